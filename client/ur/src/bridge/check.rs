//! What has to be right before the bridge moves anything: version, joints, model, tool, dead-man.
//!
//! Contract: pure; each check names what was found, what was expected and what to do.

use std::net::IpAddr;

use foretrace_client::JOINTS;
use foretrace_config::{Config, Settings};

use super::kinematics::{Deviation, DhParameters, fitting_base};

pub use crate::rtde::ControllerVersion as Version;
pub use crate::series::Series;

/// Why the bridge does not begin.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CheckRefusal {
    /// PolyScope X.
    #[error(
        "the controller runs PolyScope X ({0}), which foretrace cannot drive yet; \
         CB3 from 3.9 and e-Series from 5.3 are supported"
    )]
    PolyScopeX(Version),
    /// Registers 24 to 47 and what else is needed are not there.
    #[error("the controller runs {0}, too old; update it to 3.9 or later (CB3), 5.3 or later (e-Series)")]
    TooOld(Version),
    /// A major version that nobody knows.
    #[error(
        "the controller runs {0}, which foretrace does not know; \
         CB3 from 3.9 and e-Series from 5.3 are supported"
    )]
    Unknown(Version),
    /// The settings are for another series.
    #[error(
        "the controller cycles at {found} Hz, the settings say robot.controller_rate_hz = {settings}; \
         use the preset of this arm, or set it to {found}"
    )]
    Rate {
        /// Of the controller \[Hz\].
        found: u32,
        /// Of the settings \[Hz\].
        settings: u32,
    },
    /// The hardware may turn farther than the model.
    #[error(
        "joint {joint} stands at {q:.3} rad, beyond what the settings allow ({low:.3} to {high:.3}); \
         turn it back on the pendant, by whole turns if need be"
    )]
    Joint {
        /// The joint, from 0 at the base.
        joint: usize,
        /// Where it stands \[rad\].
        q: f64,
        /// Lowest legal position \[rad\].
        low: f64,
        /// Highest legal position \[rad\].
        high: f64,
    },
    /// Another mass is configured.
    #[error(
        "the installation says a payload of {found:.2} kg, robot.ur.payload_kg = {settings:.2}; \
         weigh the tool and correct whichever is wrong: a wrong payload lets the arm sag and stop"
    )]
    Payload {
        /// Of the controller \[kg\].
        found: f64,
        /// Of the settings \[kg\].
        settings: f64,
    },
    /// Nothing in the settings says whether the mass is right, and the arm may be a real one.
    #[error(
        "the installation says a payload of {found:.2} kg, and robot.ur.payload_kg is not set: weigh the tool, \
         write its mass there and into the installation; a wrong payload lets the arm sag and stop"
    )]
    PayloadUnsaid {
        /// Of the controller \[kg\].
        found: f64,
    },
    /// Another tool centre point is configured.
    #[error(
        "the installation's tool centre point is at {found:?} m, {key} = {settings:?}, {apart_mm:.1} mm away; \
         correct whichever is wrong: safety limits of the tool's speed are judged there"
    )]
    Tcp {
        /// Which key of the settings says otherwise.
        key: &'static str,
        /// Of the controller \[m\].
        found: [f64; 3],
        /// Of the settings \[m\].
        settings: [f64; 3],
        /// Distance \[mm\].
        apart_mm: f64,
    },
    /// A real arm without a dead-man.
    #[error(
        "{0} is not this machine, so there may be a real arm: set safety.enable_required = true and keep a \
         dead-man at hand, or say --without-dead-man"
    )]
    NoDeadMan(IpAddr),
    /// The model's base frame is that of ROS's descriptions, and the settings do not say so.
    #[error(
        "the base frame of the settings' model, link `{base}`, is turned by 180 degrees about z against the \
         controller's, as ROS's descriptions have it: if [plane] and [clearance] are written in that frame, \
         write `base_turned = true` under [robot.ur]{instead}"
    )]
    BaseTurned {
        /// Base link of the settings' model.
        base: String,
        /// What to write where they are written in the controller's frame, for the message.
        instead: String,
    },
    /// The settings say that the base frame is turned, and it is not.
    #[error(
        "the base frame of the settings' model, link `{base}`, is the controller's own, not turned by 180 \
         degrees about z: write `base_turned = false` under [robot.ur], and [plane] and [clearance] as the \
         pendant shows them"
    )]
    BaseNotTurned {
        /// Base link of the settings' model.
        base: String,
    },
    /// Another link of the model stands where the controller's base frame does.
    #[error(
        "the base frame of the settings' model, link `{base}`, is not the controller's, whose arm is off by \
         {apart_mm:.0} mm at the tool; that of link `{link}` {how}: write `base_link = \"{link}\"` under \
         [robot], `base_turned = {turned}` under [robot.ur], and [plane] and [clearance] in the frame of \
         `{link}`{pendant}"
        , how = if *turned { "is, turned by 180 degrees about z" } else { "is" }
        , pendant = if *turned { "" } else { ", as the pendant shows them" }
    )]
    AnotherBase {
        /// Base link of the settings' model.
        base: String,
        /// The link that fits.
        link: String,
        /// Its frame is turned by 180 degrees about z against the controller's.
        turned: bool,
        /// Distance of the tool between arm and model \[mm\].
        apart_mm: f64,
    },
    /// The model is of another arm.
    #[error(
        "the arm's kinematics differ from the settings' model by {apart_mm:.0} mm at the tool: \
         another model of arm? Name the right one as robot.urdf (the arm is {name})"
    )]
    Model {
        /// Distance of the tool between both \[mm\].
        apart_mm: f64,
        /// What the controller says about itself, or nothing.
        name: String,
    },
}

