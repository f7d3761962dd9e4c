//! Once an arm is armed and all peers have connected, the real-time thread takes no page fault: all its
//! memory is mapped and locked. Settings are read again meanwhile.

use std::time::Duration;

use foretrace_tests::{World, skipped, told, until};
use serde_json::Value;

use crate::PROGRAM;

/// Ticks that are looked at: 8 s, letters and travel.
const TICKS: u64 = 4000;

#[test]
fn real_time_thread_takes_no_page_fault_while_it_moves_an_arm() {
    let world = World::with_rights_kept(PROGRAM);
    // The lowest priority that comes with locked memory, so that it disturbs other tests least.
    let mild = ["loop.priority=1", "loop.spin_us=0", "safety.joint_state_timeout_ms=500"];
    let words: Vec<&str> =
        std::iter::once("daemon").chain(mild.iter().flat_map(|set| ["--set", *set])).collect();
    let mut daemon = world.start(0, &words);
    until("the daemon comes up", || {
        daemon.expect_alive();
        world.run(0, &["status"]).status.success().then_some(())
    });
    let missing = world.status(0)["missing_rights"].to_string();
    if missing.contains("memory") {
        skipped(&format!("this user may not lock memory ({missing})"));
        return;
    }
    let arm = world.armed_arm(0, &[]);
    let player = world.start(0, &["play", "glyphs:hello", "--loop"]);
    world.wait_for_mode(0, "following");
    // Until the last of them has connected and been warmed up to, and the count was read since.
    std::thread::sleep(Duration::from_secs(1));
    let before = world.status(0);
    // A child checks the settings: a copy of this process would write-protect every page of it.
    for _ in 0..3 {
        let asked = world.run(0, &["request", "reload"]);
        assert!(asked.status.success(), "{}", told(&asked));
    }
    let ticks = |status: &Value| status["loop"]["ticks"].as_u64().expect("a count");
    let after = until("some seconds of writing", || {
        let status = world.status(0);
        (ticks(&status) >= ticks(&before) + TICKS).then_some(status)
    });
    println!("page faults of the real-time thread since its first tick: {}", after["page_faults"]);
    assert_eq!(after["mode"], "following", "{after}");
    assert_eq!(
        after["page_faults"], before["page_faults"],
        "in {TICKS} ticks; a kernel that moves locked pages can do this as well \
         (vm.compact_unevictable_allowed)"
    );
    for process in [player, arm, daemon] {
        process.end();
    }
}
