//! Back-propagation through time over eight sequences at once, fused: no matrix of the whole batch is ever
//! formed.
//!
//! Contract: the gradient is that of the objective over the whole batch (its denominator is given), summed
//! over lanes and steps in a fixed order. All buffers are reused from group to group.

use foretrace_control::predict::models::activation::{sigmoid, tanh};

use super::corpus::Strokes;
use super::loss::{Objective, Padding, PreparedLoss};
use super::parameters::{LstmNetwork, LstmShape, PackedGradient, PackedWeights};
use super::real::{EightLanes, LANES, Real};

/// Up to eight sequences and the activations of their steps for the backward pass.
#[derive(Debug, Clone)]
pub(super) struct LaneGroup<F> {
    shape: LstmShape,
    /// Steps that are run: all but the last one of the longest lane.
    steps: usize,
    /// Displacements \[input scales\] as recorded, steps + 1 x 2: the targets.
    real: Vec<EightLanes<F>>,
    /// 0 where the state is forgotten before the step, else 1.
    keep: Vec<EightLanes<F>>,
    /// Leads to score after each step.
    horizon: Vec<[u16; LANES]>,
    /// Steps x (3 + H): cut input x, y, then 1, then the state h that the step starts from.
    input: Vec<EightLanes<F>>,
    /// Steps x 4H: activated gates, in the backward pass the derivatives of their arguments; `[cell][gate]`.
    gates: Vec<EightLanes<F>>,
    /// Steps + 1 x H: cell state before each step, last after the last.
    cell: Vec<EightLanes<F>>,
    /// Steps x H: tanh of the cell state after the step.
    squashed: Vec<EightLanes<F>>,
    /// Steps x (1 + H): 1, then h after the step.
    output: Vec<EightLanes<F>>,
    /// Steps x 2K: predictions, in the backward pass the loss's derivatives.
    y: Vec<EightLanes<F>>,
    /// Derivatives carried from step to step, by h and by the cell state; a whole number of blocks of four.
    by_h: Vec<EightLanes<F>>,
    by_cell: Vec<EightLanes<F>>,
}

impl<F: Real> LaneGroup<F> {
    pub(super) fn new(shape: LstmShape) -> Self {
        let padded = shape.cells.next_multiple_of(4);
        Self {
            shape,
            steps: 0,
            real: Vec::new(),
            keep: Vec::new(),
            horizon: Vec::new(),
            input: Vec::new(),
            gates: Vec::new(),
            cell: Vec::new(),
            squashed: Vec::new(),
            output: Vec::new(),
            y: Vec::new(),
            by_h: vec![EightLanes::default(); padded],
            by_cell: vec![EightLanes::default(); padded],
        }
    }

    /// Takes over up to eight sequences of raw displacements, to be divided by `scale`; `longest` is the
    /// batch's.
    ///
    /// Returns the weight of this group's targets in the batch's mean.
    pub(super) fn load(
        &mut self,
        network: &LstmNetwork,
        objective: &Objective,
        scale: f64,
        lanes: &[&Strokes],
        longest: usize,
    ) -> f64 {
        let own = lanes.iter().map(|s| s.v.len()).max().unwrap_or(0);
        let counted = objective.padding == Padding::Counted;
        let length = if counted { longest } else { own };
        self.steps = length.saturating_sub(1);
        let inputs = self.shape.cells + 3;
        let zero = EightLanes::default();
        self.real.clear();
        self.real.resize(2 * length, zero);
        self.keep.clear();
        self.keep.resize(self.steps, EightLanes::splat(F::ONE));
        self.horizon.clear();
        self.horizon.resize(self.steps, [0; LANES]);
        // The forward pass writes every entry of these before it is read.
        self.input.resize(self.steps * inputs, zero);
        self.gates.resize(self.steps * 4 * self.shape.cells, zero);
        self.cell.resize(length.max(1) * self.shape.cells, zero);
        self.squashed.resize(self.steps * self.shape.cells, zero);
        self.output.resize(self.steps * (self.shape.cells + 1), zero);
        self.y.resize(self.steps * 2 * self.shape.leads, zero);
        let mut weight = 0.0;
        for (l, strokes) in lanes.iter().enumerate().take(LANES) {
            for (t, [x, y]) in strokes.v.iter().take(length).enumerate() {
                self.real[2 * t].0[l] = F::of(x / scale);
                self.real[2 * t + 1].0[l] = F::of(y / scale);
                let resets = network.reset_beyond.is_some_and(|gate| strokes.length(t) > gate * scale);
                if resets && t < self.steps {
                    self.keep[t].0[l] = F::default();
                }
            }
            let scored = if counted { length } else { strokes.v.len() };
            for (t, horizon) in
                objective.horizons(strokes, scored, scale).into_iter().enumerate().take(self.steps)
            {
                self.horizon[t][l] = horizon.min(usize::from(u16::MAX)) as u16;
                weight += objective.weight(horizon);
            }
        }
        weight
    }

