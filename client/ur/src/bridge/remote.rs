//! Watches, beside the bridge's own thread, whether the controller is in remote control.
//!
//! Contract: one question a second at most; a dashboard that is off or silent makes the answer unknown, never
//! a stop.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::dashboard::Dashboard;

const UNKNOWN: u8 = 0;
const REMOTE: u8 = 1;
const LOCAL: u8 = 2;

const EVERY: Duration = Duration::from_secs(1);
const PATIENCE: Duration = Duration::from_millis(800);

/// The watch; ends with its owner, within a second.
#[derive(Debug)]
pub struct RemoteWatch {
    seen: Arc<AtomicU8>,
    ended: Arc<AtomicBool>,
    /// Closed to wake the thread up.
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
        let (seen, ended) = (Arc::new(AtomicU8::new(UNKNOWN)), Arc::new(AtomicBool::new(false)));
        let (wake, woken) = mpsc::channel::<()>();
        let (told, over) = (seen.clone(), ended.clone());
        let thread = thread::Builder::new().name("ur-remote".to_owned()).spawn(move || {
            let mut dashboard = None;
            while !over.load(Ordering::Relaxed) {
                if dashboard.is_none() {
                    dashboard = Dashboard::connect(address, PATIENCE).ok();
                }
                let answer = dashboard.as_mut().and_then(|dashboard| dashboard.remote_control().ok());
                let word = match answer {
                    Some(Some(true)) => REMOTE,
                    Some(Some(false)) => LOCAL,
                    Some(None) => UNKNOWN,
                    None => {
                        dashboard = None;
                        UNKNOWN
                    }
                };
                told.store(word, Ordering::Relaxed);
                if !matches!(woken.recv_timeout(EVERY), Err(mpsc::RecvTimeoutError::Timeout)) {
                    return;
                }
            }
        })?;
        Ok(Self { seen, ended, wake: Some(wake), thread: Some(thread) })
    }

    /// What was heard last; `None`: not known.
    #[must_use]
    pub fn remote(&self) -> Option<bool> {
        match self.seen.load(Ordering::Relaxed) {
            REMOTE => Some(true),
            LOCAL => Some(false),
            _ => None,
        }
    }
}

impl Drop for RemoteWatch {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
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
