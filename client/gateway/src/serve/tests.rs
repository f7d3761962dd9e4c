//! The gateway over real sockets, in one process: clients in the test, the gateway in a thread of its own.

use std::io::{BufRead, BufReader};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use foretrace_client::{GatewayError, GatewayFeed, PenReading, monotonic_now_ns};
use foretrace_shm::gateway::Frame;

use super::*;

struct Rig {
    folder: tempfile::TempDir,
    passed: Arc<Mutex<Vec<PenSample>>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<GatewayTally>>,
}

fn policy() -> Policy {
    Policy {
        allowed: vec![foretrace_shm::effective_user()],
        rate: 100_000,
        burst: 1000,
        frame_time: Duration::from_secs(60),
        silence: Duration::from_secs(60),
    }
}

impl Rig {
    fn new(policy: Policy) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let socket = GatewaySocket::open(&folder.path().join("pen"), 0o600, None).unwrap();
        let (passed, stop) = (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicBool::new(false)));
        let (taken, told) = (passed.clone(), stop.clone());
        let thread = std::thread::spawn(move || {
            let deliver = |sample| {
                taken.lock().unwrap().push(sample);
                Delivery::Heard
            };
            let mut gateway = Gateway::new(socket, policy, deliver, monotonic_now_ns);
            while !told.load(Ordering::Relaxed) {
                gateway.round().unwrap();
            }
            gateway.close()
        });
        Self { folder, passed, stop, thread: Some(thread) }
    }

    fn path(&self) -> std::path::PathBuf {
        self.folder.path().join("pen")
    }

    fn feed(&self) -> GatewayFeed {
        GatewayFeed::connect(self.path()).unwrap()
    }

    /// An admitted client that sends arbitrary bytes.
    fn raw(&self) -> Raw {
        let stream = UnixStream::connect(self.path()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let mut raw = Raw(BufReader::new(stream));
        assert_eq!(raw.line(), WELCOME);
        raw
    }

    fn passed(&self) -> usize {
        self.passed.lock().unwrap().len()
    }

    fn end(mut self) -> (GatewayTally, Vec<PenSample>) {
        self.stop.store(true, Ordering::Relaxed);
        let tally = self.thread.take().unwrap().join().unwrap();
        assert!(!self.path().exists(), "the socket goes with its gateway");
        let passed = std::mem::take(&mut *self.passed.lock().unwrap());
        assert_eq!(tally.samples.passed, passed.len() as u64);
        (tally, passed)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

struct Raw(BufReader<UnixStream>);

impl Raw {
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.0.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    }

    fn send(&mut self, bytes: &[u8]) {
        // The gateway may have ended the connection of some of these clients.
        let _ = self.0.get_mut().write_all(bytes);
    }
}

fn until(what: &str, mut claim: impl FnMut() -> bool) {
    let since = Instant::now();
    while !claim() {
        assert!(since.elapsed() < Duration::from_secs(20), "{what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn reading(index: u64) -> PenReading {
    PenReading {
        device_stamp_ns: monotonic_now_ns(),
        x_m: index as f64 * 1e-4,
        contact: true,
        ..Default::default()
    }
}

fn sample() -> PenSample {
    PenSample { device_stamp_ns: monotonic_now_ns(), pressure: -1.0, ..Default::default() }
}

#[test]
fn an_allowed_user_s_samples_pass_in_order_and_the_last_line_counts_them() {
    let rig = Rig::new(policy());
    let mut feed = rig.feed();
    for index in 0..300 {
        feed.send(reading(index)).unwrap();
    }
    assert_eq!(feed.sent(), 300);
    let last = feed.finish().unwrap();
    assert_eq!(last, "foretrace-gateway 1 closed: ended by the client; 300 samples passed on, 0 refused");
    let (tally, passed) = rig.end();
    assert!(passed.iter().enumerate().all(|(index, sample)| sample.x_m == index as f64 * 1e-4));
    assert!(passed.windows(2).all(|pair| pair[0].device_stamp_ns < pair[1].device_stamp_ns));
    assert_eq!((tally.clients, tally.turned_away.total(), tally.ended.of("ended by the client")), (1, 0, 1));
}

#[test]
fn a_user_that_is_not_on_the_list_is_turned_away_unread_and_counted() {
    let other = foretrace_shm::effective_user() + 1;
    let rig = Rig::new(Policy { allowed: vec![other], ..policy() });
    for _ in 0..3 {
        let error = GatewayFeed::connect(rig.path()).unwrap_err();
        assert!(matches!(error, GatewayError::Refused(_)), "{error}");
        let user = foretrace_shm::effective_user();
        assert!(error.to_string().contains(&format!("user not allowed (user {user})")), "{error}");
    }
    // Bytes sent before the answer change nothing.
    let mut eager = UnixStream::connect(rig.path()).unwrap();
    let _ = eager.write_all(&Frame(sample()).encode());
    let mut answer = String::new();
    BufReader::new(eager).read_line(&mut answer).unwrap();
    assert!(answer.contains("refused"), "{answer}");
    let (tally, passed) = rig.end();
    assert!(passed.is_empty());
    assert_eq!((tally.clients, tally.turned_away.of("user not allowed")), (0, 4));
}

#[test]
fn a_second_client_is_told_why_and_the_first_goes_on() {
    let rig = Rig::new(policy());
    let mut first = rig.feed();
    first.send(reading(0)).unwrap();
    let error = GatewayFeed::connect(rig.path()).unwrap_err().to_string();
    assert!(error.contains("another client is connected"), "{error}");
    first.send(reading(1)).unwrap();
    first.finish().unwrap();
    rig.feed().finish().unwrap();
    let (tally, passed) = rig.end();
    assert_eq!((passed.len(), tally.clients), (2, 2));
    assert_eq!(tally.turned_away.of("another client is connected"), 1);
}

#[test]
fn a_client_that_is_silent_gives_way_only_when_another_comes() {
    let rig = Rig::new(Policy { silence: Duration::from_millis(50), ..policy() });
    let mut silent = rig.raw();
    // Refused samples do not count as activity.
    std::thread::sleep(Duration::from_millis(60));
    silent.send(&Frame(PenSample { x_m: 99.0, ..sample() }).encode());
    let mut next = rig.feed();
    assert!(silent.line().contains("silent, and another client came"));
    next.send(reading(0)).unwrap();
    next.finish().unwrap();
    let (tally, _) = rig.end();
    assert_eq!(tally.ended.of("silent, and another client came"), 1);
}

#[test]
fn wrong_samples_are_refused_by_reason_and_the_connection_lives() {
    let rig = Rig::new(policy());
    let mut raw = rig.raw();
    let good = sample();
    let wrong = [
        PenSample { x_m: f64::NAN, ..good },
        PenSample { y_m: -11.0, ..good },
        PenSample { flags: 1 << 30, ..good },
        PenSample { device_stamp_ns: good.device_stamp_ns + 3_600_000_000_000, ..good },
        PenSample { device_stamp_ns: 1, ..good },
        good,
        good,
        PenSample { device_stamp_ns: good.device_stamp_ns - 1, ..good },
    ];
    for sample in wrong {
        raw.send(&Frame(sample).encode());
    }
    raw.0.get_ref().shutdown(Shutdown::Write).unwrap();
    let last = raw.line();
    assert!(last.contains("1 samples passed on, 7 refused ("), "{last}");
    let (tally, _) = rig.end();
    let reasons = [
        "not finite",
        "out of range",
        "unknown flags",
        "from the future",
        "too old",
        "replayed",
        "time backwards",
    ];
    for reason in reasons {
        assert_eq!(tally.samples.refused.of(reason), 1, "{reason}");
    }
}

#[test]
fn more_than_the_rate_is_refused_and_counted() {
    let rig = Rig::new(Policy { rate: 10, burst: 20, ..policy() });
    let since = Instant::now();
    let mut feed = rig.feed();
    for index in 0..2000 {
        feed.send(reading(index)).unwrap();
    }
    feed.finish().unwrap();
    let most = 20 + since.elapsed().as_millis() / 100 + 1;
    let (tally, passed) = rig.end();
    assert!(passed.len() >= 20 && passed.len() as u128 <= most, "{} passed, {most} may", passed.len());
    assert_eq!(tally.samples.refused.of("over the rate") + tally.samples.passed, 2000);
}

#[test]
fn garbage_ends_a_connection_with_its_reason_and_the_next_client_is_served() {
    let rig = Rig::new(policy());
    let with = |at: usize, value: u8| {
        let mut bytes = Frame(sample()).encode().to_vec();
        bytes[at] = value;
        bytes
    };
    let cases = [
        (b"GET / HTTP/1.1\r\n\r\n".to_vec(), "wrong frame length"),
        (vec![0; 4], "wrong frame length"),
        (vec![0xff; 5000], "wrong frame length"),
        (with(4, 2), "wrong protocol version"),
        (with(6, 7), "unknown kind of frame"),
        (with(13, 1), "reserved field in use"),
    ];
    for (bytes, reason) in &cases {
        let mut raw = rig.raw();
        raw.send(bytes);
        let last = raw.line();
        assert!(last.starts_with(&format!("foretrace-gateway 1 closed: {reason};")), "{last}");
    }
    let mut feed = rig.feed();
    feed.send(reading(0)).unwrap();
    feed.finish().unwrap();
    let (tally, _) = rig.end();
    assert_eq!((tally.ended.of("wrong frame length"), tally.samples.passed), (3, 1));
}

#[test]
fn clients_that_break_off_inside_a_frame_or_die_leave_room_for_the_next() {
    let rig = Rig::new(policy());
    for length in [1, 3, 4, 51] {
        let mut raw = rig.raw();
        raw.send(&Frame(sample()).encode()[..length]);
        raw.0.get_ref().shutdown(Shutdown::Write).unwrap();
        assert!(raw.line().contains("ended inside a frame"));
    }
    for _ in 0..20 {
        // Disconnected without an end, some with bytes in flight.
        let mut raw = rig.raw();
        raw.send(&Frame(sample()).encode());
        drop(raw);
        let mut knocked = Err(GatewayError::Refused(String::new()));
        until("the place is free", || {
            knocked = GatewayFeed::connect(rig.path());
            knocked.is_ok()
        });
        knocked.unwrap().finish().unwrap();
    }
    let (tally, _) = rig.end();
    assert_eq!(tally.ended.of("ended inside a frame"), 4);
    assert_eq!(tally.clients, 44);
}

/// A gateway in the hands of the test, with a client that it has let in.
fn by_hand(folder: &tempfile::TempDir, policy: Policy) -> (Gateway<impl FnMut(PenSample) -> Delivery>, Raw) {
    let path = folder.path().join("pen");
    let socket = GatewaySocket::open(&path, 0o600, None).unwrap();
    let mut gateway = Gateway::new(socket, policy, |_| Delivery::Heard, monotonic_now_ns);
    let stream = UnixStream::connect(path).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    gateway.round().unwrap();
    let mut client = Raw(BufReader::new(stream));
    assert_eq!(client.line(), WELCOME);
    (gateway, client)
}

#[test]
fn a_frame_in_two_parts_passes_once_the_second_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let (mut gateway, mut client) = by_hand(&folder, policy());
    let bytes = Frame(sample()).encode();
    for (part, pending, passed) in [(&bytes[..20], 20, 0), (&bytes[20..51], 51, 0), (&bytes[51..], 0, 1)] {
        client.send(part);
        gateway.round().unwrap();
        let frames = gateway.client.as_ref().map(|client| client.frames.pending());
        assert_eq!((frames, gateway.tally.samples.passed), (Some(pending), passed));
    }
    assert!(gateway.client.as_ref().unwrap().half_since.is_none(), "the frame is whole");
}

#[test]
fn a_frame_that_trickles_in_too_slowly_ends_the_connection() {
    let folder = tempfile::tempdir().unwrap();
    let frame_time = Duration::from_secs(10);
    let (mut gateway, mut client) = by_hand(&folder, Policy { frame_time, ..policy() });
    let begun = |gateway: &mut Gateway<_>, ago: Duration| {
        gateway.client.as_mut().unwrap().half_since = Some(Instant::now() - ago);
        gateway.round().unwrap();
        gateway.client.is_some()
    };
    client.send(&Frame(sample()).encode()[..50]);
    gateway.round().unwrap();
    // More bytes do not begin the time again.
    client.send(&[0]);
    assert!(begun(&mut gateway, frame_time / 2), "half of the time is left");
    assert!(!begun(&mut gateway, frame_time), "the time is over");
    let last = client.line();
    assert!(last.contains("too slow with a frame"), "{last}");
    let tally = gateway.close();
    assert_eq!((tally.samples.passed, tally.ended.of("too slow with a frame")), (0, 1));
}

#[test]
fn random_bytes_from_many_clients_neither_end_the_gateway_nor_pass() {
    let rig = Rig::new(policy());
    // xorshift64*: the same bytes in every run.
    let mut state = 0xfeed_u64;
    let mut dice = || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        state.wrapping_mul(0x2545_f491_4f6c_dd1d)
    };
    for round in 0..200 {
        let mut raw = rig.raw();
        let mut bytes: Vec<u8> = (0..dice() >> 54).map(|_| (dice() >> 40) as u8).collect();
        if round % 2 == 0 {
            // A good envelope, so that the fields are reached.
            bytes = Frame(sample()).encode().to_vec();
            let at = 24 + (dice() >> 33) as usize % 28;
            bytes[at..].fill(0xff);
        }
        raw.send(&bytes);
        let _ = raw.0.get_ref().shutdown(Shutdown::Write);
        assert!(raw.line().starts_with("foretrace-gateway 1 closed: "));
    }
    let mut feed = rig.feed();
    feed.send(reading(0)).unwrap();
    feed.finish().unwrap();
    let (tally, passed) = rig.end();
    assert_eq!(tally.clients, 201);
    assert!(passed.iter().all(|sample| foretrace_client::wire::Validate::validate(sample).is_ok()));
    assert!(tally.samples.refused.total() > 50, "{tally}");
}

#[test]
fn a_gateway_that_ends_says_so_to_its_client() {
    let rig = Rig::new(policy());
    let mut feed = rig.feed();
    rig.end();
    let mut ended = None;
    until("the client hears of it", || {
        ended = feed.send(reading(0)).err();
        ended.is_some()
    });
    let text = ended.unwrap().to_string();
    assert!(text.contains("the gateway ends"), "{text}");
}

#[test]
fn a_client_with_a_good_sample_now_and_then_gives_way_and_is_told_why() {
    let rig = Rig::new(Policy { silence: Duration::from_millis(300), ..policy() });
    let mut holder = rig.raw();
    std::thread::sleep(Duration::from_millis(320));
    holder.send(&Frame(sample()).encode());
    until("the sample passes", || rig.passed() == 1);
    let mut second = rig.feed();
    assert!(holder.line().contains("and another client came"));
    second.send(reading(1)).unwrap();
    until("the second client's sample passes", || rig.passed() == 2);
    second.finish().unwrap();
    assert_eq!(rig.end().0.clients, 2);
}
