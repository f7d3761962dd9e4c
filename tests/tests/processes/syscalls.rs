//! The system calls of the real-time thread while it moves an arm: it is traced, and every call counted.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use foretrace_tests::frozen::Frozen;
use foretrace_tests::{World, skipped};

use crate::PROGRAM;

/// Kills a process unless what is returned is dropped in time.
fn killed_after(time: Duration, pid: u32) -> Sender<()> {
    let (sender, dropped) = channel::<()>();
    std::thread::spawn(move || {
        if dropped.recv_timeout(time) == Err(RecvTimeoutError::Timeout) {
            let _ = std::process::Command::new("kill").args(["-9", &pid.to_string()]).status();
        }
    });
    sender
}

#[test]
fn real_time_thread_asks_the_kernel_for_nothing_but_sleep_and_its_page_faults() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let player = world.start(0, &["play", "glyphs:hello", "--loop"]);
    world.wait_for_mode(0, "following");
    // Until the last of them has connected and been warmed up to.
    std::thread::sleep(Duration::from_secs(1));
    let sent = || world.status(0)["arm"]["commands_sent"].as_u64().expect("a count");
    let before = sent();
    let Some(thread) = Frozen::thread_of(daemon.pid(), "foretrace-rt") else {
        skipped("this system does not let a process trace its child");
        return;
    };
    // A thread that made no calls at all would be waited for without end.
    let guard = killed_after(Duration::from_secs(60), daemon.pid());
    let calls = thread.system_calls(1500);
    drop((thread, guard));
    let Some(mut calls) = calls else {
        skipped("this kernel does not tell system calls");
        return;
    };
    let commands = sent() - before;
    for process in [player, arm, daemon] {
        process.end();
    }
    let mut taken = |number| calls.remove(&number).unwrap_or(0);
    // A sleep that tracing interrupts is begun again under a name of its own.
    let slept = taken(libc::SYS_clock_nanosleep);
    let restarted = taken(libc::SYS_restart_syscall);
    let faults = taken(libc::SYS_getrusage);
    println!(
        "{slept} sleeps, {restarted} of them begun again, {faults} looks at page faults; else {calls:?}"
    );
    assert!(calls.is_empty(), "system calls by number, and how often: {calls:?}");
    assert!(commands > 300, "only {commands} commands meanwhile");
    assert!(slept > 300 && faults <= slept + 1, "{slept} sleeps, {faults} looks at page faults");
}
