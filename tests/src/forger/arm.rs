//! An ideal arm that turns faulty.

use std::error::Error;
use std::f64::consts::{FRAC_PI_2, PI};
use std::time::{Duration, Instant};

use foretrace_client::{Foretrace, Instance};
use foretrace_shm::{Header, JointState, Message, RobotMode, SafetyMode, host_boot_id, monotonic_now_ns};
use serde_json::{Value, json};

use super::{Forge, bad_states, pace};

/// Near `robot.home_rad` of the preset `ur5`.
const HOME: [f64; foretrace_shm::JOINTS] = [PI, -1.3, 1.8, -2.0708, -FRAC_PI_2, 0.0];
const CYCLE_NS: u64 = 8_000_000;

/// Follows its commands exactly; in the last half of `time` every state is invalid.
pub(super) fn forge(
    instance: &Instance,
    foretrace: &Foretrace,
    time: Duration,
) -> Result<Value, Box<dyn Error>> {
    let mut forge = Forge::<JointState>::open(instance)?;
    let mut commands = foretrace.commands(1)?;
    let begin = Instant::now();
    let (mut sequence, mut turned) = (0, false);
    for cycle in 0.. {
        pace(begin, cycle * CYCLE_NS);
        let elapsed = begin.elapsed();
        if elapsed >= time {
            break;
        }
        let header = Header { sequence: sequence + 1, stamp_ns: monotonic_now_ns(), boot_id: host_boot_id() };
        let mut state = JointState {
            header,
            q: HOME,
            safety_mode: SafetyMode::Normal.into(),
            robot_mode: RobotMode::Running.into(),
            ..JointState::default()
        };
        if let Some(command) = commands.latest() {
            (state.q, state.qd) = (command.q, command.qd);
            state.echo(command, header.stamp_ns);
        }
        if elapsed < time / 2 {
            *state.header_mut() = header;
            sequence += 1;
            forge.send("good", state)?;
        } else {
            if !turned {
                println!("{}", json!({ "turns": monotonic_now_ns() }));
                turned = true;
            }
            for (what, bad) in bad_states(state) {
                forge.send(what, bad)?;
            }
        }
    }
    Ok(json!(forge.sent))
}

/// Stands at home and reports it in degrees.
pub(super) fn degrees(instance: &Instance, time: Duration) -> Result<Value, Box<dyn Error>> {
    let mut forge = Forge::<JointState>::open(instance)?;
    let begin = Instant::now();
    for cycle in 0_u64.. {
        pace(begin, cycle * CYCLE_NS);
        if begin.elapsed() >= time {
            break;
        }
        let header = Header { sequence: cycle + 1, stamp_ns: monotonic_now_ns(), boot_id: host_boot_id() };
        let state = JointState {
            header,
            q: HOME.map(f64::to_degrees),
            safety_mode: SafetyMode::Normal.into(),
            robot_mode: RobotMode::Running.into(),
            ..JointState::default()
        };
        forge.send("degrees", state)?;
    }
    Ok(json!(forge.sent))
}
