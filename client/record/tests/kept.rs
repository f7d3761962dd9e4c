//! Recordings of every layout that there was are kept in `tests/kept`, and stay readable.

use std::path::{Path, PathBuf};

use foretrace_record::explain::moments;
use foretrace_record::info::info;
use foretrace_record::pen::pen_samples;
use foretrace_record::read::RecordingReader;
use foretrace_record::table;
use foretrace_record::topics::layouts;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/kept")
}

#[test]
fn this_version_has_kept_a_recording_of_its_layouts() {
    let file = folder().join(format!("{:016x}.mcap", layouts()));
    assert!(
        file.exists(),
        "a layout has changed: keep the recordings that there are, and add one by `tests/record/keep.sh`"
    );
    assert_eq!(info(&file).unwrap().foreign, Vec::<String>::new());
}

#[test]
fn every_kept_recording_is_read_whatever_its_layouts() {
    let files = std::fs::read_dir(folder()).unwrap().map(|file| file.unwrap().path()).collect::<Vec<_>>();
    assert!(!files.is_empty());
    for path in files {
        let name = path.display();
        let reported = info(&path).unwrap();
        assert_eq!(reported.damage, None, "{name}");
        assert!(reported.begin.contains_key("version") && reported.laws.len() == 1, "{name}: {reported:?}");
        assert_eq!(reported.missing_ticks, 0, "{name}");
        for topic in ["/raw/tick", "/raw/input", "/raw/status"] {
            let mut csv = Vec::new();
            let rows =
                table::csv(&mut RecordingReader::open(&path).unwrap(), topic, 1, &[], &mut csv).unwrap();
            assert_eq!(reported.topics.get(topic), Some(&rows), "{name}: {topic}");
            let text = String::from_utf8(csv).unwrap();
            let columns = text.lines().next().unwrap().split(',').count();
            assert!(columns > 20 && text.contains("tick [1]"), "{name}: {topic}: {columns} columns");
            assert!(text.lines().all(|line| line.split(',').count() == columns), "{name}: {topic}");
        }
        // Explaining needs the tick records only, whatever became of the rest.
        let explained = moments(&path);
        if reported.foreign.iter().any(|topic| topic == "/raw/tick") {
            let refused = explained.unwrap_err().to_string();
            assert!(refused.contains("/raw/tick have another layout"), "{name}: {refused}");
        } else {
            assert!(!explained.unwrap().moments.is_empty(), "{name}");
        }
        let mut seen = Vec::new();
        let mut reader = RecordingReader::open(&path).unwrap();
        let keep = |sample| {
            seen.push(sample);
            Ok::<(), ()>(())
        };
        pen_samples(&mut reader, keep).unwrap().unwrap();
        assert!(seen.len() > 1, "{name}: no pen");
        assert!(seen.windows(2).all(|pair| pair[0].stamp_ns < pair[1].stamp_ns), "{name}: {seen:?}");
        assert!(seen.iter().all(|sample| sample.x_m.hypot(sample.y_m) < 1.0), "{name}: {seen:?}");
    }
}
