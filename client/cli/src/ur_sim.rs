//! `foretrace ur-sim`: a simulated controller of Universal Robots behind the ports of a real one.
//!
//! Contract: nothing but the address of `--bind` can reach it, loopback unless said otherwise. It runs until
//! Ctrl-C or for `--seconds`.

use std::f64::consts::TAU;
use std::net::{IpAddr, Ipv4Addr};
use std::time::{Duration, Instant};

use foretrace_arm::priority;
use foretrace_ur::rtde::ControllerVersion;
use foretrace_ur_sim::options::{MODEL, usual_version};
use foretrace_ur_sim::{Controller, ControllerOptions, Series, Service};
use serde::Serialize;

use crate::arm::options::JointArgs;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, tell};
use crate::values;

/// The tool of its installation at first: the pen of the presets.
const PEN: &str = "tcp 0 0 0.15 0 0 0";
/// SCHED_FIFO priority of its threads, below a bridge's with the preset's settings.
pub(crate) const PRIORITY: u32 = 60;
/// Between two looks at whether the user wants to end.
const LOOK: Duration = Duration::from_millis(100);

/// Simulate a controller of Universal Robots: dashboard, primary, secondary, real-time and RTDE interface,
/// URScript
///
/// Every client of such a robot can connect as to a real one: RTDE at 125 Hz (CB3) or 500 Hz (e-Series),
/// scripts to ports 30001 to 30003, dashboard at 29999. Its tool centre point is the presets' pen. Port 30090
/// takes faults, one line each ("help" lists them): printf 'slider 0.5\n' | nc 127.0.0.1 30090.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  foretrace ur-sim --series e\n  \
                  foretrace ur-sim --bind 127.0.0.2 --calibration-error-mm 4\n  \
                  foretrace ur-sim --do 'slider 0.3' --do 'remote off'"
)]
pub(crate) struct UrSimArgs {
    /// CB3 (UR5, software 3.15, 125 Hz) or e-Series (UR5e, software 5.11, 500 Hz)
    #[arg(long, value_enum, default_value_t = SeriesArg::Cb3)]
    series: SeriesArg,

    /// Software that it says it has, to see what a client makes of older or newer ones [default: that of the
    /// series]
    #[arg(long, value_name = "MAJOR.MINOR.BUGFIX.BUILD", value_parser = software)]
    software: Option<ControllerVersion>,

    /// Address to listen at; one that is no loopback address lets everybody in the network move the simulated
    /// arm
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    bind: IpAddr,

    /// End after this many seconds; otherwise on Ctrl-C
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    /// Stand at these joints in the beginning, base first [rad] [default: home of the presets]
    #[arg(long, value_name = "Q1,...,Q6", value_delimiter = ',')]
    from: Option<Vec<f64>>,

    /// Give the arm a calibration of its own: the flange is off the nominal one by this much [mm]
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = values::number(0.0..=50.0, "from 0 to 50 mm"))]
    calibration_error_mm: f64,

    /// Seed of the calibration
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    #[command(flatten)]
    joints: JointArgs,

    /// Hosts that programs may open sockets to; "any" lets whoever can send a program reach what this machine
    /// can
    #[arg(long, value_enum, default_value_t = SocketHostsArg::Loopback)]
    program_sockets: SocketHostsArg,

    /// Begin with the power off
    #[arg(long)]
    power_off: bool,

    /// Ask for no real-time priority
    #[arg(long)]
    no_rights: bool,

    /// Let the system choose the ports; they are told on stdout
    #[arg(long)]
    ephemeral_ports: bool,

    /// Do this in the beginning, as a line to port 30090 would; may be given several times
    #[arg(long = "do", value_name = "LINE")]
    orders: Vec<String>,

    #[command(flatten)]
    json: JsonArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum SeriesArg {
    Cb3,
    E,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum SocketHostsArg {
    Loopback,
    Any,
}

/// A run in figures; keys are stable.
#[derive(Debug, Serialize)]
struct UrSimReport {
    seconds: f64,
    connections: usize,
    /// Why it had no real-time priority; none where it had.
    not_real_time: Option<String>,
    state: serde_json::Value,
}

fn software(text: &str) -> Result<ControllerVersion, String> {
    let numbers: Option<Vec<u32>> = text.split('.').map(|number| number.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[major, minor, bugfix, build]) => Ok(ControllerVersion { major, minor, bugfix, build }),
        _ => Err("four numbers with dots between, as 5.11.1.108318".to_owned()),
    }
}

pub(crate) fn run(args: &UrSimArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let series = match args.series {
        SeriesArg::Cb3 => Series::Cb3,
        SeriesArg::E => Series::E,
    };
    let mut options = ControllerOptions {
        version: args.software.unwrap_or(usual_version(series)),
        bind: args.bind,
        ephemeral_ports: args.ephemeral_ports,
        calibration_error_m: args.calibration_error_mm * 1e-3,
        seed: args.seed,
        running: !args.power_off,
        damping: args.joints.damping(),
        mechanics: args.joints.mechanics(),
        any_host: args.program_sockets == SocketHostsArg::Any,
        ..ControllerOptions::new(series)
    };
    if let Some(from) = &args.from {
        options.q = standing(from)?;
    }
    // Before its threads are made: those that take what clients send keep the cycle as the control loop does.
    let missing = priority::ask("ur-sim", PRIORITY, args.no_rights, &tell);
    let controller = Controller::start(options).map_err(|error| Failure::failed(error, ""))?;
    for order in std::iter::once(PEN).chain(args.orders.iter().map(String::as_str)) {
        let answer = controller.obey(order);
        if let Some(why) = answer.strip_prefix("error: ") {
            return Err(Failure::usage(format_args!("--do {order:?}: {why}"), ""));
        }
    }
    let version = options.version;
    note!("ur-sim: {} {version}, {} Hz, at {}", MODEL, series.rate_hz(), args.bind);
    if args.ephemeral_ports {
        for service in Service::ALL {
            if let Some(address) = controller.address(service) {
                note!("ur-sim: {} {address}", service.name());
            }
        }
    }
    if !args.bind.is_loopback() {
        note!("ur-sim: everybody who reaches {} can move this arm", args.bind);
    }
    let began = Instant::now();
    let end = args.seconds.map(Duration::from_secs_f64);
    while !interrupt.is_set() && end.is_none_or(|end| began.elapsed() < end) {
        interrupt.wait(end.map_or(LOOK, |end| LOOK.min(end.saturating_sub(began.elapsed()))));
    }
    let state = serde_json::from_str(&controller.status()).unwrap_or_default();
    let report = UrSimReport {
        seconds: began.elapsed().as_secs_f64(),
        connections: controller.connections(),
        not_real_time: missing,
        state,
    };
    args.json.write(&report)
}

/// Where the arm stands at first [rad].
fn standing(from: &[f64]) -> Result<[f64; 6], Failure> {
    let q: Option<[f64; 6]> = from.try_into().ok();
    q.filter(|q| q.iter().all(|q| q.abs() <= TAU)).ok_or_else(|| {
        Failure::usage(
            "--from wants six joints within a turn of 0",
            "give --from=Q1,...,Q6, base first, in radians",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_config::Config;

    #[test]
    fn its_tool_is_the_pen_of_the_presets() {
        for preset in ["ur5", "ur5e", "ur5-first-run"] {
            let [x, y, z] = Config::preset(preset).unwrap().settings().robot.tool_m;
            assert_eq!(PEN, format!("tcp {x} {y} {z} 0 0 0"), "{preset}");
        }
    }
}
