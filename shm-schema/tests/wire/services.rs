//! Services over real shared memory, both sides in one process: create, open, verify, refuse, send, ask.

use std::time::Duration;

use foretrace_shm::*;

/// A separate instance per test, with the daemon's side open; removed completely when dropped.
struct Rig {
    services: Option<(Session, Services)>,
    lock: Option<InstanceLock>,
    instance: Instance,
    folder: tempfile::TempDir,
}

impl Rig {
    fn bare() -> Self {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let instance = Instance::at(0, folder.path().join("i")).unwrap();
        Self { services: None, lock: None, instance, folder }
    }

    fn with_daemon() -> Self {
        let mut rig = Self::bare();
        let mut lock = rig.instance.lock().unwrap();
        assert_eq!(rig.instance.purge(&lock).unwrap(), Purge::Removed(0));
        let session = Session::create(&rig.instance, "daemon", &lock).unwrap();
        let services = Services::create(&session).unwrap();
        lock.announce().unwrap();
        rig.services = Some((session, services));
        rig.lock = Some(lock);
        rig
    }

    fn daemon(&self) -> &Services {
        &self.services.as_ref().unwrap().1
    }

    fn peer(&self) -> Services {
        Services::open(&Session::open(&self.instance, "peer").unwrap()).unwrap()
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.services = None;
        self.lock = None;
        if self.instance.root().exists() {
            let lock = self.instance.lock().unwrap();
            let purged = self.instance.purge(&lock);
            if !std::thread::panicking() {
                assert!(matches!(purged, Ok(Purge::Removed(_))), "{purged:?}");
            }
        }
        let _ = self.folder.path();
    }
}

fn now() -> u64 {
    monotonic_now_ns()
}

#[test]
fn without_a_daemon_the_error_says_how_to_start_one() {
    let rig = Rig::bare();
    let error = Session::open(&rig.instance, "peer").unwrap_err();
    assert!(matches!(error, ServiceError::NoDaemon { number: 0, .. }));
    assert!(error.to_string().contains("start it with `foretrace daemon`"), "{error}");
    assert!(!rig.instance.root().exists(), "looking for a daemon must leave no trace");
}

#[test]
fn every_topic_carries_its_message_unchanged() {
    fn round<T: Message>(from: &Topic<T>, to: &Topic<T>, message: T) {
        let mut subscriber = to.subscriber(4.min(T::QOS.buffer), HeaderBounds::DEFAULT).unwrap();
        let mut publisher = from.publisher().unwrap();
        let stamp = now();
        assert_eq!(publisher.publish(stamp, message), Ok(1), "{}", T::SERVICE);
        let got = subscriber.take().unwrap().unwrap();
        assert_eq!(*got.header(), Header { sequence: 1, stamp_ns: stamp, boot_id: host_boot_id() });
        let mut expected = message;
        *expected.header_mut() = *got.header();
        assert_eq!(got, expected);
        assert_eq!(subscriber.take(), None);
        assert_eq!(subscriber.received(), 1);
    }
    let rig = Rig::with_daemon();
    let (ours, theirs) = (rig.daemon(), rig.peer());
    round(&theirs.pen, &ours.pen, PenSample { x_m: 0.1, flags: pen_flags::CONTACT, ..Default::default() });
    round(&ours.joint_cmd, &theirs.joint_cmd, JointCommand { q: [1.0; 6], tick: 9, ..Default::default() });
    round(&theirs.joint_state, &ours.joint_state, JointState { qd: [-1.0; 6], ..Default::default() });
    round(&ours.telemetry, &theirs.telemetry, TickRecord { trust: 0.5, ..Default::default() });
    round(&ours.status, &theirs.status, Status { pid: 7, ..Default::default() });
    round(&theirs.enable, &ours.enable, Enable { stop: 1, ..Default::default() });
    round(&ours.inputs, &theirs.inputs, TickInput { tick: 5, parts: 1, ..Default::default() });
    round(&ours.pieces, &theirs.pieces, Piece::of(PieceKind::Weights, 3, 9, b"abc", 1, 0));
}

#[test]
fn a_late_subscriber_still_gets_the_last_status() {
    let rig = Rig::with_daemon();
    let mut publisher = rig.daemon().status.publisher().unwrap();
    publisher.publish(now(), Status { tick: 1, ..Default::default() }).unwrap();
    let mut subscriber = rig.peer().status.subscriber(4, HeaderBounds::DEFAULT).unwrap();
    publisher.connect().unwrap();
    assert_eq!(subscriber.latest().unwrap().tick, 1);
}

#[test]
fn overflow_drops_the_oldest_and_is_counted() {
    let rig = Rig::with_daemon();
    let mut subscriber = rig.daemon().pen.subscriber(16, HeaderBounds::DEFAULT).unwrap();
    let mut publisher = rig.peer().pen.publisher().unwrap();
    let send = |publisher: &mut Publisher<PenSample>| publisher.publish(now(), PenSample::default()).unwrap();
    send(&mut publisher);
    assert_eq!(subscriber.drain(|_| {}), 1);
    (0..40).for_each(|_| {
        send(&mut publisher);
    });
    let mut sequences = Vec::new();
    subscriber.drain(|sample| sequences.push(sample.header.sequence));
    assert_eq!(sequences, (26..=41).collect::<Vec<_>>());
    assert_eq!(subscriber.dropped(), 24);
}

