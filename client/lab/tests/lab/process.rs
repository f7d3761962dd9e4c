//! Predictors in other programs, in tables and in closed loop: figures, order, cores, failures.

use foretrace_config::Draft;
use foretrace_control::estimate::LawParameters;
use foretrace_lab::closed_loop::{BenchArm, Benchmark, Flaws, Hand, MethodOutcome, Rival};
use foretrace_lab::prediction::lead_time::{Entrant, compare};
use foretrace_lab::prediction::{CharacterSequence, Model, Set, score};

use crate::closed_loop::{config, hand};

/// A predictor in Python: `ahead` gives the positions after `step`; `n` counts the steps from 1.
fn program(ahead: &str) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let text = format!(
        "import json, sys\nn = 0\nfor line in sys.stdin:\n    told, answer = json.loads(line), {{}}\n    \
         step = told.get('step')\n    if step:\n        n += 1\n        \
         wanted = range(1, step['wanted'] + 1)\n        {ahead}\n        \
         if step['wanted'] and positions: answer = {{'positions': positions}}\n    \
         print(json.dumps(answer), flush=True)\n"
    );
    std::fs::write(folder.path().join("predictor.py"), text).unwrap();
    let name = format!("external:python3 {}", folder.path().join("predictor.py").display());
    (folder, name)
}

const CONSTANT_VELOCITY: &str =
    "positions = [[step['x'] + i * step['dx'], step['y'] + i * step['dy']] for i in wanted]";

/// Two files of three characters in whole units, with a lift in each.
fn set() -> Set {
    let character = |file: usize, segment: usize| {
        let way = |i: usize| {
            let angle = 0.11 * i as f64 * (1.0 + 0.1 * (file + segment) as f64);
            [(90.0 * angle.cos() + 2.0 * i as f64).round(), (90.0 * angle.sin()).round()]
        };
        let mut v: Vec<[f64; 2]> =
            (0..70).map(|i| [0, 1].map(|axis| way(i + 1)[axis] - way(i)[axis])).collect();
        v[40] = [150.0, -80.0];
        v.extend([[0.0; 2]; 5]);
        CharacterSequence {
            file: format!("w{file}.dat"),
            writer: String::new(),
            segment,
            label: "x".to_owned(),
            jump: (0..v.len()).map(|t| t == 40).collect(),
            v,
            rate_hz: 200.0,
            rate_assumed: false,
            units_per_m: Some([50_000.0; 2]),
        }
    };
    let scored = (0..2).flat_map(|file| (0..3).map(move |segment| character(file, segment))).collect();
    let (refused, damaged, remarks) = (Vec::new(), Vec::new(), Vec::new());
    let (name, split) = ("pens".to_owned(), "test".to_owned());
    Set { name, split, scored, train: Vec::new(), cold: false, refused, damaged, remarks }
}

#[test]
fn constant_velocity_in_another_program_has_the_figures_of_the_built_in_one() {
    // The document's.
    let page = include_str!("../../../../docs/extend/process.md");
    let (_, text) = page.split_once("```python\n").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.py");
    std::fs::write(&file, text.split_once("```").unwrap().0).unwrap();
    let name = format!("external:python3 {}", file.display());
    let names = format!("constant-velocity,{name}");
    // Positions are whole numbers: sums and differences of them are exact on both ways.
    let scored = score(&Model::list(&names).unwrap(), &set(), &|| ()).unwrap();
    let [built_in, mut other] = <[_; 2]>::try_from(scored.rows).unwrap();
    assert_eq!(other.model, name);
    (other.model, other.us_per_step) = (built_in.model.clone(), built_in.us_per_step);
    assert_eq!(other, built_in);
    let entrants: Vec<_> = Model::list(&names).unwrap().into_iter().map(Entrant::Model).collect();
    let (boards, standings) = compare(&entrants, &[set()], &|| ()).unwrap();
    let [built_in, other] = &boards[0].models[..] else { panic!("two lanes") };
    assert_eq!((&other.leads, standings.len()), (&built_in.leads, 2));
    assert!(built_in.leads[0].targets > 50);
}

