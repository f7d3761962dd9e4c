//! The daemon and its service manager, over the test's own NOTIFY_SOCKET: ready, alive while it ticks,
//! stopping.

mod support;
#[path = "../../tests/src/frozen.rs"]
#[allow(dead_code, unreachable_pub)]
mod frozen;

use std::io::{ErrorKind, Write as _};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use support::{Site, turn, until};

const PATIENCE: Duration = Duration::from_secs(20);

struct NotifyingDaemon {
    child: Child,
    socket: UnixDatagram,
}

impl NotifyingDaemon {
    fn new(site: &Site, socket: UnixDatagram, name: &str, watchdog_us: &str) -> Self {
        let child = Command::new(env!("CARGO_BIN_EXE_foretraced"))
            .args(["--no-rights", "--set", &format!("instance.root_dir=\"{}\"", site.root.display())])
            .args(["--instance", &site.number.to_string()])
            .env("NOTIFY_SOCKET", name)
            .env("WATCHDOG_USEC", watchdog_us)
            .env_remove("WATCHDOG_PID")
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Self { child, socket }
    }

    /// The next datagram within `patience`.
    fn receive(&self, patience: Duration) -> Option<String> {
        self.socket.set_read_timeout(Some(patience)).unwrap();
        let mut bytes = [0; 512];
        match self.socket.recv(&mut bytes) {
            Ok(count) => Some(String::from_utf8(bytes[..count].to_vec()).unwrap()),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => None,
            Err(error) => panic!("{error}"),
        }
    }

    fn expect(&self, first_line: &str) -> String {
        let message = self.receive(PATIENCE).unwrap_or_else(|| panic!("{first_line} never came"));
        assert_eq!(message.lines().next(), Some(first_line), "{message}");
        message
    }

    fn end(mut self) -> String {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
        let mut last = self.expect_after_signs_of_life();
        let status = until("it ends", || self.child.try_wait().unwrap());
        assert!(status.success(), "{status}");
        while let Some(message) = self.receive(Duration::from_millis(1)) {
            assert_eq!(message, "WATCHDOG=1", "after {last}");
            last = message;
        }
        use std::io::Read;
        let mut log = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut log).unwrap();
        log
    }

    fn expect_after_signs_of_life(&self) -> String {
        loop {
            let message = self.receive(PATIENCE).expect("it says that it stops");
            if message != "WATCHDOG=1" {
                assert_eq!(message.lines().next(), Some("STOPPING=1"), "{message}");
                return message;
            }
        }
    }
}

impl Drop for NotifyingDaemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A daemon that notifies a socket with a path, and the folder of that.
fn started_beside_a_path(site: &Site) -> (tempfile::TempDir, NotifyingDaemon) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    let daemon = NotifyingDaemon::new(site, socket, path.to_str().unwrap(), "300000");
    (folder, daemon)
}

#[test]
fn ready_then_alive_then_stopping_over_a_socket_with_a_path() {
    let _turn = turn();
    let site = Site::new();
    let (_folder, daemon) = started_beside_a_path(&site);
    let ready = daemon.expect("READY=1");
    assert!(ready.contains(&format!("\nSTATUS=instance {}, 500 Hz", site.number)), "{ready}");
    assert_eq!(
        site.instance().daemon().map(|mark| mark.pid),
        Some(daemon.child.id()),
        "ready means attachable"
    );
    let since = Instant::now();
    for _ in 0..5 {
        daemon.expect("WATCHDOG=1");
    }
    // Four waits of a third of a period lie between five signs of life.
    assert!(since.elapsed() >= Duration::from_millis(300), "{:?}", since.elapsed());
    let log = daemon.end();
    assert!(log.contains("a sign of life every 300 ms"), "{log}");
}

#[test]
fn an_abstract_socket_works_and_without_a_watchdog_nothing_but_ready_and_stopping_is_said() {
    let _turn = turn();
    let site = Site::new();
    let name = format!("foretrace-daemon-notify-{}", std::process::id());
    let socket = UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
    let daemon = NotifyingDaemon::new(&site, socket, &format!("@{name}"), "never");
    daemon.expect("READY=1");
    assert_eq!(daemon.receive(Duration::from_millis(500)), None);
    let log = daemon.end();
    assert!(log.contains("WATCHDOG_USEC is not a positive whole number"), "{log}");
}

#[test]
fn a_socket_that_cannot_be_used_is_said_and_the_daemon_runs() {
    let _turn = turn();
    let site = Site::new();
    for name in ["vsock:2:1234", "/no/such/socket"] {
        let mut daemon = NotifyingDaemon::new(&site, UnixDatagram::unbound().unwrap(), name, "300000");
        until("the daemon comes up", || site.instance().daemon());
        let pid = daemon.child.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
        assert!(until("it ends", || daemon.child.try_wait().unwrap()).success());
        use std::io::Read;
        let mut log = String::new();
        daemon.child.stderr.take().unwrap().read_to_string(&mut log).unwrap();
        assert!(log.contains(name) || log.contains("cannot be notified"), "{log}");
        assert_eq!(
            log.matches("service manager cannot be notified").count() + log.matches(name).count(),
            1,
            "{log}"
        );
    }
}

#[test]
fn a_real_time_thread_that_hangs_is_not_vouched_for() {
    let _turn = turn();
    let site = Site::new();
    let (_folder, daemon) = started_beside_a_path(&site);
    daemon.expect("READY=1");
    daemon.expect("WATCHDOG=1");
    let Some(frozen) = frozen::Frozen::thread_of(daemon.child.id(), "foretrace-rt") else {
        // Not captured by the test runner.
        let _ = writeln!(std::io::stderr(), "skipped: this system does not let a process trace its child");
        return;
    };
    // Messages that were pending when the thread froze.
    while daemon.receive(Duration::from_millis(200)).is_some() {}
    assert_eq!(daemon.receive(Duration::from_millis(900)), None, "three periods without a tick");
    drop(frozen);
    daemon.expect("WATCHDOG=1");
    daemon.end();
}
