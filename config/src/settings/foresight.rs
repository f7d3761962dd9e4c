//! Sections about looking ahead: predictor, learner, trust.

use foretrace_control::predict::PredictorKind;

use crate::predictor::BuiltIn;
use crate::schema::{Legal::*, Presence::*, section, words};

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
    /// What enters a DyBM's eligibility traces.
    pub enum TraceChoice {
        /// The newest displacement.
        Newest = "newest",
        /// The displacement that has passed through the delay.
        Delayed = "delayed",
    }
}

words! {
    /// How the trust is set.
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
        /// The predictor.
        kind: PredictorKind = Words(&PredictorKind::LIVE_NAMES), Required, Live, "\"mixture\"";
        /// The network of "lstm": a shipped one by name, or a .safetensors file relative to the settings
        /// file; made for this pen.step_ms. Not set: the shipped one for this step; where there is none, or
        /// with "none", there is no predictor "lstm".
        lstm: Option<String> = Text, Optional, AtStart, "nothing: leave it out";
        /// Largest predicted step, as a multiple of the recent peak: a hand does not suddenly get faster.
        limit_factor: f64 = Between(1.0, 10.0), Default("1.25"), AtStart, "1.25";
        /// Factor per step by which the recent peak fades; 0.98 is half in a third of a second at 10 ms.
        peak_fade: f64 = Between(0.5, 0.999), Default("0.98"), AtStart, "0.98";
    }
    sections {
        /// The normaliser.
        scale @ "scale": ScaleSection;
        /// The DyBM.
        dybm @ "dybm": DybmSection;
        /// The reservoir beside it.
        esn @ "esn": EsnSection;
        /// Least squares.
        ar_rls @ "ar_rls": ArRlsSection;
        /// The mixture.
        mixture @ "mixture": MixtureSection;
        /// Refinement by newer samples.
        refine @ "refine": RefineSection;
        /// The predictor of another process.
        external @ "external": ExternalSection;
    }
}

section! {
    /// A predictor in another process (predictor.kind = "external"): it gets every step of the pen and
    /// answers with previews. While it gives none in time, or worse ones, the fallback serves.
    pub struct ExternalSection {
        /// The built-in predictor that stands in for it, and that it has to beat.
        fallback: BuiltIn = Words(&PredictorKind::BUILT_IN_NAMES), Default("\"mixture\""), AtStart,
            "\"mixture\"";
        /// Steps that may close before its preview of a step comes; later ones are refused.
        most_late_steps: u32 = Between(0.0, 8.0), Default("2"), AtStart, "2";
    }
}

section! {
    /// The running scale between metres and the numbers that predictors see; it follows the speed of the
    /// hand.
    pub struct ScaleSection {
        /// Metres per unit before any motion; 1e-4 fits 0.14 m/s at a step of 10 ms, letters of 3 cm.
        initial_m: f64 = Between(1e-9, 1.0), Default("1e-4"), AtStart, "1e-4";
        /// Smallest scale.
        min_m: f64 = Between(1e-9, 1.0), Default("1e-7"), AtStart, "1e-7";
        /// Largest scale.
        max_m: f64 = Between(1e-9, 1.0), Default("1e-2"), AtStart, "1e-2";
        /// Moving steps over which the scale forgets.
        memory_steps: f64 = Between(10.0, 1e6), Default("500.0"), AtStart, "500";
        /// Displacements below this count as rest.
        still_m: f64 = Between(0.0, 0.01), Default("5e-6"), AtStart, "5e-6";
        /// Largest relative change of the scale per step.
        max_change: f64 = Between(0.001, 1.0), Default("0.05"), AtStart, "0.05";
    }
}

section! {
    /// The dynamic Boltzmann machine (predictor.kind = "dybm", and beside the reservoir "dybm-esn").
    pub struct DybmSection {
        /// Delay d: the last d - 1 steps have weights of their own.
        delay: u32 = Between(2.0, 16.0), Required, AtStart, "9";
        /// Decay per step of each eligibility trace, one trace per entry.
        decays: Vec<f64> = Between(0.0, 0.999), Required, AtStart, "[0.5]";
        /// What enters the traces: "newest", the newest displacement, or "delayed", the one that has passed
        /// the delay.
        trace_input: TraceChoice = Words(TraceChoice::WORDS), Default("\"delayed\""), AtStart, "\"delayed\"";
        /// Learning rate, for inputs scaled to about 10 (the loop does that).
        rate: f64 = Between(0.0, 10.0), Required, AtStart, "0.01 for adagrad, 0.001 for rmsprop and adam";
        /// "adagrad", "rmsprop" or "adam".
        optimiser: Optimiser = Words(Optimiser::WORDS), Required, AtStart, "\"adagrad\"";
        /// L1 regularisation: pulls weights to exactly 0.
        l1: f64 = Between(0.0, 1.0), Default("0.0"), AtStart, "0";
        /// L2 regularisation: shrinks weights.
        l2: f64 = Between(0.0, 1.0), Default("0.0"), AtStart, "0";
    }
}

section! {
    /// The echo state network beside the DyBM (predictor.kind = "dybm-esn"): 50 units, fixed and random, with
    /// a read-out that learns by AdaGrad.
    pub struct EsnSection {
        /// Seed of the random weights; the same seed gives the same network.
        seed: u32 = Between(0.0, 4294967295.0), Default("0"), AtStart, "0";
        /// Share of the new state per step.
        leak: f64 = Between(0.0, 1.0), Default("0.7"), AtStart, "0.7, as in the paper";
        /// Largest magnitude of the network's eigenvalues: how long it remembers.
        spectral_radius: f64 = Between(0.0, 0.999), Default("0.95"), AtStart, "0.95";
        /// Learning rate of the read-out.
        rate: f64 = Between(0.0, 10.0), Default("0.01"), AtStart, "0.01";
    }
}

