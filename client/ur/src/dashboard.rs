//! The dashboard (port 29999): commands and answers as lines of text.
//!
//! Contract: every wait and every line is bounded; after an error the connection is of no use any more.
//! Nothing here powers an arm on, releases brakes or ends a safety stop: those are an operator's acts.
//!
//! *Source*: dashboard server guides of CB3 and e-Series; PolyScope X has no such server.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

pub const PORT: u16 = 29999;

/// The end of the version of a `foretrace ur-sim`, and of no other controller.
pub const SIMULATED: &str = "(simulated)";

/// Longest line that is read.
const LONGEST_LINE: usize = 1024;

/// Why the dashboard gave no answer.
#[derive(Debug, thiserror::Error)]
pub enum DashboardError {
    /// No connection; the kind tells refusal from silence.
    #[error("no connection to the dashboard: {0}")]
    Connect(std::io::Error),
    /// The connection broke.
    #[error("the dashboard's connection broke: {0}")]
    Broken(std::io::Error),
    /// It was closed from the other side.
    #[error("the dashboard closed the connection")]
    Closed,
    /// No whole line in time.
    #[error("the dashboard gave no answer within {0:?}")]
    Silent(Duration),
    /// A line without an end.
    #[error("the dashboard's answer is longer than {LONGEST_LINE} bytes")]
    TooLong,
    /// Not one line of plain text.
    #[error("{0:?} is not one line of plain text")]
    Command(String),
}

/// A connection to the dashboard.
#[derive(Debug)]
pub struct Dashboard {
    stream: TcpStream,
    read: Vec<u8>,
    patience: Duration,
    greeting: String,
}

impl Dashboard {
    /// Connects and waits for the greeting, each for `patience` at most.
    ///
    /// # Errors
    ///
    /// See [`DashboardError`].
    pub fn connect(address: SocketAddr, patience: Duration) -> Result<Self, DashboardError> {
        let stream = crate::connect(address, patience).map_err(DashboardError::Connect)?;
        let mut dashboard = Self { stream, read: Vec::new(), patience, greeting: String::new() };
        dashboard.greeting = dashboard.line()?;
        Ok(dashboard)
    }

    /// The line with which the server introduced itself.
    #[must_use]
    pub fn greeting(&self) -> &str {
        &self.greeting
    }

    /// Sends one command and returns the line that answers it.
    ///
    /// # Errors
    ///
    /// See [`DashboardError`].
    pub fn ask(&mut self, command: &str) -> Result<String, DashboardError> {
        let plain = command.bytes().all(|byte| (0x20..0x7f).contains(&byte));
        if command.is_empty() || !plain || command.len() > LONGEST_LINE {
            return Err(DashboardError::Command(command.chars().take(60).collect()));
        }
        // An answer that came too late for its own question must not answer this one.
        self.forget_late_answers()?;
        self.stream.write_all(format!("{command}\n").as_bytes()).map_err(DashboardError::Broken)?;
        self.line()
    }

    /// Whether the controller is in remote control; `None` where its version does not know (CB3, e-Series
    /// before 5.6).
    ///
    /// # Errors
    ///
    /// See [`DashboardError`].
    pub fn remote_control(&mut self) -> Result<Option<bool>, DashboardError> {
        let answer = self.ask("is in remote control")?.to_ascii_lowercase();
        Ok(match answer.trim() {
            "true" => Some(true),
            "false" => Some(false),
            _ => None,
        })
    }

