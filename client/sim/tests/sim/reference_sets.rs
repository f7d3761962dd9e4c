//! The loaders against every sequence of the reference tables, where the shared data is there.

use crate::shared::shared;
use foretrace_sim::data::{Character, DataSet, Quantity, Split, median_glyph_height};
use foretrace_sim::path::{Ink, PenPath, Placement};
use std::collections::BTreeSet;

/// The points of all strokes in order, place holders included, as the prediction tables count them.
fn pen_down(character: &Character) -> impl Iterator<Item = [f64; 2]> {
    character.components.iter().filter(|c| c.contact).flat_map(|c| c.points.iter().copied())
}

#[test]
fn every_test_sequence_has_the_label_and_length_of_the_reference() {
    let Some(shared) = shared() else { return };
    for (name, sequences) in [("unipen-ced", 3021), ("unipen-tos", 2319)] {
        let set = DataSet::load(&shared.join("data").join(name), &Split::test(), true).unwrap();
        let table = shared.join(format!("fixtures/reference/{name}-test-per-sequence.tsv"));
        let table = std::fs::read_to_string(table).unwrap();
        let expected: Vec<Vec<&str>> = table.lines().skip(1).map(|l| l.split('\t').collect()).collect();
        let found: Vec<_> = set
            .files
            .iter()
            .flat_map(|f| f.recording.segments.iter().map(move |c| (f, c)))
            .filter(|(_, c)| pen_down(c).count() > 0)
            .collect();
        assert_eq!((found.len(), expected.len()), (sequences, sequences), "{name}");
        for ((file, character), row) in found.iter().zip(&expected) {
            let steps = pen_down(character).count() - 1 + 5;
            let ours = [
                file.file.clone(),
                character.segment_index.to_string(),
                character.label.clone(),
                steps.to_string(),
            ];
            // The table keeps labels as the files write them.
            let label = row[2].replace("\\\"", "\"").replace("\\\\", "\\");
            assert_eq!(ours.each_ref().map(String::as_str), [row[0], row[1], &label, row[3]], "{name}");
        }
    }
}

#[test]
fn sets_have_the_numbers_their_readmes_state() {
    let Some(shared) = shared() else { return };
    let train = DataSet::load(&shared.join("data/unipen-ced"), &Split::train(), true).unwrap();
    let points: usize = train.characters().map(|c| pen_down(c).count()).sum();
    assert_eq!((train.files.len(), train.characters().count(), points), (18, 3200, 218_689));
    assert_eq!(median_glyph_height(train.characters()), Some(176.0));
    let tos = DataSet::load(&shared.join("data/unipen-tos"), &Split::All, true).unwrap();
    let points: usize = tos.characters().map(|c| pen_down(c).count()).sum();
    assert_eq!((tos.files.len(), tos.characters().count(), points), (108, 5025, 615_636));
    assert!(tos.files.iter().all(|f| f.recording.rate_hz == 200.0));
    assert!(tos.files.iter().all(|f| f.recording.units_per_m == Some([10_000.0; 2])));
}

#[test]
fn real_recordings_become_paths_inside_the_workspace_without_leaps() {
    let Some(shared) = shared() else { return };
    for name in ["unipen-ced", "unipen-tos"] {
        let set = DataSet::load(&shared.join("data").join(name), &Split::test(), false).unwrap();
        let median_height = median_glyph_height(set.characters()).unwrap();
        let placement = Placement::default();
        for file in &set.files {
            let (characters, rate_hz) = (&file.recording.segments[..], file.recording.rate_hz);
            let (path, skipped) =
                PenPath::from_ink(Ink { characters, rate_hz, median_height }, &placement).unwrap();
            assert!(skipped.len() * 20 <= characters.len(), "{}: {skipped:?}", file.file);
            assert_eq!(path.spans.len() + skipped.len(), characters.len());
            for (a, b) in path.samples.iter().zip(&path.samples[1..]) {
                assert!(b.t_s > a.t_s, "{}: {a:?} {b:?}", file.file);
                let sampled = b.t_s - a.t_s < 1.5 / rate_hz;
                // One glyph height per sample would be 6 m/s; too fast for a hand.
                let leap = (b.x_m - a.x_m).hypot(b.y_m - a.y_m);
                assert!(!(sampled && leap > 0.03), "{}: {a:?} {b:?}", file.file);
                assert!(!(a.contact && b.contact && !sampled), "a stroke with a hole: {a:?} {b:?}");
            }
            let [[left, low], [right, high]] = path.bounds_m().unwrap();
            // Half a glyph of hover and the follow-through of a lift.
            let margin = 0.03;
            assert!(
                left > -0.15 - margin && right < 0.15 + margin && low > -0.1 - margin && high < 0.1 + margin
            );
        }
    }
}

