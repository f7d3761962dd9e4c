//! The closed-loop benchmark on synthetic handwriting: comparisons and counts.

use foretrace_config::{Config, Draft};
use foretrace_control::estimate::LawParameters;
use foretrace_lab::baselines::{BaselineKind, BaselineSettings, Limits, build, soften};
use foretrace_lab::closed_loop::{
    BenchArm, BenchRow, Benchmark, Flaws, Hand, MethodOutcome, Rival, Sequence, SequenceScore, hands,
};
use foretrace_sim::data::{DataSet, Split, median_glyph_height};
use foretrace_sim::metrics::ToolSample;
use foretrace_sim::path::{Lift, PathSample, Placement};
use foretrace_sim::writer::text_path;

const PERIOD_S: f64 = 0.002;

pub(crate) fn config() -> Config {
    let config = Config::preset("ur5e").unwrap();
    assert_eq!(config.settings().period_ns(), 2_000_000);
    config
}

pub(crate) fn hand(arm: BenchArm, config: &Config, letters: &[&str]) -> Hand {
    let placement = Placement {
        centre_m: arm.centre_m(config),
        size_m: arm.paper_m(config),
        glyph_height_m: 0.03,
        ..Placement::default()
    };
    let sequences = letters
        .iter()
        .zip(1..)
        .map(|(label, seed)| {
            let path = text_path(label, seed, 200.0, &placement).unwrap();
            let behind_leap = vec![false; path.samples.len()];
            Sequence { label: (*label).to_owned(), path, behind_leap }
        })
        .collect();
    Hand { file: format!("{}.dat", letters.concat()), writer: String::new(), sequences }
}

fn benchmark<'a>(config: &'a Config, arms: &[BenchArm], names: &[&str]) -> Benchmark<'a> {
    let hands = |arm| vec![hand(arm, config, &["a", "8"]), hand(arm, config, &["K"])];
    Benchmark {
        config,
        arms: arms.iter().map(|arm| (*arm, hands(*arm))).collect(),
        rivals: names.iter().map(|name| Rival::named(name).unwrap()).collect(),
        flaws: Flaws::default(),
        law: LawParameters::SHIPPED,
    }
}

/// Targets of a baseline that receives `path` after 1.2 s of a resting pen, as at the benchmark's desks.
fn targets(kind: BaselineKind, settings: &BaselineSettings, path: &[PathSample]) -> Vec<ToolSample> {
    let mut way = build(kind, settings).unwrap();
    if kind.smooths_in_the_servo() {
        way = soften(way, settings);
    }
    let first = path[0];
    let waiting =
        (0..240).map(|i| PathSample { t_s: first.t_s - 1.2 + 0.005 * f64::from(i), contact: false, ..first });
    let mut pen = waiting.chain(path.iter().copied()).peekable();
    let periods = ((path.last().unwrap().t_s - first.t_s + 1.2) / PERIOD_S) as u32;
    (0..=periods)
        .map(|k| {
            let now_s = first.t_s - 1.2 + PERIOD_S * f64::from(k);
            let mut heard = Vec::new();
            while let Some(sample) = pen.next_if(|sample| sample.t_s <= now_s + 1e-9) {
                heard.push(sample);
            }
            let [x_m, y_m] = way.target(now_s, &heard).unwrap();
            ToolSample { t_s: now_s + PERIOD_S, x_m, y_m }
        })
        .collect()
}

