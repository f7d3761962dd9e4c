//! Answers `GET /metrics` with the newest text.
//!
//! Contract: it answers a bounded number of peers at a time, each within a bounded time as a whole, whatever
//! they send and however slowly. Where one machine, or all together, have no slot left, the peer that has
//! been asking for longest gives way, after a moment of its own; one that has asked is answered. It holds no
//! handle to the loop.

use std::io;
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use foretrace_serve::http::{self, Head, NoHead};
use foretrace_serve::peers::{Full, PeerLimits, Peers, Slot};

/// Peers at a time.
const LIMITS: PeerLimits = PeerLimits { all: 48, remote: 48, of_one: 16, local: 16 };
/// Longest wait for bytes of a request.
const WAIT: Duration = Duration::from_millis(200);
/// How long a peer may take to take the answer, all of it.
const WHOLE_ANSWER: Duration = Duration::from_secs(5);
/// The text format of Prometheus, version 0.0.4.
const KIND: &str = "text/plain; version=0.0.4; charset=utf-8";

/// The newest text, shared with the server.
#[derive(Debug, Clone, Default)]
pub struct MetricsBoard(Arc<Mutex<String>>);

impl MetricsBoard {
    /// Shows `text` from now on.
    pub fn show(&self, text: String) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = text;
    }

    fn text(&self) -> String {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Answers on `listener` until the process ends.
///
/// # Errors
///
/// The system refuses another thread.
pub fn serve(listener: TcpListener, board: MetricsBoard) -> io::Result<()> {
    std::thread::Builder::new().name("foretrace-http".to_owned()).spawn(move || {
        let served = Arc::new(Served { board, peers: Peers::new(LIMITS), refused: RefusedPeers::default() });
        for peer in listener.incoming() {
            let Ok(peer) = peer else {
                // No descriptor is left, for example: some peer ends.
                std::thread::sleep(Duration::from_millis(5));
                continue;
            };
            served.welcome(peer);
        }
    })?;
    Ok(())
}

/// What all peers share.
#[derive(Debug)]
struct Served {
    board: MetricsBoard,
    peers: Arc<Peers>,
    refused: RefusedPeers,
}

/// Peers that got no answer.
#[derive(Debug, Default)]
struct RefusedPeers {
    no_slot: AtomicU64,
    too_slow: AtomicU64,
    too_long: AtomicU64,
    incomplete: AtomicU64,
}

impl Served {
    /// Gives the peer a thread, or turns it away; waits while the one that gives way has its moment.
    fn welcome(self: &Arc<Self>, mut peer: TcpStream) {
        let slot = loop {
            match self.peers.enter(&peer) {
                Ok(slot) => break slot,
                Err(Full::Wait(wait)) => std::thread::sleep(wait),
                Err(_) => return count(&self.refused.no_slot),
            }
        };
        let served = self.clone();
        let answers = move || {
            // A peer that went away has no use for an error.
            let _ = served.answer(&mut peer, &slot);
            // Before the peer sees the end and comes again.
            drop(slot);
        };
        if std::thread::Builder::new().name("foretrace-peer".to_owned()).spawn(answers).is_err() {
            count(&self.refused.no_slot);
        }
    }

    fn answer(&self, peer: &mut TcpStream, slot: &Slot) -> io::Result<()> {
        peer.set_read_timeout(Some(WAIT))?;
        peer.set_write_timeout(Some(WHOLE_ANSWER))?;
        let head = match Head::read(peer) {
            Ok(head) => head,
            Err(error) => {
                match error {
                    NoHead::TooSlow => count(&self.refused.too_slow),
                    NoHead::TooLong => count(&self.refused.too_long),
                    NoHead::Malformed => {
                        let message = b"ask for GET /metrics\n";
                        http::answer(peer, "400 Bad Request", KIND, message, WHOLE_ANSWER)?;
                    }
                    // One that gave way is counted elsewhere.
                    NoHead::Incomplete if slot.asked().is_err() => {}
                    NoHead::Incomplete => count(&self.refused.incomplete),
                }
                return Ok(());
            }
        };
        if slot.asked().is_err() {
            return Ok(());
        }
        let (status, body) = match origin_form(&head.path) {
            "/metrics" => ("200 OK", self.board.text() + &self.tally()),
            _ => ("404 Not Found", "metrics are at /metrics\n".to_owned()),
        };
        let answered = match head.method.as_str() {
            "GET" => http::answer(peer, status, KIND, body.as_bytes(), WHOLE_ANSWER),
            "HEAD" => http::answer_without_body(peer, status, KIND, body.len(), WHOLE_ANSWER),
            _ => http::not_allowed(peer, "GET, HEAD", "ask for GET /metrics", WHOLE_ANSWER),
        };
        answered.inspect_err(|error| {
            if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) {
                count(&self.refused.too_slow);
            }
        })
    }

    /// What became of peers, as metrics.
    fn tally(&self) -> String {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let lines = [
            ("gave way", self.peers.gave_way()),
            ("no slot", of(&self.refused.no_slot)),
            ("too slow", of(&self.refused.too_slow)),
            ("too long", of(&self.refused.too_long)),
            ("incomplete", of(&self.refused.incomplete)),
        ]
        .map(|(reason, count)| {
            format!("foretrace_metrics_peers_refused_total{{reason=\"{reason}\"}} {count}\n")
        });
        "# HELP foretrace_metrics_peers_refused_total Peers of these metrics that got no answer.\n\
         # TYPE foretrace_metrics_peers_refused_total counter\n"
            .to_owned()
            + &lines.concat()
    }
}

