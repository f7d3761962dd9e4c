//! CSV files of others, made here: names, units, separators, clocks, and what is said of them.

use super::csv_events::{STROKES, written};
use foretrace_sim::data::{Recording, load_csv, load_recording};

pub(crate) fn read(text: &str) -> Result<Recording, String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pen.csv");
    std::fs::write(&file, text).unwrap();
    let folder = format!("{}/", folder.path().display());
    load_recording(&file).map_err(|error| error.to_string().replace(&folder, ""))
}

pub(crate) fn told(recording: &Recording) -> Vec<String> {
    recording.remarks.iter().map(ToString::to_string).collect()
}

/// Contact, points and time before, of each component.
pub(crate) fn parts(recording: &Recording) -> Vec<(bool, usize, Option<f64>)> {
    let [character] = &recording.segments[..] else { panic!("{recording:?}") };
    let round = |s: f64| (s * 1e6).round() * 1e-6;
    character.components.iter().map(|c| (c.contact, c.points.len(), c.dt_before_s.map(round))).collect()
}

#[test]
fn the_same_samples_are_read_from_every_writing() {
    let plain = read("t_s,x_m,y_m,contact\n0,0.1,0.2,1\n0.005,0.125,0.25,1\n0.01,0.15,0.3,0\n").unwrap();
    assert!((plain.rate_hz - 200.0).abs() < 1e-9 && plain.remarks.is_empty());
    for text in [
        "y_mm,contact,x_mm,t_ms\n200,1,100,0\n250,1,125,5\n300,0,150,10\n",
        "contact;t_us;x_um;y_um\n1;0;100000;200000\n1;5000;125000;250000\n0;10000;150000;300000\n",
        "\u{feff}\"t_s\";\"x_m\";\"y_m\";\"contact\"\r\n0;0,1;0,2;1\r\n0,005;0,125;0,25;1\r\n0,01;0,15;0,3;0\r\n",
        "t_s\tx_cm\ty_cm\tPen Down\n0\t10\t20\ttrue\n0,005\t12,5\t25\ttrue\n0,01\t15\t30\tfalse\n",
        "timestamp_ns,x [mm],y [mm],hover\n0,100,200,0\n5000000,125,250,0\n10000000,150,300,1\n",
        "time_s,x_m,y_m,pressure\n0,0.1,0.2,0.4\n0.005,0.125,0.25,0.1\n0.01,0.15,0.3,0\n",
        "t_s,x_m,y_m,contact\n\"0\",\"0,1\",\"0,2\",1\n\"0,005\",\"0,125\",\"0,25\",1\n\"0,01\",\"0,15\",\"0,3\",0\n",
    ] {
        let found = read(text).unwrap();
        assert_eq!(parts(&found), parts(&plain), "{text}");
        assert!((found.rate_hz - 200.0).abs() < 1e-6, "{text}: {}", found.rate_hz);
        assert_eq!((found.units_per_m, told(&found)), (Some([1.0; 2]), vec![]), "{text}");
        let points = |r: &Recording| -> Vec<[f64; 2]> {
            r.segments[0].components.iter().flat_map(|c| c.points.clone()).collect()
        };
        for (a, b) in points(&found).iter().flatten().zip(points(&plain).iter().flatten()) {
            assert!((a - b).abs() < 1e-12, "{text}: {a} {b}");
        }
    }
}

#[test]
fn columns_that_are_not_needed_are_named_and_left_out() {
    let r = read("t_s,x_m,y_m,contact,pressure,tilt_x\n0,0,0,1,0.5,3\n0.005,0,0,1,0.5,3\n").unwrap();
    assert_eq!(told(&r), ["the columns pressure, tilt_x are not used"]);
    let r = read("Export of a tablet\nMade: today\nt_s,x_m,y_m\n0,0,0\n0.005,0,0\n").unwrap();
    assert_eq!(
        told(&r),
        [
            "the lines above the header are passed over",
            "nothing tells when the pen touches the paper: all samples count as ink"
        ]
    );
}

