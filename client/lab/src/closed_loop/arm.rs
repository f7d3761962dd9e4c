//! The arms of the benchmark, each with its settings of the loop.

use foretrace_config::Config;
use foretrace_control::arm::JointLimits;
use foretrace_control::follower::FollowerSettings;
use foretrace_control::monitor::TrackingSettings;
use foretrace_control::mpc::Gains;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;
use foretrace_sim::arm::{ArmSettings, JOINTS, Mechanics};

use crate::baselines::ServoKnobs;
use crate::experiments::{ArmKind, ur5_at};

/// An arm and the size of the letters written with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BenchArm {
    /// Follows commands exactly; motion limits off.
    Ideal,
    /// 30 ms of pure delay; motion limits off.
    Delay30,
    /// The simulated UR5 behind its servo, all limits on.
    Ur5,
    /// A UR5 behind a servo that takes 100 ms, all limits on.
    Slow,
}

/// What is not ideal: the arms that have a servo, [`BenchArm::Ur5`] and [`BenchArm::Slow`], and the way of
/// the pen's samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flaws {
    /// Damping ratio of the servo; 1: none.
    pub damping: f64,
    /// Friction, gain, backlash, sag and encoder steps.
    pub mechanics: Mechanics,
    /// Age of a pen sample when it arrives \[ns\].
    pub pen_age_ns: u64,
}

impl Default for Flaws {
    fn default() -> Self {
        Self { damping: 1.0, mechanics: Mechanics::IDEAL, pen_age_ns: 0 }
    }
}

impl Flaws {
    /// `kind` with them.
    #[must_use]
    pub fn of(&self, kind: ArmKind) -> ArmKind {
        let Self { damping, mechanics, .. } = *self;
        match kind {
            ArmKind::Ur5(arm) => ArmKind::Ur5(ArmSettings { damping, mechanics, ..arm }),
            kind => kind,
        }
    }
}

/// Delay of [`BenchArm::Delay30`] \[s\].
const DELAY_S: f64 = 0.030;
/// From command to motion on [`BenchArm::Slow`] \[s\].
const SLOW_S: f64 = 0.100;
/// Largest gain that a plan may have.
pub(super) const FREE_GAIN: f64 = 1e3;
/// "Off" for the IK's correction back to the commanded tool: velocity \[m/s\] and acceleration \[m/s²\].
const FREE_CORRECTION: [f64; 2] = [1e3, 1e6];
/// Shortest step that a plan may have \[s\], and the part of its effort that is left: least error on UNIPEN
/// train writers.
const FREE_STEP_S: f64 = 1e-3;
const FREE_EASE: f64 = 0.1;
/// Plans on these arms do not follow the settings, so that measurements stay comparable between versions:
/// effort and gains, for steps of this length \[s\].
const FREE_REFERENCE_S: f64 = 5e-3;
const FREE_EFFORT: f64 = 10.0;
const FREE_FEEDBACK: Gains = Gains { position: 1.0, velocity: 3.5, acceleration: 0.0, decay: 1.0 };
const FREE_FEEDFORWARD: Gains = Gains { position: FREE_GAIN, velocity: 0.1, acceleration: 0.0, decay: 1.0 };
/// "Off" for the joints: velocity \[rad/s\] and acceleration \[rad/s²\]. 30 times a UR5's velocity, and no
/// more: the IK is linear over a period, and fails if a jump of the pen may turn a joint by half a turn in
/// one.
const FREE_JOINTS: [f64; 2] = [100.0, 1e6];
/// How far joints \[rad\] and tool \[m\] may be from their commands: as far as can be set.
const FREE_TRACKING: [f64; 2] = [0.5, 0.2];
/// Half the width and height of the paper in front of an unlimited arm \[m\].
const FREE_HALF_M: [f64; 2] = [0.30, 0.25];

impl BenchArm {
    pub const ALL: [Self; 4] = [Self::Ideal, Self::Delay30, Self::Ur5, Self::Slow];

