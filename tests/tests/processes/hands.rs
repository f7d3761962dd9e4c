//! Ways in for a hand, as far as they go without a device: tablets, buttons, and the page in a browser.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::time::Duration;

use foretrace_tests::{Process, World, assert_refused, json, told};

use crate::PROGRAM;

/// The first line that it says, and the rest of its words to come.
fn first_line(process: &mut Process) -> (String, BufReader<std::process::ChildStdout>) {
    let mut words = BufReader::new(process.take_stdout().unwrap());
    let mut line = String::new();
    words.read_line(&mut line).unwrap();
    (line.trim().to_owned(), words)
}

fn get(at: &str, host: &str) -> String {
    let mut stream = TcpStream::connect(at).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    write!(stream, "GET / HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn tablets_and_buttons_tell_what_there_is_what_is_wrong_and_what_to_do() {
    let world = World::new(PROGRAM);
    for (command, wanted) in [
        ("tablet", ["--list", "--mm", "--clutch", "--udev-rule"]),
        ("enable", ["--list", "--device", "--button", "--take-over"]),
    ] {
        let help = world.run_plain(&[command, "--help"]);
        let text = String::from_utf8_lossy(&help.stdout).into_owned();
        assert!(help.status.success() && wanted.iter().all(|word| text.contains(word)), "{text}");
    }
    let rule = world.run_plain(&["tablet", "--udev-rule"]);
    let text = String::from_utf8_lossy(&rule.stdout).into_owned();
    for word in ["ENV{ID_INPUT_TABLET}==\"1\"", "TAG+=\"uaccess\""] {
        assert!(rule.status.success() && text.contains(word), "{text}");
    }
    let listed = world.run_plain(&["tablet", "--list"]);
    let text = told(&listed);
    // Devices, or why none can be used and what to do.
    let helps = ["/dev/input/event", "plug one in", "--udev-rule", "see that this machine has input devices"]
        .iter()
        .any(|word| text.contains(word));
    assert!(matches!(listed.status.code(), Some(0 | 1)) && helps, "{text}");
    let not_one = world.write("no-device", "");
    for (options, code, words) in [
        (&["--device", &not_one][..], 5, &["no-device", "--list"][..]),
        (&["--device", "/nowhere"], 5, &["/nowhere", "No such file"]),
        (&["--scale", "0"], 2, &["--scale"]),
        (&["--clutch", "9"], 2, &["--clutch"]),
        (&["--mm", "216"], 2, &["--mm"]),
        (&["--mirror", "z"], 2, &["--mirror"]),
    ] {
        let words_of = [&["tablet"], options].concat();
        assert_refused(&world.run(0, &words_of), code, words);
    }
}

#[test]
fn a_device_that_may_not_be_read_is_answered_with_the_rule() {
    let world = World::new(PROGRAM);
    if !world.is_unprivileged() {
        return foretrace_tests::skipped("root may read everything");
    }
    let devices = std::fs::read_dir("/dev/input").into_iter().flatten().flatten();
    let Some(device) =
        devices.map(|entry| entry.path()).find(|path| path.to_string_lossy().contains("/event"))
    else {
        return foretrace_tests::skipped("there is no /dev/input/event* here");
    };
    let forbidden = device.display().to_string();
    let daemon = world.daemon(0);
    let refused = world.run(0, &["tablet", "--device", &forbidden]);
    assert_refused(&refused, 5, &[&forbidden, "--udev-rule", "70-foretrace-tablet.rules"]);
    daemon.end();
}

#[test]
fn a_console_serves_its_page_and_a_second_one_takes_another_port() {
    let world = World::new(PROGRAM);
    assert_refused(&world.run(0, &["console", "--port=0"]), 3, &["no daemon running"]);
    let daemon = world.daemon(0);
    let report = world.file("console.json").display().to_string();
    let mut console = world.start(0, &["console", "--port=0", "--json", &report]);
    let (line, _words) = first_line(&mut console);
    let (origin, token) = line.strip_prefix("open http://").and_then(|rest| rest.split_once("/#")).unwrap();
    assert_eq!((token.len(), &origin[..10]), (32, "127.0.0.1:"));
    assert!(get(origin, origin).starts_with("HTTP/1.1 200 OK"));
    assert!(get(origin, "evil.example").starts_with("HTTP/1.1 403"));
    let port = format!("--port={}", &origin[10..]);
    let second = world.run(0, &["console", &port]);
    assert_refused(&second, 1, &[origin, "cannot listen on", "--port"]);
    console.expect_alive();
    let mut beside = world.start(0, &["console", "--port=0"]);
    let (line, _more) = first_line(&mut beside);
    assert!(line.starts_with("open http://127.0.0.1:") && !line.contains(origin), "{line}");
    beside.end();
    console.end();
    assert_eq!(json(world.file("console.json").as_path())["refused"]["foreign host"], 1);
    assert!(TcpStream::connect(origin).is_err());
    daemon.end();
}

#[test]
fn a_console_for_other_machines_keeps_its_certificate_to_its_user_and_shows_how_to_get_there() {
    let world = World::new(PROGRAM);
    for wrong in ["0.0.0.0", "127.0.0.1", "desk"] {
        assert_refused(&world.run(0, &["console", &format!("--lan={wrong}")]), 2, &["--lan", "192.168.7.2"]);
    }
    // An address for documentation is none of this machine.
    assert_refused(
        &world.run(0, &["console", "--port=0", "--lan=203.0.113.7"]),
        1,
        &["203.0.113.7", "cannot listen on", "an address of this machine"],
    );
    let daemon = world.daemon(0);
    let mut prints = Vec::new();
    for _ in 0..2 {
        let mut console = world.start(0, &["console", "--port=0", "--lan=127.0.0.2", "--seconds=2"]);
        let (line, mut words) = first_line(&mut console);
        let (origin, token) =
            line.strip_prefix("open https://").and_then(|rest| rest.split_once("/#")).unwrap();
        assert!(origin.starts_with("127.0.0.2:") && token.len() == 32, "{line}");
        let insecure = get(origin, origin);
        assert!(insecure.starts_with("HTTP/1.1 426") && insecure.contains("not secure"), "{insecure}");
        let mut rest = String::new();
        words.read_to_string(&mut rest).unwrap();
        assert!(rest.lines().filter(|line| line.contains('\u{2588}')).count() > 15, "{rest}");
        prints.extend(rest.lines().find(|line| line.starts_with("certificate ")).map(str::to_owned));
        console.end();
    }
    assert_eq!(prints.len(), 2);
    assert_eq!(prints[0].split_whitespace().nth(1), prints[1].split_whitespace().nth(1), "{prints:?}");
    let kept = world.file(".local/state/foretrace/console-certificate");
    let mode = std::fs::metadata(&kept).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode, 0o600);
    daemon.end();
}