impl Series {
    /// The series that `version` belongs to.
    ///
    /// # Errors
    ///
    /// PolyScope X, versions too old, and unknown ones.
    pub const fn of(version: Version) -> Result<Self, CheckRefusal> {
        match (version.major, version.minor) {
            (3, 9..) => Ok(Self::Cb3),
            (5, 3..) => Ok(Self::E),
            (0..=3 | 5, _) => Err(CheckRefusal::TooOld(version)),
            (10.., _) => Err(CheckRefusal::PolyScopeX(version)),
            _ => Err(CheckRefusal::Unknown(version)),
        }
    }

    /// Whether the dashboard of this version tells remote from local control (e-Series from 5.6).
    #[must_use]
    pub const fn tells_remote_control(self, version: Version) -> bool {
        matches!(self, Self::E) && version.minor >= 6
    }
}

/// What the arm and its installation say before anything moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Installation {
    /// Joint positions \[rad\].
    pub q: [f64; JOINTS],
    /// Mass of the tool \[kg\]; `None` where the version does not tell (before 3.11 and 5.5.1).
    pub payload_kg: Option<f64>,
    /// Tool centre point, seen from the flange \[m\]; `None` where the version does not tell.
    pub tcp_m: Option<[f64; 3]>,
}

/// Largest difference of payloads \[kg\].
const PAYLOAD_KG: f64 = 0.1;
/// Largest distance of tool centre points \[m\].
const TCP_M: f64 = 1e-3;

/// A model that is off by more than this at the paper counts as not calibrated \[mm\].
pub const CALIBRATED_MM: f64 = 0.5;
/// A model that is off by more than this is one of another arm \[mm\].
pub const ANOTHER_ARM_MM: f64 = 30.0;

/// Everything about `found` that does not fit the settings; `position` are the joints' limits \[rad\]. Behind
/// an address of this machine (`loopback`) stands a simulator, whose payload nobody weighed.
#[must_use]
pub fn installation(
    found: &Installation,
    settings: &Settings,
    position: &[[f64; 2]; JOINTS],
    loopback: bool,
) -> Vec<CheckRefusal> {
    let mut refused = Vec::new();
    for (joint, (q, [low, high])) in found.q.iter().zip(position).enumerate() {
        if !(*q >= *low && *q <= *high) {
            refused.push(CheckRefusal::Joint { joint, q: *q, low: *low, high: *high });
        }
    }
    let ur = &settings.robot.ur;
    match (found.payload_kg, ur.payload_kg) {
        (Some(found), Some(settings)) if !((found - settings).abs() <= PAYLOAD_KG) => {
            refused.push(CheckRefusal::Payload { found, settings });
        }
        (Some(found), None) if !loopback => refused.push(CheckRefusal::PayloadUnsaid { found }),
        _ => {}
    }
    if let Some(found) = found.tcp_m {
        let (key, settings) =
            ur.tcp_m.map_or(("robot.tool_m", settings.robot.tool_m), |tcp_m| ("robot.ur.tcp_m", tcp_m));
        let apart = distance(&found, &settings);
        if !(apart <= TCP_M) {
            refused.push(CheckRefusal::Tcp { key, found, settings, apart_mm: apart * 1e3 });
        }
    }
    refused
}

