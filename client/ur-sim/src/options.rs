//! What a simulated controller is: series, address, ports, calibration.

use std::f64::consts::{FRAC_PI_2, PI};
use std::net::{IpAddr, Ipv4Addr};

use foretrace_sim::arm::Mechanics;

use foretrace_ur::rtde::ControllerVersion;

pub use foretrace_ur::series::Series;

/// The usual software of a series.
#[must_use]
pub const fn usual_version(series: Series) -> ControllerVersion {
    match series {
        Series::Cb3 => ControllerVersion { major: 3, minor: 15, bugfix: 8, build: 106_339 },
        Series::E => ControllerVersion { major: 5, minor: 11, bugfix: 1, build: 108_318 },
    }
}

/// The arm's name on the dashboard, of either series.
pub const MODEL: &str = "UR5";

/// A service behind a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Service {
    /// 29999
    Dashboard,
    /// 30001
    Primary,
    /// 30002
    Secondary,
    /// 30003
    RealTime,
    /// 30004
    Rtde,
    /// 30011: primary without scripts.
    PrimaryReadOnly,
    /// 30012: secondary without scripts.
    SecondaryReadOnly,
    /// 30013: real-time without scripts.
    RealTimeReadOnly,
    /// 30020: statements for a program in interpreter mode, e-Series only.
    Interpreter,
    /// 30090: faults on request, which no real controller has.
    Faults,
}

impl Service {
    pub const ALL: [Self; 10] = [
        Self::Dashboard,
        Self::Primary,
        Self::Secondary,
        Self::RealTime,
        Self::Rtde,
        Self::PrimaryReadOnly,
        Self::SecondaryReadOnly,
        Self::RealTimeReadOnly,
        Self::Interpreter,
        Self::Faults,
    ];

    /// Port on a real controller, and name in the fault protocol.
    const fn known_as(self) -> (u16, &'static str) {
        match self {
            Self::Dashboard => (29999, "dashboard"),
            Self::Primary => (30001, "primary"),
            Self::Secondary => (30002, "secondary"),
            Self::RealTime => (30003, "real-time"),
            Self::Rtde => (30004, "rtde"),
            Self::PrimaryReadOnly => (30011, "primary-read-only"),
            Self::SecondaryReadOnly => (30012, "secondary-read-only"),
            Self::RealTimeReadOnly => (30013, "real-time-read-only"),
            Self::Interpreter => (30020, "interpreter"),
            Self::Faults => (30090, "faults"),
        }
    }

    /// Its port on a real controller.
    #[must_use]
    pub const fn port(self) -> u16 {
        self.known_as().0
    }

    /// Whether controllers of this series have it.
    #[must_use]
    pub const fn is_of(self, series: Series) -> bool {
        !matches!((self, series), (Self::Interpreter, Series::Cb3))
    }

    /// Its name in the fault protocol.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.known_as().1
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerOptions {
    pub series: Series,
    /// Its software: what RTDE, dashboard and port 30001 say, and which fields there are.
    pub version: ControllerVersion,
    pub bind: IpAddr,
    /// Ports that the system gives instead of those of a real controller.
    pub ephemeral_ports: bool,
    /// Where the joints are at first \[rad\].
    pub q: [f64; 6],
    /// By how much the flange is off the nominal kinematics at `q` \[m\]; 0 for a nominal arm.
    pub calibration_error_m: f64,
    pub seed: u64,
    /// Power on, brakes released; else power off.
    pub running: bool,
    /// Damping ratio of `servoj`, 1: critical; what its gain makes of it on a real arm is not modelled.
    pub damping: f64,
    /// Friction, gain, backlash, sag and encoder steps of the arm.
    pub mechanics: Mechanics,
    /// Programs may connect to other hosts than this one.
    pub any_host: bool,
}

impl ControllerOptions {
    /// A running, nominal arm at the presets' home, on 127.0.0.1 and the real ports.
    #[must_use]
    pub const fn new(series: Series) -> Self {
        Self {
            series,
            version: usual_version(series),
            bind: IpAddr::V4(Ipv4Addr::LOCALHOST),
            ephemeral_ports: false,
            q: [PI, -1.3, 1.8, -2.0708, -FRAC_PI_2, 0.0],
            calibration_error_m: 0.0,
            seed: 1,
            running: true,
            damping: 1.0,
            mechanics: Mechanics::IDEAL,
            any_host: false,
        }
    }
}
