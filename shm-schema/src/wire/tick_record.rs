//! `TickRecord`: inputs, decisions and costs of one tick. At most 2 KiB.
//!
//! Contract: unlike in inputs, numbers may be anything, NaN included, so that faults are visible; only enums
//! and flags are checked. `u64::MAX` means an unknown age, a negative number an unknown residual or error.
//! Positions are in the writing plane's frame unless stated otherwise.

use iceoryx2::prelude::ZeroCopySend;

use super::arm_lag::ArmLag;
use super::arm_line::ArmLine;
use super::check::{Rejection, Validate, flags, known};
use super::counters::Counters;
use super::flags::{arm_flags, guard_mask, health, pen_flags};
use super::header::Header;
use super::layout::wire;
use super::predictor_name::PredictorName;
use super::status::GhostState;
use super::stop_detail::{StopCause, StopDetail};
use super::vocabulary::{FaultReason, Mode, Rung, STAGES, SolverPath, Stage, TrustReason};
use super::{AXES, JOINTS};

wire! {
    /// The latency from pen to arm in parts \[ns\]; `u64::MAX`: unknown.
    ///
    /// Not to be summed: a command is stamped one control period after its tick, so compute and transport
    /// within that period delay nothing. The arm's own lag, from a command's stamp to the motion, is
    /// separate.
    "foretrace.ChainV1"
    pub struct Chain {
        /// Device stamp to sent, of the newest pen sample: time of the device and its reader.
        pub pen_reader_ns: u64,
        /// Sent to received by a tick, of the newest pen sample: shared memory, and waiting for the tick.
        pub pen_transport_ns: u64,
        /// Device stamp of the newest pen sample to the release of the tick.
        pub pen_age_ns: u64,
        /// Start of the tick to the command handed to the middleware.
        pub compute_ns: u64,
        /// Handed to the middleware to accepted by the arm, of the newest command that the arm has echoed.
        pub command_transport_ns: u64,
    }
}

impl Chain {
    /// Nothing known.
    pub const UNKNOWN: Self = Self {
        pen_reader_ns: u64::MAX,
        pen_transport_ns: u64::MAX,
        pen_age_ns: u64::MAX,
        compute_ns: u64::MAX,
        command_transport_ns: u64::MAX,
    };
}

/// Points of the previewed path in a [`TickRecord`] at most.
pub const PATH_POINTS: usize = 10;

