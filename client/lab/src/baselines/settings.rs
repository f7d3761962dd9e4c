//! The baselines, their parameters and settings.

use std::fmt;
use std::str::FromStr;

use super::tuned::{self, TUNED_HEIGHT_M};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BaselineKind {
    /// 1€ filter, then `servoj` as most teleoperation scripts call it: look-ahead 0.1 s, gain 300.
    ServojGello,
    /// 1€ filter, then `servoj` as the ROS driver calls it: look-ahead 0.03 s, gain 2000.
    ServojRos,
    /// Constant-acceleration target, followed by a jerk-limited online trajectory generator.
    Otg,
    /// Constant-acceleration Kalman filter as in browsers, its prediction sent to the arm.
    Kalman,
}

impl BaselineKind {
    pub const ALL: [Self; 4] = [Self::ServojGello, Self::ServojRos, Self::Otg, Self::Kalman];

    /// Name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ServojGello => "servoj-gello",
            Self::ServojRos => "servoj-ros",
            Self::Otg => "otg",
            Self::Kalman => "kalman",
        }
    }

    /// This baseline smooths in the arm's own servo: on an arm without one it needs a
    /// [`SoftServo`](super::SoftServo).
    #[must_use]
    pub fn smooths_in_the_servo(self) -> bool {
        matches!(self, Self::ServojGello | Self::ServojRos)
    }
}

impl fmt::Display for BaselineKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for BaselineKind {
    type Err = BaselineError;

    fn from_str(text: &str) -> Result<Self, BaselineError> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == text)
            .ok_or_else(|| BaselineError::NoSuchWay { name: text.to_owned() })
    }
}

/// Limits of a baseline's tool motion, per axis of the plane; infinite: no limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// \[m/s\]
    pub velocity_mps: f64,
    /// \[m/s²\]
    pub acceleration_mps2: f64,
    /// \[m/s³\]
    pub jerk_mps3: f64,
}

impl Limits {
    pub const OFF: Self =
        Self { velocity_mps: f64::INFINITY, acceleration_mps2: f64::INFINITY, jerk_mps3: f64::INFINITY };
}

/// servoj's two knobs. Universal Robots allow 0.03 to 0.2 s and 100 to 2000, and default to 0.1 s and 300.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoKnobs {
    /// `lookahead_time` \[s\].
    pub look_ahead_s: f64,
    /// `gain`. What it does inside the controller is unpublished; no arm of the lab models it.
    pub gain: f64,
}

/// When the 1€ filter takes a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feed {
    /// With every pen sample, as in the paper; between samples its value stands still.
    Samples,
    /// Once per control period with the newest sample.
    Periods,
}

/// The 1€ filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneEuroKnobs {
    /// Cut-off at rest \[Hz\].
    pub min_cutoff_hz: f64,
    /// Growth of the cut-off with speed \[Hz per m/s\].
    pub beta_hz_per_mps: f64,
    /// Cut-off of the speed estimate \[Hz\].
    pub speed_cutoff_hz: f64,
}

/// The trajectory generator and the target estimate in front of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OtgKnobs {
    /// Pen samples of this last time make the estimate \[s\].
    pub window_s: f64,
    /// Factor on the estimated acceleration, 0 (constant velocity) to 1.
    pub acceleration_share: f64,
    /// The target state's acceleration is handed to the generator; else 0 is.
    pub target_acceleration: bool,
    /// The target is where the pen will be when the tool can be there, not where it is now.
    pub intercept: bool,
    /// Longest extrapolation without the way to the target \[s\].
    pub horizon_max_s: f64,
    /// The generator's own limits, its knob between smoothness and lag; the smaller of these and the arm's
    /// count. With the arm's limits off, 10 m/s, 3000 m/s² and 1e7 m/s³ stand for none.
    pub limits: Limits,
}

/// Start of the Kalman prediction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The newest sample, as in Chromium.
    Measured,
    Filtered,
}

/// What may smooth a prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PostFilter {
    /// The 1€ filter, which Chromium offers.
    OneEuro(OneEuroKnobs),
    /// servoj in software with this look-ahead \[s\], for which the prediction can reach further by
    /// `lead_extra_s`.
    Servo(f64),
}