    /// Runs the network over all steps; predictions stand in `y` afterwards.
    #[inline(always)]
    pub(super) fn forward(&mut self, network: &LstmNetwork, packed: &PackedWeights<F>) {
        let LstmShape { cells, leads } = self.shape;
        let (inputs, outputs) = (cells + 3, 2 * leads);
        let clip = network.clip.map(F::of);
        let mut h = std::mem::take(&mut self.by_h);
        h.fill(EightLanes::default());
        self.cell[..cells].fill(EightLanes::default());
        for t in 0..self.steps {
            let keep = self.keep[t];
            let u = &mut self.input[t * inputs..(t + 1) * inputs];
            for axis in 0..2 {
                let x = self.real[2 * t + axis] * keep;
                u[axis] = clip.map_or(x, |limit| x.clamp(limit));
            }
            u[2] = EightLanes::splat(F::ONE);
            for (u, h) in u[3..].iter_mut().zip(&h) {
                *u = *h * keep;
            }
            let gates = &mut self.gates[t * 4 * cells..(t + 1) * 4 * cells];
            for (weights, gates) in packed.forward.chunks_exact(inputs).zip(gates.chunks_exact_mut(4)) {
                let mut z = [EightLanes::<F>::default(); 4];
                for (w, u) in weights.iter().zip(&*u) {
                    for gate in 0..4 {
                        z[gate].add_scaled(w[gate], *u);
                    }
                }
                gates.copy_from_slice(&z);
            }
            // In loops of their own: the long chains of the activations overlap from cell to cell.
            let (before, after) = self.cell[t * cells..].split_at_mut(cells);
            for ((gates, before), after) in gates.chunks_exact_mut(4).zip(before).zip(&mut *after) {
                let [i, f] = [gates[0].map(sigmoid), gates[1].map(sigmoid)];
                let [g, o] = [gates[2].map(tanh), gates[3].map(sigmoid)];
                gates.copy_from_slice(&[i, f, g, o]);
                *after = f * (*before * keep) + i * g;
            }
            let squashed = &mut self.squashed[t * cells..(t + 1) * cells];
            let out = &mut self.output[t * (cells + 1)..(t + 1) * (cells + 1)];
            out[0] = EightLanes::splat(F::ONE);
            for (j, (squashed, after)) in squashed.iter_mut().zip(after).enumerate() {
                *squashed = after.map(tanh);
                h[j] = gates[4 * j + 3] * *squashed;
                out[1 + j] = h[j];
            }
            for (o, weights) in packed.out.chunks_exact(cells + 1).enumerate() {
                let mut y = if network.residual { u[o % 2] } else { EightLanes::default() };
                for (w, h) in weights.iter().zip(&*out) {
                    y.add_scaled(*w, *h);
                }
                self.y[t * outputs + o] = y;
            }
        }
        self.by_h = h;
    }

    /// Prediction of the displacement lead + 1 steps after step t in one lane \[input scales\].
    pub(super) fn lead(&self, t: usize, lead: usize, lane: usize) -> [f64; 2] {
        let at = 2 * (t * self.shape.leads + lead);
        [self.y[at].0[lane].wide(), self.y[at + 1].0[lane].wide()]
    }

    /// The objective's sum over the group, not divided by the weight; `y` turns into its derivatives.
    #[inline(always)]
    pub(super) fn score(&mut self, loss: &PreparedLoss<F>) -> f64 {
        let outputs = 2 * self.shape.leads;
        let mut total = EightLanes::<F>::default();
        for t in 0..self.steps {
            let y = &mut self.y[t * outputs..(t + 1) * outputs];
            total = total + loss.differentiate(y, &self.real[2 * (t + 1)..], &self.horizon[t]);
        }
        total.0.iter().map(|lane| lane.wide()).sum()
    }

