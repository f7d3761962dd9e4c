//! Lead times: expected errors on simple motion, windows, rates, and predictions from files.

use super::*;
use crate::prediction::{CharacterSequence, Model, Set};
use std::path::Path;

/// A character of one stroke at 100 Hz along `points`, or of several where `jumps` names the steps between
/// them.
fn character(segment: usize, points: &[[f64; 2]], jumps: &[usize]) -> CharacterSequence {
    let mut v: Vec<[f64; 2]> = points.windows(2).map(|p| [p[1][0] - p[0][0], p[1][1] - p[0][1]]).collect();
    v.extend([[0.0; 2]; 5]);
    CharacterSequence {
        file: "data/a.dat".to_owned(),
        writer: String::new(),
        segment,
        label: "x".to_owned(),
        jump: (0..v.len()).map(|t| jumps.contains(&t)).collect(),
        v,
        rate_hz: 100.0,
        rate_assumed: false,
        units_per_m: Some([2000.0; 2]),
    }
}

fn set(scored: Vec<CharacterSequence>) -> Set {
    let (name, split) = ("pens".to_owned(), "test".to_owned());
    let (refused, damaged, remarks) = (Vec::new(), Vec::new(), Vec::new());
    Set { name, split, scored, train: Vec::new(), cold: false, refused, damaged, remarks }
}

fn arc() -> Vec<[f64; 2]> {
    (0..60).map(|i| [3.0 * f64::from(i), 0.05 * f64::from(i * i)]).collect()
}

fn models(names: &str) -> Vec<Entrant> {
    Model::list(names).unwrap().into_iter().map(Entrant::Model).collect()
}

#[test]
fn straight_even_motion_is_missed_by_hold_and_met_by_constant_velocity() {
    // 2 raw units = 1 mm per 10 ms; y grows by 1.
    let points: Vec<[f64; 2]> = (0..40).map(|i| [2.0 * f64::from(i), f64::from(i)]).collect();
    let (boards, standings) =
        compare(&models("hold,constant-velocity"), &[set(vec![character(0, &points, &[])])], &|| ()).unwrap();
    let [zero, repeat] = &boards[0].models[..] else { panic!("two lanes") };
    let step_mm = 1.25_f64.sqrt();
    for (index, row) in zero.leads.iter().enumerate() {
        let missed = step_mm * (index + 1) as f64;
        assert!((row.rms.unwrap() - missed).abs() < 1e-9 && (row.along_mean.unwrap() + missed).abs() < 1e-9);
        assert!(row.cross_rms.unwrap() < 1e-6, "{row:?}");
        // Instants at 2, 4 ... and targets up to point 39.
        assert_eq!(row.targets as usize, (39 - (index + 1)) / 2);
    }
    assert!(repeat.leads.iter().all(|row| row.rms.unwrap() < 1e-9));
    assert_eq!((boards[0].unit.as_str(), boards[0].glyph_height), ("mm", Some(19.5)));
    assert_eq!((standings[0].model.as_str(), standings[1].rms_over_zero), ("constant-velocity", Some(1.0)));
}

#[test]
fn windows_end_with_their_stroke_and_do_not_start_on_a_jump() {
    let targets = Targets::of(&[character(0, &arc(), &[29])]);
    for instant in &targets.instants {
        for lead in instant.scored() {
            let target = instant.point + lead + 1;
            // Step 29 leads from point 29 to point 30; a window from point 30 would start with it.
            assert!(target <= 29 || instant.point > 30, "{instant:?} {lead}");
            assert!(target <= 59);
        }
    }
    let scored: usize = targets.instants.iter().map(|i| i.scored().count()).sum();
    let wanted = (2..=28).step_by(2).map(|t| (29 - t).min(20)).sum::<usize>()
        + (32..=58).step_by(2).map(|t| (59 - t).min(20)).sum::<usize>();
    assert_eq!(scored, wanted);
}

