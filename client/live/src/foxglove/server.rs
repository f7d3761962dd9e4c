//! The listener: lets viewers in, one thread each, and feeds their queues from a source.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use foretrace_client::wire::FaultReason;
use foretrace_client::{Instance, Mode, Status, TickRecord, monotonic_now_ns};
use foretrace_serve::guard::Token;
use foretrace_serve::http::{self, Head};
use foretrace_serve::metered::Metered;
use foretrace_serve::peers::{PeerLimits, Peers, Slot, bound_waits};

use super::guard::{Admitted, ViewerDoor};
use super::hub::{Hub, TopicMessage, ViewerParameters, ViewerTally};
use super::orders::Orders;
use super::protocol::{self, CHANNELS, StatusLevel};
use super::settings::Settings;
use super::viewer::Viewer;
use crate::LiveError;
use crate::recorder::unix_minus_monotonic;
use crate::source::{LiveSource, SourceMessage, SourceNews, Wants};
use foretrace_record::scene::{Preview, Scene};
use foretrace_record::topics::{RecordingTopic, frames, log, tick, warning};

/// Most bytes of a viewer per second: far more than one says.
const BYTES: usize = 4 << 20;
/// Viewers at a time, and those that ask to be one.
const LIMITS: PeerLimits = PeerLimits { all: 16, remote: 16, of_one: 16, local: 16 };
/// Between two looks at what has come.
const NAP: Duration = Duration::from_millis(2);
/// Longest wait for bytes of a request, and for a refusal to be taken.
const WAIT: Duration = Duration::from_millis(200);

/// What a server does.
#[derive(Debug, Clone)]
pub struct FoxgloveOptions {
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
    Taken { at: SocketAddr, source: std::io::Error },
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
    door: Arc<ViewerDoor>,
    at: SocketAddr,
    hub: Arc<Hub>,
    orders: Orders,
    source: LiveSource,
    settings: Settings,
    around: Around,
    /// From the monotonic clock to the time since 1970 \[ns\].
    clock: u64,
}

impl Server {
    /// Listens to the daemon of `instance`, and for viewers.
    ///
    /// # Errors
    ///
    /// `Taken`, `System`, `LiveSource`.
    pub fn open(instance: &Instance, options: FoxgloveOptions) -> Result<Self, FoxgloveError> {
        let FoxgloveOptions { listen, origins } = options;
        let source = LiveSource::open(instance, Wants::TICKS)?;
        let taken = |source| FoxgloveError::Taken { at: listen, source };
        let listener = TcpListener::bind(listen).map_err(taken)?;
        listener.set_nonblocking(true)?;
        let at = listener.local_addr()?;
        let door = Arc::new(ViewerDoor::new(at, origins, Token::random()?));
        let orders = Orders::start(instance)?;
        let (hub, clock) = (Arc::new(Hub::default()), unix_minus_monotonic());
        let (settings, around) = (Settings::new(instance), Around::default());
        let peers = Peers::new(LIMITS);
        Ok(Self { listener, peers, door, at, hub, orders, source, settings, around, clock })
    }

    #[must_use]
    pub const fn at(&self) -> SocketAddr {
        self.at
    }

    /// What a viewer has to say before it may arm or set anything.
    #[must_use]
    pub fn token(&self) -> &str {
        self.door.token.text()
    }

