//! The dead-man switch of a terminal: `foretrace enable --terminal` behind a real pseudo-terminal.

use foretrace_tests::{World, assert_refused, told, until};

use crate::PROGRAM;

/// Runs a program on a terminal of its own, holds the space bar there for five seconds, then waits.
const TYPIST: &str = "\
import os, pty, select, signal, sys, time
child, terminal = pty.fork()
if child == 0:
    os.execv(sys.argv[1], sys.argv[1:])
signal.signal(signal.SIGINT, lambda *_: (os.kill(child, signal.SIGINT), os.waitpid(child, 0), sys.exit(0)))
begin = time.time()
while True:
    # As a terminal repeats a key that is held: at once, after half a second, then often.
    held = time.time() - begin
    if held < 5 and (held < 0.05 or held > 0.5):
        os.write(terminal, b' ')
    if select.select([terminal], [], [], 0.03)[0]:
        try:
            sys.stderr.write(os.read(terminal, 4096).decode())
        except OSError:
            sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
";

#[test]
fn a_key_of_a_terminal_holds_a_simulated_arm_and_its_release_stops_it() {
    let mut world = World::with_rights_kept(PROGRAM);
    let _daemon = world.daemon_with(0, &["--set", "safety.enable_required=true"]);
    let refused = world.run(0, &["enable", "--terminal"]);
    assert_refused(&refused, 5, &["no arm is there", "foretrace arm sim"]);
    let mut arm = world.start(0, &["arm", "sim"]);
    until("the arm is there", || world.status(0)["arm"]["joints_rad"][5].as_f64());
    assert_refused(&world.run(0, &["request", "arm"]), 4, &["not enabled", "foretrace enable"]);
    assert_refused(&world.run(0, &["enable", "--terminal"]), 2, &["no terminal"]);
    world.go_through(["python3", "-c", TYPIST].map(str::to_owned).to_vec());
    let typist = world.start(0, &["enable", "--terminal"]);
    world.go_through(Vec::new());
    world.arm(0, &mut arm);
    let status = until("the release stops it", || {
        let status = world.status(0);
        (status["mode"] == "stopped").then_some(status)
    });
    assert_eq!(status["stop"]["reason"], "dead-man", "{status}");
    let output = typist.end();
    assert!(told(&output).contains("hold any key"), "{}", told(&output));
}