    /// Adds the gradient to `gradient`; after `forward` and `score`.
    #[inline(always)]
    pub(super) fn backward(&mut self, packed: &PackedWeights<F>, gradient: &mut PackedGradient<F>) {
        let LstmShape { cells, leads } = self.shape;
        let (inputs, outputs) = (cells + 3, 2 * leads);
        self.by_h.fill(EightLanes::default());
        self.by_cell.fill(EightLanes::default());
        // As many steps at a time as the caches hold beside the weights.
        let chunk = (640 / cells).max(16);
        let mut end = self.steps;
        while end > 0 {
            let begin = end.saturating_sub(chunk);
            for t in (begin..end).rev() {
                self.step_back(t, packed);
            }
            let span = |width: usize| begin * width..end * width;
            outer_sums::<F, 4>(
                &self.gates[span(4 * cells)],
                &self.input[span(inputs)],
                (4 * cells, inputs),
                |row, column, sums| {
                    let into = &mut gradient.layer[row / 4 * inputs + column];
                    for gate in 0..4 {
                        into[gate] += sums[gate];
                    }
                },
            );
            outer_sums::<F, 2>(
                &self.y[span(outputs)],
                &self.output[span(cells + 1)],
                (outputs, cells + 1),
                |row, column, sums| {
                    gradient.out[row * (cells + 1) + column] += sums[0];
                    gradient.out[(row + 1) * (cells + 1) + column] += sums[1];
                },
            );
            end = begin;
        }
    }

    /// From the derivatives after step t to those of its gates' arguments and of the state before it.
    #[inline(always)]
    fn step_back(&mut self, t: usize, packed: &PackedWeights<F>) {
        let LstmShape { cells, leads } = self.shape;
        let outputs = 2 * leads;
        let keep = self.keep[t];
        let y = &self.y[t * outputs..(t + 1) * outputs];
        let before = &self.cell[t * cells..(t + 1) * cells];
        let squashed = &self.squashed[t * cells..(t + 1) * cells];
        let gates = &mut self.gates[t * 4 * cells..(t + 1) * 4 * cells];
        let one = EightLanes::splat(F::ONE);
        for (j, (gates, weights)) in
            gates.chunks_exact_mut(4).zip(packed.out_back.chunks_exact(outputs)).enumerate()
        {
            let mut dh = self.by_h[j];
            for (w, dy) in weights.iter().zip(y) {
                dh.add_scaled(*w, *dy);
            }
            let [i, f, g, o] = [gates[0], gates[1], gates[2], gates[3]];
            let tc = squashed[j];
            let dc = self.by_cell[j] + dh * o * (one - tc * tc);
            gates[0] = dc * g * i * (one - i);
            gates[1] = dc * (before[j] * keep) * f * (one - f);
            gates[2] = dc * i * (one - g * g);
            gates[3] = dh * tc * o * (one - o);
            self.by_cell[j] = dc * f * keep;
        }
        let blocks = packed.back.chunks_exact(4 * cells).zip(self.by_h.chunks_exact_mut(4));
        for (weights, into) in blocks {
            let mut dh = [EightLanes::<F>::default(); 4];
            for (w, dz) in weights.iter().zip(&*gates) {
                for k in 0..4 {
                    dh[k].add_scaled(w[k], *dz);
                }
            }
            for (into, dh) in into.iter_mut().zip(dh) {
                *into = dh * keep;
            }
        }
    }
}

/// Sums of a[t][row] b[t][column] over steps and lanes, R rows of one column at a time handed to `into`.
///
/// `a` is steps x `widths.0` (a multiple of R), `b` steps x `widths.1`.
#[inline(always)]
fn outer_sums<F: Real, const R: usize>(
    a: &[EightLanes<F>],
    b: &[EightLanes<F>],
    widths: (usize, usize),
    mut into: impl FnMut(usize, usize, [F; R]),
) {
    let (rows, columns) = widths;
    for row in (0..rows).step_by(R) {
        let mut column = 0;
        while column < columns {
            // Two columns share the loads of the rows; an odd last one goes alone.
            let pair = column + 1 < columns;
            let other = if pair { column + 1 } else { column };
            let mut sums = [[EightLanes::<F>::default(); R]; 2];
            for (a, b) in a.chunks_exact(rows).zip(b.chunks_exact(columns)) {
                let a = &a[row..row + R];
                let (left, right) = (b[column], b[other]);
                for r in 0..R {
                    sums[0][r].add_product(a[r], left);
                    sums[1][r].add_product(a[r], right);
                }
            }
            let [left, right] = over_lanes(&sums);
            into(row, column, left);
            if pair {
                into(row, other, right);
            }
            column += 2;
        }
    }
}

/// Sums over the lanes.
///
/// Never inlined: with these sums in sight the compiler reorders the loop before them, at half the speed.
#[inline(never)]
fn over_lanes<F: Real, const R: usize>(sums: &[[EightLanes<F>; R]; 2]) -> [[F; R]; 2] {
    sums.map(|column| column.map(EightLanes::sum))
}
