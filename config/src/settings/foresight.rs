//! Sections about looking ahead: predictor, learner, trust.

use crate::schema::{Legal::*, Presence::*, section, words};

words! {
    /// Which predictor runs.
    pub enum PredictorChoice {
        /// Last position, zero velocity: the paper's conservative model.
        Hold = "hold",
        /// The last velocity goes on: the paper's baseline.
        ConstantVelocity = "constant-velocity",
        /// Dynamic Boltzmann machine, linear, learning online.
        Dybm = "dybm",
    }
}

words! {
    /// How a DyBM turns gradients into steps.
    pub enum Optimiser {
        /// Rates fall with the sum of squared gradients.
        Adagrad = "adagrad",
        /// Rates follow a running mean of squared gradients.
        Rmsprop = "rmsprop",
        /// Running means of gradients and of their squares.
        Adam = "adam",
    }
}

words! {
    /// Who sets the trust.
    pub enum TrustMode {
        /// From the evidence of past predictions.
        Auto = "auto",
        /// The value in the file.
        Manual = "manual",
    }
}

section! {
    /// The predictor of the hand.
    pub struct Predictor {
        /// "hold": the last position; "constant-velocity": the last velocity goes on; "dybm": learns online.
        kind: PredictorChoice = Words(PredictorChoice::WORDS), Required, Live, "\"dybm\"";
    }
    sections {
        /// The DyBM.
        dybm @ "dybm": DybmSection;
    }
}

section! {
    /// The dynamic Boltzmann machine (used when predictor.kind = "dybm").
    pub struct DybmSection {
        /// Delay d: the last d - 1 steps have weights of their own.
        delay: u32 = Between(2.0, 16.0), Required, AtStart, "9";
        /// Decay per step of each eligibility trace, one trace per entry.
        decays: Vec<f64> = Between(0.0, 0.999), Required, AtStart, "[0.2, 0.5, 0.8]";
        /// Learning rate, for inputs scaled to about 10 (the loop does that).
        rate: f64 = Between(0.0, 1.0), Required, AtStart, "0.1 for adagrad, 0.001 for rmsprop and adam";
        /// "adagrad", "rmsprop" or "adam".
        optimiser: Optimiser = Words(Optimiser::WORDS), Required, AtStart, "\"adagrad\"";
        /// Strength of the pull of weights to exactly 0.
        l1: f64 = Between(0.0, 1.0), Default("0.0"), AtStart, "0";
        /// Strength of the shrinking of weights.
        l2: f64 = Between(0.0, 1.0), Default("0.0"), AtStart, "0";
    }
}

section! {
    /// Online learning, in its own thread on copies of the weights.
    pub struct Learner {
        /// Learn while running. Off: the weights stay as they started.
        enabled: bool = Flag, Default("true"), Live, "true";
        /// Steps of recent data on which a candidate has to be no worse than the live weights.
        promote_window_steps: u32 = Between(20.0, 10000.0), Default("200"), Live, "200: two seconds at 10 ms";
        /// Steps between two candidates.
        promote_every_steps: u32 = Between(1.0, 10000.0), Default("50"), Live, "50";
        /// A promoted candidate is rolled back when its error exceeds that of its predecessor by this factor.
        rollback_factor: f64 = Between(1.0, 100.0), Default("1.5"), Live, "1.5";
    }
}

section! {
    /// The weight on the prediction: 1 = prediction only, 0 = the last position only.
    pub struct TrustSection {
        /// "auto": from the evidence of past predictions; "manual": `value`.
        mode: TrustMode = Words(TrustMode::WORDS), Required, Live, "\"auto\"";
        /// The trust in manual mode, and the ceiling in automatic mode.
        value: f64 = Between(0.0, 1.0), Default("1.0"), Live, "1.0";
        /// Steps that the trust takes from 0 to 1, at least.
        ramp_steps: u32 = Between(1.0, 1000.0), Required, Live, "10, as in the paper";
        /// Steps of history that are needed before there is any trust.
        warmup_steps: u32 = Between(0.0, 1000.0), Required, Live, "20";
    }
}
