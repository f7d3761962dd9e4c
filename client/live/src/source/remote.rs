//! Listening to a relay.

use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_client::Instance;

use super::frame::{FrameInbox, LossCounts, RelayMessage, framed, hello, kind, said, wants_frame};
use super::{SourceMessage, Wants};

/// Longest wait for a relay's greeting.
const GREETING: Duration = Duration::from_millis(500);
/// A relay that says nothing for this long hangs: it counts once a second.
const SILENT: Duration = Duration::from_secs(3);

/// Where the relay of `instance` listens.
pub(crate) fn relay_socket(instance: &Instance) -> PathBuf {
    instance.root().join("relay.sock")
}

#[derive(Debug)]
pub(super) struct Remote {
    stream: UnixStream,
    inbox: FrameInbox,
    heard: Instant,
    over: bool,
    /// The relay's counts when this began to listen.
    base: Option<LossCounts>,
    counts: LossCounts,
    /// Messages that were refused here.
    refused: u64,
}

impl Remote {
    /// Connects to the relay of `instance`; `None`: there is none of this version that answers.
    pub(super) fn connect(instance: &Instance, wants: Wants) -> Option<Self> {
        // Nobody but the own user may stand in for a relay.
        instance.check_root().ok()?;
        let mut stream = UnixStream::connect(relay_socket(instance)).ok()?;
        stream.set_write_timeout(Some(GREETING)).ok()?;
        stream.write_all(&wants_frame(wants)).ok()?;
        // A relay never pauses: what waits for a pause would wait for long.
        stream.set_nonblocking(true).ok()?;
        let (begin, mut inbox) = (Instant::now(), FrameInbox::of_relay());
        while begin.elapsed() < GREETING {
            inbox.fill(&mut stream).ok()?;
            if let Some((found, body)) = inbox.next_frame().ok()? {
                if found != kind::HELLO || body != hello() {
                    return None;
                }
                return Some(Self {
                    stream,
                    inbox,
                    heard: Instant::now(),
                    over: false,
                    base: None,
                    counts: LossCounts::default(),
                    refused: 0,
                });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        None
    }

    pub(super) fn hear(&mut self, pass: &mut dyn FnMut(SourceMessage)) {
        if self.over {
            return;
        }
        // What came before the end is taken all the same.
        let ended = self.inbox.fill(&mut self.stream).is_err();
        self.over = ended;
        loop {
            match self.inbox.next_frame() {
                Ok(Some((kind, body))) => {
                    self.heard = Instant::now();
                    match said(kind, body) {
                        Some(RelayMessage::Heard(heard)) => pass(heard),
                        Some(RelayMessage::Counts(counts)) => {
                            let base = self.base.get_or_insert(counts);
                            self.counts = LossCounts {
                                refused: counts.refused.saturating_sub(base.refused),
                                broken: counts.broken.saturating_sub(base.broken),
                            };
                        }
                        Some(RelayMessage::Refused) => self.refused += 1,
                        None => {
                            self.over = true;
                            break;
                        }
                    }
                }
                Ok(None) => break,
                Err(_) => {
                    self.over = true;
                    break;
                }
            }
        }
    }

    pub(super) fn start_again(&mut self) {
        // Eight bytes into a socket that a living relay empties all the time.
        if self.stream.write_all(&framed(kind::AGAIN, &[])).is_err() {
            self.over = true;
        }
    }

    /// Whether the relay is gone, hangs, or says what no relay says.
    pub(super) fn is_over(&self) -> bool {
        self.over || self.heard.elapsed() > SILENT
    }

    pub(super) fn counts(&self) -> LossCounts {
        LossCounts { refused: self.counts.refused + self.refused, ..self.counts }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::frame::frame_of;
    use std::os::unix::fs::PermissionsExt as _;
    use std::os::unix::net::UnixListener;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn a_listener_of_a_relay_that_sends_all_the_time_is_there_at_once_and_hears_it_all() {
        let folder = tempfile::TempDir::new_in("/tmp").unwrap();
        // As a daemon makes it.
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o700)).unwrap();
        let instance = Instance::at(3, folder.path()).unwrap();
        assert!(Remote::connect(&instance, Wants::TICKS).is_none(), "nobody listens");
        let listener = UnixListener::bind(relay_socket(&instance)).unwrap();
        let (heard, ended) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (is_heard, has_ended) = (heard.clone(), ended.clone());
        let relay = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.write_all(&framed(kind::HELLO, &hello())).unwrap();
            let (_, frame) = frame_of(&SourceMessage::Tick(Box::default()));
            let mut sent = 0_u64;
            while sent < 500 && !is_heard.load(Ordering::Relaxed) {
                stream.write_all(&frame).unwrap();
                sent += 1;
                std::thread::sleep(Duration::from_millis(10));
            }
            has_ended.store(true, Ordering::Relaxed);
            sent
        });
        let mut remote = Remote::connect(&instance, Wants::TICKS).unwrap();
        assert!(!ended.load(Ordering::Relaxed), "it waited for a pause of five seconds");
        heard.store(true, Ordering::Relaxed);
        let (sent, mut came) = (relay.join().unwrap(), 0);
        remote.hear(&mut |_| came += 1);
        assert_eq!(came, sent);
        assert!(remote.is_over(), "the relay went");
    }
}