#[test]
fn a_clock_that_counts_from_1970_begins_at_the_first_sample() {
    for (name, begin, step, unit_told) in [
        ("t_s", 1_718_000_000.0, 0.005, false),
        ("t_ms", 1_718_000_000_000.0, 5.0, false),
        ("timestamp_us", 1_718_000_000_000_000.0, 5e3, false),
        ("timestamp", 1_718_000_000_000.0, 5.0, true),
        ("timestamp", 1_718_000_000_000_000_000.0, 5e6, true),
        // No clock counts that many seconds.
        ("t_s", 1_718_000_000_000.0, 5.0, true),
    ] {
        let mut text = format!("{name},x_m,y_m,contact\n");
        for k in 0..20 {
            text.push_str(&format!("{:.4},0.{k:02},0,1\n", begin + step * f64::from(k)));
        }
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pen.csv");
        std::fs::write(&file, &text).unwrap();
        let path = load_csv(&file).unwrap();
        assert!(
            path.samples[0].t_s == 0.0 && (path.samples[19].t_s - 0.095).abs() < 1e-6,
            "{name}: {path:?}"
        );
        let r = load_recording(&file).unwrap();
        assert!((r.rate_hz - 200.0).abs() < 0.1 && r.segments[0].components[0].stamps_s.is_empty(), "{name}");
        assert_eq!(told(&r).len(), usize::from(unit_told), "{name}: {:?}", told(&r));
    }
    // Others keep their zero: recordings of one machine have one clock.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pen.csv");
    std::fs::write(&file, "t_s,x_m,y_m,contact\n45000.5,0,0,1\n45000.505,0,0,1\n").unwrap();
    assert_eq!(load_csv(&file).unwrap().samples[0].t_s, 45000.5);
}

#[test]
fn equal_stamps_are_merged_and_stamps_that_step_back_left_out_with_their_number() {
    let r = read(
        "t_ms,x_mm,y_mm,contact\n0,0,0,1\n5,2,0,1\n5,4,0,1\n10,6,0,1\n7,90,90,1\n15,8,0,1\n20,10,0,1\n20,10,0,0\n",
    )
    .unwrap();
    let x: Vec<f64> = r.segments[0].components[0].points.iter().map(|[x, _]| (x * 1e3).round()).collect();
    assert_eq!(x, [0.0, 3.0, 6.0, 8.0]);
    assert_eq!(parts(&r), [(true, 4, None), (false, 1, None)]);
    assert_eq!(
        told(&r),
        [
            "2 samples have the stamp of the one before, and are merged",
            "1 samples step back in time, and are left out"
        ]
    );
    let message = read("t_s,x_m,y_m\n3,0,0\n2,0,0\n1,0,0\n0,0,0\n").unwrap_err();
    assert_eq!(message, "pen.csv: 3 of 4 stamps step back; write the samples in order of time, on one clock");
}

#[test]
fn uneven_stamps_are_kept_and_even_ones_change_nothing() {
    let file = |step_s: &dyn Fn(u32) -> f64| {
        let (mut text, mut t_s) = ("t_s,x_m,y_m,contact\n".to_owned(), 0.0);
        for k in 0..60 {
            text.push_str(&format!("{t_s:.6},{:.6},0,1\n", 0.5 * t_s));
            t_s += step_s(k);
        }
        read(&text).unwrap()
    };
    let even = file(&|k| if k % 2 == 0 { 0.005 } else { 0.005_009 });
    assert!(even.segments[0].components.iter().all(|c| c.stamps_s.is_empty()));
    assert_eq!(even.segments[0].components[0].points.len(), 60);
    let uneven = file(&|k| if k % 3 == 0 { 0.012 } else { 0.004 });
    let component = &uneven.segments[0].components[0];
    assert_eq!((component.stamps_s.len(), uneven.segments[0].components.len()), (60, 1));
    assert!((uneven.rate_hz - 150.0).abs() < 2.0, "{}", uneven.rate_hz);
    let steps = component.even_points(uneven.rate_hz);
    assert!(steps.windows(2).all(|w| ((w[1][0] - w[0][0]) * uneven.rate_hz - 0.5).abs() < 1e-3), "{steps:?}");
}

#[test]
fn what_cannot_be_read_is_named_with_line_column_value_and_range() {
    for (text, wanted) in [
        (
            "t_ms,x_mm,y_mm\n0,0,0\n5,far,0\n",
            "pen.csv:3: x_mm is \"far\"; legal: a number in [-100000, 100000]",
        ),
        ("t_ms,x_mm,y_mm\n0,0,0\n5,,0\n", "pen.csv:3: x_mm is \"\"; legal: a number"),
        ("t_ms,x_mm,y_mm\n0,0,0\nsoon,0,0\n", "pen.csv:3: t_ms is \"soon\"; legal: a number"),
        (
            "# a\n\nt_ms,x_mm,y_mm,touch\n0,0,0,perhaps\n",
            "pen.csv:4: touch is \"perhaps\"; legal: 0, 1, false, true",
        ),
        ("x_mm,y_mm,touch\n0,0,1\n", "pen.csv:1: expected a header like t_s,x_m,y_m,contact"),
        ("t_s,x_m,y_m\n0,0,0\n", "pen.csv: 1 samples; a path needs at least 2"),
        ("0,0,0,1\n0.005,0,0,1\n", "pen.csv: not CSV: it holds numbers without a header"),
    ] {
        let message = read(text).unwrap_err();
        assert!(message.starts_with(wanted), "{message}\nwanted: {wanted}");
    }
}

