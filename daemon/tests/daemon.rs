//! The whole daemon, from outside: requests, refusals, reloads, second daemons, signals.

mod support;

use std::io::{BufRead as _, BufReader};
use std::process::{Command, Stdio};

use foretrace_shm::{
    ControlOp, ControlStatus, Enable, FaultReason, GhostState, HeaderBounds, Mode, Purge, Services, Session,
    monotonic_now_ns,
};
use foretraced::{DaemonError, Source};
use support::{Operator, Running, Site, arm, pen, turn, until};

#[test]
fn arming_without_an_arm_is_refused_with_what_to_do() {
    let _turn = turn();
    let site = Site::new();
    let daemon = Running::start(&site, site.source());
    let mut operator = Operator::attach(&site);
    let answer = operator.ask(ControlOp::Arm, 0.0);
    assert_eq!(answer.outcome(), ControlStatus::NoJointState);
    assert!(answer.text().contains("foretrace arm sim"), "{}", answer.text());
    let query = operator.ask(ControlOp::Query, 0.0);
    assert_eq!((query.outcome(), query.detail), (ControlStatus::Ok, u32::from(Mode::Idle)));
    let status = operator.status_when("it counts requests", |status| status.counters.requests == 2);
    assert_eq!(status.counters.requests_refused, 1);
    let report = daemon.end().unwrap();
    assert!(report.status.counters.ticks > 0);
    assert_eq!(report.status.mode, u32::from(Mode::Idle));
}