#[test]
fn before_an_ideal_arm_a_way_is_where_it_wants_to_be() {
    let config = config();
    let benchmark = benchmark(&config, &[BenchArm::Ideal], &["hold"]);
    let hand = hand(BenchArm::Ideal, &config, &["a"]);
    for kind in BaselineKind::ALL {
        let rival = Rival::named(kind.name()).unwrap();
        let run = benchmark.replay(rival, BenchArm::Ideal, &hand, 0).unwrap().unwrap();
        let settings =
            BaselineSettings::new(kind, PERIOD_S, 0.0, Limits::OFF, BenchArm::Ideal.glyph_height_m());
        let wanted = targets(kind, &settings, &hand.sequences[0].path.samples);
        assert!(wanted.len() <= run.tool.len() && wanted.len() > 600);
        for (tool, wanted) in run.tool.iter().zip(&wanted) {
            assert!((tool.t_s - wanted.t_s).abs() < 1e-6, "{tool:?} {wanted:?}");
            let off_m = (tool.x_m - wanted.x_m).hypot(tool.y_m - wanted.y_m);
            // Time-optimal motion amplifies rounding of the clock; an error of one period would be 0.2 mm and
            // more.
            let most_m = if kind == BaselineKind::Otg { 1e-4 } else { 1e-6 };
            assert!(off_m < most_m, "{kind} at {}: {off_m}", tool.t_s);
        }
        for (tool, tick) in run.tool.iter().zip(&run.ticks) {
            let [x, y] = tick.setpoint;
            assert!((tool.x_m - x).hypot(tool.y_m - y) < 1e-8, "{kind}: {tool:?} {tick:?}");
        }
    }
}

/// Also of a predictor that learns from what the hand wrote before, and in any order.
#[test]
fn sequences_that_are_written_again_are_the_same() {
    let config = config();
    let benchmark = benchmark(&config, &[BenchArm::Ur5], &["hold", "mixture"]);
    let outcomes = benchmark.run(|| {}).unwrap();
    let (arm, hands) = &benchmark.arms[0];
    let asked = [(1, 0, 1), (0, 1, 0), (1, 1, 0), (1, 0, 0), (1, 0, 1), (1, 0, 2)];
    let wanted: Vec<_> =
        asked.iter().map(|(who, hand, index)| (benchmark.rivals[*who], &hands[*hand], *index)).collect();
    let runs = benchmark.replay_all(*arm, &wanted).unwrap();
    assert_eq!(runs.len(), asked.len());
    for ((who, hand, index), run) in asked.into_iter().zip(&runs) {
        let Some(sequence) = hands[hand].sequences.get(index) else {
            assert!(run.is_none());
            continue;
        };
        let before: usize = hands[..hand].iter().map(|hand| hand.sequences.len()).sum();
        let again = SequenceScore::of(sequence, run.as_ref().unwrap());
        assert_eq!(
            format!("{again:?}"),
            format!("{:?}", outcomes[who].scores[before + index]),
            "{who} {hand} {index}"
        );
    }
}

#[test]
fn the_servo_of_a_way_counts_on_the_ur5_and_changes_nothing_on_the_slow_arm() {
    let config = config();
    let arms = [BenchArm::Delay30, BenchArm::Ur5, BenchArm::Slow];
    let benchmark = benchmark(&config, &arms, &["hold", "servoj-gello", "servoj-ros"]);
    let rows = MethodOutcome::table(&benchmark.run(|| {}).unwrap());
    let lag = |arm: BenchArm, name: &str| find(&rows, arm, name).lag_ms;
    for arm in [BenchArm::Delay30, BenchArm::Ur5] {
        let more = lag(arm, "servoj-gello") - lag(arm, "servoj-ros");
        assert!((50.0..100.0).contains(&more), "{arm:?}: {more}");
    }
    // Only the filters differ there.
    let more = lag(BenchArm::Slow, "servoj-gello") - lag(BenchArm::Slow, "servoj-ros");
    assert!((-5.0..15.0).contains(&more), "{more}");
    // A filter of 100 ms turns letters by less than 100 ms, but by more than twice what the UR5's servo does.
    assert!(lag(BenchArm::Slow, "servoj-ros") > 2.0 * lag(BenchArm::Ur5, "servoj-ros"));
}

