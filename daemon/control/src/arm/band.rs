//! Band-pass of joint positions on the grid: what passes is free of offsets, of drift and of most noise.
//!
//! Contract: a difference over `L` grid steps, then three running sums of as many. The middle of the band is
//! near 0.27/L per grid step. Commands and joint states pass the same filter, which changes no relation
//! between them. No allocation, bounded work.

use crate::state::state;

/// The difference and the sums.
pub(in crate::arm) const STAGES: usize = 4;

/// The filter, for all joints.
#[derive(Debug, Clone)]
pub(in crate::arm) struct Band<const J: usize, const L: usize> {
    /// Inputs of the difference and of each sum, as rings.
    entered: [[[f64; J]; L]; STAGES],
    sums: [[f64; J]; STAGES - 1],
    at: usize,
}

state! { whole [const J: usize, const L: usize] Band<J, L> { entered, sums, at } }

impl<const J: usize, const L: usize> Band<J, L> {
    /// As if the joints had been at `q` \[rad\] for ever.
    pub(in crate::arm) fn at_rest(q: &[f64; J]) -> Self {
        let mut entered = [[[0.0; J]; L]; STAGES];
        let [differenced, ..] = &mut entered;
        *differenced = [*q; L];
        Self { entered, sums: [[0.0; J]; STAGES - 1], at: 0 }
    }

    /// What comes out when `q` goes in.
    pub(in crate::arm) fn pass(&mut self, q: &[f64; J]) -> [f64; J] {
        let mut x = *q;
        let mut sums = self.sums.iter_mut();
        for (stage, ring) in self.entered.iter_mut().enumerate() {
            let Some(slot) = ring.get_mut(self.at) else { continue };
            let left = std::mem::replace(slot, x);
            for (x, left) in x.iter_mut().zip(left) {
                *x -= left;
            }
            if stage > 0
                && let Some(sum) = sums.next()
            {
                for (x, sum) in x.iter_mut().zip(sum) {
                    *sum += *x;
                    *x = *sum * (1.0 / L as f64);
                }
            }
        }
        self.at = (self.at + 1) % L;
        x
    }
}

/// Puts `value` first; drops the last one.
pub(in crate::arm) fn push<T, const M: usize>(register: &mut [T; M], value: T) {
    register.rotate_right(1);
    if let Some(first) = register.first_mut() {
        *first = value;
    }
}