/// Pooled mean squared error of constant velocity over steps 1.., mean over components, five zero steps
/// appended.
fn constant_velocity_mse(set: &DataSet) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for character in set.characters() {
        let points: Vec<[f64; 2]> = pen_down(character).collect();
        let mut v: Vec<[f64; 2]> = points.windows(2).map(|p| [0, 1].map(|k| p[1][k] - p[0][k])).collect();
        v.resize(v.len() + 5, [0.0; 2]);
        for pair in v.windows(2) {
            sum += (0..2).map(|k| (pair[1][k] - pair[0][k]).powi(2)).sum::<f64>();
            count += 2.0;
        }
    }
    sum / count
}

#[test]
fn pendigits_has_its_published_parts() {
    let Some(shared) = shared() else { return };
    let folder = shared.join("data/pendigits-orig");
    assert_eq!(DataSet::splits(&folder).unwrap(), ["test", "train", "all"]);
    let parts = [(Split::train(), 7494, 304_216, 30), (Split::test(), 3498, 138_578, 14)];
    for (part, digits, points, writers) in parts {
        let set = DataSet::load(&folder, &part, true).unwrap();
        let found: usize = set.characters().map(|c| pen_down(c).count()).sum();
        let names: BTreeSet<&str> = set.characters().map(|c| c.writer.as_str()).collect();
        assert_eq!((set.characters().count(), found, names.len()), (digits, points, writers), "{part}");
        assert!(set.characters().all(|c| matches!(c.label.as_bytes(), [b'0'..=b'9'])));
        let recording = &set.files[0].recording;
        assert_eq!(
            (recording.rate_hz, recording.rate_assumed, recording.units_per_m),
            (100.0, true, None),
            "{part}"
        );
        if part == Split::test() {
            // As in the table of reference numbers.
            assert_eq!(format!("{:.2}", constant_velocity_mse(&set)), "43.10");
        }
    }
    let all = DataSet::load(&folder, &Split::All, true).unwrap();
    let names: BTreeSet<&str> = all.characters().map(|c| c.writer.as_str()).collect();
    assert_eq!((all.characters().count(), names.len()), (7494 + 3498, 44));
}

#[test]
fn character_trajectories_have_their_published_parts() {
    let Some(shared) = shared() else { return };
    let folder = shared.join("data/character-trajectories");
    assert_eq!(DataSet::splits(&folder).unwrap(), ["train", "test", "all"]);
    let letters = "abcdeghlmnopqrsuvwyz".chars().map(String::from).collect::<Vec<_>>();
    // Lengths without padding; those with it are what the set's description states.
    let parts = [
        (Split::train(), letters, [61, 182, 172_394], "0.01381"),
        (Split::test(), vec![String::new()], [60, 175, 170_545], "0.01424"),
    ];
    for (part, labels, lengths, mse) in parts {
        let set = DataSet::load(&folder, &part, true).unwrap();
        let found: BTreeSet<&str> = set.characters().map(|c| c.label.as_str()).collect();
        assert_eq!(found.into_iter().collect::<Vec<_>>(), labels, "{part}");
        let steps = || set.characters().map(|c| pen_down(c).count() - 1);
        let found = [steps().min().unwrap(), steps().max().unwrap(), steps().sum()];
        assert_eq!((set.characters().count(), found), (1429, lengths), "{part}");
        assert_eq!(format!("{:.5}", constant_velocity_mse(&set)), mse, "{part}");
        let recording = &set.files[0].recording;
        assert_eq!((recording.quantity, recording.rate_hz), (Quantity::Velocity, 200.0));
    }
}
