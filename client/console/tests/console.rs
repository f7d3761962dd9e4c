//! The console from outside, as a browser and as an attacker, before a daemon's side made in the same
//! process.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_client::{
    Claimant, Enable, Foretrace, HeaderBounds, HolderKind, Instance, PenSample, monotonic_now_ns,
};
use foretrace_config::Config;
use foretrace_console::{Console, Link, Tally};
use foretrace_shm::{InstanceLock, Message, Services, Session, Topic};
use serde_json::{Value, json};
use tungstenite::{ClientRequestBuilder, Message as Packet, WebSocket};

/// The daemon's side: it takes every pen sample and every dead-man message.
struct Daemon {
    services: Services,
    _session: Session,
    _lock: InstanceLock,
}

struct Rig {
    _folder: tempfile::TempDir,
    instance: Instance,
    daemon: Daemon,
    at: SocketAddr,
    token: String,
    over: Arc<AtomicBool>,
    running: Option<JoinHandle<Tally>>,
}

impl Rig {
    fn start() -> Self {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let instance = Instance::at(6, folder.path().join("i")).unwrap();
        let mut lock = instance.lock().unwrap();
        instance.purge(&lock).unwrap();
        let session = Session::create(&instance, "daemon", &lock).unwrap();
        let services = Services::create(&session).unwrap();
        lock.announce().unwrap();
        let daemon = Daemon { services, _session: session, _lock: lock };
        let console = Console::open(0, Box::new(|_| {})).unwrap();
        let (at, address) = (console.at(), console.address());
        let over = Arc::new(AtomicBool::new(false));
        let link = Link {
            instance: instance.clone(),
            config: Config::preset("ur5").unwrap(),
            writer: Box::new(|_| Ok((0..40).map(|i| (0.005 * f64::from(i), 0.001, 0.002, true)).collect())),
            remedy: |_| "look at the arm",
        };
        let ends = over.clone();
        let running = std::thread::spawn(move || console.run(link, || ends.load(Ordering::Acquire)).unwrap());
        let token = address.split('#').nth(1).unwrap().to_owned();
        Self { _folder: folder, instance, daemon, at, token, over, running: Some(running) }
    }

    fn end(mut self) -> Tally {
        self.over.store(true, Ordering::Release);
        self.running.take().unwrap().join().unwrap()
    }

    fn page(&self) -> Page {
        self.page_from(&format!("http://{}", self.at)).unwrap()
    }

    fn page_from(&self, origin: &str) -> Result<Page, String> {
        let stream = TcpStream::connect(self.at).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let request = ClientRequestBuilder::new(format!("ws://{}/socket", self.at).parse().unwrap())
            .with_header("Origin", origin);
        // The handshake may take longer than one read.
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let (socket, _) = tungstenite::client(request, stream).map_err(|error| error.to_string())?;
        socket.get_ref().set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        Ok(Page(socket, Vec::new()))
    }

    /// A page that controls.
    fn controller(&self) -> Page {
        let mut page = self.page();
        page.say(json!({ "control": self.token }));
        assert_eq!(page.hears("control")["mine"], true);
        page
    }

    fn request(&self, text: &str) -> String {
        let mut stream = TcpStream::connect(self.at).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let _ = stream.write_all(text.as_bytes());
        let mut answer = Vec::new();
        // A connection that is reset after its answer has said enough.
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    fn get(&self, path: &str) -> String {
        self.request(&format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", self.at))
    }

    /// Takes every message of a topic in a thread of its own until `act` is done.
    fn heard<T: Message + Send>(&self, topic: &Topic<T>, act: impl FnOnce()) -> Vec<T> {
        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let (ready, is_ready) = std::sync::mpsc::channel();
            let is_over = &over;
            let hearing = scope.spawn(move || {
                let mut subscriber = topic.subscriber(T::QOS.buffer, HeaderBounds::DEFAULT).unwrap();
                ready.send(()).unwrap();
                let mut got = Vec::new();
                loop {
                    let last = is_over.load(Ordering::Acquire);
                    subscriber.drain(monotonic_now_ns(), |message| got.push(message));
                    if last {
                        return got;
                    }
                    std::thread::sleep(Duration::from_micros(500));
                }
            });
            is_ready.recv().unwrap();
            act();
            over.store(true, Ordering::Release);
            hearing.join().unwrap()
        })
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        if let Some(running) = self.running.take() {
            let _ = running.join();
        }
    }
}