#[test]
fn a_step_without_a_preview_is_told_too_and_no_preview_is_a_pen_at_rest() {
    // Says where it was five steps ago, which needs every step; before, nothing.
    let memory = "seen = [] if step['motion'] == 'start' else seen; seen.append([step['x'], step['y']]); \
                  positions = [seen[-5]] * len(wanted) if len(seen) > 5 else None";
    let (_folder, name) = program(memory);
    let entrants: Vec<_> =
        Model::list(&format!("hold,{name}")).unwrap().into_iter().map(Entrant::Model).collect();
    let set = set();
    let (boards, _) = compare(&entrants, std::slice::from_ref(&set), &|| ()).unwrap();
    let [hold, other] = &boards[0].models[..] else { panic!("two lanes") };
    // At 200 Hz instants are four steps apart: five steps back is one that was told without a preview.
    assert!(other.leads[0].rms > hold.leads[0].rms);
    let (_folder, silent) = program("positions = None");
    let names = format!("hold,{silent}");
    let rows = score(&Model::list(&names).unwrap(), &set, &|| ()).unwrap().rows;
    assert_eq!((rows[0].mse, &rows[0].pos_mse), (rows[1].mse, &rows[1].pos_mse));
}

#[test]
fn a_program_that_fails_ends_the_table_with_what_and_where() {
    let refused = |ahead: &str| {
        let (_folder, name) = program(ahead);
        let models = Model::list(&name).unwrap();
        let table = score(&models, &set(), &|| ()).unwrap_err().to_string();
        let entrants: Vec<_> = models.into_iter().map(Entrant::Model).collect();
        let leads = compare(&entrants, &[set()], &|| ()).unwrap_err().to_string();
        assert!(table.starts_with(&name) && leads.starts_with(&name), "{table} {leads}");
        [table, leads]
    };
    // A sequence has 76 steps, its start included: the 100th is step 23 of the second character.
    for text in refused("positions = None\n        if n == 100: sys.exit(7)") {
        assert!(
            text.contains(", w0.dat, character 1 (\"x\"): at step 23: it ended (exit status: 7)"),
            "{text}"
        );
    }
    for text in refused("positions = [[0.0, 0.0]] * (len(wanted) + (n > 232 and len(wanted) > 0))") {
        assert!(text.contains("w1.dat, character 0") && text.contains("positions, wanted are"), "{text}");
    }
    // The last step of all, which nobody asks a preview of.
    for text in refused("positions = None\n        if n == 456: print('done')") {
        assert!(text.contains("w1.dat, character 2") && text.contains("at step 75"), "{text}");
    }
    let text = score(&Model::list("external:exit 9").unwrap(), &set(), &|| ()).unwrap_err().to_string();
    let wanted =
        "external:exit 9: in answer to the greeting: it ended (exit status: 9); its own output says why";
    assert!(text.starts_with(wanted), "{text}");
    for empty in ["external:", "external:  "] {
        let text = Model::named(empty).unwrap_err().to_string();
        assert!(text.contains("external:COMMAND"), "{text}");
        assert!(Rival::named(empty).unwrap_err().to_string().contains("external:COMMAND"));
    }
}

fn scores(config: &foretrace_config::Config, names: &[&str], hands: Vec<Hand>) -> Vec<MethodOutcome> {
    let benchmark = Benchmark {
        config,
        arms: vec![(BenchArm::Ur5, hands)],
        rivals: names.iter().map(|name| Rival::named(name).unwrap()).collect(),
        flaws: Flaws::default(),
        law: LawParameters::SHIPPED,
    };
    benchmark.run(|| {}).unwrap()
}

fn written(outcome: &MethodOutcome) -> String {
    format!("{:?}", outcome.scores)
}

