//! A console before a daemon's side made in the same process, and the page of a browser or an attacker.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_client::wire::HeaderBounds;
use foretrace_client::{Instance, monotonic_now_ns};
use foretrace_config::Config;
use foretrace_console::{Certificate, Console, ConsoleTally, DaemonLink, Lan, Records, Renewer};
use foretrace_shm::{InstanceLock, Message, Services, Session, Topic};
use serde_json::{Value, json};
use tungstenite::{ClientRequestBuilder, Message as Packet, WebSocket};

/// The daemon's side: it takes every pen sample and every dead-man message.
pub(crate) struct Daemon {
    pub(crate) services: Services,
    _session: Session,
    _lock: InstanceLock,
}

/// Removes what the middleware keeps for the next daemon of an instance.
struct Swept(Instance);

impl Drop for Swept {
    fn drop(&mut self) {
        let _ = self.0.clean();
    }
}

pub(crate) struct Rig {
    pub(crate) instance: Instance,
    pub(crate) daemon: Daemon,
    pub(crate) at: SocketAddr,
    pub(crate) token: String,
    pub(crate) renewer: Renewer,
    /// Under TLS: what a page on another machine trusts.
    tls: Option<Arc<rustls::ClientConfig>>,
    over: Arc<AtomicBool>,
    running: Option<JoinHandle<ConsoleTally>>,
    // Dropped after everything that is in them.
    _swept: Swept,
    _folder: tempfile::TempDir,
}

impl Rig {
    pub(crate) fn start() -> Self {
        Self::open(false)
    }

    /// Under TLS, at an address that is none of its usual ones.
    pub(crate) fn start_lan() -> Self {
        Self::open(true)
    }

    fn open(is_lan: bool) -> Self {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let instance = Instance::at(6, folder.path().join("i")).unwrap();
        let mut lock = instance.lock().unwrap();
        instance.purge(&lock).unwrap();
        let session = Session::create(&instance, "daemon", &lock).unwrap();
        let services = Services::create(&session).unwrap();
        lock.announce().unwrap();
        let daemon = Daemon { services, _session: session, _lock: lock };
        let (lan, tls) = if is_lan { trusted(folder.path()) } else { (None, None) };
        let console = Console::open(0, lan, Box::new(|_| {})).unwrap();
        let (at, address, renewer) = (console.at(), console.address(), console.renewer());
        let over = Arc::new(AtomicBool::new(false));
        let link = DaemonLink {
            instance: instance.clone(),
            config: Config::preset("ur5").unwrap(),
            writer: Box::new(|text| {
                // 20 s, or a fifth of one.
                let count = if text == "long" { 4000 } else { 40 };
                Ok((0..count).map(|i| (0.005 * f64::from(i), 0.001, 0.002, true)).collect())
            }),
            remedy: Box::new(|_, _| "look at the arm".to_owned()),
            recordings: Box::new(Tape(false)),
        };
        let ends = over.clone();
        let running = std::thread::spawn(move || console.run(link, || ends.load(Ordering::Acquire)).unwrap());
        let token = address.split('#').nth(1).unwrap().to_owned();
        let (_swept, running) = (Swept(instance.clone()), Some(running));
        Self { instance, daemon, at, token, renewer, tls, over, running, _swept, _folder: folder }
    }

    pub(crate) fn end(mut self) -> ConsoleTally {
        self.over.store(true, Ordering::Release);
        self.running.take().unwrap().join().unwrap()
    }

    /// Where its pages are.
    pub(crate) fn origin(&self) -> String {
        format!("{}://{}", if self.tls.is_some() { "https" } else { "http" }, self.at)
    }

    pub(crate) fn page(&self) -> Page {
        self.page_from(&self.origin()).unwrap()
    }

    pub(crate) fn page_from(&self, origin: &str) -> Result<Page, String> {
        // The handshake may take longer than one read.
        let (line, stream) = self.line(&self.at.ip().to_string());
        let request = ClientRequestBuilder::new(format!("ws://{}/socket", self.at).parse().unwrap())
            .with_header("Origin", origin);
        let (socket, _) = tungstenite::client(request, line).map_err(|error| error.to_string())?;
        stream.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        Ok(Page(socket, Vec::new(), stream))
    }

    /// A connection, under TLS where the console is, to a server that proves to be `name`.
    pub(crate) fn line(&self, name: &str) -> (Box<dyn Line>, TcpStream) {
        let stream = TcpStream::connect(self.at).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let below = stream.try_clone().unwrap();
        let line: Box<dyn Line> = match &self.tls {
            None => Box::new(stream),
            Some(tls) => {
                let name = name.to_owned().try_into().unwrap();
                let client = rustls::ClientConnection::new(tls.clone(), name).unwrap();
                Box::new(rustls::StreamOwned::new(client, stream))
            }
        };
        (line, below)
    }

    /// A page that controls.
    pub(crate) fn controller(&self) -> Page {
        let mut page = self.page();
        page.say(json!({ "control": self.token }));
        assert_eq!(page.hears("control")["mine"], true);
        page
    }

    /// Whether the next frame says so.
    pub(crate) fn frame_says(&self, page: &mut Page, so: impl Fn(&Value) -> bool) -> bool {
        page.1.retain(|said| said["frame"].is_null());
        so(&page.hears("frame")["here"])
    }

