//! `Status`: the daemon's state, sent ten times per second and on every change.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use super::arm_lag::ArmLag;
use super::arm_line::ArmLine;
use super::arm_note::NoteWords;
use super::check::{Rejection, Validate, flags, known};
use super::counters::Counters;
use super::flags::{arm_flags, missing_rights};
use super::header::Header;
use super::latency::Latency;
use super::layout::wire;
use super::predictor_name::PredictorName;
use super::refused::Refused;
use super::stop_detail::{StopCause, StopDetail, ToolExtent};
use super::tick_record::Chain;
use super::vocabulary::{FaultReason, Mode, STAGES, Stage, TrustReason, UnknownValue, wire_enum};
use super::{AXES, JOINTS};

wire! {
    /// Distribution of a duration \[ns\], saturated.
    "foretrace.PercentilesV1"
    pub struct Percentiles {
        /// Median.
        pub p50_ns: u32,
        /// 99 of 100 are at most this.
        pub p99_ns: u32,
        /// 999 of 1000 are at most this.
        pub p99_9_ns: u32,
        /// The largest.
        pub max_ns: u32,
    }
}

wire! {
    /// How well a tool follows the pen, since the loop was armed. Distances in the plane; negative: unknown.
    /// Lags are the shift of the pen that fits the tool best, −0.05 to 0.2; NaN: unknown.
    "foretrace.TrackingV1"
    pub struct Tracking {
        /// Root mean square distance while the pen writes, over the last seconds of writing \[m\].
        pub recent_rms_m: f64,
        /// The same since arming \[m\].
        pub session_rms_m: f64,
        /// The same since arming, hovering included \[m\].
        pub hover_rms_m: f64,
        /// Lag of the tool behind the pen, over the last seconds of writing \[s\].
        pub recent_lag_s: f64,
        /// The same since arming \[s\].
        pub session_lag_s: f64,
    }
}

impl Tracking {
    /// Nothing known.
    pub const UNKNOWN: Self = Self {
        recent_rms_m: -1.0,
        session_rms_m: -1.0,
        hover_rms_m: -1.0,
        recent_lag_s: f64::NAN,
        session_lag_s: f64::NAN,
    };
}

wire! {
    /// The straight way home from the measured joints, or the rest of it while the arm moves along it.
    "foretrace.WayHomeV1"
    pub struct WayHome {
        /// Distance from home of the joint that turns farthest \[rad\]; negative: unknown.
        pub farthest_rad: f64,
        /// Duration of the way, or of the rest of it, without obstacles \[s\]; negative: unknown.
        pub left_s: f64,
        /// In mode [`Mode::Homing`], the fraction of the way done; negative: in another mode.
        pub share: f64,
        /// The joint that turns farthest, from 0, base first.
        pub joint: u32,
        /// In mode [`Mode::Homing`]: 1 once the way was found clear, and the motion has begun.
        pub moving: u32,
    }
}

impl WayHome {
    /// Nothing known.
    pub const UNKNOWN: Self = Self { farthest_rad: -1.0, left_s: -1.0, share: -1.0, joint: 0, moving: 0 };
}

wire_enum! {
    /// Whether the ghost (what trust 0 would have done) can be compared with the loop.
    pub enum GhostState: u32 {
        /// The loop does not follow the pen, or there is no ghost.
        Off = 0 => "off",
        /// The tool or its ghost is still on its way to the pen.
        Approaching = 1 => "approaching",
        /// Ticks were missing; the ghost starts again and is given time to settle.
        Settling = 2 => "settling",
        /// Compared.
        Comparable = 3 => "comparable",
    }
}

wire_enum! {
    /// Why a preview of another process was not used.
    pub enum PreviewRefusal: u32 {
        /// No preview was refused.
        None = 0 => "none",
        /// No positions, fewer than the plan looks at from now on, or more than there is room for; radii for
        /// some only.
        Malformed = 1 => "malformed",
        /// A position or a radius that is not finite, or a negative radius.
        NonFinite = 2 => "non-finite",
        /// For a grid step that had not closed.
        Ahead = 3 => "ahead",
        /// For a grid step that was too old.
        Late = 4 => "late",
        /// For a grid step of which a preview had come before, or after another one since the newest step
        /// closed.
        Repeated = 5 => "repeated",
        /// For a grid step of the stroke before.
        OtherStroke = 6 => "other stroke",
        /// A displacement much longer than the hand's recent motion.
        Wild = 7 => "wild",
        /// The message itself: its stamp, sequence, boot or count.
        Message = 8 => "message",
    }
}

