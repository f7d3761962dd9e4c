//! Section about what only arms of Universal Robots have: `foretrace arm ur` reads it, nothing else does.

use crate::schema::{Legal::*, Presence::*, section};

section! {
    /// The bridge to a Universal Robots controller (`foretrace arm ur`): how its servo follows, which
    /// registers are used, and what the installation on the pendant has to say.
    pub struct UrSection {
        /// Look-ahead of `servoj`: how far it projects its motion. Smaller follows sooner and is rougher.
        look_ahead_ms: f64 = Between(30.0, 200.0), Default("30.0"), AtStart, "30; 100 on a first run";
        /// Gain of `servoj`: how stiffly it pulls towards each target. Large gains with noisy targets make
        /// the arm vibrate.
        gain: f64 = Between(100.0, 2000.0), Default("1200.0"), AtStart, "1200; 300 on a first run";
        /// First of the 18 registers of a kind that may be used, of integers and of doubles, inputs and
        /// outputs. 24 and above belong to RTDE clients, those below to fieldbuses as well.
        register_base: u32 = Between(24.0, 30.0), Default("24"), AtStart,
            "24; another where `foretrace doctor --robot` finds them IN_USE";
        /// Cycles without a fresh target for which the program on the controller goes on in a straight line.
        /// Then it stops.
        extrapolate_cycles: u32 = Between(0.0, 5.0), Default("5"), AtStart, "5; less near people";
        /// Deceleration of the leading joint when that program stops by itself (`stopj`). Not set: the
        /// smallest of
        /// `robot.stale_deceleration_radps2`.
        stop_radps2: Option<f64> = Between(0.5, 40.0), Optional, AtStart, "nothing: leave it out";
        /// Targets per second below which the controller itself ends the program, the second belt
        /// (`rtde_set_watchdog`).
        watchdog_hz: f64 = Between(1.0, 50.0), Default("10.0"), AtStart, "10";
        /// Mass of the tool as the installation on the pendant has to have it; the bridge refuses another by
        /// more than 0.1 kg. Not set: the bridge refuses every arm that is not on this machine.
        payload_kg: Option<f64> = Between(0.0, 10.0), Optional, AtStart, "the weight of pen and holder";
        /// Tool centre point as the installation has to have it, seen from the flange; the bridge refuses
        /// another by more than a millimetre. Not set: `robot.tool_m`.
        tcp_m: Option<[f64; 3]> = Between(-0.5, 0.5), Optional, AtStart, "nothing: leave it out";
        /// `[plane]` and `[clearance]` are written in a base frame that is turned by 180 degrees about z
        /// against the controller's, whose coordinates the pendant shows: true for ROS's descriptions with
        /// their `base_link`. The bridge refuses a model that is turned otherwise than is said here.
        base_turned: bool = Flag, Default("false"), AtStart, "false; what the bridge says";
        /// Nearest to the paper that the pen comes while the model of the arm is not its factory calibration
        /// (`foretrace calibrate kinematics`) and may be off by more than half a millimetre. By as much as it
        /// is off the pen stays higher.
        uncalibrated_height_m: f64 = Between(0.001, 0.2), Default("0.03"), AtStart, "0.03";
    }
}