/// The socket, and what came that nobody has asked for yet.
struct Page(WebSocket<TcpStream>, Vec<Value>);

impl Page {
    fn say(&mut self, message: Value) {
        self.0.send(Packet::text(message.to_string())).unwrap();
    }

    /// The next message of this kind.
    fn hears(&mut self, kind: &str) -> Value {
        if let Some(index) = self.1.iter().position(|said| !said[kind].is_null()) {
            return self.1.remove(index)[kind].clone();
        }
        let deadline = Instant::now() + Duration::from_secs(20);
        while Instant::now() < deadline {
            if let Ok(Packet::Text(text)) = self.0.read() {
                let said: Value = serde_json::from_str(text.as_str()).unwrap();
                if !said[kind].is_null() {
                    return said[kind].clone();
                }
                self.1.push(said);
            }
        }
        panic!("no {kind} came");
    }

    /// Whether the console ended the connection.
    fn is_let_go(&mut self) -> bool {
        let deadline = Instant::now() + Duration::from_secs(20);
        while Instant::now() < deadline {
            match self.0.read() {
                Ok(Packet::Close(_)) => return true,
                Err(tungstenite::Error::Io(error))
                    if matches!(
                        error.kind(),
                        std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut
                    ) => {}
                Err(_) => return true,
                Ok(_) => {}
            }
        }
        false
    }

    /// Pen samples of now, `count` of them.
    fn writes(&mut self, count: u32) {
        let now_us = monotonic_now_ns() as f64 * 1e-3;
        let samples: Vec<Value> = (0..count)
            .map(|i| json!([now_us - 1000.0 + f64::from(i), 0.001 * f64::from(i), 0.02, 3, 0.5, 0.1, -0.1]))
            .collect();
        self.say(json!({ "pen": samples }));
    }
}

#[test]
fn the_page_is_served_to_this_machine_and_to_no_other_name() {
    let rig = Rig::start();
    let page = rig.get("/");
    assert!(page.starts_with("HTTP/1.1 200 OK") && page.contains("<title>foretrace</title>"), "{page:.300}");
    assert!(!page.contains(&rig.token));
    assert!(rig.get("/three.js").len() > 100_000);
    assert!(rig.get("/../../etc/passwd").starts_with("HTTP/1.1 404"));
    let foreign = rig.request("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n");
    assert!(foreign.starts_with("HTTP/1.1 403") && foreign.contains("foreign host"), "{foreign}");
    let posted = rig.request(&format!("POST / HTTP/1.1\r\nHost: {}\r\n\r\n", rig.at));
    assert!(posted.starts_with("HTTP/1.1 405"), "{posted}");
    for origin in ["http://evil.example", "null", "https://localhost"] {
        assert!(rig.page_from(origin).is_err(), "{origin}");
    }
    let tally = rig.end();
    assert_eq!((tally.refused["foreign host"], tally.refused["foreign origin"]), (1, 3));
}

#[test]
fn a_page_that_controls_writes_and_every_sample_arrives_in_order() {
    let rig = Rig::start();
    let mut page = rig.controller();
    assert!(page.hears("scene")["radii"].as_array().unwrap().len() > 3);
    let got = rig.heard(&rig.daemon.services.pen, || {
        for _ in 0..10 {
            page.writes(12);
            std::thread::sleep(Duration::from_millis(15));
        }
        std::thread::sleep(Duration::from_millis(100));
    });
    assert_eq!(got.len(), 120);
    assert!(got.windows(2).all(|pair| pair[0].device_stamp_ns < pair[1].device_stamp_ns));
    let expected = |index: usize| 0.001 * (index % 12) as f64;
    assert!(got.iter().enumerate().all(|(index, sample)| (sample.x_m - expected(index)).abs() < 1e-12));
    assert!(got.iter().all(|sample| sample.contact() && sample.pressure == 0.5));
    let holder = rig.instance.holder(foretrace_client::Place::Pen).unwrap();
    assert_eq!(holder.who.kind(), HolderKind::Browser);
    drop(page);
    assert_eq!(rig.end().samples, 120);
}

