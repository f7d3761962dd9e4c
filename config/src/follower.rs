//! From settings to what the control law and the learner are built from: units, frames and types change here
//! only.
//!
//! Contract: a [`Config`] always converts; what the law itself would refuse was refused when the config was
//! checked.

use foretrace_clarabel::ClarabelProfile;
use foretrace_control::arm::lag::Following;
use foretrace_control::contact::ContactSettings;
use foretrace_control::envelope::EnvelopeSettings;
use foretrace_control::estimate::LawParameters;
use foretrace_control::estimate::refine::RefinePrior;
use foretrace_control::follower::{Follower, FollowerError, FollowerSettings, SafetySettings};
use foretrace_control::ik::IkSettings;
use foretrace_control::learn::{Leads, LearnError, Learner, LearnerSettings, Rule};
use foretrace_control::monitor::{SlowArm, TrackingSettings};
use foretrace_control::mpc::{AxisLimits, Gains, MpcError, MpcSettings, SoftPenalty};
use foretrace_control::pen::{PenSettings, SpeedScaleSettings};
use foretrace_control::plane::Plane;
use foretrace_control::predict::{MAX_PREVIEW, Models, PreviewSettings};
use foretrace_control::qp::backend::Backend;
use foretrace_control::trust::{TrustRequest, TrustSettings};
use foretrace_control::units::Trust;
use nalgebra::Vector3;

use crate::config::Config;
use crate::headroom::payload;
use crate::robot::{JOINTS, Robot};
use crate::settings::{self, QpBackend, Settings, SlowArmChoice, TrustMode};

impl Config {
    /// What the follower is built from; the horizon N is `settings().mpc.horizon`.
    #[must_use]
    pub fn follower_settings(&self) -> FollowerSettings<JOINTS> {
        follower_settings(self.settings(), self.robot(), self.models(), self.prior())
    }

    /// What the learner is built from.
    #[must_use]
    pub fn learner_settings(&self) -> LearnerSettings {
        learner_settings(self.settings())
    }
}

impl Settings {
    /// Control period dt in nanoseconds.
    #[must_use]
    pub fn period_ns(&self) -> u64 {
        1_000_000_000 / u64::from(self.control_loop.rate_hz.max(1))
    }

    /// Step of the plan in seconds.
    #[must_use]
    pub fn plan_step_s(&self) -> f64 {
        let period_ms = self.period_ns() as f64 * 1e-6;
        let usual_ms = (0.25 * f64::from(self.pen.step_ms)).max(period_ms);
        self.mpc.step_ms.unwrap_or(usual_ms) * 1e-3
    }

    /// How far ahead the first reference of a plan lies at start, in nanoseconds.
    #[must_use]
    pub fn ahead_ns(&self) -> u64 {
        let pure_ms = (self.timing.dead_time_ms - self.timing.servo_filter_ms).max(0.0);
        ns(pure_ms + self.mpc.response_ms)
    }

    /// Grid steps that the plan spans.
    #[must_use]
    pub fn plan_steps(&self) -> usize {
        let spanned_s = self.plan_step_s() * f64::from(self.mpc.horizon);
        (spanned_s / (self.step_ns() as f64 * 1e-9)).ceil().max(1.0) as usize
    }

    /// Grid step Δ in nanoseconds.
    #[must_use]
    pub fn step_ns(&self) -> u64 {
        u64::from(self.pen.step_ms) * 1_000_000
    }
}

impl settings::TrustSection {
    /// How the trust is set, in the control law's types.
    #[must_use]
    pub fn request(&self) -> TrustRequest {
        match self.mode {
            TrustMode::Auto => TrustRequest::Auto,
            TrustMode::Manual => TrustRequest::Manual(Trust::new(self.value)),
        }
    }
}

/// What the control law says to settings that passed every other test.
pub(crate) fn judge(
    settings: &Settings,
    robot: &Robot,
    models: &Models,
    prior: &RefinePrior,
) -> Result<(), LawRefusal> {
    Learner::new(learner_settings(settings), models)?;
    let follower = follower_settings(settings, robot, models, prior);
    match settings.mpc.horizon {
        10 => drop(Follower::<10, JOINTS>::new(follower)?),
        20 => drop(Follower::<20, JOINTS>::new(follower)?),
        _ => drop(Follower::<30, JOINTS>::new(follower)?),
    }
    Ok(())
}

