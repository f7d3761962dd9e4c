//! CSV files whose rows are events, and what tells when the pen touches the paper.

use super::csv_files::{parts, read, told};
use foretrace_sim::data::{Recording, load_recording_in};

/// Rows of a pen that writes for 12 samples, hovers for 4 and writes again, 5 ms apart, with what `cells`
/// tells of each: its number, and whether the pen is down.
pub(crate) fn written(header: &str, cells: impl Fn(usize, bool) -> String) -> Recording {
    let rows = (0..24).map(|k| format!("{},{k},{}\n", 5 * k, cells(k, !(12..16).contains(&k))));
    read(&format!("t_ms,x_mm,y_mm,{header}\n{}", rows.collect::<String>())).unwrap()
}

pub(crate) const STROKES: [(bool, usize, Option<f64>); 3] =
    [(true, 12, None), (false, 4, None), (true, 8, None)];

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
fn rows_of_several_pointers_are_those_of_one_at_a_time() {
    // Two fingers at once, then each pointer after the other, as browsers number strokes.
    let two = written("pointerId,contact", |k, down| format!("{},{},{}", k % 2 * 500, k % 2, u8::from(down)));
    let points: Vec<[f64; 2]> =
        two.segments[0].components.iter().flat_map(|c| c.points.iter().map(|p| p.map(|v| v * 1e3))).collect();
    assert!(points.len() == 12 && points.iter().all(|[_, y]| *y == 0.0), "{points:?}");
    assert_eq!(told(&two), ["12 rows are of other pointers, and are left out"]);
    let strokes = written("pointerId,contact", |k, down| format!("0,{},{}", k / 13, u8::from(down)));
    assert_eq!((parts(&strokes), told(&strokes)), (STROKES.to_vec(), vec![]));
    // A pen among fingers; a second finger; rows without a number go with the others.
    let pen = written("tool_type,contact", |k, down| {
        let tool = if k % 3 == 1 { "finger" } else { "stylus" };
        format!("0,{tool},{}", u8::from(down))
    });
    assert_eq!(told(&pen), ["8 rows are of other pointers, and are left out"]);
    let second = written("isPrimary,contact", |k, down| format!("0,{},{}", k % 4 != 3, u8::from(down)));
    assert_eq!(told(&second), ["6 rows are of other pointers, and are left out"]);
    let sparse = written("pointerId,contact", |k, down| {
        format!("0,{},{}", if k % 2 == 0 { "7" } else { "" }, u8::from(down))
    });
    assert_eq!((parts(&sparse), told(&sparse)), (STROKES.to_vec(), vec![]));
}

#[test]
fn a_given_unit_does_not_mirror_a_screen() {
    let second = |header: &str, event: &str| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pen.csv");
        let rows = format!("t_ms,{header},type\n0,1,2,{event}down\n5,3,4,{event}move\n10,5,6,{event}up\n");
        std::fs::write(&file, rows).unwrap();
        let r = load_recording_in(&file, "mm".parse().unwrap()).unwrap();
        r.segments[0].components[0].points[1].map(|v| (v * 1e3).round())
    };
    assert_eq!(second("x,y", "pointer"), [3.0, -4.0]);
    assert_eq!(second("clientX,clientY", "pen"), [3.0, -4.0]);
    assert_eq!(second("x,y", "pen"), [3.0, 4.0]);
    // A name with a unit of length has its own direction.
    assert_eq!(second("x_mm,y_mm", "pointer"), [3.0, 4.0]);
}

#[test]
fn contact_is_told_by_numbers_of_any_writing_and_by_words_of_a_pen() {
    for (header, down, up) in [
        ("contact", "1.000", "0.000"),
        ("contact", "1e0", "\"0,0\""),
        ("pen_state", "PenDown", "PenUp"),
        ("pen_state", "STYLUS_DOWN", "hovering"),
        ("tip_contact", "touching", "up"),
        ("hover", "down", "hover"),
        ("penUp", "0.0", "1.0"),
        ("normalized_pressure", "0.5", "0"),
        ("force_n", "0.5", "0.0"),
    ] {
        let r = written(header, |_, is_down| format!("0,{}", if is_down { down } else { up }));
        assert_eq!((parts(&r), told(&r)), (STROKES.to_vec(), vec![]), "{header} {down}");
    }
    let why = read("t_ms,x_mm,y_mm,contact\n0,0,0,2\n").unwrap_err();
    assert_eq!(why, "pen.csv:2: contact is \"2\"; legal: 0, 1, false, true");
}
