//! `Previewer`: the follower's interface. Grid steps in metres go in, predicted positions in metres come out.
//!
//! Contract: every predictor observes every step, so a switch needs no new history. A start, a jump or lost
//! steps clear all memories. A non-finite preview is replaced by Hold and reported.
//!
//! Bound on the roll-out: a linear model fed with its own output may diverge within 16 steps (learned
//! matrices with an eigenvalue above 1 are common while it learns). A hand does not suddenly move much faster
//! than it recently did, so no predicted displacement may exceed `limit_factor` times the recent peak; the
//! bounded value is fed back. The models themselves are unbounded.

use crate::state::state;
use thiserror::Error;

use super::bands::{self, BandTable, PreviewBands};
use super::external::{External, ExternalPreview, ExternalReport, MOST_LATE, PlanLeads, PreviewRefusal};
use super::online::WeightsError;
use super::{MAX_PREVIEW, Models, Needs, OnlineWeights, Oracle, Panel, PredictorKind, RollOut};
use crate::pen::{GridStep, Motion, PenError, SpeedScale, SpeedScaleSettings, TARGET_RMS};
use crate::predict::{LearnStep, PenStep};

/// What a previewer needs to start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreviewSettings {
    /// Δ \[ns\].
    pub step_ns: u64,
    /// The predictor that answers first.
    pub kind: PredictorKind,
    /// The built-in predictor that stands in for another process's.
    pub fallback: PredictorKind,
    /// Steps that may close before another process's preview comes, at most
    /// [`MOST_LATE`](super::external::MOST_LATE).
    pub most_late: u32,
    /// Longest predicted displacement in units of the recent peak, at least 1.
    pub limit_factor: f64,
    /// Decay per step of the recent peak, in (0, 1); 0.98 halves it in a third of a second at 10 ms.
    pub peak_fade: f64,
    /// How displacements are normalised.
    pub scale: SpeedScaleSettings,
}

impl Default for PreviewSettings {
    fn default() -> Self {
        Self {
            step_ns: 10_000_000,
            kind: PredictorKind::MIXTURE,
            fallback: PredictorKind::MIXTURE,
            most_late: 2,
            limit_factor: 1.25,
            peak_fade: 0.98,
            scale: SpeedScaleSettings::default(),
        }
    }
}

/// Settings, weights or requests a previewer cannot work with.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PreviewError {
    /// The normaliser's bounds.
    #[error(transparent)]
    Scale(#[from] PenError),
    /// A model's settings or weights.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The bound on the rollout.
    #[error(
        "preview limit factor is {limit_factor}, legal are 1 to 10; peak fade is {peak_fade}, legal are 0.5 \
         to 0.999"
    )]
    Limit {
        /// The refused value, as it was given.
        limit_factor: f64,
        /// The refused value, as it was given.
        peak_fade: f64,
    },
    /// Nobody to stand in for another process, or too old previews.
    #[error(
        "predictor external needs a built-in predictor that stands in for it, {fallback} is none; its \
         previews may be {most_late} steps late, legal are 0 to 8"
    )]
    External {
        /// The refused value, as it was given.
        fallback: &'static str,
        /// The refused value, as it was given.
        most_late: u32,
    },
    /// No recording was loaded.
    #[error("predictor {predictor} needs a recording: it is for experiments, choose another predictor")]
    NoRecording {
        /// Name of the number, as in the message.
        predictor: &'static str,
    },
    /// No trained network was loaded.
    #[error("predictor {predictor} needs a trained network: load one, or choose another predictor")]
    NoNetwork {
        /// Name of the number, as in the message.
        predictor: &'static str,
    },
}

/// A preview's reference point and quality.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreviewReport {
    /// Grid index of the newest closed step; entry i of the preview is the instant (base_index + i + 1)·Δ.
    pub base_index: u64,
    /// Position at `base_index` \[m\].
    pub base_position: [f64; 2],
    /// The predictor's numbers were finite; if not, the preview is Hold.
    pub finite: bool,
    /// How many predicted displacements the bound on the rollout shortened.
    pub limited: u32,
    /// Error bands of this predictor, per lead.
    pub bands: PreviewBands,
}