/// Why the control law refuses settings.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LawRefusal {
    /// The loop.
    #[error("the loop: {0}{keys}", keys = keys(.0))]
    Follower(#[from] FollowerError),
    /// The learner.
    #[error("the learner: {0}")]
    Learner(#[from] LearnError),
}

/// The keys behind a refusal that has no single key.
const fn keys(error: &FollowerError) -> &'static str {
    match error {
        FollowerError::Mpc(MpcError::Swings { .. }) => {
            " (mpc.feedback.velocity and mpc.feedforward.velocity; mpc.horizon, mpc.step_ms, \
             mpc.feedback.decay, mpc.feedforward.decay, mpc.effort)"
        }
        FollowerError::JointJerk { .. } => " (robot.jerk_radps3; robot.acceleration_radps2)",
        FollowerError::LittleJerk { .. } => {
            " (mpc.limits.x, y and z .jerk_mps3; robot.jerk_radps3; mpc.horizon, mpc.step_ms)"
        }
        FollowerError::NoRest { .. } => {
            " (mpc.limits.x, y and z; mpc.feedback, mpc.feedforward; mpc.max_iterations, mpc.horizon, \
             mpc.step_ms)"
        }
        _ => "",
    }
}

fn follower_settings(
    s: &Settings,
    robot: &Robot,
    models: &Models,
    prior: &RefinePrior,
) -> FollowerSettings<JOINTS> {
    FollowerSettings {
        payload: payload(&s.robot.payload, s.robot.ur.payload_kg, &s.robot.tool_m),
        period_ns: s.period_ns(),
        pen: pen(s),
        preview: PreviewSettings {
            step_ns: s.step_ns(),
            kind: s.predictor.kind,
            fallback: s.predictor.external.fallback.0,
            most_late: s.predictor.external.most_late_steps,
            limit_factor: s.predictor.limit_factor,
            peak_fade: s.predictor.peak_fade,
            scale: SpeedScaleSettings {
                initial_m: s.predictor.scale.initial_m,
                min_m: s.predictor.scale.min_m,
                max_m: s.predictor.scale.max_m,
                memory_steps: s.predictor.scale.memory_steps,
                still_m: s.predictor.scale.still_m,
                max_change: s.predictor.scale.max_change,
            },
        },
        models: models.clone(),
        weights: models.initial_weights(),
        prior: *prior,
        law: LawParameters::SHIPPED,
        trust: TrustSettings {
            step_ns: s.step_ns(),
            ramp_steps: f64::from(s.trust.ramp_steps),
            warmup_steps: s.trust.warmup_steps,
            stale_after_ns: ns(s.pen.stale_ms),
            auto_ceiling: Trust::new(s.trust.ceiling),
            per_step: s.trust.per_step,
        },
        trust_request: s.trust.request(),
        mpc: mpc(s),
        plane: plane(s),
        chain: robot.chain.clone(),
        limits: robot.limits,
        ik: ik(s, robot),
        clearance: robot.clearance.clone(),
        ik_backend: backend(s.ik.backend),
        dead_time_ns: ns(s.timing.dead_time_ms),
        following: following(s),
        response_ns: ns(s.mpc.response_ms),
        velocity_lead_ns: ns(s.mpc.velocity_lead_ms),
        safety: SafetySettings {
            valid_periods: s.control_loop.valid_periods,
            latch_after_ns: ns(s.safety.latch_after_ms),
            joint_state_timeout_ns: ns(s.safety.joint_state_timeout_ms),
            enable_timeout_ns: ns(s.safety.enable_timeout_ms),
            enable_required: s.safety.enable_required,
            hold_after_ns: ns(s.safety.hold_after_ms),
            arm_max_speed: s.safety.arm_max_speed_radps,
            arm_workspace_margin: s.safety.arm_workspace_margin_m,
            arm_max_tilt: s.safety.arm_max_tilt_rad,
            previous_plan_max_ns: ns(s.safety.previous_plan_max_ms),
            approach_distance: s.safety.approach_distance_m,
            tracking: tracking(&s.safety.tracking),
            contact: ContactSettings {
                judged: s.safety.contact.stop,
                torque_share: s.safety.contact.torque_share,
                hold_ns: ns(s.safety.contact.hold_ms),
                learn_ns: ns(1e3 * s.safety.contact.learn_s),
            },
            envelope: EnvelopeSettings {
                margin_m: s.safety.envelope.margin_m,
                max_tilt_rad: s.safety.envelope.max_tilt_rad,
                max_speed_mps: s.safety.envelope.max_speed_mps,
            },
        },
    }
}

fn tracking(s: &settings::Tracking) -> TrackingSettings {
    TrackingSettings {
        joint_rad: s.joint_rad,
        tool_m: s.tool_m,
        still_rad: s.still_rad,
        runaway_radps: s.runaway_radps,
        hold_ns: ns(s.hold_ms),
        slow_arm: match s.slow_arm {
            SlowArmChoice::SlowDown => SlowArm::SlowDown,
            SlowArmChoice::Stop => SlowArm::Stop,
        },
    }
}

/// The largest dead time that following may reach, by default \[ms\].
const FARTHEST_MS: f64 = 200.0;

