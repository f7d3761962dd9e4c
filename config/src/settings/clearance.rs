//! Section about what the arm must not touch.

use crate::schema::{Legal::*, Presence::*, section};

section! {
    /// What the arm keeps away from, in the robot's base frame: its shape is the URDF's collision geometry
    /// (spheres, cylinders, boxes; not meshes). It slides along or stops; it does not look for ways around.
    pub struct ClearanceSection {
        /// Distance kept by commands. It has to cover the arm's lag behind them, and how well shapes are
        /// known.
        margin_m: f64 = Between(0.002, 0.2), Default("0.01"), AtStart, "0.01; 0.03 where shapes are \
                                        uncertain";
        /// The arm keeps away from itself.
        itself: bool = Flag, Default("true"), AtStart, "true";
        /// Planes (table, walls), each [[point in m], [normal of length 1, away from what is forbidden]]. The
        /// first link, and a housing around the second joint, are not tested against a plane that the first
        /// link's own axis stands on.
        planes_m: Option<Vec<[[f64; 3]; 2]>> = Between(-10.0, 10.0), Optional, AtStart,
            "[[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]] for a table that the base stands on, once the tool has a \
             shape that fits";
        /// Boxes, each [[centre in m], [size in m along its own axes], [roll, pitch, yaw in rad]].
        boxes_m: Option<Vec<[[f64; 3]; 3]>> = Between(-10.0, 10.0), Optional, AtStart, "nothing: leave it \
                                        out";
    }
}
