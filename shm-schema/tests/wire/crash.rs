//! A killed daemon: peers notice and keep their memory, and a new daemon starts over its leftovers.
//!
//! The daemon is this test binary, started again with `CHILD` set. It is killed only once it is up: if killed
//! earlier, and as root, the middleware can leave an empty segment that makes others hang.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use foretrace_shm::*;

const CHILD: &str = "FORETRACE_TEST_DAEMON_ROOT";

/// Not a test of its own: the daemon's role, when started by the tests below.
#[test]
fn daemon_role() {
    let Some(root) = std::env::var_os(CHILD) else { return };
    let instance = Instance::at(0, root).unwrap();
    let mut lock = instance.lock().unwrap();
    let purge = instance.purge(&lock).unwrap();
    let session = Session::create(&instance, "daemon", &lock).unwrap();
    let services = Services::create(&session).unwrap();
    let mut commands = services.joint_cmd.publisher().unwrap();
    lock.announce().unwrap();
    // Not `eprintln!`: the harness would capture it.
    writeln!(std::io::stderr(), "up {purge:?}").unwrap();
    loop {
        let _ = commands.publish(monotonic_now_ns(), JointCommand::default());
        std::thread::sleep(Duration::from_millis(1));
    }
}

struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(instance: &Instance) -> (Killed, String) {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "crash::daemon_role", "--nocapture"])
        .env(CHILD, instance.root())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let stderr = BufReader::new(child.stderr.take().unwrap());
    let child = Killed(child);
    let up = stderr
        .lines()
        .map_while(Result::ok)
        .find(|line| line.starts_with("up "))
        .expect("the daemon did not start");
    (child, up)
}

fn wait_for<T>(mut look: impl FnMut() -> Option<T>) -> T {
    for _ in 0..3000 {
        if let Some(found) = look() {
            return found;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("waited 30 s in vain");
}

#[test]
fn a_killed_daemon_is_noticed_replaced_and_cleaned_up_after() {
    let folder = tempfile::tempdir_in("/tmp").unwrap();
    let instance = Instance::at(0, folder.path().join("i")).unwrap();
    let (first, up) = start(&instance);
    assert_eq!(up, "up Removed(0)");
    assert_eq!(instance.daemon().unwrap().pid, first.0.id());
    assert!(matches!(instance.lock(), Err(InstanceError::Held { pid: Some(_), .. })));

    let peer = Services::open(&Session::open(&instance, "peer").unwrap()).unwrap();
    let mut commands = peer.joint_cmd.subscriber(16, HeaderBounds::DEFAULT).unwrap();
    wait_for(|| commands.latest());
    drop(first);
    assert_eq!(instance.daemon(), None);
    assert!(matches!(Session::open(&instance, "late"), Err(ServiceError::NoDaemon { .. })));

    // With a living peer the next daemon takes over, and the peer receives from it without any action.
    let (second, up) = start(&instance);
    assert_eq!(up, format!("up PeersAlive([{}])", std::process::id()));
    wait_for(|| {
        commands.latest();
        (commands.restarts() == 1).then_some(())
    });
    drop((commands, peer));
    drop(second);

    // Without one, the leftovers are purged.
    assert!(instance.shared_memory().unwrap().segments > 0, "a killed daemon leaves its segments");
    let (third, up) = start(&instance);
    assert!(up.starts_with("up Removed(") && up != "up Removed(0)", "{up}");
    drop(third);
    let lock = instance.lock().unwrap();
    assert!(matches!(instance.purge(&lock).unwrap(), Purge::Removed(_)));
    assert_eq!(instance.shared_memory().unwrap().segments, 0);
}