#[test]
fn hold_is_never_worse_than_itself_and_rows_say_everything() {
    let config = config();
    let names = ["hold", "mixture", "servoj-ros", "servoj-ros-legal", "kalman-legal", "oracle"];
    let benchmark = benchmark(&config, &[BenchArm::Ur5], &names);
    let rows = MethodOutcome::table(&benchmark.run(|| {}).unwrap());
    let hold = find(&rows, BenchArm::Ur5, "hold");
    assert_eq!((hold.worse_than_hold_pct, hold.worst_beyond_hold_m), (Some(0.0), Some(0.0)));
    assert!(find(&rows, BenchArm::Ur5, "oracle").mse_m2 < 0.3 * hold.mse_m2);
    // The law's commands keep the joints' limits; a stream that jumps with every sample does not.
    for legal in ["hold", "mixture", "oracle", "servoj-ros-legal", "kalman-legal"] {
        assert_eq!(find(&rows, BenchArm::Ur5, legal).illegal_pct, 0.0, "{legal}");
    }
    let [free, legal] = ["servoj-ros", "servoj-ros-legal"].map(|name| find(&rows, BenchArm::Ur5, name));
    assert!(free.illegal_pct > 5.0);
    // It is the same baseline, with tighter limits.
    assert!((0.9..2.0).contains(&(legal.mse_m2 / free.mse_m2)), "{} {}", legal.mse_m2, free.mse_m2);
    for row in &rows {
        assert_eq!(row.sequences, 3);
        let json = serde_json::to_value(row).unwrap();
        assert!(json["predictor"].is_string() && json["arm"] == "ur5", "{json}");
        // Beside `hold`, on one arm and without jumps, every score is known.
        let unknown = json.as_object().unwrap().iter().filter(|(_, value)| value.is_null());
        let unknown: Vec<_> = unknown.map(|(key, _)| key.as_str()).collect();
        assert!(unknown.is_empty() || unknown == ["leap_mse_m2"], "{unknown:?}: {json}");
        let numbers = json.as_object().unwrap().values().filter(|value| value.is_number()).count();
        assert!(numbers >= 11, "{json}");
    }
}

#[test]
fn many_threads_give_the_numbers_of_one() {
    let config = config();
    let names = ["hold", "mixture", "dybm", "kalman"];
    let benchmark = benchmark(&config, &[BenchArm::Delay30], &names);
    for outcome in benchmark.run(|| {}).unwrap() {
        let (arm, hands) = &benchmark.arms[0];
        let alone: Vec<_> = hands
            .iter()
            .flat_map(|hand| (0..hand.sequences.len()).map(move |index| (hand, index)))
            .map(|(hand, index)| {
                let run = benchmark.replay(outcome.rival, *arm, hand, index).unwrap().unwrap();
                SequenceScore::of(&hand.sequences[index], &run)
            })
            .collect();
        assert_eq!(alone.len(), 3);
        // Absent parts of a score are NaN, which equals nothing.
        let text = |scores: &[Option<SequenceScore>]| format!("{scores:?}");
        assert_eq!(text(&alone), text(&outcome.scores), "{}", outcome.rival.name());
    }
}

#[test]
fn what_lies_behind_an_unrecorded_lift_is_scored_apart() {
    let folder = tempfile::tempdir().unwrap();
    let stroke = |x: f64| -> String {
        let points = (0..80).map(|i| {
            let angle = 0.08 * f64::from(i);
            format!("{:.0} {:.0}\n", x + 200.0 * angle.cos(), 200.0 * angle.sin())
        });
        format!(".PEN_DOWN\n{}.PEN_UP\n", points.collect::<String>())
    };
    let text = format!(
        ".VERSION 1.0\n.COORD X Y\n.POINTS_PER_SECOND 200\n.HIERARCHY CHARACTER\n{}{}.SEGMENT CHARACTER 0-1 \
         OK \"8\"\n",
        stroke(0.0),
        stroke(500.0)
    );
    std::fs::write(folder.path().join("w.dat"), text).unwrap();
    let set = DataSet::load(folder.path(), &Split::All, true).unwrap();
    let height = median_glyph_height(set.characters()).unwrap();
    let config = config();
    let row = |lift| {
        let (placed, left_out) = hands(&set, height, BenchArm::Ideal, &config, lift).unwrap();
        assert_eq!((placed.len(), left_out), (1, 0));
        let benchmark = Benchmark {
            config: &config,
            arms: vec![(BenchArm::Ideal, placed)],
            rivals: vec![Rival::HOLD],
            flaws: Flaws::default(),
            law: LawParameters::SHIPPED,
        };
        MethodOutcome::table(&benchmark.run(|| {}).unwrap()).remove(0)
    };
    let leap = row(Lift::Leap);
    let behind = leap.leap_mse_m2.unwrap();
    assert!(behind > 2.0 * leap.mse_m2, "{behind:e} {:e}", leap.mse_m2);
    assert_eq!(row(Lift::Travel).leap_mse_m2, None);
}

