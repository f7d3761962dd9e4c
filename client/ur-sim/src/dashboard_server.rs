//! What the dashboard (port 29999) answers, line by line.
//!
//! *Source*: dashboard server guides of CB3 and e-Series, and what the Universal Robots client library
//! expects. PolyScope's files do not exist here: nothing can be loaded, and no report is made.

use super::options::{MODEL, Series};
use super::world::{Runtime, World};
use foretrace_ur::dashboard::SIMULATED;
use foretrace_ur::primary::MessageContent;

/// The first line of a connection.
pub const GREETING: &str = "Connected: Universal Robots Dashboard Server";

/// Of a command that a series never had.
const NEVER: u32 = u32::MAX;
/// Longest message that is logged \[characters\].
const LONGEST_LOGGED: usize = 255;
/// Roles of a CB3's pendant.
const ROLES: [&str; 5] = ["programmer", "operator", "none", "locked", "restricted"];
const MODES: [&str; 2] = ["MANUAL", "AUTOMATIC"];

/// Of an e-Series in local control.
const LOCAL: &str = "Command is not allowed due to safety reasons, please switch robot to Remote Control mode and \
                     reconnect to port 29999";

/// What comes of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DashboardReply {
    Line(String),
    /// A line, then the connection ends.
    Last(String),
    /// A line, then all connections end and the ports are closed.
    Off(String),
}

/// Commands that remote control is needed for, where the series knows it.
const REMOTE_ONLY: [&str; 8] = [
    "play",
    "stop",
    "pause",
    "power on",
    "power off",
    "brake release",
    "unlock protective stop",
    "restart safety",
];

/// Answers `command`.
pub fn answer(world: &mut World, command: &str) -> DashboardReply {
    let series = world.robot.options.series;
    let version = world.robot.options.version;
    // Least minor version of 3.x and of 5.x.
    let since = |cb3, e| version.minor >= if series == Series::Cb3 { cb3 } else { e } || version.major > 5;
    let failed = || format!("Failed to execute: {command}");
    let (first, argument) = command.split_once(' ').unwrap_or((command, ""));
    if series == Series::E && !world.remote && (REMOTE_ONLY.contains(&command) || first == "load") {
        return DashboardReply::Line(LOCAL.to_owned());
    }
    let runtime = world.runtime();
    // Of the program that is loaded on the pendant, which none can be: those of sockets are not.
    let name = "<unnamed>";
    DashboardReply::Line(match command {
        "quit" => return DashboardReply::Last("Disconnected".to_owned()),
        "shutdown" => {
            world.reboot();
            return DashboardReply::Off("Shutting down".to_owned());
        }
        "robotmode" => format!("Robotmode: {}", world.robot.mode.word()),
        "safetymode" => format!("Safetymode: {}", world.robot.safety.word()),
        "safetystatus" => format!("Safetystatus: {}", world.robot.safety.word()),
        "running" => format!("Program running: {}", runtime == Runtime::Playing),
        "programState" => match runtime {
            Runtime::Stopped => format!("STOPPED {name}"),
            Runtime::Pausing | Runtime::Paused => format!("PAUSED {name}"),
            Runtime::Playing | Runtime::Resuming => format!("PLAYING {name}"),
        },
        "get loaded program" => "No program loaded".to_owned(),
        "isProgramSaved" => format!("true {name}"),
        "PolyscopeVersion" => format!("URSoftware {version} {SIMULATED}"),
        "version" => version.to_string(),
        "get robot model" if since(12, 6) => MODEL.to_owned(),
        "get serial number" if since(12, 6) => "20201234567".to_owned(),
        "is in remote control" if since(NEVER, 6) => world.remote.to_string(),
        "get operational mode" if since(NEVER, 6) => world.operational_mode.to_owned(),
        "clear operational mode" if since(NEVER, 0) => {
            world.operational_mode = "NONE";
            "No longer controlling the operational mode. Current operational mode: 'MANUAL'.".to_owned()
        }
        "getUserRole" if since(1, NEVER) => world.user_role.to_ascii_uppercase(),
        "saveLog" if since(13, 8) => "Log saved to disk".to_owned(),
        "close popup" => {
            world.popups.clear();
            "closing popup".to_owned()
        }
        "close safety popup" => "closing safety popup".to_owned(),
        "power on" => {
            world.power_on();
            "Powering on".to_owned()
        }
        "power off" => {
            world.power_off();
            "Powering off".to_owned()
        }
        "brake release" if world.brake_release() => "Brake releasing".to_owned(),
        "play" if world.play() => "Starting program".to_owned(),
        "stop" if world.stop_all() => "Stopped".to_owned(),
        "pause" if world.pause() => "Pausing program".to_owned(),
        "play" | "stop" | "pause" | "brake release" => failed(),
        "unlock protective stop" => {
            let cycle = world.robot.cycle;
            match world.robot.safety.unlock(cycle) {
                Ok(()) => "Protective stop releasing".to_owned(),
                Err(why) => why.to_owned(),
            }
        }
        "restart safety" => {
            world.restart_safety();
            "Restarting safety".to_owned()
        }
        _ => match first {
            "load" => {
                format!("File not found: {}", argument.strip_prefix("installation ").unwrap_or(argument))
            }
            "popup" => "showing popup".to_owned(),
            "addToLog" if argument.trim().is_empty() => "No log message to add".to_owned(),
            "addToLog" => {
                world.say(MessageContent::Text(argument.chars().take(LONGEST_LOGGED).collect()));
                "Added log message".to_owned()
            }
            "setUserRole" if since(1, NEVER) => match ROLES.into_iter().find(|role| *role == argument) {
                Some(role) => {
                    world.user_role = role;
                    format!("Setting user role: {role}")
                }
                None => format!("Failed setting user role: {argument}"),
            },
            _ => asked(world, command, since(NEVER, 0), since(13, 8)),
        },
    })
}

