//! Sections about the plan: MPC, its gains and its limits.

use crate::schema::{Legal::*, Presence::*, section, words};

words! {
    /// Solver of the quadratic programmes.
    pub enum QpBackend {
        /// The built-in exact solver: microseconds, no allocation.
        Exact = "exact",
        /// Clarabel with its default settings: hundreds of microseconds, allocates.
        Clarabel = "clarabel",
        /// Clarabel with the fastest settings that are still accurate here.
        ClarabelTuned = "clarabel-tuned",
    }
}

section! {
    /// The plan in the writing plane: minimise tracking error and jerk over the horizon, inside the limits.
    /// Gains and effort are plain numbers for errors in mm, mm per step, mm per step^2 and mm per step^3.
    pub struct Mpc {
        /// Steps of the plan; the horizon lasts horizon * mpc.step_ms.
        horizon: u32 = OneOf(&[10.0, 20.0, 30.0]), Required, AtStart, "20: with steps of 2.5 ms time enough \
                                        to brake from 0.8 m/s";
        /// Step of the plan; not longer than pen.step_ms, not shorter than the loop's period. Shorter answers
        /// new samples sooner. Not set: a quarter of pen.step_ms, or the period where that is longer.
        step_ms: Option<f64> = Between(1.0, 20.0), Optional, AtStart, "nothing: leave it out";
        /// Extra lead of the references beyond the dead time, for the plan's own response to a new sample.
        /// More follows sooner and overshoots more.
        response_ms: f64 = Between(0.0, 50.0), Default("0.0"), AtStart, "0; about 8 with an arm fast enough \
                                        for sharp gains";
        /// Time by which references lead the predicted pen along its predicted velocity. It removes the lag
        /// that late predictions and limits cause; values above the preset increase the error.
        velocity_lead_ms: f64 = Between(0.0, 100.0), Default("7.0"), AtStart, "7; 0 for an arm that no \
                                        limits hold up, or a known future";
        /// "exact": built-in, for real work; "clarabel", "clarabel-tuned": for comparison.
        backend: QpBackend = Words(QpBackend::WORDS), Default("\"exact\""), AtStart, "\"exact\"";
        /// Weight beta on the jerk: less follows sharper corners, more rounds them.
        effort: f64 = Between(1e-6, 1000.0), Required, AtStart, "10";
        /// Iterations of the exact solver per axis before the previous plan is used, and the next one is
        /// asked for less. Where the tool cannot stay in the workspace, a tick may take half as many again.
        max_iterations: u32 = Between(1.0, 10000.0), Default("100"), AtStart,
            "100: enough for the presets, whatever the pen does";
    }
    sections {
        /// Gains on the error against the last position.
        feedback @ "feedback": Gains;
        /// Gains on the error against the prediction.
        feedforward @ "feedforward": Gains;
        /// Prices of violating the soft limits.
        penalty @ "penalty": Penalty;
        /// Limits per axis.
        limits @ "limits": Limits;
    }
}

section! {
    /// Weights of the tracking error: feedback against the last position (trust 0), feedforward against the
    /// prediction (trust 1).
    pub struct Gains {
        /// Weight of the position error.
        position: f64 = Between(1e-6, 1000.0), Required, AtStart, "1.0; feedforward up to 3 for an arm much \
                                        faster than the hand";
        /// Weight of the velocity error.
        velocity: f64 = Between(0.0, 1000.0), Required, AtStart, "7.0 for feedback, 2.5 for feedforward";
        /// Weight of the acceleration error.
        acceleration: f64 = Between(0.0, 1000.0), Required, AtStart, "0: acceleration is left to mpc.effort";
        /// Factor on all three from one step to the next: below 1, later steps count less.
        decay: f64 = Between(0.1, 1.0), Required, AtStart, "1.0";
    }
}

section! {
    /// Cost of one unit of violation of a soft limit, per step, in the units of the gains. If limits exclude
    /// each other, the one with the highest price is kept.
    pub struct Penalty {
        /// Price of acceleration above its limit.
        acceleration: f64 = Between(1.0, 1e9), Default("1e6"), AtStart, "1e6";
        /// Price of velocity above its limit.
        velocity: f64 = Between(1.0, 1e9), Default("1e6"), AtStart, "1e6";
        /// Price of a position outside the workspace.
        position: f64 = Between(1.0, 1e9), Default("1e6"), AtStart, "1e6";
    }
}

section! {
    /// Limits of the tool per axis of the writing plane.
    pub struct Limits {}
    sections {
        /// Along the plane's x.
        x @ "x": AxisLimits;
        /// Along the plane's y.
        y @ "y": AxisLimits;
        /// Along the plane's normal.
        z @ "z": AxisLimits;
    }
}

section! {
    /// Limits of the tool along one axis of the writing plane. The workspace is `plane.workspace_m`.
    pub struct AxisLimits {
        /// Largest speed (kept unless the state makes that impossible).
        velocity_mps: f64 = Between(0.001, 5.0), Required, AtStart, "0.8: letters of 3 cm at natural speed; \
                                        0.25 near people";
        /// Largest acceleration (kept unless the state makes that impossible).
        acceleration_mps2: f64 = Between(0.01, 100.0), Required, AtStart, "36.0 for a UR5 near its home with \
                                        a pen, 24.0 without one; 5.0 near people";
        /// Largest jerk (always kept).
        jerk_mps3: f64 = Between(1.0, 100_000.0), Required, AtStart,
            "16000: the acceleration reverses in 3 ms; 400 near people";
    }
}
