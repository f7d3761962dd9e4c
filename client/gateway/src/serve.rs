//! The gateway's connections: admits one client at a time and turns its bytes into samples.
//!
//! Contract: one thread, bounded memory, every wait bounded. The user is judged before a byte is read.
//! Whatever a client sends or leaves out, the gateway goes on; only a listener that fails ends it.

use std::io::{self, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use foretrace_serve::admission::Admission;
use foretrace_serve::frames::{FrameBuffer, Over};
use foretrace_shm::gateway::{BODY_BYTES, Frame, FrameError, WELCOME};
use foretrace_shm::{PenSample, peer_user};

use crate::holder::SlotHolder;
use crate::socket::GatewaySocket;
use crate::tally::{GatewayTally, Samples};

/// Longest wait for bytes of the client, and so between two looks at new connections.
const WAIT: Duration = Duration::from_millis(20);
/// A client over its rate is read no faster than once per this time.
const THROTTLE: Duration = Duration::from_millis(1);
/// Bytes read at once.
const CHUNK: usize = 4096;
/// Connections that are answered in one round.
const MOST_ACCEPTED: usize = 16;

#[derive(Debug, Clone)]
pub struct Policy {
    /// Users that may come in.
    pub allowed: Vec<u32>,
    /// Samples per second in the long run.
    pub rate: u32,
    /// Samples at once.
    pub burst: u32,
    /// Longest time from the first byte of a frame to its last.
    pub frame_time: Duration,
    /// A client of which nothing, or too little for a pen, passed for this long gives way to the next one
    /// that connects.
    pub silence: Duration,
}

/// What became of a sample that passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    Heard,
    Unheard,
    Failed,
}

#[derive(Debug)]
struct GatewayClient {
    stream: UnixStream,
    user: u32,
    frames: FrameBuffer,
    /// Since when a frame is not whole.
    half_since: Option<Instant>,
    holder: SlotHolder,
    samples: Samples,
}

/// The gateway; `Deliver` takes every sample that passes.
#[derive(Debug)]
pub struct Gateway<Deliver> {
    socket: GatewaySocket,
    policy: Policy,
    admission: Admission,
    client: Option<GatewayClient>,
    tally: GatewayTally,
    deliver: Deliver,
    now_ns: fn() -> u64,
}

impl<Deliver: FnMut(PenSample) -> Delivery> Gateway<Deliver> {
    /// A gateway behind `socket`; `now_ns`: the monotonic clock.
    pub fn new(socket: GatewaySocket, policy: Policy, deliver: Deliver, now_ns: fn() -> u64) -> Self {
        let admission = Admission::new(policy.rate, policy.burst, now_ns());
        Self { socket, policy, admission, client: None, tally: GatewayTally::default(), deliver, now_ns }
    }

    /// What came and went so far.
    pub fn tally(&self) -> &GatewayTally {
        &self.tally
    }

    /// The user that is in.
    pub fn user(&self) -> Option<u32> {
        self.client.as_ref().map(|client| client.user)
    }

    /// One round: answers new connections, then waits for bytes of the client, at most `WAIT`.
    ///
    /// # Errors
    ///
    /// The socket takes no clients any more.
    pub fn round(&mut self) -> io::Result<()> {
        for _ in 0..MOST_ACCEPTED {
            match self.socket.accept()? {
                Some(stream) => self.answer(stream),
                None => break,
            }
        }
        match self.client.take() {
            None => std::thread::sleep(WAIT / 2),
            Some(mut client) => match self.hear(&mut client) {
                None => self.client = Some(client),
                Some(reason) => self.end(client, reason),
            },
        }
        Ok(())
    }

    /// Ends the connection and gives the last counts.
    pub fn close(mut self) -> GatewayTally {
        if let Some(client) = self.client.take() {
            self.end(client, "the gateway ends");
        }
        self.tally
    }

