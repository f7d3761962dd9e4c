//! The same hand in front of another law, behind the arm that was fitted to the recording.

use foretrace_config::{Config, Draft};
use foretrace_control::follower::{Budget, Follower, JointReading, NoClock, Request};
use foretrace_control::learn::Learner;
use foretrace_control::pen::PenReading;
use foretrace_control::predict::{ExternalPreview, OnlineWeights};
use foretrace_control::state;
use foretrace_control::units::Stamp;
use foretrace_record::picture::draw;
use foretrace_record::replay::ReplayEnd;
use foretrace_record::what_if::{Variant, what_if};
use foretrace_shm::{PieceKind, Thing, TickInput};
use foretrace_sim::arm::{ArmModel, ArmSettings};
use foretraced::wire::{self, Given};
use tempfile::TempDir;

use super::{DAEMON, replayed, written};

/// Where the hand is \[m\]: strokes with lifts, so that there is a worst one.
fn hand(t: f64) -> [f64; 2] {
    [0.03 * (4.0 * t).sin() + 0.01 * (11.0 * t).sin(), 0.025 * (6.3 * t).cos()]
}

/// Seven seconds of a hand in front of the preset, behind a servo of 30 ms, with a learner in step.
fn behind_a_servo() -> (Vec<TickInput>, f64, Thing) {
    let (inputs, lag_s, settings, _) = recorded(&Config::preset("ur5").unwrap(), false);
    (inputs, lag_s, settings)
}

/// The same by `config`; where `foreseen`, a process that knows the hand answers each step one tick later.
/// With the previews that ticks were given.
fn recorded(config: &Config, foreseen: bool) -> (Vec<TickInput>, f64, Thing, Vec<Thing>) {
    let settings = config.follower_settings();
    let (period, home) = (settings.period_ns, settings.ik.home);
    let period_s = period as f64 * 1e-9;
    let servo = ArmSettings::ur5(period_s, 0.03);
    let mut arm = ArmModel::at_rest(servo, home);
    let (mut target, mut q, mut qd) = (home, home, [0.0; 6]);
    let mut learner = Learner::new(config.learner_settings(), config.models()).unwrap();
    let mut fresh: Option<Box<OnlineWeights>> = None;
    let (mut inputs, mut previews, mut coming) = (Vec::new(), Vec::new(), None::<ExternalPreview>);
    let (plane, step_ns, origin_ns) = (settings.plane, settings.pen.step_ns, 10_000_000_000_u64);
    let mut follower = Follower::<20, 6>::new(settings).unwrap();
    for tick in 1..=(7.0 / period_s) as u64 {
        let now = Stamp(10_000_000_000 + tick * period);
        let t = tick as f64 * period_s;
        let mut pen = Vec::new();
        if tick.is_multiple_of(3) && t > 0.2 {
            pen.push(PenReading::new(now, hand(t), t % 1.7 > 0.2));
        }
        let joints = JointReading { stamp: now, q, qd, motion_allowed: true };
        let given = Given {
            now,
            budget: Budget::default(),
            joints: Some(joints),
            effort: None,
            enable: None,
            request: (tick == 5).then_some(Request::Arm),
            halt: None,
            weights: None,
            preview: coming.is_some(),
            unsent: false,
            pen_samples: pen.len() as u32,
            complete: true,
        };
        let weights = fresh.take();
        let preview = coming.take();
        if let Some(preview) = &preview {
            let bytes = state::bytes_of(preview).unwrap();
            previews.push(Thing { kind: PieceKind::Preview, number: tick, daemon_id: DAEMON, bytes });
        }
        let input = given.step_input(&pen, weights.as_deref(), preview.as_ref());
        let output = follower.step(&input, given.budget, &mut NoClock);
        for step in output.learn.iter().take(output.learn_count) {
            if foreseen {
                let mut preview =
                    ExternalPreview { base_index: step.index, count: 64, ..ExternalPreview::EMPTY };
                for (ahead, slot) in (1..).zip(&mut preview.positions) {
                    let at_ns = (step.index + ahead) * step_ns;
                    *slot = plane.from_pen(hand((at_ns as f64 - origin_ns as f64) * 1e-9));
                }
                coming = Some(preview);
            }
            if config.settings().learner.enabled && learner.learn(step).hand_over {
                fresh = Some(Box::new(*learner.weights()));
            }
        }
        let mut sent = wire::tick_input(tick, DAEMON, &given, &output);
        wire::pen_part(&mut sent, 0, &pen);
        sent.header.stamp_ns = now.0;
        inputs.push(sent);
        let moved = arm.cycle(target);
        (q, qd) = (moved.q, moved.qd);
        target = output.command.map_or(target, |command| command.q);
    }
    let settings = Thing {
        kind: PieceKind::Settings,
        number: 0,
        daemon_id: DAEMON,
        bytes: config.render().into_bytes(),
    };
    (inputs, servo.group_delay_s(), settings, previews)
}

