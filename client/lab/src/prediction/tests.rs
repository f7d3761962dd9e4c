//! Ranking: no leak from the scored part, and messages about names, units and models that cannot train.

use super::lead_time::{Entrant, compare};
use super::*;
use foretrace_sim::data::Split;
use std::path::Path;

/// A folder of UNIPEN files with one character each, and the split table `rows` (word, file).
fn folder(rows: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut table = String::from("set\tfile\n");
    for (index, (word, file)) in rows.iter().enumerate() {
        table += &format!("{word}\t{file}\n");
        let points: String = (0..30).map(|i| format!("{} {}\n", 7 * i, i * i / (index + 2))).collect();
        let text = format!(
            ".VERSION 1.0\n.COORD X Y\n.POINTS_PER_SECOND 200\n.X_POINTS_PER_MM 50\n.Y_POINTS_PER_MM 50\n\
             .HIERARCHY CHARACTER\n.PEN_DOWN\n{points}.PEN_UP\n.SEGMENT CHARACTER 0 OK \"x\"\n"
        );
        std::fs::write(folder.path().join(file), text).unwrap();
    }
    std::fs::write(folder.path().join("split.tsv"), table).unwrap();
    folder
}

fn load(folder: &Path, word: &str, cold: bool) -> Set {
    Set::load(folder, &word.parse().unwrap(), cold).unwrap()
}

fn row(set: &Set, model: &str) -> (Row, Option<String>) {
    let scored = score(&Model::list(model).unwrap(), set, &|| ()).unwrap();
    (scored.rows[0].clone(), scored.runs[0].note.clone())
}

#[test]
fn nothing_is_learned_from_what_is_scored() {
    let folder = folder(&[("train", "a.dat"), ("test", "b.dat"), ("test", "c.dat"), ("tablet", "d.dat")]);
    let counts = |word: &str, cold: bool| {
        let set = load(folder.path(), word, cold);
        (set.scored.len(), set.train.len())
    };
    assert_eq!((counts("test", false), counts("tablet", false)), ((2, 1), (1, 1)));
    assert_eq!(
        (counts("train", false), counts("all", false), counts("test", true)),
        ((1, 0), (4, 0), (2, 0))
    );
    assert!(Set::load(folder.path(), &Split::Named("tests".to_owned()), false).is_err());
}

#[test]
fn models_that_could_not_train_say_so() {
    let folder = folder(&[("train", "a.dat"), ("test", "b.dat")]);
    let (trained, note) = row(&load(folder.path(), "test", false), "dybm-offline");
    assert!(trained.train_s_per_epoch.is_some() && note.is_none(), "{note:?}");
    let (cold, note) = row(&load(folder.path(), "test", true), "dybm-offline");
    assert!(cold.train_s_per_epoch.is_none() && note.unwrap().contains("cold"));
    // Without a single step to learn from it predicts what Hold does.
    let (zero, _) = row(&load(folder.path(), "test", true), "hold");
    assert_eq!((cold.mse, cold.pos_mse), (zero.mse, zero.pos_mse));
    assert!(trained.mse < zero.mse);
}

#[test]
fn networks_do_the_same_on_a_tablet_of_other_units() {
    let folder = folder(&[("train", "a.dat"), ("test", "b.dat"), ("test", "c.dat")]);
    let set = load(folder.path(), "test", false);
    let enlarged = |factor: f64| {
        let mut set = set.clone();
        let steps = set.scored.iter_mut().chain(&mut set.train).flat_map(|s| &mut s.v);
        steps.flatten().for_each(|v| *v *= factor);
        set
    };
    for model in ["lstm10-reference", "ar-rls"] {
        let (a, note) = row(&enlarged(1000.0), model);
        assert!(note.unwrap().contains("scaled as it goes"));
        let (b, _) = row(&enlarged(1e-3), model);
        let ratio = a.mse.unwrap() / b.mse.unwrap();
        assert!((ratio * 1e-12 - 1.0).abs() < 1e-6, "{model}: {ratio:e}");
        assert!(row(&set, model).1.is_none());
    }
}

#[test]
fn wrong_names_are_answered_with_the_legal_ones() {
    let error = Model::list("hold,lstm11").unwrap_err().to_string();
    for word in ["\"lstm11\"", "constant-velocity", "dybm-esn", "lstm:FILE.safetensors"] {
        assert!(error.contains(word), "{error}");
    }
    assert!(Model::list("hold, hold").unwrap_err().to_string().contains("twice"));
    assert!(Model::list("").is_err());
    let error = Model::list("lstm:nowhere.safetensors").unwrap_err().to_string();
    assert!(error.contains("nowhere.safetensors"), "{error}");
    assert_eq!(Model::all().iter().map(Model::name).collect::<Vec<_>>(), names());
}

#[test]
fn rows_have_the_documented_keys_and_null_where_unknown() {
    let folder = folder(&[("train", "a.dat"), ("test", "b.dat")]);
    let mut set = load(folder.path(), "test", false);
    set.scored.iter_mut().for_each(|s| s.units_per_m = None);
    let json = serde_json::to_value(row(&set, "hold").0).unwrap();
    let mut keys: Vec<&String> = json.as_object().unwrap().keys().collect();
    keys.sort();
    assert_eq!(
        keys,
        [
            "median",
            "model",
            "mse",
            "pos_mse",
            "ps_b",
            "ps_lstm",
            "rms_mm_10",
            "train_s_per_epoch",
            "us_per_step",
            "vel_mse",
            "within"
        ]
    );
    let mut leads: Vec<&String> = json["vel_mse"].as_object().unwrap().keys().collect();
    leads.sort();
    assert_eq!(leads, ["1", "10", "2", "5"]);
    assert!(json["rms_mm_10"].is_null() && json["train_s_per_epoch"].is_null());
    assert!(json["ps_b"].is_number() && json["ps_lstm"].is_number());
}

