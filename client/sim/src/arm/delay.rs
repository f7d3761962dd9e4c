//! The transport of a target from the sender to the servo: a pure delay, constant, jittering or changing
//! during the run.
//!
//! Contract: in each cycle the servo reads the target of `delay` ago, linear between two cycles' targets. It
//! never reads backwards: when the delay grows it reads the same target again, when it shrinks targets are
//! skipped, as by a controller that keeps the newest one. Deterministic: the jitter is drawn from the seed,
//! one number a cycle. Absent: loss (the consumer of commands bridges it), a limit on how fast the delay may
//! change.

use std::collections::VecDeque;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::JOINTS;

/// Longest delay that is kept \[s\]; longer ones count as this.
pub const MAX_DELAY_S: f64 = 1.0;

/// How late targets reach the servo. Negative or non-finite values count as 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DelaySettings {
    /// Delay \[s\], at most [`MAX_DELAY_S`]; any fraction of a cycle.
    pub delay_s: f64,
    /// Each cycle's delay lies within this about `delay_s` \[s\], evenly spread, never below 0.
    ///
    /// The newest target that arrived counts: jitter of more than a cycle therefore shortens the delay in the
    /// mean.
    pub jitter_s: f64,
    /// Seed of the jitter.
    pub seed: u64,
    /// Another delay from some instant on.
    pub change: Option<DelayChange>,
}

/// A change of the delay during the run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DelayChange {
    /// When, since the arm began to cycle \[s\].
    pub at_s: f64,
    /// The delay from then on \[s\].
    pub delay_s: f64,
}

impl DelaySettings {
    /// Nothing but a constant delay \[s\].
    #[must_use]
    pub fn constant(delay_s: f64) -> Self {
        Self { delay_s, ..Self::default() }
    }

    /// The delay in force at `t_s` after the arm began to cycle, without its jitter \[s\].
    #[must_use]
    pub fn at(&self, t_s: f64) -> f64 {
        match self.change {
            Some(change) if t_s >= change.at_s => legal(change.delay_s),
            _ => legal(self.delay_s),
        }
    }

    fn longest_s(&self) -> f64 {
        let changed = self.change.map_or(0.0, |change| legal(change.delay_s));
        legal(legal(self.delay_s).max(changed) + legal(self.jitter_s))
    }
}

fn legal(seconds: f64) -> f64 {
    if seconds.is_nan() { 0.0 } else { seconds.clamp(0.0, MAX_DELAY_S) }
}

#[derive(Debug, Clone)]
pub(super) struct DelayLine {
    settings: DelaySettings,
    cycle_s: f64,
    rng: Pcg64,
    /// Newest first; as many as the longest delay needs.
    targets: VecDeque<[f64; JOINTS]>,
    /// How many cycles ago the target was sent that the servo reads now.
    age: f64,
    cycles: u64,
}

impl DelayLine {
    /// All targets so far were `q` \[rad\]. `None` where nothing is ever delayed.
    pub(super) fn new(settings: DelaySettings, cycle_s: f64, q: [f64; JOINTS]) -> Option<Self> {
        let longest = settings.longest_s() / cycle_s;
        // Not finite: a cycle of no length.
        if !(longest > 0.0 && longest.is_finite()) {
            return None;
        }
        let targets = VecDeque::from(vec![q; longest.ceil() as usize + 2]);
        let rng = Pcg64::seed_from_u64(settings.seed);
        Some(Self { settings, cycle_s, rng, targets, age: 0.0, cycles: 0 })
    }

    /// Only `target` is on its way, as after a standstill.
    pub(super) fn fill(&mut self, target: [f64; JOINTS]) {
        self.targets.iter_mut().for_each(|sent| *sent = target);
    }

    /// Sends `target`; returns what the servo reads in this cycle.
    pub(super) fn pass(&mut self, target: [f64; JOINTS]) -> [f64; JOINTS] {
        let t_s = self.cycles as f64 * self.cycle_s;
        let jitter_s = legal(self.settings.jitter_s);
        let drawn = if jitter_s > 0.0 { jitter_s * self.rng.random_range(-1.0..=1.0) } else { 0.0 };
        let wanted = legal(self.settings.at(t_s) + drawn) / self.cycle_s;
        let most = (self.targets.len() - 2) as f64;
        // The arm rested before the first cycle, so the initial delay holds at once.
        let never_back = if self.cycles == 0 { wanted } else { self.age + 1.0 };
        self.age = wanted.min(never_back).min(most);
        self.cycles += 1;
        self.targets.pop_back();
        self.targets.push_front(target);
        let (whole, part) = (self.age.floor() as usize, self.age.fract());
        let (newer, older) = (self.targets[whole], self.targets[whole + 1]);
        std::array::from_fn(|axis| newer[axis] + part * (older[axis] - newer[axis]))
    }

    /// Age of the target that the servo read last \[s\].
    pub(super) fn age_s(&self) -> f64 {
        self.age * self.cycle_s
    }
}
