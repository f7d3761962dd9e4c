//! The thread that receives stops at a socket beside the lock file, independent of middleware, memory,
//! descriptors and other threads.
//!
//! Contract: bound before anything else of the daemon, removed after everything else. Nothing is allocated
//! per message. The thread waits only for messages and, after a stop, for the tick that takes it, for a
//! bounded time. The run directory (0700) decides who may send. Invalid frames are counted by reason.

use std::io::{self, ErrorKind};
use std::net::Shutdown;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_shm::{Instance, Mode, STOP_FRAME_BYTES, StopAnswer, StopFrame, StopFrameError};

use crate::rt::stops::StopFlag;

/// A running loop takes a stop within a period; after this time it does not run.
const TICK_PATIENCE: Duration = Duration::from_millis(250);
/// Interval between checks for that.
const LOOK: Duration = Duration::from_micros(200);
/// The thread notices the end of the daemon within this time.
const WAKE: Duration = Duration::from_millis(500);
/// Pause after an error of the socket itself, so that a lasting one does not use up a processor.
const PAUSE: Duration = Duration::from_millis(10);

/// Counts of the thread, for log and status.
#[derive(Debug, Default)]
pub struct StopTally {
    pub stops: AtomicU64,
    /// Sender of the newest one, as it claims.
    pub newest_pid: AtomicU32,
    /// Frames of another length or kind.
    pub malformed: AtomicU64,
    /// Frames of another boot.
    pub foreign: AtomicU64,
    /// Answers that could not be delivered.
    pub unanswered: AtomicU64,
    /// Errors of the socket.
    pub failures: AtomicU64,
}

/// The running thread; the socket goes with it.
#[derive(Debug)]
pub struct StopSocket {
    path: PathBuf,
    socket: UnixDatagram,
    tally: Arc<StopTally>,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl StopSocket {
    /// Listens in the run directory of `instance`, whose lock the caller holds.
    ///
    /// # Errors
    /// The system refuses socket, file or thread.
    pub fn open(instance: &Instance, flag: Arc<StopFlag>) -> io::Result<Self> {
        let path = instance.stop_socket();
        // An existing file belongs to a daemon that is gone: we hold the lock.
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let socket = UnixDatagram::bind(&path)?;
        // Independent of umask: the owner must be able to write to it.
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600))?;
        socket.set_read_timeout(Some(WAKE))?;
        // A separate socket, because a full queue at the other end must not block.
        let answers = UnixDatagram::unbound()?;
        answers.set_nonblocking(true)?;
        let (tally, quit) = (Arc::new(StopTally::default()), Arc::new(AtomicBool::new(false)));
        let listener =
            Listener { socket: socket.try_clone()?, answers, flag, tally: tally.clone(), quit: quit.clone() };
        let thread = std::thread::Builder::new()
            .name("foretrace-stop".to_owned())
            .stack_size(1 << 18)
            .spawn(move || listener.run())?;
        Ok(Self { path, socket, tally, quit, thread: Some(thread) })
    }

    /// The counts so far.
    #[must_use]
    pub fn tally(&self) -> Arc<StopTally> {
        self.tally.clone()
    }
}

impl Drop for StopSocket {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Release);
        let _ = self.socket.shutdown(Shutdown::Both);
        let _ = std::fs::remove_file(&self.path);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// State of the thread.
struct Listener {
    socket: UnixDatagram,
    answers: UnixDatagram,
    flag: Arc<StopFlag>,
    tally: Arc<StopTally>,
    quit: Arc<AtomicBool>,
}

