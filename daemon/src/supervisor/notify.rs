//! Notifications to the service manager that started the daemon: ready, alive, stopping (sd_notify(3)).
//!
//! Contract: datagrams over NOTIFY_SOCKET, a path or an abstract name (`@...`), from the supervisor's thread
//! only. Nothing blocks and nothing fails the daemon. The watchdog is fed only while the real-time thread's
//! ticks advance: the manager ends and restarts a loop that hangs. Without NOTIFY_SOCKET nothing is sent.

use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};

use tracing::{info, warn};

/// Feedings per watchdog period: two may be late or lost before the manager acts.
const FEEDS_PER_PERIOD: u32 = 3;

/// The connection to the service manager, if there is one.
#[derive(Debug, Default)]
pub(super) struct Manager {
    socket: Option<NotifySocket>,
    watchdog: Option<WatchdogFeed>,
    warned: bool,
}

impl Manager {
    /// From the environment: NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID.
    pub(super) fn of_environment() -> Self {
        let socket = std::env::var_os("NOTIFY_SOCKET").filter(|name| !name.is_empty());
        let number = |key: &str| std::env::var(key).ok().map(|text| text.trim().parse::<u64>());
        let Some(socket) = socket else { return Self::default() };
        let socket = match NotifySocket::to(&socket) {
            Ok(socket) => socket,
            Err(error) => {
                warn!("NOTIFY_SOCKET {} cannot be used: {error}", socket.to_string_lossy());
                return Self::default();
            }
        };
        let period = watchdog_period(number("WATCHDOG_USEC"), number("WATCHDOG_PID"), std::process::id());
        let period = period.unwrap_or_else(|text| {
            warn!("{text}");
            None
        });
        if let Some(period) = period {
            info!("the service manager expects a sign of life every {} ms", period.as_millis());
        }
        Self { socket: Some(socket), watchdog: period.map(WatchdogFeed::new), warned: false }
    }

    /// Peers can attach; `status` is one line for `systemctl status`.
    pub(super) fn ready(&mut self, status: &str) {
        self.notify(&format!("READY=1\nSTATUS={}", status.replace('\n', " ")));
    }

    /// The shutdown has begun.
    pub(super) fn stopping(&mut self) {
        self.notify("STOPPING=1\nSTATUS=bringing the arm to rest");
    }

    /// Feeds the watchdog if it is time and `ticks` of the loop have increased since it was last fed.
    pub(super) fn alive(&mut self, ticks: u64) {
        let now = Instant::now();
        if self.watchdog.as_ref().is_some_and(|watchdog| watchdog.is_due(now, ticks))
            && self.notify("WATCHDOG=1")
        {
            // Not sent: tried again at the next check.
            self.watchdog.iter_mut().for_each(|watchdog| watchdog.fed(now, ticks));
        }
    }

    fn notify(&mut self, words: &str) -> bool {
        let Some(socket) = &self.socket else { return false };
        match socket.send(words) {
            Ok(()) => true,
            Err(error) => {
                if !self.warned {
                    warn!("the service manager cannot be notified ({error}); said only once");
                    self.warned = true;
                }
                false
            }
        }
    }
}

/// A datagram socket and its destination.
#[derive(Debug)]
struct NotifySocket {
    socket: UnixDatagram,
    address: SocketAddr,
}

impl NotifySocket {
    fn to(name: &OsStr) -> io::Result<Self> {
        let address = match name.as_bytes() {
            [b'/', ..] => SocketAddr::from_pathname(name)?,
            [b'@', rest @ ..] if !rest.is_empty() => SocketAddr::from_abstract_name(rest)?,
            _ => {
                return Err(io::Error::new(
                    io::ErrorKind::InvalidInput,
                    "neither an absolute path nor @NAME",
                ));
            }
        };
        let socket = UnixDatagram::unbound()?;
        // A manager that does not read must not block the supervisor.
        socket.set_nonblocking(true)?;
        Ok(Self { socket, address })
    }

    fn send(&self, words: &str) -> io::Result<()> {
        self.socket.send_to_addr(words.as_bytes(), &self.address).map(drop)
    }
}

/// When signs of life are due.
#[derive(Debug)]
struct WatchdogFeed {
    every: Duration,
    last: Option<(Instant, u64)>,
}

impl WatchdogFeed {
    fn new(period: Duration) -> Self {
        Self { every: period / FEEDS_PER_PERIOD, last: None }
    }

    fn is_due(&self, now: Instant, ticks: u64) -> bool {
        match self.last {
            None => ticks > 0,
            Some((at, seen)) => ticks != seen && now.saturating_duration_since(at) >= self.every,
        }
    }