/// The model of `config` is of this arm with kinematics `dh`, which `deviation` compares; `name` is what its
/// own measures say it is.
///
/// # Errors
///
/// [`CheckRefusal::Model`], [`CheckRefusal::BaseTurned`], [`CheckRefusal::BaseNotTurned`],
/// [`CheckRefusal::AnotherBase`].
pub fn model(
    dh: Option<&DhParameters>,
    deviation: Option<&Deviation>,
    name: Option<&str>,
    config: &Config,
) -> Result<(), CheckRefusal> {
    let Some(off) = deviation.filter(|off| !(off.most_mm <= ANOTHER_ARM_MM)) else { return Ok(()) };
    let fitting = dh.and_then(|dh| fitting_base(dh, config, ANOTHER_ARM_MM));
    let base = config.robot().chain.ends().0.to_owned();
    if !(off.turned_mm <= ANOTHER_ARM_MM) {
        if let Some(fits) = fitting {
            let (link, turned) = (fits.link, fits.turned);
            return Err(CheckRefusal::AnotherBase { base, link, turned, apart_mm: off.most_mm });
        }
        let name = name.unwrap_or("one that foretrace does not know").to_owned();
        return Err(CheckRefusal::Model { apart_mm: off.most_mm, name });
    }
    if config.settings().robot.ur.base_turned {
        return Err(CheckRefusal::BaseNotTurned { base });
    }
    let inside = fitting.filter(|fits| !fits.turned).map(|fits| fits.link);
    let instead = inside.map_or_else(
        || {
            "; no link that is fixed to it stands as the controller's frame, so they cannot be as the pendant \
             shows them"
                .to_owned()
        },
        |link| format!("; if they are as the pendant shows them, write `base_link = \"{link}\"` under [robot]"),
    );
    Err(CheckRefusal::BaseTurned { base, instead })
}

/// The rate of the settings is the controller's.
///
/// # Errors
///
/// [`CheckRefusal::Rate`].
pub const fn rate(series: Series, settings_hz: u32) -> Result<(), CheckRefusal> {
    if series.rate_hz() == settings_hz {
        Ok(())
    } else {
        Err(CheckRefusal::Rate { found: series.rate_hz(), settings: settings_hz })
    }
}