fn following(s: &Settings) -> Following {
    if !s.timing.follow_lag {
        return Following::Fixed;
    }
    let step_ms = f64::from(s.pen.step_ms);
    let plan_ms = s.plan_step_s() * 1e3 * f64::from(s.mpc.horizon);
    let room_ms = (MAX_PREVIEW as f64 - 2.0) * step_ms - plan_ms - s.mpc.response_ms - s.pen.stale_ms;
    // If there is no room for the initial dead time either, the check of the horizon reports it.
    let most_ms = room_ms.min(FARTHEST_MS).max(s.timing.dead_time_ms);
    let max_ms = s.timing.dead_time_max_ms.unwrap_or(most_ms);
    Following::Measured { max_ns: ns(max_ms), rate: s.timing.follow_rate }
}

fn plane(s: &Settings) -> Plane {
    Plane {
        origin: Vector3::from(s.plane.origin_m),
        rotation: s.plane.rotation(),
        pen_scale: s.plane.scale,
        pen_origin: s.plane.pen_origin_m,
        lift_height: s.plane.lift_height_m,
        press_depth: s.plane.press_m,
    }
}

/// Settings are in the device's frame, the tracker in the plane's.
fn pen(s: &Settings) -> PenSettings {
    let plane = plane(s);
    let [[x_min, x_max], [y_min, y_max]] = s.pen.bounds_m;
    PenSettings {
        step_ns: s.step_ns(),
        max_gap_ns: ns(s.pen.max_gap_ms),
        max_future_ns: ns(s.pen.future_tolerance_ms),
        max_speed_mps: s.pen.max_speed_mps * s.plane.scale,
        min_interval_ns: u64::from(s.pen.min_interval_us) * 1000,
        position_min_m: plane.from_pen([x_min, y_min]),
        position_max_m: plane.from_pen([x_max, y_max]),
    }
}

fn mpc(s: &Settings) -> MpcSettings {
    let gains = |g: &settings::Gains| Gains {
        position: g.position,
        velocity: g.velocity,
        acceleration: g.acceleration,
        decay: g.decay,
    };
    let limits = |axis: &settings::AxisLimits, position_m| AxisLimits {
        jerk_mps3: axis.jerk_mps3,
        acceleration_mps2: axis.acceleration_mps2,
        velocity_mps: axis.velocity_mps,
        position_m,
    };
    let [x_range, y_range, z_range] = s.plane.workspace_m;
    let settings::Limits { x, y, z } = &s.mpc.limits;
    MpcSettings {
        step_s: s.plan_step_s(),
        gains_feedback: [gains(&s.mpc.feedback); 3],
        gains_feedforward: [gains(&s.mpc.feedforward); 3],
        effort: s.mpc.effort,
        axes: [limits(x, x_range), limits(y, y_range), limits(z, z_range)],
        soft_penalty: SoftPenalty {
            acceleration: s.mpc.penalty.acceleration,
            velocity: s.mpc.penalty.velocity,
            position: s.mpc.penalty.position,
        },
        backend: backend(s.mpc.backend),
        max_iterations: s.mpc.max_iterations,
        servo_s: s.timing.servo_filter_ms * 1e-3,
        unlimited: false,
    }
}

const fn backend(backend: QpBackend) -> Backend {
    match backend {
        QpBackend::Exact => Backend::Exact,
        QpBackend::Clarabel => Backend::Other(&ClarabelProfile::Default),
        QpBackend::ClarabelTuned => Backend::Other(&ClarabelProfile::Tuned),
    }
}

fn ik(s: &Settings, robot: &Robot) -> IkSettings<JOINTS> {
    IkSettings {
        gain_hz: s.ik.gain_hz.unwrap_or(0.5 * f64::from(s.control_loop.rate_hz)),
        orientation_m: s.ik.orientation_length_m,
        normal_weight: s.ik.normal_weight,
        tilt_weight: s.ik.tilt_weight,
        spin_weight: s.ik.spin_weight,
        damping_floor_m2: s.ik.damping_floor_m2,
        damping_peak_m2: s.ik.damping_peak_m2,
        singular_m: s.ik.singular_m,
        correction_mps: s.ik.correction_mps,
        correction_mps2: s.ik.correction_mps2,
        posture_weight_m2: s.ik.posture_weight_m2,
        posture_hz: s.ik.posture_hz,
        home: robot.home,
    }
}

fn learner_settings(s: &Settings) -> LearnerSettings {
    LearnerSettings {
        leads: Leads::of_loop(s.step_ns(), s.ahead_ns(), s.plan_steps()),
        rule: Rule {
            memory_steps: s.learner.memory_steps,
            min_evidence: s.learner.min_evidence_steps,
            promote_ratio: s.learner.promote_ratio,
            rollback_ratio: s.learner.rollback_ratio,
            follow_steps: s.learner.follow_steps,
        },
        max_learned: s.learner.max_learned,
    }
}

/// Milliseconds to whole nanoseconds; the ranges of the keys keep it positive and far below the end of u64.
fn ns(ms: f64) -> u64 {
    (ms * 1e6).round() as u64
}