/// A pen that jumps across the whole paper; joints without limits follow within a tick, where a real arm that
/// is so far from what its answer to the commands was would be a fault.
#[test]
fn an_arm_without_limits_follows_every_jump_of_the_pen() {
    let config = config();
    for arm in [BenchArm::Ideal, BenchArm::Delay30] {
        let [x, y] = arm.centre_m(&config);
        let mut writer = hand(arm, &config, &["m", "w", "8"]);
        for (index, sample) in writer.sequences.iter_mut().flat_map(|s| &mut s.path.samples).enumerate() {
            let side = if index / 30 % 2 == 0 { 0.12 } else { -0.12 };
            (sample.x_m, sample.y_m) = (0.4 * sample.x_m + 0.6 * x + side, 0.4 * sample.y_m + 0.6 * y - side);
        }
        let benchmark = Benchmark {
            config: &config,
            arms: vec![(arm, vec![writer])],
            rivals: vec![Rival::HOLD, Rival::AS_SHIPPED],
            flaws: Flaws::default(),
            law: LawParameters::SHIPPED,
        };
        assert_eq!(benchmark.run(|| {}).unwrap().len(), 2, "{}", arm.name());
    }
}

#[test]
fn writers_who_take_turns_in_a_file_are_hands_of_their_own() {
    let digit = |place: u32, (writer, turn): (u32, u32)| {
        let points: String = (0..60_u32)
            .map(|i| {
                let angle = 0.1 * f64::from(i) * (1.0 + 0.2 * f64::from(turn) - 0.3 * f64::from(writer));
                format!("{:.0} {:.0}\n", 90.0 * angle.cos() + f64::from(i), 90.0 * angle.sin())
            })
            .collect();
        format!(
            ".SEGMENT DIGIT {place} ? \"{turn}\"\n.COMMENT {turn} {writer} 0\n.PEN_DOWN\n{points}.PEN_UP\n"
        )
    };
    let config = config();
    let scores = |order: [(u32, u32); 6]| {
        let folder = tempfile::tempdir().unwrap();
        let text: String = (0..).zip(order).map(|(place, each)| digit(place, each)).collect();
        std::fs::write(folder.path().join("digits.tes"), text).unwrap();
        let set = DataSet::load(folder.path(), &Split::All, true).unwrap();
        let height = median_glyph_height(set.characters()).unwrap();
        let (placed, left_out) = hands(&set, height, BenchArm::Ur5, &config, Lift::Leap).unwrap();
        assert_eq!(left_out, 0);
        let writers: Vec<_> = placed.iter().map(|hand| (hand.writer.clone(), hand.sequences.len())).collect();
        assert_eq!(writers, [("tes-2".to_owned(), 3), ("tes-1".to_owned(), 3)]);
        let benchmark = Benchmark {
            config: &config,
            arms: vec![(BenchArm::Ur5, placed)],
            rivals: vec![Rival::AS_SHIPPED],
            flaws: Flaws::default(),
            law: LawParameters::SHIPPED,
        };
        let outcomes = benchmark.run(|| {}).unwrap();
        let names = benchmark.names();
        let each: Vec<_> = MethodOutcome::each(&names, &outcomes).collect();
        each.iter().map(|each| (each.writer.to_owned(), each.index, each.score.mse_m2)).collect::<Vec<_>>()
    };
    let apart = scores([(2, 0), (2, 1), (2, 2), (1, 0), (1, 1), (1, 2)]);
    assert_eq!(scores([(2, 0), (1, 0), (2, 1), (1, 1), (1, 2), (2, 2)]), apart);
    // Earlier sequences matter.
    assert_ne!(scores([(2, 1), (2, 0), (2, 2), (1, 0), (1, 1), (1, 2)])[2], apart[2]);
}

