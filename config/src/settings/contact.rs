//! Section about what an arm that reports efforts may feel.

use crate::schema::{Legal::*, Presence::*, section};

section! {
    /// When an arm that reports its joints' currents or torques counts as touching something: torque beyond
    /// what its motion needs in free space, which is learned while the tool is lifted. It latches a stop,
    /// "contact". Off where no effort comes, or the URDF has no masses. Never a safety function.
    pub struct ContactSection {
        /// Whether efforts are judged.
        stop: bool = Flag, Default("true"), AtStart, "true; false where an arm's currents say nothing of its \
                                        torques";
        /// Torque beyond the expectation that a joint may show for ever, as a share of its effort limit in
        /// the URDF.
        torque_share: f64 = Between(0.02, 1.0), Default("0.07"), AtStart, "0.07";
        /// How long twice that torque may last; three times it, half as long.
        hold_ms: f64 = Between(0.0, 5000.0), Default("400.0"), AtStart, "400";
        /// Motion with the tool lifted, after each arming, before anything is judged.
        learn_s: f64 = Between(0.5, 60.0), Default("1.0"), AtStart, "1";
    }
}
