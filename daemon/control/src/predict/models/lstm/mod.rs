//! LSTM: one layer of 10, 32 or 64 cells on displacements, with a linear output per lead (paper, section 3).
//!
//! Parameters ([`LstmWeights`]), memory ([`LstmState`]) and the predictor ([`Lstm`]) are separate. Trained
//! offline; nothing learns here. Two kinds of output: `leads` = 1 predicts the next displacement and is
//! rolled out by feeding predictions back; more leads predict each step directly from the newest state, and
//! beyond the last one its displacement decays. Inputs are divided by the network's `input_scale` and limited
//! to ±`input_clip`; outputs are multiplied back.
//!
//! Contract: no allocation after construction; the same bits on every machine. [`Lstm::new`] computes in
//! `f32`, as PyTorch trains, in half the memory and time; [`Lstm::exact`] in `f64`, for tables that are
//! compared to the last digits.

mod weights;
mod cell;
mod state;

use crate::state::{Reader, State, StateError, Writer, state};
use std::sync::Arc;

use cell::{Cells, Memory};
pub use state::LstmState;
pub use weights::{
    GATES, HIDDEN_SIZES, LARGEST_INPUT, LstmError, LstmSpec, LstmTensors, LstmWeights, MAX_HIDDEN,
};

use crate::predict::{Entry, Models, NetworkPredictor, Predictor, shortened};

pub(super) const ENTRY: Entry = Entry::trained::<Lstm>("lstm", "the trained network of `lstm`");

/// Decay per step of the last direct lead beyond it.
pub const FADE: f64 = 0.8;

/// Precision of the computation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// `f32`.
    Single,
    /// `f64`: reproduces a training in double precision to rounding.
    Double,
}

/// The predictor: weights and memory. Clones share the weights.
#[derive(Debug, Clone)]
pub struct Lstm {
    weights: Arc<LstmWeights>,
    engine: SizedLstm,
    hidden: [f64; MAX_HIDDEN],
}

state! { [] Lstm { engine, hidden } fixed { weights } }

/// Compiled sizes: precision and number of cells; cells per block and blocks (the fastest of those measured
/// with SSE2).
#[derive(Debug, Clone)]
#[expect(
    clippy::large_enum_variant,
    reason = "one kilobyte at most, and the memory is where the tick looks for it"
)]
enum SizedLstm {
    Double10(LstmCore<f64, 10, 2, 5>),
    Double32(LstmCore<f64, 32, 4, 8>),
    Double64(LstmCore<f64, 64, 4, 16>),
    Single10(LstmCore<f32, 10, 12, 1>),
    Single32(LstmCore<f32, 32, 8, 4>),
    Single64(LstmCore<f32, 64, 8, 8>),
}

/// Calls the same for whichever size is present.
macro_rules! with_machine {
    ($engine:expr, $machine:ident => $do:expr) => {
        match $engine {
            SizedLstm::Double10($machine) => $do,
            SizedLstm::Double32($machine) => $do,
            SizedLstm::Double64($machine) => $do,
            SizedLstm::Single10($machine) => $do,
            SizedLstm::Single32($machine) => $do,
            SizedLstm::Single64($machine) => $do,
        }
    };
}

impl State for SizedLstm {
    fn save(&self, to: &mut Writer<'_>) {
        with_machine!(self, machine => machine.save(to));
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        with_machine!(self, machine => machine.load(from))
    }
}

#[derive(Debug, Clone)]
struct LstmCore<T, const H: usize, const U: usize, const B: usize> {
    cells: Arc<Cells<T, H, U, B>>,
    memory: Memory<T, U, B>,
}

state! {
    [T: State, const H: usize, const U: usize, const B: usize] LstmCore<T, H, U, B> { memory }
    fixed { cells }
}

impl Lstm {
    /// Starts with empty memory; computes in `f32`.
    #[must_use]
    pub fn new(weights: Arc<LstmWeights>) -> Self {
        Self::with_precision(weights, Precision::Single)
    }

    /// Starts with empty memory; computes in `f64`.
    #[must_use]
    pub fn exact(weights: Arc<LstmWeights>) -> Self {
        Self::with_precision(weights, Precision::Double)
    }

