//! [`DoubleExponential`]: double exponential smoothing as a predictor (LaViola, "Double exponential
//! smoothing: an alternative to Kalman filter-based predictive tracking", Eurographics Workshop on Virtual
//! Environments 2003, pages 199 to 206).
//!
//! S'_t = α p_t + (1−α) S'_{t−1}, S''_t = α S'_t + (1−α) S''_{t−1}, and τ steps later
//! p_{t+τ} = (2 + ατ/(1−α)) S'_t − (1 + ατ/(1−α)) S''_t. A stroke starts with S' = S'' = p. α is that of the
//! least mean squared error on the train part, one for each τ; without a train part [`UNTRAINED`].

use super::model::Contestant;

/// The values of α to choose from.
const ALPHAS: [f64; 21] = [
    0.01, 0.02, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.50, 0.55, 0.60, 0.65, 0.70, 0.75,
    0.80, 0.85, 0.90, 0.95,
];
/// Index of the α for sets without a train part: the best 10 ms ahead on the train writers of unipen-ced
/// (`foretrace lab table1 --data unipen-ced --models double-exponential` says it).
const UNTRAINED: usize = 19;
/// The step nearest to this look-ahead time has its α named beside the nearest and the farthest \[ns\].
const NAMED_NS: f64 = 1e7;
/// Farthest look-ahead with an α of its own \[ns\], and most steps to it.
const FARTHEST_NS: f64 = 2e8;
const MOST_STEPS: usize = 256;

/// S' and S'' of one α, from the newest position \[raw units\]: no sum grows with the stroke.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Smoothed {
    once: [f64; 2],
    twice: [f64; 2],
}

impl Smoothed {
    /// The pen went on by `v`.
    fn observe(&mut self, alpha: f64, v: [f64; 2]) {
        for (axis, v) in v.into_iter().enumerate() {
            self.once[axis] = (1.0 - alpha) * (self.once[axis] - v);
            self.twice[axis] = alpha * self.once[axis] + (1.0 - alpha) * (self.twice[axis] - v);
        }
    }

    /// Where the pen will be after `tau` steps, from the newest position.
    fn after(&self, alpha: f64, tau: f64) -> [f64; 2] {
        let further = alpha * tau / (1.0 - alpha);
        [0, 1].map(|axis| (2.0 + further) * self.once[axis] - (1.0 + further) * self.twice[axis])
    }
}

/// Every α at one point of a stroke, and the displacement that led there.
#[derive(Debug, Clone, Copy)]
struct Past {
    smoothed: [Smoothed; ALPHAS.len()],
    v: [f64; 2],
}

/// The predictor; reads raw units as they come, since it is linear.
#[derive(Debug, Clone)]
pub(super) struct DoubleExponential {
    smoothed: [Smoothed; ALPHAS.len()],
    /// Index of the α for one, two … steps ahead.
    chosen: Vec<usize>,
    /// The step that is named, and how far ahead that is \[ms\].
    named_steps: usize,
    named_ms: f64,
    tuning: Option<AlphaTuning>,
}

/// Squared errors by α and steps ahead, and what they are taken from: the newest points of this stroke.
#[derive(Debug, Clone)]
struct AlphaTuning {
    squares: Vec<[f64; ALPHAS.len()]>,
    past: std::collections::VecDeque<Past>,
}

impl DoubleExponential {
    /// For a device with steps of `step_ns`.
    pub(super) fn new(step_ns: f64) -> Self {
        let steps = ((FARTHEST_NS / step_ns).ceil() as usize).clamp(1, MOST_STEPS);
        let tuning = AlphaTuning { squares: vec![[0.0; ALPHAS.len()]; steps], past: Default::default() };
        let named_steps = ((NAMED_NS / step_ns).round() as usize).clamp(1, steps);
        let chosen = vec![UNTRAINED; steps];
        let named_ms = named_steps as f64 * step_ns / 1e6;
        Self { smoothed: Default::default(), chosen, named_steps, named_ms, tuning: Some(tuning) }
    }

    fn advance(&mut self, v: [f64; 2]) {
        for (smoothed, alpha) in self.smoothed.iter_mut().zip(ALPHAS) {
            smoothed.observe(alpha, v);
        }
    }
}

impl AlphaTuning {
    fn forget(&mut self) {
        self.past.clear();
    }

