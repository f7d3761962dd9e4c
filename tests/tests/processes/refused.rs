//! The daemon reports every refusal, with field, value, bound and a guess, in the status, in the log and in
//! the answer to a request to arm.

use foretrace_tests::{World, assert_refused, until};
use serde_json::Value;

use crate::PROGRAM;

/// The newest refusal of `what` in the status; null: none.
fn refused(status: &Value, what: &str) -> Value {
    let all = status["refused"].as_array().unwrap_or_else(|| panic!("refused: {status}"));
    all.iter().find(|refused| refused["what"] == what).cloned().unwrap_or(Value::Null)
}

/// Runs a forger until the status shows a refusal of `what` for its `field`; the refusal, and the status for
/// people.
fn told_of(world: &World, kind: &str, what: &str, field: &str) -> (Value, String) {
    let mut liar = world.start(0, &["forge", kind, "600"]);
    let seen = until(&format!("a refusal of {what}"), || {
        liar.expect_alive();
        let seen = refused(&world.status(0), what);
        (seen["field"] == field).then_some(seen)
    });
    let text = String::from_utf8(world.run(0, &["status"]).stdout).expect("text");
    let answer = world.run(0, &["request", "arm"]);
    if what == "joint state" {
        assert_refused(&answer, 4, &["q[0]", "degrees?"]);
        let said = String::from_utf8_lossy(&answer.stderr).into_owned();
        assert!(!said.contains("no joint state has arrived"), "{said}");
    }
    drop(liar);
    (seen, text)
}

#[test]
fn units_and_clocks_that_are_wrong_are_recognised() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    for (kind, what, field, guess) in [
        ("pixels", "pen", "x_m", "pixels?"),
        ("degrees", "joint state", "q", "degrees?"),
        ("wall-clock", "pen", "stamp_ns", "CLOCK_MONOTONIC"),
    ] {
        let (seen, text) = told_of(&world, kind, what, field);
        let why = seen["why"].as_str().unwrap_or_else(|| panic!("{seen}"));
        assert!(why.contains(guess), "{kind}: {why}");
        let told = text.lines().any(|line| line.starts_with("refused") && line.contains(guess));
        assert!(told, "{kind}: no line of {text}");
        println!("{kind}: {why}");
    }
    // Each new reason is logged, whatever else the log reported in that second.
    let log = daemon.testify();
    for guess in ["pixels?", "degrees?", "CLOCK_MONOTONIC"] {
        let told =
            log.lines().any(|line| line.contains(" refused") && line.contains("; ") && line.contains(guess));
        assert!(told, "{guess} in {log}");
    }
}
