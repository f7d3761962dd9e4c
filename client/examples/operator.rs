//! An operator: arms, holds the dead-man switch for some seconds, disarms; stops if anything goes wrong.
//!
//! `cargo run -p foretrace-client --example operator [INSTANCE] [SECONDS]`
//!
//! Try it in simulation: `foretrace daemon`, `foretrace arm sim` and `foretrace play glyphs:Hello` first.

use std::time::{Duration, Instant};

use foretrace_client::{DeadMan, Foretrace, Instance, stop};

const PATIENCE: Duration = Duration::from_secs(2);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let instance = Instance::new(arguments.next().map_or(Ok(0), |text| text.parse())?)?;
    let seconds = arguments.next().map_or(Ok(5), |text| text.parse())?;

    let led = lead(&instance, Duration::from_secs(seconds));
    if led.is_err() {
        // Needs neither attachment nor shared memory, and says if the arm's own stop has to be used.
        match stop(&instance, PATIENCE) {
            Ok(stopped) => eprintln!("stopped: {}", stopped.words()),
            Err(error) => eprintln!("{error}"),
        }
    }
    led
}

fn lead(instance: &Instance, length: Duration) -> Result<(), Box<dyn std::error::Error>> {
    let foretrace = Foretrace::attach_within(instance, PATIENCE)?;
    // Held from before arming: the arm stops when it falls silent, and when this program dies.
    let mut switch = foretrace.dead_man()?;
    switch.beat()?;
    let mut requests = foretrace.requests();
    requests.arm(PATIENCE)?;
    println!("armed");
    let end = Instant::now() + length;
    while Instant::now() < end {
        switch.beat()?;
        std::thread::sleep(DeadMan::INTERVAL);
    }
    requests.disarm(PATIENCE)?;
    println!("disarmed");
    Ok(())
}
