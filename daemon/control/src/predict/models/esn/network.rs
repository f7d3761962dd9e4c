//! `Network`: the arithmetic of a reservoir and its read-out in one precision, laid out for the processor's
//! vectors.
//!
//! Units are stored in B blocks of W (the last one padded with zero units), so that a block's sums fit into
//! the registers during one pass over the state.

use crate::predict::models::activation::{Scalar, tanh};
use crate::predict::models::dybm::{DybmState, DybmWeights};
use crate::predict::models::esn::{ReservoirState, UNITS};
use crate::predict::shortened;

/// Two blocks of 13 vectors.
pub(super) type Double = ReservoirMatrices<f64, 26, 2>;
/// One block of 13 vectors.
pub(super) type Single = ReservoirMatrices<f32, 52, 1>;

/// W_in and W_rec, packed by block.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReservoirMatrices<T, const W: usize, const B: usize> {
    leak: T,
    /// 1 − leak.
    keep: T,
    /// B x 2 x W.
    input: [[[T; W]; 2]; B],
    /// B x UNITS x W; row j holds unit j's weights to the block.
    recurrent: [[[T; W]; UNITS]; B],
}

impl<T: Scalar, const W: usize, const B: usize> ReservoirMatrices<T, W, B> {
    pub(super) fn new(leak: f64, input: &[ReservoirState; 2], recurrent: &[ReservoirState; UNITS]) -> Self {
        let column = |rows: &[ReservoirState], j: usize, unit: usize| {
            T::of(rows.get(j).and_then(|row| row.get(unit)).copied().unwrap_or(0.0))
        };
        Self {
            leak: T::of(leak),
            keep: T::of(1.0 - leak),
            input: blocks(|j, unit| column(input, j, unit)),
            recurrent: blocks(|j, unit| column(recurrent, j, unit)),
        }
    }

    /// s ← (1 − leak)·s + leak·tanh(x W_in + s W_rec).
    #[inline]
    pub(super) fn step(&self, state: &mut [T; UNITS], x: [T; 2]) {
        let mut driven = [[T::ZERO; W]; B];
        for ((input, recurrent), driven) in self.input.iter().zip(&self.recurrent).zip(&mut driven) {
            let mut sums = [T::ZERO; W];
            for (row, x) in input.iter().zip(&x) {
                for (sum, w) in sums.iter_mut().zip(row) {
                    *sum += *x * *w;
                }
            }
            for (row, s) in recurrent.iter().zip(state.iter()) {
                for (sum, w) in sums.iter_mut().zip(row) {
                    *sum += *s * *w;
                }
            }
            *driven = sums.map(tanh);
        }
        for (s, driven) in state.iter_mut().zip(driven.as_flattened()) {
            *s = self.keep * *s + self.leak * *driven;
        }
    }

    /// Predicts `out.len()` steps of DyBM and read-out, each prediction (shortened to `limit`) fed back.
    pub(super) fn roll_out(
        &self,
        dybm: (&DybmWeights, &DybmState),
        readout: (&[[T; 2]; UNITS], &ReservoirState),
        limit: f64,
        out: &mut [[f64; 2]],
    ) {
        let (weights, mut memory) = (dybm.0, *dybm.1);
        let (readout, mut state) = (readout.0, readout.1.map(T::of));
        let mut fed_back = None;
        for predicted in out {
            if let Some(x) = fed_back {
                memory.observe(&weights.shape, x);
                self.step(&mut state, x.map(T::of));
            }
            let ([x, y], [dx, dy]) = (weights.predict(&memory), read(readout, &state));
            *predicted = shortened([x + dx.wide(), y + dy.wide()], limit);
            fed_back = Some(*predicted);
        }
    }
}

/// s A, summed in ten lanes.
#[inline]
pub(super) fn read<T: Scalar>(readout: &[[T; 2]; UNITS], state: &[T; UNITS]) -> [T; 2] {
    const LANES: usize = 10;
    let mut lanes = [[T::ZERO; 2]; LANES];
    for (rows, states) in readout.as_chunks::<LANES>().0.iter().zip(state.as_chunks::<LANES>().0) {
        for ((lane, row), s) in lanes.iter_mut().zip(rows).zip(states) {
            for (sum, a) in lane.iter_mut().zip(row) {
                *sum += *s * *a;
            }
        }
    }
    lanes.iter().fold([T::ZERO; 2], |[x, y], [dx, dy]| [x + *dx, y + *dy])
}

/// `entry(row, unit)` in blocks of units.
fn blocks<T, const W: usize, const ROWS: usize, const B: usize>(
    entry: impl Fn(usize, usize) -> T,
) -> [[[T; W]; ROWS]; B] {
    std::array::from_fn(|block| {
        std::array::from_fn(|row| std::array::from_fn(|lane| entry(row, block * W + lane)))
    })
}