/// Larger displacements are not motion [per axis]: a thousand times the typical one.
const LARGEST_OBSERVED: f64 = 1000.0 * TARGET_RMS;

/// All predictors behind one history, and the normaliser.
#[derive(Debug, Clone)]
pub struct Previewer {
    settings: PreviewSettings,
    active: PredictorKind,
    scale: SpeedScale,
    panel: Panel,
    version: u64,
    bands: BandTable,
    newest: Option<GridStep>,
    history: u32,
    /// Recent peak of |x| \[in the plane\].
    peak: f64,
    /// Recent mean of |x|² \[in the plane, squared\].
    level_square: f64,
    external: Box<External>,
}

state! {
    [] Previewer { active, scale, panel, version, bands, newest, history, peak, level_square, external }
    fixed { settings }
}

impl Previewer {
    /// Starts with empty memories.
    ///
    /// # Errors
    ///
    /// Settings outside their bounds, or weights that are invalid or made for another loop.
    pub fn new(
        settings: PreviewSettings,
        models: &Models,
        weights: &OnlineWeights,
    ) -> Result<Self, PreviewError> {
        let PreviewSettings { limit_factor, peak_fade, fallback, most_late, .. } = settings;
        if !((1.0..=10.0).contains(&limit_factor) && (0.5..=0.999).contains(&peak_fade)) {
            return Err(PreviewError::Limit { limit_factor, peak_fade });
        }
        if fallback.needs() == Needs::Process || most_late > MOST_LATE {
            return Err(PreviewError::External { fallback: fallback.name(), most_late });
        }
        weights.fits(settings.step_ns)?;
        let panel = Panel::new(models, weights)?;
        offered(&panel, settings.kind, &settings)?;
        Ok(Self {
            settings,
            active: settings.kind,
            scale: SpeedScale::new(settings.scale)?,
            panel,
            version: weights.version,
            bands: weights.bands,
            newest: None,
            history: 0,
            peak: 0.0,
            level_square: 0.0,
            external: Box::new(External::new(most_late)),
        })
    }

    /// Gives the recorded future to the oracle (start-up only: the recording it replaces is freed).
    pub fn load_recording(&mut self, oracle: Oracle) {
        self.panel.load(oracle);
    }

    /// Takes in one closed step, in order; returns what the learner learns from it.
    pub fn observe(&mut self, step: &GridStep) -> LearnStep {
        let follows = self.newest.is_some_and(|newest| newest.index.checked_add(1) == Some(step.index));
        let motion = match step.motion {
            Motion::Continues if !follows => Motion::Start,
            Motion::Continues if !self.plausible(step) => Motion::Jump,
            given => given,
        };
        self.newest = Some(*step);
        let mut pen = PenStep { touch: step.touch(), ..PenStep::default() };
        if motion == Motion::Continues {
            self.scale.observe(step);
            pen.x = self.scale.normalise(step.displacement);
            pen.half = self.scale.normalise(step.half);
            pen.ahead = self.scale.normalise(step.ahead);
            pen.ahead_s = step.ahead_ns as f64 * 1e-9;
            self.remember(&pen);
        } else {
            self.forget();
        }
        let scale_m = self.scale.metres_per_unit();
        self.panel.set_cursor(step.index, scale_m);
        let step = LearnStep {
            index: step.index,
            motion,
            position: step.position,
            pen,
            scale_m,
            limit: self.limit(),
            level: bands::level(self.level_square),
        };
        if self.active == PredictorKind::EXTERNAL {
            self.external.observe(&step);
        }
        step
    }

    /// Takes over what another process predicted for a plan that looks at `leads`; says why if it is not
    /// used. `None`: it was not asked, another predictor is active.
    pub fn take(
        &mut self,
        preview: &ExternalPreview,
        leads: PlanLeads,
    ) -> Option<Result<(), PreviewRefusal>> {
        let limit_m = self.limit() * self.scale.metres_per_unit();
        let asked = self.active == PredictorKind::EXTERNAL;
        asked.then(|| self.external.take(preview, leads, limit_m))
    }

