//! Finds out what there is to find out about a controller, port by port.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use foretrace_client::monotonic_now_ns;
use foretrace_config::Config;

use super::super::address::Addresses;
use super::super::check::Series;
use super::super::clock::{ClockMap, Mapped};
use super::super::kinematics::deviation;
use super::super::measures;
use super::super::probe::installation;
use super::super::registers::{Numbers, ProgramAnswer, RegisterMap};
use super::super::trip::Trips;
use super::{Facts, Modes, Port, RegisterFact, Timing};
use crate::dashboard::{Dashboard, DashboardError};
use crate::primary::PrimaryError;
use crate::rtde::{ProtocolVersion, RtdeClient, RtdeError, RtdeValue};

/// Longest wait for a step.
const PATIENCE: Duration = Duration::from_secs(3);
/// Longest wait for a state.
const WAIT: Duration = Duration::from_millis(100);
/// Most arrivals that are remembered, ten minutes at 500 Hz.
const MOST: usize = 300_000;

/// Looks at everything; listens for `lasting`, or until `interrupted` says so.
#[must_use]
pub fn gather(
    addresses: &Addresses,
    config: &Config,
    lasting: Duration,
    interrupted: &dyn Fn() -> bool,
) -> Facts {
    let mut facts = Facts { loopback: addresses.ip().is_loopback(), ..Facts::default() };
    let (port, arm, remote) = dashboard(addresses.dashboard);
    (facts.dashboard, facts.arm, facts.remote) = (port, arm, remote);
    let mut tcp_m = None;
    match measures::listen(addresses.primary, PATIENCE) {
        Ok(measures) => {
            tcp_m = measures.tcp_m;
            facts.primary = if measures.states {
                Port::Open("robot states come".to_owned())
            } else {
                Port::Strange("no robot state came".to_owned())
            };
            facts.dh = measures.dh;
            facts.deviation = measures.dh.and_then(|dh| deviation(&dh, config));
            // The dashboard calls a UR5e a UR5; its measures do not.
            let measured = measures.dh.and_then(|dh| dh.name()).map(str::to_owned);
            facts.arm = measured.or_else(|| facts.arm.take());
        }
        Err(PrimaryError::Connect(error)) => facts.primary = closed(&error),
        Err(error) => facts.primary = Port::Strange(error.to_string()),
    }
    if interrupted() {
        return facts;
    }
    facts.rtde = match rtde(addresses, config, lasting, interrupted, &mut facts) {
        Ok(protocol) => Port::Open(format!("protocol {}", protocol.number())),
        Err(RtdeError::Connect(error)) => closed(&error),
        Err(error @ RtdeError::Silent(_)) => Port::Silent(error.to_string()),
        Err(error) => Port::Strange(error.to_string()),
    };
    if let Some(installation) = &mut facts.installation {
        installation.tcp_m = installation.tcp_m.or(tcp_m);
    }
    facts
}

fn closed(error: &std::io::Error) -> Port {
    match error.kind() {
        std::io::ErrorKind::ConnectionRefused => Port::Refused,
        _ => Port::Silent(error.to_string()),
    }
}

fn dashboard(address: SocketAddr) -> (Port, Option<String>, Option<bool>) {
    let mut dashboard = match Dashboard::connect(address, PATIENCE) {
        Ok(dashboard) => dashboard,
        Err(DashboardError::Connect(error)) => return (closed(&error), None, None),
        Err(error @ DashboardError::Silent(_)) => return (Port::Silent(error.to_string()), None, None),
        Err(error) => return (Port::Strange(error.to_string()), None, None),
    };
    let greeting: String = dashboard.greeting().chars().take(60).collect();
    // Old versions answer with a complaint, which is longer than any model's name.
    let named = |model: &String| model.len() < 20 && model.starts_with("UR");
    let arm = dashboard.ask("get robot model").ok().filter(named);
    let remote = dashboard.remote_control().ok().flatten();
    (Port::Open(greeting), arm, remote)
}

fn rtde(
    addresses: &Addresses,
    config: &Config,
    lasting: Duration,
    interrupted: &dyn Fn() -> bool,
    facts: &mut Facts,
) -> Result<ProtocolVersion, RtdeError> {
    let mut first = RtdeClient::connect(addresses.rtde, PATIENCE)?;
    let protocol = first.protocol();
    facts.version = Some(first.controller_version()?);
    facts.installation = installation(&mut first, PATIENCE).ok();
    drop(first);
    let Some(series) = facts.version.and_then(|version| Series::of(version).ok()) else {
        return Ok(protocol);
    };
    let Some(registers) = RegisterMap::at(config.settings().robot.ur.register_base) else {
        return Ok(protocol);
    };
    let mut second = RtdeClient::connect(addresses.rtde, PATIENCE)?;
    let claimed = claim(&mut second, &registers)?;
    let free = claimed == RegisterFact::Free;
    facts.registers = Some(claimed);
    listen(&mut second, &registers, free, f64::from(series.rate_hz()), lasting, interrupted, facts)?;
    Ok(protocol)
}