    /// Starts with empty memory, in the given precision.
    #[must_use]
    pub fn with_precision(weights: Arc<LstmWeights>, precision: Precision) -> Self {
        let engine = match (precision, weights.spec().hidden) {
            (Precision::Double, ..=10) => SizedLstm::Double10(LstmCore::new(&weights)),
            (Precision::Double, ..=32) => SizedLstm::Double32(LstmCore::new(&weights)),
            (Precision::Double, _) => SizedLstm::Double64(LstmCore::new(&weights)),
            (Precision::Single, ..=10) => SizedLstm::Single10(LstmCore::new(&weights)),
            (Precision::Single, ..=32) => SizedLstm::Single32(LstmCore::new(&weights)),
            (Precision::Single, _) => SizedLstm::Single64(LstmCore::new(&weights)),
        };
        Self { weights, engine, hidden: [0.0; MAX_HIDDEN] }
    }

    /// The parameters in use.
    #[must_use]
    pub fn weights(&self) -> &LstmWeights {
        &self.weights
    }

    /// h after the last real input; H numbers in (−1, 1).
    #[must_use]
    pub fn hidden(&self) -> &[f64] {
        self.hidden.get(..self.weights.spec().hidden).unwrap_or(&self.hidden)
    }

    /// The whole memory, e.g. for comparisons.
    #[must_use]
    pub fn state(&self) -> LstmState {
        let mut state = LstmState::empty();
        with_machine!(&self.engine, machine => machine.write(&mut state));
        state
    }
}

impl NetworkPredictor for Lstm {
    fn of(models: &Models) -> Option<Self> {
        models.networks().lstm.clone().map(Self::new)
    }
}

impl Predictor for Lstm {
    /// Non-finite displacements are ignored.
    fn observe(&mut self, x: [f64; 2]) {
        let scale = self.weights.spec().input_scale;
        if x.iter().all(|x| x.is_finite()) {
            with_machine!(&mut self.engine, machine => machine.observe(scale, x, &mut self.hidden));
        }
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        let LstmSpec { leads, input_scale, .. } = *self.weights.spec();
        // The limit is in the caller's units; the network works in its own.
        let limit = limit / input_scale;
        if leads == 1 {
            with_machine!(&self.engine, machine => machine.roll_out(limit, out));
        } else {
            with_machine!(&self.engine, machine => machine.direct(leads, limit, out));
        }
        for x in out.as_flattened_mut() {
            *x *= input_scale;
        }
    }

    fn reset(&mut self) {
        self.hidden = [0.0; MAX_HIDDEN];
        with_machine!(&mut self.engine, machine => machine.memory = Memory::EMPTY);
    }
}

impl<T: crate::predict::models::activation::Scalar, const H: usize, const U: usize, const B: usize>
    LstmCore<T, H, U, B>
{
    fn new(weights: &LstmWeights) -> Self {
        Self { cells: Arc::new(Cells::new(weights)), memory: Memory::EMPTY }
    }

    fn observe(&mut self, scale: f64, x: [f64; 2], hidden: &mut [f64; MAX_HIDDEN]) {
        self.cells.step(&mut self.memory, x.map(|x| x / scale));
        for (wide, h) in hidden.iter_mut().zip(self.memory.h.as_flattened()) {
            *wide = h.wide();
        }
    }

    /// One step ahead, from a copy of the memory, each prediction fed back.
    fn roll_out(&self, limit: f64, out: &mut [[f64; 2]]) {
        let mut memory = self.memory;
        let mut fed_back = None;
        for predicted in out {
            if let Some(x) = fed_back {
                self.cells.step(&mut memory, x);
            }
            self.cells.outputs(&memory, std::slice::from_mut(predicted));
            *predicted = shortened(*predicted, limit);
            fed_back = Some(*predicted);
        }
    }

    /// Every lead from the newest state, then fading.
    fn direct(&self, leads: usize, limit: f64, out: &mut [[f64; 2]]) {
        let (near, far) = out.split_at_mut(leads.min(out.len()));
        self.cells.outputs(&self.memory, near);
        for predicted in near.iter_mut() {
            *predicted = shortened(*predicted, limit);
        }
        let mut last = near.last().copied().unwrap_or_default();
        for predicted in far {
            last = last.map(|x| x * FADE);
            *predicted = last;
        }
    }

    fn write(&self, state: &mut LstmState) {
        for (wide, narrow) in [(&mut state.h, &self.memory.h), (&mut state.c, &self.memory.c)] {
            for (wide, narrow) in wide.iter_mut().zip(narrow.as_flattened()) {
                *wide = narrow.wide();
            }
        }
        state.x = self.memory.x.map(T::wide);
    }
}