    /// Judges what was predicted of the newest point, which `v` led to.
    fn judge(&mut self, smoothed: &[Smoothed; ALPHAS.len()], v: [f64; 2]) {
        let mut moved = v;
        for ((steps, squares), past) in (1..).zip(&mut self.squares).zip(&self.past) {
            for ((square, past), alpha) in squares.iter_mut().zip(&past.smoothed).zip(ALPHAS) {
                let [x, y] = past.after(alpha, f64::from(steps));
                *square += (x - moved[0]).powi(2) + (y - moved[1]).powi(2);
            }
            moved = [moved[0] + past.v[0], moved[1] + past.v[1]];
        }
        self.past.truncate(self.squares.len() - 1);
        self.past.push_front(Past { smoothed: *smoothed, v });
    }

    /// The best α for each number of steps; where nothing was learned, the usual one.
    fn best(&self) -> Vec<usize> {
        let best = |squares: &[f64; ALPHAS.len()]| {
            let known = squares.iter().any(|square| *square > 0.0);
            let least = squares.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
            least.filter(|_| known).map_or(UNTRAINED, |(index, _)| index)
        };
        self.squares.iter().map(best).collect()
    }
}

impl Contestant for DoubleExponential {
    fn start_sequence(&mut self) {
        self.new_stroke([0.0; 2]);
    }

    fn new_stroke(&mut self, _v: [f64; 2]) {
        self.smoothed = Default::default();
        if let Some(tuning) = &mut self.tuning {
            tuning.forget();
            tuning.past.push_front(Past { smoothed: self.smoothed, v: [0.0; 2] });
        }
    }

    fn observe(&mut self, v: [f64; 2]) {
        self.advance(v);
        if let Some(tuning) = &mut self.tuning {
            tuning.judge(&self.smoothed, v);
        }
    }

    fn preview(&self, out: &mut [[f64; 2]]) {
        let farthest = self.chosen.last().copied().unwrap_or(UNTRAINED);
        let mut last = [0.0; 2];
        for (index, slot) in out.iter_mut().enumerate() {
            let chosen = self.chosen.get(index).copied().unwrap_or(farthest);
            let (Some(smoothed), Some(alpha)) = (self.smoothed.get(chosen), ALPHAS.get(chosen)) else {
                break;
            };
            let position = smoothed.after(*alpha, (index + 1) as f64);
            *slot = [position[0] - last[0], position[1] - last[1]];
            last = position;
        }
    }

    fn end_training(&mut self) {
        if let Some(tuning) = self.tuning.take() {
            self.chosen = tuning.best();
        }
    }