/// The Kalman filter and the rules around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KalmanKnobs {
    /// Standard deviation of a pen sample \[m\]. Only the ratio to `process_mps2` matters.
    pub measurement_m: f64,
    /// Standard deviation of the change of acceleration per sample \[m/s²\]. Chromium: 1e5 s⁻² times
    /// `measurement_m`.
    pub process_mps2: f64,
    /// Where the prediction starts from.
    pub origin: Origin,
    /// Longest prediction \[s\]. Chromium: 0.025.
    pub horizon_max_s: f64,
    /// Additional prediction \[s\], to compensate for a post-filter's lag. Chromium: 0.
    pub lead_extra_s: f64,
    /// Factor on ½at². Chromium: 1.
    pub acceleration_share: f64,
    /// Acceleration only counts where the path turned by more than 15° in the last 40 ms (Chromium's ink
    /// trail).
    pub turn_rule: bool,
    /// No prediction where it would turn back (Chromium's ink trail).
    pub reversal_rule: bool,
    /// What smooths the prediction, once per period.
    pub post_filter: Option<PostFilter>,
}

impl KalmanKnobs {
    /// As Chromium draws delegated ink trails (`components/viz`, `ui/base/prediction`), in metres.
    pub const CHROMIUM: Self = Self {
        measurement_m: 1e-4,
        process_mps2: 10.0,
        origin: Origin::Measured,
        horizon_max_s: 0.025,
        lead_extra_s: 0.0,
        acceleration_share: 1.0,
        turn_rule: true,
        reversal_rule: true,
        post_filter: None,
    };
}

/// All settings of a baseline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaselineSettings {
    /// Control period \[s\].
    pub period_s: f64,
    /// Known dead time of the arm, from command to motion \[s\]. The servoj baselines do not use it.
    pub dead_time_s: f64,
    /// Height of a median glyph that the knobs are meant for \[m\].
    pub height_m: f64,
    /// Limits of the tool. Only the trajectory generator uses them; for the others the arm clamps.
    pub limits: Limits,
    pub servo: ServoKnobs,
    /// 1€ filter of the servoj baselines.
    pub one_euro: OneEuroKnobs,
    /// When it takes a step.
    pub feed: Feed,
    pub otg: OtgKnobs,
    pub kalman: KalmanKnobs,
}

impl BaselineSettings {
    /// The baseline tuned for least error: with limits off, least error; with limits on, the Kalman baseline
    /// as smooth as the jerk limit requires.
    ///
    /// `height_m`: height of a median glyph \[m\]; parameters with a length scale with it. See
    /// [`super::sweep`].
    #[must_use]
    pub fn new(kind: BaselineKind, period_s: f64, dead_time_s: f64, limits: Limits, height_m: f64) -> Self {
        let servo = match kind {
            BaselineKind::ServojGello => ServoKnobs { look_ahead_s: 0.1, gain: 300.0 },
            _ => ServoKnobs { look_ahead_s: 0.03, gain: 2000.0 },
        };
        let scale = height_m / TUNED_HEIGHT_M;
        let budget = limits.jerk_mps3 / scale;
        let tuned = Self {
            period_s,
            dead_time_s,
            limits,
            height_m: TUNED_HEIGHT_M,
            servo,
            one_euro: tuned::one_euro(kind),
            feed: Feed::Periods,
            otg: tuned::otg(dead_time_s, budget),
            kalman: tuned::kalman(dead_time_s, budget),
        };
        tuned.for_height(height_m)
    }

    /// The same settings for glyphs of another height: parameters with a length scale with it, `limits` stay.
    #[must_use]
    pub fn for_height(mut self, height_m: f64) -> Self {
        let scale = height_m / self.height_m;
        self.height_m = height_m;
        self.one_euro.beta_hz_per_mps /= scale;
        if let Some(PostFilter::OneEuro(post)) = &mut self.kalman.post_filter {
            post.beta_hz_per_mps /= scale;
        }
        self.kalman.measurement_m *= scale;
        self.kalman.process_mps2 *= scale;
        let limits = &mut self.otg.limits;
        limits.velocity_mps *= scale;
        limits.acceleration_mps2 *= scale;
        limits.jerk_mps3 *= scale;
        self
    }

