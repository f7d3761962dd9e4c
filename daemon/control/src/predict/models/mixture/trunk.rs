//! `Trunk`: the experts' features of the pen, made once per step.
//!
//! Contract: fixed after construction; the memory it fills is a plain copy from which any parameters can
//! predict.

use crate::state::state;
use std::sync::Arc;

use crate::pen::TARGET_RMS;
use crate::predict::models::ar_rls::{ArRlsState, REGRESSORS};
use crate::predict::models::esn::{Reservoir, ReservoirSettings, ReservoirState, UNITS};
use crate::predict::models::foresight::{Foreseen, Foresight, ForesightWeights, PenHistory};
use crate::predict::models::lstm::MAX_HIDDEN;
use crate::predict::models::mixture::{GATE, LEADS, NODES, NodePath};
use crate::predict::{Lstm, LstmWeights, PenStep, Predictor, WeightsError};

/// Features that need no training: FIFO and reservoir.
pub(super) const PLAIN: usize = REGRESSORS + UNITS;
/// All features: those and the cells of the LSTM (zero past its size).
pub(super) const ALL: usize = PLAIN + MAX_HIDDEN;

/// FIFO features are displacements in units of the RMS, so that all features are of order 1.
const FIFO_UNIT: f64 = 1.0 / TARGET_RMS;

/// Memory of the pen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MixtureMemory {
    /// The last displacements, newest first.
    pub(super) recent: ArRlsState,
    /// State of the reservoir.
    reservoir: ReservoirState,
    /// φ: FIFO, reservoir, cells.
    pub(super) features: [f32; ALL],
    /// The LSTM's prediction, summed up to each node; absent without an LSTM.
    pub(super) lstm: Option<NodePath>,
    /// What `foresight` sees.
    history: PenHistory,
    /// Its output; absent without it.
    pub(super) foresight: Option<Foreseen>,
}

state! { [] MixtureMemory { recent, reservoir, features, lstm, history, foresight } }

impl MixtureMemory {
    pub(super) const EMPTY: Self = Self {
        recent: ArRlsState { recent: [[0.0; 2]; REGRESSORS / 2] },
        reservoir: [0.0; UNITS],
        features: [0.0; ALL],
        lstm: None,
        history: PenHistory::EMPTY,
        foresight: None,
    };

    /// The newest displacement; zero after a reset.
    pub(super) fn newest(&self) -> [f64; 2] {
        let [newest, ..] = self.recent.recent;
        newest
    }

    /// Features without those of the LSTM.
    pub(super) fn plain(&self) -> &[f32; PLAIN] {
        // The prefix is as long as its type says.
        self.features.first_chunk().unwrap_or(&[0.0; PLAIN])
    }
}

/// Networks trained offline; those that are absent leave their experts out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrainedNetworks {
    /// With [`LEADS`] direct outputs.
    pub lstm: Option<Arc<LstmWeights>>,
    /// The network that sees contact, direction and time.
    pub foresight: Option<Arc<ForesightWeights>>,
}

impl From<Option<Arc<LstmWeights>>> for TrainedNetworks {
    fn from(lstm: Option<Arc<LstmWeights>>) -> Self {
        Self { lstm, foresight: None }
    }
}

/// Which of them are there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Present {
    /// The LSTM takes part as an expert.
    pub lstm: bool,
    /// The network that sees contact, direction and time.
    pub foresight: bool,
}

state! { [] Present { lstm, foresight } }

impl From<bool> for Present {
    fn from(lstm: bool) -> Self {
        Self { lstm, foresight: false }
    }
}

impl From<&TrainedNetworks> for Present {
    fn from(trained: &TrainedNetworks) -> Self {
        Self { lstm: trained.lstm.is_some(), foresight: trained.foresight.is_some() }
    }
}

/// Reservoir and networks. Clones share their matrices.
#[derive(Debug, Clone)]
pub struct Trunk {
    reservoir: Arc<Reservoir>,
    lstm: Option<Lstm>,
    foresight: Option<Foresight>,
}