/// The fallback is Hold, so that every figure tells whether the previews were used.
#[test]
fn previews_of_another_process_come_again_in_a_replay_and_in_front_of_another_law() {
    let place = TempDir::new().unwrap();
    let draft =
        Draft::preset("ur5").set("predictor.kind", "external").set("predictor.external.fallback", "hold");
    let draft = draft.set("learner.enabled", "false");
    let config = draft.finish().unwrap();
    let (inputs, _, settings, previews) = recorded(&config, true);
    assert!(previews.len() > 500, "{}", previews.len());
    let mut things = vec![&settings];
    things.extend(&previews);
    let file = written(&place, "run.mcap", &things, &inputs);
    let again = replayed(&file);
    assert_eq!(
        (again.ticks, again.difference, &again.end),
        (inputs.len() as u64, None, &ReplayEnd::OfRecording)
    );
    let answer = what_if(&file, &[Variant::parse("predictor=hold").unwrap()], 2).unwrap();
    let rms = |row: usize| answer.rows[row].rms_mm;
    println!("{} mm as recorded, {} mm again, {} mm by hold", rms(0), rms(1), rms(2));
    assert_eq!(answer.previews_missing, 0);
    // Samples newer than the grid leave Hold little to be worse by.
    assert!(
        (rms(1) / rms(0) - 1.0).abs() < 0.01 && rms(2) > 1.03 * rms(1),
        "{} {} {}",
        rms(0),
        rms(1),
        rms(2)
    );

    // Some are lost: that is where a replay ends, and another law is told how many.
    things.truncate(400);
    let number = previews[399].number;
    let file = written(&place, "lost.mcap", &things, &inputs);
    let again = replayed(&file);
    assert_eq!(
        (again.ticks, again.difference, again.end),
        (number - 1, None, ReplayEnd::NoPreview { tick: number })
    );
    let answer = what_if(&file, &[], 1).unwrap();
    assert_eq!(answer.previews_missing, previews.len() - 399);
    // Without any there is nothing of that predictor to show.
    let file = written(&place, "none.mcap", &[&settings], &inputs);
    let refused = what_if(&file, &[], 1).unwrap_err().to_string();
    assert!(refused.contains("holds no preview"), "{refused}");
}

#[test]
fn another_law_is_judged_by_the_same_hand_behind_the_arm_of_the_recording() {
    let place = TempDir::new().unwrap();
    let (inputs, lag_s, settings) = behind_a_servo();
    let file = written(&place, "run.mcap", &[&settings], &inputs);
    let variants: Vec<_> =
        ["predictor=hold", "trust=0", "trust=1"].map(|text| Variant::parse(text).unwrap()).into();
    let answer = what_if(&file, &variants, 2).unwrap_or_else(|error| panic!("{error}"));
    let rms = |row: usize| answer.rows[row].rms_mm;
    let names: Vec<_> = answer.rows.iter().map(|row| row.name.as_str()).collect();
    assert_eq!(
        names,
        ["as recorded", "recorded settings, learner cold", "predictor=hold", "trust=0", "trust=1"]
    );
    println!("{answer:#?}");
    assert!((answer.arm.lag_s() - lag_s).abs() < 3e-3, "{} for {lag_s}", answer.arm.lag_s());
    assert!(answer.arm_misfit_mm < 0.2, "{} mm", answer.arm_misfit_mm);
    // The same law behind the modelled arm does as it did behind the real one.
    assert!((rms(1) / rms(0) - 1.0).abs() < 0.05, "{} {}", rms(0), rms(1));
    // Nothing predicted is worse on such a hand, and nothing refined either much worse.
    assert!(rms(2) > 1.02 * rms(1) && rms(3) > 2.0 * rms(1), "{} {} {}", rms(1), rms(2), rms(3));
    assert!(answer.rows.iter().all(|row| row.worst_stroke_mm >= 0.9 * row.rms_mm && row.stopped.is_none()));
    // All of it as a picture: a curve and a stroke of each.
    assert!(answer.curves.iter().all(|curve| curve.error_mm.len() > 20 && curve.tool.len() > 20));
    assert!((answer.curves[0].stroke_mm - answer.rows[0].worst_stroke_mm).abs() < 1e-9);
    let picture = place.path().join("picture.svg");
    draw(&picture, "run.mcap", &answer).unwrap();
    let svg = std::fs::read_to_string(&picture).unwrap();
    for words in ["What if: run.mcap", "as recorded: ", "trust=0: ", "time [s]", "robot, pen down"] {
        assert!(svg.contains(words), "{words}");
    }
    // The same on every machine, however many threads there are.
    assert_eq!(what_if(&file, &variants, 1).unwrap(), answer);
    assert!(answer.gone.is_empty());

    // With settings of a version that had more of them.
    let text = String::from_utf8(settings.bytes.clone()).unwrap();
    let before = text.replacen("[trust]\n", "[trust]\nproof_cases = 1\n", 1);
    assert_ne!(before, text);
    let before = Thing { bytes: before.into_bytes(), ..settings.clone() };
    let older = written(&place, "older.mcap", &[&before], &inputs);
    let of_older = what_if(&older, &variants, 2).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(of_older.rows, answer.rows);
    assert_eq!(of_older.gone, replayed(&older).gone);
    assert!(of_older.gone.len() == 1 && of_older.gone[0].contains("trust.proof_cases"), "{of_older:?}");

    let bytes = std::fs::read(&file).unwrap();
    let cut = place.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() * 8 / 10]).unwrap();
    let early = what_if(&cut, &[], 1).unwrap_or_else(|error| panic!("{error}"));
    assert!(answer.damage.is_none() && early.damage.is_some() && early.seconds < answer.seconds);
    let wrong = Variant::parse("mpc.horizon=7").unwrap();
    let reported = what_if(&file, &[wrong], 1).unwrap_err().to_string();
    assert!(reported.contains("mpc.horizon") && reported.contains("10, 20"), "{reported}");
    let short = written(&place, "short.mcap", &[&settings], &inputs[..40]);
    let reported = what_if(&short, &variants, 1).unwrap_err().to_string();
    assert!(
        reported.contains("cannot be told from the recording") || reported.contains("the recording has"),
        "{reported}"
    );
}