impl Listener {
    fn run(self) {
        // One byte more than a frame, so that a longer message is recognised.
        let mut bytes = [0; STOP_FRAME_BYTES + 1];
        while !self.quit.load(Ordering::Acquire) {
            match self.socket.recv_from(&mut bytes) {
                Ok((length, from)) => self.receive(bytes.get(..length).unwrap_or_default(), &from),
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {}
                    _ => {
                        self.tally.failures.fetch_add(1, Ordering::Relaxed);
                        std::thread::sleep(PAUSE);
                    }
                },
            }
        }
    }

    fn receive(&self, bytes: &[u8], from: &SocketAddr) {
        match StopFrame::decode(bytes) {
            Ok(frame) => self.stop(frame, from),
            // The daemon's own shutdown.
            Err(_) if self.quit.load(Ordering::Acquire) => {}
            Err(StopFrameError::Malformed { .. }) => {
                self.tally.malformed.fetch_add(1, Ordering::Relaxed);
            }
            Err(StopFrameError::ForeignBoot) => {
                self.tally.foreign.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    fn stop(&self, frame: StopFrame, from: &SocketAddr) {
        // Before everything else: whatever fails below, the next tick stops the arm.
        let number = self.flag.ask();
        self.tally.stops.fetch_add(1, Ordering::Relaxed);
        self.tally.newest_pid.store(frame.pid, Ordering::Relaxed);
        let noted = StopAnswer { token: frame.token, taken: None, trust: 0.0 };
        self.answer(&noted, from);
        let since = Instant::now();
        while since.elapsed() < TICK_PATIENCE {
            if let Some((mode, trust)) = self.flag.outcome(number) {
                let taken = Mode::try_from(mode).ok();
                return self.answer(&StopAnswer { taken, trust, ..noted }, from);
            }
            std::thread::sleep(LOOK);
        }
    }

    fn answer(&self, answer: &StopAnswer, to: &SocketAddr) {
        if self.answers.send_to_addr(&answer.encode(), to).is_err() {
            self.tally.unanswered.fetch_add(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use foretrace_control::units::Trust;

    use super::*;
    use crate::support::{Site, until};

    fn client(site: &Site, name: &str) -> UnixDatagram {
        let socket = UnixDatagram::bind(site.root.join(name)).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        socket
    }

    fn answer(client: &UnixDatagram) -> StopAnswer {
        let mut bytes = [0; 64];
        let length = client.recv(&mut bytes).unwrap();
        StopAnswer::decode(&bytes[..length]).unwrap()
    }

    #[test]
    fn a_stop_is_noted_at_once_and_told_again_when_a_tick_has_taken_it() {
        let site = Site::new();
        let _lock = site.instance().lock().unwrap();
        let flag = Arc::new(StopFlag::default());
        let stops = StopSocket::open(&site.instance(), flag.clone()).unwrap();
        let client = client(&site, "c");
        let frame = StopFrame { token: 77, pid: 5 };
        client.send_to(&frame.encode(), site.instance().stop_socket()).unwrap();
        assert_eq!(answer(&client), StopAnswer { token: 77, taken: None, trust: 0.0 });
        let taken = until("the flag is set", || flag.take());
        flag.report(taken, foretrace_control::follower::Mode::Stopped, Trust::new(0.5));
        // If the machine suspended this test for longer than the thread's patience, there is no answer.
        if stops.tally().unanswered.load(Ordering::Relaxed) == 0 {
            client.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
            let mut bytes = [0; 64];
            if let Ok(length) = client.recv(&mut bytes) {
                let answer = StopAnswer::decode(&bytes[..length]).unwrap();
                assert_eq!(answer, StopAnswer { token: 77, taken: Some(Mode::Stopped), trust: 0.5 });
            }
        }
        assert_eq!(stops.tally().stops.load(Ordering::Relaxed), 1);
        let path = site.instance().stop_socket();
        drop(stops);
        assert!(!path.exists());
    }

    #[test]
    fn what_is_no_frame_stops_nothing_and_is_counted() {
        let site = Site::new();
        let _lock = site.instance().lock().unwrap();
        let flag = Arc::new(StopFlag::default());
        // A socket left by a killed daemon does no harm.
        std::fs::write(site.instance().stop_socket(), "").unwrap();
        let stops = StopSocket::open(&site.instance(), flag.clone()).unwrap();
        let client = client(&site, "c");
        let good = StopFrame { token: 1, pid: 2 }.encode();
        let mut foreign = good;
        foreign[8] ^= 1;
        let path = site.instance().stop_socket();
        for bytes in [&b""[..], b"stop", &good[..31], &[&good[..], &[0]].concat(), &foreign] {
            client.send_to(bytes, &path).unwrap();
        }
        let tally = stops.tally();
        let count = |count: &AtomicU64| count.load(Ordering::Relaxed);
        until("all are counted", || (count(&tally.malformed) + count(&tally.foreign) == 5).then_some(()));
        assert_eq!((count(&tally.foreign), count(&tally.stops), flag.take()), (1, 0, None));
    }

    #[test]
    fn a_sender_without_an_address_or_with_a_full_queue_keeps_nobody() {
        let site = Site::new();
        let _lock = site.instance().lock().unwrap();
        let flag = Arc::new(StopFlag::default());
        let stops = StopSocket::open(&site.instance(), flag.clone()).unwrap();
        let (silent, path) = (client(&site, "silent"), site.instance().stop_socket());
        let frame = StopFrame { token: 1, pid: 2 }.encode();
        UnixDatagram::unbound().unwrap().send_to(&frame, &path).unwrap();
        let loops = flag.clone();
        let quit = Arc::new(AtomicBool::new(false));
        let over = quit.clone();
        let ticks = std::thread::spawn(move || {
            while !over.load(Ordering::Acquire) {
                if let Some(taken) = loops.take() {
                    loops.report(taken, foretrace_control::follower::Mode::Idle, Trust::NONE);
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        // The answers are not read, until no more fit.
        for _ in 0..2000 {
            silent.send_to(&frame, &path).unwrap();
        }
        let tally = stops.tally();
        until("all are served", || (tally.stops.load(Ordering::Relaxed) == 2001).then_some(()));
        assert!(tally.unanswered.load(Ordering::Relaxed) > 0);
        quit.store(true, Ordering::Release);
        ticks.join().unwrap();
    }
}
