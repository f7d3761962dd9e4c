//! Log messages, written by a separate thread, so that no other thread waits for their reader.
//!
//! Contract: a stopped terminal, a pager, or a full pipe holds up this thread only. Up to [`WAITING`]
//! messages wait; further ones are lost, and their number is written next.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};
use foretrace_config::plain_log;
use tracing_subscriber::fmt::MakeWriter;

use crate::rt::os::leave_stops_to_the_loop;

/// Messages that may wait: some seconds of frequent messages.
const WAITING: usize = 1024;
/// Time for which an ending program waits for its last messages to be written.
const PATIENCE: Duration = Duration::from_millis(500);

enum LogItem {
    Line(Vec<u8>),
    /// Answered when everything before it has been written.
    Mark(Sender<()>),
}

/// Handle of the writer; clones write to the same.
#[derive(Debug, Clone)]
pub(crate) struct Messages {
    items: Sender<LogItem>,
    lost: Arc<AtomicU64>,
}

/// Waits, when dropped, until all messages before it have been written, for a bounded time.
#[derive(Debug)]
#[must_use = "the last messages of a program are lost without it"]
pub struct LogGuard(Messages);

impl Messages {
    /// A thread that writes to `out`.
    ///
    /// # Errors
    ///
    /// The system starts no thread.
    pub(crate) fn to(out: impl Write + Send + 'static) -> io::Result<(Self, LogGuard)> {
        let (sender, items) = bounded(WAITING);
        let messages = Self { items: sender, lost: Arc::default() };
        let lost = messages.lost.clone();
        std::thread::Builder::new().name("foretrace-log".into()).stack_size(128 * 1024).spawn(move || {
            leave_stops_to_the_loop();
            write_all(&items, &lost, out);
        })?;
        Ok((messages.clone(), LogGuard(messages)))
    }
}

fn write_all(items: &Receiver<LogItem>, lost: &AtomicU64, mut out: impl Write) {
    for item in items {
        let missing = lost.swap(0, Ordering::Relaxed);
        // An error of the output cannot be reported anywhere.
        if missing > 0 {
            let _ = writeln!(out, "{missing} messages lost: the output was blocked");
        }
        match item {
            LogItem::Line(line) => drop(out.write_all(&line)),
            LogItem::Mark(done) => {
                let _ = out.flush();
                let _ = done.try_send(());
            }
        }
    }
}

impl Write for Messages {
    /// Takes a whole message; the subscriber writes each in one call.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = self
            .items
            .try_send(LogItem::Line(plain_log(&String::from_utf8_lossy(line)).into_owned().into_bytes()))
        {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<'a> MakeWriter<'a> for Messages {
    type Writer = Self;

    fn make_writer(&'a self) -> Self {
        self.clone()
    }
}

impl Drop for LogGuard {
    fn drop(&mut self) {
        let (done, written) = bounded(1);
        if self.0.items.send_timeout(LogItem::Mark(done), PATIENCE).is_ok() {
            let _ = written.recv_timeout(PATIENCE);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::time::Instant;

    use super::*;

    /// Accepts nothing while `stopped` is locked.
    #[derive(Clone, Default)]
    struct Reader {
        stopped: Arc<Mutex<()>>,
        read: Arc<Mutex<Vec<u8>>>,
    }

    impl Write for Reader {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _gate = self.stopped.lock().unwrap();
            self.read.lock().unwrap().write(bytes)
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn nobody_waits_for_a_reader_that_does_not_read_and_what_is_lost_is_reported() {
        let reader = Reader::default();
        let (mut messages, guard) = Messages::to(reader.clone()).unwrap();
        let gate = reader.stopped.lock().unwrap();
        let sent = WAITING + 500;
        for number in 0..sent {
            messages.write_all(format!("message {number}\n").as_bytes()).unwrap();
        }
        let since = Instant::now();
        drop(guard);
        assert!(since.elapsed() < Duration::from_secs(20), "waited for a reader that never comes");
        drop(gate);
        let (_, last) = (messages.write(b"later\n").unwrap(), LogGuard(messages));
        drop(last);
        let text = String::from_utf8(reader.read.lock().unwrap().clone()).unwrap();
        let mut kept = text.lines().filter(|line| line.starts_with("message "));
        assert_eq!(kept.next(), Some("message 0"));
        let written = 1 + kept.count();
        let lost: usize = text
            .lines()
            .filter_map(|line| {
                line.strip_suffix(" messages lost: the output was blocked")?.parse::<usize>().ok()
            })
            .sum();
        assert!(written >= WAITING, "{written}");
        // The very last messages may be pending when this ends.
        assert!(
            written + lost + usize::from(text.contains("later")) >= sent,
            "{written} written, {lost} lost"
        );
    }

    #[test]
    fn what_a_terminal_acts_upon_is_written_out_in_the_log_too() {
        let reader = Reader::default();
        let (mut messages, guard) = Messages::to(reader.clone()).unwrap();
        let _ = messages.write("file a\u{202e}b\u{9b}31m\rc\n".as_bytes()).unwrap();
        drop(guard);
        let text = String::from_utf8(reader.read.lock().unwrap().clone()).unwrap();
        assert_eq!(text, "file a\\u202Eb\\u009B31m\\u000Dc\n");
    }

    #[test]
    fn guard_waits_for_the_last_message() {
        let reader = Reader::default();
        let (mut messages, guard) = Messages::to(reader.clone()).unwrap();
        for number in 0..200 {
            messages.write_all(format!("{number}\n").as_bytes()).unwrap();
        }
        drop(guard);
        let text = String::from_utf8(reader.read.lock().unwrap().clone()).unwrap();
        assert!(text.ends_with("199\n") && text.lines().count() == 200, "{text}");
    }
}