    /// Lets a client in or turns it away.
    fn answer(&mut self, mut stream: UnixStream) {
        let timeouts =
            stream.set_read_timeout(Some(WAIT)).and_then(|()| stream.set_write_timeout(Some(WAIT)));
        let user = timeouts.and_then(|()| peer_user(&stream));
        let refusal = match user {
            Err(_) => Some("user unknown"),
            Ok(user) if !self.policy.allowed.contains(&user) => Some("user not allowed"),
            Ok(_) => self.refuse_a_second(),
        };
        match (refusal, user) {
            (None, Ok(user)) if say(&mut stream, WELCOME).is_ok() => {
                self.tally.clients = self.tally.clients.saturating_add(1);
                self.client = Some(GatewayClient {
                    stream,
                    user,
                    frames: FrameBuffer::new(BODY_BYTES..=BODY_BYTES),
                    half_since: None,
                    holder: SlotHolder::new(Instant::now()),
                    samples: Samples::default(),
                });
            }
            (refusal, user) => {
                let reason = refusal.unwrap_or("gone before it was let in");
                self.tally.turned_away.count(reason);
                let who = user.map_or_else(|_| String::new(), |user| format!(" (user {user})"));
                // A client that is turned away need not read the reason.
                let _ = say(&mut stream, &format!("foretrace-gateway 1 refused: {reason}{who}"));
            }
        }
    }

    /// Keeps the place for the connected client, unless it is silent.
    fn refuse_a_second(&mut self) -> Option<&'static str> {
        let client = self.client.take()?;
        match client.holder.gives_way(Instant::now(), self.policy.silence) {
            None => {
                self.client = Some(client);
                Some("another client is connected")
            }
            Some(reason) => {
                self.end(client, reason);
                None
            }
        }
    }

    /// Takes what the client has sent; a reason when the connection is over.
    fn hear(&mut self, client: &mut GatewayClient) -> Option<&'static str> {
        match client.frames.read_once(&mut client.stream, CHUNK) {
            Ok(_) => {}
            Err(Over::Ended) if client.frames.pending() > 0 => return Some("ended inside a frame"),
            Err(Over::Ended) => return Some("ended by the client"),
            Err(_) => return Some("the connection broke"),
        }
        let before = client.samples.refused.total();
        loop {
            let frame = match client.frames.next_frame() {
                Ok(None) => break,
                Ok(Some(body)) => Frame::decode(body),
                Err(Over::Length(length)) => Err(FrameError::Length(length)),
                Err(_) => return Some("the connection broke"),
            };
            match frame {
                Ok(frame) => {
                    client.half_since = None;
                    self.take(client, frame.0);
                }
                Err(error) => return Some(frame_reason(error)),
            }
        }
        if client.frames.pending() > 0 {
            let since = *client.half_since.get_or_insert_with(Instant::now);
            if since.elapsed() > self.policy.frame_time {
                return Some("too slow with a frame");
            }
        }
        if client.samples.refused.total() > before {
            std::thread::sleep(THROTTLE);
        }
        None
    }

    /// Judges one sample and passes it on.
    fn take(&mut self, client: &mut GatewayClient, sample: PenSample) {
        let both = [&mut client.samples, &mut self.tally.samples];
        if let Err(refusal) = self.admission.judge(&sample, (self.now_ns)()) {
            both.into_iter().for_each(|samples| samples.refused.count(refusal.label()));
            return;
        }
        client.holder.pass(Instant::now());
        let delivery = (self.deliver)(sample);
        for samples in both {
            match delivery {
                Delivery::Heard => samples.passed += 1,
                Delivery::Unheard => {
                    samples.passed += 1;
                    samples.unheard += 1;
                }
                Delivery::Failed => samples.failed += 1,
            }
        }
    }

    fn end(&mut self, mut client: GatewayClient, reason: &'static str) {
        self.tally.ended.count(reason);
        // It may be gone, or not reading.
        let _ = say(&mut client.stream, &format!("foretrace-gateway 1 closed: {reason}; {}", client.samples));
        let _ = client.stream.shutdown(Shutdown::Both);
    }
}

/// Reasons as counted, without the numbers of the broken frame.
const fn frame_reason(error: FrameError) -> &'static str {
    match error {
        FrameError::Length(_) => "wrong frame length",
        FrameError::Version(_) => "wrong protocol version",
        FrameError::Kind(_) => "unknown kind of frame",
        FrameError::Reserved(_) => "reserved field in use",
    }
}

fn say(stream: &mut UnixStream, words: &str) -> io::Result<()> {
    stream.write_all(format!("{words}\n").as_bytes())
}

#[cfg(test)]
mod tests;