section! {
    /// Autoregression over the last 8 steps by recursive least squares (predictor.kind = "ar-rls"). Lengths
    /// are normalised: a typical step is 10 per axis, 14 in the plane.
    pub struct ArRlsSection {
        /// Factor per step by which the past loses weight: 0.999 remembers a thousand steps.
        forgetting: f64 = Between(0.9, 1.0), Default("0.999"), AtStart, "0.999";
        /// A step that is longer in the plane is a jump: it empties the memory and is not learned from.
        gate: f64 = Between(1.0, 1e6), Default("100.0"), AtStart, "100";
        /// Largest error per axis that is learned from in full.
        huber: f64 = Between(0.001, 1e4), Default("12.0"), AtStart, "12";
    }
}

section! {
    /// The mixture (predictor.kind = "mixture"): constant velocity, least squares, a reservoir's read-out,
    /// trained networks, and each of them corrected online, reweighted at every step and for every lead.
    pub struct MixtureSection {
        /// The network: a shipped one by name, or a .safetensors file relative to the settings file, with 24
        /// direct leads, made for this pen.step_ms. Not set: the shipped one for this step; where there is
        /// none, or with "none", the mixture does without.
        network: Option<String> = Text, Optional, AtStart, "nothing: leave it out";
        /// The network that also sees contact, direction and time: a shipped one by name, or a .safetensors
        /// file relative to the settings file that "foretrace lab train --model foresight" made for this
        /// pen.step_ms. Not set: the shipped one for this step, "foresight-5ms", "foresight-8ms" or
        /// "foresight-10ms"; where there is none, or with "none", the mixture does without.
        foresight: Option<String> = Text, Optional, AtStart, "nothing: leave it out";
        /// Factor per step by which the past loses weight in the read-outs.
        forgetting: f64 = Between(0.99, 1.0), Default("0.99985"), AtStart, "0.99985";
        /// How fast the weights of the experts follow their errors.
        rate: f64 = Between(0.0, 10.0), Default("0.1"), AtStart, "0.1";
        /// Part of the weights that is redistributed at every step, so that no expert is lost for good.
        share: f64 = Between(0.0, 0.1), Default("0.001"), AtStart, "0.001";
    }
}

section! {
    /// How samples newer than the grid move the preview (trust.per_step): learned online, starting from
    /// weights fitted to other hands.
    pub struct RefineSection {
        /// The initial weights: the shipped "refine-prior", or a .toml file relative to the settings file.
        /// Not set: the shipped ones.
        prior: Option<String> = Text, Optional, AtStart, "nothing: leave it out";
    }
}

section! {
    /// Online learning, in its own thread on copies of the weights. A candidate learns; it replaces the live
    /// weights only when it did better on recent motion (or, for models that learn at once, no worse), and is
    /// rolled back when it then does worse than its predecessor. They are compared by their predictions over
    /// the leads that the plan uses: from the dead time to the horizon behind it.
    pub struct Learner {
        /// Learn while running. Off: the weights stay as they are.
        enabled: bool = Flag, Default("true"), Live, "true";
        /// Initial weights: they repeat the last displacement, decaying by this factor per step. 0 starts
        /// from zero weights, as in the paper.
        initial_persistence: f64 = Between(0.0, 1.0), Default("0.95"), AtStart, "0.95";
        /// Moving steps over which the comparison forgets.
        memory_steps: f64 = Between(10.0, 1e6), Default("300.0"), AtStart,
            "300: three seconds of motion at 10 ms";
        /// Moving steps that have to be compared before the live weights change again.
        min_evidence_steps: u32 = Between(10.0, 1e6), Default("100"), AtStart, "100";
        /// Moving steps between two hand-overs of weights that follow their candidate.
        follow_steps: u32 = Between(1.0, 1e6), Default("10"), AtStart, "10: a tenth of a second at 10 ms";
        /// The candidate is promoted when its error is below this part of the live error.
        promote_ratio: f64 = Between(0.1, 1.0), Default("0.95"), AtStart, "0.95";
        /// The live weights are rolled back when their error is above this many times their predecessor's.
        rollback_ratio: f64 = Between(1.0, 10.0), Default("1.1"), AtStart, "1.1";
        /// Displacements longer than this in the plane (normalised; a typical one is 14) are not learned
        /// from.
        max_learned: f64 = Between(10.0, 1e6), Default("60.0"), AtStart, "60";
    }
}

section! {
    /// The weight on the prediction: 1 = prediction only, 0 = the last position only.
    pub struct TrustSection {
        /// "auto": from the evidence of past predictions; "manual": `value`.
        mode: TrustMode = Words(TrustMode::WORDS), Required, Live, "\"auto\"";
        /// The trust in manual mode; too little history or a stale pen still overrule it.
        value: f64 = Between(0.0, 1.0), Default("1.0"), Live, "1.0";
        /// Largest trust in automatic mode.
        ceiling: f64 = Between(0.0, 1.0), Default("1.0"), AtStart, "1.0";
        /// Automatic mode trusts each step of the preview by its record, and corrects the preview by samples
        /// newer than the grid's. Off: one trust for the whole preview, as in the paper and in manual mode.
        per_step: bool = Flag, Default("true"), AtStart, "true";
        /// Least number of steps in which the trust goes from 0 to 1.
        ramp_steps: u32 = Between(1.0, 1000.0), Required, AtStart, "10, as in the paper";
        /// Steps of motion that are needed before there is any trust.
        warmup_steps: u32 = Between(0.0, 1000.0), Required, AtStart, "5";
    }
}
