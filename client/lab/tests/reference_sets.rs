//! The loaders against every sequence of the reference tables, where the shared data is there.

use foretrace_lab::data::{DataSet, Split, median_glyph_height};
use foretrace_lab::path::{Ink, PenPath, Placement};
use std::io::Write as _;
use std::path::PathBuf;

fn shared() -> Option<PathBuf> {
    let folder = std::env::var_os("FORETRACE_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared"), PathBuf::from);
    if folder.join("data").is_dir() {
        return Some(folder);
    }
    // Past the capture of the test runner: a skipped test must be seen.
    let _ =
        writeln!(std::io::stderr(), "skipped: no shared data at {} (set FORETRACE_SHARED)", folder.display());
    None
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
            .filter(|(_, c)| c.pen_down_points().count() > 0)
            .collect();
        assert_eq!((found.len(), expected.len()), (sequences, sequences), "{name}");
        for ((file, character), row) in found.iter().zip(&expected) {
            let steps = character.pen_down_points().count() - 1 + 5;
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
    let points: usize = train.characters().map(|c| c.pen_down_points().count()).sum();
    assert_eq!((train.files.len(), train.characters().count(), points), (18, 3200, 218_689));
    assert_eq!(median_glyph_height(train.characters()), Some(176.0));
    let tos = DataSet::load(&shared.join("data/unipen-tos"), &Split::All, true).unwrap();
    let points: usize = tos.characters().map(|c| c.pen_down_points().count()).sum();
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
                // One glyph height per sample would be 6 m/s; nobody writes like that.
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