#[test]
fn the_rate_of_uneven_stamps_is_their_mean_unless_the_file_states_one() {
    // Whole milliseconds of a device of 133 Hz.
    let rows = |from: &str| {
        let row = |k: usize| format!("{:.3},0.{k:03},0,1\n", (k as f64 * 7.52).floor() * 1e-3);
        format!("{from}t_s,x_m,y_m,contact\n{}", (0..400).map(row).collect::<String>())
    };
    let r = read(&rows("")).unwrap();
    assert!((r.rate_hz - 132.98).abs() < 0.1, "{}", r.rate_hz);
    let r = read(&rows("# foretrace-pen version=1 unit=m rate_hz=130 writer=-\n")).unwrap();
    assert!((r.rate_hz - 130.0).abs() < 1e-3, "{}", r.rate_hz);
    // Even ones have one over their median step, to the last bit.
    let times = [0.0, 0.005, 0.010_004, 0.015_002];
    let rows: String = times.iter().map(|t| format!("{t},0,0\n")).collect();
    let r = read(&format!("t_s,x_m,y_m\n{rows}")).unwrap();
    assert_eq!(r.rate_hz, 1.0 / (times[1] - times[0]));
}

#[test]
fn a_clock_that_is_coarser_than_the_samples_is_refused() {
    let rows = |header: &str, of: &dyn Fn(u64) -> u64| {
        let rows = (0..400).map(|k| format!("{},{k},0,1\n", of(k)));
        format!("{header},x_mm,y_mm,contact\n{}", rows.collect::<String>())
    };
    for header in ["t_s", "time"] {
        let why = read(&rows(header, &|k| 1_700_000_000 + k / 200)).unwrap_err();
        assert_eq!(
            why,
            "pen.csv: 398 of 400 samples have the stamp of the one before: the clock is coarser than the \
             samples; write stamps that tell them apart"
        );
    }
    // Two samples a stamp are merged, and so are rows that only repeat one.
    assert_eq!(parts(&read(&rows("t_ms", &|k| 8 * (k / 2))).unwrap()), [(true, 200, None)]);
    let polled: String = (0..400).map(|k| format!("{},{},0,1\n", k / 8 * 8, k / 8)).collect();
    let polled = read(&format!("t_ms,x_mm,y_mm,contact\n{polled}")).unwrap();
    assert_eq!((parts(&polled), polled.rate_hz.round()), (vec![(true, 50, None)], 125.0));
    let slow = read("time,x_mm,y_mm\n1700000000,0,0\n1700000001,1,0\n1700000002,2,0\n").unwrap();
    assert_eq!(slow.rate_hz, 1.0);
    assert!(told(&slow)[1].starts_with("the time is taken as seconds, as large as its numbers are"));
}

#[test]
fn stamps_since_1970_give_the_rate_of_the_device() {
    for (header, digits, ticks) in
        [("time", 3, 5_u64), ("stamp_s", 6, 5000), ("stamp_ns", 0, 5_000_000), ("unix_ms", 0, 5)]
    {
        let scale = 10_u64.pow(digits);
        let per_s = ticks * 200 / scale.min(ticks * 200);
        let row = |k: u64| {
            let now = 1_700_000_000 * per_s * scale + k * ticks;
            let fraction = if digits == 0 {
                String::new()
            } else {
                format!(".{:0w$}", now % scale, w = digits as usize)
            };
            format!("{}{fraction},0.{k:03},0,1\n", now / scale)
        };
        let text = format!("{header},x_m,y_m,contact\n{}", (0..200).map(row).collect::<String>());
        let r = read(&text).unwrap();
        assert!((r.rate_hz - 200.0).abs() < 1e-9, "{header}: {}", r.rate_hz);
        assert_eq!(parts(&r), [(true, 200, None)], "{header}");
    }
}