    /// Before previews of another process, where they are asked for: what stands in for them after the newest
    /// step, made once per step, or `again` with other weights, as far as a plan that looks at `leads` needs.
    pub fn prepare(&mut self, leads: PlanLeads, again: bool) {
        let steps = leads.farthest.min(MAX_PREVIEW);
        let (Some(newest), true) = (self.newest, self.active == PredictorKind::EXTERNAL) else { return };
        let enough = self.external.fallback().is_some_and(|(known, _)| known.len() >= steps);
        if again || !enough {
            let mut positions = [[0.0; 2]; MAX_PREVIEW];
            let wanted = positions.get_mut(..steps).unwrap_or_default();
            let (kind, scale_m) = (self.settings.fallback, self.scale.metres_per_unit());
            let made = self.panel.roll_out(kind, self.limit(), scale_m, newest.position, wanted);
            self.external.stand_in(wanted, made, leads);
        }
        self.external.carry_on();
    }

    /// What became of another process's previews; `verdict` of the one that came in this tick.
    #[must_use]
    pub fn external(&self, verdict: Option<Result<(), PreviewRefusal>>) -> Option<ExternalReport> {
        (self.active == PredictorKind::EXTERNAL).then(|| self.external.report(verdict))
    }

    /// Predicts positions \[m\] at the grid points after the newest closed step with the active predictor;
    /// `None` (and `out` unchanged) before the first step. At most [`MAX_PREVIEW`](super::MAX_PREVIEW)
    /// entries are predictions, the rest repeats the last.
    pub fn preview(&self, out: &mut [[f64; 2]]) -> Option<PreviewReport> {
        self.preview_of(self.active, out)
    }

    /// As `preview`, with any of the predictors.
    pub fn preview_of(&self, kind: PredictorKind, out: &mut [[f64; 2]]) -> Option<PreviewReport> {
        if kind != PredictorKind::EXTERNAL {
            return self.built_in(kind, out);
        }
        let mut report = self.preview_standing_in(out)?;
        let part = self.external.part();
        if let Some(theirs) = self.external.bounded().filter(|_| part > 0.0) {
            for ([x, y], [tx, ty]) in out.iter_mut().zip(theirs) {
                (*x, *y) = (*x + part * (*tx - *x), *y + part * (*ty - *y));
            }
        }
        report.bands = report.bands.or_given(|lead| self.external.radius(lead).filter(|_| part > 0.5));
        Some(report)
    }

    /// As `preview`, with the built-in predictor that stands in for another process.
    pub fn preview_standing_in(&self, out: &mut [[f64; 2]]) -> Option<PreviewReport> {
        let newest = self.newest?;
        match self.external.fallback() {
            // Made after this step already.
            Some((known, RollOut { finite, limited })) if out.len() <= known.len() => {
                out.iter_mut().zip(known).for_each(|(slot, position)| *slot = *position);
                let bands = self.bands_of(self.settings.fallback);
                Some(PreviewReport {
                    base_index: newest.index,
                    base_position: newest.position,
                    finite,
                    limited,
                    bands,
                })
            }
            _ => self.built_in(self.settings.fallback, out),
        }
    }

    /// As `preview`, with what another process predicts; `None`: it predicted nothing that could be carried
    /// on.
    pub fn preview_of_process(&self, out: &mut [[f64; 2]]) -> Option<PreviewReport> {
        let theirs = self.external.bounded()?;
        let mut report = self.preview_standing_in(out)?;
        report.bands = report.bands.or_given(|lead| self.external.radius(lead));
        out.iter_mut().zip(theirs).for_each(|(slot, position)| *slot = *position);
        Some(report)
    }

    /// Its part in the preview in force, 0 to 1; `None`: another predictor is active.
    #[must_use]
    pub fn part(&self) -> Option<f64> {
        (self.active == PredictorKind::EXTERNAL).then(|| self.external.part())
    }

    /// The process that predicts, or did last.
    #[must_use]
    pub const fn process(&self) -> u64 {
        self.external.sender()
    }

    /// Whether the other process's preview came in time: what is carried on longer is not worth judging.
    #[must_use]
    pub fn process_in_time(&self) -> bool {
        self.active == PredictorKind::EXTERNAL && self.external.in_time()
    }