    /// # Errors
    ///
    /// The first parameter of this baseline that is outside its range.
    pub(super) fn check(&self, kind: BaselineKind) -> Result<(), BaselineError> {
        let positive = f64::MIN_POSITIVE;
        let mut ranges = vec![
            ("period_s", self.period_s, 1e-4, 0.1),
            ("dead_time_s", self.dead_time_s, 0.0, 1.0),
            ("height_m", self.height_m, 1e-4, 10.0),
            ("servo.look_ahead_s", self.servo.look_ahead_s, 1e-3, 1.0),
            ("limits.velocity_mps", self.limits.velocity_mps, positive, f64::INFINITY),
            ("limits.acceleration_mps2", self.limits.acceleration_mps2, positive, f64::INFINITY),
            ("limits.jerk_mps3", self.limits.jerk_mps3, positive, f64::INFINITY),
        ];
        match kind {
            BaselineKind::ServojGello | BaselineKind::ServojRos => {
                ranges.extend(one_euro_ranges(&self.one_euro))
            }
            BaselineKind::Otg => ranges.extend([
                ("otg.window_s", self.otg.window_s, 1e-3, 0.5),
                ("otg.acceleration_share", self.otg.acceleration_share, 0.0, 1.0),
                ("otg.horizon_max_s", self.otg.horizon_max_s, 0.0, f64::INFINITY),
                ("otg.limits.velocity_mps", self.otg.limits.velocity_mps, positive, 1e6),
                ("otg.limits.acceleration_mps2", self.otg.limits.acceleration_mps2, positive, 1e6),
                ("otg.limits.jerk_mps3", self.otg.limits.jerk_mps3, positive, 1e9),
            ]),
            BaselineKind::Kalman => {
                ranges.extend([
                    ("kalman.measurement_m", self.kalman.measurement_m, positive, 1.0),
                    ("kalman.process_mps2", self.kalman.process_mps2, positive, 1e9),
                    ("kalman.horizon_max_s", self.kalman.horizon_max_s, 0.0, f64::INFINITY),
                    ("kalman.lead_extra_s", self.kalman.lead_extra_s, 0.0, 0.5),
                    ("kalman.acceleration_share", self.kalman.acceleration_share, 0.0, 1.0),
                ]);
                match &self.kalman.post_filter {
                    Some(PostFilter::OneEuro(knobs)) => ranges.extend(one_euro_ranges(knobs)),
                    Some(PostFilter::Servo(look_ahead_s)) => {
                        ranges.push(("kalman.post_filter", *look_ahead_s, 1e-3, 1.0));
                    }
                    None => {}
                }
            }
        }
        let broken = ranges.into_iter().find(|(_, value, low, high)| !(*low <= *value && *value <= *high));
        broken.map_or(Ok(()), |(name, value, low, high)| {
            Err(BaselineError::Range { kind, name, value, low, high })
        })
    }
}

fn one_euro_ranges(knobs: &OneEuroKnobs) -> [(&'static str, f64, f64, f64); 3] {
    let positive = f64::MIN_POSITIVE;
    [
        ("min_cutoff_hz", knobs.min_cutoff_hz, positive, 1e6),
        ("beta_hz_per_mps", knobs.beta_hz_per_mps, 0.0, 1e9),
        ("speed_cutoff_hz", knobs.speed_cutoff_hz, positive, 1e6),
    ]
}

/// A baseline that cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BaselineError {
    /// An unknown name.
    #[error("there is no baseline {name:?}; there are servoj-gello, servoj-ros, otg, kalman")]
    NoSuchWay { name: String },
    /// A knob.
    #[error("{kind}: {name} is {value}; legal: {low} to {high}")]
    Range { kind: BaselineKind, name: &'static str, value: f64, low: f64, high: f64 },
}