    /// Name in tables and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Delay30 => "delay30",
            Self::Ur5 => "ur5",
            Self::Slow => "slow",
        }
    }

    /// Height that the median train glyph gets \[m\].
    #[must_use]
    pub const fn glyph_height_m(self) -> f64 {
        if self.limited() { 0.03 } else { 0.1 }
    }

    #[must_use]
    pub const fn limited(self) -> bool {
        matches!(self, Self::Ur5 | Self::Slow)
    }

    /// The arm behind the loop of `config`.
    #[must_use]
    pub fn kind(self, config: &Config) -> ArmKind {
        let ur5 = ur5_at(config);
        match self {
            Self::Ideal => ArmKind::Ideal,
            Self::Delay30 => ArmKind::Delayed(DELAY_S),
            Self::Ur5 => ArmKind::Ur5(ur5),
            Self::Slow => ArmKind::Ur5(ArmSettings {
                look_ahead_s: SLOW_S - (ur5.group_delay_s() - ur5.look_ahead_s),
                ..ur5
            }),
        }
    }

    /// The same arm behind a baseline: `ur5` takes the look-ahead that it gives its servo. `slow` has a fixed
    /// servo of 100 ms, so it stays as it is.
    #[must_use]
    pub(super) fn kind_for_baseline(self, config: &Config, servo: ServoKnobs) -> ArmKind {
        match (self, self.kind(config)) {
            (Self::Ur5, ArmKind::Ur5(arm)) => {
                ArmKind::Ur5(ArmSettings { look_ahead_s: servo.look_ahead_s, ..arm })
            }
            (_, kind) => kind,
        }
    }

    /// Width and height of the paper \[m\], centred on [`Self::centre_m`].
    #[must_use]
    pub fn paper_m(self, config: &Config) -> [f64; 2] {
        let [x, y, _] = config.settings().plane.workspace_m;
        if self.limited() { [x[1] - x[0], y[1] - y[0]] } else { FREE_HALF_M.map(|half| 2.0 * half) }
    }

    /// Middle of the paper \[m\].
    #[must_use]
    pub fn centre_m(self, config: &Config) -> [f64; 2] {
        let [x, y, _] = config.settings().plane.workspace_m;
        [0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])]
    }

    /// The sharpest plan for this arm, with `gain` towards the prediction: without limits its steps are so
    /// short that a jump of the prediction is followed within a tick. Feedback only (Hold) keeps steps of the
    /// control period.
    pub(super) fn sharpen(self, settings: &mut FollowerSettings<JOINTS>, gain: f64) {
        if self.limited() {
            return;
        }
        let hold = settings.trust_request == TrustRequest::Manual(Trust::NONE);
        let (step_s, ease) =
            if hold { (settings.period_ns as f64 * 1e-9, 1.0) } else { (FREE_STEP_S, FREE_EASE) };
        // Scales the cost so that it does not depend on the length of the steps.
        let finer = FREE_REFERENCE_S / step_s;
        settings.mpc.step_s = step_s;
        settings.mpc.effort = FREE_EFFORT * ease * finer.powi(6);
        settings.mpc.gains_feedback =
            [Gains { velocity: FREE_FEEDBACK.velocity * finer, ..FREE_FEEDBACK }; 3];
        settings.mpc.gains_feedforward = [Gains { position: gain, ..FREE_FEEDFORWARD }; 3];
    }

    /// `settings` for this arm: limits on or off, and a pen gate that grows with the letters.
    pub(super) fn fit(self, config: &Config, settings: &mut FollowerSettings<JOINTS>) {
        // The paths are in metres of the plane already.
        settings.plane.pen_scale = 1.0;
        settings.plane.pen_origin = [0.0; 2];
        if self.limited() {
            return;
        }
        settings.mpc.unlimited = true;
        let centre = self.centre_m(config);
        for (axis, limits) in settings.mpc.axes.iter_mut().enumerate() {
            if let (Some(centre), Some(half)) = (centre.get(axis), FREE_HALF_M.get(axis)) {
                limits.position_m = [centre - half - 0.1, centre + half + 0.1];
            }
        }
        let growth = self.glyph_height_m() / Self::Ur5.glyph_height_m();
        settings.pen.max_speed_mps *= growth;
        settings.pen.position_min_m = settings.pen.position_min_m.map(|low| low * growth);
        settings.pen.position_max_m = settings.pen.position_max_m.map(|high| high * growth);
        let [velocity, acceleration] = FREE_JOINTS;
        let position = *settings.limits.position();
        if let Ok(free) = JointLimits::new(position, [velocity; JOINTS], [acceleration; JOINTS]) {
            settings.limits = free;
        }
        [settings.ik.correction_mps, settings.ik.correction_mps2] = FREE_CORRECTION;
        // The monitor knows the arm's answer on a grid of 10 ms; within one step such an arm crosses the
        // paper.
        let [joint_rad, tool_m] = FREE_TRACKING;
        settings.safety.tracking = TrackingSettings { joint_rad, tool_m, ..settings.safety.tracking };
    }
}
