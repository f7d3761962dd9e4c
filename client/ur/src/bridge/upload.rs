//! Sends the program to the primary interface, and hears what the controller says about it, on a thread of
//! its own.
//!
//! Contract: nobody who asks here waits for the controller. The connection that sends is the one that is
//! read, so that nothing fills up unread, and it is held while the program runs: a controller may drop what
//! came over one that is closed.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use crate::primary::{MessageContent, PrimaryClient, PrimaryError, PrimaryPackage};

/// Between two looks at whether all is over.
const LOOK: Duration = Duration::from_millis(100);
/// Longest words that are kept.
const LONGEST: usize = 200;
/// Words that wait to be heard; beyond them the controller's own wait in the socket.
const WAITING: usize = 32;

/// What came of a program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum UploadEvent {
    /// The program ended by an error of its own.
    Exception(String),
    /// The controller tells something grave that need not be the program's.
    Warning(String),
    /// The program could not be sent, or its connection broke.
    Lost(String),
}

/// A program on its way, or running.
#[derive(Debug)]
pub struct Upload {
    heard: Receiver<UploadEvent>,
    over: Arc<AtomicBool>,
}

impl Upload {
    /// Begins to send `text` to `primary`; each step may take `patience`.
    ///
    /// # Errors
    ///
    /// Where the system gives no thread. That there is no connection is heard later.
    pub fn begin(primary: SocketAddr, text: String, patience: Duration) -> std::io::Result<Self> {
        let (tell, heard) = sync_channel(WAITING);
        let over = Arc::new(AtomicBool::new(false));
        let ends = over.clone();
        thread::Builder::new().name("ur-program".to_owned()).spawn(move || {
            if let Err(error) = deliver(primary, &text, patience, &tell, &ends) {
                // Nobody may be left to hear it.
                let _ = tell.send(UploadEvent::Lost(error));
            }
        })?;
        Ok(Self { heard, over })
    }

    /// The oldest thing that was not heard yet; never waits.
    pub fn heard(&mut self) -> Option<UploadEvent> {
        self.heard.try_recv().ok()
    }
}

impl Drop for Upload {
    fn drop(&mut self) {
        // Not waited for: who drops this has a cycle to keep.
        self.over.store(true, Ordering::Relaxed);
    }
}

/// Sends, then listens until nobody wants to hear any more. The words of an error are for readers.
fn deliver(
    primary: SocketAddr,
    text: &str,
    patience: Duration,
    tell: &SyncSender<UploadEvent>,
    over: &AtomicBool,
) -> Result<(), String> {
    let unsent = |error: PrimaryError| format!("the program could not be sent to port 30001: {error}");
    let mut client = PrimaryClient::connect(primary, patience).map_err(unsent)?;
    client.send(text.as_bytes()).map_err(unsent)?;
    while !over.load(Ordering::Relaxed) {
        let received = client.receive(LOOK).map_err(|error| format!("port 30001: {error}"))?;
        let Some(PrimaryPackage::Message(message)) = received else { continue };
        let plain = |words: String| words.chars().filter(|c| !c.is_control()).take(LONGEST).collect();
        let heard = match message.content {
            MessageContent::RuntimeException { line, column, text } => {
                UploadEvent::Exception(plain(format!("line {line}, column {column}: {text}")))
            }
            MessageContent::Code { code, argument, level, text } if level >= 3 => {
                UploadEvent::Warning(plain(format!("C{code}A{argument}: {text}")))
            }
            _ => continue,
        };
        if tell.send(heard).is_err() {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primary::RobotMessage;
    use std::io::{Read, Write};
    use std::net::TcpListener;
    use std::time::Instant;

    const LONG: Duration = Duration::from_secs(20);

    fn heard(upload: &mut Upload) -> UploadEvent {
        let begin = Instant::now();
        loop {
            if let Some(heard) = upload.heard() {
                return heard;
            }
            assert!(begin.elapsed() < LONG);
            thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn program_arrives_whole_and_what_is_said_on_its_connection_is_heard() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let server = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut text = [0; 9];
            stream.read_exact(&mut text).unwrap();
            for content in [
                MessageContent::Text("hello".to_owned()),
                MessageContent::Code {
                    code: 210,
                    argument: 3,
                    level: 3,
                    text: "the cover is open".to_owned(),
                },
                MessageContent::RuntimeException { line: 3, column: 7, text: "unknown\u{7} name".to_owned() },
            ] {
                let message = RobotMessage { timestamp_us: 1, source: 7, content };
                stream.write_all(&PrimaryPackage::Message(message).encode()).unwrap();
            }
            // The only connection: nothing is left unread on another one.
            listener.set_nonblocking(true).unwrap();
            (listener.accept().is_err(), stream, text)
        });
        let mut upload = Upload::begin(address, "def a():\n".to_owned(), LONG).unwrap();
        assert_eq!(heard(&mut upload), UploadEvent::Warning("C210A3: the cover is open".to_owned()));
        assert_eq!(heard(&mut upload), UploadEvent::Exception("line 3, column 7: unknown name".to_owned()));
        let (alone, _stream, text) = server.join().unwrap();
        assert!(alone);
        assert_eq!(text, *b"def a():\n");
    }

    #[test]
    fn what_the_controller_goes_on_sending_is_read_and_does_not_fill_up() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let server = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.set_write_timeout(Some(LONG)).unwrap();
            let content = MessageContent::Text("x".repeat(1000));
            let state =
                PrimaryPackage::Message(RobotMessage { timestamp_us: 1, source: 7, content }).encode();
            // Far more than the buffers of both ends hold.
            (0..20_000).all(|_| stream.write_all(&state).is_ok())
        });
        let upload = Upload::begin(address, "def a():\n".to_owned(), LONG).unwrap();
        assert!(server.join().unwrap());
        drop(upload);
    }

    #[test]
    fn a_closed_port_is_reported() {
        let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let mut upload = Upload::begin(nobody, "x".to_owned(), Duration::from_secs(1)).unwrap();
        let UploadEvent::Lost(words) = heard(&mut upload) else { panic!() };
        assert!(words.contains("could not be sent to port 30001"), "{words}");
    }
}