#[test]
fn devices_of_other_rates_share_the_time_axis() {
    // 133 Hz: 10 ms are 1.33 samples; the path between them is straight.
    let mut odd = character(0, &(0..60).map(|i| [f64::from(i), 0.0]).collect::<Vec<_>>(), &[]);
    odd.rate_hz = 133.0;
    let targets = Targets::of(std::slice::from_ref(&odd));
    let instant = targets.instants[0];
    assert_eq!(instant.point, 3);
    let truth = targets.truth(0, instant.point, 4).unwrap();
    assert!((truth.position[0] - 6.65).abs() < 1e-9 && truth.position[1] == 0.0);
    let (boards, _) = compare(&models("constant-velocity"), &[set(vec![odd])], &|| ()).unwrap();
    assert!(boards[0].models[0].leads.iter().all(|row| row.rms.unwrap() < 1e-9));
}

/// An external predictor on the exported files: constant velocity in a few lines.
fn answered(folder: &Path, bands: bool) -> String {
    let points = std::fs::read_to_string(folder.join("pens-points.csv")).unwrap();
    let points: Vec<Vec<String>> =
        points.lines().skip(1).map(|l| l.split(',').map(str::to_owned).collect()).collect();
    let at = |segment: &str, t: usize| -> [f64; 2] {
        let row = points.iter().find(|p| p[1] == segment && p[2] == t.to_string()).unwrap();
        [row[4].parse().unwrap(), row[5].parse().unwrap()]
    };
    let targets = std::fs::read_to_string(folder.join("pens-targets.csv")).unwrap();
    let mut text =
        String::from(if bands { "x,y,lead,file,segment,t,r50,r90\n" } else { "x,y,lead,file,segment,t\n" });
    for row in targets.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let (t, lead): (usize, f64) = (cells[2].parse().unwrap(), cells[3].parse().unwrap());
        let (now, before) = (at(cells[1], t), at(cells[1], t - 1));
        let ahead = |i: usize| now[i] + (now[i] - before[i]) * lead / 10.0;
        let radii = if bands { ",0,1e9" } else { "" };
        text += &format!("{},{},{lead},{},{},{t}{radii}\n", ahead(0), ahead(1), cells[0], cells[1]);
    }
    text
}

#[test]
fn predictions_from_elsewhere_score_like_the_same_model_here() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(vec![character(0, &arc(), &[29]), character(4, &arc()[..33], &[])]);
    export(folder.path(), "pens", &set.scored).unwrap();
    let text = answered(folder.path(), true);
    let predictions = Predictions::parse(&text, Path::new("mine.csv")).unwrap();
    let mut entrants = models("constant-velocity");
    entrants.push(Entrant::File { name: "mine".to_owned(), predictions });
    let (boards, standings) = compare(&entrants, &[set], &|| ()).unwrap();
    let [here, mine] = &boards[0].models[..] else { panic!("two lanes") };
    for (a, b) in here.leads.iter().zip(&mine.leads) {
        assert_eq!(a.targets, b.targets);
        for (a, b) in
            [(a.rms, b.rms), (a.along_mean, b.along_mean), (a.cross_rms, b.cross_rms), (a.median, b.median)]
        {
            assert!((a.unwrap() - b.unwrap()).abs() < 1e-6, "{a:?} {b:?}");
        }
        assert_eq!((a.coverage_50, b.coverage_90), (None, Some(100.0)));
        assert!(b.coverage_50.unwrap() < 100.0);
    }
    assert_eq!(standings.len(), 2);
}

#[test]
fn wrong_predictions_are_refused_with_file_and_line() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(vec![character(0, &arc(), &[])]);
    export(folder.path(), "pens", &set.scored).unwrap();
    let whole = answered(folder.path(), false);
    let says = |text: &str, words: &[&str]| {
        let error = match Predictions::parse(text, Path::new("mine.csv")) {
            Err(error) => error.to_string(),
            Ok(predictions) => {
                let entrant = Entrant::File { name: "mine".to_owned(), predictions };
                compare(&[entrant], std::slice::from_ref(&set), &|| ()).unwrap_err().to_string()
            }
        };
        for word in words {
            assert!(error.contains(word), "{error}\nlacks {word}");
        }
    };
    let header = "file,segment,t,lead,x,y\n";
    says("file,segment,t,x,y\n", &["mine.csv:1", "lead"]);
    says("", &["mine.csv:1", "header"]);
    says(&format!("{header}data/a.dat,0,2,10,nan,1\n"), &["mine.csv:2", "x is \"nan\"", "legal"]);
    says(&format!("{header}data/a.dat,0,2,10,1\n"), &["mine.csv:2", "y is \"\""]);
    says(&format!("{header}\ndata/a.dat,0,2,15,1,1\n"), &["mine.csv:3", "lead is \"15\"", "200"]);
    says(&format!("{header}data/a.dat,-1,2,10,1,1\n"), &["mine.csv:2", "segment is \"-1\""]);
    says(&format!("{header}data/a.dat,0,3,10,1,1\n"), &["mine.csv:2", "t 3", "not a target"]);
    says(&format!("{header}\"b,c.dat\",0,2,10,1,1\n"), &["mine.csv:2", "b,c.dat", "none of the sets"]);
    let lines: Vec<&str> = whole.lines().collect();
    says(&lines[..lines.len() - 2].join("\n"), &["mine.csv", "2 of", "t 56, lead 30", "--export-targets"]);
    says(&format!("{whole}{}\n", lines[7]), &[&format!("mine.csv:{}", lines.len() + 1), "before"]);
}

