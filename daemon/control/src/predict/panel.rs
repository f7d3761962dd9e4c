//! `Panel`: every predictor behind one memory of the pen, in normalised units.
//!
//! Contract: all predictors observe every step, so a switch needs no new history. The loop previews from its
//! panel, the learner calibrates error bands on one of its own, with the same code and the same steps, so the
//! bands are those of the loop. Every predictor in the registry is a member.

use super::member::{Member, OfflineMember};
use super::models::REGISTRY;
use super::online::WeightsError;

use super::{Hold, MAX_PREVIEW, Models, Needs, OnlineWeights, Oracle, PenStep, PredictorKind};
use crate::state::{Reader, State, StateError, Writer, load_part, save_part, state};

/// Answers for a predictor that is absent or has no history.
const NOBODY: &OfflineMember<Hold> = &OfflineMember(Hold);

/// Result of a roll-out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RollOut {
    /// Every number was finite; if not, all positions are the first.
    pub finite: bool,
    /// Predicted displacements that the bound shortened.
    pub limited: u32,
}

state! { whole [] RollOut { finite, limited } }

/// All predictors behind one interface.
#[derive(Debug, Clone)]
pub struct Panel {
    /// In the order of the registry; `None`: its requirements are missing.
    members: [Option<Box<dyn Member>>; REGISTRY.len()],
    /// Something was observed since the memories were last emptied.
    knows: bool,
}

impl State for Panel {
    fn save(&self, to: &mut Writer<'_>) {
        for member in &self.members {
            save_part(member.as_ref(), to);
        }
        self.knows.save(to);
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        for member in &mut self.members {
            load_part(member.as_mut(), from)?;
        }
        self.knows.load(from)
    }
}

impl Panel {
    /// Starts with empty memories.
    ///
    /// # Errors
    ///
    /// Weights that are invalid or made for another loop.
    pub fn new(models: &Models, weights: &OnlineWeights) -> Result<Self, WeightsError> {
        weights.validate()?;
        weights.fits(models.settings().step_ns)?;
        let mut members = [const { None }; REGISTRY.len()];
        for (member, entry) in members.iter_mut().zip(REGISTRY) {
            *member = entry.build(models, weights)?;
        }
        Ok(Self { members, knows: false })
    }

    /// Remembers one real normalised displacement, and what the pen tells besides.
    pub fn observe(&mut self, step: &PenStep) {
        for member in self.members.iter_mut().flatten() {
            member.observe_pen(step);
        }
        self.knows = true;
    }

    /// Empties the memories of all predictors.
    pub fn forget(&mut self) {
        for member in self.members.iter_mut().flatten() {
            member.reset();
        }
        self.knows = false;
    }

    /// `kind` can be chosen.
    #[must_use]
    pub fn offers(&self, kind: PredictorKind) -> bool {
        self.member(kind).is_some()
    }

    /// Takes over what changed, all or nothing; memories stay.
    ///
    /// # Errors
    ///
    /// Weights that are invalid or do not fit; the old ones stay.
    pub fn set_weights(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        for member in self.members.iter().flatten() {
            member.judge(weights)?;
        }
        for member in self.members.iter_mut().flatten() {
            member.take_over(weights)?;
        }
        Ok(())
    }

    /// Positions \[m\] from `from` on, one per entry of `out`, with `scale_m` metres per unit and no
    /// displacement longer than `limit` (normalised, in the plane); beyond [`MAX_PREVIEW`] the last is
    /// repeated.
    pub fn roll_out(
        &self,
        kind: PredictorKind,
        limit: f64,
        scale_m: f64,
        from: [f64; 2],
        out: &mut [[f64; 2]],
    ) -> RollOut {
        let mut scratch = [[0.0; 2]; MAX_PREVIEW];
        let wanted = out.len().min(MAX_PREVIEW);
        let steps = scratch.get_mut(..wanted).unwrap_or_default();
        // A recording is not bounded.
        let limit = if kind.needs() == Needs::Recording { f64::INFINITY } else { limit };
        self.predictor(kind).preview_within(limit, steps);
        let mut report = RollOut { finite: true, limited: 0 };
        let almost = limit * (1.0 - 1e-9);
        let [mut x, mut y] = from;
        let mut steps = steps.iter();
        for position in out.iter_mut() {
            if let Some([dx, dy]) = steps.next() {
                report.limited += u32::from(dx * dx + dy * dy >= almost * almost);
                x += scale_m * dx;
                y += scale_m * dy;
            }
            *position = [x, y];
        }
        // A NaN anywhere propagates to every later sum.
        if !(x.is_finite() && y.is_finite()) {
            report.finite = false;
            out.fill(from);
        }
        report
    }

    /// Gives the recorded future to the oracle.
    pub(super) fn load(&mut self, oracle: Oracle) {
        if let Some(member) = self.members.get_mut(PredictorKind::ORACLE.index()) {
            *member = Some(Box::new(OfflineMember(oracle)));
        }
    }

    /// Tells the position of the loop on the grid.
    pub(super) fn set_cursor(&mut self, index: u64, scale_m: f64) {
        for member in self.members.iter_mut().flatten() {
            member.set_cursor(index, scale_m);
        }
    }

    /// Writes the parameters in use into `weights`.
    pub(super) fn write_weights(&self, weights: &mut OnlineWeights) {
        for member in self.members.iter().flatten() {
            member.write_weights(weights);
        }
    }

    fn member(&self, kind: PredictorKind) -> Option<&dyn Member> {
        self.members.get(kind.index())?.as_deref()
    }

    /// The predictor that answers for `kind`: Hold if it is absent or has no history; the oracle needs no
    /// history.
    fn predictor(&self, kind: PredictorKind) -> &dyn Member {
        match self.member(kind) {
            Some(member) if self.knows || kind.needs() == Needs::Recording => member,
            _ => NOBODY,
        }
    }
}
