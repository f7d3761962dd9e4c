//! The dead-man switch of a terminal: `foretrace enable --terminal` behind a real pseudo-terminal.

use foretrace_tests::{World, assert_refused, json, told, until};

use crate::PROGRAM;

/// Nothing but the key stops the arm: a busy machine may hold it up for half a second.
const PATIENT_LOOP: &str = "safety.joint_state_timeout_ms=500";

/// Runs a program on a terminal of its own, holds the space bar there for eight seconds, then waits.
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
    if held < 8 and (held < 0.05 or held > 0.5):
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
    held_then_released(&mut world, &mut arm);
}

/// Holds a key until `arm` is armed, and lets it go.
fn held_then_released(world: &mut World, arm: &mut foretrace_tests::Process) {
    world.go_through(["python3", "-c", TYPIST].map(str::to_owned).to_vec());
    let typist = world.start(0, &["enable", "--terminal"]);
    world.go_through(Vec::new());
    world.arm(0, arm);
    let status = until("the release stops it", || {
        let status = world.status(0);
        (status["mode"] == "stopped").then_some(status)
    });
    assert_eq!(status["stop"]["reason"], "dead-man", "{status}");
    let output = typist.end();
    assert!(told(&output).contains("hold any key"), "{}", told(&output));
}

#[test]
fn a_key_of_a_terminal_holds_the_arm_of_a_simulated_controller() {
    let mut world = World::with_rights_kept(PROGRAM);
    // Ports are fixed, as a real one's: tests side by side need addresses of their own.
    let [_, _, b, c] = std::process::id().to_be_bytes();
    let address = std::net::Ipv4Addr::new(127, 198, b, 1 + c % 250).to_string();
    let mut controller = world.start_plain(&["ur-sim", "--bind", &address].map(str::to_owned));
    until("the controller listens", || {
        controller.expect_alive();
        std::net::TcpStream::connect((address.as_str(), 30004)).ok()
    });
    let settings =
        ["--set", "loop.valid_periods=12", "--set", "safety.enable_required=true", "--set", PATIENT_LOOP];
    let _daemon = world.daemon_with(0, &settings);
    let mut bridge = world.start(0, &[&["arm", "ur", "--robot", &address], &settings[..]].concat());
    until("the arm is there", || world.status(0)["arm"]["joints_rad"][5].as_f64());
    assert_refused(&world.run(0, &["request", "arm"]), 4, &["not enabled", "foretrace enable"]);
    held_then_released(&mut world, &mut bridge);
}

/// Runs a program on a terminal of its own, types there what is appended to a file, and appends what the
/// program writes to another.
const SCRIBE: &str = "\
import os, pty, select, signal, sys, time
typed, written, program = sys.argv[1], sys.argv[2], sys.argv[3:]
child, terminal = pty.fork()
if child == 0:
    os.execv(program[0], program)
signal.signal(signal.SIGINT, lambda *_: os.kill(child, signal.SIGINT))
source, copy = open(typed, 'rb', 0), open(written, 'ab', 0)
while True:
    for key in source.read().split(b'|'):
        if key:
            os.write(terminal, key)
            time.sleep(0.03)
    if select.select([terminal], [], [], 0.03)[0]:
        try:
            copy.write(os.read(terminal, 4096))
        except OSError:
            sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
";

/// Gives a player the newest line of a file, a hundred times per second, as a pen does that is held still.
const PEN: &str = "\
import signal, subprocess, sys, time
player = subprocess.Popen(sys.argv[2:], stdin=subprocess.PIPE)
signal.signal(signal.SIGINT, lambda *_: (player.stdin.close(), sys.exit(player.wait())))
while True:
    line = open(sys.argv[1]).read().strip()
    if line:
        player.stdin.write(line.encode() + b'\\n')
        player.stdin.flush()
    time.sleep(0.01)
";

fn appended(file: &std::path::Path, text: &str) {
    use std::io::Write;
    let mut file = std::fs::OpenOptions::new().append(true).open(file).unwrap();
    file.write_all(text.as_bytes()).unwrap();
}