state! { [] Trunk {} present { lstm } fixed { reservoir, foresight } }

impl Trunk {
    /// The reservoir of seed 0, and the networks.
    ///
    /// # Errors
    ///
    /// An LSTM with fewer or more than [`LEADS`] outputs.
    pub fn new(trained: TrainedNetworks) -> Result<Self, WeightsError> {
        let TrainedNetworks { lstm, foresight } = trained;
        if let Some(lstm) = &lstm {
            let leads = lstm.spec().leads as f64;
            WeightsError::bounded("mixture", "leads of the LSTM", leads, LEADS as f64, LEADS as f64)?;
        }
        let reservoir = Reservoir::shared(&ReservoirSettings::default())?;
        let foresight = foresight.map(|weights| Foresight::new(&weights));
        Ok(Self { reservoir, lstm: lstm.map(Lstm::new), foresight })
    }

    /// Which networks are there.
    #[must_use]
    pub fn present(&self) -> Present {
        Present { lstm: self.lstm.is_some(), foresight: self.foresight.is_some() }
    }

    /// Takes in one step; a jump (or NaN) clears the memory and counts as
    /// rest, as in training.
    pub fn observe(&mut self, memory: &mut MixtureMemory, step: &PenStep) {
        if is_motion(step.x) {
            self.take_in(memory, step);
        } else {
            self.reset(memory);
            self.take_in(memory, &PenStep { touch: step.touch, ..PenStep::of([0.0; 2]) });
        }
    }

    fn take_in(&mut self, memory: &mut MixtureMemory, step: &PenStep) {
        let x = step.x;
        memory.recent.observe(x);
        self.reservoir.observe(&mut memory.reservoir, x);
        let fifo = memory.recent.recent.as_flattened().iter().map(|x| x * FIFO_UNIT);
        let plain = fifo.chain(memory.reservoir);
        for (feature, value) in memory.features.iter_mut().zip(plain) {
            *feature = value as f32;
        }
        if let Some(foresight) = &self.foresight {
            memory.history.observe(step);
            memory.foresight = Some(foresight.foresee(&memory.history));
        }
        let Some(lstm) = &mut self.lstm else { return };
        lstm.observe(x);
        for (feature, h) in memory.features.iter_mut().skip(PLAIN).zip(lstm.hidden()) {
            *feature = *h as f32;
        }
        let mut steps = [[0.0; 2]; LEADS];
        lstm.preview(&mut steps);
        memory.lstm = Some(summed(&steps));
    }

    /// Clears what is remembered of the pen.
    pub fn reset(&mut self, memory: &mut MixtureMemory) {
        *memory = MixtureMemory::EMPTY;
        if let Some(lstm) = &mut self.lstm {
            lstm.reset();
            // At rest until the first displacement.
            memory.lstm = Some([[0.0; 2]; NODES.len()]);
        }
        memory.foresight = self.foresight.is_some().then_some(Foreseen::NOTHING);
    }
}

/// `x` is no longer than the gate ([`GATE`]); NaN is not motion.
#[must_use]
pub fn is_motion(x: [f64; 2]) -> bool {
    let [a, b] = x;
    a * a + b * b <= GATE * GATE
}

/// Sums of displacements up to each node.
pub(super) fn summed(steps: &[[f64; 2]; LEADS]) -> NodePath {
    let [mut x, mut y] = [0.0; 2];
    let mut sums = [[0.0; 2]; LEADS];
    for (sum, [dx, dy]) in sums.iter_mut().zip(steps) {
        x += dx;
        y += dy;
        *sum = [x, y];
    }
    NODES.map(|node| sums.get(node - 1).copied().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_hold_the_way_up_to_them() {
        // 1 + 2 + ... + h on one axis, h/2 on the other.
        let path = summed(&std::array::from_fn(|step| [(step + 1) as f64, -0.5]));
        for (node, [x, y]) in NODES.iter().zip(path) {
            assert_eq!([x, y], [(node * (node + 1) / 2) as f64, -0.5 * *node as f64], "{node} steps");
        }
    }
}
