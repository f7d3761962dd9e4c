//! Latency monitor: every second, the spread of wake-up latency and step time of the ticks of that second,
//! and where the time went between pen and arm (medians of that second; - where it is not known).
//!
//! `cargo run -p foretrace-client --example latency_monitor [INSTANCE] [SECONDS]`

use std::process::ExitCode;
use std::time::{Duration, Instant};

use foretrace_client::{Attachment, Foretrace, Instance, Stage};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let number = arguments.next().map_or(Ok(0), |text| text.parse())?;
    let seconds: u64 = arguments.next().map_or(Ok(u64::MAX), |text| text.parse())?;

    let mut foretrace = Foretrace::attach_within(&Instance::new(number)?, Duration::from_secs(2))?;
    let mut telemetry = foretrace.telemetry()?;
    println!(
        "daemon {}, [us]  wake-up p50/p99/max   step p50/p99/max   ticks  lost   [ms] pen: reader transport \
         age   computed   to the arm",
        foretrace.daemon().pid
    );

    for _ in 0..seconds {
        let (mut wakeup, mut step) = (Vec::new(), Vec::new());
        let mut parts: [Vec<u64>; 5] = Default::default();
        let end = Instant::now() + Duration::from_secs(1);
        while Instant::now() < end {
            telemetry.drain(|record| {
                wakeup.push(record.stage(Stage::Wakeup));
                step.push(record.stage(Stage::Step));
                let chain = record.chain;
                let pen = [chain.pen_reader_ns, chain.pen_transport_ns, chain.pen_age_ns];
                let arm = [chain.compute_ns, chain.command_transport_ns];
                for (part, ns) in parts.iter_mut().zip(pen.into_iter().chain(arm)) {
                    part.extend((ns != u64::MAX).then_some(ns));
                }
            });
            std::thread::sleep(Duration::from_millis(50));
        }
        if step.is_empty() {
            println!("no ticks; is the daemon up? {}", foretrace.daemon_is_up());
            // New services need new handles.
            if let Ok(Attachment::Renewed) = foretrace.reattach_if_needed() {
                telemetry = foretrace.telemetry()?;
            }
            continue;
        }
        let [reader, transport, age, computed, to_the_arm] = parts.each_mut().map(|part| median_ms(part));
        println!(
            "{:>33} {:>18} {:>7} {:>5} {reader:>18} {transport:>9} {age:>4} {computed:>10} {to_the_arm:>12}",
            spread(&mut wakeup),
            spread(&mut step),
            step.len(),
            telemetry.lost()
        );
    }
    Ok(())
}

/// The median in milliseconds.
fn median_ms(ns: &mut [u64]) -> String {
    ns.sort_unstable();
    ns.get(ns.len() / 2).map_or_else(|| "-".to_owned(), |&ns| format!("{:.2}", ns as f64 * 1e-6))
}

/// p50/p99/max in microseconds.
fn spread(ns: &mut [u32]) -> String {
    ns.sort_unstable();
    let at = |per_cent: usize| {
        ns.get((ns.len() * per_cent / 100).min(ns.len() - 1)).map_or(0.0, |&ns| f64::from(ns))
    };
    format!("{:.1}/{:.1}/{:.1}", at(50) / 1e3, at(99) / 1e3, at(100) / 1e3)
}
