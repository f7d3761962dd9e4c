//! What other users can do: nothing with the shared memory, and only through the gateway with the pen.
//!
//! Started as root, the daemon runs as `nobody` and the stranger as another user. Without root there is only
//! one user at hand: then the modes are still checked, and the rest says that it was skipped.

use std::fs::Permissions;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use foretrace_tests::{STRANGER, World, assert_refused, json, told, until};

use crate::PROGRAM;

/// Everything of the instance that is a file: in /dev/shm, and below its folder.
fn files(world: &World) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let instance = world.instance(0);
    let segments: Vec<PathBuf> = std::fs::read_dir("/dev/shm")
        .unwrap()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(instance.prefix()))
        .map(|entry| entry.path())
        .collect();
    let mut below = vec![instance.root().to_path_buf()];
    let mut next = 0;
    while let Some(path) = below.get(next).cloned() {
        next += 1;
        if std::fs::symlink_metadata(&path).is_ok_and(|found| found.is_dir()) {
            below.extend(std::fs::read_dir(&path).into_iter().flatten().flatten().map(|entry| entry.path()));
        }
    }
    (segments, below)
}

/// A running daemon with peers of every kind, in a folder that everybody may enter.
fn inhabited(world: &World) -> [foretrace_tests::Process; 3] {
    // The folder of the test is private as well, and would hide what the instance leaves open.
    std::fs::set_permissions(world.file(""), Permissions::from_mode(0o755)).unwrap();
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let pen = world.start(0, &["play", "glyphs:Hello", "--loop"]);
    world.wait_for_mode(0, "following");
    [daemon, arm, pen]
}

#[test]
fn every_file_of_a_running_instance_is_its_user_s_alone() {
    let world = World::new(PROGRAM);
    let _crew = inhabited(&world);
    let (segments, below) = files(&world);
    let root = std::fs::metadata(world.instance(0).root()).unwrap();
    assert_eq!(root.mode() & 0o7777, 0o700, "{}", world.instance(0).root().display());
    let mut seen = 0;
    for path in &segments {
        // A connection may go between listing and looking.
        let Ok(found) = std::fs::symlink_metadata(path) else { continue };
        assert_eq!(found.uid(), root.uid(), "{}", path.display());
        assert_eq!(found.mode() & 0o077, 0, "{} has mode {:03o}", path.display(), found.mode() & 0o777);
        seen += 1;
    }
    assert!(seen > 10, "{seen} segments");
    let mut seen = 0;
    for path in &below {
        // The middleware opens a file to all in the moment in which it removes it (iceoryx2-bb-posix 0.9.3,
        // `File::drop`).
        let opened_to_go = |found: &std::fs::Metadata| found.mode() & 0o777 == 0o777;
        let mut found = std::fs::symlink_metadata(path);
        if found.as_ref().is_ok_and(opened_to_go) {
            std::thread::sleep(std::time::Duration::from_millis(200));
            found = std::fs::symlink_metadata(path);
        }
        let Ok(found) = found else { continue };
        assert_eq!(found.uid(), root.uid(), "{}", path.display());
        // Behind the folder's 0700; nothing for strangers even so.
        assert_eq!(found.mode() & 0o007, 0, "{} has mode {:03o}", path.display(), found.mode() & 0o777);
        seen += 1;
    }
    assert!(seen > 10, "{seen} files below {}", world.instance(0).root().display());
}