/// Reasons of [`PreviewRefusal`], `None` left out.
pub const PREVIEW_REFUSALS: usize = 8;

wire! {
    /// The predictor of another process. Counts are since the daemon started, saturated.
    "foretrace.ExternalStateV2"
    pub struct ExternalState {
        /// Its part in the preview in force, 0 to 1; the rest is the fallback's. Negative: it is not chosen.
        pub weight: f32,
        /// Evidence that it is better than the fallback, -10 to 10: used from 5 on, until it falls below 0.
        pub evidence: f32,
        /// Mean of `weight` over the steps that closed while it was chosen; negative: none did.
        pub share: f32,
        /// Grid steps that closed while it was chosen.
        pub steps: u32,
        /// Those of them that had a preview of their own before the next one closed.
        pub hits: u32,
        /// Previews that were taken over.
        pub taken: u32,
        /// Previews that a newer one of the same tick replaced, or that found no room.
        pub lost: u32,
        /// Grid steps that could not be sent.
        pub unsent: u32,
        /// Previews refused by reason, in the order of [`PreviewRefusal`] from `Malformed` on.
        pub refused: [u32; PREVIEW_REFUSALS],
        /// From a grid step sent to its preview received, over the last two seconds; 0: nothing came.
        pub latency: Percentiles,
    }
}

impl ExternalState {
    /// It is not chosen, and never was.
    pub const NONE: Self = Self {
        weight: -1.0,
        evidence: 0.0,
        share: -1.0,
        steps: 0,
        hits: 0,
        taken: 0,
        lost: 0,
        unsent: 0,
        refused: [0; PREVIEW_REFUSALS],
        latency: Percentiles { p50_ns: 0, p99_ns: 0, p99_9_ns: 0, max_ns: 0 },
    };
}

wire! {
    /// State of the daemon. Distributions are over all ticks since start, after warm-up.
    "foretrace.StatusV9"
    pub struct Status {
        /// Stamp: when it was sent.
        pub header: Header,
        /// Identifies this start of the daemon.
        pub daemon_id: u64,
        /// Process number.
        pub pid: u32,
        /// [`Mode`].
        pub mode: u32,
        /// [`FaultReason`].
        pub fault: u32,
        /// [`mod@missing_rights`].
        pub missing_rights: u32,
        /// Ticks per second, configured \[Hz\].
        pub rate_hz: f64,
        /// Ticks per second over the last second, measured \[Hz\].
        pub measured_rate_hz: f64,
        /// Newest tick.
        pub tick: u64,
        /// Since the daemon started \[ns\].
        pub uptime_ns: u64,
        /// Number of changes of live settings.
        pub settings_revision: u64,
        /// Hash of the settings.
        pub settings_hash: u64,

        /// Distribution of each [`Stage`].
        pub stages: [Percentiles; STAGES],
        /// Totals.
        pub counters: Counters,

        /// Trust α.
        pub trust: f64,
        /// Target of α.
        pub trust_target: f64,
        /// [`TrustReason`].
        pub trust_reason: u32,
        /// The active predictor; none before the first tick.
        pub predictor: PredictorName,
        /// Age of the newest pen sample \[ns\]; `u64::MAX`: none.
        pub pen_age_ns: u64,
        /// Age of the newest joint state \[ns\]; `u64::MAX`: none.
        pub joint_state_age_ns: u64,
        /// Parts of the latency, each the median over about the last second.
        pub chain: Chain,
        /// From the device stamp of a pen sample to the first command handed over after it was received.
        pub pen_to_command: Latency,
        /// From a command handed over to its motion: to its stamp, plus the arm's measured lag.
        pub command_to_motion: Latency,

        /// Version of the weights in use.
        pub learner_version: u64,
        /// Grid steps learnt from.
        pub learner_updates: u64,
        /// Sets of weights handed to the loop.
        pub learner_promotions: u64,
        /// Sets of weights rolled back.
        pub learner_rollbacks: u64,
        /// Sets of weights not handed over: non-finite or worse.
        pub learner_refused: u64,
        /// Age of the weights in use \[ns\].
        pub learner_age_ns: u64,
        /// Root mean square of the one-step prediction error, recent \[m\]; negative: none.
        pub predictor_rms_m: f64,
        /// Radius about the plan's first reference in which the pen is expected in nine of ten cases \[m\];
        /// negative: unknown.
        pub predictor_band_m: f64,

        /// The arm's lag, and the plan's dead time.
        pub arm_lag: ArmLag,
        /// Score of the measured arm.
        pub tracking: Tracking,
        /// Score of the arm as it would be at Hold (trust 0), at the same instants.
        pub ghost: Tracking,
        /// How long the pen wrote while both were compared \[s\].
        pub compared_s: f64,
        /// [`GhostState`].
        pub ghost_state: u32,
        /// Median cost of the ghost per tick, on a thread that no tick waits for \[ns\].
        pub ghost_cost_ns: u32,

        /// Heap allocations per tick after warm-up, ticks with a connection change left out.
        pub allocations_per_tick: f64,
        /// Evidence behind the newest latched stop.
        pub stop: StopDetail,
        /// Extremes of the measured tool.
        pub extent: ToolExtent,
        /// Fraction of the commanded speed at which the arm moves; negative: unknown.
        pub arm_speed_share: f64,
        /// The newest pen sample that was refused.
        pub pen_refused: Refused,
        /// The newest joint state that was refused.
        pub joints_refused: Refused,
        /// The newest dead-man message that was refused.
        pub enable_refused: Refused,
        /// The newest echo of a command that was rejected.
        pub echo_refused: Refused,
        /// The way home.
        pub way_home: WayHome,
        /// The line to the arm's controller.
        pub arm_line: ArmLine,
        /// Measured joints \[rad\]; zero while there is no joint state.
        pub joints_q: [f64; JOINTS],
        /// The measured tool in the base frame: position \[m\], then rotation vector \[rad\], as a pendant
        /// shows it.
        pub tool_base: [f64; 6],
        /// The measured tool in the plane's frame \[m\]: along the paper, across it, above it.
        pub tool_plane_m: [f64; AXES],
        /// When the note of the arm's process came into force \[ns\]; 0: there is none.
        pub note_since_ns: u64,
        /// That note.
        pub note: NoteWords,
        /// The predictor of another process.
        pub external: ExternalState,
    }
}

