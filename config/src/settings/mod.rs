//! The typed settings: one struct per section, every key declared once with its rule.
//!
//! Contract: values here have passed their own range test; `check` tests constraints between keys. A
//! declaration reads: name: type = legal range, needed or not, live or only at start, where to start from.

mod process;
mod hand;
mod plane;
mod foresight;
mod plan;
mod arm;
mod clearance;
mod payload;
mod contact;
mod ur;

pub use arm::{Arming, EnvelopeSection, Ik, RobotSection, SlowArmChoice, Timing, Tracking};
pub use clearance::ClearanceSection;
pub use contact::ContactSection;
pub use foresight::{
    ArRlsSection, DybmSection, EsnSection, ExternalSection, Learner, MixtureSection, Optimiser, Predictor,
    RefineSection, ScaleSection, TraceChoice, TrustMode, TrustSection,
};
pub use hand::Pen;
pub use payload::PayloadSection;
pub use plan::{AxisLimits, Gains, Limits, Mpc, Penalty, QpBackend};
pub use plane::PlaneSection;
pub use process::{Instance, Loop, Telemetry};
pub use ur::UrSection;

use crate::schema::section;

section! {
    /// Settings of one foretrace daemon.
    pub struct Settings {}
    sections {
        /// Which daemon this is.
        instance @ "instance": Instance;
        /// The tick.
        control_loop @ "loop": Loop;
        /// The pen's path and its limits.
        pen @ "pen": Pen;
        /// The writing plane.
        plane @ "plane": PlaneSection;
        /// The predictor.
        predictor @ "predictor": Predictor;
        /// Online learning.
        learner @ "learner": Learner;
        /// The weight on the prediction.
        trust @ "trust": TrustSection;
        /// The plan in the writing plane.
        mpc @ "mpc": Mpc;
        /// Joints from the plan.
        ik @ "ik": Ik;
        /// The arm.
        robot @ "robot": RobotSection;
        /// Obstacles.
        clearance @ "clearance": ClearanceSection;
        /// Delays.
        timing @ "timing": Timing;
        /// Conditions for arming and stops.
        safety @ "safety": Arming;
        /// Telemetry.
        telemetry @ "telemetry": Telemetry;
    }
}
