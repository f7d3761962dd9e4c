//! The plan as linear feedback: its lag, and whether it settles, against simulated plans.

use crate::support::settings;
use foretrace_control::follower::{Follower, FollowerError};
use foretrace_control::mpc::{AxisLimits, Mpc, MpcError, MpcSettings, Plan, Start};
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::{AxisState, Trust};

const N: usize = 10;

/// Gains of feedback \[position, velocity\] and effort; those of the preview with a third of the damping.
fn law(position: f64, velocity: f64, effort: f64) -> MpcSettings {
    let mut law = settings(PredictorKind::HOLD).mpc;
    law.effort = effort;
    for gains in &mut law.gains_feedback {
        (gains.position, gains.velocity, gains.acceleration) = (position, velocity, 0.0);
    }
    for gains in &mut law.gains_feedforward {
        (gains.position, gains.velocity, gains.acceleration) = (position, velocity / 3.0, 0.0);
    }
    law
}

fn middle(law: &MpcSettings) -> [f64; 3] {
    law.axes.map(|AxisLimits { position_m: [low, high], .. }| 0.5 * (low + high))
}

#[test]
fn lag_of_feedback_is_that_of_an_arm_behind_a_steady_target() {
    let step_s = law(1.0, 0.0, 10.0).step_s;
    for (position, velocity, effort, servo_s, periods) in [
        (1.0, 0.0, 10.0, 0.0, 1.0),
        (1.0, 2.0, 0.1, 0.0, 0.2),
        (0.3, 0.5, 3.0, 0.0, 2.0),
        (0.3, 0.5, 3.0, 0.03, 0.2),
    ] {
        let law = MpcSettings { servo_s, ..law(position, velocity, effort) };
        let period_s = periods * step_s;
        let mut mpc = Mpc::<N>::new(&law).unwrap();
        let told = mpc.feedback_lag_s(period_s);
        // Planned anew every period while the target moves.
        let (speed, ticks) = (1e-3, (20.0 / period_s) as u32);
        let middle = middle(&law);
        let (mut command, mut arm) = (middle.map(AxisState::at_rest), middle.map(AxisState::at_rest));
        let mut plan = Plan::resting(step_s);
        for k in 0..ticks {
            let mut target = middle.map(AxisState::at_rest);
            target[0].position += speed * period_s * f64::from(k);
            let preview = target.map(|state| [state; N]);
            let from = Start { command, arm };
            assert!(mpc.plan_behind(&from, &target, &preview, Trust::NONE, 200, &mut plan).usable());
            let next = plan.state_at(period_s).unwrap();
            for ((arm, from), to) in arm.iter_mut().zip(&command).zip(&next) {
                *arm = if servo_s > 0.0 {
                    behind_servo(arm, from.position, to.position, servo_s, period_s)
                } else {
                    *to
                };
            }
            command = next;
        }
        let behind = middle[0] + speed * period_s * f64::from(ticks) - arm[0].position;
        let lag = behind / speed;
        let off = told / lag - 1.0;
        assert!(
            off.abs() < 1e-3,
            "{position} {velocity} {effort} {servo_s} {periods}: {told} s, really {lag} s"
        );
    }
}

#[test]
fn lag_of_feedback_is_the_same_with_any_limits() {
    let wide = law(1.0, 2.0, 0.1);
    let mut narrow = wide;
    for axis in &mut narrow.axes {
        (axis.jerk_mps3, axis.acceleration_mps2, axis.velocity_mps) = (10.0, 0.1, 0.01);
    }
    let lag = |law: &MpcSettings| Mpc::<N>::new(law).unwrap().feedback_lag_s(0.002);
    assert_eq!(lag(&narrow).to_bits(), lag(&wide).to_bits());
}

/// A critically damped filter after a straight line, in small steps.
fn behind_servo(arm: &AxisState, from: f64, to: f64, servo_s: f64, period_s: f64) -> AxisState {
    let (omega, pieces) = (2.0 / servo_s, 200);
    let (mut arm, dt) = (*arm, period_s / f64::from(pieces));
    for piece in 0..pieces {
        let at = from + (to - from) * (f64::from(piece) + 0.5) / f64::from(pieces);
        let push = omega * omega * (at - arm.position) - 2.0 * omega * arm.velocity;
        arm.position += arm.velocity * dt + 0.5 * push * dt * dt;
        arm.velocity += push * dt;
    }
    arm
}