impl Status {
    /// Distribution of a stage.
    pub fn stage(&self, stage: Stage) -> Percentiles {
        self.stages.get(stage as usize).copied().unwrap_or_default()
    }
}

impl Validate for Status {
    fn validate(&self) -> Result<(), Rejection> {
        known::<_, Mode>("mode", self.mode)?;
        known::<_, FaultReason>("fault", self.fault)?;
        known::<_, StopCause>("stop.cause", self.stop.cause)?;
        known::<_, TrustReason>("trust_reason", self.trust_reason)?;
        self.predictor.check("predictor")?;
        known::<_, GhostState>("ghost_state", self.ghost_state)?;
        flags("arm_line.flags", self.arm_line.flags, arm_flags::ALL)?;
        flags("missing_rights", self.missing_rights, missing_rights::ALL)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::vocabulary::RejectReason;

    #[test]
    fn unknown_modes_and_rights_are_refused() {
        assert_eq!(Status::default().validate(), Ok(()));
        let status = Status { mode: 77, ..Default::default() };
        assert_eq!(status.validate(), Err(Rejection::new(RejectReason::UnknownEnum, "mode")));
        let status = Status { missing_rights: u32::MAX, ..Default::default() };
        assert_eq!(status.validate().unwrap_err().reason, RejectReason::UnknownFlags);
    }

    #[test]
    fn a_stage_has_its_own_distribution() {
        let mut status = Status::default();
        status.stages[Stage::Ik as usize].p50_ns = 7;
        let medians = [Stage::Ik, Stage::Mpc, Stage::Step].map(|stage| status.stage(stage).p50_ns);
        assert_eq!(medians, [7, 0, 0]);
    }

    #[test]
    fn every_number_of_a_vocabulary_is_checked_by_name() {
        type Spoil = fn(&mut Status);
        let cases: [(&str, Spoil); 8] = [
            ("mode", |status| status.mode = 99),
            ("fault", |status| status.fault = 99),
            ("stop.cause", |status| status.stop.cause = 99),
            ("trust_reason", |status| status.trust_reason = 5),
            ("predictor", |status| status.predictor.bytes[0] = 0xff),
            ("ghost_state", |status| status.ghost_state = 4),
            ("arm_line.flags", |status| status.arm_line.flags = 1 << 31),
            ("missing_rights", |status| status.missing_rights = 1 << 31),
        ];
        for (field, spoil) in cases {
            let mut status = Status::default();
            spoil(&mut status);
            assert_eq!(status.validate().unwrap_err().field, field);
        }
    }
}
