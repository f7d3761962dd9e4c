//! The demo with `--arm ur`: a simulated Universal Robots controller, and the settings that go with it.

use std::net::{Ipv4Addr, TcpListener};

use foretrace_arm::priority::below_the_loop;
use foretrace_config::Config;
use foretrace_ur::bridge::address::Addresses;
use foretraced::{Base, Source};

use super::DemoArgs;
use super::crew::{Crew, words};
use crate::failure::Failure;

/// What its process is called.
pub(super) const CONTROLLER: &str = "controller";
/// What the processes of the echo pair are called.
const ECHO: [&str; 2] = ["controller's end of the echo pair", "bridge's end of the echo pair"];
/// Rate of an e-Series \[Hz\].
const E_SERIES_HZ: u32 = 500;

/// Starts a controller of the series that the settings are for, on a loopback address of its own, and waits
/// for it. Returns the address.
pub(super) fn controller(crew: &mut Crew, config: &Config, no_rights: bool) -> Result<String, Failure> {
    // Ports are fixed, as a real one's: two demos side by side need two addresses.
    let [_, a, b, c] = std::process::id().to_be_bytes();
    let address = Ipv4Addr::new(127, 100 + a % 100, b, 1 + c % 250);
    let series = if config.settings().robot.controller_rate_hz == E_SERIES_HZ { "e" } else { "cb3" };
    let mut sim = words(&["ur-sim", "--series", series, "--bind", &address.to_string()]);
    sim.extend(installation(config));
    if no_rights {
        sim.push("--no-rights".to_owned());
    }
    crew.start(CONTROLLER, &sim)?;
    crew.listening(Addresses::at(address.into()).rtde)?;
    Ok(address.to_string())
}

/// The installation that the bridge will want to find: what the settings say of tool and payload.
fn installation(config: &Config) -> Vec<String> {
    let robot = &config.settings().robot;
    let [x, y, z] = robot.ur.tcp_m.unwrap_or(robot.tool_m);
    let payload = robot.ur.payload_kg.map(|kg| format!("payload {kg}"));
    let orders = [Some(format!("tcp {x} {y} {z} 0 0 0")), payload];
    orders.into_iter().flatten().flat_map(|order| ["--do".to_owned(), order]).collect()
}

/// Starts a bare echo pair at the rate and, where they are asked for, with the priorities of controller and
/// bridge; what it counts goes to `report`.
pub(super) fn echo(crew: &mut Crew, config: &Config, no_rights: bool, report: &str) -> Result<(), Failure> {
    // The system chooses a port that is free.
    let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|listener| listener.local_addr());
    let at = free.map_err(|error| Failure::failed(format_args!("no free port: {error}"), ""))?.to_string();
    let rate = config.settings().robot.controller_rate_hz.to_string();
    let mut end = |name, role, priority: u32, more: &[&str]| {
        let mut end = words(&["ur-echo", role, "--at", &at, "--rate", &rate]);
        end.extend(words(more));
        if !no_rights {
            end.push(format!("--priority={priority}"));
        }
        crew.start(name, &end)
    };
    let [controller, bridge] = ECHO;
    end(controller, "controller", crate::ur_sim::PRIORITY, &["--json", report])?;
    end(bridge, "bridge", below_the_loop(config.settings()), &[])
}

/// Ends both, the one that reports first.
pub(super) fn echo_ends(crew: &mut Crew) -> Result<(), Failure> {
    ECHO.into_iter().try_for_each(|name| crew.end(name))
}

/// Options of the other arm do not go together with this one.
pub(super) fn check(args: &DemoArgs) -> Result<(), Failure> {
    if args.arm_rate.is_some() || !args.arm.arguments().is_empty() {
        let remedy = "leave the --arm-... options out; `foretrace ur-sim --do LINE` lets its controller fail";
        return Err(Failure::usage("the --arm-... options are about the simulated arm", remedy));
    }
    Ok(())
}

/// The settings that go with a series, and commands that are valid for as long as the way to the controller
/// takes.
pub(super) fn fitting(mut source: Source, series: Option<&str>) -> Source {
    if let (Base::Preset(name), Some(series)) = (&mut source.base, series) {
        *name = if series == "e" { "ur5e" } else { "ur5" }.to_owned();
    }
    let key = "loop.valid_periods";
    let given = source.overrides.iter().any(|(known, _)| known == key);
    if given || matches!(source.base, Base::File(_)) { source } else { source.with(key, "12") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_controller_has_the_tool_and_the_payload_of_the_settings() {
        let text = "preset = \"ur5\"\n[robot.ur]\npayload_kg = 0.25\ntcp_m = [0.0, 0.01, 0.2]\n";
        let config = Config::parse(text, "t.toml", ".").unwrap();
        assert_eq!(installation(&config), ["--do", "tcp 0 0.01 0.2 0 0 0", "--do", "payload 0.25"]);
    }

    #[test]
    fn a_series_chooses_the_preset_and_what_was_told_stays() {
        let fitted = fitting(Source::preset("ur5"), Some("e"));
        assert!(matches!(&fitted.base, Base::Preset(name) if name == "ur5e"));
        assert_eq!(fitted.overrides, [("loop.valid_periods".to_owned(), "12".to_owned())]);
        let kept = fitting(Source::preset("ur5").with("loop.valid_periods", "20"), None);
        assert_eq!(kept.overrides, [("loop.valid_periods".to_owned(), "20".to_owned())]);
    }
}