    fn fed(&mut self, now: Instant, ticks: u64) {
        self.last = Some((now, ticks));
    }
}

type Parsed = Option<Result<u64, std::num::ParseIntError>>;

/// The watchdog period of process `own`; `None` if there is no watchdog or it concerns another process.
fn watchdog_period(usec: Parsed, pid: Parsed, own: u32) -> Result<Option<Duration>, String> {
    let Some(usec) = usec else { return Ok(None) };
    let usec = match usec {
        Ok(usec) if usec > 0 => usec,
        _ => {
            return Err(
                "WATCHDOG_USEC is not a positive whole number of microseconds: no watchdog".to_owned()
            );
        }
    };
    match pid {
        None => {}
        Some(Ok(pid)) if pid == u64::from(own) => {}
        Some(Ok(_)) => return Ok(None),
        Some(Err(_)) => return Err("WATCHDOG_PID is not a process number: no watchdog".to_owned()),
    }
    Ok(Some(Duration::from_micros(usec)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(socket: &UnixDatagram) -> String {
        let mut bytes = [0; 256];
        socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let count = socket.recv(&mut bytes).unwrap();
        String::from_utf8(bytes[..count].to_vec()).unwrap()
    }

    fn manager(name: &OsStr) -> Manager {
        Manager { socket: Some(NotifySocket::to(name).unwrap()), ..Manager::default() }
    }

    #[test]
    fn words_reach_a_socket_with_a_path_and_one_with_an_abstract_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let by_path = UnixDatagram::bind(&path).unwrap();
        let mut to_path = manager(path.as_os_str());
        to_path.ready("two\nlines");
        assert_eq!(received(&by_path), "READY=1\nSTATUS=two lines");

        let name = format!("foretrace-notify-{}", std::process::id());
        let address = SocketAddr::from_abstract_name(&name).unwrap();
        let by_name = UnixDatagram::bind_addr(&address).unwrap();
        manager(OsStr::new(&format!("@{name}"))).stopping();
        assert!(received(&by_name).starts_with("STOPPING=1\n"));
    }

    #[test]
    fn a_name_of_another_kind_is_refused() {
        for name in ["", "@", "relative/path", "vsock:2:1234"] {
            assert!(NotifySocket::to(OsStr::new(name)).is_err(), "{name}");
        }
        assert!(NotifySocket::to(OsStr::new(&format!("/{}", "x".repeat(200)))).is_err());
    }

    #[test]
    fn a_manager_that_does_not_read_neither_blocks_nor_ends_anything() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let unread = UnixDatagram::bind(&path).unwrap();
        let mut manager = manager(path.as_os_str());
        assert!((0..10_000).any(|_| !manager.notify("WATCHDOG=1")), "its queue never fills");
        assert!(manager.warned);
        drop(unread);
        assert!(!manager.notify("WATCHDOG=1"));
    }

    #[test]
    fn the_watchdog_is_fed_three_times_per_period_and_only_while_ticks_advance() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut watchdog = WatchdogFeed::new(Duration::from_millis(300));
        assert!(!watchdog.is_due(at(0), 0), "no tick yet");
        assert!(watchdog.is_due(at(0), 1));
        watchdog.fed(at(0), 1);
        assert!(!watchdog.is_due(at(99), 50));
        assert!(watchdog.is_due(at(100), 50));
        watchdog.fed(at(100), 50);
        assert!(!watchdog.is_due(at(5000), 50), "the loop hangs");
        assert!(watchdog.is_due(at(5001), 51), "and goes on");
    }

    #[test]
    fn a_watchdog_for_another_process_or_without_a_sensible_period_is_left_alone() {
        let number = |text: &str| Some(text.parse::<u64>());
        let half = Some(Duration::from_millis(500));
        assert_eq!(watchdog_period(number("500000"), None, 7), Ok(half));
        assert_eq!(watchdog_period(number("500000"), number("7"), 7), Ok(half));
        assert_eq!(watchdog_period(number("500000"), number("8"), 7), Ok(None));
        assert_eq!(watchdog_period(None, number("7"), 7), Ok(None));
        for wrong in ["0", "-1", "soon", "99999999999999999999999"] {
            assert!(
                watchdog_period(number(wrong), None, 7).unwrap_err().contains("WATCHDOG_USEC"),
                "{wrong}"
            );
        }
        assert!(watchdog_period(number("1"), number("me"), 7).unwrap_err().contains("WATCHDOG_PID"));
    }
}
