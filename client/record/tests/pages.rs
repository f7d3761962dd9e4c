//! Pages of recordings: what they show, what they say is missing, and what a hostile file can do to them.

use std::path::PathBuf;

use foretrace_config::Config;
use foretrace_record::page::of_recording;
use foretrace_record::topics::{RecordingTopic, thing_bytes};
use foretrace_record::write::{FileFacts, Output};
use foretrace_shm::{GhostState, Mode, PieceKind, Thing, TickRecord, Wire, pen_flags};
use serde_json::Value;
use tempfile::TempDir;

const SECOND: u64 = 1_000_000_000;

fn settings() -> Thing {
    let text = Config::preset("ur5").unwrap().render();
    Thing { kind: PieceKind::Settings, number: 0, daemon_id: 5, bytes: text.into_bytes() }
}

/// A tick `after_ns` after the first: a pen that draws circles about `tool` \[m\], which is where the arm is
/// at `home`, an arm that turns a little, and a ghost that is 12 mm behind the pen.
fn tick(number: u64, after_ns: u64, home: [f64; 6], tool: [f64; 2]) -> TickRecord {
    let now = 100 * SECOND + after_ns;
    let t = after_ns as f64 * 1e-9;
    let mut q = home;
    q[0] += 0.005 * t.sin();
    let (x, y) = (tool[0] + 0.005 * (3.0 * t).sin(), tool[1] + 0.005 * (3.0 * t).cos());
    TickRecord {
        tick: number,
        release_ns: now,
        command_stamp_ns: now + 2_000_000,
        pen_sequence: number,
        pen_stamp_ns: now - 1_000_000,
        pen_m: [x, y, 0.0],
        pen_flags: pen_flags::CONTACT,
        joint_state_age_ns: 1_000_000,
        measured_q: q,
        mode: Mode::Following.into(),
        ghost_state: GhostState::Comparable.into(),
        ghost_tool_m: [x - 0.012, y, 0.0],
        compared_ns: now - 100_000_000,
        error_m: 0.001,
        ghost_error_m: 0.012,
        compared_contact: 1,
        trust: 0.9,
        ..TickRecord::default()
    }
}

/// The first `seconds` of it, `hz` records a second.
fn ticks(seconds: u64, hz: u64) -> Vec<TickRecord> {
    let config = Config::preset("ur5").unwrap();
    let (home, plane) = (config.robot().home, config.follower_settings().plane);
    let tool = plane.point_from_base(&config.robot().chain.forward(&home).position);
    (0..seconds * hz).map(|k| tick(k + 1, k * SECOND / hz, home, [tool.x, tool.y])).collect()
}

fn without_ghost(record: TickRecord) -> TickRecord {
    TickRecord {
        ghost_state: GhostState::Off.into(),
        ghost_tool_m: [0.0; 3],
        compared_ns: 0,
        error_m: -1.0,
        ghost_error_m: -1.0,
        ..record
    }
}

fn written(place: &TempDir, name: &str, things: &[Thing], ticks: &[TickRecord]) -> PathBuf {
    let target = place.path().join(name);
    let mut output = Output::create(&target, &FileFacts::new()).unwrap();
    for thing in things {
        output.put(RecordingTopic::Thing, 1, &thing_bytes(thing)).unwrap();
    }
    for record in ticks {
        let mut bytes = Vec::new();
        record.put(&mut bytes);
        output.put(RecordingTopic::TickRaw, record.release_ns, &bytes).unwrap();
    }
    output.finish(&FileFacts::new()).unwrap()
}

/// The frames that a page holds.
fn frames(page: &str) -> Value {
    let (_, after) = page.split_once("id=\"moved\">").expect("frames");
    serde_json::from_str(after.split_once("</script>").unwrap().0).expect("frames as JSON")
}

fn places(series: &Value) -> usize {
    series["x"].as_array().unwrap().iter().filter(|x| x.is_number()).count()
}

