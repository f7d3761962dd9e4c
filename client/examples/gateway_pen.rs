//! A pen in another user's process: draws a circle of 2 cm through a gateway's socket.
//!
//! `foretrace gateway --socket /tmp/foretrace-pen.socket --allow-uid UID --mode 666` as the daemon's user,
//! then `cargo run -p foretrace-client --example gateway_pen [SOCKET] [SECONDS]` as user UID.

use std::f64::consts::TAU;
use std::time::Duration;

use foretrace_client::{GatewayError, GatewayFeed, PenReading, monotonic_now_ns};

/// As a tablet sends.
const PERIOD: Duration = Duration::from_millis(5);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let socket = arguments.next().unwrap_or_else(|| "/tmp/foretrace-pen.socket".to_owned());
    let seconds: f64 = arguments.next().map_or(Ok(10.0), |text| text.parse())?;

    let mut pen = GatewayFeed::connect(socket)?;
    for sample in 0..(seconds / PERIOD.as_secs_f64()) as u64 {
        let angle = TAU * 0.5 * sample as f64 * PERIOD.as_secs_f64();
        let reading = PenReading {
            device_stamp_ns: monotonic_now_ns(),
            x_m: 0.1 + 0.02 * angle.cos(),
            y_m: 0.05 + 0.02 * angle.sin(),
            contact: true,
            ..Default::default()
        };
        match pen.send(reading) {
            Ok(()) => {}
            // Nothing was sent, and the connection stands.
            Err(GatewayError::Invalid(why)) => eprintln!("reading left out: {why}"),
            Err(error) => return Err(error.into()),
        }
        std::thread::sleep(PERIOD);
    }
    // How many samples it passed on and refused, and why.
    println!("{} sent; the gateway: {}", pen.sent(), pen.finish()?);
    Ok(())
}