/// Growth per second of a small deviation of `axis` at `trust`, planned anew every `period_s`; the mean over
/// 40 s, after 40 s of transient.
fn followed(law: &MpcSettings, axis: usize, trust: Trust, period_s: f64) -> f64 {
    let held = middle(law).map(AxisState::at_rest);
    let preview = held.map(|state| [state; N]);
    let mut mpc = Mpc::<N>::new(law).unwrap();
    let (mut command, mut arm) = (held, held);
    command[axis].position += 1e-7;
    let mut plan = Plan::resting(law.step_s);
    // Of the whole state, because an oscillation passes through zero. Rescaled now and then, so that no limit
    // is near.
    let size = |state: &AxisState| {
        let [p, v] = [state.position - held[axis].position, state.velocity * law.step_s];
        p.hypot(v).hypot(state.acceleration * law.step_s.powi(2))
    };
    let (ticks, mut grown, mut begin) = ((40.0 / period_s) as u32, 0.0, 0.0);
    for tick in 0..2 * ticks {
        if tick == ticks {
            begin = grown + size(&command[axis]).ln();
        }
        let from = Start { command, arm };
        assert!(mpc.plan_behind(&from, &held, &preview, trust, 200, &mut plan).usable());
        let next = plan.state_at(period_s).unwrap();
        for ((arm, from), to) in arm.iter_mut().zip(&command).zip(&next) {
            if law.servo_s > 0.0 {
                *arm = behind_servo(arm, from.position, to.position, law.servo_s, period_s);
            }
        }
        command = next;
        let factor = 1e-7 / size(&command[axis]);
        grown -= factor.ln();
        for (state, held) in command.iter_mut().chain(&mut arm).zip(held.iter().chain(&held)) {
            state.position = held.position + factor * (state.position - held.position);
            state.velocity *= factor;
            state.acceleration *= factor;
        }
    }
    ((grown + size(&command[axis]).ln() - begin) / 40.0).exp()
}

/// Settings with their names, and the period.
fn cases() -> Vec<(&'static str, MpcSettings, f64)> {
    let plain = |position: f64, effort: f64, servo_s: f64| MpcSettings {
        servo_s,
        ..law(position, 0.5 * position, effort)
    };
    let mut decaying = plain(1.0, 10.0, 0.0);
    for gains in decaying.gains_feedback.iter_mut().chain(&mut decaying.gains_feedforward) {
        gains.decay = 0.3;
    }
    let mut across = plain(1.0, 10.0, 0.0);
    across.gains_feedforward[1].position = 1e-3;
    across.gains_feedforward[1].velocity = 1e-3;
    // Either cost alone settles, and so does half of both.
    let mut between = law(0.002, 0.08, 500.0);
    for gains in &mut between.gains_feedforward {
        (gains.position, gains.velocity) = (0.2, 0.0);
    }
    between.step_s = 0.005;
    vec![
        ("sharp", plain(1.0, 10.0, 0.0), 0.002),
        ("softer", plain(0.1, 10.0, 0.0), 0.002),
        ("soft", plain(0.01, 10.0, 0.0), 0.002),
        ("softest", plain(0.003, 10.0, 0.0), 0.002),
        ("slow ticks", plain(0.003, 10.0, 0.0), 0.008),
        ("ticks of two steps", MpcSettings { step_s: 0.001, ..plain(1.0, 10.0, 0.0) }, 0.002),
        ("behind a servo", plain(0.3, 10.0, 0.03), 0.002),
        ("soft behind a servo", plain(0.003, 10.0, 0.03), 0.002),
        ("decaying", decaying, 0.002),
        ("across", across, 0.002),
        ("between", between, 0.002),
    ]
}

#[test]
fn what_is_said_to_settle_does_and_what_is_said_to_swing_grows_as_fast_as_told() {
    let mut swung = Vec::new();
    for (name, mut law, period_s) in cases() {
        law.unlimited = true;
        match Mpc::<N>::new(&law).unwrap().settles(period_s) {
            Ok(()) => {
                for (axis, alpha) in [(0, 0.0), (0, 0.05), (1, 0.15), (2, 0.4), (0, 0.6), (1, 0.8), (0, 1.0)]
                {
                    let really = followed(&law, axis, Trust::new(alpha), period_s);
                    assert!(really < 1.0, "{name}, axis {axis} at {alpha}: {really}");
                }
            }
            Err(MpcError::Swings { axis, alpha, per_s }) => {
                swung.push((name, axis));
                let really = followed(&law, axis, Trust::new(alpha), period_s);
                let off = really.ln() / per_s.ln() - 1.0;
                assert!(per_s > 1.0 && off.abs() < 0.02, "{name}: told {per_s}, really {really}");
            }
            Err(other) => panic!("{other}"),
        }
    }
    println!("{swung:?}");
    for swings in [("softest", 0), ("decaying", 0), ("across", 1), ("between", 0)] {
        assert!(swung.contains(&swings), "{swings:?} is missing in {swung:?}");
    }
    for settles in ["sharp", "ticks of two steps", "behind a servo"] {
        assert!(swung.iter().all(|(name, _)| *name != settles), "{settles}: {swung:?}");
    }
}

#[test]
fn a_loop_that_would_swing_is_not_built() {
    let mut wanted = settings(PredictorKind::HOLD);
    for gains in wanted.mpc.gains_feedforward.iter_mut().chain(&mut wanted.mpc.gains_feedback) {
        (gains.position, gains.velocity, gains.acceleration) = (1e-3, 1e-3, 0.0);
    }
    wanted.mpc.effort = 10.0;
    let refused = Follower::<N, 6>::new(wanted).unwrap_err();
    assert!(matches!(refused, FollowerError::Mpc(MpcError::Swings { .. })), "{refused}");
    assert!(refused.to_string().contains("look farther ahead"), "{refused}");
}
