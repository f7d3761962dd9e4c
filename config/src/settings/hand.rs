//! Section about the pen.

use crate::schema::{Legal::*, Presence::*, section};

section! {
    /// The pen: how its samples become a path on a uniform grid, and which samples are refused.
    pub struct Pen {
        /// Step of the grid on which prediction and plan live; a multiple of the loop's period.
        step_ms: u32 = Between(4.0, 20.0), Required, AtStart,
            "10; 8 or 16 at 125 Hz, 8 or 12 at 250 Hz, because the step is a multiple of the period";
        /// Longest pause between samples that is bridged by a straight line, from 2 to 32 steps; a longer one
        /// starts a new path.
        max_gap_ms: f64 = Between(8.0, 640.0), Required, AtStart, "100: ten reports of a 100 Hz tablet";
        /// Age of the newest sample beyond which the input is stale: trust falls to 0. Samples that are older
        /// when they arrive begin no motion; twice as old they end it.
        stale_ms: f64 = Between(10.0, 2000.0), Required, AtStart, "100";
        /// Largest plausible speed, in pen metres; a faster step counts as a jump between strokes (or a
        /// fault), not as motion.
        max_speed_mps: f64 = Between(0.05, 20.0), Required, AtStart, "3: quick handwriting stays below 1";
        /// Least time between samples that this gate assumes, because stamps jitter.
        min_interval_us: u32 = Between(1.0, 4000.0), Default("2000"), AtStart, "2000";
        /// Area of the device, [[x_min, x_max], [y_min, y_max]] in pen metres; samples outside are refused.
        bounds_m: [[f64; 2]; 2] = Between(-5.0, 5.0), Required, AtStart,
            "[[-0.5, 0.5], [-0.5, 0.5]], or the active area of the tablet";
        /// Largest time by which a stamp may lie in the future; beyond it the sample is refused.
        future_tolerance_ms: f64 = Between(0.0, 1000.0), Default("20.0"), AtStart, "20";
    }
}
