//! Watches, beside the bridge's own thread, whether the controller is in remote control.
//!
//! Contract: one question a second at most; a dashboard that is off or silent makes the answer unknown, never
//! a stop.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::dashboard::Dashboard;

const EVERY: Duration = Duration::from_secs(1);
const PATIENCE: Duration = Duration::from_millis(800);

/// The watch; ends with its owner, within a second.
#[derive(Debug)]
pub struct RemoteWatch {
    newest: Arc<Mutex<Option<bool>>>,
    /// Closed to end the thread.
    wake: Option<mpsc::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl RemoteWatch {
    /// Begins to ask the dashboard at `address`.
    ///
    /// # Errors
    ///
    /// Where the system gives no thread.
    pub fn begin(address: SocketAddr) -> std::io::Result<Self> {
        let newest = Arc::new(Mutex::new(None));
        let (wake, woken) = mpsc::channel::<()>();
        let answers = newest.clone();
        let thread = thread::Builder::new().name("ur-remote".to_owned()).spawn(move || {
            let mut dashboard = None;
            loop {
                if dashboard.is_none() {
                    dashboard = Dashboard::connect(address, PATIENCE).ok();
                }
                let answer = dashboard.as_mut().and_then(|dashboard| dashboard.remote_control().ok());
                if answer.is_none() {
                    dashboard = None;
                }
                *answers.lock().unwrap_or_else(PoisonError::into_inner) = answer.flatten();
                if !matches!(woken.recv_timeout(EVERY), Err(mpsc::RecvTimeoutError::Timeout)) {
                    return;
                }
            }
        })?;
        Ok(Self { newest, wake: Some(wake), thread: Some(thread) })
    }

    /// The newest answer; `None`: not known.
    #[must_use]
    pub fn remote(&self) -> Option<bool> {
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for RemoteWatch {
    fn drop(&mut self) {
        drop(self.wake.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader, Write};
    use std::net::TcpListener;
    use std::time::Instant;

    #[test]
    fn answers_are_heard_and_a_dashboard_that_goes_away_makes_them_unknown() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let server = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.write_all(b"hello\n").unwrap();
            let mut line = String::new();
            BufReader::new(stream.try_clone().unwrap()).read_line(&mut line).unwrap();
            stream.write_all(b"false\n").unwrap();
            assert_eq!(line, "is in remote control\n");
            thread::sleep(Duration::from_millis(300));
        });
        let watch = RemoteWatch::begin(address).unwrap();
        let until = |wanted: Option<bool>| {
            let begin = Instant::now();
            while watch.remote() != wanted && begin.elapsed() < Duration::from_secs(20) {
                thread::sleep(Duration::from_millis(10));
            }
            assert_eq!(watch.remote(), wanted);
        };
        until(Some(false));
        server.join().unwrap();
        until(None);
    }

    #[test]
    fn without_a_dashboard_nothing_is_known() {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        assert_eq!(RemoteWatch::begin(port).unwrap().remote(), None);
    }
}
