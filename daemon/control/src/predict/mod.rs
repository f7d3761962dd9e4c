//! Predictors: one step ahead of the pen, rolled out by feeding predictions back.
//!
//! Contract: `observe` takes a real displacement and changes memory; `preview` takes `&self`, so a rollout cannot
//! change what the predictor remembers (paper, section 3: the state after it is the state after the last real input).
//! Every displacement is per grid step Δ and normalised (see [`crate::pen::SpeedScale`]), never SI.
//! [`Previewer`] is what the follower uses: metres in, predicted positions in metres out.

pub mod models;
pub mod bands;
pub mod refine;
mod online;
mod online_weights;
mod panel;
mod previewer;
mod step;

use std::fmt;

pub use models::{
    ArRls, ArRlsLearner, ArRlsSettings, ArRlsWeights, ConstantVelocity, Dybm, DybmEsn, DybmEsnLearner,
    DybmEsnSettings, DybmEsnWeights, DybmLearner, DybmSettings, DybmState, DybmWeights, Hold, InitialWeights,
    Lstm, LstmError, LstmWeights, Mixture, MixtureLearner, MixtureParameters, MixtureSettings, ModelSettings,
    Models, ModelsError, Networks, Optimiser, Oracle,
};
pub use online::{LARGEST_DISPLACEMENT, ModelParameters, OnlineModel, WeightsError};
pub use online_weights::OnlineWeights;
pub use panel::{Panel, RollOut};
pub use previewer::{PreviewError, PreviewReport, PreviewSettings, Previewer};
pub use step::LearnStep;

/// Longest preview in steps: N = 30 and the lead that dead time and pen age add.
pub const MAX_PREVIEW: usize = 64;

/// A model of the pen that predicts its next displacements.
pub trait Predictor {
    /// Remembers one real normalised displacement.
    fn observe(&mut self, x: [f64; 2]);

    /// Predicts the next `out.len()` normalised displacements; `out[i]` is i+1 steps after the last observed one.
    fn preview(&self, out: &mut [[f64; 2]]) {
        self.preview_within(f64::INFINITY, out);
    }

    /// As `preview`, with no predicted displacement longer than `limit` (normalised): where predictions are fed back,
    /// the limited one is, so that a model that diverges on its own output saturates instead.
    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]);

    /// Forgets the history; parameters stay.
    fn reset(&mut self);
}

/// One of the predictors, by its place in [`PredictorKind::ALL`].
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct PredictorKind(u8);

impl PredictorKind {
    /// Last position, at rest (the paper's conservative model).
    pub const HOLD: Self = Self(0);
    /// Last displacement repeated (the baseline of the paper's Table 1).
    pub const CONSTANT_VELOCITY: Self = Self(1);
    /// Linear dynamic Boltzmann machine, learning online.
    pub const DYBM: Self = Self(2);
    /// The recorded future; experiments only.
    pub const ORACLE: Self = Self(3);
    /// Trained network, if one was loaded.
    pub const LSTM: Self = Self(4);
    /// DyBM with an echo state network beside it, learning online.
    pub const DYBM_ESN: Self = Self(5);
    /// Autoregression by recursive least squares, learning online.
    pub const AR_RLS: Self = Self(6);
    /// Mixture of experts that learns online whom to believe.
    pub const MIXTURE: Self = Self(7);

    /// Every predictor.
    pub const ALL: [Self; 8] = [
        Self::HOLD,
        Self::CONSTANT_VELOCITY,
        Self::DYBM,
        Self::ORACLE,
        Self::LSTM,
        Self::DYBM_ESN,
        Self::AR_RLS,
        Self::MIXTURE,
    ];

    /// Those that a running loop has: all but the oracle.
    pub const LIVE: [Self; 7] = [
        Self::HOLD,
        Self::CONSTANT_VELOCITY,
        Self::DYBM,
        Self::LSTM,
        Self::DYBM_ESN,
        Self::AR_RLS,
        Self::MIXTURE,
    ];

    /// Place in [`Self::ALL`].
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// Name in settings, requests and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::HOLD => "hold",
            Self::CONSTANT_VELOCITY => "constant-velocity",
            Self::DYBM => "dybm",
            Self::ORACLE => "oracle",
            Self::LSTM => "lstm",
            Self::DYBM_ESN => "dybm-esn",
            Self::AR_RLS => "ar-rls",
            _ => "mixture",
        }
    }

    /// What to tell someone who asks for a predictor by its name of earlier versions; empty for all other names.
    #[must_use]
    pub fn renamed(name: &str) -> &'static str {
        if name == "ours" || name.starts_with("ours-") {
            " (what was called ours is called mixture)"
        } else {
            ""
        }
    }

    /// The predictor of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

impl Default for PredictorKind {
    fn default() -> Self {
        Self::MIXTURE
    }
}

impl fmt::Debug for PredictorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// `x` shortened to `limit` if it is longer; what is not finite becomes NaN, so that it stays visible.
#[must_use]
#[inline]
pub(crate) fn shortened(x: [f64; 2], limit: f64) -> [f64; 2] {
    let [a, b] = x;
    let squared = a * a + b * b;
    if squared <= limit * limit {
        return x;
    }
    // Through the largest component first: the square of a huge one overflows.
    let largest = a.abs().max(b.abs());
    let (a, b) = (a / largest, b / largest);
    let factor = limit / a.hypot(b);
    [a * factor, b * factor]
}