#[test]
fn what_is_odd_in_the_part_that_is_trained_on_is_told_too() {
    let folder = tempfile::tempdir().unwrap();
    let csv = |odd: &str| {
        let rows: String = (0..40)
            .map(|k| format!("{:.3},{:.4},0,1\n", f64::from(k) * 0.005, f64::from(k) * 1e-3))
            .collect();
        format!("t_s,x_m,y_m,contact\n{rows}{odd}")
    };
    let twice = "0.195,0.1,0,1\n";
    for (name, text) in [
        ("split.tsv", "set\tfile\ntrain\ta.csv\ntrain\tbad.csv\ntest\tb.csv\ntest\tbad.csv\n".to_owned()),
        ("a.csv", csv(twice)),
        ("b.csv", csv("")),
        ("bad.csv", "t,x\n".to_owned()),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let set = Set::load(folder.path(), &Split::test(), false).unwrap();
    let [remark] = &set.remarks[..] else { panic!("{:?}", set.remarks) };
    assert!(remark.starts_with("a.csv: 1 samples have the stamp of the one before"), "{remark}");
    assert_eq!(set.refused.len(), 1, "a file of both parts is told once: {:?}", set.refused);
    // Nothing is learned from, nothing is told of it.
    assert_eq!(Set::load(folder.path(), &Split::test(), true).unwrap().remarks, Vec::<String>::new());
}

/// RMS errors \[mm\] of a pen at constant velocity, 10 and 200 ms ahead, on the one file of a folder.
fn constant_velocity_errors(name: &str, text: &str) -> [f64; 2] {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), text).unwrap();
    let set = Set::load(folder.path(), &Split::All, false).unwrap();
    assert_eq!((set.refused.len(), set.scored.len()), (0, 1), "{:?}", set.refused);
    let entrants = [Entrant::Model(Model::named("constant-velocity").unwrap())];
    let (boards, _) = compare(&entrants, &[set], &|| ()).unwrap();
    assert_eq!(boards[0].unit, "mm");
    let leads = &boards[0].models[0].leads;
    [10, 200].map(|ms| leads.iter().find(|row| row.lead_ms == ms).unwrap().rms.unwrap())
}

/// A circle of 30 mm radius in 1 s, as times \[s\] and places \[m\], 8 s of it.
fn circle(step_s: impl Fn(usize) -> f64) -> Vec<[f64; 3]> {
    let mut t_s = 0.0;
    let mut samples = Vec::new();
    while t_s < 8.0 {
        let (sin, cos) = (std::f64::consts::TAU * t_s).sin_cos();
        samples.push([t_s, 0.03 * cos, 0.03 * sin]);
        t_s += step_s(samples.len());
    }
    samples
}

#[test]
fn a_circle_has_its_error_whatever_its_stamps_and_format_are() {
    let uneven = circle(|k| if (k * k / 7) % 3 == 0 { 0.012 } else { 0.004 });
    let csv = |samples: &[[f64; 3]]| {
        let row = |[t, x, y]: &[f64; 3]| format!("{t:.5},{x:.7},{y:.7},1\n");
        format!("t_s,x_m,y_m,contact\n{}", samples.iter().map(row).collect::<String>())
    };
    let inkml = |samples: &[[f64; 3]]| {
        let point = |[t, x, y]: &[f64; 3]| format!("{:.3} {:.4} {:.4}", t * 1e3, x * 1e5, y * 1e5);
        let points: Vec<String> = samples.iter().map(point).collect();
        format!(
            "<ink><inkSource><traceFormat><channel name=\"T\"/><channel name=\"X\" units=\"cm\"/>\
             <channel name=\"Y\" units=\"cm\"/></traceFormat><channelProperties>\
             <channelProperty channel=\"X\" name=\"resolution\" value=\"1000\" units=\"1/cm\"/>\
             <channelProperty channel=\"Y\" name=\"resolution\" value=\"1000\" units=\"1/cm\"/>\
             </channelProperties></inkSource><trace>{}</trace></ink>",
            points.join(",")
        )
    };
    let unipen = |samples: &[[f64; 3]]| {
        let row = |[t, x, y]: &[f64; 3]| format!("{:.4} {:.4} {:.3}\n", x * 1e5, y * 1e5, t * 1e3);
        let rows: String = samples.iter().map(row).collect();
        format!(
            ".COORD X Y T\n.X_POINTS_PER_MM 100\n.Y_POINTS_PER_MM 100\n.SEGMENT CHARACTER\n.PEN_DOWN\n{rows}"
        )
    };
    let [near, far] = constant_velocity_errors("even.csv", &csv(&circle(|_| 1.0 / 150.0)));
    assert!((far - 23.4).abs() < 0.1 && (near - 0.1).abs() < 0.02, "{near} {far}");
    for (name, text) in
        [("uneven.csv", csv(&uneven)), ("uneven.inkml", inkml(&uneven)), ("uneven.dat", unipen(&uneven))]
    {
        let [uneven_near, uneven_far] = constant_velocity_errors(name, &text);
        // The velocity is that of half a step ago, and these steps are longer: that is 1.4 %.
        assert!((uneven_far / far - 1.0).abs() < 0.02, "{name}: {uneven_far}, not {far}");
        assert!((uneven_near - near).abs() < 0.025, "{name}: {uneven_near}, not {near}");
    }
}
