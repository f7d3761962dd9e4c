//! CSV files of others, made here: names, units, separators, clocks, events, and what is said of them.

use foretrace_sim::data::{Recording, load_csv, load_recording};

fn read(text: &str) -> Result<Recording, String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pen.csv");
    std::fs::write(&file, text).unwrap();
    let folder = format!("{}/", folder.path().display());
    load_recording(&file).map_err(|error| error.to_string().replace(&folder, ""))
}

fn told(recording: &Recording) -> Vec<String> {
    recording.remarks.iter().map(ToString::to_string).collect()
}

/// Contact, points and time before, of each component.
fn parts(recording: &Recording) -> Vec<(bool, usize, Option<f64>)> {
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
fn events_of_a_browser_are_strokes_of_its_pen() {
    let r = read(
        "type,timeStamp,pointerId,pointerType,clientX,clientY,pressure,buttons\n\
         pointermove,1000.0,7,pen,10,50,0,0\n\
         pointerdown,1008.1,7,pen,11,51,0.2,1\n\
         pointermove,1016.2,7,pen,12,52,0.4,1\n\
         pointermove,1018.0,3,touch,500,500,0.5,1\n\
         mousemove,1016.2,7,pen,12,52,0.4,1\n\
         keydown,1017.0,,,,,,\n\
         pointermove,1024.3,7,pen,13,53,0.4,1\n\
         pointerup,1024.3,7,pen,13,53,0,0\n\
         pointermove,1032.4,7,pen,14,54,0,0\n\
         pointerdown,1100.0,9,pen,30,60,0.2,1\n\
         pointermove,1108.0,9,pen,31,61,0.2,1\n\
         pointerup,1116.0,9,pen,,,0,0\n",
    )
    .unwrap();
    let found: Vec<_> = parts(&r).into_iter().map(|(contact, points, _)| (contact, points)).collect();
    assert_eq!(found, [(false, 1), (true, 2), (false, 2), (true, 2)], "{r:?}");
    // y of a screen grows downwards; its pixels have no size.
    assert_eq!((r.segments[0].components[1].points[0], r.units_per_m), ([11.0, -51.0], None));
    let told = told(&r);
    for wanted in [
        "1 rows are events of other kinds",
        "2 rows are of other pointers",
        "1 rows have no position",
        "1 samples have the stamp",
        "the time is taken as milliseconds",
    ] {
        assert!(told.iter().any(|line| line.starts_with(wanted)), "{wanted}: {told:?}");
    }
}

#[test]
fn motion_events_of_android_and_packets_of_a_wacom_are_read() {
    let android = read(
        "eventTime,action,x,y,pressure,toolType\n5000,9,1,1,0,2\n5008,0,2,2,0.3,2\n5016,2,3,3,0.3,2\n5024,1,3,3,0.3,2\n\
         5200,ACTION_DOWN,9,9,0.3,2\n5208,ACTION_MOVE,9,8,0.3,2\n",
    )
    .unwrap();
    let found: Vec<_> = parts(&android).into_iter().map(|(contact, points, _)| (contact, points)).collect();
    assert_eq!(found, [(false, 1), (true, 2), (false, 1), (true, 2)]);
    assert_eq!(android.segments[0].components[1].points[0], [2.0, -2.0]);
    let wacom = read(
        "pkTime,pkX,pkY,pkNormalPressure,pkStatus\n10,100,200,0,0\n15,101,201,300,0\n20,102,202,310,0\n",
    )
    .unwrap();
    assert_eq!(parts(&wacom), [(false, 1, None), (true, 2, None)]);
    assert_eq!(wacom.segments[0].components[0].points[0], [100.0, 200.0]);
    assert!((wacom.rate_hz - 200.0).abs() < 1e-9);
    let pad = read("x,y,pressure,rdy,sw,timeCount\n1,2,0,1,0,0\n1,3,200,1,1,5\n1,4,200,1,1,10\n").unwrap();
    assert_eq!(parts(&pad), [(false, 1, None), (true, 2, None)]);
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

/// Rows of a pen that writes for 12 samples, hovers for 4 and writes again, 5 ms apart, with what `cells`
/// tells of each: its number, and whether the pen is down.
fn written(header: &str, cells: impl Fn(usize, bool) -> String) -> Recording {
    let rows = (0..24).map(|k| format!("{},{k},{}\n", 5 * k, cells(k, !(12..16).contains(&k))));
    read(&format!("t_ms,x_mm,y_mm,{header}\n{}", rows.collect::<String>())).unwrap()
}

const STROKES: [(bool, usize, Option<f64>); 3] = [(true, 12, None), (false, 4, None), (true, 8, None)];

#[test]
fn a_column_of_states_is_no_list_of_android_events() {
    let number = |yes: bool| if yes { "1" } else { "0" };
    let r = written("state", |_, down| format!("0,{}", number(down)));
    assert_eq!((parts(&r), told(&r)), (STROKES.to_vec(), vec![]));
    // A column of contact goes before it.
    let r = written("state,contact", |_, down| format!("0,{},{}", number(!down), number(down)));
    assert_eq!((parts(&r), told(&r)), (STROKES.to_vec(), vec!["the column state is not used".to_owned()]));
    // States of something else.
    let r = written("state,contact", |k, down| format!("0,{},{}", k % 5, number(down)));
    assert_eq!(parts(&r), STROKES);
    // UITouch: began, moved, stationary, ended, cancelled.
    let phase = |k: usize, down: bool| match k {
        0 | 16 => "0",
        12 => "3",
        _ if down => ["1", "2"][k % 2],
        _ => "4",
    };
    let r = written("phase", |k, down| format!("0,{}", phase(k, down)));
    assert_eq!(parts(&r), STROKES);
    // The phase of an experiment begins strokes and ends none.
    let r = written("phase,contact", |k, down| format!("0,{},{}", k / 10, number(down)));
    assert_eq!(parts(&r), STROKES);
    // Numbers of an event that nobody names are none of Android's.
    let r = written("event,contact", |_, down| format!("0,{},{}", number(!down), number(down)));
    assert_eq!(parts(&r), STROKES);
    let r = written("action", |k, down| {
        format!(
            "0,{}",
            if k == 0 || k == 16 {
                0
            } else if down {
                2
            } else {
                1
            }
        )
    });
    assert_eq!(parts(&r), STROKES);
}

#[test]
fn a_column_of_events_may_be_filled_where_something_changes() {
    let change = |k: usize| match k {
        0 | 16 => "down",
        12 => "up",
        _ => "",
    };
    let r = written("event", |k, _| format!("0,{}", change(k)));
    assert_eq!((parts(&r), told(&r)), (STROKES.to_vec(), vec![]));
    let r = written("type", |k, _| {
        format!("0,{}", change(k).replace("down", "pointerdown").replace("up", "pointerup"))
    });
    assert_eq!(parts(&r), STROKES);
}

#[test]
fn where_events_only_move_contact_buttons_or_pressure_tell() {
    for (header, down, up) in [
        ("type,isDown", "pointermove,true", "pointermove,false"),
        ("type,hover", "pointermove,0", "pointermove,1"),
        ("type,buttons", "pointermove,1", "pointermove,0"),
        ("type,pressure", "pointermove,0.5", "pointermove,0"),
        ("type,pressure", "pointermove,0.5", "pointermove,"),
        ("action", "ACTION_MOVE", "ACTION_HOVER_MOVE"),
        // Buttons on the pen's side: pressure tells.
        ("pressure,buttonState", "0.5,0", "0,0"),
        ("pressure,buttonState", "0.5,32", "0,32"),
        ("type,pressure,buttons", "pointermove,0.5,0", "pointermove,0,0"),
    ] {
        let r = written(header, |_, is_down| format!("0,{}", if is_down { down } else { up }));
        assert_eq!(parts(&r), STROKES, "{header} {down} {up}");
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