/// One by one, so that each that is not to be had is named.
fn claim(client: &mut RtdeClient, registers: &RegisterMap) -> Result<RegisterFact, RtdeError> {
    let (mut in_use, mut unknown) = (Vec::new(), Vec::new());
    for name in registers.input_names() {
        match client.set_up_inputs(&[name.as_str()]) {
            Ok(_) => {}
            Err(RtdeError::InUse(_)) => in_use.push(name),
            Err(RtdeError::NotFound(_)) => unknown.push(name),
            Err(error) => return Err(error),
        }
    }
    Ok(match (in_use.is_empty(), unknown.is_empty()) {
        (false, _) => RegisterFact::InUse(in_use),
        (true, false) => RegisterFact::Unknown(unknown),
        (true, true) => RegisterFact::Free,
    })
}

/// Listens at the controller's own rate. Where the counter's register is ours it is written and read back,
/// which no program is needed for: inputs are outputs as well.
fn listen(
    client: &mut RtdeClient,
    registers: &RegisterMap,
    free: bool,
    rate_hz: f64,
    lasting: Duration,
    interrupted: &dyn Fn() -> bool,
    facts: &mut Facts,
) -> Result<(), RtdeError> {
    let counter = format!("input_int_register_{}", registers.counter());
    let names = [
        "timestamp",
        "robot_mode",
        "safety_mode",
        "runtime_state",
        "speed_scaling",
        "target_speed_fraction",
        &counter,
    ];
    client.set_up_outputs(&names, rate_hz)?;
    let recipe = if free { Some(client.set_up_inputs(&[counter.as_str()])?) } else { None };
    client.start()?;
    let cycle_s = 1.0 / rate_hz;
    let (mut clock, mut trips) = (ClockMap::default(), Trips::new(cycle_s, 1));
    let mut counters = Numbers::from_seed(monotonic_now_ns());
    let (begin, mut late_ms, mut states, mut skipped) = (Instant::now(), Vec::new(), 0, 0);
    let mut last: Option<f64> = None;
    while begin.elapsed() < lasting && !interrupted() {
        let Some(package) = client.receive(WAIT)? else { continue };
        let arrival_ns = monotonic_now_ns();
        let mut values = package.values.into_iter();
        let mut next = || values.next();
        let timestamp = next().and_then(RtdeValue::double).unwrap_or(f64::NAN);
        facts.modes = Some(Modes {
            robot: next().and_then(RtdeValue::int32).unwrap_or(i32::MIN),
            safety: next().and_then(RtdeValue::int32).unwrap_or(i32::MIN),
            runtime: next().and_then(RtdeValue::uint32).unwrap_or(u32::MAX),
            speed_scaling: next().and_then(RtdeValue::double).unwrap_or(f64::NAN),
            slider: next().and_then(RtdeValue::double).unwrap_or(f64::NAN),
        });
        let echo = next().and_then(RtdeValue::int32).unwrap_or(0);
        states += 1;
        if let Some(last) = last.replace(timestamp) {
            skipped += (((timestamp - last) / cycle_s).round() as u64).saturating_sub(1);
        }
        if let Mapped::At(stamp_ns) = clock.observe(timestamp, arrival_ns)
            && late_ms.len() < MOST
        {
            late_ms.push(arrival_ns.saturating_sub(stamp_ns) as f64 * 1e-6);
        }
        trips.answered(&ProgramAnswer { echo, ..ProgramAnswer::default() }, timestamp);
        if let Some(recipe) = &recipe {
            let counter = counters.next_number();
            trips.sent(counter, timestamp);
            client.send(recipe, &[RtdeValue::Int32(counter)])?;
        }
    }
    facts.timing = Some(Timing {
        seconds: begin.elapsed().as_secs_f64(),
        rate_hz,
        states,
        skipped,
        late_ms: quantiles(&mut late_ms),
        round_trips: trips.counts().to_vec(),
    });
    Ok(())
}

/// Median, 99 of 100, and the largest.
fn quantiles(values: &mut [f64]) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * values.len().saturating_sub(1) as f64).round() as usize;
        values.get(index).copied().unwrap_or(f64::NAN)
    };
    [at(0.5), at(0.99), at(1.0)]
}
