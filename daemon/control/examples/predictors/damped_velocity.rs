//! Damped velocity: the pen repeats its last displacement, a tenth shorter every step; x̂_k = ρ^k x. Example
//! of `docs/extend/predictor.md`.

use crate::predict::{Entry, Predictor, shortened};
use crate::state::state;

pub(super) const ENTRY: Entry =
    Entry::plain::<DampedVelocity>("damped-velocity", "repeats the last velocity, a tenth less every step");

/// ρ.
const DAMPING: f64 = 0.9;

/// Predicts ρ^k times the last observed displacement; zero before the first.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct DampedVelocity {
    last: [f64; 2],
}

state! { [] DampedVelocity { last } }

impl Predictor for DampedVelocity {
    fn observe(&mut self, x: [f64; 2]) {
        self.last = x;
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        let mut x = self.last;
        for predicted in out {
            x = shortened(x.map(|x| DAMPING * x), limit);
            *predicted = x;
        }
    }

    fn reset(&mut self) {
        self.last = [0.0; 2];
    }
}

#[cfg(test)]
mod tests {
    use crate::predict::{ModelSettings, Models, Networks, Panel, PenStep, PredictorKind};

    #[test]
    fn the_loop_has_it_by_its_name() {
        let models = Models::new(ModelSettings::preset(10_000_000), Networks::default()).unwrap();
        let mut panel = Panel::new(&models, &models.initial_weights()).unwrap();
        let kind = PredictorKind::from_name("damped-velocity").unwrap();
        assert!(panel.offers(kind) && PredictorKind::LIVE.contains(&kind) && !kind.learns());
        panel.observe(&PenStep::of([4.0, -2.0]));
        let mut positions = [[0.0; 2]; 3];
        assert!(panel.roll_out(kind, f64::INFINITY, 1.0, [0.0; 2], &mut positions).finite);
        // 4 (0.9 + 0.81 + 0.729), and half of it downwards.
        let [x, y] = positions[2];
        assert!((x - 9.756).abs() < 1e-12 && (y + 4.878).abs() < 1e-12, "{positions:?}");
        panel.forget();
        panel.roll_out(kind, f64::INFINITY, 1.0, [0.0; 2], &mut positions);
        assert_eq!(positions, [[0.0; 2]; 3]);
    }
}
