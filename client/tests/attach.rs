//! The library against a daemon's side made in the same process, over real shared memory.

use std::time::Duration;

use foretrace_client::wire::{ControlOp, ControlStatus, HeaderBounds, RejectReason, pen_flags};
use foretrace_client::{
    Attachment, Claimant, Commands, DeadManError, FeedError, Foretrace, HolderKind, Instance, JointCommand,
    PenReading, RequestError, ServiceError, Status, TickRecord, monotonic_now_ns,
};
use foretrace_shm::{InstanceLock, Message, Purge, Services, Session};

struct TestDaemon {
    services: Services,
    _session: Session,
    _lock: InstanceLock,
}

struct Rig {
    folder: tempfile::TempDir,
}

impl Rig {
    fn new() -> Self {
        Self { folder: tempfile::tempdir_in("/tmp").unwrap() }
    }

    fn instance(&self) -> Instance {
        Instance::at(5, self.folder.path().join("i")).unwrap()
    }

    fn start(&self) -> TestDaemon {
        let instance = self.instance();
        let mut lock = instance.lock().unwrap();
        instance.purge(&lock).unwrap();
        let session = Session::create(&instance, "daemon", &lock).unwrap();
        let services = Services::create(&session).unwrap();
        lock.announce().unwrap();
        TestDaemon { services, _session: session, _lock: lock }
    }

    fn attach(&self) -> Foretrace {
        Foretrace::attach_within(&self.instance(), Duration::ZERO).unwrap()
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        if self.instance().root().exists() {
            let lock = self.instance().lock().unwrap();
            let purged = self.instance().purge(&lock);
            assert!(std::thread::panicking() || matches!(purged, Ok(Purge::Removed(_))), "{purged:?}");
        }
    }
}

const SHORT: Duration = Duration::from_millis(20);

#[test]
fn attaching_without_a_daemon_says_which_instance_and_what_to_do() {
    let rig = Rig::new();
    let error = Foretrace::attach_within(&rig.instance(), SHORT).unwrap_err().to_string();
    assert!(error.starts_with("no daemon running for instance 5"), "{error}");
    assert!(error.ends_with("start it with `foretrace daemon --instance 5`"), "{error}");
}

#[test]
fn attaching_waits_for_a_daemon_that_is_starting() {
    let rig = Rig::new();
    let instance = rig.instance();
    let waiting = std::thread::spawn(move || {
        let foretrace = Foretrace::attach_within(&instance, Duration::from_secs(30)).unwrap();
        foretrace.daemon().pid
    });
    std::thread::sleep(SHORT);
    let _daemon = rig.start();
    assert_eq!(waiting.join().unwrap(), std::process::id());
}

#[test]
fn a_pen_reading_arrives_and_a_senseless_one_is_refused_here() {
    let rig = Rig::new();
    let daemon = rig.start();
    let mut pen = daemon.services.pen.subscriber(16, HeaderBounds::DEFAULT).unwrap();
    let foretrace = rig.attach();
    let mut feed = foretrace.pen_feed().unwrap();
    let reading = PenReading { device_stamp_ns: 5, x_m: 0.25, contact: true, ..Default::default() };
    assert_eq!(feed.send(reading), Ok(true));
    assert!(matches!(feed.send(PenReading { x_m: f64::NAN, ..reading }), Err(FeedError::Invalid(_))));
    let mut got = Vec::new();
    pen.drain(|sample| got.push(sample));
    assert_eq!(got.len(), 1);
    assert_eq!((got[0].device_stamp_ns, got[0].x_m, got[0].pressure), (5, 0.25, -1.0));
    assert_eq!(got[0].flags, pen_flags::CONTACT | pen_flags::IN_RANGE);
    let error = foretrace.pen_feed().unwrap_err().to_string();
    assert!(error.starts_with("the pen is held by the program attach"), "{error}");
}