#[test]
fn refused_messages_are_counted_by_reason_and_do_not_look_dropped() {
    let rig = Rig::with_daemon();
    let mut subscriber = rig.daemon().pen.subscriber(16, HeaderBounds::DEFAULT).unwrap();
    let mut publisher = rig.peer().pen.publisher().unwrap();
    let bad = [
        PenSample { x_m: f64::NAN, ..Default::default() },
        PenSample { y_m: 1e9, ..Default::default() },
        PenSample { flags: 1 << 31, ..Default::default() },
    ];
    for sample in bad {
        publisher.publish(now(), sample).unwrap();
    }
    publisher.publish(now() + 1_000_000_000, PenSample::default()).unwrap();
    publisher.publish(now(), PenSample { x_m: 0.5, ..Default::default() }).unwrap();
    assert_eq!(subscriber.latest().unwrap().x_m, 0.5);
    let rejections = subscriber.rejections();
    for reason in [
        RejectReason::NotFinite,
        RejectReason::OutOfRange,
        RejectReason::UnknownFlags,
        RejectReason::FromTheFuture,
    ] {
        assert_eq!(rejections.of(reason), 1, "{reason}");
    }
    // Only the one from the future, whose header was rejected, leaves a gap.
    assert_eq!((rejections.total(), subscriber.dropped(), subscriber.received()), (4, 1, 1));
}

#[test]
fn a_second_publisher_and_a_fifth_subscriber_find_no_slot() {
    let rig = Rig::with_daemon();
    let peer = rig.peer();
    let _first = peer.pen.publisher().unwrap();
    let error = peer.pen.publisher().unwrap_err();
    assert!(matches!(error, ServiceError::NoSlot { what: "publisher", limit: 1, .. }), "{error}");
    let _four: Vec<_> =
        (0..4).map(|_| rig.daemon().pen.subscriber(1, HeaderBounds::DEFAULT).unwrap()).collect();
    let error = rig.daemon().pen.subscriber(1, HeaderBounds::DEFAULT).unwrap_err();
    assert!(matches!(error, ServiceError::NoSlot { what: "subscriber", limit: 4, .. }), "{error}");
    let own = format!("(process {})", std::process::id());
    assert_eq!(error.to_string().matches(&own).count(), 4, "who holds them is named: {error}");
    let error = peer.joint_cmd.subscriber(257, HeaderBounds::DEFAULT).unwrap_err();
    assert!(matches!(error, ServiceError::BufferSize { asked: 257, limit: 256, .. }), "{error}");
}

#[test]
fn a_restarted_daemon_takes_over_what_living_peers_kept() {
    let mut rig = Rig::with_daemon();
    let peer = rig.peer();
    let mut subscriber = peer.joint_cmd.subscriber(4, HeaderBounds::DEFAULT).unwrap();
    let mut publisher = rig.daemon().joint_cmd.publisher().unwrap();
    for _ in 0..3 {
        publisher.publish(now(), JointCommand::default()).unwrap();
    }
    assert_eq!(subscriber.drain(|_| {}), 3);
    drop(publisher);
    rig.services = None;
    rig.lock = None;
    assert!(matches!(Session::open(&rig.instance, "late"), Err(ServiceError::NoDaemon { .. })));

    let mut lock = rig.instance.lock().unwrap();
    assert_eq!(rig.instance.purge(&lock).unwrap(), Purge::PeersAlive(vec![std::process::id()]));
    let session = Session::create(&rig.instance, "daemon", &lock).unwrap();
    let services = Services::create(&session).unwrap();
    lock.announce().unwrap();
    let mut publisher = services.joint_cmd.publisher().unwrap();
    publisher.publish(now(), JointCommand::default()).unwrap();
    assert_eq!(subscriber.drain(|_| {}), 1);
    assert_eq!(subscriber.restarts(), 1);
    drop((subscriber, peer, publisher));
    rig.services = Some((session, services));
    rig.lock = Some(lock);
}

#[test]
fn two_instances_side_by_side_do_not_hear_each_other() {
    let (a, b) = (Rig::with_daemon(), Rig::with_daemon());
    let mut in_b = b.daemon().pen.subscriber(4, HeaderBounds::DEFAULT).unwrap();
    let mut in_a = a.daemon().pen.subscriber(4, HeaderBounds::DEFAULT).unwrap();
    let mut publisher = a.peer().pen.publisher().unwrap();
    publisher.publish(now(), PenSample::default()).unwrap();
    assert!(in_a.take().is_some() && in_b.take().is_none());
}