/// Starts `program` through a script that gets the files as arguments.
fn through(world: &mut World, script: &str, files: &[&str], program: &[&str]) -> foretrace_tests::Process {
    let files = files.iter().map(|file| {
        let path = world.file(file);
        if !path.exists() {
            std::fs::write(&path, "").unwrap();
        }
        path.display().to_string()
    });
    let words = ["python3", "-c", script].map(str::to_owned).into_iter().chain(files).collect();
    world.go_through(words);
    let process = world.start(0, program);
    world.go_through(Vec::new());
    process
}

#[test]
fn the_plane_of_a_simulated_arm_is_found_with_keys() {
    let mut world = World::with_rights_kept(PROGRAM);
    let _daemon = world.daemon(0);
    let arm = through(&mut world, SCRIBE, &["keys", "arm.txt"], &["arm", "sim", "--guide"]);
    let pen = through(&mut world, PEN, &["pen.txt"], &["play", "-"]);
    let marks =
        ["calibrate", "plane", "--json", &world.file("plane.json").display().to_string()].map(str::to_owned);
    let marks: Vec<&str> = marks.iter().map(String::as_str).collect();
    let plane = through(&mut world, SCRIBE, &["enters", "plane.txt"], &marks);
    let tip = |world: &World| {
        let at = &world.status(0)["arm"]["tool_base"];
        Some([at[0].as_f64()?, at[1].as_f64()?, at[2].as_f64()?])
    };
    let begin = until("the arm is there", || tip(&world));
    // In steps of a centimetre, a triangle and the proof; lowered by 3 mm as a whole.
    appended(&world.file("keys"), "1|3|2|-|-|-|3|");
    let mut at = [0_i32; 2];
    for (number, mark) in [[0, 0], [8, 0], [0, 8], [6, 6]].into_iter().enumerate() {
        let [x, y] = mark.map(|steps| f64::from(steps) * 1e-2);
        std::fs::write(world.file("pen.txt"), format!("{x},{y},0\n")).unwrap();
        until("the mark is asked for", || {
            let words = std::fs::read_to_string(world.file("plane.txt")).ok()?;
            words.contains(&format!("mark {}", number + 1)).then_some(())
        });
        // A touch counts only after the pen was seen lifted.
        std::thread::sleep(std::time::Duration::from_millis(500));
        std::fs::write(world.file("pen.txt"), format!("{x},{y},1\n")).unwrap();
        until("the pen's touch is taken", || {
            let words = std::fs::read_to_string(world.file("plane.txt")).ok()?;
            words.contains(&format!("mark {}: bring the tip", number + 1)).then_some(())
        });
        for (axis, (more, less)) in
            [("\u{1b}[A|", "\u{1b}[B|"), ("\u{1b}[D|", "\u{1b}[C|")].iter().enumerate()
        {
            let steps = mark[axis] - at[axis];
            let key = if steps > 0 { more } else { less };
            appended(&world.file("keys"), &key.repeat(steps.unsigned_abs() as usize));
        }
        at = mark;
        let goal = [begin[0] + x, begin[1] + y, begin[2] - 3e-3];
        until("the tip is there", || {
            let near = tip(&world)?.iter().zip(goal).all(|(a, b)| (a - b).abs() < 5e-5);
            near.then_some(())
        });
        appended(&world.file("enters"), "\n");
    }
    let output = plane.output();
    let words = std::fs::read_to_string(world.file("plane.txt")).unwrap();
    assert!(output.status.success(), "{} {words}", told(&output));
    let report = json(&world.file("plane.json"));
    let figure = |key: &str| report[key].as_f64().unwrap();
    assert!((figure("scale") - 1.0).abs() < 1e-3, "{report}");
    let origin = |axis: usize| report["origin_m"][axis].as_f64().unwrap();
    assert!((origin(2) - begin[2] + 3e-3).abs() < 1e-4, "{report}");
    assert!((report["normal"][2].as_f64().unwrap() - 1.0).abs() < 1e-4, "{report}");
    pen.end();
    arm.end();
}
