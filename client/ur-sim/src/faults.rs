//! Faults and an operator's acts on request: one line in, one line out (port 30090, or `--do`).

use std::time::Duration;

use foretrace_sim::arm::Fault;
use serde_json::json;

use super::options::{Series, Service};
use super::safety::{ProtectiveReason, RobotMode, SafetyBreach};
use super::trouble::Trouble;
use super::world::World;

/// All that is understood.
pub const HELP: &str = "protective-stop, unlock, emergency-stop, emergency-reset, safeguard-stop, \
     safeguard-reset, violation, fault, restart-safety, recovery on|off, backdrive on|off, power-off, \
     power-up, slider 0..1, pause, play, stop-program, remote on|off, payload KG, tcp X Y Z RX RY RZ, \
     arm KIND[:VALUE]|mended, reboot [SECONDS], service NAME on|off, cut SECONDS [ADDRESS], delay MS, \
     jitter MS, digital-in N on|off, status, help";

/// Does what `line` says; the answer begins with `ok` or `error`, but that of `status`, which is JSON.
pub fn obey(world: &mut World, trouble: &Trouble, line: &str) -> String {
    let mut words = line.split_ascii_whitespace();
    let command = words.next().unwrap_or("");
    let arguments: Vec<&str> = words.take(8).collect();
    match act(world, trouble, command, &arguments) {
        Ok(None) => "ok".to_owned(),
        Ok(Some(text)) => text,
        Err(why) => format!("error: {why}"),
    }
}

fn number(arguments: &[&str], at: usize, range: std::ops::RangeInclusive<f64>) -> Result<f64, String> {
    let number = arguments.get(at).and_then(|word| word.parse::<f64>().ok());
    number
        .filter(|number| range.contains(number))
        .ok_or_else(|| format!("wants a number from {} to {}", range.start(), range.end()))
}

fn on_off(arguments: &[&str], at: usize) -> Result<bool, String> {
    match arguments.get(at) {
        Some(&"on") => Ok(true),
        Some(&"off") => Ok(false),
        _ => Err("wants on or off".to_owned()),
    }
}

fn act(
    world: &mut World,
    trouble: &Trouble,
    command: &str,
    arguments: &[&str],
) -> Result<Option<String>, String> {
    let seconds = |seconds: f64| Duration::from_secs_f64(seconds);
    match command {
        "protective-stop" => world.robot.protective_stop(ProtectiveReason::Asked),
        "unlock" => {
            let cycle = world.robot.cycle;
            world.robot.safety.unlock(cycle)?;
        }
        "emergency-stop" => world.robot.emergency_stop(),
        "emergency-reset" => world.robot.safety.emergency = false,
        "safeguard-stop" => world.robot.safeguard_stop(),
        "safeguard-reset" => world.robot.safety.safeguard = false,
        "violation" => world.robot.breach(SafetyBreach::Violation),
        "fault" => world.robot.breach(SafetyBreach::Fault),
        "restart-safety" => world.restart_safety(),
        "recovery" if on_off(arguments, 0)? => world.robot.breach(SafetyBreach::Recovery),
        "recovery" => {
            let there = world.robot.safety.breach == Some(SafetyBreach::Recovery);
            refuse(there, "the robot is not in recovery mode")?;
            world.robot.safety.breach = None;
        }
        "backdrive" => {
            let done = world.backdrive(on_off(arguments, 0)?);
            refuse(done, "the power is off, or it is so already")?;
        }
        "power-off" => world.power_off(),
        "power-up" => {
            refuse(world.robot.safety.lets_power_on(), "a safety stop keeps the power off")?;
            if matches!(world.robot.mode, RobotMode::PowerOff | RobotMode::Idle) {
                world.robot.mode = RobotMode::Releasing { until: None };
            }
        }
        "slider" => world.robot.slider = number(arguments, 0, 0.0..=1.0)?,
        "pause" => refuse(world.pause(), "no program runs")?,
        "play" => refuse(world.play(), "there is no program, or the robot is not ready")?,
        "stop-program" => world.stop(),
        "remote" => {
            refuse(world.robot.options.series == Series::E, "CB3 knows no remote control")?;
            world.remote = on_off(arguments, 0)?;
        }
        "payload" => world.robot.payload.0 = number(arguments, 0, 0.0..=100.0)?,
        "tcp" => {
            let mut pose = [0.0; 6];
            for (at, value) in pose.iter_mut().enumerate() {
                *value = number(arguments, at, -10.0..=10.0)?;
            }
            world.robot.tcp_offset = pose;
        }
        "arm" if arguments == ["mended"] => world.robot.mend(),
        "arm" => {
            let text = arguments.first().copied().unwrap_or("");
            let (kind, value) =
                text.split_once(':').map_or((text, None), |(kind, value)| (kind, Some(value)));
            let fault = value.map_or_else(|| format!("{kind}@0"), |value| format!("{kind}@0:{value}"));
            let fault: Fault =
                fault.parse().map_err(|error: foretrace_sim::arm::NoFault| error.to_string())?;
            world.robot.break_now(fault.kind);
        }
        "digital-in" => {
            let bit = number(arguments, 0, 0.0..=17.0)? as u32;
            let on = u64::from(on_off(arguments, 1)?);
            world.robot.digital_inputs = world.robot.digital_inputs & !(1 << bit) | on << bit;
        }
        "reboot" => {
            let away = if arguments.is_empty() { 3.0 } else { number(arguments, 0, 0.1..=600.0)? };
            world.reboot();
            trouble.reboot(seconds(away));
        }
        "service" => {
            let name = arguments.first().copied().unwrap_or("");
            let known = Service::ALL.into_iter().find(|service| service.name() == name);
            let service = known.filter(|service| *service != Service::Faults);
            trouble.switch(service.ok_or("knows no such service")?, on_off(arguments, 1)?);
        }
        "cut" => {
            let whose = arguments.get(1).map(|word| word.parse());
            let whose = whose.transpose().map_err(|_| "wants an address, as 127.0.0.7, or none")?;
            let done = trouble.cut(seconds(number(arguments, 0, 0.0..=600.0)?), whose);
            refuse(done, "too many clients are cut off already; cut 0 ends all cuts")?;
        }
        "delay" => trouble.delay(seconds(number(arguments, 0, 0.0..=1000.0)? * 1e-3)),
        "jitter" => trouble.jitter(seconds(number(arguments, 0, 0.0..=1000.0)? * 1e-3)),
        "status" => return Ok(Some(status(world))),
        "help" => return Ok(Some(HELP.to_owned())),
        _ => return Err(format!("knows {HELP}")),
    }
    Ok(None)
}

