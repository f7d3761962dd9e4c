//! A line per second of the daemon's status: mode, trust, ages of pen and arm, and what is refused.
//!
//! `cargo run -p foretrace-client --example status_line [INSTANCE] [SECONDS]`

use std::time::Duration;

use foretrace_client::{Attachment, Foretrace, Instance, Mode, Status};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let number = arguments.next().map_or(Ok(0), |text| text.parse())?;
    let seconds: u64 = arguments.next().map_or(Ok(u64::MAX), |text| text.parse())?;

    let mut foretrace = Foretrace::attach_within(&Instance::new(number)?, Duration::from_secs(2))?;
    let mut reader = foretrace.status()?;
    for _ in 0..seconds {
        std::thread::sleep(Duration::from_secs(1));
        match reader.newest_if_new() {
            Some(status) => println!("{}", line(&status)),
            None => {
                println!("no status for {:?}; is the daemon up? {}", reader.age(), foretrace.daemon_is_up());
                // New services need new handles.
                if let Ok(Attachment::Renewed) = foretrace.reattach_if_needed() {
                    reader = foretrace.status()?;
                }
            }
        }
    }
    Ok(())
}

fn line(status: &Status) -> String {
    // A number from a newer daemon has no name here.
    let mode = Mode::try_from(status.mode).map_or("unknown", Mode::label);
    let age = |ns: u64| if ns == u64::MAX { "-".to_owned() } else { format!("{:.1}", ns as f64 * 1e-6) };
    format!(
        "{mode:>9}  trust {:.2}  pen {:>6} ms  arm {:>6} ms  {} ticks, {} late, {} pen samples refused",
        status.trust,
        age(status.pen_age_ns),
        age(status.joint_state_age_ns),
        status.counters.ticks,
        status.counters.overruns,
        status.counters.pen_rejected.total(),
    )
}
