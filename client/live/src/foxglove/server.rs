//! The listener: lets viewers in, one thread each, and feeds their queues from a source.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use foretrace_client::{FaultReason, Instance, Mode, Status, TickRecord, monotonic_now_ns};
use foretrace_serve::guard::Token;
use foretrace_serve::http::{self, Head};
use foretrace_serve::metered::Metered;
use foretrace_serve::peers::{Limits, Peers, Slot};

use super::guard::{Admitted, Door};
use super::hub::{Data, Hub, Parameters, Tally};
use super::orders::Orders;
use super::protocol::{self, CHANNELS, Level};
use super::settings::Settings;
use super::viewer::Viewer;
use crate::LiveError;
use crate::recorder::unix_minus_monotonic;
use crate::source::{Heard, News, Source, Wants};
use foretrace_record::scene::{Preview, Scene};
use foretrace_record::topics::{Topic, frames, log, tick, warning};

/// Most bytes of a viewer per second: far more than one says.
const BYTES: usize = 4 << 20;
/// Viewers at a time, and those that ask to be one.
const LIMITS: Limits = Limits { all: 16, remote: 16, of_one: 16, local: 16 };
/// Between two looks at what has come.
const NAP: Duration = Duration::from_millis(2);
/// Longest wait for bytes of a request, and for a refusal to be taken.
const WAIT: Duration = Duration::from_millis(200);

/// What a server does.
#[derive(Debug, Clone)]
pub struct Options {
    /// Where to listen; port 0: a free one.
    pub listen: SocketAddr,
    /// Origins of pages that may come in, beside those of the viewers.
    pub origins: Vec<String>,
}

/// Why there is no server.
#[derive(thiserror::Error)]
pub enum FoxgloveError {
    /// Nobody can listen there.
    #[error("cannot listen on {at}: {source}; give another --listen")]
    Taken {
        /// The address.
        at: SocketAddr,
        /// The system's error.
        source: std::io::Error,
    },
    /// The system gives no random numbers, or no thread.
    #[error("the server cannot start: {0}")]
    System(#[from] std::io::Error),
    /// Nothing can be heard.
    #[error(transparent)]
    Source(#[from] LiveError),
}

foretrace_shm::debug_as_display!(FoxgloveError);

/// What is shown beside ticks.
#[derive(Debug, Default)]
struct Around {
    scene: Option<Scene>,
    preview: Preview,
}

/// A server that listens.
pub struct Server {
    listener: TcpListener,
    peers: Arc<Peers>,
    door: Arc<Door>,
    at: SocketAddr,
    hub: Arc<Hub>,
    orders: Orders,
    source: Source,
    settings: Settings,
    around: Around,
    /// From the monotonic clock to the time since 1970 \[ns\].
    clock: u64,
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("at", &self.at).finish_non_exhaustive()
    }
}

impl Server {
    /// Listens to the daemon of `instance`, and for viewers.
    ///
    /// # Errors
    ///
    /// `Taken`, `System`, `Source`.
    pub fn open(instance: &Instance, options: Options) -> Result<Self, FoxgloveError> {
        let Options { listen, origins } = options;
        let source = Source::open(instance, Wants::TICKS)?;
        let taken = |source| FoxgloveError::Taken { at: listen, source };
        let listener = TcpListener::bind(listen).map_err(taken)?;
        listener.set_nonblocking(true)?;
        let at = listener.local_addr()?;
        let door = Arc::new(Door::new(at, origins, Token::random()?));
        let orders = Orders::start(instance)?;
        let (hub, clock) = (Arc::new(Hub::default()), unix_minus_monotonic());
        let (settings, around) = (Settings::new(instance), Around::default());
        let peers = Peers::new(LIMITS);
        Ok(Self { listener, peers, door, at, hub, orders, source, settings, around, clock })
    }

    /// Where it listens.
    #[must_use]
    pub const fn at(&self) -> SocketAddr {
        self.at
    }

    /// What a viewer has to say before it may arm or set anything.
    #[must_use]
    pub fn token(&self) -> &str {
        self.door.token.text()
    }