#[test]
fn a_recording_makes_a_page_with_pen_arm_and_ghost_that_asks_for_nothing() {
    let place = TempDir::new().unwrap();
    let file = written(&place, "run.mcap", &[settings()], &ticks(6, 500));
    let (page, reported) = of_recording(&file).unwrap();
    assert!(!reported.moments.is_empty() && reported.damage.is_none());
    let moved = frames(&page);
    for series in ["pen", "arm", "ghost"] {
        assert!(places(&moved[series]) > 500, "{series}");
    }
    // At one time the ghost is 12 mm behind.
    let behind = |k: usize| moved["pen"]["x"][k].as_i64().unwrap() - moved["ghost"]["x"][k].as_i64().unwrap();
    assert!((behind(200) - 1200).abs() < 60, "{}", behind(200));
    for words in ["12.00 mm rms", "1.00 mm", "Moments that matter"] {
        assert!(page.contains(words), "{words}");
    }
    for outside in ["://", "src=", "href=", "@import", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert!(!page.contains("has no ghost"));
    assert!(page.len() < 400_000, "{} bytes", page.len());
}

#[test]
fn a_recording_without_a_ghost_makes_a_page_that_says_so() {
    let place = TempDir::new().unwrap();
    let ticks: Vec<_> = ticks(4, 500).into_iter().map(without_ghost).collect();
    let (page, _) = of_recording(&written(&place, "run.mcap", &[settings()], &ticks)).unwrap();
    assert!(page.contains("This recording has no ghost"));
    assert!(!page.contains("without prediction:"), "nothing stands for what is not there");
    let moved = frames(&page);
    assert!(moved["ghost"].is_null() && places(&moved["pen"]) > 300 && places(&moved["arm"]) > 300);
}

#[test]
fn a_long_recording_is_cut_to_a_minute_and_the_page_says_so() {
    let place = TempDir::new().unwrap();
    let mut ticks = ticks(150, 100);
    // The second minute has the pen in the air.
    for record in &mut ticks[6000..12000] {
        record.pen_flags = 0;
    }
    let (page, _) = of_recording(&written(&place, "long.mcap", &[settings()], &ticks)).unwrap();
    assert!(page.contains("Of 3 pieces in which it followed, each 60 s long at most"));
    let moved = frames(&page);
    let count = moved["pen"]["x"].as_array().unwrap().len();
    assert!((5900..=6001).contains(&count) && moved["from"].as_f64().unwrap() < 1.0, "{count} frames");
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
}

#[test]
fn what_a_file_is_called_stays_text() {
    let place = TempDir::new().unwrap();
    let name = "<img src=x onerror=alert(1)>&\"'.mcap";
    let (page, _) = of_recording(&written(&place, name, &[settings()], &ticks(2, 200))).unwrap();
    assert!(!page.contains("<img"));
    assert!(page.contains("<h1>&lt;img src=x onerror=alert(1)&gt;&amp;&quot;"));
}

#[test]
fn forged_numbers_are_left_out_and_the_page_stays_small() {
    let place = TempDir::new().unwrap();
    let mut ticks = ticks(3, 200);
    for (k, record) in ticks.iter_mut().enumerate() {
        match k % 7 {
            0 => record.measured_q = [f64::NAN; 6],
            1 => record.pen_m = [f64::INFINITY, 1e300, 0.0],
            2 => record.ghost_tool_m = [1e300, f64::NAN, 0.0],
            3 => (record.compared_ns, record.error_m) = (u64::MAX, 1e300),
            4 => record.pen_stamp_ns = u64::MAX,
            5 => record.command_stamp_ns = u64::MAX,
            _ => record.joint_state_age_ns = u64::MAX,
        }
    }
    // Time leaps by centuries, and back.
    ticks[300].release_ns = u64::MAX - 1;
    let file = written(&place, "forged.mcap", &[settings()], &ticks);
    let (page, _) = of_recording(&file).unwrap();
    assert!(page.len() < 1_000_000 && !page.contains("NaN"), "{} bytes", page.len());
    let moved = frames(&page);
    assert!(moved["pen"]["x"].as_array().unwrap().len() <= 6001);
}

#[test]
fn what_a_page_cannot_do_without_is_said() {
    let place = TempDir::new().unwrap();
    let says = |file: PathBuf| of_recording(&file).unwrap_err().to_string();
    let reported = says(written(&place, "bare.mcap", &[], &ticks(2, 200)));
    assert!(reported.contains("the arm's geometry is not known: it holds no settings"), "{reported}");
    let idle: Vec<_> =
        ticks(2, 200).into_iter().map(|record| TickRecord { mode: Mode::Armed.into(), ..record }).collect();
    let reported = says(written(&place, "idle.mcap", &[settings()], &idle));
    assert!(reported.contains("the loop never follows a pen in it"), "{reported}");
    let foreign = Thing { bytes: b"[robot]\nname = 7".to_vec(), ..settings() };
    let reported = says(written(&place, "foreign.mcap", &[foreign], &ticks(2, 200)));
    assert!(reported.contains("the arm's geometry is not known"), "{reported}");
}
