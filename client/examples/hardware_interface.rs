//! Hardware interface: follows joint commands at the controller's own rate and reports the joints back.
//!
//! `cargo run -p foretrace-client --example hardware_interface [INSTANCE] [SECONDS]`
//!
//! The arm here is ideal: it follows its commands exactly. Replace `Drive` with calls to your controller and
//! keep the loop: it shows every duty of a consumer. Commands of another boot, replayed or malformed never
//! arrive (`Commands` refuses and counts them); a valid one is followed by q + q̇·(now − stamp) until
//! `valid_until`; after that the arm brakes by itself, so that a daemon that dies is harmless.

use std::f64::consts::{FRAC_PI_2, PI};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use foretrace_client::{
    Attachment, Demand, Foretrace, Instance, JOINTS, JointState, RobotMode, SafetyMode, demand_at,
    monotonic_now_ns,
};

/// Of the controller: 125 Hz, as a CB3 has.
const RATE_HZ: u64 = 125;
const CYCLE: Duration = Duration::from_nanos(1_000_000_000 / RATE_HZ);
/// How hard the arm brakes by itself \[rad/s²\]: `robot.stale_deceleration_radps2`. The daemon relies on it.
const BRAKING: f64 = 20.0;

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
    let seconds = arguments.next().map_or(Ok(u64::MAX), |text| text.parse())?;

    let mut foretrace = Foretrace::attach_within(&Instance::new(number)?, Duration::from_secs(2))?;
    let mut commands = foretrace.commands(1)?;
    let mut states = foretrace.joint_states()?;
    // Where the preset `ur5` expects the arm: above the paper, tool down.
    let mut drive = Drive { q: [PI, -1.3, 1.8, -2.0708, -FRAC_PI_2, 0.0], qd: [0.0; JOINTS] };
    println!("reporting to daemon {}; it moves once the daemon is armed", foretrace.daemon().pid);

    let mut next = Instant::now();
    let mut cycle: u64 = 0;
    while cycle / RATE_HZ < seconds {
        let now = monotonic_now_ns();
        let command = commands.latest().copied();
        match command.map_or(Demand::Brake, |command| demand_at(&command, now)) {
            Demand::Follow { q, qd } => drive = Drive { q, qd },
            Demand::Brake => drive.brake(CYCLE.as_secs_f64()),
        }
        states.publish(
            now,
            JointState {
                commands_received: commands.received(),
                commands_refused: commands.rejections().total(),
                q: drive.q,
                qd: drive.qd,
                safety_mode: SafetyMode::Normal.into(),
                robot_mode: RobotMode::Running.into(),
                // The echo of the pen sample's identity: the command obeyed, and when it arrived.
                ..commands.echo()
            },
        )?;

        cycle += 1;
        if cycle.is_multiple_of(RATE_HZ) {
            println!(
                "joint 0 {:+.4} rad, {} commands, {} lost",
                drive.q[0],
                commands.received(),
                commands.dropped()
            );
            match foretrace.reattach_if_needed() {
                Ok(Attachment::Renewed) => {
                    // The old handles first: only one arm may report at a time.
                    drop((commands, states));
                    commands = foretrace.commands(1)?;
                    states = foretrace.joint_states()?;
                }
                Ok(_) => {}
                Err(error) => println!("{error}"),
            }
        }
        next += CYCLE;
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    Ok(())
}

/// An ideal arm.
struct Drive {
    q: [f64; JOINTS],
    qd: [f64; JOINTS],
}

impl Drive {
    /// One cycle of braking to a stand.
    fn brake(&mut self, dt: f64) {
        for (q, qd) in self.q.iter_mut().zip(&mut self.qd) {
            let slower = qd.signum() * (qd.abs() - BRAKING * dt).max(0.0);
            *q += 0.5 * (*qd + slower) * dt;
            *qd = slower;
        }
    }
}