    /// Serves viewers until `over` says so; `tell` is told what changed.
    pub fn run(mut self, mut tell: impl FnMut(News), mut over: impl FnMut() -> bool) -> Tally {
        let (mut shown, mut before) = (Shown::default(), None);
        while !over() {
            // No more at once than there may be: ticks do not wait.
            for _ in 0..LIMITS.all {
                let Ok((stream, _)) = self.listener.accept() else { break };
                self.welcome(stream);
            }
            let now = monotonic_now_ns().wrapping_add(self.clock);
            self.hub.now_ns.store(now, Ordering::Relaxed);
            let wanted = CHANNELS.map(|topic| self.hub.wants(place(topic)));
            self.look_around(now, &mut tell);
            let (hub, clock, around) = (&self.hub, self.clock, &mut self.around);
            let news = self.source.hear(|heard| match heard {
                Heard::Tick(record) => {
                    publish(hub, (before.as_deref(), &record), around, clock, wanted);
                    before = Some(record);
                }
                Heard::Status(status) => shown.show(hub, &status),
                Heard::Input(_) | Heard::Thing(_) => {}
            });
            if let Some(news) = news {
                match news {
                    News::Gone => {
                        let words = "the daemon is gone; waiting for another";
                        self.hub.say(&protocol::status(Level::Error, words, Some("daemon")));
                    }
                    News::Back | News::Renewed => {
                        self.hub.say(&protocol::remove_status("daemon"));
                        self.settings.want();
                    }
                    News::Elsewhere | News::Deaf(_) => {}
                }
                tell(news);
            }
            std::thread::sleep(NAP);
        }
        self.hub.finish();
        self.hub.tally()
    }

    /// Hears which settings are in force, and shows what they place around the pen; `now` is since 1970
    /// \[ns\].
    fn look_around(&mut self, now: u64, tell: &mut impl FnMut(News)) {
        let text = match self.settings.look() {
            Ok(text) => text,
            Err(error) => return tell(News::Deaf(error)),
        };
        let Some(text) =
            text.filter(|text| !self.around.scene.as_ref().is_some_and(|scene| scene.is_of(text)))
        else {
            return;
        };
        match Scene::of(&text) {
            Ok(scene) => {
                let bytes = scene.update(now).into();
                self.hub.keep(Data { channel: place(Topic::Scene), time_ns: now, bytes });
                self.around.scene = Some(scene);
            }
            Err(why) => {
                let words = format!("the arm is not shown: the settings cannot be read here: {why}");
                self.hub.say(&protocol::status(Level::Warning, &words, Some("scene")));
                let bytes = warning(&words, now).into();
                self.hub.publish(&Data { channel: place(Topic::Log), time_ns: now, bytes });
            }
        }
    }

