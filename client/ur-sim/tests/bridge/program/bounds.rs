//! What the program lets a joint do: its range and speed always, more than its acceleration for a cycle
//! only, and not even that after late cycles.

use proptest::prelude::*;

use super::*;

/// Commands at full acceleration whose sign changes at once, seen from a trip and a tick ahead.
#[test]
fn punctual_targets_pass_however_sharply_their_commands_reverse() {
    const AHEAD_S: f64 = 0.009;
    let mut scene = Scene::following(0.0);
    scene.fresh();
    let (mut q, mut qd) = (scene.arm.q[0], 0.0);
    for cycle in 0..500 {
        let qdd = if (cycle + 5) / 10 % 2 == 0 { 40.0 } else { -40.0 };
        q += qd * CYCLE_S + 0.5 * qdd * CYCLE_S * CYCLE_S;
        qd += qdd * CYCLE_S;
        (scene.q[0], scene.qd[0]) = (q + qd * AHEAD_S, qd);
        assert_eq!(scene.fresh().program(), ProgramState::Following, "cycle {cycle}");
        let off = (scene.arm.q[0] - scene.q[0]).abs();
        assert!(off < 1e-9, "cycle {cycle}: {off} rad");
    }
}

/// How much farther the newest speed is from one of those before than the acceleration of 40 rad/s² makes it,
/// and what a punctual target may ask for in the first and in the last cycle \[rad/s\].
fn excess(speeds: &[[f64; JOINTS]]) -> f64 {
    let Some(newest) = speeds.last() else { return 0.0 };
    let over = |(ago, before): (usize, &[f64; JOINTS])| {
        let change = newest.iter().zip(before).map(|(qd, before)| (qd - before).abs()).fold(0.0, f64::max);
        change - (ago as f64 + 2.0 * 5.0) * 40.0 * CYCLE_S
    };
    speeds.iter().rev().enumerate().map(over).fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn a_hostile_stream_is_not_followed_harder_than_a_joint_may_for_more_than_a_cycle() {
    let mut scene = Scene::following(0.0);
    scene.fresh();
    let mut speeds = vec![];
    for cycle in 0..200 {
        // As hard as a punctual target may ask for, from cycle to cycle.
        let to = if cycle / 8 % 2 == 0 { 3.0 } else { -3.0 };
        scene.qd[0] += (to - scene.qd[0]).clamp(-200.0 * CYCLE_S, 200.0 * CYCLE_S);
        scene.q[0] += scene.qd[0] * CYCLE_S;
        scene.fresh();
        speeds.push(scene.arm.qd);
        assert!(excess(&speeds) <= 1e-6, "cycle {cycle}: {} rad/s", excess(&speeds));
    }
}

#[test]
fn after_late_cycles_a_joint_returns_inside_its_limits_and_is_on_its_targets_again() {
    // Of the joint: 40 rad/s². What the targets need of it, and cycles until they are met again, as the same
    // equations outside of URScript give them.
    for (acceleration, most_cycles) in [(10.0, 4), (20.0, 11), (30.0, 38)] {
        for (late, moment) in (1..=5).flat_map(|late| (0..16).map(move |moment| (late, moment))) {
            let w = 10.0;
            let begin = f64::from(moment) / 16.0 * 2.0 * std::f64::consts::PI / w;
            let target = |t: f64| {
                let a = acceleration / (w * w);
                (a * (1.0 - (w * (t - begin)).cos()), a * w * (w * (t - begin)).sin())
            };
            let mut scene = Scene::following(0.0);
            let from = scene.arm.q[0];
            let (mut t, mut before, mut last_off) = (begin, 0.0, 0);
            for cycle in 0..150 {
                t += CYCLE_S;
                let (q, qd) = target(t);
                (scene.q[0], scene.qd[0]) = (from + q, qd);
                let stands = 40 + moment;
                if (stands..stands + late).contains(&cycle) {
                    scene.stale()
                } else {
                    scene.fresh()
                };
                let hard = (scene.arm.qd[0] - before).abs() / CYCLE_S;
                before = scene.arm.qd[0];
                assert!(hard <= 40.0 + 1e-6, "{acceleration}, {late} late: {hard} rad/s²");
                if (scene.arm.q[0] - scene.q[0]).abs() > 1e-9 {
                    last_off = cycle + 1 - stands - late;
                    assert!(cycle >= stands, "{acceleration}: off before any cycle was late");
                }
            }
            assert!(last_off <= most_cycles, "{acceleration}, {late} late: {last_off} cycles");
            assert_eq!((scene.answer().program(), scene.answer().late), (ProgramState::Following, late));
        }
    }
}

/// Targets that need all of the acceleration leave none for a return.
#[test]
fn after_late_cycles_at_full_acceleration_a_joint_returns_or_stops_as_late_inside_its_limits() {
    let mut stopped = 0;
    for late in 1..=5 {
        let mut scene = Scene::following(0.0);
        let mut before = 0.0;
        for cycle in 0..60 {
            scene.qd[0] = (scene.qd[0] + 40.0 * CYCLE_S).min(3.0);
            scene.q[0] += scene.qd[0] * CYCLE_S;
            if (1..=late).contains(&cycle) {
                scene.stale()
            } else {
                scene.fresh()
            };
            let hard = (scene.arm.qd[0] - before).abs() / CYCLE_S;
            before = scene.arm.qd[0];
            assert!(hard <= 40.0 + 1e-6, "{late} late, cycle {cycle}: {hard} rad/s²");
        }
        let state = scene.answer().program();
        stopped += i32::from(state == ProgramState::StoppedLate);
        assert!([ProgramState::Following, ProgramState::StoppedLate].contains(&state), "{late}: {state:?}");
    }
    assert!((1..5).contains(&stopped), "{stopped} of 5");
}

#[test]
fn a_joint_is_never_led_beyond_its_range() {
    // Straight at the end of the range, with counters that stay away just before it; and a target beyond it.
    for (late, end) in (0..=5).flat_map(|late| [(late, 0), (late, 1)]) {
        let mut scene = Scene::new();
        let (range, way) = (scene.program.limits.position()[0], [-1.0, 1.0][end]);
        scene.arm.q[0] = range[end] - 0.5 * way;
        scene.fresh();
        (scene.permit, scene.q) = (9, scene.arm.q);
        scene.fresh();
        // It also has to come to rest inside.
        for cycle in 0..160 {
            scene.qd[0] = way * (scene.qd[0].abs() + 20.0 * CYCLE_S).min(3.0);
            scene.q[0] += scene.qd[0] * CYCLE_S;
            if (20..20 + late).contains(&cycle) {
                scene.stale()
            } else {
                scene.fresh()
            };
            let q = scene.arm.q[0];
            assert!((range[0]..=range[1]).contains(&q), "{late}: {q} of {range:?}");
        }
        assert_eq!(scene.arm.qd, [0.0; JOINTS], "{late}");
        let stopped = [ProgramState::StoppedJump, ProgramState::StoppedLate];
        assert!(stopped[..=usize::from(late > 0)].contains(&scene.answer().program()), "{late}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Whatever comes in whatever rhythm: no joint moves faster than it may; none harder than it may in late
    /// cycles, in others none harder than a punctual target may ask for, nor for longer than that takes; all
    /// stand still in the end.
    #[test]
    fn whatever_comes_the_joints_stay_inside_their_limits(
        cycles in proptest::collection::vec((0u8..12, -0.3f64..0.3, -4.0f64..4.0, 0i32..4), 1..120)
    ) {
        let mut scene = Scene::following(0.0);
        let mut speeds = vec![];
        for (kind, far, speed, permit) in cycles {
            let before = scene.arm.qd;
            match kind {
                0 => scene.q[0] += far,
                1 => scene.qd[0] = speed,
                2 => scene.permit = permit,
                3 => (scene.q, scene.qd) = (scene.arm.q, [0.0; JOINTS]),
                4 => scene.permit += 1,
                5 => scene.q[0] += 0.1 * far,
                _ => {}
            }
            if kind < 9 { scene.fresh() } else { scene.stale() };
            let speed = scene.arm.qd.iter().map(|qd| qd.abs()).fold(0.0, f64::max);
            prop_assert!(speed <= 3.1 + 1e-9, "{} rad/s", speed);
            let change = scene.arm.qd.iter().zip(before).map(|(qd, before)| (qd - before).abs());
            let hard = change.fold(0.0, f64::max) / CYCLE_S;
            let most = if kind < 9 { 5.0 * 40.0 } else { 40.0 };
            prop_assert!(hard <= most + 1e-6, "{} rad/s²", hard);
            speeds.push(scene.arm.qd);
            prop_assert!(excess(&speeds) <= 1e-6, "{} rad/s", excess(&speeds));
        }
        for _ in 0..100 {
            scene.stale();
        }
        prop_assert_eq!(scene.arm.qd, [0.0; JOINTS]);
    }
}
