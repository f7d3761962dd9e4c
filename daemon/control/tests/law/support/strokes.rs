//! Synthetic motion of a pen: handwriting in metres, and signals in the normalised units of the learner.

use foretrace_control::pen::{GridStep, Motion, Touch};
use foretrace_control::predict::{LearnStep, PenStep};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Strokes made of overlapping bell-shaped speed pulses in changing directions (the kinematic view of
/// handwriting), each followed by a rest; `strokes` of them at 10 ms.
pub(crate) fn handwriting(seed: u64, strokes: usize) -> Vec<GridStep> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut velocity = Vec::new();
    for _ in 0..strokes {
        let pulses = rng.random_range(3..8);
        let begin = velocity.len();
        velocity.resize(begin + 12 * pulses + 45, [0.0_f64; 2]);
        for pulse in 0..pulses {
            let (angle, width) =
                (rng.random_range(0.0..std::f64::consts::TAU), rng.random_range(4.0..8.0_f64));
            let centre = 20.0 + 12.0 * pulse as f64 + rng.random_range(-3.0..3.0_f64);
            let speed = rng.random_range(0.5e-3..2.5e-3_f64);
            for (k, v) in velocity[begin..].iter_mut().enumerate() {
                let bell = speed * (-0.5 * ((k as f64 - centre) / width).powi(2)).exp();
                *v = [v[0] + bell * angle.cos(), v[1] + bell * angle.sin()];
            }
        }
    }
    path(&velocity)
}

/// Those displacements as grid steps from index 0.
pub(crate) fn path(displacements: &[[f64; 2]]) -> Vec<GridStep> {
    let mut position = [0.0; 2];
    (0..)
        .zip(displacements)
        .map(|(index, displacement)| {
            position = [position[0] + displacement[0], position[1] + displacement[1]];
            let motion = if index == 0 { Motion::Start } else { Motion::Continues };
            GridStep {
                index,
                position,
                displacement: *displacement,
                motion,
                contact: true,
                ..GridStep::default()
            }
        })
        .collect()
}

/// A displacement of a pen that has just come to touch the paper; its first half is not known.
pub(crate) fn on_paper(x: [f64; 2]) -> PenStep {
    PenStep { x, touch: Touch { contact: true, steps: 0 }, ..PenStep::default() }
}

/// Steps of a signal whose next displacement is `factor` times the last, kicked every 12 steps; normalised.
pub(crate) fn first_order(factor: f64, count: usize, first_index: u64, seed: u64) -> Vec<LearnStep> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut x = [0.0_f64; 2];
    (0..count)
        .map(|i| {
            x = x.map(|x| factor * x);
            if i % 12 == 0 {
                x = [rng.random_range(-20.0..20.0), rng.random_range(-20.0..20.0)];
            }
            let motion = if i == 0 { Motion::Start } else { Motion::Continues };
            LearnStep { index: first_index + i as u64, motion, pen: on_paper(x), ..LearnStep::default() }
        })
        .collect()
}