#[test]
fn another_user_can_open_no_segment_no_file_and_no_socket_and_cannot_attach() {
    let world = World::new(PROGRAM);
    let Some(stranger) = world.stranger() else { return };
    let _crew = inhabited(&world);
    let (segments, below) = files(&world);
    let paths: Vec<String> = segments.iter().chain(&below).map(|path| path.display().to_string()).collect();
    assert!(paths.len() > 20, "{paths:?}");
    let mut words = vec!["trespass".to_owned()];
    words.extend(paths);
    let output = stranger.start(&words).output();
    assert!(output.status.success(), "{}", told(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["user"], STRANGER, "{report}");
    assert_eq!(report["entered"], serde_json::json!([]), "{report}");
    let (denied, gone) = (report["denied"].as_u64().unwrap(), report["gone"].as_u64().unwrap());
    assert!(denied > 40, "{report}");
    // As its own user, everything is accessible: the same attempts succeed.
    let own = world.start_plain(&words).output();
    let own: serde_json::Value = serde_json::from_slice(&own.stdout).unwrap();
    assert!(
        own["entered"].as_array().unwrap().len() > 20 && own["denied"].as_u64() < Some(denied),
        "{own} {gone}"
    );

    for command in ["status", "play"] {
        let mut words: Vec<String> = vec![command.to_owned()];
        words.extend((command == "play").then(|| "glyphs:Hi".to_owned()));
        words.extend(world.instance_options(0));
        let refused = stranger.start(&words).output();
        let root = world.instance(0).root().display().to_string();
        assert_refused(&refused, 1, &[&root, "belongs to user", "run as the same user as the daemon"]);
    }
}

/// Waits until the gateway's socket is there with its final mode.
fn open(path: &Path, mode: u32) {
    until("the gateway opens", || {
        let found = std::fs::symlink_metadata(path).ok()?;
        (found.file_type().is_socket() && found.mode() & 0o777 == mode).then_some(())
    });
}

#[test]
fn an_allowed_user_s_pen_moves_the_loop_through_the_gateway_and_others_are_turned_away() {
    let world = World::new(PROGRAM);
    std::fs::set_permissions(world.file(""), Permissions::from_mode(0o755)).unwrap();
    let stranger = world.stranger();
    // Without root the only user at hand is the own one; the way through the gateway is the same.
    let sender = stranger.as_ref().map_or(world.user(), |_| STRANGER);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let path = world.file("pen.socket");
    let socket = path.display().to_string();
    let uid = sender.to_string();
    let gateway = world.start(
        0,
        &["gateway", "--socket", &socket, "--allow-uid", &uid, "--mode", "666", "--json", "gateway.json"],
    );
    open(&path, 0o666);
    let words: Vec<String> =
        ["play", "glyphs:Hello", "--gateway", &socket, "--json", "-"].map(str::to_owned).to_vec();
    let start =
        || stranger.as_ref().map_or_else(|| world.start_plain(&words), |stranger| stranger.start(&words));
    let playing = start();
    world.wait_for_mode(0, "following");
    let second = start().output();
    assert_refused(&second, 4, &["another client is connected"]);
    let played = playing.output();
    assert!(played.status.success(), "{}", told(&played));
    let said = String::from_utf8_lossy(&played.stderr);
    assert!(said.contains("closed: ended by the client;"), "{said}");
    let report: serde_json::Value = serde_json::from_slice(&played.stdout).unwrap();

    let mut turned_away = 0;
    if stranger.is_some() {
        // The daemon's own user is not on this list.
        let refused = world.start_plain(&words).output();
        assert_refused(&refused, 4, &["user not allowed", &format!("(user {})", world.user())]);
        turned_away = 1;
    }
    let ended = gateway.end();
    assert!(String::from_utf8_lossy(&ended.stdout).contains("turned away"), "{}", told(&ended));
    assert!(!path.exists());
    let tally = json(&world.file("gateway.json"));
    assert_eq!(tally["samples"]["passed"], report["samples"], "{tally}");
    assert_eq!(tally["samples"]["refused"], serde_json::json!({}), "{tally}");
    assert_eq!(tally["turned_away"]["another client is connected"], 1, "{tally}");
    assert_eq!(tally["turned_away"]["user not allowed"].as_u64().unwrap_or(0), turned_away, "{tally}");
    arm.end();
    daemon.end();
}

#[test]
fn a_gateway_outlives_its_daemon_and_refuses_a_bad_beginning_with_a_line() {
    let world = World::new(PROGRAM);
    let socket = world.file("pen.socket").display().to_string();
    let user = world.user().to_string();
    let gateway = ["gateway", "--socket", &socket, "--allow-uid", &user, "--json", "gateway.json"];
    assert_refused(&world.run(0, &gateway), 3, &["no daemon running"]);
    let daemon = world.daemon(0);
    let missing = world.file("none/pen").display().to_string();
    let refused = world.run(0, &["gateway", "--socket", &missing, "--allow-uid", &user]);
    assert_refused(&refused, 5, &["--socket", "none", "No such file", "make the folder first"]);
    let occupied = world.write("taken", "precious");
    let refused = world.run(0, &["gateway", "--socket", &occupied, "--allow-uid", &user]);
    assert_refused(&refused, 5, &["taken", "exists and is no socket"]);
    assert_eq!(std::fs::read_to_string(&occupied).unwrap(), "precious");
    for wrong in [
        &["gateway", "--socket", &socket][..],
        &["gateway", "--socket", &socket, "--allow-uid", "anna"],
        &["gateway", "--socket", &socket, "--allow-uid", "1", "--mode", "999"],
        &["gateway", "--socket", &socket, "--allow-uid", "1", "--rate", "0"],
    ] {
        assert_refused(&world.run(0, wrong), 2, &["error:"]);
    }

    let gate = world.start(0, &gateway);
    open(&world.file("pen.socket"), 0o660);
    let second = world.start(0, &gateway).output();
    assert_refused(&second, 1, &["the pen is held by the gateway", "--take-over"]);
    daemon.end();
    let daemon = world.daemon(0);
    let played = world.run_plain(&["play", "glyphs:Hi", "--gateway", &socket]);
    assert!(played.status.success(), "{}", told(&played));
    gate.end();
    let tally = json(&world.file("gateway.json"));
    assert!(tally["samples"]["passed"].as_u64() > Some(100), "{tally}");

    // A killed gateway leaves its socket; the next one takes its place, and play says what is wrong
    // meanwhile.
    let gate = world.start(0, &gateway);
    open(&world.file("pen.socket"), 0o660);
    gate.kill();
    let refused = world.run_plain(&["play", "glyphs:Hi", "--gateway", &socket]);
    assert_refused(&refused, 1, &["pen.socket", "Connection refused", "foretrace gateway"]);
    let gate = world.start(0, &gateway);
    until("the next gateway answers", || {
        world
            .run_plain(&["play", "glyphs:i", "--gateway", &socket, "--seconds", "0.1"])
            .status
            .success()
            .then_some(())
    });
    gate.end();
    daemon.end();
}

/// A file of another user under a name of the instance; removed at the end.
struct Planted(PathBuf);

impl Planted {
    fn new(world: &World) -> Self {
        let planted =
            Self(PathBuf::from(format!("/dev/shm/{}planted.connection", world.instance(0).prefix())));
        std::fs::write(&planted.0, "").unwrap();
        std::fs::set_permissions(&planted.0, Permissions::from_mode(0o666)).unwrap();
        std::os::unix::fs::chown(&planted.0, Some(STRANGER), Some(STRANGER)).unwrap();
        planted
    }
}

impl Drop for Planted {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

#[test]
fn a_segment_that_another_user_planted_keeps_the_daemon_from_starting_and_is_told_while_it_runs() {
    let world = World::new(PROGRAM);
    // Without another user the file cannot be planted.
    if world.stranger().is_none() {
        return;
    }
    let planted = Planted::new(&world);
    let refused = world.run(0, &["daemon", "--no-rights"]);
    let (name, owner) = (planted.0.display().to_string(), format!("belongs to user {STRANGER} (mode 666)"));
    assert_refused(&refused, 1, &[&name, &owner, "ask that user or root to remove it"]);
    drop(planted);

    let daemon = world.daemon(0);
    let planted = Planted::new(&world);
    // Looked at once per second; the daemon goes on.
    std::thread::sleep(std::time::Duration::from_millis(2500));
    drop(planted);
    let ended = daemon.end();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(said.matches(&owner).count(), 1, "{said}");
}