wire! {
    /// One tick's evidence.
    "foretrace.TickRecordV7"
    pub struct TickRecord {
        /// Stamp: end of the tick.
        pub header: Header,
        /// Number of the tick, from 1.
        pub tick: u64,
        /// When it should have started \[ns\].
        pub release_ns: u64,
        /// The time at which its command holds \[ns\].
        pub command_stamp_ns: u64,
        /// Time left to the deadline \[ns\]; negative after an overrun.
        pub slack_ns: i64,
        /// Cost of each [`Stage`] \[ns\], saturated.
        pub stage_ns: [u32; STAGES],

        /// Caps of iterations the tick was given: MPC.
        pub budget_mpc_iterations: u32,
        /// Caps of iterations the tick was given: IK.
        pub budget_ik_iterations: u32,
        /// 1: the budget was shed.
        pub shed: u32,
        /// Whole periods dropped before this tick.
        pub skipped_ticks: u32,

        /// Identity of the newest pen sample: its number in its publisher's sequence; 0: none yet.
        pub pen_sequence: u64,
        /// Identity of the newest pen sample: its device stamp \[ns\]; 0: none yet.
        pub pen_stamp_ns: u64,
        /// Latencies, part by part.
        pub chain: Chain,
        /// Newest pen position \[m\].
        pub pen_m: [f64; AXES],
        /// Pen samples accepted in this tick.
        pub pen_samples: u32,
        /// [`crate::pen_flags`] of the newest sample.
        pub pen_flags: u32,

        /// Age of the newest joint state \[ns\].
        pub joint_state_age_ns: u64,
        /// Newest measured joint positions \[rad\].
        pub measured_q: [f64; JOINTS],
        /// Tick of the newest command that the arm has echoed; 0: none.
        pub echo_tick: u64,
        /// Identity of the pen sample behind that command, as echoed: its number.
        pub echo_pen_sequence: u64,
        /// Identity of the pen sample behind that command, as echoed: its device stamp \[ns\].
        pub echo_pen_stamp_ns: u64,

        /// Reference of the tool at the command's stamp \[m\].
        pub reference_m: [f64; AXES],
        /// Setpoint: position \[m\].
        pub setpoint_m: [f64; AXES],
        /// Setpoint: velocity \[m/s\].
        pub setpoint_mps: [f64; AXES],
        /// Setpoint: acceleration \[m/s²\].
        pub setpoint_mps2: [f64; AXES],
        /// Jerk of the setpoint since the tick before \[m/s³\]; 0 where that tick sent no command.
        pub jerk_mps3: [f64; AXES],
        /// Tool position of the published command \[m\].
        pub tool_m: [f64; AXES],
        /// Published joint positions \[rad\].
        pub q: [f64; JOINTS],
        /// Published joint velocities \[rad/s\].
        pub qd: [f64; JOINTS],

        /// Trust α: 1 prediction only, 0 hold only.
        pub trust: f64,
        /// Target of α.
        pub trust_target: f64,
        /// Part of another process's predictor in the preview, \[0, 1\]; negative: it is not chosen.
        pub confidence: f64,
        /// [`TrustReason`].
        pub trust_reason: u32,
        /// [`Rung`].
        pub rung: u32,
        /// [`Mode`].
        pub mode: u32,
        /// [`FaultReason`].
        pub fault: u32,
        /// [`mod@health`].
        pub health: u32,
        /// [`mod@guard_mask`].
        pub guard_mask: u32,
        /// Joints the guard altered, one bit per joint.
        pub guard_joints: u32,
        /// Soft limits of the MPC exceeded, all axes.
        pub mpc_soft: u32,

        /// Active limits of the MPC, per axis.
        pub mpc_active: [u32; AXES],
        /// Solver iterations, per axis.
        pub mpc_iterations: [u32; AXES],
        /// [`SolverPath`], per axis.
        pub mpc_path: [u32; AXES],
        /// Joints at a limit in the IK, one bit per joint.
        pub ik_active: u32,
        /// Solver iterations.
        pub ik_iterations: u32,
        /// [`SolverPath`].
        pub ik_path: u32,
        /// KKT residual, normalised, per axis; negative: not computed.
        pub mpc_residual: [f64; AXES],
        /// KKT residual, normalised; negative: not computed.
        pub ik_residual: f64,
        /// Length of the orientation error \[rad\].
        pub orientation_error_rad: f64,
        /// Distance to the nearest singularity \[m\]; negative: not computed.
        pub singularity_m: f64,

        /// One-step error of the predictor at the newest closed grid step \[m\]; negative: none.
        pub predictor_error_m: f64,
        /// Radius about the plan's first reference in which the pen is expected in nine of ten cases \[m\];
        /// negative: unknown.
        pub predictor_band_m: f64,
        /// Version of the weights in use.
        pub learner_version: u64,
        /// Age of the weights in use \[ns\].
        pub learner_age_ns: u64,
        /// The active predictor.
        pub predictor: PredictorName,
        /// Steps of the roll-out.
        pub preview_steps: u32,

        /// Heap allocations in this tick.
        pub allocations: u32,
        /// 1: a port connected or disconnected in this tick.
        pub connections_changed: u32,
        /// Totals up to this tick.
        pub counters: Counters,
        /// The arm's lag, and the plan's dead time.
        pub arm_lag: ArmLag,

        /// Tool position of the command at the same stamp at Hold (trust 0) \[m\]; zero without a ghost.
        pub ghost_tool_m: [f64; AXES],
        /// The time of the next two distances, a tenth of a second back \[ns\]; 0: none in this tick.
        pub compared_ns: u64,
        /// Distance of the measured tool from the pen at that time, in the plane \[m\]; negative: none in
        /// this tick.
        pub error_m: f64,
        /// The same for the ghost's tool, behind an arm of the same lag \[m\]; negative: none in this tick.
        pub ghost_error_m: f64,
        /// [`GhostState`].
        pub ghost_state: u32,
        /// 1: the pen wrote at that time.
        pub compared_contact: u32,
        /// Evidence behind the newest latched stop.
        pub stop: StopDetail,
        /// Fraction of the commanded speed at which the arm moves; negative: unknown.
        pub arm_speed_share: f64,
        /// The line to the arm's controller.
        pub arm_line: ArmLine,
        /// Points of the next field that are known; 0: there was no preview, or no plan.
        pub path_points: u32,
        /// 0.
        pub reserved: u32,
        /// The previewed path that the plan was to follow, as far as it trusted it: x and y of each point in
        /// turn, from soon to late, the plan's last reference at the end \[m\].
        pub path_m: [f32; 2 * PATH_POINTS],
    }
}