#[test]
fn in_closed_loop_a_program_that_predicts_nothing_costs_nothing() {
    let config = config();
    let (_folder, name) = program("positions = None");
    let outcomes = scores(&config, &["mixture", &name], vec![hand(BenchArm::Ur5, &config, &["a", "8"])]);
    assert_eq!(written(&outcomes[0]), written(&outcomes[1]));
    assert_eq!(outcomes[1].rival.name(), name);
}

#[test]
fn in_closed_loop_a_better_program_is_used_whatever_the_order_the_cores_and_the_speed() {
    let config = Draft::preset("ur5e").set("predictor.external.fallback", "hold").finish().unwrap();
    let hands = || {
        ["a8", "KO", "e"].map(|letters| {
            hand(BenchArm::Ur5, &config, &letters.split("").filter(|l| !l.is_empty()).collect::<Vec<_>>())
        })
    };
    let (_fast, name) = program(CONSTANT_VELOCITY);
    let (_slow, slow) = program(&format!("{CONSTANT_VELOCITY}\n        import time; time.sleep(0.004)"));
    let (_silent, silent) = program("positions = None");
    let rivals = [&name, &slow, &silent, "constant-velocity"];
    let together = scores(&config, &rivals, hands().to_vec());
    assert_eq!(written(&together[0]), written(&together[1]));
    // Each hand by itself, one core at work, the last hand first.
    let mut alone: Vec<_> =
        hands().into_iter().rev().map(|hand| scores(&config, &[&name], vec![hand]).remove(0)).collect();
    alone.reverse();
    let alone: Vec<_> = alone.into_iter().flat_map(|outcome| outcome.scores).collect();
    assert_eq!(written(&together[0]), format!("{alone:?}"));
    let rows = MethodOutcome::table(&together);
    // Where nothing stands beside it, constant velocity earns its part, and most of what it has built in.
    let gain = |row: usize| 1.0 - rows[row].mse_m2 / rows[2].mse_m2;
    assert!(gain(0) > 0.05 && gain(0) > 0.5 * gain(3), "{} of {}", gain(0), gain(3));
}

#[test]
fn what_is_to_be_swept_is_known_before_any_program_starts() {
    let config = config();
    let folder = tempfile::tempdir().unwrap();
    let mark = folder.path().join("started");
    let benchmark = Benchmark {
        config: &config,
        arms: vec![(BenchArm::Ideal, vec![hand(BenchArm::Ideal, &config, &["a"])])],
        rivals: vec![Rival::named(&format!("external:touch {}", mark.display())).unwrap()],
        flaws: Flaws::default(),
        law: LawParameters::SHIPPED,
    };
    let sweep = benchmark.pareto_sweep();
    assert!(sweep.jobs > 1 && !mark.exists(), "{sweep:?}");
    benchmark.pareto(sweep, || {}).unwrap_err();
    assert!(mark.exists());
}

#[test]
fn in_closed_loop_a_program_that_fails_ends_the_benchmark_with_what_and_where() {
    let config = config();
    let refused = |name: &str| {
        let benchmark = Benchmark {
            config: &config,
            arms: vec![(BenchArm::Ur5, vec![hand(BenchArm::Ur5, &config, &["a", "8"])])],
            rivals: vec![Rival::named(name).unwrap()],
            flaws: Flaws::default(),
            law: LawParameters::SHIPPED,
        };
        benchmark.run(|| {}).unwrap_err().to_string()
    };
    let (_folder, name) = program("positions = [[0.0, 0.0]] * 3 if n > 250 else None");
    let text = refused(&name);
    assert!(text.contains("a8.dat") && text.contains(&format!("{name} on ur5: at step ")), "{text}");
    assert!(text.contains("3 positions, wanted are "), "{text}");
    let text = refused("external:exit 9");
    assert!(
        text.contains("a8.dat") && text.contains("external:exit 9: in answer to the greeting: it"),
        "{text}"
    );
}