#[test]
fn leaps_of_the_pen_do_not_throw_an_arm_without_limits() {
    let config = config();
    let hand = |arm| {
        let mut hand = hand(arm, &config, &["a", "8", "K", "e", "s"]);
        let [centre_x, centre_y] = arm.centre_m(&config);
        for (sequence, turn) in hand.sequences.iter_mut().zip(0_u32..) {
            let (sin, cos) = (0.7 * f64::from(turn)).sin_cos();
            // From edge to edge of the paper and back within a sample.
            for (sample, number) in sequence.path.samples.iter_mut().zip(0..) {
                let way = if number / 60 % 2 == 0 { -0.2 } else { 0.2 };
                (sample.x_m, sample.y_m) = (
                    centre_x + 0.5 * (sample.x_m - centre_x) + way * cos,
                    centre_y + 0.5 * (sample.y_m - centre_y) + way * sin,
                );
            }
        }
        hand
    };
    let arms = [BenchArm::Ideal, BenchArm::Delay30].map(|arm| (arm, vec![hand(arm)])).to_vec();
    let rivals = ["mixture", "dybm", "mixture-trust1"].map(|name| Rival::named(name).unwrap()).to_vec();
    for row in MethodOutcome::table(
        &Benchmark { config: &config, arms, rivals, flaws: Flaws::default(), law: LawParameters::SHIPPED }
            .run(|| {})
            .unwrap(),
    ) {
        // The jump itself is 0.4 m.
        println!("{} {}: {:.3} m at most, {:.3e} m²", row.arm, row.predictor, row.max_m, row.mse_m2);
        assert!(row.max_m < 0.45, "{} {}: {} m", row.arm, row.predictor, row.max_m);
    }
}

#[test]
fn sweeps_hold_the_shipped_point_and_lead_from_smooth_to_stiff() {
    let config = config();
    let arms = [BenchArm::Ideal, BenchArm::Ur5, BenchArm::Slow];
    let mut benchmark = benchmark(&config, &arms, &["hold", "mixture", "servoj-ros", "kalman"]);
    benchmark.arms.iter_mut().for_each(|(_, hands)| hands.truncate(1));
    let rows = MethodOutcome::table(&benchmark.run(|| {}).unwrap());
    let mut heard = 0;
    let sweep = benchmark.pareto_sweep();
    let jobs = sweep.jobs;
    let points = benchmark.pareto(sweep, || heard += 1).unwrap();
    assert_eq!(heard, jobs);
    for row in &rows {
        let swept: Vec<_> = points.iter().filter(|p| p.arm == row.arm && p.method == row.predictor).collect();
        let count = match (row.predictor.as_str(), row.arm) {
            ("mixture", "ideal") => 12,
            ("mixture", _) => 11,
            ("hold", _) => 8,
            // The slow arm's servo is fixed.
            ("servoj-ros", "slow") => 6,
            ("servoj-ros", _) => 10,
            _ => 9,
        };
        assert_eq!(swept.len(), count, "{swept:#?}");
        let shipped: Vec<_> = swept.iter().filter(|point| point.default).collect();
        assert_eq!(shipped.len(), 1);
        assert_eq!((shipped[0].rms_m, shipped[0].rms_jerk), (row.mse_m2.sqrt(), row.rms_jerk));
        let mut labels: Vec<_> = swept.iter().map(|point| &point.label).collect();
        labels.dedup();
        assert_eq!(labels.len(), swept.len());
        let jerk = |label: &str| swept.iter().find(|point| point.label == label).unwrap().rms_jerk;
        // The jerk of a slow arm is the arm's own.
        if row.arm == "ideal" && ["hold", "mixture"].contains(&row.predictor.as_str()) {
            assert!(jerk("gains x 0.05") < 0.7 * jerk("default"), "{swept:#?}");
        }
        if row.arm == "ur5" && row.predictor == "mixture" {
            assert!(jerk("trust to 0.1, damping x 2") < 0.5 * jerk("default"), "{swept:#?}");
        }
    }
    let json = serde_json::to_value(&points).unwrap();
    for key in ["method", "label", "arm", "rms_m", "rms_jerk"] {
        assert!(!json[0][key].is_null(), "{key}: {}", json[0]);
    }
}