const _: () = assert!(size_of::<TickRecord>() <= 2048);

impl TickRecord {
    /// Cost of a stage \[ns\].
    pub fn stage(&self, stage: Stage) -> u32 {
        self.stage_ns.get(stage as usize).copied().unwrap_or(0)
    }

    /// Points of the previewed path, from soon to late \[m\].
    pub fn path(&self) -> impl Iterator<Item = [f32; 2]> {
        let points = self.path_m.as_chunks::<2>().0;
        points.iter().copied().take(self.path_points as usize)
    }

    /// Sets the cost of a stage, saturated to 4.29 s.
    pub fn set_stage(&mut self, stage: Stage, ns: u64) {
        if let Some(cost) = self.stage_ns.get_mut(stage as usize) {
            *cost = u32::try_from(ns).unwrap_or(u32::MAX);
        }
    }
}

impl Validate for TickRecord {
    fn validate(&self) -> Result<(), Rejection> {
        known::<_, TrustReason>("trust_reason", self.trust_reason)?;
        known::<_, Rung>("rung", self.rung)?;
        known::<_, Mode>("mode", self.mode)?;
        known::<_, FaultReason>("fault", self.fault)?;
        known::<_, StopCause>("stop.cause", self.stop.cause)?;
        self.predictor.check("predictor")?;
        known::<_, SolverPath>("ik_path", self.ik_path)?;
        known::<_, GhostState>("ghost_state", self.ghost_state)?;
        for path in self.mpc_path {
            known::<_, SolverPath>("mpc_path", path)?;
        }
        flags("arm_line.flags", self.arm_line.flags, arm_flags::ALL)?;
        flags("health", self.health, health::ALL)?;
        flags("guard_mask", self.guard_mask, guard_mask::ALL)?;
        flags("pen_flags", self.pen_flags, pen_flags::ALL)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_of_a_fault_may_hold_nan() {
        let record = TickRecord { setpoint_m: [f64::NAN; AXES], ..Default::default() };
        assert_eq!(record.validate(), Ok(()));
    }

    #[test]
    fn an_unknown_solver_path_on_any_axis_is_refused() {
        for axis in 0..AXES {
            let mut record = TickRecord::default();
            record.mpc_path[axis] = 5;
            assert_eq!(record.validate().unwrap_err().field, "mpc_path");
        }
    }

    #[test]
    fn stage_costs_saturate() {
        let mut record = TickRecord::default();
        record.set_stage(Stage::Ik, 1 << 40);
        record.set_stage(Stage::Step, 3);
        assert_eq!(
            (record.stage(Stage::Ik), record.stage(Stage::Step), record.stage(Stage::Mpc)),
            (u32::MAX, 3, 0)
        );
    }

    #[test]
    fn the_path_has_as_many_points_as_it_says_and_no_more_than_there_are() {
        let path_m = std::array::from_fn(|i| i as f32);
        let of = |path_points| TickRecord { path_m, path_points, ..Default::default() };
        assert_eq!(of(2).path().collect::<Vec<_>>(), [[0.0, 1.0], [2.0, 3.0]]);
        assert_eq!([0, 1, u32::MAX].map(|points| of(points).path().count()), [0, 1, PATH_POINTS]);
    }

    #[test]
    fn every_number_of_a_vocabulary_is_checked_by_name() {
        type Spoil = fn(&mut TickRecord);
        let cases: [(&str, Spoil); 11] = [
            ("trust_reason", |record| record.trust_reason = 99),
            ("rung", |record| record.rung = 99),
            ("mode", |record| record.mode = 99),
            ("fault", |record| record.fault = 99),
            ("stop.cause", |record| record.stop.cause = 99),
            ("predictor", |record| record.predictor.bytes[0] = 0xff),
            ("ik_path", |record| record.ik_path = 99),
            ("ghost_state", |record| record.ghost_state = 99),
            ("arm_line.flags", |record| record.arm_line.flags = 1 << 31),
            ("guard_mask", |record| record.guard_mask = 1 << 31),
            ("pen_flags", |record| record.pen_flags = 1 << 31),
        ];
        for (field, spoil) in cases {
            let mut record = TickRecord::default();
            spoil(&mut record);
            assert_eq!(record.validate().unwrap_err().field, field);
        }
        assert_eq!(TickRecord { health: u32::MAX, ..Default::default() }.validate(), Ok(()));
    }
}