fn refuse(done: bool, why: &str) -> Result<(), String> {
    if done { Ok(()) } else { Err(why.to_owned()) }
}

/// Where everything stands, as one line of JSON; keys are stable.
#[must_use]
pub fn status(world: &World) -> String {
    let actual = world.robot.actual();
    json!({
        "timestamp_s": world.robot.timestamp(),
        "robot_mode": world.robot.mode.word(),
        "safety_mode": world.robot.safety.word(),
        "protective_stop": world.robot.safety.protective().map(ProtectiveReason::text),
        "runtime_state": world.runtime().number(),
        "program": world.program_name(),
        "speed_slider": world.robot.slider,
        "speed_scaling": world.robot.speed_scaling,
        "remote": world.remote,
        "setup": world.robot.setup.settings(),
        "q_rad": actual.q,
        "qd_radps": actual.qd,
    })
    .to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::ControllerOptions;

    #[test]
    fn every_line_is_answered_by_one() {
        let mut world = World::new(ControllerOptions::new(Series::E));
        let trouble = Trouble::default();
        let mut ask = |line: &str| obey(&mut world, &trouble, line);
        for good in [
            "slider 0.5",
            "delay 20",
            "jitter 5",
            "cut 0",
            "cut 0.1 127.0.0.7",
            "remote off",
            "payload 1.5",
            "tcp 0 0 0.1 0 0 0",
            "service dashboard off",
            "service dashboard on",
            "arm slow:0.5",
            "arm mended",
            "backdrive on",
            "backdrive off",
            "power-up",
            "recovery on",
            "recovery off",
            "violation",
            "restart-safety",
            "fault",
            "restart-safety",
            "digital-in 3 on",
            "safeguard-stop",
            "safeguard-reset",
            "protective-stop",
            "emergency-stop",
            "emergency-reset",
            "reboot 1",
            "stop-program",
        ] {
            assert_eq!(ask(good), "ok", "{good}");
        }
        let mut cb3 = World::new(ControllerOptions::new(Series::Cb3));
        assert!(obey(&mut cb3, &trouble, "remote off").starts_with("error: CB3"));
        let mut ask = |line: &str| obey(&mut world, &trouble, line);
        for bad in [
            "",
            "slider",
            "slider 2",
            "slider nan",
            "remote",
            "tcp 1 2",
            "service faults off",
            "arm bent",
            "pause",
            "cut -1",
            "cut 1 everybody",
            "recovery off",
            "recovery",
            "backdrive on",
            "digital-in 99 on",
        ] {
            assert!(ask(bad).starts_with("error: "), "{bad}");
        }
        let status: serde_json::Value = serde_json::from_str(&ask("status")).unwrap();
        assert_eq!(status["robot_mode"], "POWER_OFF");
        assert!(!ask("help").contains('\n'));
    }
}