#[test]
fn points_that_the_law_refuses_are_left_out_of_a_sweep_and_named() {
    let config = Draft::preset("ur5").set("mpc.horizon", "10").finish().unwrap();
    let mut benchmark = benchmark(&config, &[BenchArm::Ideal], &["mixture"]);
    benchmark.arms.iter_mut().for_each(|(_, hands)| hands.truncate(1));
    let sweep = benchmark.pareto_sweep();
    let refused = sweep.refused.clone();
    let points = benchmark.pareto(sweep, || {}).unwrap();
    assert!(!refused.is_empty() && points.len() + refused.len() == 12, "{refused:#?}");
    for message in &refused {
        assert!(
            message.starts_with("mixture on ideal, gains x 0.0") && message.contains("does not settle"),
            "{message}"
        );
        assert!(points.iter().all(|point| !message.contains(&format!(", {}:", point.label))), "{message}");
    }
}

#[test]
fn the_lead_of_the_presets_is_for_arms_behind_a_servo_and_for_what_is_not_known() {
    let with = |lead_ms: Option<&str>| {
        let draft = Draft::preset("ur5e");
        let config = lead_ms.map_or(draft.clone(), |ms| draft.set("mpc.velocity_lead_ms", ms)).finish();
        let config = config.unwrap();
        let arms = [BenchArm::Ideal, BenchArm::Delay30, BenchArm::Ur5];
        let mut benchmark = benchmark(&config, &arms, &["constant-velocity", "oracle"]);
        benchmark.arms.iter_mut().for_each(|(_, hands)| hands.truncate(1));
        let rows = benchmark.run(|| {}).unwrap();
        rows.iter().map(|outcome| format!("{:?}", outcome.scores)).collect::<Vec<_>>()
    };
    let [preset, none, asked] = [None, Some("0.0"), Some("7.0")].map(with);
    // Two predictors on each of three arms, the arms outside.
    let same = |other: &[String]| preset.iter().zip(other).map(|(a, b)| a == b).collect::<Vec<_>>();
    assert_eq!(same(&none), [true, true, true, true, false, true]);
    assert_eq!(same(&asked), [false, false, false, false, true, false]);
}

#[test]
fn a_name_that_nobody_has_is_answered_with_all_names_in_order() {
    let error = Rival::named("servoj").unwrap_err();
    let names = "hold constant-velocity dybm dybm-esn lstm ar-rls mixture-trust1 mixture \
                 servoj-gello \
                 servoj-ros otg kalman oracle servoj-gello-legal servoj-ros-legal otg-legal kalman-legal";
    assert_eq!(error.known.join(" "), names);
    assert!(error.to_string().contains(names), "{error}");
}

/// Behind a network every sample is old when it arrives: the pen does not rest meanwhile.
#[test]
fn samples_that_are_old_on_arrival_are_predicted_up_to_the_age_that_the_settings_allow() {
    let errors = |stale_ms: &str, age_ms: u64| {
        let config = Draft::preset("ur5").set("pen.stale_ms", stale_ms).finish().unwrap();
        let mut benchmark = benchmark(&config, &[BenchArm::Ur5], &["hold", "mixture"]);
        benchmark.flaws.pen_age_ns = age_ms * 1_000_000;
        let rows = MethodOutcome::table(&benchmark.run(|| {}).unwrap());
        let rms_mm = |name| find(&rows, BenchArm::Ur5, name).mse_m2.sqrt() * 1e3;
        (rms_mm("hold"), rms_mm("mixture"))
    };
    for (stale_ms, age_ms, most) in
        [("100", 20, 0.6), ("100", 60, 0.8), ("300", 120, 0.95), ("340", 300, 1.05)]
    {
        let (hold, predicted) = errors(stale_ms, age_ms);
        println!("age {age_ms} ms: hold {hold:.2} mm, predicted {predicted:.2} mm");
        assert!(predicted < most * hold, "age {age_ms} ms: {predicted} mm beside {hold} mm");
    }
    // Older than allowed: motion does not begin. What happens to a stream that becomes older:
    // daemon/control/tests/law/follower.rs.
    let ((hold, predicted), standing) = (errors("100", 90), errors("100", 130));
    assert!(predicted < 0.95 * hold, "{predicted} mm beside {hold} mm");
    assert_eq!(standing.0, standing.1, "with and without prediction the arm stands");
}

fn find<'a>(rows: &'a [BenchRow], arm: BenchArm, name: &str) -> &'a BenchRow {
    rows.iter().find(|row| row.arm == arm.name() && row.predictor == name).unwrap()
}
