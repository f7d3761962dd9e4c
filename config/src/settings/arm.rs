//! Sections about the arm: inverse kinematics, robot, timing, safety.

use super::{ContactSection, PayloadSection, QpBackend, UrSection};
use crate::schema::{Legal::*, Presence::*, section, words};

section! {
    /// Joints from the plan: a quadratic programme over joint velocities.
    pub struct Ik {
        /// Share of the tool's pose error that is removed per second; at most the rate of the loop. Not set:
        /// half the rate of the loop.
        gain_hz: Option<f64> = Between(0.1, 1000.0), Optional, AtStart, "nothing: leave it out";
        /// Solver of the joint velocities: "exact" (bounded time, no allocation), "clarabel" or
        /// "clarabel-tuned" (for comparison; they allocate).
        backend: QpBackend = Words(QpBackend::WORDS), Default("\"exact\""), AtStart, "\"exact\"";
        /// A turn of the tool counts like a displacement at this distance from its tip.
        orientation_length_m: f64 = Between(0.001, 1.0), Default("0.1"), AtStart, "0.1";
        /// Weight of position errors along the plane's normal, relative to those in the plane: where joints
        /// cannot do both, the tool leaves the line rather than the paper.
        normal_weight: f64 = Between(1.0, 100.0), Default("10.0"), AtStart, "10; 1 treats all directions \
                                        alike";
        /// Weight of turns of the tool relative to those displacements: where joints cannot do both, the tool
        /// tilts a little and its tip stays on the line. Of an upright tool: the weight grows to 1 at 0.15
        /// rad.
        tilt_weight: f64 = Between(0.01, 1.0), Default("0.2"), AtStart, "0.2; 1 keeps the pen upright at any \
                                        price";
        /// Weight of the turn about the pen's own axis, relative to the tilt; 0 leaves it free.
        spin_weight: f64 = Between(0.0, 1.0), Default("0.1"), AtStart, "0.1";
        /// Damping far from singularities.
        damping_floor_m2: f64 = Between(1e-12, 0.01), Default("1e-9"), AtStart, "1e-9";
        /// Damping at a singularity.
        damping_peak_m2: f64 = Between(1e-9, 1.0), Default("1e-3"), AtStart, "1e-3";
        /// Distance to singularities (a lever arm) below which damping grows.
        singular_m: f64 = Between(1e-4, 1.0), Default("0.02"), AtStart, "0.02";
        /// Fastest correction of a position error.
        correction_mps: f64 = Between(0.001, 5.0), Default("0.25"), AtStart, "0.25";
        /// Corrections are slowed so that they can end with this deceleration.
        correction_mps2: f64 = Between(0.01, 100.0), Default("2.0"), AtStart, "2.0";
        /// Pull toward `robot.home_rad`, for arms with more joints than the task needs; 0 for none. A weight
        /// near the square of a lever arm competes with the path.
        posture_weight_m2: f64 = Between(0.0, 0.01), Default("0.0"), AtStart, "0; 1e-7 with seven joints";
        /// Rate of that pull.
        posture_hz: f64 = Between(0.01, 100.0), Default("1.0"), AtStart, "1";
    }
}