/// Against another machine than this one a dead-man is needed, or an explicit word.
///
/// # Errors
///
/// [`CheckRefusal::NoDeadMan`].
pub const fn dead_man(host: IpAddr, enable_required: bool, without: bool) -> Result<(), CheckRefusal> {
    if host.is_loopback() || enable_required || without { Ok(()) } else { Err(CheckRefusal::NoDeadMan(host)) }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_config::Config;

    const fn version(major: u32, minor: u32) -> Version {
        Version { major, minor, bugfix: 1, build: 7 }
    }

    #[test]
    fn supported_versions_are_reported_from_the_others() {
        assert_eq!(Series::of(version(3, 15)), Ok(Series::Cb3));
        assert_eq!(Series::of(version(3, 9)), Ok(Series::Cb3));
        assert_eq!(Series::of(version(5, 3)), Ok(Series::E));
        for old in [version(3, 8), version(5, 2), version(1, 8)] {
            assert_eq!(Series::of(old), Err(CheckRefusal::TooOld(old)));
        }
        let text = Series::of(version(10, 10)).unwrap_err().to_string();
        assert!(text.contains("PolyScope X (10.10.1.7)") && text.contains("CB3 from 3.9"), "{text}");
        assert!(matches!(Series::of(version(4, 0)), Err(CheckRefusal::Unknown(_))));
        assert_eq!(rate(Series::E, 125), Err(CheckRefusal::Rate { found: 500, settings: 125 }));
    }

    #[test]
    fn only_newer_e_series_tell_remote_control() {
        assert!(Series::E.tells_remote_control(version(5, 6)));
        assert!(!Series::E.tells_remote_control(version(5, 5)));
        assert!(!Series::Cb3.tells_remote_control(version(3, 15)));
    }

    fn judged(text: &str, change: impl FnOnce(&mut Installation)) -> Vec<CheckRefusal> {
        judged_at(text, true, change)
    }

    fn judged_at(text: &str, loopback: bool, change: impl FnOnce(&mut Installation)) -> Vec<CheckRefusal> {
        let config = Config::parse(&format!("preset = \"ur5\"\n{text}"), "t.toml", ".").unwrap();
        let mut found =
            Installation { q: config.robot().home, payload_kg: Some(0.5), tcp_m: Some([0.0, 0.0, 0.15]) };
        change(&mut found);
        installation(&found, config.settings(), config.robot().limits.position(), loopback)
    }

    #[test]
    fn an_installation_is_judged_by_the_tool_where_the_settings_say_no_more() {
        // The preset's pen is 150 mm long.
        assert_eq!(judged("", |_| {}), []);
        let text = judged("", |found| found.tcp_m = Some([0.0; 3]))[0].to_string();
        assert!(text.contains("robot.tool_m = [0.0, 0.0, 0.15]") && text.contains("150.0 mm"), "{text}");
        // A payload that nobody wrote down is one that nobody compared.
        let real = judged_at("", false, |_| {});
        assert_eq!(real, [CheckRefusal::PayloadUnsaid { found: 0.5 }]);
        assert!(real[0].to_string().contains("robot.ur.payload_kg is not set"));
        assert_eq!(judged_at("[robot.ur]\npayload_kg = 0.5\n", false, |_| {}), []);
    }

    #[test]
    fn a_model_of_another_arm_is_refused() {
        let off = |most_mm| Deviation { most_mm, uneven_mm: 0.0, height_mm: 0.0, turned_mm: 900.0 };
        let config = Config::preset("ur5").unwrap();
        let judged = |off: Option<&Deviation>, name| model(None, off, name, &config);
        assert_eq!(judged(Some(&off(29.0)), Some("a UR5")), Ok(()));
        assert_eq!(judged(None, None), Ok(()));
        for most_mm in [31.0, f64::NAN] {
            assert!(judged(Some(&off(most_mm)), Some("a UR10")).unwrap_err().to_string().contains("a UR10"));
        }
    }

    #[test]
    fn what_is_near_enough_or_not_told_is_not_refused() {
        let reported = "[robot.ur]\npayload_kg = 0.55\ntcp_m = [0.0, 0.0005, 0.15]\n";
        assert_eq!(judged(reported, |_| {}), []);
        // A version that does not tell cannot be wrong.
        assert_eq!(judged(reported, |found| (found.payload_kg, found.tcp_m) = (None, None)), []);
    }

    #[test]
    fn each_difference_is_reported_with_both_values() {
        let reported = "[robot.ur]\npayload_kg = 1.5\ntcp_m = [0.0, 0.0, 0.1]\n";
        let refused = judged(reported, |found| found.q[5] = 7.0);
        let text = refused.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        assert_eq!(refused.len(), 3, "{text}");
        assert!(text.contains("joint 5 stands at 7.000 rad") && text.contains("0.50 kg"), "{text}");
        assert!(text.contains("50.0 mm"), "{text}");
        assert_eq!(judged(reported, |found| found.payload_kg = Some(f64::NAN)).len(), 2);
    }

    #[test]
    fn another_machine_needs_a_dead_man_or_a_word() {
        let (here, there) = ("127.0.0.7".parse().unwrap(), "192.168.0.9".parse().unwrap());
        assert_eq!(dead_man(here, false, false), Ok(()));
        assert_eq!(dead_man(there, true, false), Ok(()));
        assert_eq!(dead_man(there, false, true), Ok(()));
        let text = dead_man(there, false, false).unwrap_err().to_string();
        assert!(text.contains("--without-dead-man") && text.contains("safety.enable_required"), "{text}");
    }
}