    /// Gives the connection a thread, or turns it away.
    fn welcome(&self, stream: TcpStream) {
        let timeouts = stream
            .set_nonblocking(false)
            .and_then(|()| stream.set_read_timeout(Some(WAIT)))
            .and_then(|()| stream.set_write_timeout(Some(WAIT)));
        if timeouts.is_err() {
            return;
        }
        let slot = match self.peers.enter(&stream) {
            Ok(slot) => slot,
            Err(full) => {
                self.hub.refuse(full.label());
                let message = format!("{}: end a viewer, or try again", full.label());
                return refuse(stream, "503 Service Unavailable", &message);
            }
        };
        let (hub, door, orders) = (self.hub.clone(), self.door.clone(), self.orders.clone());
        let clock = self.clock.to_string();
        let serves = move || {
            if let Some((stream, admitted)) = admit(&hub, &door, stream, &slot) {
                let queue = hub.enter();
                hub.count(|tally| tally.viewers += 1);
                Viewer::new(stream, admitted, (&hub, &queue), &door, &orders).serve(&clock);
                hub.leave(&queue);
            }
        };
        if std::thread::Builder::new().name("foretrace-viewer".to_owned()).spawn(serves).is_err() {
            self.hub.refuse("no thread");
        }
    }
}

/// Reads the request and makes the connection a viewer's, or answers why not.
fn admit(hub: &Hub, door: &Door, stream: TcpStream, slot: &Slot) -> Option<(Metered<TcpStream>, Admitted)> {
    let mut stream = Metered::new(stream, BYTES);
    let head = match Head::read(&mut stream) {
        Ok(head) => head,
        Err(error) => {
            hub.refuse(error.label());
            refuse(stream, "400 Bad Request", error.label());
            return None;
        }
    };
    if let Err(reason) = slot.asked() {
        hub.refuse(reason);
        refuse(stream, "503 Service Unavailable", reason);
        return None;
    }
    let Some(key) = head.socket_key() else {
        hub.refuse("no WebSocket request");
        let message = "this is a WebSocket server for Foxglove and Lichtblick: open its address there";
        refuse(stream, "426 Upgrade Required", message);
        return None;
    };
    match door.judge(&head) {
        Ok(admitted) => {
            http::upgrade(&mut stream, key, Some(admitted.protocol)).ok()?;
            Some((stream, admitted))
        }
        Err(refusal) => {
            hub.refuse(refusal.reason);
            refuse(stream, "400 Bad Request", &refusal.message);
            None
        }
    }
}

/// A short answer, which fits into the socket's own buffer; the other side need not read it.
fn refuse(mut stream: impl std::io::Write, status: &str, message: &str) {
    let _ = http::answer(&mut stream, status, http::TEXT, format!("{message}\n").as_bytes(), WAIT);
}

fn place(topic: Topic) -> usize {
    CHANNELS.iter().position(|known| *known == topic).unwrap_or(CHANNELS.len())
}

/// Puts a record, and what changed since the one `before`, into the queues, in the encodings that anybody
/// wants.
fn publish(
    hub: &Hub,
    (before, record): (Option<&TickRecord>, &TickRecord),
    around: &mut Around,
    clock: u64,
    wanted: [bool; CHANNELS.len()],
) {
    let time_ns = record.header.stamp_ns.wrapping_add(clock);
    let [ticks, transforms, lines, _, path] = wanted;
    let send = |topic: Topic, bytes: Vec<u8>| {
        hub.publish(&Data { channel: place(topic), time_ns, bytes: bytes.into() });
    };
    if ticks {
        send(Topic::Tick, tick(record));
    }
    if transforms {
        let scene = around.scene.as_mut();
        let links = scene.map_or_else(Vec::new, |scene| scene.frames(record, time_ns));
        frames(record, time_ns).into_iter().chain(links).for_each(|frame| send(Topic::Frames, frame));
    }
    if path && let Some(line) = around.preview.update(record, time_ns) {
        send(Topic::Preview, line);
    }
    if lines && let Some(before) = before {
        log(before, record, time_ns).into_iter().for_each(|line| send(Topic::Log, line));
    }
}

/// What viewers were shown of the status.
#[derive(Debug, Default)]
struct Shown {
    parameters: Parameters,
    stopped: bool,
}

impl Shown {
    fn show(&mut self, hub: &Hub, status: &Status) {
        self.parameters = Parameters::of(status);
        hub.show(self.parameters.clone());
        let stopped = [Mode::Stopped, Mode::Fault].map(u32::from).contains(&status.mode);
        if std::mem::replace(&mut self.stopped, stopped) == stopped {
            return;
        }
        if stopped {
            let why = FaultReason::try_from(status.fault).unwrap_or(FaultReason::Internal);
            let words = format!("the arm was stopped: {why}");
            hub.say(&protocol::status(Level::Warning, &words, Some("stopped")));
        } else {
            hub.say(&protocol::remove_status("stopped"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;
    use std::time::Instant;
    use tungstenite::client::IntoClientRequest as _;
    use tungstenite::http::HeaderValue;
    use tungstenite::{Message, WebSocket};

    /// A viewer of a server without a daemon, and its thread.
    fn viewer(hub: &Arc<Hub>) -> (WebSocket<TcpStream>, std::thread::JoinHandle<()>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let at = listener.local_addr().unwrap();
        let door = Arc::new(Door::new(at, Vec::new(), Token::random().unwrap()));
        let hub = hub.clone();
        let serving = std::thread::spawn(move || {
            let folder = tempfile::TempDir::new_in("/tmp").unwrap();
            let orders = Orders::start(&Instance::at(3, folder.path()).unwrap()).unwrap();
            let stream = listener.accept().unwrap().0;
            let slot = Peers::new(LIMITS).enter(&stream).unwrap();
            let (stream, admitted) = admit(&hub, &door, stream, &slot).unwrap();
            let queue = hub.enter();
            Viewer::new(stream, admitted, (&hub, &queue), &door, &orders).serve("1");
            hub.leave(&queue);
        });
        let mut request = format!("ws://{at}/").into_client_request().unwrap();
        request.headers_mut().insert("sec-websocket-protocol", HeaderValue::from_static("foxglove.sdk.v1"));
        let stream = TcpStream::connect(at).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let (mut socket, _) = tungstenite::client(request, stream).unwrap();
        socket.send(Message::text(r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]}"#)).unwrap();
        (socket, serving)
    }

    fn wait(what: &str, mut is: impl FnMut() -> bool) {
        let begin = Instant::now();
        while !is() {
            assert!(begin.elapsed() < Duration::from_secs(60), "{what}");
            std::thread::sleep(NAP);
        }
    }

    #[test]
    fn a_viewer_that_never_reads_is_let_go_and_one_beside_it_gets_everything() {
        let hub = Arc::new(Hub::default());
        let (mut reads, second) = viewer(&hub);
        wait("it subscribes", || hub.wants(0));
        let (never, first) = viewer(&hub);
        let (told, messages) = (Arc::new(std::sync::atomic::AtomicU64::new(0)), 1500);
        let counted = told.clone();
        let reading = std::thread::spawn(move || {
            while let Ok(message) = reads.read() {
                if matches!(&message, Message::Binary(bytes) if bytes.first() == Some(&1)) {
                    counted.fetch_add(1, Ordering::Relaxed);
                }
            }
        });
        // Far more than the buffers of the system hold.
        for time_ns in 1..=messages {
            hub.publish(&Data { channel: 0, time_ns, bytes: vec![7; 40_000].into() });
            let before = time_ns.saturating_sub(100);
            wait("the one that reads goes on", || told.load(Ordering::Relaxed) >= before);
        }
        wait("the other one is let go", || hub.tally().refused.contains_key("reads too slowly"));
        first.join().unwrap();
        wait("all of it comes", || told.load(Ordering::Relaxed) == messages);
        assert!(hub.tally().dropped > 100, "{:?}", hub.tally());
        drop(never);
        hub.finish();
        second.join().unwrap();
        reading.join().unwrap();
    }

    #[test]
    fn a_message_of_empty_pieces_without_end_ends_the_viewer_that_sends_it() {
        let hub = Arc::new(Hub::default());
        let (mut socket, serving) = viewer(&hub);
        let line = socket.get_mut();
        // A text that goes on, and pieces of it that go on, all of them empty; masked (RFC 6455, 5.2).
        line.write_all(&[0x01, 0x80, 0, 0, 0, 0]).unwrap();
        let pieces = [0x00, 0x80, 0, 0, 0, 0].repeat(8192);
        let begin = Instant::now();
        while begin.elapsed() < Duration::from_secs(20) && line.write_all(&pieces).is_ok() {}
        assert!(begin.elapsed() < Duration::from_secs(20), "it is still served");
        serving.join().unwrap();
        assert_eq!(hub.tally().refused.get("too many bytes"), Some(&1));
    }

    #[test]
    fn bad_messages_are_counted_by_reason_and_answered_and_floods_end_the_connection() {
        let hub = Arc::new(Hub::default());
        let (mut socket, serving) = viewer(&hub);
        socket.send(Message::text("{")).unwrap();
        socket
            .send(Message::text(r#"{"op":"subscribe","subscriptions":[{"id":2,"channelId":99}]}"#))
            .unwrap();
        socket.send(Message::binary(vec![1, 2, 3])).unwrap();
        socket.send(Message::binary(vec![2, 9, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0])).unwrap();
        let mut told = Vec::new();
        while told.len() < 4 {
            if let Message::Text(text) = socket.read().unwrap()
                && (text.contains("\"status\"") || text.contains("serviceCallFailure"))
            {
                told.push(text.to_string());
            }
        }
        let refused = hub.tally().refused;
        for reason in ["message not understood", "unknown channel", "not offered here", "unknown service"] {
            assert_eq!(refused.get(reason), Some(&1), "{refused:?} {told:?}");
        }
        for _ in 0..2000 {
            if socket.send(Message::text("{}")).is_err() {
                break;
            }
        }
        serving.join().unwrap();
        assert!(hub.tally().refused.contains_key("too many messages"), "{:?}", hub.tally());
    }
}