/// Takes every message of a topic while `act` runs, as the daemon does in every tick.
fn received<T: Message + Send, V: Send>(
    topic: &foretrace_shm::Topic<T>,
    field: impl Fn(T) -> V + Sync,
    act: impl FnOnce(),
) -> Vec<V> {
    let over = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        let (ready, is_ready) = std::sync::mpsc::channel();
        let (field, is_over) = (&field, &over);
        let hearing = scope.spawn(move || {
            let mut subscriber = topic.subscriber(4, HeaderBounds::DEFAULT).unwrap();
            ready.send(()).unwrap();
            let mut got = Vec::new();
            loop {
                let last = is_over.load(std::sync::atomic::Ordering::Acquire);
                subscriber.drain(|message| got.push(field(message)));
                if last {
                    return got;
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        is_ready.recv().unwrap();
        act();
        std::thread::sleep(SHORT);
        over.store(true, std::sync::atomic::Ordering::Release);
        hearing.join().unwrap()
    })
}

/// Runs `give_way` until `take`, in another thread, is through.
fn while_asking<T: Send>(take: impl FnOnce() -> T + Send, mut give_way: impl FnMut()) -> T {
    std::thread::scope(|scope| {
        let taking = scope.spawn(take);
        while !taking.is_finished() {
            give_way();
            std::thread::sleep(SHORT);
        }
        taking.join().unwrap()
    })
}

#[test]
fn a_pen_that_is_asked_for_is_handed_over_and_both_are_told() {
    let rig = Rig::new();
    let _daemon = rig.start();
    let foretrace = rig.attach();
    let mut feed = foretrace.pen_feed().unwrap();
    let reading = PenReading { device_stamp_ns: 5, ..Default::default() };
    let tablet = Claimant::new(HolderKind::Tablet, "/dev/input/event7");
    let asks = || {
        let taken = rig.attach().take_pen_feed(&tablet, Duration::from_secs(5));
        taken.map(|mut feed| feed.send(PenReading { device_stamp_ns: 6, ..reading }).is_ok())
    };
    let taken = while_asking(asks, || drop(feed.handed_to().cloned()));
    assert!(taken.unwrap());
    assert_eq!(feed.handed_to().unwrap().who, tablet);
    assert_eq!((feed.send(reading), feed.sent()), (Err(FeedError::HandedOver), 0));
    // Free again: the new one has ended.
    foretrace.pen_feed().unwrap();
}

#[test]
fn a_dead_man_switch_that_is_handed_over_says_stop_first_and_is_not_for_browsers() {
    let rig = Rig::new();
    let daemon = rig.start();
    let foretrace = rig.attach();
    let pedal = Claimant::new(HolderKind::Button, "pedal");
    let mut dead_man = foretrace.dead_man_as(&pedal).unwrap();
    let browser = Claimant::new(HolderKind::Browser, "127.0.0.1");
    let refused = while_asking(
        || rig.attach().take_dead_man(&browser, Duration::from_secs(5)).map(|_| ()),
        || drop(dead_man.handed_to().cloned()),
    );
    assert!(refused.unwrap_err().to_string().contains("a browser never takes it"));
    dead_man.beat().unwrap();
    let other = Claimant::new(HolderKind::Button, "other pedal");
    let stops = received(
        &daemon.services.enable,
        |message| message.stop,
        || {
            dead_man.beat().unwrap();
            while_asking(
                || rig.attach().take_dead_man(&other, Duration::from_secs(5)).map(|_| ()),
                || drop(dead_man.handed_to().cloned()),
            )
            .unwrap();
        },
    );
    assert_eq!(dead_man.beat(), Err(DeadManError::HandedOver));
    assert_eq!(stops.last(), Some(&1), "{stops:?}");
}

#[test]
fn the_latest_command_stays_until_a_newer_one_comes() {
    let rig = Rig::new();
    let daemon = rig.start();
    let foretrace = rig.attach();
    let mut commands = foretrace.commands(4).unwrap();
    assert!(commands.latest().is_none());
    let mut publisher = daemon.services.joint_cmd.publisher().unwrap();
    for tick in 1..=3 {
        publisher.publish(monotonic_now_ns(), JointCommand { tick, ..Default::default() }).unwrap();
    }
    assert_eq!(commands.latest().unwrap().tick, 3);
    assert_eq!(commands.latest().unwrap().tick, 3);
    assert_eq!((commands.received(), commands.dropped()), (3, 0));
    publisher.publish(monotonic_now_ns(), JointCommand { q: [f64::NAN; 6], ..Default::default() }).unwrap();
    assert_eq!(commands.latest().unwrap().tick, 3);
    assert_eq!(commands.rejections().of(RejectReason::NotFinite), 1);
}

#[test]
fn no_echo_says_that_a_command_was_taken_before_it_was_sent() {
    let rig = Rig::new();
    let daemon = rig.start();
    let foretrace = rig.attach();
    let mut commands = foretrace.commands(Commands::MAX_BUFFER).unwrap();
    let over = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut publisher = daemon.services.joint_cmd.publisher().unwrap();
            while !over.load(std::sync::atomic::Ordering::Acquire) {
                publisher.publish(monotonic_now_ns(), JointCommand::default()).unwrap();
            }
        });
        let (mut early, mut sent_ns) = (0, 0);
        for round in 0..200_000 {
            if round % 2 == 0 {
                commands.drain(|command| sent_ns = command.header.stamp_ns);
            } else if let Some(command) = commands.latest() {
                sent_ns = command.header.stamp_ns;
            }
            early += u64::from(commands.echo().command_accepted_ns < sent_ns);
        }
        over.store(true, std::sync::atomic::Ordering::Release);
        assert_eq!((early, commands.received() > 0), (0, true));
    });
}