#[test]
fn stamps_of_no_clock_cost_their_own_rows_only() {
    let rows = |odd: usize, stamp: &str, begin: u64| {
        let stamp_of =
            |k: usize| if k == odd { stamp.to_owned() } else { (begin + 5 * k as u64).to_string() };
        let rows = (0..100).map(|k| format!("{},{k},0,1\n", stamp_of(k)));
        read(&format!("t_ms,x_mm,y_mm,contact\n{}", rows.collect::<String>())).unwrap()
    };
    let ahead = "1 samples are far ahead in time of those that follow, and are left out";
    let untimed = "1 rows have no time of the clock of the others, and are left out";
    for (odd, stamp, begin, wanted) in [
        (50, "1000250", 0, ahead),
        (0, "1700000000000", 0, ahead),
        (50, "1700000999999", 1_700_000_000_000, ahead),
        (0, "0", 1_700_000_000_000, untimed),
        (50, "0", 1_700_000_000_000, untimed),
    ] {
        let r = rows(odd, stamp, begin);
        assert_eq!((parts(&r), told(&r)), (vec![(true, 99, None)], vec![wanted.to_owned()]), "{odd} {stamp}");
        assert!((r.rate_hz - 200.0).abs() < 1e-6, "{odd} {stamp}: {}", r.rate_hz);
    }
}

#[test]
fn cells_without_a_value_say_nothing_and_are_counted() {
    let r = read("t_ms,x_mm,y_mm,contact\n0,0,0,1\n5,nan,NaN,1\n10,1,0,NA\n15,2,0,0\nnan,,null,\n20,3,0,0\n")
        .unwrap();
    assert_eq!(parts(&r), [(true, 2, None), (false, 2, None)]);
    let wanted = [
        "1 rows say nothing of contact, and are as the row before",
        "2 rows have no position, and are left out",
    ];
    assert_eq!(told(&r), wanted);
    for (header, down, up, wanted) in [
        ("pressure", "0.4", "", "4 rows have no pressure, and count as hovering"),
        ("pressure", "0.4", "NaN", "4 rows have no pressure, and count as hovering"),
        ("contact", "1", "", "4 rows say nothing of contact where others say contact, and count as hovering"),
        ("hover", "", "1", "20 rows say nothing of contact where others say none, and count as ink"),
        ("buttons", "1", "", "4 rows say nothing of contact where others say contact, and count as hovering"),
    ] {
        let r = written(header, |_, is_down| format!("0,{}", if is_down { down } else { up }));
        assert_eq!((parts(&r), told(&r)), (STROKES.to_vec(), vec![wanted.to_owned()]), "{header}");
    }
}

#[test]
fn even_files_with_many_short_lifts_keep_their_strokes() {
    let stroke = |of: u32| (0..6).map(move |k| f64::from(of * 55 + k * 5) * 1e-3);
    let rows: String = (0..60).flat_map(stroke).map(|t_s| format!("{t_s:.3},{t_s:.3},0,1\n")).collect();
    let r = read(&format!("t_s,x_m,y_m,contact\n{rows}")).unwrap();
    assert!((r.rate_hz - 200.0).abs() < 1e-9, "{}", r.rate_hz);
    let strokes = parts(&r);
    assert!(strokes.len() == 60 && strokes.iter().all(|(_, points, _)| *points == 6), "{strokes:?}");
}

#[test]
fn tables_of_every_shape_are_read() {
    let wanted = vec![(true, 2, None), (false, 1, None)];
    for text in [
        "t_ms,x_mm,y_mm,contact\r0,0,0,1\r5,1,0,1\r10,2,0,0\r",
        "t_ms,x_mm,y_mm,contact,note\n0,0,0,1,\"a\nb\"\n5,1,0,1,\"c, \"\"d\"\"\"\n10,2,0,0,\n",
        "\"t_ms\", \"x_mm\", \"y_mm\", \"contact\"\n\"0\", \"0\", \"0\", \"1\"\n\"5\", \"1\", \"0\", \"1\"\n\"10\", \"2\", \"0\", \"0\"\n",
        "# made by numpy\n# t_ms,x_mm,y_mm,contact\n0.0e+00,0,0,1.0e+00\n5.0e+00,1,0,1.0e+00\n1.0e+01,2,0,0.0e+00\n",
    ] {
        let r = read(text).unwrap();
        assert_eq!(
            (parts(&r), told(&r).iter().filter(|l| !l.contains("note")).count()),
            (wanted.clone(), 0),
            "{text}"
        );
    }
    let preamble =
        "[Recording]\nDevice=Tablet\n[Samples]\nt_ms,x_mm,y_mm,contact\n0,0,0,1\n5,1,0,1\n10,2,0,0\n";
    assert_eq!(parts(&read(preamble).unwrap()), wanted);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pen.txt");
    std::fs::write(&file, preamble).unwrap();
    assert_eq!(parts(&load_recording(&file).unwrap()), wanted);
    let why = read("[{\"t\":0}]\n").unwrap_err();
    assert!(why.starts_with("pen.csv: not CSV: it is JSON"), "{why}");
}