section! {
    /// The arm: a serial chain from a URDF, and limits that may be narrower than those in the URDF. Lists
    /// have one number per joint, from base to tool.
    pub struct RobotSection {
        /// Name of an embedded robot ("ur5", "ur5e"), or path of a URDF file relative to this settings file.
        urdf: String = Text, Required, AtStart, "\"ur5\"";
        /// Link that is the base frame. Not set: the only root of the URDF.
        base_link: Option<String> = Text, Optional, AtStart, "\"base_link\" for a UR";
        /// Link that carries the tool; its z axis is the pen. Not set: the only leaf of the URDF.
        tip_link: Option<String> = Text, Optional, AtStart, "\"tool0\" for a UR";
        /// Position of the pen's tip in the frame of `tip_link`. It must be accurate: the tool may tilt
        /// (`ik.tilt_weight`), and it tilts about this point.
        tool_m: [f64; 3] = Between(-0.5, 0.5), Default("[0.0, 0.0, 0.0]"), AtStart,
            "[0.0, 0.0, length] for a pen of that length below the flange";
        /// Posture from which the plane is reached without passing a singularity. Outside the joint limits by
        /// 1e-3 rad or less, as rounded digits are, it is taken as the limit; by more it is refused.
        home_rad: Vec<f64> = Between(-6.3, 6.3), Required, AtStart,
            "the posture with the tool above the middle of the paper";
        /// Largest speed per joint; the smaller of this and the URDF's holds.
        velocity_radps: Vec<f64> = Between(0.01, 10.0), Required, AtStart, "3.1 for a UR; 1.0 on a first run";
        /// Largest acceleration per joint.
        acceleration_radps2: Vec<f64> = Between(0.1, 500.0), Required, AtStart,
            "40 for a UR, all its controller gives; 5 on a first run";
        /// Largest jerk per joint. Not set: the tool's jerk limit is the only one.
        jerk_radps3: Option<Vec<f64>> = Between(1.0, 1e6), Optional, AtStart, "nothing: leave it out";
        /// Deceleration per joint with which the hardware interface brakes by itself when no commands come.
        /// Not set: the largest acceleration.
        stale_deceleration_radps2: Option<Vec<f64>> = Between(0.1, 500.0), Optional, AtStart,
            "nothing: leave it out";
        /// Lowest position per joint, where narrower than the URDF's.
        position_min_rad: Option<Vec<f64>> = Between(-6.3, 6.3), Optional, AtStart, "nothing: leave it out";
        /// Highest position per joint, where narrower than the URDF's.
        position_max_rad: Option<Vec<f64>> = Between(-6.3, 6.3), Optional, AtStart, "nothing: leave it out";
        /// Cycles per second of the robot's controller: 125 for a UR with CB3, 500 for an e-Series.
        controller_rate_hz: u32 = Between(50.0, 8000.0), Required, AtStart, "125 for a UR5, 500 for a UR5e";
    }
    sections {
        /// What it carries.
        payload @ "payload": PayloadSection;
        /// What only arms of Universal Robots have.
        ur @ "ur": UrSection;
    }
}

section! {
    /// Delays of the world around the loop.
    pub struct Timing {
        /// Whole time from a command to the motion of the arm, `servo_filter_ms` included; the prediction
        /// looks this far ahead in addition. With `follow_lag` this is the initial value, and the learner
        /// compares predictions this far ahead.
        dead_time_ms: f64 = Between(0.0, 200.0), Required, AtStart,
            "what `foretrace calibrate lag` says; servoj with look-ahead 0.03 s: 35 at 500 Hz, 42 at 125 Hz \
             (one controller cycle more, and waiting for it)";
        /// Part of the dead time that is due to the arm's servo, a critically damped filter with this group
        /// delay: the plan then accounts for the filter, inside all limits. 0: all of the dead time is taken
        /// as pure delay.
        servo_filter_ms: f64 = Between(0.0, 150.0), Default("0.0"), AtStart,
            "0 for letters near the arm's limits; for slower motion what `foretrace calibrate lag` says";
        /// Measure the arm's lag online, from commands and joint states, and let the dead time follow it.
        /// `false`: the dead time stays as configured; the lag is still measured and shown.
        follow_lag: bool = Flag, Default("true"), AtStart, "true";
        /// Largest rate at which the dead time follows, in seconds per second.
        follow_rate: f64 = Between(0.001, 0.1), Default("0.02"), AtStart, "0.02: 20 ms per second";
        /// Largest dead time that following may reach. Not set: what the number of predicted steps allows, at
        /// most 200 ms.
        dead_time_max_ms: Option<f64> = Between(0.0, 200.0), Optional, AtStart, "nothing: leave it out";
    }
}

section! {
    /// When the daemon may start to move the arm, and when it stops.
    pub struct Arming {
        /// Age of the joint state beyond which the arm counts as lost.
        joint_state_timeout_ms: f64 = Between(2.0, 1000.0), Required, AtStart, "50";
        /// A dead-man signal is needed to move.
        enable_required: bool = Flag, Required, AtStart, "true with people near the arm; false in simulation";
        /// Age of the dead-man signal beyond which the arm stops (it is sent 50 times per second).
        enable_timeout_ms: f64 = Between(20.0, 2000.0), Default("100.0"), AtStart, "100";
        /// Longest single stall of the loop; a longer one latches a stop, and the arm has to be armed again.
        latch_after_ms: f64 = Between(10.0, 5000.0), Required, AtStart, "200";
        /// Share of the recent periods that the loop's own work may overrun (their tick took longer than a
        /// period, or never ran because of one that did). Above half of it the loop solves in every second
        /// tick only, above all of it the stop is latched.
        late_ticks_max: f64 = Between(0.01, 1.0), Default("0.5"), AtStart, "0.5; 0.05 on a machine of its \
                                        own";
        /// Window of that share.
        late_ticks_window_ms: f64 = Between(50.0, 2000.0), Default("1000.0"), AtStart, "1000";
        /// Largest joint speed when arming: the arm must be at rest.
        arm_max_speed_radps: f64 = Between(0.0001, 1.0), Default("0.02"), AtStart, "0.02";
        /// Largest distance of the tool outside the workspace when arming.
        arm_workspace_margin_m: f64 = Between(0.0, 0.5), Default("0.02"), AtStart, "0.02";
        /// Largest angle between the tool's axis and the plane's normal when arming.
        arm_max_tilt_rad: f64 = Between(0.01, 1.5), Default("0.3"), AtStart, "0.3";
        /// After arming the tool stays lifted until it is this close to the pen. Five times as far away, and
        /// 50 mm at least, it lifts again.
        approach_distance_m: f64 = Between(0.0005, 0.5), Default("0.01"), AtStart, "0.01";
        /// Time without a new pen sample after which the arm counts as holding, at rest where the pen was
        /// last seen; however old samples are when they arrive.
        hold_after_ms: f64 = Between(10.0, 10000.0), Default("200.0"), AtStart, "200";
        /// Longest use of an earlier plan, when there is no fresh one, before the joints stop.
        previous_plan_max_ms: f64 = Between(2.0, 200.0), Default("50.0"), AtStart, "50: the length of a plan";
    }
    sections {
        /// Bounds of the tracking monitor.
        tracking @ "tracking": Tracking;
        /// When efforts mean that the arm touches something.
        contact @ "contact": ContactSection;
        /// How far the tool may go.
        envelope @ "envelope": EnvelopeSection;
    }
}

