//! Section about what the arm carries.

use crate::schema::{Legal::*, Presence::*, section};

section! {
    /// What the arm carries beyond the links of the URDF, pen and holder as a rule: for the torques that its
    /// joints need (`foretrace config torque`). Nothing else depends on it, and no command does.
    pub struct PayloadSection {
        /// Its mass. Not set: `robot.ur.payload_kg`, and without that nothing is carried. Where both are set
        /// this one counts for torques, and the bridge compares the other with the installation.
        mass_kg: Option<f64> = Between(0.0, 50.0), Optional, AtStart, "the weight of pen and holder";
        /// Its centre of mass in the frame of `robot.tip_link`. Not set: half of `robot.tool_m`, the middle
        /// of the pen.
        centre_m: Option<[f64; 3]> = Between(-1.0, 1.0), Optional, AtStart, "nothing: leave it out";
    }
}