/// Commands of several words with an argument.
fn asked(world: &mut World, command: &str, e_series: bool, reports: bool) -> String {
    if let Some(mode) = command.strip_prefix("set operational mode ").filter(|_| e_series) {
        return match MODES.into_iter().find(|known| known.eq_ignore_ascii_case(mode)) {
            Some(known) => {
                world.operational_mode = known;
                format!("Operational mode {known} is set")
            }
            None => format!("Failed setting operational mode: {mode}"),
        };
    }
    if command.starts_with("generate flight report") && reports {
        return "Error generating flight report: no reports are simulated".to_owned();
    }
    if command.starts_with("generate support file") && reports {
        return "Error generating support file: no reports are simulated".to_owned();
    }
    format!("could not understand: '{command}'")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrival::Arrival;
    use crate::options::ControllerOptions;

    fn line(world: &mut World, command: &str) -> String {
        match answer(world, command) {
            DashboardReply::Line(line) | DashboardReply::Last(line) | DashboardReply::Off(line) => line,
        }
    }

    #[test]
    fn power_up_goes_as_clients_do_it() {
        let mut world = World::new(ControllerOptions { running: false, ..ControllerOptions::new(Series::E) });
        assert_eq!(line(&mut world, "robotmode"), "Robotmode: POWER_OFF");
        assert_eq!(line(&mut world, "power on"), "Powering on");
        (0..300).for_each(|_| world.cycle());
        assert_eq!(line(&mut world, "robotmode"), "Robotmode: IDLE");
        assert_eq!(line(&mut world, "brake release"), "Brake releasing");
        (0..300).for_each(|_| world.cycle());
        assert_eq!(line(&mut world, "robotmode"), "Robotmode: RUNNING");
        assert_eq!(line(&mut world, "play"), "Failed to execute: play");
    }

    #[test]
    fn releasing_the_brakes_powers_on_where_the_safety_system_lets_it() {
        for asked_again in [false, true] {
            let options = ControllerOptions { running: false, ..ControllerOptions::new(Series::E) };
            let mut world = World::new(options);
            assert_eq!(line(&mut world, "brake release"), "Brake releasing");
            assert_eq!(line(&mut world, "robotmode"), "Robotmode: POWER_ON");
            (0..100).for_each(|_| world.cycle());
            if asked_again {
                assert_eq!(line(&mut world, "power on"), "Powering on");
                assert_eq!(line(&mut world, "brake release"), "Brake releasing");
            }
            (0..700).for_each(|_| world.cycle());
            assert_eq!(line(&mut world, "robotmode"), "Robotmode: RUNNING");
            world.robot.emergency_stop();
            (0..500).for_each(|_| world.cycle());
            assert_eq!(line(&mut world, "brake release"), "Failed to execute: brake release");
            assert_eq!(line(&mut world, "robotmode"), "Robotmode: POWER_OFF");
        }
    }

    #[test]
    fn a_script_of_a_socket_is_never_the_loaded_program() {
        let mut world = World::new(ControllerOptions::new(Series::Cb3));
        world.take_script("def p():\n  sync()\n  textmsg(\"ran\")\nend\n");
        assert_eq!(line(&mut world, "get loaded program"), "No program loaded");
        (0..100).for_each(|_| world.cycle());
        assert_eq!(world.runtime(), Runtime::Stopped);
        assert_eq!(line(&mut world, "get loaded program"), "No program loaded");
        assert_eq!(line(&mut world, "play"), "Failed to execute: play");
        (0..100).for_each(|_| world.cycle());
        assert_eq!(format!("{:?}", world.messages).matches("ran").count(), 1);
        world.take_script("def p():\n  while True:\n    sync()\n  end\nend\n");
        // Not paused: there is nothing to resume, and what runs is left alone.
        assert_eq!(line(&mut world, "play"), "Failed to execute: play");
        assert_eq!(world.runtime(), Runtime::Playing);
    }

    #[test]
    fn a_program_is_played_paused_and_stopped() {
        let mut world = World::new(ControllerOptions::new(Series::Cb3));
        world.take_script("def p():\n  while True:\n    sync()\n  end\nend\n");
        assert_eq!(line(&mut world, "programState"), "PLAYING <unnamed>");
        assert_eq!(line(&mut world, "running"), "Program running: true");
        assert_eq!(line(&mut world, "pause"), "Pausing program");
        (0..100).for_each(|_| world.cycle());
        assert_eq!(line(&mut world, "programState"), "PAUSED <unnamed>");
        assert_eq!(line(&mut world, "play"), "Starting program");
        assert_eq!(line(&mut world, "stop"), "Stopped");
        assert_eq!(line(&mut world, "programState"), "STOPPED <unnamed>");
        // PolyScope sees the end of a program a moment later: a stop that comes just then has not failed.
        assert_eq!(line(&mut world, "stop"), "Stopped");
        (0..100).for_each(|_| world.cycle());
        assert_eq!(line(&mut world, "stop"), "Failed to execute: stop");
    }

    #[test]
    fn stop_ends_what_a_client_left_behind_and_what_still_waits() {
        let mut world = World::new(ControllerOptions::new(Series::E));
        let program = "def left():\n  while True:\n    sync()\n  end\nend\n";
        for _ in 0..5 {
            world.arrive(Arrival::read(program)).unwrap();
        }
        world.cycle();
        assert_eq!(line(&mut world, "stop"), "Stopped");
        (0..20).for_each(|_| world.cycle());
        assert_eq!(world.runtime(), Runtime::Stopped);
        world.take_script(program);
        assert_eq!(line(&mut world, "running"), "Program running: true");
    }

    #[test]
    fn the_manuals_commands_are_answered_by_series() {
        let mut cb3 = World::new(ControllerOptions::new(Series::Cb3));
        let mut e = World::new(ControllerOptions::new(Series::E));
        let unknown = |answer: String| answer.starts_with("could not understand");
        for (command, cb3_knows, e_knows) in [
            ("get robot model", true, true),
            ("get serial number", true, true),
            ("setUserRole operator", true, false),
            ("getUserRole", true, false),
            ("set operational mode manual", false, true),
            ("get operational mode", false, true),
            ("clear operational mode", false, true),
            ("load installation default.installation", true, true),
            ("saveLog", true, true),
            ("generate flight report controller", true, true),
            ("generate support file /programs", true, true),
            ("addToLog hello", true, true),
            ("popup hello", true, true),
            ("close popup", true, true),
            ("close safety popup", true, true),
            ("safetystatus", true, true),
            ("isProgramSaved", true, true),
            ("fly", false, false),
        ] {
            assert_eq!(!unknown(line(&mut cb3, command)), cb3_knows, "CB3 {command}");
            assert_eq!(!unknown(line(&mut e, command)), e_knows, "e {command}");
        }
        assert_eq!(line(&mut cb3, "setUserRole boss"), "Failed setting user role: boss");
        assert_eq!(line(&mut cb3, "getUserRole"), "OPERATOR");
        assert_eq!(line(&mut e, "set operational mode automatic"), "Operational mode AUTOMATIC is set");
        assert_eq!(line(&mut e, "get operational mode"), "AUTOMATIC");
        assert_eq!(line(&mut e, "load installation x"), "File not found: x");
        assert_eq!(line(&mut e, "addToLog"), "No log message to add");
    }

    #[test]
    fn e_series_in_local_control_obeys_the_pendant_only() {
        let mut world = World::new(ControllerOptions::new(Series::E));
        world.remote = false;
        assert_eq!(line(&mut world, "is in remote control"), "false");
        for command in ["power off", "load x.urp", "play", "brake release"] {
            assert_eq!(
                line(&mut world, command),
                "Command is not allowed due to safety reasons, please switch robot to Remote Control mode and \
                 reconnect to port 29999",
                "{command}"
            );
        }
        assert_eq!(line(&mut world, "robotmode"), "Robotmode: RUNNING");
        world.take_script("def p():\n  sync()\nend\n");
        assert_eq!(world.runtime(), Runtime::Stopped);
    }

    #[test]
    fn older_software_does_not_know_what_came_later() {
        let mut options = ControllerOptions::new(Series::E);
        options.version.minor = 4;
        let mut world = World::new(options);
        assert_eq!(line(&mut world, "version"), "5.4.1.108318");
        assert!(line(&mut world, "is in remote control").starts_with("could not understand"));
    }

    #[test]
    fn cb3_does_not_know_what_came_with_e_series() {
        let mut world = World::new(ControllerOptions::new(Series::Cb3));
        assert!(line(&mut world, "is in remote control").starts_with("could not understand"));
        assert!(line(&mut world, "").starts_with("could not understand"));
    }
}