/// The path of a target that may be a whole URL, as proxies send it. Source: RFC 9112, 3.2.2.
fn origin_form(path: &str) -> &str {
    let scheme = "http://";
    let is_whole = path.get(..scheme.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(scheme));
    let Some(rest) = path.get(scheme.len()..).filter(|_| is_whole) else { return path };
    rest.find('/').and_then(|at| rest.get(at..)).unwrap_or("/")
}

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_serve::http::HEAD_TIME;
    use std::io::{Read as _, Write as _};
    use std::net::SocketAddr;
    use std::time::Instant;

    /// Peers of one machine.
    const OF_ONE: usize = LIMITS.local;

    fn served(text: &str) -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let board = MetricsBoard::default();
        board.show(text.to_owned());
        serve(listener, board).unwrap();
        address
    }

    fn ask(address: SocketAddr, bytes: &[u8]) -> String {
        let mut peer = TcpStream::connect(address).unwrap();
        peer.write_all(bytes).unwrap();
        let mut reported = String::new();
        peer.read_to_string(&mut reported).unwrap();
        reported
    }

    const SCRAPE: &[u8] = b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n";

    #[test]
    fn peers_of_any_kind_get_an_answer_or_are_left() {
        let address = served("foretrace_up 0\n");
        // Those who never ask hold up nobody, however many they are.
        let _silent: Vec<_> = (0..3 * OF_ONE).map(|_| TcpStream::connect(address).unwrap()).collect();
        let reported = ask(address, SCRAPE);
        assert!(
            reported.starts_with("HTTP/1.1 200 OK") && reported.contains("\nforetrace_up 0\n"),
            "{reported}"
        );
        let gave_way = format!("refused_total{{reason=\"gave way\"}} {}\n", 2 * OF_ONE + 1);
        assert!(reported.contains(&gave_way), "{reported}");
        assert!(ask(address, b"GET / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404"));
        assert!(ask(address, b"POST /metrics HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 405"));
        assert!(ask(address, b"\xff\xff\xff\r\n\r\n").starts_with("HTTP/1.1 400"));
        let named = ask(address, b"GET /metrics?name=up HTTP/1.0\r\n\r\n");
        assert!(named.starts_with("HTTP/1.1 200 OK") && named.contains("\nforetrace_up 0\n"), "{named}");
        let head = ask(address, b"HEAD /metrics HTTP/1.1\r\n\r\n");
        assert!(head.starts_with("HTTP/1.1 200 OK") && head.ends_with("\r\n\r\n"), "{head}");
        let mut endless = TcpStream::connect(address).unwrap();
        let begin = Instant::now();
        while endless.write_all(&[b'a'; 1024]).is_ok() {
            assert!(begin.elapsed() < Duration::from_secs(60));
        }
        let reported = ask(address, SCRAPE);
        assert!(reported.contains("refused_total{reason=\"too long\"} 1\n"), "{reported}");
    }

    #[test]
    fn a_head_has_the_length_of_its_body_and_other_methods_hear_what_is_allowed() {
        let address = served("foretrace_up 0\n");
        let length = |answer: &str| {
            let line = answer.lines().find_map(|line| line.strip_prefix("Content-Length: ")).unwrap();
            line.parse::<usize>().unwrap()
        };
        for target in [
            "/metrics",
            "/metrics?name=up&x[]=%20",
            "/metrics?",
            "http://x:9184/metrics?a=b",
            "/other?/metrics",
        ] {
            let got = ask(address, format!("GET {target} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes());
            let (head, body) = got.split_once("\r\n\r\n").unwrap();
            let status = if target.starts_with("/other") { "HTTP/1.1 404" } else { "HTTP/1.1 200" };
            assert!(got.starts_with(status) && length(head) == body.len(), "{target}: {got}");
            let headed = ask(address, format!("HEAD {target} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes());
            assert_eq!(headed, format!("{head}\r\n\r\n"), "{target}");
        }
        let long = "x".repeat(300_000);
        for method in ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "BREW"] {
            for body in ["", "hi", &long] {
                let asked =
                    format!("{method} /metrics?x HTTP/1.1\r\nContent-Length: {}\r\n\r\n{body}", body.len());
                let got = ask(address, asked.as_bytes());
                assert!(got.starts_with("HTTP/1.1 405") && got.contains("\r\nAllow: GET, HEAD\r\n"), "{got}");
                assert!(got.ends_with("\r\n\r\nask for GET /metrics\n"), "{method}: {got}");
            }
        }
    }

    #[test]
    fn every_scrape_beside_peers_that_drip_and_come_again_is_answered() {
        // Fewer than one machine may have, and more.
        scraped_beside(12, Duration::from_millis(20));
        scraped_beside(OF_ONE + 8, Duration::from_millis(100));
    }

    fn scraped_beside(drippers: usize, pause: Duration) {
        let address = served("foretrace_up 0\n");
        let over = Arc::new(std::sync::atomic::AtomicBool::new(false));
        let drippers: Vec<_> = (0..drippers)
            .map(|_| {
                let over = over.clone();
                std::thread::spawn(move || {
                    while !over.load(std::sync::atomic::Ordering::Relaxed) {
                        let Ok(mut peer) = TcpStream::connect(address) else { continue };
                        while !over.load(std::sync::atomic::Ordering::Relaxed) && peer.write_all(b"G").is_ok()
                        {
                            std::thread::sleep(pause);
                        }
                    }
                })
            })
            .collect();
        for scrape in 0..45 {
            let reported = ask(address, SCRAPE);
            assert!(reported.starts_with("HTTP/1.1 200 OK"), "scrape {scrape}: {reported}");
            std::thread::sleep(Duration::from_millis(10));
        }
        over.store(true, std::sync::atomic::Ordering::Relaxed);
        for dripper in drippers {
            dripper.join().unwrap();
        }
    }

    #[test]
    fn bytes_that_drip_prolong_neither_question_nor_answer() {
        // More than the sockets' buffers hold.
        let address = served(&"x".repeat(64 << 20));
        let begin = Instant::now();
        let mut dripping = TcpStream::connect(address).unwrap();
        dripping.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        let mut end = [0];
        loop {
            // The end is a byte count of zero, or a reset.
            match dripping.write_all(b"a").and_then(|()| dripping.read(&mut end)) {
                Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => {
                }
                _ => break,
            }
            assert!(begin.elapsed() < Duration::from_secs(60));
        }
        assert!(begin.elapsed() >= HEAD_TIME);

        let mut sipping = TcpStream::connect(address).unwrap();
        sipping.write_all(SCRAPE).unwrap();
        let (begin, mut taken, mut room) = (Instant::now(), 0, vec![0; 1 << 16]);
        while let Ok(came @ 1..) = sipping.read(&mut room) {
            taken += came;
            std::thread::sleep(Duration::from_millis(100));
            assert!(begin.elapsed() < Duration::from_secs(60));
        }
        assert!(taken < 64 << 20, "{taken}");
        let reported = ask(address, b"GET / HTTP/1.1\r\n\r\n");
        assert!(reported.starts_with("HTTP/1.1 404"), "{reported}");
    }
}
