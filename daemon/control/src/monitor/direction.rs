//! A joint that moves against its commands, judged at the lag that the other joints show.
//!
//! Contract: small letters mirrored stay inside the span of their commands, and mirrored oscillation looks
//! like oscillation half a period late. But all joints of an arm have the same lag: at the lag that explains
//! the others best, a mirrored joint is anticorrelated. All sums forget by [`KEEP`]; a change of the lag
//! passes through them before a fault is reported.

use super::path::RangeHistory;
use crate::state::state;

/// Candidate lags: 0, 10, ... 200 ms.
const LAGS: usize = 21;
/// Forgetting factor of each sum from block to block: 1/e in 0.3 s.
const KEEP: f64 = 0.967;
/// Judged once in this many blocks.
const EVERY: u64 = 4;
/// Findings in a row before a fault is reported: 0.32 s, longer than the memory of the sums.
const IN_A_ROW: u32 = 8;
/// Least correlation of the other joints with their commands, and least anticorrelation of the faulty one.
const AGREES: f64 = 0.8;
const AGAINST: f64 = -0.5;

/// Sums over recent motion.
#[derive(Debug, Clone)]
pub(super) struct Directions<const J: usize> {
    /// Per lag and joint: Σ measured · commanded step, and Σ of the squared commanded step.
    products: [[f64; J]; LAGS],
    asked: [[f64; J]; LAGS],
    /// Σ of the squared measured step, and of its absolute value.
    done: [f64; J],
    travel: [f64; J],
    in_a_row: [u32; J],
}

state! { [const J: usize] Directions<J> { products, asked, done, travel, in_a_row } }

impl<const J: usize> Directions<J> {
    pub(super) const fn new() -> Self {
        Self {
            products: [[0.0; J]; LAGS],
            asked: [[0.0; J]; LAGS],
            done: [0.0; J],
            travel: [0.0; J],
            in_a_row: [0; J],
        }
    }

    /// Called when block `block` of the measured joints is complete. Returns a joint that moved against its
    /// commands by more than `limit` \[rad\], as travel within the memory, and by how much.
    pub(super) fn see(
        &mut self,
        block: u64,
        measured: &RangeHistory<J>,
        commands: &RangeHistory<J>,
        limit: f64,
    ) -> Option<(usize, f64)> {
        let step = measured.step(block)?;
        for ((done, travel), step) in self.done.iter_mut().zip(&mut self.travel).zip(&step) {
            *done = KEEP * *done + step * step;
            *travel = KEEP * *travel + step.abs();
        }
        for (lag, (products, asked)) in (0..).zip(self.products.iter_mut().zip(&mut self.asked)) {
            let command = block.checked_sub(lag).and_then(|then| commands.step(then)).unwrap_or([0.0; J]);
            let joints = products.iter_mut().zip(asked).zip(step.iter().zip(&command));
            for ((product, asked), (step, command)) in joints {
                *product = KEEP * *product + step * command;
                *asked = KEEP * *asked + command * command;
            }
        }
        if block.is_multiple_of(EVERY) { self.judge(limit) } else { None }
    }

