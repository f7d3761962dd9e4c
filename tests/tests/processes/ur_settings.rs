//! A bridge to a UR and a daemon that were given different settings.

use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use foretrace_tests::{World, json, told, until};

use crate::PROGRAM;

const PATIENCE: Duration = Duration::from_secs(5);
const VALID: [&str; 2] = ["--set", "loop.valid_periods=12"];

#[test]
fn an_arm_whose_bridge_requires_a_dead_man_is_not_moved_by_a_daemon_that_does_not() {
    let world = World::new(PROGRAM);
    // Ports are fixed, as a real one's: tests side by side need addresses of their own.
    let [_, _, b, c] = std::process::id().to_be_bytes();
    let address = Ipv4Addr::new(127, 199, b, 1 + c % 250).to_string();
    let mut controller = world.start_plain(&["ur-sim", "--bind", &address].map(str::to_owned));
    let rtde: SocketAddr = format!("{address}:30004").parse().expect("an address");
    until("the controller listens", || {
        controller.expect_alive();
        TcpStream::connect_timeout(&rtde, PATIENCE).ok()
    });
    let _daemon = world.daemon_with(0, &VALID);

    let file = world.file("ur.json");
    let report = file.display().to_string();
    let bridge = ["arm", "ur", "--robot", &address, "--json", &report];
    let stricter = ["--set", "safety.enable_required=true", "--seconds", "8"];
    let mut strict = world.start(0, &[&bridge[..], &VALID, &stricter].concat());
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(6) {
        strict.expect_alive();
        let asked = world.run(0, &["request", "arm"]);
        assert!(!asked.status.success(), "armed over other settings: {}", told(&asked));
    }
    let output = strict.output();
    assert!(told(&output).contains("the daemon runs with other settings"), "{}", told(&output));
    assert_eq!(json(&file)["arm"]["link"]["reason"], "other-settings");

    let mut same = world.start(0, &[&bridge[..], &VALID].concat());
    world.arm(0, &mut same);
    let line = until("the round trip is told", || {
        let line = world.status(0)["arm"]["line"].clone();
        line["round_trip_ms"].is_number().then_some(line)
    });
    // At least the cycle from a state to the next read, of 8 ms.
    assert!(line["round_trip_ms"].as_f64() >= Some(8.0), "{line}");
    assert!(line["late_cycles"].is_u64() && line["without_dead_man"] == false, "{line}");
    assert!(same.end().status.success());
}