words! {
    /// What happens with an arm that is slower than commanded.
    pub enum SlowArmChoice {
        /// It slows with the arm.
        SlowDown = "slow-down",
        /// A stop is latched.
        Stop = "stop",
    }
}

section! {
    /// How far the arm may be from its commands. Measured joints are compared with all commands that may have
    /// caused them, back to `timing.dead_time_max_ms` and the spread of a servo filter: the smaller that is,
    /// the sooner an arm that stands still is noticed. A violation latches a stop, "tracking-error", with
    /// joint, amount and limit.
    pub struct Tracking {
        /// Largest distance of a measured joint from all of those commands. A joint at half of it that moves
        /// away stops the arm as well.
        joint_rad: f64 = Between(0.002, 0.5), Default("0.02"), AtStart, "0.02";
        /// The same for the tool, along the axes of the plane: several small joint errors add up. Three
        /// quarters of it stop the arm where one or two joints take the tool so far from where it would be if
        /// they answered as the others do. Three times as much until the arm has moved for two seconds.
        tool_m: f64 = Between(0.001, 0.2), Default("0.005"), AtStart, "0.005";
        /// Commanded motion of a joint within a quarter of a second that must show in the measurement: a
        /// joint that then stands still stops the arm.
        still_rad: f64 = Between(0.002, 0.5), Default("0.006"), AtStart, "0.006";
        /// Largest speed at which a joint may move away from its commands.
        runaway_radps: f64 = Between(0.02, 3.0), Default("0.1"), AtStart, "0.1";
        /// A violation that lasts this long, and at least two joint states, stops the arm; a shorter one is
        /// ignored.
        hold_ms: f64 = Between(0.0, 200.0), Default("10.0"), AtStart, "10";
        /// With an arm that moves at less than three quarters of the commanded speed (a speed slider):
        /// "slow-down", the tool slows with it; "stop", a stop is latched.
        slow_arm: SlowArmChoice = Words(SlowArmChoice::WORDS), Default("\"slow-down\""), AtStart,
            "\"slow-down\"";
    }
}

section! {
    /// Bounds of the tool while the pen leads, whatever the plan is: checked on the commanded joints in every
    /// tick. Near a bound the tool gets no faster than the joints can stop it; beyond it a stop is latched.
    /// An arm that was armed outside (`safety.arm_workspace_margin_m`, `safety.arm_max_tilt_rad`) may only
    /// come in.
    pub struct EnvelopeSection {
        /// Beyond `plane.workspace_m` (also into the paper) by more than this, a stop is latched; commands
        /// keep half of it.
        margin_m: f64 = Between(0.0002, 0.05), Default("0.001"), AtStart, "0.001; more only where joints are \
                                        much slower than the plan";
        /// Largest angle between the tool's axis and the plane's normal.
        max_tilt_rad: f64 = Between(0.02, 1.5), Default("0.35"), AtStart, "0.35: letters tilt the preset's \
                                        pen by 0.1, leaps by 0.25";
        /// Largest speed of the tool. Not set: norm of the plan's velocity limits plus `ik.correction_mps`.
        max_speed_mps: Option<f64> = Between(0.005, 20.0), Optional, AtStart, "nothing: leave it out; 0.25 \
                                        near people";
    }
}