#[test]
fn operators_steer_trust_and_predictor_and_a_stop_stays_until_armed_again() {
    let _turn = turn();
    let site = Site::new();
    let daemon = Running::start(&site, site.source());
    let mut operator = Operator::attach(&site);
    let (_arm, _log) = arm(&site);
    let _pen = pen(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert_eq!(operator.ask(ControlOp::Arm, 0.0).outcome(), ControlStatus::Ok);
    assert_eq!(operator.ask(ControlOp::Arm, 0.0).outcome(), ControlStatus::WrongMode);
    operator.status_when("trust grows", |status| status.trust > 0.9);
    operator.ask(ControlOp::SetTrust, 0.25);
    operator.status_when("trust is 0.25", |status| (status.trust - 0.25).abs() < 1e-9);
    operator.ask(ControlOp::TrustAuto, 0.0);
    assert!(operator.switch_predictor("hold").is_success());
    operator.status_when("Hold has taken over", |status| status.predictor.as_str() == Some("hold"));
    // A live loop has no recording of the future.
    let oracle = operator.switch_predictor("oracle");
    assert_eq!(oracle.outcome(), ControlStatus::PredictorUnavailable, "{oracle}");
    let nobody = operator.switch_predictor("crystal-ball");
    assert_eq!(nobody.outcome(), ControlStatus::PredictorUnavailable);
    assert!(nobody.text().contains("crystal-ball") && nobody.text().contains("mixture"), "{nobody}");
    assert!(operator.ask(ControlOp::Stop, 0.0).is_success());
    let stopped = operator.status_when("it stops", |status| status.mode == u32::from(Mode::Stopped));
    assert_eq!(stopped.fault, u32::from(FaultReason::Requested));
    until("it can be armed again", || operator.ask(ControlOp::Arm, 0.0).is_success().then_some(()));
    assert!(operator.ask(ControlOp::Disarm, 0.0).is_success());
    operator.status_when("it lets go", |status| status.mode == u32::from(Mode::Idle));
    daemon.end().unwrap();
}

#[test]
fn an_order_dated_ahead_is_refused_and_counted_and_a_stop_is_obeyed() {
    let _turn = turn();
    let site = Site::new();
    let daemon = Running::start(&site, site.source());
    let mut operator = Operator::attach(&site);
    let (_arm, _log) = arm(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    for op in [ControlOp::Arm, ControlOp::MoveHome, ControlOp::FreezeTrust, ControlOp::Reload] {
        let answer = operator.ask_dated(op, monotonic_now_ns() + 5_000_000_000);
        assert_eq!(answer.outcome(), ControlStatus::Invalid, "{op}: {answer}");
        assert!(answer.text().contains("s in the future, allowed 0.100 s"), "{op}: {answer}");
    }
    operator.status_when("they are counted", |status| status.counters.requests_refused == 4);
    assert_eq!(operator.newest.mode, u32::from(Mode::Idle));
    // A clock that is a little ahead is no reason; the order counts from its arrival.
    let armed = operator.ask_dated(ControlOp::Arm, monotonic_now_ns() + 50_000_000);
    assert_eq!(armed.outcome(), ControlStatus::Ok, "{armed}");
    let stopped = operator.ask_dated(ControlOp::Stop, u64::MAX);
    assert!(stopped.is_success(), "{stopped}");
    operator.status_when("it stops", |status| status.mode == u32::from(Mode::Stopped));
    // Dated ahead of that stop, an order to arm does not outrank it.
    assert!(!operator.ask_dated(ControlOp::Arm, monotonic_now_ns() + 5_000_000_000).is_success());
    assert!(operator.ask_dated(ControlOp::Disarm, u64::MAX).is_success());
    operator.status_when("it lets go", |status| status.mode == u32::from(Mode::Idle));
    daemon.end().unwrap();
}

#[test]
fn at_trust_0_the_ghost_is_the_loop_and_with_trust_it_shows_what_is_saved() {
    let _turn = turn();
    let site = Site::new();
    // On circles the lag cannot be measured, and this arm has none.
    let source = site.source().with("trust.mode", "manual").with("timing.dead_time_ms", 0.0);
    let daemon = Running::start(&site, source);
    let mut operator = Operator::attach(&site);
    let session = Session::open(&site.instance(), "observer").unwrap();
    let services = Services::open(&session).unwrap();
    let mut telemetry = services.telemetry.subscriber(256, HeaderBounds::DEFAULT).unwrap();
    let (_arm, _log) = arm(&site);
    let _pen = pen(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert!(operator.ask(ControlOp::SetTrust, 0.0).is_success());
    assert!(operator.ask(ControlOp::Arm, 0.0).is_success());
    let (mut seen, mut settled) = (0, true);
    let status = operator.status_when("both are compared", |status| {
        telemetry.drain(|record| {
            let state = GhostState::try_from(record.ghost_state).unwrap();
            // A ghost that had to skip ticks on a busy machine is near, but no longer identical.
            settled &= state != GhostState::Settling;
            if settled && record.mode == u32::from(Mode::Following) {
                assert_eq!(record.ghost_tool_m, record.tool_m, "tick {}", record.tick);
                assert!(record.compared_ns == 0 || record.compared_ns < record.release_ns);
                seen += 1;
            }
        });
        status.compared_s > 1.0
    });
    assert!(seen > 300 || !settled, "{seen} ticks");
    let (real, ghost) = (status.tracking, status.ghost);
    assert!((real.session_rms_m / ghost.session_rms_m - 1.0).abs() < 0.1, "{real:?} {ghost:?}");
    assert!((real.session_lag_s - ghost.session_lag_s).abs() < 5e-3, "{real:?} {ghost:?}");
    assert!(status.ghost_cost_ns > 0);

    assert!(operator.ask(ControlOp::SetTrust, 1.0).is_success());
    operator.status_when("prediction saves millimetres and milliseconds", |status| {
        let (real, ghost) = (status.tracking, status.ghost);
        real.recent_rms_m < 0.8 * ghost.recent_rms_m && real.recent_lag_s < ghost.recent_lag_s - 0.005
    });
    daemon.end().unwrap();
}

#[test]
fn without_a_ghost_nothing_is_compared_and_nothing_claimed() {
    let _turn = turn();
    let site = Site::new();
    let daemon = Running::start(&site, site.source().with("telemetry.ghost", false));
    let mut operator = Operator::attach(&site);
    let (_arm, _log) = arm(&site);
    let _pen = pen(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert!(operator.ask(ControlOp::Arm, 0.0).is_success());
    let status = operator.status_when("it follows", |status| status.mode == u32::from(Mode::Following));
    assert_eq!((status.ghost_state, status.ghost_cost_ns), (u32::from(GhostState::Off), 0));
    assert!(status.tracking.session_rms_m < 0.0 && status.ghost.session_lag_s.is_nan(), "{status:?}");
    daemon.end().unwrap();
}

#[test]
fn an_arm_that_falls_silent_latches_a_stop_with_its_reason_until_it_is_back_and_armed_again() {
    let _turn = turn();
    let site = Site::new();
    let daemon = Running::start(&site, site.source());
    let mut operator = Operator::attach(&site);
    let (first, _log) = arm(&site);
    let _pen = pen(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert!(operator.ask(ControlOp::Arm, 0.0).is_success());
    operator.status_when("it follows", |status| status.mode == u32::from(Mode::Following));
    drop(first);
    let stopped = operator.status_when("it stops", |status| status.mode == u32::from(Mode::Stopped));
    assert_eq!(stopped.fault, u32::from(FaultReason::JointStateStale));
    until("the arm is missed", || {
        (operator.ask(ControlOp::Arm, 0.0).outcome() == ControlStatus::JointStateStale).then_some(())
    });
    let (_second, log) = arm(&site);
    until("it can be armed again", || operator.ask(ControlOp::Arm, 0.0).is_success().then_some(()));
    operator.status_when("it follows again", |status| status.mode == u32::from(Mode::Following));
    assert_eq!(log.illegal.load(std::sync::atomic::Ordering::Relaxed), 0);
    // Everything but the first command after arming is compared with the one before.
    assert_eq!(log.begun.load(std::sync::atomic::Ordering::Relaxed), 1);
    daemon.end().unwrap();
}

#[test]
fn a_dead_man_that_falls_silent_stops_the_arm_and_beats_that_were_overwritten_are_counted() {
    let _turn = turn();
    let site = Site::new();
    let source = site.source().with("safety.enable_required", true).with("safety.enable_timeout_ms", 500.0);
    let daemon = Running::start(&site, source);
    let mut operator = Operator::attach(&site);
    let session = Session::open(&site.instance(), "dead-man").unwrap();
    let services = Services::open(&session).unwrap();
    let mut dead_man = services.enable.publisher().unwrap();
    let mut beat = || dead_man.publish(monotonic_now_ns(), Enable::default()).map(|_| ()).unwrap();
    let (_arm, log) = arm(&site);
    let _pen = pen(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert_eq!(operator.ask(ControlOp::Arm, 0.0).outcome(), ControlStatus::NotEnabled);
    until("it is armed under a dead-man", || {
        beat();
        operator.ask(ControlOp::Arm, 0.0).is_success().then_some(())
    });
    let held = operator.status_when("it follows for as long as the dead-man beats", |status| {
        beat();
        status.mode == u32::from(Mode::Following) && status.trust > 0.5
    });
    assert_eq!(held.counters.enable_rejected, 0);
    // Far more between two ticks than shared memory holds.
    (0..2000).for_each(|_| beat());
    let stopped = operator.status_when("silence stops it", |status| status.mode == u32::from(Mode::Stopped));
    assert_eq!(stopped.fault, u32::from(FaultReason::DeadMan));
    // A tick takes four.
    let lost = stopped.counters.enable_dropped - held.counters.enable_dropped;
    assert!(lost >= 1000, "{lost} of 2000");
    assert_eq!(log.illegal.load(std::sync::atomic::Ordering::Relaxed), 0);
    daemon.end().unwrap();
}

#[test]
fn a_second_daemon_on_the_same_instance_is_refused_and_two_instances_live_side_by_side() {
    let _turn = turn();
    let (site, other) = (Site::new(), Site::new());
    let daemon = Running::start(&site, site.source());
    let refused = Running::start(&site, site.source()).end().unwrap_err();
    assert!(matches!(refused, DaemonError::Instance(_)), "{refused}");
    assert!(refused.to_string().contains(&std::process::id().to_string()), "{refused}");
    let second = Running::start(&other, other.source());
    Operator::attach(&site).status_when("the first runs", |status| status.tick > 0);
    Operator::attach(&other).status_when("the second runs", |status| status.tick > 0);
    second.end().unwrap();
    daemon.end().unwrap();
}

#[test]
fn a_reload_takes_live_settings_and_refuses_the_others() {
    let _turn = turn();
    let site = Site::new();
    std::fs::create_dir_all(&site.root).unwrap();
    std::fs::set_permissions(&site.root, std::os::unix::fs::PermissionsExt::from_mode(0o700)).unwrap();
    let file = site.root.join("settings.toml");
    let write = |body: &str| {
        let root = site.root.display();
        let head = format!("preset = \"ur5\"\n[instance]\nnumber = {}\nroot_dir = \"{root}\"\n", site.number);
        std::fs::write(&file, head + body).unwrap();
    };
    write("[predictor]\nkind = \"hold\"\n");
    let daemon = Running::start(&site, Source::file(&file));
    let mut operator = Operator::attach(&site);
    operator.status_when("it starts with Hold", |status| status.predictor.as_str() == Some("hold"));

    write("[predictor]\nkind = \"constant-velocity\"\n");
    let answer = operator.ask(ControlOp::Reload, 0.0);
    assert_eq!(answer.outcome(), ControlStatus::Ok, "{answer}");
    assert!(answer.text().contains("predictor.kind"), "{answer}");
    let wanted = Some("constant-velocity");
    let status = operator.status_when("the new one takes over", |status| status.predictor.as_str() == wanted);
    assert_eq!(status.settings_revision, 1);

    write("[predictor]\nkind = \"hold\"\n[loop]\npriority = 70\n");
    let answer = operator.ask(ControlOp::Reload, 0.0);
    assert_eq!(answer.outcome(), ControlStatus::NeedsRestart, "{answer}");
    assert!(answer.text().contains("loop.priority"), "{answer}");

    write("[predictor]\nkind = \"crystal-ball\"\n");
    let answer = operator.ask(ControlOp::Reload, 0.0);
    assert_eq!(answer.outcome(), ControlStatus::SettingsRejected, "{answer}");
    let status = operator.status_when("nothing else changed", |status| status.tick > 0);
    assert_eq!((status.predictor.as_str(), status.settings_revision), (wanted, 1));
    daemon.end().unwrap();
}

#[test]
fn a_signal_ends_the_program_cleanly_and_wrong_settings_end_it_with_a_line() {
    let _turn = turn();
    let site = Site::new();
    let program = || {
        let mut program = Command::new(env!("CARGO_BIN_EXE_foretraced"));
        program
            .args(["--no-rights", "--set", &format!("instance.root_dir=\"{}\"", site.root.display())])
            .args(["--instance", &site.number.to_string()])
            .stderr(Stdio::piped());
        program
    };
    for (option, value, code, word) in [
        ("--rate", "333", 2, "125, 250, 500 and 1000"),
        ("--set", "loop.rate_hz=333", 5, "loop.rate_hz"),
        ("--log", "a=b=", 2, "error, warn, info, debug"),
        ("--\u{9b}31m", "\u{1b}[31m", 2, "\\u009B31m"),
    ] {
        let wrong = program().args([option, value]).output().unwrap();
        let text = String::from_utf8_lossy(&wrong.stderr);
        assert_eq!(wrong.status.code(), Some(code), "{text}");
        assert!(text.contains(word) && !text.contains("panicked") && !text.contains('\u{1b}'), "{text}");
    }

    let mut child = program().spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    let instance = site.instance();
    let pid = until("the daemon comes up", || instance.daemon()).pid;
    assert_eq!(pid, child.id());
    let refused = program().output().unwrap();
    let text = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && text.contains(&format!("process {pid}")), "{text}");
    assert!(Command::new("kill").args(["-HUP", &pid.to_string()]).status().unwrap().success());
    // Another process checks them first.
    let reloaded = lines.any(|line| line.contains("settings reloaded, nothing has changed"));
    assert!(Command::new("kill").args(["-TERM", &pid.to_string()]).status().unwrap().success());
    let text: Vec<String> = lines.collect();
    let text = text.join("\n");
    assert!(child.wait().unwrap().success() && reloaded, "{text}");
    assert!(text.contains("stopping"), "{text}");
    assert_eq!(instance.daemon(), None);
    assert_eq!(instance.shared_memory().unwrap().segments, 0);
}

#[test]
fn a_process_that_checks_settings_says_what_it_read_and_ends_without_room() {
    let folder = tempfile::tempdir().unwrap();
    let [file, robot] = ["a.toml", "arm.urdf"].map(|name| folder.path().join(name));
    std::fs::write(&robot, foretrace_config::presets::robot("ur5").unwrap()).unwrap();
    std::fs::write(&file, "preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, 0.15]\n")
        .unwrap();
    let check = |memory: &str, file: &std::path::Path| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_foretraced"));
        program.args(["check-settings", memory, "file"]).arg(file).args(["0", "loop.spin_us", "0"]);
        program.output().unwrap()
    };
    let good = check("0", &file);
    let output = String::from_utf8_lossy(&good.stdout);
    assert!(good.status.success() && good.stderr.is_empty(), "{good:?}");
    // The bytes of both files, under their names.
    for part in ["foretrace settings", "a.toml", "urdf = \"arm.urdf\"", "arm.urdf", "shoulder_pan_joint"] {
        assert!(output.contains(part), "{part}: {output:.2000}");
    }
    // With too little memory it ends, whatever that does to it; the one that waits for it lives.
    let starved = check("1000000", &file);
    assert!(!starved.status.success(), "{starved:?}");
    std::fs::write(&robot, format!("<robot>{}", "<link>".repeat(60_000))).unwrap();
    let refused = check("0", &file);
    let output = String::from_utf8_lossy(&refused.stdout);
    assert!(refused.status.success() && output.contains("refused"), "{refused:?}");
    assert!(output.contains("65 elements inside each other (line 1), 64 are the most"), "{output}");
}

#[test]
fn a_killed_daemon_leaves_nothing_that_hinders_the_next() {
    let _turn = turn();
    let site = Site::new();
    let program = || {
        Command::new(env!("CARGO_BIN_EXE_foretraced"))
            .args(["--no-rights", "--set", &format!("instance.root_dir=\"{}\"", site.root.display())])
            .args(["--instance", &site.number.to_string()])
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    };
    let instance = site.instance();
    for _ in 0..3 {
        let mut child = program();
        until("the daemon comes up", || instance.daemon());
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(instance.daemon(), None);
    }
    let daemon = Running::start(&site, site.source());
    Operator::attach(&site).status_when("the next one runs", |status| status.tick > 0);
    daemon.end().unwrap();
    let lock = instance.lock().unwrap();
    assert!(matches!(instance.purge(&lock), Ok(Purge::Removed(_))));
    assert_eq!(instance.shared_memory().unwrap().segments, 0);
}

#[test]
fn peers_that_stay_find_the_restarted_daemon() {
    let _turn = turn();
    let site = Site::new();
    let daemon = Running::start(&site, site.source());
    let session = Session::open(&site.instance(), "watcher").unwrap();
    let services = Services::open(&session).unwrap();
    daemon.end().unwrap();
    let daemon = Running::start(&site, site.source());
    let mut records = services.telemetry.subscriber(64, foretrace_shm::HeaderBounds::DEFAULT).unwrap();
    until("records of the new daemon arrive", || records.latest());
    daemon.end().unwrap();
}
