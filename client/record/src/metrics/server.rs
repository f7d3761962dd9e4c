//! The small server that hands out the newest text.
//!
//! Contract: it answers a bounded number of peers at a time, each within a bounded time as a whole, whatever
//! they send and however slowly. Where one machine, or all together, have no place left, the peer that has
//! been asking for longest gives way; one that has asked is answered. It holds no handle to the loop.

use std::fmt::Write as _;
use std::io::{self, Read as _, Write as _};
use std::net::{IpAddr, Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use foretrace_client::metered::machine;

/// Peers at a time.
const PEERS: usize = 48;
/// Of those, from one machine.
const OF_ONE: usize = 16;
/// How long a peer may take to ask, from the first byte to the last.
const ASKING: Duration = Duration::from_secs(2);
/// How long it may take to take the answer, all of it.
const TAKING: Duration = Duration::from_secs(5);
/// Bytes of a request at most.
const LONGEST_REQUEST: usize = 8192;

/// The newest text, shared with the server.
#[derive(Debug, Clone, Default)]
pub struct Board(Arc<Mutex<String>>);

impl Board {
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
pub fn serve(listener: TcpListener, board: Board) -> io::Result<()> {
    std::thread::Builder::new().name("foretrace-http".to_owned()).spawn(move || {
        let room = Arc::new(Room::default());
        for peer in listener.incoming() {
            let Ok(peer) = peer else {
                // No descriptor is left, for example: some peer ends.
                std::thread::sleep(Duration::from_millis(5));
                continue;
            };
            let Some(seat) = room.enter(&peer) else { continue };
            let board = board.clone();
            let answers = move || {
                let mut peer = peer;
                // A peer that went away has no use for an error.
                let _ = answer(&mut peer, &board, &seat);
                // Before the peer sees the end and comes again.
                drop(seat);
            };
            if std::thread::Builder::new().name("foretrace-peer".to_owned()).spawn(answers).is_err() {
                room.inside().turned_away += 1;
            }
        }
    })?;
    Ok(())
}

/// The peers that are there.
#[derive(Debug, Default)]
struct Room(Mutex<Inside>);

#[derive(Debug, Default)]
struct Inside {
    /// In the order in which they came.
    guests: Vec<Guest>,
    next: u64,
    gave_way: u64,
    turned_away: u64,
    timed_out: u64,
    too_long: u64,
}

#[derive(Debug)]
struct Guest {
    number: u64,
    machine: IpAddr,
    /// Its line, while it still asks.
    asking: Option<TcpStream>,
}

/// A place in the room; free again when it is dropped.
#[derive(Debug)]
struct Seat {
    room: Arc<Room>,
    number: u64,
}

impl Room {
    fn inside(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for `peer`, if need be that of one who still asks; none where all are being answered.
    fn enter(self: &Arc<Self>, peer: &TcpStream) -> Option<Seat> {
        let known = peer.peer_addr().and_then(|address| Ok((machine(address.ip()), peer.try_clone()?)));
        let mut inside = self.inside();
        let Ok((machine, line)) = known else {
            inside.turned_away += 1;
            return None;
        };
        let own = inside.guests.iter().filter(|guest| guest.machine == machine).count();
        let free = (own < OF_ONE || inside.give_way(Some(machine)))
            && (inside.guests.len() < PEERS || inside.give_way(None));
        if !free {
            inside.turned_away += 1;
            return None;
        }
        let number = inside.next;
        inside.next += 1;
        inside.guests.push(Guest { number, machine, asking: Some(line) });
        Some(Seat { room: self.clone(), number })
    }
}

impl Inside {
    /// Lets the one go that has been asking for longest, of one machine or of all.
    fn give_way(&mut self, of: Option<IpAddr>) -> bool {
        let asks =
            |guest: &Guest| guest.asking.is_some() && of.is_none_or(|machine| machine == guest.machine);
        let Some(oldest) = self.guests.iter().position(asks) else { return false };
        if let Some(line) = self.guests.remove(oldest).asking {
            // Its thread reads the end; it may be gone already.
            let _ = line.shutdown(Shutdown::Both);
        }
        self.gave_way += 1;
        true
    }
}

impl Seat {
    /// It has asked: it keeps its place until it is answered.
    fn asked(&self) {
        let mut inside = self.room.inside();
        if let Some(guest) = inside.guests.iter_mut().find(|guest| guest.number == self.number) {
            guest.asking = None;
        }
    }

    fn count(&self, error: &io::Error) {
        let mut inside = self.room.inside();
        match error.kind() {
            io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => inside.timed_out += 1,
            io::ErrorKind::InvalidData => inside.too_long += 1,
            // It went away, or had to.
            _ => {}
        }
    }

    /// What became of peers, as metrics.
    fn tally(&self) -> String {
        let inside = self.room.inside();
        let mut text =
            "# HELP foretrace_metrics_peers_refused_total Peers of these metrics that got no answer.\n\
                        # TYPE foretrace_metrics_peers_refused_total counter\n"
                .to_owned();
        for (reason, count) in [
            ("gave way", inside.gave_way),
            ("no place", inside.turned_away),
            ("too slow", inside.timed_out),
            ("too long", inside.too_long),
        ] {
            let _ = writeln!(text, "foretrace_metrics_peers_refused_total{{reason=\"{reason}\"}} {count}");
        }
        text
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.room.inside().guests.retain(|guest| guest.number != self.number);
    }
}

fn answer(peer: &mut TcpStream, board: &Board, seat: &Seat) -> io::Result<()> {
    let asked = heard(peer).inspect_err(|error| seat.count(error))?;
    seat.asked();
    let line = asked.split(|byte| *byte == b'\r').next().unwrap_or_default();
    let mut words = line.split(|byte| *byte == b' ');
    let (status, body) = match (words.next(), words.next()) {
        (Some(b"GET"), Some(b"/metrics")) => ("200 OK", board.text() + &seat.tally()),
        (Some(b"GET"), Some(_)) => ("404 Not Found", "metrics are at /metrics\n".to_owned()),
        _ => ("400 Bad Request", "ask for GET /metrics\n".to_owned()),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: \
         {}\r\nConnection: close\r\n\r\n",
        body.len()
    );
    told(peer, &[head.as_bytes(), body.as_bytes()].concat()).inspect_err(|error| seat.count(error))
}

/// The head of a request, or what came before its end.
fn heard(peer: &mut TcpStream) -> io::Result<Vec<u8>> {
    let until = Instant::now() + ASKING;
    let (mut asked, mut room) = (Vec::new(), [0; 1024]);
    while !asked.windows(4).any(|end| end == b"\r\n\r\n") {
        if asked.len() > LONGEST_REQUEST {
            return Err(io::ErrorKind::InvalidData.into());
        }
        peer.set_read_timeout(Some(left(until)?))?;
        let came = peer.read(&mut room)?;
        if came == 0 {
            break;
        }
        asked.extend_from_slice(room.get(..came).unwrap_or_default());
    }
    Ok(asked)
}

/// Writes all of it.
fn told(peer: &mut TcpStream, mut bytes: &[u8]) -> io::Result<()> {
    let until = Instant::now() + TAKING;
    while !bytes.is_empty() {
        peer.set_write_timeout(Some(left(until)?))?;
        let taken = peer.write(bytes)?;
        if taken == 0 {
            return Err(io::ErrorKind::WriteZero.into());
        }
        bytes = bytes.get(taken..).unwrap_or_default();
    }
    Ok(())
}

/// The time left; bytes that drip do not add to it.
fn left(until: Instant) -> io::Result<Duration> {
    let left = until.saturating_duration_since(Instant::now());
    if left.is_zero() { Err(io::ErrorKind::TimedOut.into()) } else { Ok(left) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::SocketAddr;

    fn served(text: &str) -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let board = Board::default();
        board.show(text.to_owned());
        serve(listener, board).unwrap();
        address
    }

    fn ask(address: SocketAddr, bytes: &[u8]) -> String {
        let mut peer = TcpStream::connect(address).unwrap();
        peer.write_all(bytes).unwrap();
        let mut told = String::new();
        peer.read_to_string(&mut told).unwrap();
        told
    }

    const SCRAPE: &[u8] = b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n";

    #[test]
    fn peers_of_any_kind_get_an_answer_or_are_left() {
        let address = served("foretrace_up 0\n");
        // Those who never ask hold up nobody, however many they are.
        let _silent: Vec<_> = (0..3 * OF_ONE).map(|_| TcpStream::connect(address).unwrap()).collect();
        let told = ask(address, SCRAPE);
        assert!(told.starts_with("HTTP/1.1 200 OK") && told.contains("\nforetrace_up 0\n"), "{told}");
        let gave_way = format!("refused_total{{reason=\"gave way\"}} {}\n", 2 * OF_ONE + 1);
        assert!(told.contains(&gave_way), "{told}");
        assert!(ask(address, b"GET / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404"));
        assert!(ask(address, b"\xff\xff\xff\r\n\r\n").starts_with("HTTP/1.1 400"));
        let mut endless = TcpStream::connect(address).unwrap();
        let begin = Instant::now();
        while endless.write_all(&[b'a'; 1024]).is_ok() {
            assert!(begin.elapsed() < Duration::from_secs(60));
        }
        let told = ask(address, SCRAPE);
        assert!(told.contains("refused_total{reason=\"too long\"} 1\n"), "{told}");
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
            let told = ask(address, SCRAPE);
            assert!(told.starts_with("HTTP/1.1 200 OK"), "scrape {scrape}: {told}");
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
        assert!(begin.elapsed() >= ASKING);

        let mut sipping = TcpStream::connect(address).unwrap();
        sipping.write_all(SCRAPE).unwrap();
        let (begin, mut taken, mut room) = (Instant::now(), 0, vec![0; 1 << 16]);
        while let Ok(came @ 1..) = sipping.read(&mut room) {
            taken += came;
            std::thread::sleep(Duration::from_millis(100));
            assert!(begin.elapsed() < Duration::from_secs(60));
        }
        assert!(taken < 64 << 20, "{taken}");
        let told = ask(address, b"GET / HTTP/1.1\r\n\r\n");
        assert!(told.starts_with("HTTP/1.1 404"), "{told}");
    }

    #[test]
    fn one_who_has_asked_keeps_its_place_and_one_machine_has_only_its_own() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let room = Arc::new(Room::default());
        let line = || {
            let peer = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let _other = listener.accept().unwrap();
            peer
        };
        let seats: Vec<_> = (0..OF_ONE).map(|_| room.enter(&line()).unwrap()).collect();
        seats[0].asked();
        let next = room.enter(&line()).unwrap();
        let numbers = |room: &Room| room.inside().guests.iter().map(|guest| guest.number).collect::<Vec<_>>();
        assert_eq!(numbers(&room), [&[0][..], &(2..=OF_ONE as u64).collect::<Vec<_>>()].concat());
        seats.iter().chain([&next]).for_each(Seat::asked);
        assert!(room.enter(&line()).is_none());
        drop((seats, next));
        let inside = room.inside();
        assert_eq!((inside.guests.len(), inside.gave_way, inside.turned_away), (0, 1, 1));
    }
}
