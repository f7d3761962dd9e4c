//! What training minimises: errors of predicted displacements, and of the positions they sum to.
//!
//! After input t, lead i is scored against the displacement of step t+i (`step`) and the sum of steps
//! t+1..=t+i (`position`), per component. The mean is weighted: sum of w rho(e) over sum of w, both
//! components counted. Absent: targets inside a jump and beyond the end of a sequence, unless the padding is
//! counted (as in the paper).

use super::corpus::Strokes;
use super::real::{EightLanes, LANES, Real};

/// How an error is punished.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Penalty {
    /// e^2.
    Squared,
    /// e^2 / 2 up to `delta`, straight beyond (PyTorch's HuberLoss); for positions at lead i, `delta` x i.
    Huber {
        /// Units of the input scale.
        delta: f64,
    },
}

/// What happens beyond the end of a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Padding {
    /// All sequences of a batch are filled with zero steps to the longest, and these count ("zero-padded for
    /// uniformity").
    Counted,
    /// Only real steps count.
    Masked,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Objective {
    /// How an error is punished.
    pub penalty: Penalty,
    /// What happens beyond the end of a sequence.
    pub padding: Padding,
    /// Steps that are known to be jumps or are longer than this \[input scales\] are no targets, nor is what
    /// lies beyond.
    pub gate: Option<f64>,
    /// Weight of the displacement at each lead, K long.
    pub step: Vec<f64>,
    /// Weight of the position at each lead, K long.
    pub position: Vec<f64>,
}

impl Objective {
    /// The paper's: mean squared error of the next step, the padding counted.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            penalty: Penalty::Squared,
            padding: Padding::Counted,
            gate: None,
            step: vec![1.0],
            position: vec![0.0],
        }
    }

    /// Leads that can be scored after input t: those before the end, before the next jump and within K.
    pub(super) fn horizons(&self, strokes: &Strokes, length: usize, scale: f64) -> Vec<usize> {
        let leads = self.step.len();
        let mut free = 0;
        let mut horizons = vec![0; length];
        for t in (0..length.saturating_sub(1)).rev() {
            let jumps = |gate: f64| strokes.jumps(t + 1) || strokes.length(t + 1) > gate * scale;
            free = if self.gate.is_some_and(jumps) { 0 } else { free + 1 };
            horizons[t] = free.min(leads);
        }
        horizons
    }

    /// Weight that a target with `horizon` leads brings to the mean's denominator.
    pub(super) fn weight(&self, horizon: usize) -> f64 {
        2.0 * self.step.iter().zip(&self.position).take(horizon).map(|(s, p)| s + p).sum::<f64>()
    }

    pub(super) fn prepared<F: Real>(&self) -> PreparedLoss<F> {
        PreparedLoss {
            delta: match self.penalty {
                Penalty::Squared => None,
                Penalty::Huber { delta } => Some(F::of(delta)),
            },
            step: self.step.iter().map(|&w| F::of(w)).collect(),
            position: self.position.iter().map(|&w| F::of(w)).collect(),
            positions: self.position.iter().any(|&w| w != 0.0),
        }
    }
}

/// An [`Objective`] in the kernels' type.
#[derive(Debug, Clone)]
pub(super) struct PreparedLoss<F> {
    delta: Option<F>,
    step: Vec<F>,
    position: Vec<F>,
    positions: bool,
}

impl<F: Real> PreparedLoss<F> {
    /// Turns the predictions `y` (2K rows) after input t into the loss's derivative ; returns the loss's
    /// lanes. Neither is divided by the weight yet.
    ///
    /// `targets` are the steps from t+1 on, `[step][component]`; fewer than K where no lane has more.
    /// `horizon` is each lane's number of leads to score.
    #[inline(always)]
    pub(super) fn differentiate(
        &self,
        y: &mut [EightLanes<F>],
        targets: &[EightLanes<F>],
        horizon: &[u16; LANES],
    ) -> EightLanes<F> {
        let mut loss = EightLanes::default();
        let known = y.len().min(targets.len());
        let (scored, unknown) = y.split_at_mut(known);
        unknown.fill(EightLanes::default());
        let mut travelled = [EightLanes::<F>::default(); 2];
        for (row, (y, target)) in scored.iter_mut().zip(targets).enumerate() {
            *y = *y - *target;
            travelled[row % 2] = travelled[row % 2] + *y;
        }
        // From the last lead back: a displacement moves all positions from its lead on.
        let mut later = [EightLanes::<F>::default(); 2];
        for (row, y) in scored.iter_mut().enumerate().rev() {
            let (lead, axis) = (row / 2, row % 2);
            let (mask, error) = (mask(horizon, lead), *y);
            let (value, slope) = self.penalise(error, F::ONE);
            loss.add_scaled(self.step[lead], value * mask);
            if self.positions {
                let (value, slope) = self.penalise(travelled[axis], F::of((lead + 1) as f64));
                loss.add_scaled(self.position[lead], value * mask);
                later[axis].add_scaled(self.position[lead], slope * mask);
                travelled[axis] = travelled[axis] - error;
            }
            let mut derivative = later[axis];
            derivative.add_scaled(self.step[lead], slope * mask);
            *y = derivative;
        }
        loss
    }

    /// Value and slope of the penalty, its corner at `delta` x `reach`.
    #[inline(always)]
    fn penalise(&self, error: EightLanes<F>, reach: F) -> (EightLanes<F>, EightLanes<F>) {
        match self.delta {
            None => (error * error, error + error),
            Some(delta) => {
                let slope = error.clamp(delta * reach);
                // |e| <= d: e e - e e / 2; beyond: +-d e - d d / 2.
                (slope * (error - slope.map(|s| s * F::of(0.5))), slope)
            }
        }
    }
}

#[inline(always)]
fn mask<F: Real>(horizon: &[u16; LANES], lead: usize) -> EightLanes<F> {
    let mut mask = EightLanes::default();
    for l in 0..LANES {
        mask.0[l] = if usize::from(horizon[l]) > lead { F::ONE } else { F::default() };
    }
    mask
}
