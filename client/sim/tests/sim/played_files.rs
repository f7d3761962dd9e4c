//! Recordings as paths to play: what a pen would have sent, at the times of the file.

use foretrace_config::Config;
use foretrace_sim::source::{PathOptions, PenSource, load};

fn played(files: &[(&str, &str)], options: &PathOptions) -> PenSource {
    let folder = tempfile::tempdir().unwrap();
    let name = |(name, text): &(&str, &str)| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        file.display().to_string()
    };
    let names: Vec<String> = files.iter().map(name).collect();
    let config = Config::preset("ur5").unwrap();
    let mut source = load(&names, options, config.settings()).unwrap();
    let folder = format!("{}/", folder.path().display());
    source.notes.iter_mut().for_each(|note| *note = note.replace(&folder, ""));
    source
}

/// Milliseconds between samples, rounded.
fn steps(source: &PenSource) -> Vec<f64> {
    source.path.samples.windows(2).map(|w| ((w[1].t_s - w[0].t_s) * 1e3).round()).collect()
}

const INKML: &str = "<ink><traceFormat><channel name=\"X\"/><channel name=\"Y\"/><channel name=\"T\"/></traceFormat>\
                     <trace>0 0 0,1 9 8,4 8 32,5 0 40,8 9 64,8 8 464,9 0 472</trace></ink>";

#[test]
fn samples_are_played_at_their_times_and_a_gap_is_no_lift() {
    let source = played(&[("a.inkml", INKML)], &PathOptions::default());
    assert_eq!(steps(&source), [8.0, 24.0, 8.0, 24.0, 400.0, 8.0]);
    assert!(source.path.samples.iter().all(|sample| sample.contact), "{:?}", source.path.samples);
    assert_eq!((source.path.gaps, source.path.inserted_travels), (1, 0));
    let twice = played(&[("a.inkml", INKML)], &PathOptions { speed: 2.0, ..PathOptions::default() });
    assert_eq!(steps(&twice), [4.0, 12.0, 4.0, 12.0, 200.0, 4.0]);
}

#[test]
fn hover_between_strokes_keeps_its_uneven_times() {
    let csv = "t_ms,x,y,contact\n0,0,0,1\n8,1,5,1\n20,2,9,1\n31,3,8,0\n36,4,5,0\n52,5,2,1\n60,6,0,1\n";
    let source = played(&[("a.csv", csv)], &PathOptions::default());
    assert_eq!(steps(&source), [8.0, 12.0, 11.0, 5.0, 16.0, 8.0]);
    let contact: Vec<bool> = source.path.samples.iter().map(|sample| sample.contact).collect();
    assert_eq!(contact, [true, true, true, false, false, true, true]);
    assert!(source.notes.iter().any(|note| note.starts_with("a.csv: x and y name no unit of length")));
}

#[test]
fn units_may_be_given_and_a_path_in_metres_is_taken_as_it_stands() {
    let csv = "time,x,y,contact\n0,10,20,1\n5000,11,20,1\n10000,12,21,1\n";
    let units = "mm,us".parse().unwrap();
    let source = played(&[("a.csv", csv)], &PathOptions { units, ..PathOptions::default() });
    let last = source.path.samples[2];
    assert!((last.x_m - 0.012).abs() < 1e-12 && (last.y_m - 0.021).abs() < 1e-12, "{last:?}");
    assert_eq!((steps(&source), source.notes.len()), (vec![5.0, 5.0], 0));
}

#[test]
fn files_whose_rates_were_found_from_stamps_are_played_together() {
    let file = |period: f64| -> String {
        let rows = (0..30).map(|k| format!("{:.5},{},{}\n", f64::from(k) * period, k % 7, k % 5));
        format!("t_s,x,y\n{}", rows.collect::<String>())
    };
    let [a, b] = [0.005, 0.00505].map(file);
    let source = played(&[("a.csv", &a), ("b.csv", &b)], &PathOptions::default());
    let of_b = source.path.samples.len() - 30;
    let steps: Vec<f64> = source.path.samples[of_b..].windows(2).map(|w| w[1].t_s - w[0].t_s).collect();
    assert!(steps.iter().all(|step| (step - 0.00505).abs() < 1e-6), "{steps:?}");
    let ink = source.notes.iter().filter(|note| note.contains("count as ink")).count();
    assert!(
        ink == 1 && source.notes.iter().any(|note| note.starts_with("a.csv and 1 other file: nothing")),
        "{:?}",
        source.notes
    );
}