    fn forget_late_answers(&mut self) -> Result<(), DashboardError> {
        self.read.clear();
        self.stream.set_nonblocking(true).map_err(DashboardError::Broken)?;
        let mut scrap = [0; 256];
        // Bounded: a server that never stops talking is not listened to.
        let came = (0..16).try_for_each(|_| match self.stream.read(&mut scrap) {
            Ok(0) => Err(Some(DashboardError::Closed)),
            Ok(_) => Ok(()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => Err(None),
            Err(error) => Err(Some(DashboardError::Broken(error))),
        });
        self.stream.set_nonblocking(false).map_err(DashboardError::Broken)?;
        came.err().flatten().map_or(Ok(()), Err)
    }

    /// The next line, without its end, control characters left out.
    fn line(&mut self) -> Result<String, DashboardError> {
        let end = Instant::now() + self.patience;
        loop {
            let end_of_line = self.read.iter().position(|byte| *byte == b'\n');
            if let Some(at) = end_of_line.filter(|at| *at <= LONGEST_LINE) {
                let line: Vec<u8> = self.read.drain(..=at).collect();
                let text = String::from_utf8_lossy(&line);
                return Ok(text.chars().filter(|c| !c.is_control()).collect());
            }
            if self.read.len() > LONGEST_LINE {
                return Err(DashboardError::TooLong);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(DashboardError::Silent(self.patience));
            }
            self.stream.set_read_timeout(Some(left)).map_err(DashboardError::Broken)?;
            let mut some = [0; 256];
            match self.stream.read(&mut some) {
                Ok(0) => return Err(DashboardError::Closed),
                Ok(count) => self.read.extend(some.iter().take(count)),
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {}
                    _ => return Err(DashboardError::Broken(error)),
                },
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader};
    use std::net::TcpListener;
    use std::thread::{self, JoinHandle};

    use proptest::prelude::*;

    const SOON: Duration = Duration::from_millis(300);

    /// A server for one connection that is given to `talk`.
    fn server(talk: impl FnOnce(TcpStream) + Send + 'static) -> (SocketAddr, JoinHandle<()>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        (address, thread::spawn(move || talk(listener.accept().unwrap().0)))
    }

    /// A server that greets and answers every line with `answer`.
    fn answering(answer: &'static str) -> (SocketAddr, JoinHandle<()>) {
        server(move |mut stream| {
            stream.write_all(b"Connected: Universal Robots Dashboard Server\n").unwrap();
            let lines = BufReader::new(stream.try_clone().unwrap()).lines();
            for _ in lines.map_while(Result::ok) {
                stream.write_all(answer.as_bytes()).unwrap();
            }
        })
    }

    #[test]
    fn greeting_is_read_before_the_first_answer() {
        let (address, _) = answering("Robotmode: RUNNING\r\n");
        let mut dashboard = Dashboard::connect(address, SOON).unwrap();
        assert!(dashboard.greeting().starts_with("Connected:"));
        assert_eq!(dashboard.ask("robotmode").unwrap(), "Robotmode: RUNNING");
    }

    #[test]
    fn remote_control_is_true_false_or_unknown_to_the_version() {
        for (answer, meant) in
            [("true\n", Some(true)), ("False\n", Some(false)), ("could not understand: ...\n", None)]
        {
            let (address, _) = answering(answer);
            assert_eq!(Dashboard::connect(address, SOON).unwrap().remote_control().unwrap(), meant);
        }
    }

    #[test]
    fn a_server_that_says_nothing_is_given_up() {
        let (address, _) = server(|stream| {
            thread::sleep(2 * SOON);
            drop(stream);
        });
        assert!(matches!(Dashboard::connect(address, SOON), Err(DashboardError::Silent(_))));
    }

    #[test]
    fn a_line_without_end_is_given_up() {
        let (address, _) = server(|mut stream| while stream.write_all(&[b'x'; 4096]).is_ok() {});
        assert!(matches!(Dashboard::connect(address, SOON), Err(DashboardError::TooLong)));
    }

    #[test]
    fn a_server_that_goes_away_is_reported() {
        let (address, _) = server(|mut stream| stream.write_all(b"hello\n").unwrap());
        let mut dashboard = Dashboard::connect(address, SOON).unwrap();
        let refused = (0..3).map(|_| dashboard.ask("robotmode")).find_map(Result::err).unwrap();
        assert!(matches!(refused, DashboardError::Closed | DashboardError::Broken(_)), "{refused}");
    }

    #[test]
    fn an_answer_that_came_late_does_not_answer_the_next_question() {
        let (address, server) = server(|mut stream| {
            stream.write_all(b"hello\n").unwrap();
            let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
            lines.next();
            thread::sleep(SOON + SOON / 2);
            stream.write_all(b"late\n").unwrap();
            lines.next();
            stream.write_all(b"right\n").unwrap();
        });
        let mut dashboard = Dashboard::connect(address, SOON).unwrap();
        assert!(matches!(dashboard.ask("one"), Err(DashboardError::Silent(_))));
        thread::sleep(SOON);
        assert_eq!(dashboard.ask("two").unwrap(), "right");
        server.join().unwrap();
    }

    #[test]
    fn commands_of_several_lines_are_refused() {
        let (address, _) = answering("x\n");
        let mut dashboard = Dashboard::connect(address, SOON).unwrap();
        for command in ["", "play\nstop", "päuse", "a\0b"] {
            assert!(matches!(dashboard.ask(command), Err(DashboardError::Command(_))), "{command:?}");
        }
    }

    /// A case is a connection, and a port is not used again for a minute.
    const MOST_CONNECTIONS: u32 = 5000;

    fn cases() -> ProptestConfig {
        let cases = crate::fuzz::cases(200);
        ProptestConfig { cases: cases.cases.min(MOST_CONNECTIONS), ..cases }
    }

    proptest! {
        #![proptest_config(cases())]

        #[test]
        fn hostile_servers_are_answered_by_plain_lines_or_left(
            pieces in prop::collection::vec(prop_oneof![
                Just(b"Connected: Universal Robots Dashboard Server\n".to_vec()),
                Just(b"true\n".to_vec()),
                Just(b"\n".to_vec()),
                prop::collection::vec(any::<u8>(), 0..100),
                (any::<u8>(), 0usize..3000).prop_map(|(byte, length)| vec![byte; length]),
            ], 0..8),
            pauses in any::<bool>(),
        ) {
            let (address, server) = server(move |mut stream| {
                for piece in pieces {
                    // It may be left amid the bytes.
                    if stream.write_all(&piece).is_err() {
                        return;
                    }
                    if pauses {
                        thread::yield_now();
                    }
                }
            });
            // The server leaves: nobody waits for it until patience ends.
            if let Ok(mut dashboard) = Dashboard::connect(address, 100 * SOON) {
                prop_assert!(plain(dashboard.greeting()));
                let answers = ["robotmode", "programState"].map(|command| dashboard.ask(command));
                for answer in answers {
                    match answer {
                        Ok(line) => prop_assert!(plain(&line), "{line:?}"),
                        Err(DashboardError::Silent(_)) => prop_assert!(false, "it waited for nobody"),
                        Err(_) => {}
                    }
                }
                prop_assert!(!matches!(dashboard.remote_control(), Err(DashboardError::Silent(_))));
            }
            server.join().unwrap();
        }
    }

    fn plain(line: &str) -> bool {
        line.len() <= 3 * LONGEST_LINE && line.chars().all(|c| !c.is_control())
    }

    #[test]
    fn bytes_that_are_no_text_are_survived() {
        let (address, _) = server(|mut stream| {
            stream.write_all(&[0xff, 0xfe, 0, 7, b'\n', 0x80, b'\n']).unwrap();
            thread::sleep(SOON);
        });
        let dashboard = Dashboard::connect(address, SOON).unwrap();
        assert!(dashboard.greeting().chars().all(|c| !c.is_control()));
    }
}