    pub(crate) fn request(&self, text: &str) -> String {
        let (mut stream, _below) = self.line(&self.at.ip().to_string());
        let _ = stream.write_all(text.as_bytes());
        let mut answer = Vec::new();
        // A connection that is reset after its answer has said enough.
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    pub(crate) fn get(&self, path: &str) -> String {
        self.request(&format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", self.at))
    }

    /// Takes every message of a topic in a thread of its own until `act` is done.
    pub(crate) fn heard<T: Message + Send>(&self, topic: &Topic<T>, act: impl FnOnce()) -> Vec<T> {
        self.heard_counting(topic, |_| act())
    }

    /// The same; `act` gets the number of messages so far.
    pub(crate) fn heard_counting<T: Message + Send>(
        &self,
        topic: &Topic<T>,
        act: impl FnOnce(&AtomicUsize),
    ) -> Vec<T> {
        let over = AtomicBool::new(false);
        let count = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            let (ready, is_ready) = std::sync::mpsc::channel();
            let (is_over, counted) = (&over, &count);
            let hearing = scope.spawn(move || {
                let mut subscriber = topic.subscriber(T::QOS.buffer, HeaderBounds::DEFAULT).unwrap();
                ready.send(()).unwrap();
                let mut got = Vec::new();
                loop {
                    let last = is_over.load(Ordering::Acquire);
                    subscriber.drain(|message| got.push(message));
                    counted.store(got.len(), Ordering::Release);
                    if last {
                        return got;
                    }
                    std::thread::sleep(Duration::from_micros(500));
                }
            });
            is_ready.recv().unwrap();
            act(&count);
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

/// Waits until it is so, or for longer than any machine needs.
pub(crate) fn wait_until(mut is_so: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(20);
    while !is_so() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A certificate of its own for a second address of this machine, and who trusts no other.
fn trusted(folder: &std::path::Path) -> (Option<Lan>, Option<Arc<rustls::ClientConfig>>) {
    let file = folder.join("certificate");
    let names = ["127.0.0.2", "127.0.0.1", "localhost"].map(str::to_owned);
    let certificate = Certificate::kept(&file, &names, std::time::SystemTime::now()).unwrap();
    let kept = std::fs::read_to_string(&file).unwrap();
    let hex = kept.lines().find_map(|line| line.strip_prefix("certificate ")).unwrap();
    let byte = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
    let der: Vec<u8> = (0..hex.len()).step_by(2).map(byte).collect();
    let mut roots = rustls::RootCertStore::empty();
    roots.add(der.into()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let tls = rustls::ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let lan = Lan {
        addresses: vec!["127.0.0.2".parse().unwrap()],
        names: vec!["localhost".to_owned()],
        certificate,
    };
    (Some(lan), Some(Arc::new(tls)))
}

/// What a page's bytes go through.
pub(crate) trait Line: Read + Write + Send {}
impl<T: Read + Write + Send> Line for T {}

/// A recording that holds nothing.
struct Tape(bool);

impl Records for Tape {
    fn begin(&mut self) -> Result<String, String> {
        let was = std::mem::replace(&mut self.0, true);
        if was { Err("a recording is under way".to_owned()) } else { Ok("recording into here".to_owned()) }
    }

    fn end(&mut self) -> Result<String, String> {
        let was = std::mem::replace(&mut self.0, false);
        if was { Ok("the recording ends".to_owned()) } else { Err("no recording is under way".to_owned()) }
    }

    fn shown(&self) -> Value {
        json!({ "on": self.0 })
    }
}

/// A request of now, as an operator clicks it.
pub(crate) fn ask(what: Value) -> Value {
    json!({ "ask": [what, monotonic_now_ns() as f64 * 1e-3] })
}

/// A text for the writer, of now.
pub(crate) fn write(text: &str) -> Value {
    json!({ "write": [text, monotonic_now_ns() as f64 * 1e-3] })
}

/// The socket, and what came that nobody has asked for yet.
pub(crate) struct Page(pub(crate) WebSocket<Box<dyn Line>>, pub(crate) Vec<Value>, TcpStream);

impl Page {
    pub(crate) fn say(&mut self, message: Value) {
        self.0.send(Packet::text(message.to_string())).unwrap();
    }

    /// Reads wait for a moment only.
    pub(crate) fn short(&self) {
        self.2.set_read_timeout(Some(Duration::from_micros(200))).unwrap();
    }

    /// The next message of this kind.
    pub(crate) fn hears(&mut self, kind: &str) -> Value {
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
    pub(crate) fn is_let_go(&mut self) -> bool {
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

    /// Says that the button is held, or let go.
    pub(crate) fn holds(&mut self, held: bool) {
        let now_us = monotonic_now_ns() as f64 * 1e-3;
        self.say(json!({ "hold": [held, now_us] }));
    }

    /// Holds the button until it is so.
    pub(crate) fn holds_until(&mut self, mut is_so: impl FnMut() -> bool) {
        wait_until(|| {
            self.holds(true);
            std::thread::sleep(Duration::from_millis(20));
            is_so()
        });
    }

    /// Pen samples of now, `count` of them.
    pub(crate) fn writes(&mut self, count: u32) {
        let now_us = monotonic_now_ns() as f64 * 1e-3;
        let samples: Vec<Value> = (0..count)
            .map(|i| json!([now_us - 1000.0 + f64::from(i), 0.001 * f64::from(i), 0.02, 3, 0.5, 0.1, -0.1]))
            .collect();
        self.say(json!({ "pen": samples }));
    }
}