    /// Serves viewers until `over` says so; `tell` gets what changed.
    pub fn run(mut self, mut tell: impl FnMut(SourceNews), mut over: impl FnMut() -> bool) -> ViewerTally {
        let (mut shown, mut before) = (ShownStatus::default(), None);
        while !over() {
            // No more at once than there may be: ticks do not wait.
            for _ in 0..LIMITS.all {
                let Ok((stream, _)) = self.listener.accept() else { break };
                self.welcome(stream);
            }
            let now = monotonic_now_ns().wrapping_add(self.clock);
            self.hub.now_ns.store(now, Ordering::Relaxed);
            let wanted = CHANNELS.map(|topic| self.hub.wants(channel_of(topic)));
            self.look_around(now, &mut tell);
            let (hub, clock, around) = (&self.hub, self.clock, &mut self.around);
            let news = self.source.hear(|heard| match heard {
                SourceMessage::Tick(record) => {
                    publish(hub, (before.as_deref(), &record), around, clock, wanted);
                    before = Some(record);
                }
                SourceMessage::Status(status) => shown.show(hub, &status),
                SourceMessage::Input(_) | SourceMessage::Thing(_) => {}
            });
            if let Some(news) = news {
                match news {
                    SourceNews::Gone => {
                        let words = "the daemon is gone; waiting for another";
                        self.hub.say(&protocol::status(StatusLevel::Error, words, Some("daemon")));
                    }
                    SourceNews::Back | SourceNews::Renewed => {
                        self.hub.say(&protocol::remove_status("daemon"));
                        self.settings.want();
                    }
                    SourceNews::Elsewhere | SourceNews::Deaf(_) => {}
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
    fn look_around(&mut self, now: u64, tell: &mut impl FnMut(SourceNews)) {
        let text = match self.settings.look() {
            Ok(text) => text,
            Err(error) => return tell(SourceNews::Deaf(error)),
        };
        let Some(text) =
            text.filter(|text| !self.around.scene.as_ref().is_some_and(|scene| scene.is_of(text)))
        else {
            return;
        };
        match Scene::of(&text) {
            Ok(scene) => {
                let bytes = scene.update(now).into();
                self.hub.keep(TopicMessage {
                    channel: channel_of(RecordingTopic::Scene),
                    time_ns: now,
                    bytes,
                });
                self.around.scene = Some(scene);
            }
            Err(why) => {
                let words = format!("the arm is not shown: the settings cannot be read here: {why}");
                self.hub.say(&protocol::status(StatusLevel::Warning, &words, Some("scene")));
                let bytes = warning(&words, now).into();
                self.hub.publish(&TopicMessage {
                    channel: channel_of(RecordingTopic::Log),
                    time_ns: now,
                    bytes,
                });
            }
        }
    }

    /// Gives the connection a thread, or turns it away.
    fn welcome(&self, mut stream: TcpStream) {
        if bound_waits(&stream, WAIT, WAIT).is_err() {
            return;
        }
        let slot = match self.peers.enter(&stream) {
            Ok(slot) => slot,
            Err(full) => {
                self.hub.refuse(full.label());
                let message = format!("{}: end a viewer, or try again", full.label());
                return http::refuse(&mut stream, "503 Service Unavailable", &message, WAIT);
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
fn admit(
    hub: &Hub,
    door: &ViewerDoor,
    stream: TcpStream,
    slot: &Slot,
) -> Option<(Metered<TcpStream>, Admitted)> {
    let mut stream = Metered::new(stream, BYTES);
    let refused = match Head::asked(&mut stream, slot) {
        Err((status, reason)) => (status, reason, reason.to_owned()),
        Ok(head) => match (head.socket_key(), door.judge(&head)) {
            (Some(key), Ok(admitted)) => {
                http::upgrade(&mut stream, key, Some(admitted.protocol)).ok()?;
                return Some((stream, admitted));
            }
            (Some(_), Err(refusal)) => ("400 Bad Request", refusal.reason, refusal.message),
            (None, _) => (
                "426 Upgrade Required",
                "no WebSocket request",
                "this is a WebSocket server for Foxglove and Lichtblick: open its address there".to_owned(),
            ),
        },
    };
    let (status, reason, message) = refused;
    hub.refuse(reason);
    // A short answer fits into the socket's own buffer.
    http::refuse(&mut stream, status, &message, WAIT);
    None
}

fn channel_of(topic: RecordingTopic) -> usize {
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
    let send = |topic: RecordingTopic, bytes: Vec<u8>| {
        hub.publish(&TopicMessage { channel: channel_of(topic), time_ns, bytes: bytes.into() });
    };
    if ticks {
        send(RecordingTopic::Tick, tick(record));
    }
    if transforms {
        let scene = around.scene.as_mut();
        let links = scene.map_or_else(Vec::new, |scene| scene.frames(record, time_ns));
        frames(record, time_ns)
            .into_iter()
            .chain(links)
            .for_each(|frame| send(RecordingTopic::Frames, frame));
    }
    if path && let Some(line) = around.preview.update(record, time_ns) {
        send(RecordingTopic::Preview, line);
    }
    if lines && let Some(before) = before {
        log(before, record, time_ns).into_iter().for_each(|line| send(RecordingTopic::Log, line));
    }
}

/// What viewers were shown of the status.
#[derive(Debug, Default)]
struct ShownStatus {
    parameters: ViewerParameters,
    stopped: bool,
}

impl ShownStatus {
    fn show(&mut self, hub: &Hub, status: &Status) {
        self.parameters = ViewerParameters::of(status);
        hub.show(self.parameters.clone());
        let stopped = [Mode::Stopped, Mode::Fault].map(u32::from).contains(&status.mode);
        if std::mem::replace(&mut self.stopped, stopped) == stopped {
            return;
        }
        if stopped {
            let why = FaultReason::try_from(status.fault).unwrap_or(FaultReason::Internal);
            let words = format!("the arm was stopped: {why}");
            hub.say(&protocol::status(StatusLevel::Warning, &words, Some("stopped")));
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
        let door = Arc::new(ViewerDoor::new(at, Vec::new(), Token::random().unwrap()));
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
        let (reported, messages) = (Arc::new(std::sync::atomic::AtomicU64::new(0)), 1500);
        let counted = reported.clone();
        let reading = std::thread::spawn(move || {
            while let Ok(message) = reads.read() {
                if matches!(&message, Message::Binary(bytes) if bytes.first() == Some(&1)) {
                    counted.fetch_add(1, Ordering::Relaxed);
                }
            }
        });
        // Far more than the buffers of the system hold.
        for time_ns in 1..=messages {
            hub.publish(&TopicMessage { channel: 0, time_ns, bytes: vec![7; 40_000].into() });
            let before = time_ns.saturating_sub(100);
            wait("the one that reads goes on", || reported.load(Ordering::Relaxed) >= before);
        }
        wait("the other one is let go", || hub.tally().refused.contains_key("reads too slowly"));
        first.join().unwrap();
        wait("all of it comes", || reported.load(Ordering::Relaxed) == messages);
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
        let mut reported = Vec::new();
        while reported.len() < 4 {
            if let Message::Text(text) = socket.read().unwrap()
                && (text.contains("\"status\"") || text.contains("serviceCallFailure"))
            {
                reported.push(text.to_string());
            }
        }
        let refused = hub.tally().refused;
        for reason in ["message not understood", "unknown channel", "not offered here", "unknown service"] {
            assert_eq!(refused.get(reason), Some(&1), "{refused:?} {reported:?}");
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
