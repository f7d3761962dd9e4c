//! Section about the writing plane.

use crate::schema::{Legal::*, Presence::*, section};

section! {
    /// The writing plane, calibrated in the robot's base frame. Its x axis and its normal are given; y =
    /// normal × x. The tool points along -normal.
    pub struct PlaneSection {
        /// The plane's origin in the base frame.
        origin_m: [f64; 3] = Between(-3.0, 3.0), Required, AtStart,
            "the tool position at the middle of the paper";
        /// Direction of the pen's x in the base frame, a vector of length 1.
        x_axis: [f64; 3] = Between(-1.0, 1.0), Required, AtStart,
            "a measured direction along the lower edge of the paper";
        /// Direction away from the paper in the base frame, a vector of length 1 at right angles to x_axis.
        normal: [f64; 3] = Between(-1.0, 1.0), Required, AtStart, "[0.0, 0.0, 1.0] for a table";
        /// Point of the pen device that maps to the plane's origin.
        pen_origin_m: [f64; 2] = Between(-5.0, 5.0), Default("[0.0, 0.0]"), AtStart, "[0.0, 0.0]";
        /// Plane metres per pen metre.
        scale: f64 = Between(0.01, 100.0), Required, AtStart, "1.0: the arm writes as large as the hand";
        /// Height of the lifted tool above the plane while the pen is up.
        lift_height_m: f64 = Between(0.001, 0.2), Required, AtStart, "0.01: more takes from the joints what \
                                        writing needs";
        /// How far below the paper (z = 0) the tool is commanded while the pen touches: the preload of a pen
        /// with a spring. plane.workspace_m must reach as deep.
        press_m: f64 = Between(0.0, 0.005), Default("0.0"), AtStart, "0.0 for a rigid pen, which it would push \
                                        into the paper; 0.0005 to 0.001 for one with a spring of 1 to 2 N/mm";
        /// Where the tool may be, [[x_min, x_max], [y_min, y_max], [z_min, z_max]] in the plane's frame.
        /// Every corner must be within reach of the arm; contact (z = 0, less press_m) and the lift height
        /// lie inside. A plan may press the tip no deeper than z_min into the paper.
        workspace_m: [[f64; 2]; 3] = Between(-3.0, 3.0), Required, AtStart,
            "[[-0.1, 0.1], [-0.1, 0.1], [-0.0005, 0.05]]";
    }
}
