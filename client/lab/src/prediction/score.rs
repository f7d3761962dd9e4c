//! The error measures of the prediction tables, per sequence and pooled.
//!
//! After v[0..=t] a model predicts v[t+1..t+10]. Error at lead h: of v[t+h] (velocity) and of the sum of the
//! first h predicted displacements (position), over every t with t + h inside the sequence, squared, mean
//! over components. The plain MSE is the velocity error at lead 1. Step 0 has no history and is not scored.
//! Within-stroke leaves out jumps and the step after one; `rms_mm_10` counts windows v[t..=t+10] without a
//! jump.

use super::CharacterSequence;

/// Steps that every model previews.
pub const HORIZON: usize = 10;

/// The leads that tables show, in steps.
pub const LEADS: [usize; 4] = [1, 2, 5, 10];

/// A sum of squares and how many went into it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mean {
    pub sum: f64,
    pub count: u64,
}

impl Mean {
    pub fn push(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    pub fn merge(&mut self, other: &Self) {
        self.sum += other.sum;
        self.count += other.count;
    }

    /// The mean, `None` without terms.
    #[must_use]
    pub fn get(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

/// Squared errors of one or more sequences.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// One step ahead, steps within strokes only \[raw units²\].
    pub within: Mean,
    /// Displacement errors at [`LEADS`], mean over components \[raw units²\].
    pub velocity: [Mean; 4],
    /// Position errors at [`LEADS`], mean over components \[raw units²\].
    pub position: [Mean; 4],
    /// 2-D position errors after [`HORIZON`] steps in windows without jumps \[mm²\]; empty where the unit is
    /// unknown.
    pub clean_mm2: Mean,
}

impl Tally {
    /// Scores the previews of one sequence: `previews[t]` was made after v[0..=t].
    #[must_use]
    pub fn of(sequence: &CharacterSequence, previews: &[[[f64; 2]; HORIZON]]) -> Self {
        let mut tally = Self::default();
        let mut last_jump: Option<usize> = None;
        let next_jumps = next_jumps(&sequence.jump);
        for (t, preview) in previews.iter().enumerate() {
            if sequence.jump.get(t).copied().unwrap_or(false) {
                last_jump = Some(t);
            }
            let mut gap = [0.0; 2];
            for (h, predicted) in (1..).zip(preview) {
                let Some(&[x, y]) = sequence.v.get(t + h) else { break };
                let [px, py] = *predicted;
                let error = [px - x, py - y];
                gap = [gap[0] + error[0], gap[1] + error[1]];
                if h == 1 && sequence.within_stroke(t + 1) {
                    tally.within.push(half_square(error));
                }
                if let Some(column) = LEADS.iter().position(|lead| *lead == h) {
                    tally.velocity[column].push(half_square(error));
                    tally.position[column].push(half_square(gap));
                }
                let clean = last_jump != Some(t) && next_jumps.get(t).is_none_or(|next| *next > t + h);
                if h == HORIZON
                    && clean
                    && let Some([x_per_m, y_per_m]) = sequence.units_per_m
                {
                    let mm = [gap[0] * 1e3 / x_per_m, gap[1] * 1e3 / y_per_m];
                    tally.clean_mm2.push(2.0 * half_square(mm));
                }
            }
        }
        tally
    }

    pub fn merge(&mut self, other: &Self) {
        self.within.merge(&other.within);
        self.clean_mm2.merge(&other.clean_mm2);
        for (mine, theirs) in self.velocity.iter_mut().zip(&other.velocity) {
            mine.merge(theirs);
        }
        for (mine, theirs) in self.position.iter_mut().zip(&other.position) {
            mine.merge(theirs);
        }
    }

    /// Mean squared one-step error \[raw units²\].
    #[must_use]
    pub fn mse(&self) -> Option<f64> {
        self.velocity[0].get()
    }
}

/// For each step the first jump at or after it.
fn next_jumps(jump: &[bool]) -> Vec<usize> {
    let mut next = vec![usize::MAX; jump.len()];
    let mut seen = usize::MAX;
    for (t, slot) in next.iter_mut().enumerate().rev() {
        if jump[t] {
            seen = t;
        }
        *slot = seen;
    }
    next
}

fn half_square([x, y]: [f64; 2]) -> f64 {
    0.5 * (x * x + y * y)
}

/// Percentage of sequences whose error is strictly below that of `reference`; `None` if they do not pair up.
#[must_use]
pub fn share_below(errors: &[f64], reference: &[f64]) -> Option<f64> {
    if errors.is_empty() || errors.len() != reference.len() {
        return None;
    }
    let below = errors.iter().zip(reference).filter(|(ours, theirs)| ours < theirs).count();
    Some(100.0 * below as f64 / errors.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prediction::{Plain, constant_velocity, preview_all, zero};

    fn sequence(v: &[[f64; 2]], jumps: &[usize]) -> CharacterSequence {
        CharacterSequence {
            file: "a".to_owned(),
            writer: String::new(),
            segment: 0,
            label: "x".to_owned(),
            v: v.to_vec(),
            jump: (0..v.len()).map(|t| jumps.contains(&t)).collect(),
            rate_hz: 200.0,
            rate_assumed: false,
            units_per_m: Some([2000.0, 1000.0]),
        }
    }

    fn tally(contestant: &mut dyn crate::prediction::Contestant, sequence: &CharacterSequence) -> Tally {
        let mut previews = Vec::new();
        preview_all(contestant, sequence, &mut previews);
        Tally::of(sequence, &previews)
    }

    /// v = (1,0), (3,0), (3,4): by hand.
    #[test]
    fn three_steps_score_as_worked_out_by_hand() {
        let sequence = sequence(&[[1.0, 0.0], [3.0, 0.0], [3.0, 4.0]], &[]);
        let still = tally(&mut zero(), &sequence);
        // One ahead: (3,0) and (3,4): (9 + 25) / 2 steps / 2 components.
        assert_eq!(still.mse(), Some(8.5));
        // Two ahead, only from t = 0: velocity (3,4): 25/2; position (6,4): 52/2.
        assert_eq!((still.velocity[1].get(), still.position[1].get()), (Some(12.5), Some(26.0)));
        assert_eq!(still.velocity[2].get(), None);
        let repeat = tally(&mut constant_velocity(), &sequence);
        // One ahead: (-2,0) and (0,-4): (4 + 16) / 2 / 2.
        assert_eq!(repeat.mse(), Some(5.0));
        // Two ahead from (1,0): velocity error (-2,-4): 20/2; position error (2-6, 0-4): 32/2.
        assert_eq!((repeat.velocity[1].get(), repeat.position[1].get()), (Some(10.0), Some(16.0)));
    }

    #[test]
    fn jump_and_the_step_after_it_are_not_within_a_stroke() {
        let steps = [[1.0, 0.0], [1.0, 0.0], [100.0, 0.0], [2.0, 0.0], [4.0, 0.0]];
        let still = tally(&mut zero(), &sequence(&steps, &[2]));
        // Targets 1 and 4 stay: (1 + 16) / 2 / 2.
        assert_eq!((still.within.get(), still.within.count), (Some(4.25), 2));
        assert_eq!(still.velocity[0].count, 4);
    }

    #[test]
    fn clean_windows_hold_no_jump_and_do_not_start_on_one() {
        // 24 steps of (2, 1): after 10 steps (20, 10) raw, that is (10, 10) mm at 2 and 1 units/mm.
        let steps = [[2.0, 1.0]; 24];
        let whole = tally(&mut zero(), &sequence(&steps, &[]));
        assert_eq!((whole.clean_mm2.get(), whole.clean_mm2.count), (Some(200.0), 14));
        // A jump at 12 spoils the windows t ..= t + 10 of t = 2 ..= 12; those of 0, 1 and 13 stay.
        let cut = tally(&mut zero(), &sequence(&steps, &[12]));
        assert_eq!((cut.clean_mm2.get(), cut.clean_mm2.count), (Some(200.0), 3));
        let unknown = CharacterSequence { units_per_m: None, ..sequence(&steps, &[]) };
        assert_eq!(tally(&mut zero(), &unknown).clean_mm2.get(), None);
    }

    #[test]
    fn previews_stop_before_the_end_and_perfect_ones_have_no_error() {
        let steps: Vec<[f64; 2]> = (0..15).map(|_| [0.5, -0.25]).collect();
        let sequence = sequence(&steps, &[]);
        let mut model: Plain<_> = constant_velocity();
        let mut previews = Vec::new();
        preview_all(&mut model, &sequence, &mut previews);
        assert_eq!(previews.len(), 14);
        let tally = Tally::of(&sequence, &previews);
        assert_eq!(tally.velocity.map(|m| (m.sum, m.count)), [(0.0, 14), (0.0, 13), (0.0, 10), (0.0, 5)]);
        assert_eq!(tally.position.map(|m| m.sum), [0.0; 4]);
    }

    #[test]
    fn diverged_models_beat_nobody() {
        assert_eq!(share_below(&[1.0, 2.0, f64::NAN, 3.0], &[1.0, 3.0, 1.0, 4.0]), Some(50.0));
        assert_eq!(share_below(&[1.0], &[1.0, 2.0]), None);
    }
}