#[test]
fn telemetry_counts_what_it_was_too_slow_to_read() {
    let rig = Rig::new();
    let daemon = rig.start();
    let mut telemetry = rig.attach().telemetry().unwrap();
    let mut publisher = daemon.services.telemetry.publisher().unwrap();
    let mut run = |ticks: std::ops::RangeInclusive<u64>| {
        ticks.for_each(|tick| {
            publisher.publish(monotonic_now_ns(), TickRecord { tick, ..Default::default() }).unwrap();
        });
    };
    run(1..=1);
    assert_eq!(telemetry.drain(|_| {}), 1);
    run(2..=300);
    let mut ticks = Vec::new();
    telemetry.drain(|record| ticks.push(record.tick));
    assert_eq!(ticks, (45..=300).collect::<Vec<_>>());
    assert_eq!(telemetry.lost(), 43);
}

#[test]
fn a_refusal_carries_the_daemons_reason() {
    let rig = Rig::new();
    let daemon = rig.start();
    let mut server = daemon.services.control.server(1).unwrap();
    let foretrace = rig.attach();
    let asking = std::thread::spawn(move || {
        let mut requests = foretrace.requests();
        let long = Duration::from_secs(30);
        (requests.arm(long), requests.set_trust(0.5, long), requests.set_trust(7.0, long))
    });
    while !asking.is_finished() {
        if let Some(call) = server.take() {
            if call.request.op == u32::from(ControlOp::Arm) {
                call.answer(ControlStatus::OutsideLimits, 6.4, 2, "joint 2 is at 6.4 rad");
            } else {
                let trust = call.request.value;
                call.answer(ControlStatus::Ok, trust, 0, "");
            }
        }
        std::thread::yield_now();
    }
    let (arm, trust, senseless) = asking.join().unwrap();
    let refused = arm.unwrap_err();
    assert_eq!(refused.to_string(), "the daemon refused: outside limits: joint 2 is at 6.4 rad");
    assert_eq!(refused.refusal(), Some(ControlStatus::OutsideLimits));
    assert_eq!(trust.unwrap().value, 0.5);
    assert!(matches!(senseless, Err(RequestError::Invalid(_))));
}

#[test]
fn the_dead_man_beats_and_stops() {
    let rig = Rig::new();
    let daemon = rig.start();
    let mut enable = daemon.services.enable.subscriber(4, HeaderBounds::DEFAULT).unwrap();
    let mut dead_man = rig.attach().dead_man().unwrap();
    dead_man.beat().unwrap();
    assert_eq!(enable.latest().unwrap().stop, 0);
    dead_man.stop().unwrap();
    assert_eq!(enable.latest().unwrap().stop, 1);
}

#[test]
fn handles_live_on_when_a_new_daemon_takes_over() {
    let rig = Rig::new();
    let daemon = rig.start();
    let mut foretrace = rig.attach();
    assert_eq!(foretrace.reattach_if_needed().unwrap(), Attachment::Unchanged);
    let mut status = foretrace.status().unwrap();
    drop(daemon);
    assert!(!foretrace.daemon_is_up());
    assert!(matches!(foretrace.reattach_if_needed(), Err(ServiceError::NoDaemon { .. })));
    let daemon = rig.start();
    assert_eq!(foretrace.reattach_if_needed().unwrap(), Attachment::TakenOver);
    assert_eq!(foretrace.reattach_if_needed().unwrap(), Attachment::Unchanged);
    let mut publisher = daemon.services.status.publisher().unwrap();
    publisher.publish(monotonic_now_ns(), Status { pid: 42, ..Default::default() }).unwrap();
    assert_eq!(status.next_within(Duration::from_secs(30)).unwrap().pid, 42);
    assert!(status.age().is_some());
}

#[test]
fn recreated_services_are_noticed_and_attached_to() {
    let rig = Rig::new();
    let daemon = rig.start();
    let mut foretrace = rig.attach();
    drop(daemon);
    // Somebody removes the files under a living peer, as a cleaner of /tmp does.
    let instance = rig.instance();
    std::fs::remove_dir_all(instance.root().join("iox2")).unwrap();
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        if entry.file_name().to_string_lossy().starts_with(instance.prefix()) {
            std::fs::remove_file(entry.path()).unwrap();
        }
    }
    let daemon = rig.start();
    assert_eq!(foretrace.reattach_if_needed().unwrap(), Attachment::Renewed);
    let mut status = foretrace.status().unwrap();
    let mut publisher = daemon.services.status.publisher().unwrap();
    publisher.publish(monotonic_now_ns(), Status { pid: 43, ..Default::default() }).unwrap();
    assert_eq!(status.latest().unwrap().pid, 43);
}