    fn built_in(&self, kind: PredictorKind, out: &mut [[f64; 2]]) -> Option<PreviewReport> {
        let newest = self.newest?;
        let scale_m = self.scale.metres_per_unit();
        let RollOut { finite, limited } =
            self.panel.roll_out(kind, self.limit(), scale_m, newest.position, out);
        Some(PreviewReport {
            base_index: newest.index,
            base_position: newest.position,
            finite,
            limited,
            bands: self.bands_of(kind),
        })
    }

    fn bands_of(&self, kind: PredictorKind) -> PreviewBands {
        let unit_m = self.scale.metres_per_unit() * bands::level(self.level_square);
        PreviewBands::new(*self.bands.of(kind), unit_m)
    }

    /// Makes another predictor active from the next preview on.
    ///
    /// # Errors
    ///
    /// A predictor that is absent; the old one stays.
    pub fn choose(&mut self, kind: PredictorKind) -> Result<(), PreviewError> {
        offered(&self.panel, kind, &self.settings)?;
        if kind == PredictorKind::EXTERNAL && self.active != kind {
            *self.external = External::new(self.settings.most_late);
        }
        self.active = kind;
        Ok(())
    }

    /// `kind` can be chosen.
    #[must_use]
    pub fn offers(&self, kind: PredictorKind) -> bool {
        offered(&self.panel, kind, &self.settings).is_ok()
    }

    /// The predictor that answers now.
    #[must_use]
    pub fn active(&self) -> PredictorKind {
        self.active
    }

    /// Takes over what changed in the weights between two steps, all or nothing; memories stay.
    ///
    /// # Errors
    ///
    /// Weights that are invalid or do not fit; the old ones stay.
    pub fn set_weights(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        weights.bands.validate()?;
        self.panel.set_weights(weights)?;
        self.bands = weights.bands;
        self.version = weights.version;
        Ok(())
    }

    /// Version of the set of weights in use.
    #[must_use]
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Writes the weights in use into `weights`.
    pub fn tell_weights(&self, weights: &mut OnlineWeights) {
        self.panel.write_weights(weights);
        (weights.version, weights.bands) = (self.version, self.bands);
    }

    /// Steps of ordinary motion since the memories were last emptied.
    #[must_use]
    pub fn history(&self) -> u32 {
        self.history
    }

    /// The newest closed step.
    #[must_use]
    pub fn newest(&self) -> Option<GridStep> {
        self.newest
    }

    /// Clears all memories, e.g. when the pen is gone for good; the scale stays.
    pub fn forget(&mut self) {
        self.history = 0;
        self.level_square = 0.0;
        self.panel.forget();
    }

    /// Longest predicted displacement \[in the plane\]; the peak counts as at least 10, because a resting
    /// hand may start.
    fn limit(&self) -> f64 {
        self.settings.limit_factor * self.peak.max(TARGET_RMS)
    }

    /// NaN and displacements that would swamp the memory are no motion, even if they passed the pen tracker's
    /// gate.
    fn plausible(&self, step: &GridStep) -> bool {
        self.scale.normalise(step.displacement).iter().all(|x| x.abs() <= LARGEST_OBSERVED)
    }

    fn remember(&mut self, step: &PenStep) {
        self.history = self.history.saturating_add(1);
        let [dx, dy] = step.x;
        self.peak = dx.hypot(dy).max(self.peak * self.settings.peak_fade);
        self.level_square = bands::level_square(self.level_square, step.x);
        self.panel.observe(step);
    }
}

/// Why `kind` is not available.
fn offered(panel: &Panel, kind: PredictorKind, settings: &PreviewSettings) -> Result<(), PreviewError> {
    let answers = if kind.needs() == Needs::Process { settings.fallback } else { kind };
    let predictor = answers.name();
    match answers.needs() {
        _ if panel.offers(answers) => Ok(()),
        Needs::Network => Err(PreviewError::NoNetwork { predictor }),
        Needs::Recording | Needs::Nothing | Needs::Process => Err(PreviewError::NoRecording { predictor }),
    }
}