#[test]
fn a_request_is_answered_with_its_token_and_text() {
    let rig = Rig::with_daemon();
    let topic = rig.peer().control;
    let asking = std::thread::spawn(move || {
        let mut client = topic.client().unwrap();
        let mut answers = Vec::new();
        for (op, value) in [(ControlOp::Arm, 0.0), (ControlOp::SetTrust, 2.0), (ControlOp::SetTrust, 0.25)] {
            let request = ControlRequest { value, ..ControlRequest::new(0, 0, op) };
            answers.push(client.ask(request, Duration::from_secs(20)).unwrap());
        }
        answers
    });
    let mut server = rig.daemon().control.server(99).unwrap();
    while !asking.is_finished() {
        if let Some(call) = server.take() {
            match ControlOp::try_from(call.request.op).unwrap() {
                ControlOp::Arm => {
                    call.answer(ControlStatus::NoJointState, 0.0, 3, "no joint state has arrived")
                }
                _ => {
                    let value = call.request.value;
                    call.answer(ControlStatus::Ok, value, 0, "")
                }
            };
        }
        std::thread::yield_now();
    }
    let answers = asking.join().unwrap();
    assert_eq!(answers[0].to_string(), "no joint state: no joint state has arrived");
    assert_eq!((answers[0].detail, answers[0].daemon_id, answers[0].boot_id), (3, 99, host_boot_id()));
    assert_eq!(answers[1].outcome(), ControlStatus::Invalid);
    assert!(answers[2].is_success() && answers[2].value == 0.25);
    assert_eq!(server.rejections().of(RejectReason::OutOfRange), 1);
}

#[test]
fn asking_a_silent_or_absent_server_ends() {
    let rig = Rig::with_daemon();
    let mut client = rig.peer().control.client().unwrap();
    let query = ControlRequest::new(0, 0, ControlOp::Query);
    let wait = Duration::from_millis(20);
    assert_eq!(client.ask(query, wait), Err(AskError::NoServer));
    let server = rig.daemon().control.server(1).unwrap();
    assert_eq!(client.ask(query, wait), Err(AskError::Timeout(wait)));
    drop(server);
    assert_eq!(client.ask(query, wait), Err(AskError::NoServer));
}

#[test]
fn the_whole_instance_fits_its_memory_limit() {
    let rig = Rig::with_daemon();
    fn full<T: Message>(topic: &Topic<T>) -> (Vec<Publisher<T>>, Vec<Subscriber<T>>) {
        let subscribers = (0..T::QOS.subscribers)
            .map(|_| topic.subscriber(T::QOS.buffer, HeaderBounds::DEFAULT).unwrap())
            .collect();
        let mut publisher = topic.publisher().unwrap();
        publisher.publish(now(), T::ZERO).unwrap();
        (vec![publisher], subscribers)
    }
    let s = rig.daemon();
    let ports = (
        full(&s.pen),
        full(&s.joint_cmd),
        full(&s.joint_state),
        full(&s.telemetry),
        full(&s.status),
        full(&s.enable),
        full(&s.inputs),
        full(&s.pieces),
    );
    let _server = s.control.server(1).unwrap();
    let mut clients: Vec<_> = (0..CONTROL_CLIENTS).map(|_| s.control.client().unwrap()).collect();
    for client in &mut clients {
        let _ = client.ask(ControlRequest::new(0, 0, ControlOp::Query), Duration::ZERO);
    }
    let memory = rig.instance.shared_memory().unwrap();
    println!("{memory:?}");
    assert!(memory.bytes > 1 << 20, "the measurement found nothing");
    assert!(memory.bytes <= SHARED_MEMORY_LIMIT_BYTES, "{} bytes", memory.bytes);
    drop(ports);
}

#[test]
fn clients_that_come_and_go_leave_room_for_more_than_the_middleware_keeps_of_the_departed() {
    let rig = Rig::with_daemon();
    let mut server = rig.daemon().control.server(1).unwrap();
    // 0.9.3 keeps up to 128 departed clients beside the four living ones.
    for round in 0..150 {
        let peer = rig.peer();
        let asking = std::thread::spawn(move || {
            let mut client = peer.control.client().unwrap();
            client.ask(ControlRequest::new(0, 0, ControlOp::Query), Duration::from_secs(30))
        });
        let call = loop {
            if let Some(call) = server.take() {
                break call;
            }
            std::thread::sleep(Duration::from_millis(1));
        };
        assert!(call.answer(ControlStatus::Ok, 0.0, round, ""));
        assert_eq!(asking.join().unwrap().unwrap().detail, round);
    }
}

#[test]
fn of_requests_that_nobody_waits_for_any_more_only_stops_are_carried_out() {
    for (op, carried_out) in [
        (ControlOp::Arm, false),
        (ControlOp::SetTrust, false),
        (ControlOp::Stop, true),
        (ControlOp::Disarm, true),
    ] {
        let rig = Rig::with_daemon();
        let mut server = rig.daemon().control.server(1).unwrap();
        let peer = rig.peer();
        let mut client = peer.control.client().unwrap();
        let asked = client.ask(ControlRequest::new(0, 0, op), Duration::from_millis(20));
        assert!(asked.is_err(), "{asked:?}");
        let taken = server.take().map(|call| call.request.op);
        assert_eq!(taken, carried_out.then(|| u32::from(op)), "{op:?}");
    }
}
