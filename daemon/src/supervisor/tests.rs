//! A fault of the daemon's own threads, which no message or other process can cause.

use std::sync::atomic::Ordering;

use foretrace_shm::{ControlOp, Mode};

use super::*;
use crate::support::{Operator, Site, arm, pen, rights, turn, until};

#[test]
fn a_panic_of_the_ipc_thread_brings_the_arm_smoothly_to_rest_and_is_the_reason_given() {
    let _turn = turn();
    let site = Site::new();
    let options = Options { rights: rights(), signals: false, ..Options::new(site.source()) };
    let instance = site.instance();
    let lock = instance.lock().unwrap();
    let (mut lock, _session, services) = open_services(&instance, lock).unwrap();
    let config = options.source.load().unwrap();
    let mut daemon =
        Daemon::start(&options, config, &instance, &services, Arc::default(), Arc::default()).unwrap();
    lock.announce().unwrap();

    let mut operator = Operator::attach(&site);
    let (_arm, log) = arm(&site);
    let _pen = pen(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert!(operator.ask(ControlOp::Arm, 0.0).is_success());
    let moving = || {
        let last = (*log.last.lock().unwrap())?;
        (last.mode == u32::from(Mode::Following) && last.qd.iter().any(|qd| qd.abs() > 0.02)).then_some(())
    };
    until("the arm moves", moving);

    daemon.ipc_orders.send(IpcOrder::Panic).unwrap();
    let mut manager = Manager::of_environment();
    let outcome = daemon.watch(&options, &instance, &mut manager);
    let error = daemon.end(outcome, &options.stop, &mut manager).unwrap_err();
    assert!(matches!(error, DaemonError::ThreadDied { name: "ipc", .. }), "{error}");
    assert!(error.to_string().contains("as the test wants it"), "{error}");

    // Not left to brake by itself: commands brought it to rest, and the loop let go.
    until("the arm is led to a stand", || {
        let last = (*log.last.lock().unwrap())?;
        (last.mode == u32::from(Mode::Idle) && last.qd == [0.0; foretrace_shm::JOINTS]).then_some(())
    });
    assert_eq!((log.illegal.load(Ordering::Relaxed), log.begun.load(Ordering::Relaxed)), (0, 1));
}
