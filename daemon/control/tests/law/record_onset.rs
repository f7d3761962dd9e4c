//! Previews at the onset of the pen's motion: the share of a preview that is trusted.

use crate::support::judging::Judge;

/// Metres per normalised unit: a step of ordinary motion, 1 mm, is 10.
const UNIT_M: f64 = 1e-4;
const STEP_S: f64 = 0.01;

#[test]
fn where_the_pen_begins_to_move_a_new_hand_is_believed_step_by_step() {
    let predicted = [5e-3, -2e-3];
    for per_step in [false, true] {
        let mut judge = Judge::new(STEP_S, per_step);
        let mut x = 0.0;
        for rested in [true, false, true] {
            let steps = if rested { 5 } else { 0 };
            for _ in 0..steps {
                judge.realise([x, 0.0], UNIT_M);
            }
            for share in [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.0] {
                let share = if per_step && rested { share } else { 1.0 };
                let believed = judge.believed(4, predicted);
                assert!(
                    (believed[0] - share * predicted[0]).abs() < 1e-12,
                    "{per_step} {rested}: {believed:?}"
                );
                assert!(
                    (believed[1] - share * predicted[1]).abs() < 1e-12,
                    "{per_step} {rested}: {believed:?}"
                );
                x += 1e-3;
                judge.realise([x, 0.0], UNIT_M);
            }
        }
    }
}

#[test]
fn an_arm_away_from_its_limits_is_not_held_back() {
    let predicted = [5e-3, -2e-3];
    let mut judge = Judge::new(STEP_S, true);
    for (saturated, share) in [(1.0, 0.3), (0.0, 1.0), (0.15, 0.65), (0.5, 0.3)] {
        judge.saturate(saturated);
        let believed = judge.believed(4, predicted)[0] / predicted[0];
        assert!((believed - share).abs() < 1e-12, "{saturated}: {believed}");
    }
}
