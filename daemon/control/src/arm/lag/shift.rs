//! The pure shift of the commands that fits the measured joints best.
//!
//! Contract: per candidate shift the variance of the error between measured joints and shifted command about
//! each joint's mean (arms have static offsets), with the caller's weights and forgetting. The minimum is
//! refined by a parabola. No allocation, bounded work.

use crate::arm::track::GRID_S;
use crate::state::state;

/// Candidates, one grid step apart, from [`EARLIEST`] grid steps on.
pub(super) const CANDIDATES: usize = 22;
/// The first candidate looks one grid step ahead, so that a lag of zero lies between two.
pub(super) const EARLIEST: i64 = -1;
/// Two minima are distinct if one error is this many times the other.
const DISTINCT: f64 = 2.0;

/// Sums over the recent motion.
#[derive(Debug, Clone)]
pub(super) struct ShiftBank<const J: usize> {
    weight: f64,
    errors: [Errors<J>; CANDIDATES],
}

state! { [const J: usize] ShiftBank<J> { weight, errors } }

#[derive(Debug, Clone, Copy)]
struct Errors<const J: usize> {
    sum: [f64; J],
    square: f64,
}

state! { [const J: usize] Errors<J> { sum, square } }

impl<const J: usize> ShiftBank<J> {
    pub(super) const fn new() -> Self {
        Self { weight: 0.0, errors: [Errors { sum: [0.0; J], square: 0.0 }; CANDIDATES] }
    }

    /// Weight of everything that is remembered \[grid steps\].
    pub(super) fn weight(&self) -> f64 {
        self.weight
    }

    /// Squared distance \[rad²\] from the measured joints to the nearest of the commands, after subtracting
    /// the mean errors.
    pub(super) fn distance2(&self, measured: &[f64; J], commanded: &[[f64; J]; CANDIDATES]) -> f64 {
        let per_weight = if self.weight > 0.0 { 1.0 / self.weight } else { 0.0 };
        let mut nearest = f64::INFINITY;
        for (errors, commanded) in self.errors.iter().zip(commanded) {
            let mut square = 0.0;
            for (sum, (measured, commanded)) in errors.sum.iter().zip(measured.iter().zip(commanded)) {
                let error = measured - commanded - sum * per_weight;
                square += error * error;
            }
            nearest = nearest.min(square);
        }
        nearest
    }

    /// Adds one sample: measured joints and the command of every candidate, with weight `weight`, after
    /// scaling the evidence so far by `keep`.
    pub(super) fn add(
        &mut self,
        measured: &[f64; J],
        commanded: &[[f64; J]; CANDIDATES],
        keep: f64,
        weight: f64,
    ) {
        self.weight = keep * self.weight + weight;
        for (errors, commanded) in self.errors.iter_mut().zip(commanded) {
            let mut square = 0.0;
            for (sum, (measured, commanded)) in errors.sum.iter_mut().zip(measured.iter().zip(commanded)) {
                let error = measured - commanded;
                *sum = keep * *sum + weight * error;
                square += error * error;
            }
            errors.square = keep * errors.square + weight * square;
        }
    }

    /// Scales the evidence so far by `keep`.
    pub(super) fn fade(&mut self, keep: f64) {
        self.add(&[0.0; J], &[[0.0; J]; CANDIDATES], keep, 0.0);
    }

    /// The best shift \[s\]; `None` without motion, outside the candidates, or when another shift fits about
    /// as well.
    pub(super) fn best(&self) -> Option<f64> {
        let mut curve = [0.0; CANDIDATES];
        for (value, errors) in curve.iter_mut().zip(&self.errors) {
            *value = errors.square - errors.sum.iter().map(|sum| sum * sum).sum::<f64>() / self.weight;
        }
        let (at, least) = minima(&curve).min_by(|a, b| a.1.total_cmp(&b.1))?;
        if minima(&curve).any(|(other, value)| other != at && !(value > DISTINCT * least)) {
            return None;
        }
        let (before, after) = (*curve.get(at.checked_sub(1)?)?, *curve.get(at + 1)?);
        let curvature = before - 2.0 * least + after;
        let offset = 0.5 * (before - after) / curvature;
        let steps = at as f64 + EARLIEST as f64 + offset;
        (curvature > 0.0 && offset.abs() <= 1.0).then_some(steps * GRID_S)
    }
}

/// Inner minima of a curve: index and value.
fn minima(curve: &[f64; CANDIDATES]) -> impl Iterator<Item = (usize, f64)> + '_ {
    curve.windows(3).enumerate().filter_map(|(i, window)| match window {
        [before, here, after] if here < before && here <= after => Some((i + 1, *here)),
        _ => None,
    })
}
