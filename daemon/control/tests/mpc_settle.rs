//! The plan as linear feedback: its lag, and whether it settles, against plans that are really followed.

mod support;

use foretrace_control::follower::{Follower, FollowerError};
use foretrace_control::mpc::{AxisLimits, Mpc, MpcError, MpcSettings, Plan, Start};
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::{AxisState, Trust};
use support::settings;

const N: usize = 10;

/// Gains of feedback [position, velocity] and effort; those of the preview with a third of the damping.
fn law(position: f64, velocity: f64, effort: f64) -> MpcSettings {
    let mut law = settings(PredictorKind::Hold).mpc;
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
fn lag_of_feedback_is_that_of_a_tool_behind_a_steady_target() {
    for (position, velocity, effort) in [(1.0, 0.0, 10.0), (1.0, 2.0, 0.1), (0.3, 0.5, 3.0)] {
        let law = law(position, velocity, effort);
        let middle = middle(&law);
        let mut mpc = Mpc::<N>::new(&law).unwrap();
        let told = mpc.feedback_lag_s();
        // Re-planned every step while the target moves.
        let (speed, step_s) = (1e-3, law.step_s);
        let mut tool = middle.map(AxisState::at_rest);
        let mut plan = Plan::resting(step_s);
        for k in 0..2000 {
            let mut target = middle.map(AxisState::at_rest);
            target[0].position += speed * step_s * f64::from(k);
            let preview = target.map(|state| [state; N]);
            assert!(mpc.plan(&tool, &target, &preview, Trust::NONE, 200, &mut plan).usable());
            tool = plan.state_at(step_s).unwrap();
        }
        let behind = middle[0] + speed * step_s * 2000.0 - tool[0].position;
        let lag = behind / speed;
        assert!((told / lag - 1.0).abs() < 1e-3, "{position} {velocity} {effort}: {told} s, really {lag} s");
    }
}

#[test]
fn lag_of_feedback_is_the_same_with_any_limits() {
    let wide = law(1.0, 2.0, 0.1);
    let mut narrow = wide;
    for axis in &mut narrow.axes {
        (axis.jerk_mps3, axis.acceleration_mps2, axis.velocity_mps) = (10.0, 0.1, 0.01);
    }
    let lag = |law: &MpcSettings| Mpc::<N>::new(law).unwrap().feedback_lag_s();
    assert_eq!(lag(&narrow).to_bits(), lag(&wide).to_bits());
}

/// By what a small deviation is multiplied per second at `trust`, planned anew every `period_s`; the mean over 40 s, after 40 s in which
/// what dies away sooner does.
fn followed(law: &MpcSettings, trust: Trust, period_s: f64) -> f64 {
    let servo = |arm: &AxisState, from: f64, to: f64| {
        if law.servo_s == 0.0 {
            return AxisState { position: to, ..*arm };
        }
        // Critically damped, in small steps.
        let (omega, pieces) = (2.0 / law.servo_s, 200);
        let (mut arm, dt) = (*arm, period_s / f64::from(pieces));
        for piece in 0..pieces {
            let at = from + (to - from) * (f64::from(piece) + 0.5) / f64::from(pieces);
            let push = omega * omega * (at - arm.position) - 2.0 * omega * arm.velocity;
            arm.position += arm.velocity * dt + 0.5 * push * dt * dt;
            arm.velocity += push * dt;
        }
        arm
    };
    let held = middle(law).map(AxisState::at_rest);
    let preview = held.map(|state| [state; N]);
    let mut mpc = Mpc::<N>::new(law).unwrap();
    let (mut command, mut arm) = (held, held);
    command[0].position += 1e-7;
    let mut plan = Plan::resting(law.step_s);
    // Of the whole state: a swing passes through zero. Shrunk now and then, so that no limit comes near.
    let size = |state: &AxisState| {
        let [p, v] = [state.position - held[0].position, state.velocity * law.step_s];
        p.hypot(v).hypot(state.acceleration * law.step_s.powi(2))
    };
    let (ticks, mut grown, mut begin) = ((40.0 / period_s) as u32, 0.0, 0.0);
    for tick in 0..2 * ticks {
        if tick == ticks {
            begin = grown + size(&command[0]).ln();
        }
        let from = Start { command, arm };
        assert!(mpc.plan_behind(&from, &held, &preview, trust, 200, &mut plan).usable());
        let next = plan.state_at(period_s).unwrap();
        for ((arm, from), to) in arm.iter_mut().zip(&command).zip(&next) {
            *arm = servo(arm, from.position, to.position);
        }
        command = next;
        let factor = 1e-7 / size(&command[0]);
        grown -= factor.ln();
        for (state, held) in command.iter_mut().chain(&mut arm).zip(held.iter().chain(&held)) {
            state.position = held.position + factor * (state.position - held.position);
            state.velocity *= factor;
            state.acceleration *= factor;
        }
    }
    ((grown + size(&command[0]).ln() - begin) / 40.0).exp()
}

#[test]
fn what_is_said_to_settle_does_and_what_is_said_to_swing_grows_as_fast_as_told() {
    let mut swung = 0;
    for (position, effort, servo_s, period_s) in [
        (1.0, 10.0, 0.0, 0.002),
        (0.1, 10.0, 0.0, 0.002),
        (0.01, 10.0, 0.0, 0.002),
        (0.003, 10.0, 0.0, 0.002),
        (0.003, 10.0, 0.0, 0.008),
        (0.3, 10.0, 0.03, 0.002),
        (0.003, 10.0, 0.03, 0.002),
        (0.01, 1000.0, 0.06, 0.004),
    ] {
        let mut law = law(position, 0.5 * position, effort);
        law.servo_s = servo_s;
        law.unlimited = true;
        let told = Mpc::<N>::new(&law).unwrap().settles(period_s);
        match told {
            Ok(()) => {
                for alpha in [0.0, 0.5, 1.0] {
                    let really = followed(&law, Trust::new(alpha), period_s);
                    assert!(really < 1.0, "{position} {effort} {servo_s} at {alpha}: {really}");
                }
            }
            Err(MpcError::Swings { alpha, per_s, .. }) => {
                swung += 1;
                let really = followed(&law, Trust::new(alpha), period_s);
                assert!(per_s > 1.0);
                let off = really.ln() / per_s.ln() - 1.0;
                assert!(off.abs() < 0.02, "{position} {effort} {servo_s}: told {per_s}, really {really}");
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!((2..=6).contains(&swung), "{swung} of 8 swing");
}

#[test]
fn a_loop_that_would_swing_is_not_built() {
    let mut wanted = settings(PredictorKind::Hold);
    for gains in wanted.mpc.gains_feedforward.iter_mut().chain(&mut wanted.mpc.gains_feedback) {
        (gains.position, gains.velocity, gains.acceleration) = (1e-3, 1e-3, 0.0);
    }
    wanted.mpc.effort = 10.0;
    let refused = Follower::<N, 6>::new(wanted).unwrap_err();
    assert!(matches!(refused, FollowerError::Mpc(MpcError::Swings { .. })), "{refused}");
    assert!(refused.to_string().contains("lower the effort"), "{refused}");
}
