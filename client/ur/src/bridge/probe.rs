//! What a controller says about itself before the bridge begins: version, installation, kinematics.
//!
//! Contract: reads only; a few seconds at most.

use std::time::{Duration, Instant};

use foretrace_config::Config;

use super::address::Addresses;
use super::check::{self, CheckRefusal, Installation, Series, Version};
use super::kinematics::{Deviation, DhParameters, deviation};
use super::line;
use super::measures;
use super::pilot::Floor;
use super::reason::HaltReason;
use crate::dashboard::{Dashboard, SIMULATED};
use crate::rtde::{RtdeClient, RtdeError, RtdeValue};

/// Longest wait for a step.
const PATIENCE: Duration = Duration::from_secs(3);

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Software of the controller.
    pub version: Version,
    /// What kind it is.
    pub series: Series,
    /// Joints, payload and tool.
    pub installation: Installation,
    /// The arm's own kinematics; `None` where the primary interface does not tell.
    pub dh: Option<DhParameters>,
}

/// Why nothing was found.
#[derive(Debug, thiserror::Error)]
pub enum ProbeError {
    /// RTDE does not answer.
    #[error("{reason}: {0}", reason = line::reason(.0).text())]
    Rtde(#[from] RtdeError),
    /// The bridge cannot drive this controller.
    #[error("{0}")]
    Refused(#[from] CheckRefusal),
    /// No state came.
    #[error("the controller sends no states over RTDE")]
    NoState,
}

impl ProbeError {
    /// What it means for the bridge.
    #[must_use]
    pub fn reason(&self) -> HaltReason {
        match self {
            Self::Rtde(error) => line::reason(error),
            Self::Refused(_) => HaltReason::DoesNotFit,
            Self::NoState => HaltReason::ConnectionLost,
        }
    }
}

/// Asks the controller at `addresses`.
///
/// # Errors
///
/// See [`ProbeError`].
pub fn probe(addresses: &Addresses) -> Result<Found, ProbeError> {
    let mut client = RtdeClient::connect(addresses.rtde, PATIENCE)?;
    let version = client.controller_version()?;
    let series = Series::of(version)?;
    let mut installation = installation(&mut client, PATIENCE)?;
    let measures = measures::listen(addresses.primary, PATIENCE).ok();
    let dh = measures.and_then(|measures| measures.dh);
    // Older versions tell the tool only there.
    installation.tcp_m = installation.tcp_m.or_else(|| measures?.tcp_m);
    Ok(Found { version, series, installation, dh })
}

/// Joints, payload and tool over a connection that has not started yet.
///
/// # Errors
///
/// See [`ProbeError`].
pub fn installation(client: &mut RtdeClient, patience: Duration) -> Result<Installation, ProbeError> {
    // What the version does not know is asked for no more: the last of these is known to all.
    let asked: [&[&str]; 4] = [
        &["actual_q", "payload", "tcp_offset"],
        &["actual_q", "payload"],
        &["actual_q", "tcp_offset"],
        &["actual_q"],
    ];
    let mut refused = None;
    for names in asked {
        match client.set_up_outputs(names, 10.0) {
            Ok(()) => return read(client, names, patience),
            Err(error @ RtdeError::NotFound(_)) => refused = Some(error),
            Err(error) => return Err(error.into()),
        }
    }
    Err(refused.map_or(ProbeError::NoState, ProbeError::Rtde))
}

fn read(client: &mut RtdeClient, names: &[&str], patience: Duration) -> Result<Installation, ProbeError> {
    client.start()?;
    let end = Instant::now() + patience;
    while Instant::now() < end {
        let Some(package) = client.receive(Duration::from_millis(500))? else { continue };
        let of = |wanted: &str| {
            let pairs = names.iter().zip(&package.values);
            pairs.into_iter().find(|(name, _)| **name == wanted).map(|(_, value)| *value)
        };
        let Some(q) = of("actual_q").and_then(RtdeValue::vector6d) else { continue };
        let tcp = of("tcp_offset").and_then(RtdeValue::vector6d);
        return Ok(Installation {
            q,
            payload_kg: of("payload").and_then(RtdeValue::double),
            tcp_m: tcp.map(|[x, y, z, ..]| [x, y, z]),
        });
    }
    Err(ProbeError::NoState)
}

impl Found {
    /// The arm by its measures.
    #[must_use]
    pub fn arm(&self) -> Option<&'static str> {
        self.dh.and_then(|dh| dh.name())
    }

    /// Name of the embedded description of this arm.
    #[must_use]
    pub fn embedded(&self) -> Option<&'static str> {
        match self.arm()? {
            "a UR5" => Some("ur5"),
            "a UR5e or UR7e" => Some("ur5e"),
            _ => None,
        }
    }

    /// Judges all of it: how far the tip is from where the model of `config` believes it, `None` where nobody
    /// can say. `loopback`: the host is this machine.
    ///
    /// # Errors
    ///
    /// Everything that does not fit.
    pub fn judged(&self, config: &Config, loopback: bool) -> Result<Option<Deviation>, Vec<CheckRefusal>> {
        let (settings, position) = (config.settings(), config.robot().limits.position());
        let mut wrong = check::installation(&self.installation, settings, position, loopback);
        wrong.extend(check::rate(self.series, settings.robot.controller_rate_hz).err());
        let deviation = self.deviation(config);
        wrong.extend(check::model(self.dh.as_ref(), deviation.as_ref(), self.arm(), config).err());
        if wrong.is_empty() { Ok(deviation) } else { Err(wrong) }
    }

    /// How far the tip is from where the model of `config` believes it, over the paper.
    #[must_use]
    pub fn deviation(&self, config: &Config) -> Option<Deviation> {
        self.dh.and_then(|dh| deviation(&dh, config))
    }
}

/// Asks and judges the controller at `addresses` before anything may move: where the pen has to stay above,
/// or `None` for an arm that is calibrated.
///
/// # Errors
///
/// Why it may not, and in which words.
pub fn inspect(addresses: &Addresses, config: &Config) -> Result<Option<Floor>, (HaltReason, String)> {
    let found = probe(addresses).map_err(|error| (error.reason(), error.to_string()))?;
    match found.judged(config, addresses.ip().is_loopback()) {
        Ok(deviation) => Ok(Floor::of(config, deviation)),
        Err(wrong) => {
            let words: Vec<String> = wrong.iter().map(ToString::to_string).collect();
            Err((HaltReason::DoesNotFit, words.join("; ")))
        }
    }
}

/// Whether the controller at `addresses` is a simulator on this machine that says so (`foretrace ur-sim`): no
/// version of a real one, or of the manufacturer's own simulator, ends in these words.
#[must_use]
pub fn is_simulated(addresses: &Addresses) -> bool {
    let version = || Dashboard::connect(addresses.dashboard, PATIENCE)?.ask("PolyscopeVersion");
    addresses.ip().is_loopback() && version().is_ok_and(|version| version.ends_with(SIMULATED))
}