proptest::proptest! {
    #[test]
    fn no_text_makes_the_reader_panic(text in "(file,segment,t,lead,x,y\n)?[0-9.,eE\"\\-\nnaif#\u{e9} \
                                        ]{0,200}") {
        let _ = Predictions::parse(&text, Path::new("mine.csv"));
    }
}

/// The same predictor a fixed time late, or too far ahead: what a lead's side effects are of.
fn shifted(folder: &Path, late_ms: f64) -> String {
    let read = |what: &str| std::fs::read_to_string(folder.join(format!("pens-{what}.csv"))).unwrap();
    let points: Vec<Vec<String>> =
        read("points").lines().skip(1).map(|l| l.split(',').map(str::to_owned).collect()).collect();
    let at = |segment: &str, t: f64| -> [f64; 2] {
        let row = |t: usize| points.iter().find(|p| p[1] == segment && p[2] == t.to_string());
        let (low, share) = (t.floor() as usize, t.fract());
        let of = |row: &Vec<String>| [row[4].parse::<f64>().unwrap(), row[5].parse().unwrap()];
        let a = of(row(low).unwrap());
        let b = row(low + 1).map_or(a, of);
        [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
    };
    let mut text = String::from("file,segment,t,lead,x,y\n");
    for target in read("targets").lines().skip(1) {
        let cells: Vec<&str> = target.split(',').collect();
        let t = cells[2].parse::<f64>().unwrap() + (cells[3].parse::<f64>().unwrap() - late_ms) / 10.0;
        let [x, y] = at(cells[1], t);
        text += &format!("{target},{x},{y}\n");
    }
    text
}

#[test]
fn who_is_late_on_a_line_is_late_only_and_who_is_early_over_anticipates_only() {
    let folder = tempfile::tempdir().unwrap();
    // 2 raw units = 1 mm per 10 ms.
    let points: Vec<[f64; 2]> = (0..60).map(|i| [1.2 * f64::from(i), 1.6 * f64::from(i)]).collect();
    let whole = set(vec![character(0, &points, &[])]);
    // What is early has to know more of the line than is scored.
    let known: Vec<[f64; 2]> = (0..90).map(|i| [1.2 * f64::from(i), 1.6 * f64::from(i)]).collect();
    export(folder.path(), "pens", &whole.scored).unwrap();
    let targets = std::fs::read_to_string(folder.path().join("pens-targets.csv")).unwrap();
    export(folder.path(), "pens", &[character(0, &known, &[])]).unwrap();
    std::fs::write(folder.path().join("pens-targets.csv"), targets).unwrap();
    for late_ms in [15.0, -15.0] {
        let predictions =
            Predictions::parse(&shifted(folder.path(), late_ms), Path::new("mine.csv")).unwrap();
        let entrant = Entrant::File { name: "mine".to_owned(), predictions };
        let (boards, _) = compare(&[entrant], std::slice::from_ref(&whole), &|| ()).unwrap();
        for row in &boards[0].models[0].leads {
            let (is, is_not) = match late_ms > 0.0 {
                true => (row.lateness, row.over_anticipation),
                false => (row.over_anticipation, row.lateness),
            };
            for value in [is.mean, is.p50, is.p95, is.p99, row.rms, row.error.mean] {
                assert!((value.unwrap() - 1.5).abs() < 1e-6, "{row:?}");
            }
            assert!(is_not.p99.unwrap() < 1e-6 && row.jitter.p99.unwrap() < 1e-6, "{row:?}");
            // 10 ms ahead and 15 ms late is behind the newest point.
            let turned = if late_ms > 0.0 && row.lead_ms == 10 { 180.0 } else { 0.0 };
            assert!((row.wrong_direction_deg.p50.unwrap() - turned).abs() < 1e-6, "{row:?}");
        }
    }
}

#[test]
fn jitter_is_within_a_stroke_and_from_instant_to_instant() {
    // Constant velocity on a parabola misses by the same vector at every instant, whatever the speed.
    let points: Vec<[f64; 2]> = (0..60).map(|i| [3.0 * f64::from(i), 0.05 * f64::from(i * i)]).collect();
    let (boards, _) =
        compare(&models("constant-velocity"), &[set(vec![character(0, &points, &[29])])], &|| ()).unwrap();
    for row in &boards[0].models[0].leads {
        assert!(row.jitter.p99.unwrap() < 1e-5 && row.rms.unwrap() > 1e-3, "{row:?}");
    }
    // Instants at 2, 4 … 28 and 32, 34 … 58: 28 targets 10 ms ahead, of which two are the first of a stroke.
    let each: Vec<_> = boards[0].each().collect();
    assert_eq!((each.len(), each[0].targets[0]), (1, 28));
    let tally = boards[0].models[0].sequences[0].1[0];
    assert_eq!((tally.square.count, tally.jitter.count), (28, 26));
}

#[test]
fn intervals_are_over_writers_and_each_sequence_is_told() {
    let written = |segment: usize, writer: &str, bend: f64| {
        let points: Vec<[f64; 2]> = (0..50).map(|i| [3.0 * f64::from(i), bend * f64::from(i * i)]).collect();
        CharacterSequence { writer: writer.to_owned(), ..character(segment, &points, &[]) }
    };
    let several = |writers: [&str; 4]| {
        let bends = [0.01, 0.02, 0.06, 0.09];
        let scored = writers.into_iter().zip(bends).enumerate();
        set(scored.map(|(segment, (writer, bend))| written(segment, writer, bend)).collect())
    };
    let entrants = models("hold,constant-velocity");
    let (boards, standings) = compare(&entrants, &[several(["a", "b", "b", "c"])], &|| ()).unwrap();
    assert_eq!(boards[0].writers, 3);
    for lane in &boards[0].models {
        for row in &lane.leads {
            let ([low, high], rms) = (row.rms_interval.unwrap(), row.rms.unwrap());
            assert!(low <= rms && rms <= high && low < high, "{row:?}");
        }
    }
    // Over itself, `hold` is 1 whoever writes.
    assert_eq!(standings[1].rms_over_zero_interval, Some([1.0, 1.0]));
    let ([low, high], is) =
        (standings[0].rms_over_zero_interval.unwrap(), standings[0].rms_over_zero.unwrap());
    assert!(low < is && is < high && high < 1.0, "{standings:?}");
    // The sequences make up the row.
    let each: Vec<_> = boards[0].each().collect();
    assert_eq!(each.iter().map(|one| (one.model, one.name.segment)).collect::<Vec<_>>(), {
        let of = |model| (0..4).map(move |segment| (model, segment));
        of("hold").chain(of("constant-velocity")).collect::<Vec<_>>()
    });
    let row = &boards[0].models[1].leads[4];
    let of_model = || each.iter().skip(4);
    let targets: u64 = of_model().map(|one| one.targets[4]).sum();
    let squares: f64 = of_model().map(|one| one.rms[4].unwrap().powi(2) * one.targets[4] as f64).sum();
    assert_eq!(targets, row.targets);
    assert!(((squares / targets as f64).sqrt() - row.rms.unwrap()).abs() < 1e-12);
    let (boards, standings) = compare(&entrants, &[several(["a"; 4])], &|| ()).unwrap();
    assert_eq!(boards[0].writers, 1);
    assert!(boards[0].models.iter().flat_map(|lane| &lane.leads).all(|row| row.rms_interval.is_none()));
    assert!(standings.iter().all(|standing| standing.rms_over_zero_interval.is_none()));
}