#[test]
fn a_console_with_an_arm_of_its_own_says_how_a_tablet_reaches_it() {
    let world = World::new(PROGRAM);
    let mut console = world.start_plain(&["console", "--sim", "--port=0"].map(str::to_owned));
    let mut words = BufReader::new(console.take_stdout().unwrap());
    let mut line = String::new();
    words.read_line(&mut line).unwrap();
    assert!(line.starts_with("open http://127.0.0.1:"), "{line}");
    line.clear();
    words.read_line(&mut line).unwrap();
    let root =
        line.trim().strip_prefix("with a tablet: foretrace tablet --root ").expect("the way of a tablet");
    // What stands in for the tablet here has to reach the same daemon, and the arm is armed.
    let played = world.run_plain(&["play", "glyphs:I", "--root", root]);
    assert!(played.status.success(), "{}", told(&played));
    let status = world.run_plain(&["status", "--root", root]);
    assert!(status.status.success(), "{}", told(&status));
    console.end();
    assert!(!std::path::Path::new(root).exists());
}

#[test]
fn samples_of_a_pipe_reach_the_loop_to_the_last_line_and_lines_that_are_none_are_counted() {
    let mut world = World::with_rights_kept(PROGRAM);
    let _daemon = world.daemon(0);
    let lines: String = (0..200).map(|k| format!("{},0.001,{}\n", f64::from(k) * 1e-4, k / 100)).collect();
    world.write(
        "pen.txt",
        &format!("x_m,y_m,contact\n{lines}0.01,0.02\n0.01,0.02,7\n{}\n0.02,0.001,1", "9".repeat(300)),
    );
    let feed = "exec \"$0\" \"$@\" < pen.txt";
    world.go_through(["sh", "-c", feed].map(str::to_owned).to_vec());
    // It stays for as long as a loop may be held up.
    let patient = ["--set", "safety.latch_after_ms=2000"];
    let output = world.run(0, &["play", "-", "--json", "play.json", patient[0], patient[1]]);
    world.go_through(Vec::new());
    assert!(output.status.success(), "{}", told(&output));
    let report = json(&world.file("play.json"));
    assert_eq!((&report["samples"], &report["failed"]), (&201.into(), &3.into()), "{report}");
    assert!(told(&output).contains("line 202 of stdin is no sample"), "{}", told(&output));
    let received = || world.status(0)["pen"]["samples"].as_u64().filter(|samples| *samples == 201);
    foretrace_tests::until("all of them arrive", received);
}
