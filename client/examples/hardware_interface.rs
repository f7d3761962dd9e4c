//! Hardware interface: follows joint commands at the controller's own rate and reports the joints back.
//!
//! `cargo run -p foretrace-client --example hardware_interface [INSTANCE] [SECONDS]`
//!
//! It needs `foretrace daemon` and takes the arm's place there: do not start it beside `foretrace arm sim`.
//! The arm moves after `foretrace request arm`.
//!
//! The arm here is ideal: it follows its commands exactly. Replace `Drive` with calls to your controller and
//! keep the loop: it shows every duty of a consumer. Commands of another boot, replayed or malformed never
//! arrive (`Commands` refuses and counts them); a valid one is followed by q + q̇·(now − stamp) until
//! `valid_until`; after that the arm brakes by itself, so that a daemon that dies is harmless. No error
//! ends the loop: an arm in motion needs it to brake.

use std::f64::consts::{FRAC_PI_2, PI};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use foretrace_client::{
    Commands, DaemonChange, Demand, Foretrace, Instance, JOINTS, JointState, JointStates, Lasting, RobotMode,
    SafetyMode, ServiceError, demand_at, monotonic_now_ns,
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

    let foretrace = Foretrace::attach_within(&Instance::new(number)?, Duration::from_secs(2))?;
    println!("reporting to daemon {}; it moves after `foretrace request arm`", foretrace.daemon().pid);
    let handles = open(&foretrace)?;
    let mut ports = Lasting::new(foretrace, handles);
    // Where the preset `ur5` expects the arm: above the paper, tool down.
    let mut drive = Drive { q: [PI, -1.3, 1.8, -2.0708, -FRAC_PI_2, 0.0], qd: [0.0; JOINTS] };

    let mut next = Instant::now();
    let (mut cycle, mut not_sent) = (0_u64, 0_u64);
    while cycle / RATE_HZ < seconds {
        let now = monotonic_now_ns();
        let command = ports.handle.as_mut().and_then(|(commands, _)| commands.latest());
        let demand = command.map_or(Demand::Brake, |command| demand_at(command, now));
        match demand {
            Demand::Follow { q, qd } => drive = Drive { q, qd },
            Demand::Brake => drive.brake(CYCLE.as_secs_f64()),
        }
        if let Some((commands, states)) = &mut ports.handle {
            let state = JointState {
                commands_received: commands.received(),
                commands_refused: commands.rejections().total(),
                q: drive.q,
                qd: drive.qd,
                // A real controller has stops of its own: report them, `ProtectiveStop` and `PowerOff` too.
                safety_mode: SafetyMode::Normal.into(),
                robot_mode: RobotMode::Running.into(),
                // The echo of the pen sample's identity: the command obeyed, and when it arrived.
                ..commands.echo()
            };
            // The ideal arm is there at `now`. Of a real one: the clock right after measuring.
            not_sent += u64::from(!states.publish(now, state).unwrap_or(false));
        }

        cycle += 1;
        if cycle.is_multiple_of(RATE_HZ)
            && let Some((commands, _)) = &ports.handle
        {
            println!(
                "joint 0 {:+.4} rad, {} commands, {} lost, {not_sent} states not sent",
                drive.q[0],
                commands.received(),
                commands.dropped()
            );
        }
        // Attaching to another daemon can take seconds: only while the arm stands.
        if demand == Demand::Brake && drive.qd == [0.0; JOINTS] {
            let (change, error) = ports.look(open);
            if let Some(error) = error {
                println!("{error}");
            }
            if let Some(words) = change.words("standing, and waiting for it") {
                println!("{words}");
            }
            if change != DaemonChange::None {
                // Cycles that were lost meanwhile are not made up for.
                next = Instant::now();
            }
        }
        next += CYCLE;
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    Ok(())
}

/// The handles of an arm. One unread command is kept, the newest: it needs no other.
fn open(foretrace: &Foretrace) -> Result<(Commands, JointStates), ServiceError> {
    Ok((foretrace.commands(1)?, foretrace.joint_states()?))
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