#[test]
fn without_the_token_nothing_moves_and_all_that_was_tried_is_counted() {
    let rig = Rig::start();
    let mut page = rig.page();
    page.say(json!({ "control": "0123456789abcdef0123456789abcdef" }));
    let told = page.hears("control");
    assert!(told["mine"] == false && told["refused"].as_str().unwrap().contains("token is wrong"), "{told}");
    let pens = rig.heard(&rig.daemon.services.pen, || {
        let held = rig.heard(&rig.daemon.services.enable, || {
            page.writes(5);
            page.say(json!({ "hold": true }));
            for message in [json!({"ask": {"arm": true}}), json!({"write": "Hi"}), json!({"take_pen": true})]
            {
                page.say(message);
                let told = page.hears("reply");
                assert!(
                    told["done"] == false && told["words"].as_str().unwrap().contains("only watches"),
                    "{told}"
                );
            }
            std::thread::sleep(Duration::from_millis(200));
        });
        assert!(held.is_empty());
    });
    assert!(pens.is_empty());
    assert_eq!(rig.instance.holder(foretrace_client::Place::Pen), None);
    let tally = rig.end();
    assert_eq!((tally.refused["wrong token"], tally.refused["without control"]), (1, 5));
    assert_eq!(tally.samples, 0);
}

#[test]
fn one_page_controls_at_a_time_and_the_next_one_when_it_is_gone() {
    let rig = Rig::start();
    let first = rig.controller();
    let mut second = rig.page();
    second.say(json!({ "control": rig.token }));
    let told = second.hears("control");
    assert!(told["refused"].as_str().unwrap().contains("controls: give the control back"), "{told}");
    drop(first);
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        second.say(json!({ "control": rig.token }));
        if second.hears("control")["mine"] == true {
            break;
        }
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The dead-man messages while `act` runs.
fn dead_man(rig: &Rig, act: impl FnOnce()) -> Vec<u32> {
    let got: Vec<Enable> = rig.heard(&rig.daemon.services.enable, act);
    got.into_iter().map(|message| message.stop).collect()
}

#[test]
fn a_held_button_beats_and_silence_or_a_lost_page_lets_it_go() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let told = dead_man(&rig, || {
        for _ in 0..10 {
            page.say(json!({ "hold": true }));
            std::thread::sleep(Duration::from_millis(40));
        }
        // Says nothing more, as a page that hangs.
        std::thread::sleep(Duration::from_millis(400));
    });
    assert!(told.iter().filter(|stop| **stop == 0).count() >= 10, "{told:?}");
    assert_eq!((told.last(), told.iter().filter(|stop| **stop == 1).count()), (Some(&1), 1), "{told:?}");
    let told = dead_man(&rig, || {
        for _ in 0..5 {
            page.say(json!({ "hold": true }));
            std::thread::sleep(Duration::from_millis(40));
        }
        drop(page);
        std::thread::sleep(Duration::from_millis(400));
    });
    assert_eq!(told.last(), Some(&1), "{told:?}");
}

#[test]
fn a_browser_displaces_no_hardware_enabling_device() {
    let rig = Rig::start();
    let foretrace = Foretrace::attach_within(&rig.instance, Duration::ZERO).unwrap();
    let pedal = Claimant::new(HolderKind::Button, "foot pedal");
    let mut dead_man = foretrace.dead_man_as(&pedal).unwrap();
    let mut page = rig.controller();
    for _ in 0..20 {
        page.say(json!({ "hold": true }));
        dead_man.beat().unwrap();
        std::thread::sleep(Duration::from_millis(40));
    }
    assert!(dead_man.handed_to().is_none());
    let said = |frame: &Value| {
        frame["here"]["hold_note"].as_str().is_some_and(|note| note.contains("held by the button foot pedal"))
    };
    assert!((0..100).any(|_| said(&page.hears("frame"))));
}

