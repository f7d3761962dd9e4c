//! Ranking: no leak from the scored part, and messages about names, units and models that cannot train.

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