    fn trained_note(&self) -> Option<String> {
        let alpha = |index: usize| ALPHAS.get(index).copied().unwrap_or(f64::NAN);
        let (near, far) = (self.chosen.first()?, self.chosen.last()?);
        let (steps, named) = (self.chosen.len(), self.chosen.get(self.named_steps - 1)?);
        let ends =
            format!("α from {:.2}, 1 step ahead, to {:.2}, {steps} steps ahead", alpha(*near), alpha(*far));
        // To a tenth, and none where it is whole.
        let ms = (10.0 * self.named_ms).round() / 10.0;
        Some(format!("{ends}; {:.2} {ms} ms ahead", alpha(*named)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALPHA_HALF: usize = 11;

    fn with_alpha(index: usize, steps: usize) -> DoubleExponential {
        let mut model = DoubleExponential::new(5e6);
        (model.chosen, model.tuning) = (vec![index; steps], None);
        model.start_sequence();
        model
    }

    /// Positions after 1, 2 … steps.
    fn positions(model: &DoubleExponential, count: usize) -> Vec<[f64; 2]> {
        let mut steps = vec![[0.0; 2]; count];
        model.preview(&mut steps);
        let mut at = [0.0; 2];
        let add = |v: [f64; 2]| {
            at = [at[0] + v[0], at[1] + v[1]];
            at
        };
        steps.into_iter().map(add).collect()
    }

    #[test]
    fn three_points_give_what_the_equations_give_by_hand() {
        // p = 0, 4, 6 with α = 1/2: S' = 0, 2, 4 and S'' = 0, 1, 2.5. Then p_{t+τ} = (2 + τ) 4 − (1 + τ) 2.5.
        let mut model = with_alpha(ALPHA_HALF, 3);
        model.observe([4.0, -8.0]);
        model.observe([2.0, -4.0]);
        // Positions from the newest point, 6: 7 − 6, 8.5 − 6, 10 − 6.
        assert_eq!(positions(&model, 3), [[1.0, -2.0], [2.5, -5.0], [4.0, -8.0]]);
    }

    #[test]
    fn a_straight_line_is_predicted_exactly_in_the_limit() {
        for (index, alpha) in ALPHAS.into_iter().enumerate() {
            let mut model = with_alpha(index, 40);
            let start = |model: &DoubleExponential| (positions(model, 1)[0][0] - 3.0).abs();
            model.observe([3.0, 1.0]);
            let first = start(&model);
            // Each step leaves 1 − α of what is missing.
            (0..(40.0 / alpha) as usize).for_each(|_| model.observe([3.0, 1.0]));
            for (steps, [x, y]) in (1..).map(f64::from).zip(positions(&model, 60)) {
                assert!(
                    (x - 3.0 * steps).abs() < 1e-9 && (y - steps).abs() < 1e-9,
                    "{alpha}: {steps} {x} {y}"
                );
            }
            assert!(first > 1e-3 || alpha > 0.9, "{alpha}: the first step tells little, {first}");
        }
    }

    #[test]
    fn a_new_stroke_forgets_the_one_before() {
        let mut model = with_alpha(ALPHA_HALF, 3);
        (0..9).for_each(|_| model.observe([5.0, 0.0]));
        model.new_stroke([400.0, 90.0]);
        assert_eq!(positions(&model, 2), [[0.0; 2]; 2]);
        model.observe([4.0, -8.0]);
        model.observe([2.0, -4.0]);
        assert_eq!(positions(&model, 1), [[1.0, -2.0]]);
    }

    #[test]
    fn the_chosen_alpha_has_the_least_error_on_what_it_was_trained_on() {
        let stroke: Vec<[f64; 2]> = (0..200)
            .map(|i| {
                let angle = 0.11 * f64::from(i);
                let noise = f64::from(i * 7919 % 13) - 6.0;
                [6.0 * angle.cos() + 0.3 * noise, 6.0 * angle.sin() - 0.2 * noise]
            })
            .collect();
        let strokes = [&stroke[..90], &stroke[90..]];
        let mut model = DoubleExponential::new(5e6);
        for (index, stroke) in strokes.iter().enumerate() {
            if index == 0 {
                model.start_sequence()
            } else {
                model.new_stroke([900.0, 0.0])
            }
            stroke.iter().for_each(|v| model.observe(*v));
        }
        model.end_training();
        assert_eq!(model.chosen.len(), 40);
        // Again, with nothing but `preview` and sums.
        for steps in [1, 2, 5, 20, 40_usize] {
            let error = |index: usize| {
                let mut sum = 0.0;
                for stroke in strokes {
                    let mut model = with_alpha(index, 40);
                    for t in 0..stroke.len() + 1 - steps {
                        if t > 0 {
                            model.observe(stroke[t - 1]);
                        }
                        let [x, y] = positions(&model, steps)[steps - 1];
                        let [a, b] =
                            stroke[t..t + steps].iter().fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]);
                        sum += (x - a).powi(2) + (y - b).powi(2);
                    }
                }
                sum
            };
            let best = (0..ALPHAS.len()).min_by(|a, b| error(*a).total_cmp(&error(*b))).unwrap();
            assert_eq!(model.chosen[steps - 1], best, "{steps} steps");
        }
        assert!(model.chosen[0] > model.chosen[39], "{:?}", model.chosen);
        // 10 ms are two steps.
        model.chosen = (0..40).map(|steps| steps.min(ALPHAS.len() - 1)).collect();
        let note = model.trained_note().unwrap();
        assert_eq!(note, "α from 0.01, 1 step ahead, to 0.95, 40 steps ahead; 0.02 10 ms ahead");
    }

    #[test]
    fn where_no_step_ends_at_10_ms_the_note_says_how_far_ahead_the_named_one_is() {
        for (rate_hz, end) in [(60.0, "; 0.01 16.7 ms ahead"), (300.0, "; 0.05 10 ms ahead")] {
            let mut model = DoubleExponential::new(1e9 / rate_hz);
            model.chosen = (0..model.chosen.len()).map(|steps| steps.min(ALPHAS.len() - 1)).collect();
            let note = model.trained_note().unwrap();
            assert!(note.ends_with(end), "{note}");
        }
    }

    #[test]
    fn without_training_every_look_ahead_has_the_usual_alpha() {
        let mut model = DoubleExponential::new(1e7);
        model.start_sequence();
        model.end_training();
        assert_eq!(model.chosen, [UNTRAINED; 20]);
    }
}
