//! What a recorder takes: pen samples, joint states, and the inputs of all ticks with the snapshots that a
//! replay begins with. Counts them.
//!
//! `cargo run -p foretrace-client --example watch_everything [INSTANCE] [SECONDS]`

use std::time::{Duration, Instant};

use foretrace_client::{Foretrace, Instance};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let number = arguments.next().map_or(Ok(0), |text| text.parse())?;
    let seconds: u64 = arguments.next().map_or(Ok(10), |text| text.parse())?;

    let foretrace = Foretrace::attach_within(&Instance::new(number)?, Duration::from_secs(2))?;
    let (mut pen, mut joints) = (foretrace.pen_watch()?, foretrace.joint_watch()?);
    let mut inputs = foretrace.inputs()?;
    let (mut strokes, mut farthest_rad, mut ticks) = (0_u64, 0.0_f64, 0);
    let mut touched = false;
    let end = Instant::now() + Duration::from_secs(seconds);
    while Instant::now() < end {
        pen.drain(|sample| {
            strokes += u64::from(sample.contact() && !touched);
            touched = sample.contact();
        });
        joints.drain(|state| farthest_rad = state.q.iter().fold(farthest_rad, |most, q| most.max(q.abs())));
        // The first part of a tick counts it; a flood of pen samples takes several.
        inputs.drain(|input| ticks += u64::from(input.part == 0));
        inputs.snapshots(|snapshot| {
            println!("{} {}: {} bytes", snapshot.kind.label(), snapshot.number, snapshot.bytes.len());
        });
        // A buffer holds some hundred milliseconds.
        std::thread::sleep(Duration::from_millis(4));
    }
    println!("{ticks} ticks, {} lost; {} snapshots broken", inputs.lost(), inputs.snapshots_broken());
    println!("{strokes} strokes, {} samples lost; joints up to {farthest_rad:.2} rad", pen.lost());
    Ok(())
}
