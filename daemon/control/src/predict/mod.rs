//! Predictors: one step ahead of the pen, rolled out by feeding predictions back.
//!
//! Contract: `observe` takes a real displacement and changes memory; `preview` takes `&self`, so a rollout
//! cannot change what the predictor remembers (paper, section 3: the state after it is the state after the
//! last real input). Every displacement is per grid step Δ and normalised (see [`crate::pen::SpeedScale`]),
//! never SI. [`Previewer`] is what the follower uses: metres in, predicted positions in metres out.
//!
//! *The unit of length* here, in [`crate::learn`] and in [`crate::estimate`]: the running scale makes the RMS
//! of a moving pen's steps 10 per axis ([`crate::pen::TARGET_RMS`]), whatever the hand and the size of the
//! writing, so a step of ordinary motion is about 14 long (√2 · 10). Every bound or measure of a length says
//! which it is: *per axis*, of each component, or *in the plane*, of the vector.

pub mod models;
pub mod bands;
pub mod external;
mod member;
mod online;
mod online_weights;
mod panel;
mod previewer;
mod registry;
mod step;
mod taught;

pub use external::{ExternalPreview, ExternalReport, PlanLeads, PreviewRefusal};
pub use member::AnyPredictor;
pub use models::{
    ArRls, ArRlsLearner, ArRlsSettings, ArRlsWeights, ConstantVelocity, Dybm, DybmEsn, DybmEsnLearner,
    DybmEsnSettings, DybmEsnWeights, DybmLearner, DybmSettings, DybmState, DybmWeights, Hold, InitialWeights,
    Lstm, LstmError, LstmWeights, Mixture, MixtureLearner, MixtureParameters, MixtureSettings, ModelSettings,
    Models, ModelsError, Networks, Optimiser, Oracle, REGISTRY,
};
pub use online::{LARGEST_DISPLACEMENT, ModelParameters, OnlineModel, WeightsError};
pub use online_weights::OnlineWeights;
pub use panel::{Panel, RollOut};
pub use previewer::{PreviewError, PreviewReport, PreviewSettings, Previewer};
pub use registry::{Entry, LONGEST_NAME, Needs, NetworkPredictor, PredictorKind, kind_of};
pub use step::{LearnStep, PenStep};
pub use taught::{Learning, ListedPredictor, OnlinePredictor, Pace, ParametersOf};

/// Longest preview in steps: N = 30 and the lead that dead time and pen age add.
pub const MAX_PREVIEW: usize = 64;

/// A model of the pen that predicts its next displacements.
pub trait Predictor {
    /// Remembers one real normalised displacement.
    fn observe(&mut self, x: [f64; 2]);

    /// As `observe`, with what the pen knows besides. For predictors that look at contact.
    fn observe_pen(&mut self, step: &PenStep) {
        self.observe(step.x);
    }

    /// Predicts the next `out.len()` normalised displacements; `out[i]` is i+1 steps after the last observed
    /// one.
    fn preview(&self, out: &mut [[f64; 2]]) {
        self.preview_within(f64::INFINITY, out);
    }

    /// As `preview`, with no predicted displacement longer than `limit` (normalised, in the plane). Where
    /// predictions are fed back, the limited one is, so that a diverging model saturates.
    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]);

    /// Forgets the history; parameters stay.
    fn reset(&mut self);

    /// Sets the newest closed grid index and the present scale \[m per unit\]. For predictors that replay a
    /// recording.
    fn set_cursor(&mut self, _index: u64, _scale_m: f64) {}
}

/// `x` shortened to `limit` if it is longer in the plane; non-finite values become NaN, so that they stay
/// visible.
#[must_use]
#[inline]
pub(crate) fn shortened(x: [f64; 2], limit: f64) -> [f64; 2] {
    let [a, b] = x;
    let squared = a * a + b * b;
    if squared <= limit * limit {
        return x;
    }
    // Scaled by the largest component first, because the square of a large number overflows.
    let largest = a.abs().max(b.abs());
    let (a, b) = (a / largest, b / largest);
    let factor = limit / a.hypot(b);
    [a * factor, b * factor]
}