#[test]
fn the_pen_of_a_tablet_is_taken_over_only_when_a_person_asks_for_it() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let instance = rig.instance.clone();
    let over = Arc::new(AtomicBool::new(false));
    let ends = over.clone();
    let (has_it, it_has) = std::sync::mpsc::channel();
    let tablet = std::thread::spawn(move || {
        let foretrace = Foretrace::attach_within(&instance, Duration::ZERO).unwrap();
        let mut feed = foretrace.pen_feed_as(&Claimant::new(HolderKind::Tablet, "event7")).unwrap();
        has_it.send(()).unwrap();
        while feed.handed_to().is_none() && !ends.load(Ordering::Acquire) {
            std::thread::sleep(Duration::from_millis(5));
        }
        feed.handed_to().map(|to| to.who.kind())
    });
    it_has.recv().unwrap();
    page.writes(3);
    std::thread::sleep(Duration::from_millis(300));
    assert!(!tablet.is_finished());
    page.say(json!({ "take_pen": true }));
    let told = page.hears("reply");
    over.store(true, Ordering::Release);
    assert!(told["done"] == true, "{told}");
    assert_eq!(tablet.join().unwrap(), Some(HolderKind::Browser));
}

#[test]
fn the_built_in_writer_writes_by_itself() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let got: Vec<PenSample> = rig.heard(&rig.daemon.services.pen, || {
        page.say(json!({ "write": "Hi" }));
        assert_eq!(page.hears("reply")["done"], true);
        std::thread::sleep(Duration::from_millis(600));
    });
    assert_eq!(got.len(), 40);
}

#[test]
fn a_message_of_a_megabyte_and_a_flood_end_the_page_that_sent_them() {
    let rig = Rig::start();
    let mut page = rig.page();
    // The console ends the connection while the rest is still being sent.
    let _ = page.0.send(Packet::text("x".repeat(1 << 20)));
    assert!(page.is_let_go());
    let mut flood = rig.page();
    for _ in 0..20_000 {
        if flood.0.send(Packet::text("{\"ping\":1}")).is_err() {
            break;
        }
    }
    assert!(flood.is_let_go());
    let mut odd = rig.page();
    odd.0.send(Packet::binary(vec![0_u8; 16])).unwrap();
    odd.say(json!({ "ping": 1.0 }));
    assert_eq!(odd.hears("pong")[0], 1.0);
    let tally = rig.end();
    assert_eq!(
        (
            tally.refused["message too long"],
            tally.refused["too many messages"],
            tally.refused["binary message"]
        ),
        (1, 1, 1)
    );
}

#[test]
fn a_thousand_connections_are_bounded_and_a_page_is_served_afterwards() {
    let rig = Rig::start();
    let mut open = Vec::new();
    for _ in 0..1000 {
        // The system may refuse some by itself.
        open.extend(TcpStream::connect_timeout(&rig.at, Duration::from_secs(5)));
    }
    assert!(open.len() > 900, "{}", open.len());
    drop(open);
    let deadline = Instant::now() + Duration::from_secs(20);
    while !rig.get("/").starts_with("HTTP/1.1 200") {
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(rig.end().refused["too many connections"] > 500);
}

#[test]
fn a_page_that_never_reads_costs_only_itself() {
    let rig = Rig::start();
    let deaf = rig.page();
    let mut page = rig.controller();
    let begin = Instant::now();
    let mut slowest = Duration::ZERO;
    while begin.elapsed() < Duration::from_secs(2) {
        let sent = Instant::now();
        page.say(json!({ "ping": 1.0 }));
        page.hears("pong");
        slowest = slowest.max(sent.elapsed());
        std::thread::sleep(Duration::from_millis(5));
    }
    // A page that waited for the deaf one would wait for seconds.
    assert!(slowest < Duration::from_secs(1), "{slowest:?}");
    drop(deaf);
    rig.end();
}