    fn judge(&mut self, limit: f64) -> Option<(usize, f64)> {
        let scale = |asked: f64, done: f64| (asked * done).sqrt();
        // Per lag: correlation of all joints together, as numerator and denominator.
        let mut whole = [[0.0; 2]; LAGS];
        for (whole, (products, asked)) in whole.iter_mut().zip(self.products.iter().zip(&self.asked)) {
            let scales = asked.iter().zip(&self.done).map(|(asked, done)| scale(*asked, *done));
            *whole = [products.iter().sum(), scales.sum()];
        }
        let all: f64 = self.travel.iter().sum();
        let mut found = None;
        let joints = self.travel.iter().zip(&self.done).zip(&mut self.in_a_row).enumerate();
        for (joint, ((travel, done), in_a_row)) in joints {
            let of = |numbers: &[f64; J]| numbers.get(joint).copied().unwrap_or_default();
            let mut best = [f64::NEG_INFINITY, 0.0];
            if *travel > limit && all - travel > limit {
                let sums = whole.iter().zip(self.products.iter().zip(&self.asked));
                for ([product, size], (products, asked)) in sums {
                    let own = [of(products), scale(of(asked), *done)];
                    let [own_product, own_size] = own;
                    let others = (product - own_product) / (size - own_size).max(f64::MIN_POSITIVE);
                    let [most, _] = best;
                    if others > most {
                        best = [others, own_product / own_size.max(f64::MIN_POSITIVE)];
                    }
                }
            }
            let [others, own] = best;
            *in_a_row = if others > AGREES && own < AGAINST { *in_a_row + 1 } else { 0 };
            if *in_a_row >= IN_A_ROW && found.is_none() {
                found = Some((joint, *travel));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Stamp;

    /// Three joints that write small circles at `hz`, 0.1 s late; joint 0 mirrored or not. Returns the block
    /// in which it is reported.
    fn blamed(sign: f64, hz: f64, lag_change: bool) -> Option<u64> {
        let (mut commands, mut measured) = (RangeHistory::<3>::new(), RangeHistory::<3>::new());
        let mut directions = Directions::new();
        let at = |t: f64| {
            let phase = std::f64::consts::TAU * hz * t;
            [0.01 * phase.cos(), 0.01 * phase.sin(), 0.008 * (phase + 1.0).cos()]
        };
        for tick in 0..2000_u64 {
            let t = tick as f64 * 2e-3;
            let stamp = Stamp(tick * 2_000_000);
            commands.push(stamp, &at(t));
            let late = if lag_change && t > 2.0 { 0.18 } else { 0.1 };
            let [a, b, c] = at((t - late).max(0.0));
            measured.push(stamp, &[sign * a, b, c]);
            let block = measured.newest();
            if tick.is_multiple_of(5)
                && block > 0
                && let Some((joint, travel)) = directions.see(block - 1, &measured, &commands, 0.012)
            {
                assert_eq!(joint, 0);
                assert!(travel > 0.012);
                return Some(block);
            }
        }
        None
    }

    #[test]
    fn only_the_joint_that_is_turned_about_is_blamed() {
        for hz in [1.5, 2.5, 4.0] {
            let block = blamed(-1.0, hz, false).expect("turned about");
            assert!(block < 120, "{hz} Hz: after {block} blocks");
            assert_eq!(blamed(1.0, hz, false), None);
            assert_eq!(blamed(1.0, hz, true), None, "{hz} Hz: a change of the lag is no fault");
        }
    }

    /// Every sum over all complete blocks, weighted by 0.967 per block of age.
    #[test]
    fn sums_are_over_the_steps_of_all_blocks_and_forget() {
        let (mut commands, mut measured) = (RangeHistory::<2>::new(), RangeHistory::<2>::new());
        let mut directions = Directions::new();
        let at = |t: f64| [0.3 * (9.0 * t).sin(), 0.2 * (5.0 * t).cos()];
        let (mut asked, mut done): (Vec<[f64; 2]>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
        for tick in 0..400_u64 {
            let (t, stamp) = (tick as f64 * 2e-3, Stamp(1_000_000_000 + tick * 2_000_000));
            commands.push(stamp, &at(t));
            measured.push(stamp, &at(t - 0.03).map(|q| 0.7 * q));
            // The first sample of a block closes the one before; the first block of a path has no step.
            if tick % 5 == 0 && tick >= 10 {
                let block = measured.newest() - 1;
                asked.push(commands.step(block).unwrap());
                done.push(measured.step(block).unwrap());
                assert_eq!(directions.see(block, &measured, &commands, 10.0), None);
            }
        }
        let kept = |age: usize| KEEP.powi(age as i32);
        let count = done.len();
        for joint in 0..2 {
            let sum =
                |of: &dyn Fn(usize) -> f64| (0..count).map(|k| kept(count - 1 - k) * of(k)).sum::<f64>();
            let close = |found: f64, expected: f64| {
                assert!((found - expected).abs() <= 1e-9 * expected.abs(), "{found} {expected}");
            };
            close(directions.done[joint], sum(&|k| done[k][joint].powi(2)));
            close(directions.travel[joint], sum(&|k| done[k][joint].abs()));
            for lag in [0, 3, LAGS - 1] {
                let command = |k: usize| k.checked_sub(lag).map_or(0.0, |k| asked[k][joint]);
                close(directions.asked[lag][joint], sum(&|k| command(k).powi(2)));
                close(directions.products[lag][joint], sum(&|k| command(k) * done[k][joint]));
            }
        }
    }
}
