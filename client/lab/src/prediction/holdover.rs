//! [`Holdover`]: what bridges a late target where nothing predicts: the stream's last velocity, for 80 ms.
//!
//! The look-ahead time is how late the target is. `late-constant-velocity` keeps the velocity for 80 ms, then
//! stands still; `late-holdover` lets it fall linearly to rest within 80 ms, as the core of Axol does
//! (almond-bot/axol, pull request 306, "Core carries a late target along the stream's velocity"). The
//! velocity is that of the last step; Axol smooths it lightly.

use super::model::Contestant;

/// How long a late target is carried on \[ns\].
const CARRIED_NS: f64 = 8e7;

/// What becomes of the velocity while the target is late.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Carried {
    /// It stays, and ends at once.
    Constant,
    /// It falls linearly to rest.
    Ramped,
}

/// Carries the last displacement on.
#[derive(Debug, Clone)]
pub(super) struct Holdover {
    carried: Carried,
    /// Steps of the device in the time that a target is carried on.
    steps: f64,
    last: [f64; 2],
}

impl Holdover {
    /// For a device with steps of `step_ns`.
    pub(super) fn new(carried: Carried, step_ns: f64) -> Self {
        Self { carried, steps: CARRIED_NS / step_ns, last: [0.0; 2] }
    }

    /// How many of the last displacement the target has gone on `late` steps after it.
    fn reach(&self, late: f64) -> f64 {
        let late = late.min(self.steps);
        match self.carried {
            Carried::Constant => late,
            Carried::Ramped => late - late * late / (2.0 * self.steps),
        }
    }
}

impl Contestant for Holdover {
    fn start_sequence(&mut self) {
        self.last = [0.0; 2];
    }

    fn new_stroke(&mut self, _v: [f64; 2]) {
        self.last = [0.0; 2];
    }

    fn observe(&mut self, v: [f64; 2]) {
        self.last = v;
    }

    fn preview(&self, out: &mut [[f64; 2]]) {
        let mut before = 0.0;
        for (index, slot) in out.iter_mut().enumerate() {
            let reach = self.reach((index + 1) as f64);
            *slot = self.last.map(|v| v * (reach - before));
            before = reach;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn positions(carried: Carried, step_ms: f64) -> Vec<f64> {
        let mut model = Holdover::new(carried, step_ms * 1e6);
        model.start_sequence();
        [[9.0, 9.0], [2.0, -4.0]].into_iter().for_each(|v| model.observe(v));
        let mut out = [[0.0; 2]; 12];
        model.preview(&mut out);
        assert!(out.iter().all(|[x, y]| (y + 2.0 * x).abs() < 1e-12), "{out:?}");
        let mut sum = 0.0;
        let add = |[x, _]: &[f64; 2]| {
            sum += x;
            sum
        };
        out.iter().map(add).collect()
    }

    #[test]
    fn constant_velocity_ends_after_80_ms() {
        let ten_ms = positions(Carried::Constant, 10.0);
        assert_eq!(ten_ms[..8], [2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0]);
        assert_eq!(ten_ms[8..], [16.0; 4]);
        // 80 ms are 2.67 steps of 30 ms.
        let thirty_ms = positions(Carried::Constant, 30.0);
        assert!((thirty_ms[2] - 2.0 * 8.0 / 3.0).abs() < 1e-12 && thirty_ms[11] == thirty_ms[2]);
    }

    #[test]
    fn a_ramp_goes_half_as_far_and_slower_from_the_start() {
        let ramp = positions(Carried::Ramped, 10.0);
        // v (τ − τ²/16) with v = 2 per step of 10 ms.
        for (steps, at) in (1..).map(f64::from).zip(&ramp[..8]) {
            assert!((at - 2.0 * (steps - steps * steps / 16.0)).abs() < 1e-12, "{steps}: {at}");
        }
        assert!((ramp[7] - 8.0).abs() < 1e-12 && ramp[11] == ramp[7]);
    }

    #[test]
    fn a_lift_is_no_velocity() {
        let mut model = Holdover::new(Carried::Constant, 1e7);
        model.observe([1.0, 1.0]);
        model.new_stroke([700.0, 0.0]);
        let mut out = [[5.0; 2]; 2];
        model.preview(&mut out);
        assert_eq!(out, [[0.0; 2]; 2]);
    }
}
