//! What each trouble of a controller is called, how bad it is, and what to do about it.

use super::*;
use crate::bridge::check::{Installation, Version};
use crate::bridge::kinematics::Deviation;
use foretrace_config::Config;

fn facts() -> Facts {
    Facts {
        loopback: false,
        dashboard: Port::Open("Connected".to_owned()),
        primary: Port::Open("states".to_owned()),
        rtde: Port::Open("protocol 2".to_owned()),
        version: Some(Version { major: 3, minor: 15, bugfix: 8, build: 1 }),
        arm: Some("UR5".to_owned()),
        remote: None,
        modes: Some(Modes { robot: 7, safety: 1, runtime: 1, speed_scaling: 0.0, slider: 1.0 }),
        installation: Some(Installation {
            q: Config::preset("ur5").unwrap().robot().home,
            payload_kg: Some(0.4),
            tcp_m: Some([0.0, 0.0, 0.15]),
        }),
        registers: Some(RegisterFact::Free),
        timing: Some(Timing {
            seconds: 10.0,
            rate_hz: 125.0,
            states: 1250,
            skipped: 0,
            late_ms: [0.1, 0.4, 1.0],
            round_trips: vec![0, 1240, 9, 0, 0, 0, 0],
        }),
        dh: None,
        deviation: Some(Deviation { most_mm: 0.1, uneven_mm: 0.1, height_mm: 0.0, turned_mm: 900.0 }),
    }
}

fn judged(change: impl FnOnce(&mut Facts)) -> Vec<Finding> {
    let text = "preset = \"ur5-first-run\"\n[robot.ur]\npayload_kg = 0.4\ntcp_m = [0.0, 0.0, 0.15]\n";
    let config = Config::parse(text, "t.toml", ".").unwrap();
    let mut facts = facts();
    change(&mut facts);
    all(&facts, &config)
}

#[test]
fn a_controller_in_order_has_nothing_but_good_findings() {
    let poor: Vec<_> = judged(|_| {}).into_iter().filter(|f| f.grade != Grade::Good).collect();
    assert!(poor.is_empty(), "{poor:?}");
}

/// Change, name of the finding, grade, words of the fix.
type Row = (fn(&mut Facts), &'static str, Grade, &'static str);

#[test]
fn each_trouble_is_reported_under_its_name_with_what_to_do() {
    let rows: [Row; 20] = [
        (|f| f.rtde = Port::Refused, "rtde (30004)", Grade::Bad, "enable RTDE"),
        (|f| f.primary = Port::Silent("timed out".to_owned()), "primary (30001)", Grade::Bad, "firewall"),
        (|f| f.dashboard = Port::Refused, "dashboard (29999)", Grade::Fair, "Dashboard Server"),
        (|f| f.rtde = Port::Strange("HTTP".to_owned()), "rtde (30004)", Grade::Bad, "Universal Robots"),
        (
            |f| f.version = Some(Version { major: 10, minor: 7, bugfix: 0, build: 0 }),
            "version",
            Grade::Bad,
            "PolyScope X",
        ),
        (
            |f| f.version = Some(Version { major: 5, minor: 12, bugfix: 0, build: 0 }),
            "version",
            Grade::Bad,
            "controller_rate_hz",
        ),
        (|f| f.remote = Some(false), "remote control", Grade::Bad, "Remote Control"),
        (|f| f.modes.as_mut().unwrap().robot = 3, "robot", Grade::Bad, "brakes"),
        (|f| f.modes.as_mut().unwrap().safety = 3, "safety", Grade::Bad, "on the pendant"),
        (|f| f.modes.as_mut().unwrap().runtime = 2, "program", Grade::Bad, "stop it"),
        (|f| f.modes.as_mut().unwrap().slider = 0.5, "speed", Grade::Bad, "100 %"),
        (
            |f| f.registers = Some(RegisterFact::InUse(vec!["input_int_register_24".to_owned()])),
            "registers",
            Grade::Bad,
            "Fieldbus",
        ),
        (|f| f.installation.as_mut().unwrap().q[0] = 6.9, "joints", Grade::Bad, "turn it back"),
        (|f| f.installation.as_mut().unwrap().payload_kg = Some(2.0), "payload", Grade::Bad, "weigh"),
        (|f| f.timing.as_mut().unwrap().skipped = 40, "states", Grade::Bad, "direct cable"),
        (|f| f.timing.as_mut().unwrap().round_trips[6] = 5, "round trip", Grade::Bad, "five cycles"),
        (|f| f.deviation.as_mut().unwrap().most_mm = 80.0, "calibration", Grade::Bad, "another model of arm"),
        (
            |f| f.installation.as_mut().unwrap().tcp_m = Some([0.0; 3]),
            "tool centre point",
            Grade::Bad,
            "150.0 mm away",
        ),
        (|f| f.deviation.as_mut().unwrap().most_mm = 4.0, "calibration", Grade::Fair, "calibrate kinematics"),
        (|f| f.timing = None, "round trip", Grade::Fair, "run again"),
    ];
    for (change, name, grade, fix) in rows {
        let found = judged(change);
        let finding = found.iter().find(|finding| finding.name == name).unwrap();
        assert_eq!(finding.grade, grade, "{finding:?}");
        assert!(finding.fix.contains(fix), "{finding:?}");
    }
}

#[test]
fn a_payload_that_nobody_wrote_down_is_bad_for_a_real_arm_as_for_the_bridge() {
    let config = Config::parse("preset = \"ur5-first-run\"\n", "t.toml", ".").unwrap();
    let grade = |loopback| {
        let facts = Facts { loopback, ..facts() };
        let found = all(&facts, &config);
        found.iter().find(|f| f.name == "payload").unwrap().grade
    };
    assert_eq!((grade(false), grade(true)), (Grade::Bad, Grade::Fair));
}

#[test]
fn every_finding_that_is_not_good_says_what_to_do_even_where_nothing_is_known() {
    let config = Config::preset("ur5").unwrap();
    for facts in [Facts::default(), facts()] {
        for finding in all(&facts, &config) {
            assert_eq!(finding.fix.is_empty(), finding.grade == Grade::Good, "{finding:?}");
        }
    }
}

#[test]
fn without_a_program_only_the_slider_tells_the_speed() {
    let scaled = |f: &mut Facts| {
        let modes = f.modes.as_mut().unwrap();
        (modes.runtime, modes.speed_scaling) = (2, 0.4);
    };
    let of = |found: Vec<Finding>| found.iter().find(|f| f.name == "speed").unwrap().grade;
    assert_eq!((of(judged(|_| {})), of(judged(scaled))), (Grade::Good, Grade::Bad));
}
