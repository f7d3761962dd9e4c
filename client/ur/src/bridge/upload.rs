//! Sends the program to the primary interface, and hears what the controller says about it.

use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use crate::primary::{Client, Package, Said};

/// Most packages that are looked at in one cycle.
const AT_ONCE: usize = 8;
/// Long enough to read what is there already.
const GLANCE: Duration = Duration::from_micros(500);
/// Longest words that are kept.
const LONGEST: usize = 200;

/// A program on its way. The connection is held while it begins: a controller may drop what came over one
/// that is closed.
#[derive(Debug)]
pub struct Upload {
    _stream: TcpStream,
    /// Messages come on every connection; without this one the program runs all the same.
    messages: Option<Client>,
}

impl Upload {
    /// Sends `text` to `primary` within `patience`.
    ///
    /// # Errors
    ///
    /// Where there is no connection, or it breaks.
    pub fn begin(primary: SocketAddr, text: &str, patience: Duration) -> std::io::Result<Self> {
        let messages = Client::connect(primary, patience).ok();
        let mut stream = TcpStream::connect_timeout(&primary, patience)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(patience))?;
        stream.write_all(text.as_bytes())?;
        Ok(Self { _stream: stream, messages })
    }

    /// What the controller says against the program, if anything came; waits for half a millisecond at most.
    pub fn objection(&mut self) -> Option<String> {
        for _ in 0..AT_ONCE {
            let received = self.messages.as_mut()?.receive(GLANCE);
            let Ok(Some(package)) = received else {
                if received.is_err() {
                    self.messages = None;
                }
                return None;
            };
            let Package::Message(message) = package else { continue };
            let words = match message.said {
                Said::RuntimeException { line, column, text } => {
                    format!("line {line}, column {column}: {text}")
                }
                Said::Code { code, argument, level, text } if level >= 3 => {
                    format!("C{code}A{argument}: {text}")
                }
                _ => continue,
            };
            return Some(words.chars().filter(|c| !c.is_control()).take(LONGEST).collect());
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primary::RobotMessage;
    use std::io::Read;
    use std::net::TcpListener;
    use std::thread;
    use std::time::Instant;

    #[test]
    fn program_arrives_whole_and_an_exception_is_heard() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let server = thread::spawn(move || {
            let (mut listening, _) = listener.accept().unwrap();
            let (mut sending, _) = listener.accept().unwrap();
            let mut text = [0; 9];
            sending.read_exact(&mut text).unwrap();
            for said in [
                Said::Text("hello".to_owned()),
                Said::RuntimeException { line: 3, column: 7, text: "unknown\u{7} name".to_owned() },
            ] {
                let message = RobotMessage { timestamp_us: 1, source: 7, said };
                listening.write_all(&Package::Message(message).encode()).unwrap();
            }
            (listening, text)
        });
        let mut upload = Upload::begin(address, "def a():\n", Duration::from_secs(5)).unwrap();
        let begin = Instant::now();
        let objection = loop {
            if let Some(objection) = upload.objection() {
                break objection;
            }
            assert!(begin.elapsed() < Duration::from_secs(20));
        };
        assert_eq!(objection, "line 3, column 7: unknown name");
        assert_eq!(server.join().unwrap().1, *b"def a():\n");
    }

    #[test]
    fn a_closed_port_is_told() {
        let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        assert!(Upload::begin(nobody, "x", Duration::from_secs(1)).is_err());
    }
}
