//! Progress of a long command and the time left: always on stderr, never in the result.
//!
//! Contract: a bar in place on a terminal, else a line every ten seconds, also while a single step lasts
//! longer. Steps may come from any thread. Prints nothing for a command that ends within ten seconds, and
//! nothing after the end.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::output::{may_draw, note};

/// Time between two lines without a terminal.
const EVERY: Duration = Duration::from_secs(10);
/// Between two looks of a bar at its clock.
const TICK: Duration = Duration::from_millis(500);

/// Steps of a long command, shown until it is dropped.
#[derive(Debug)]
pub(crate) enum StepProgress {
    Bar(ProgressBar),
    Lines(ProgressLines),
}

impl StepProgress {
    /// `steps` steps of `what`, all of about the same length.
    pub(crate) fn of(what: &'static str, steps: usize) -> Self {
        if !may_draw() {
            return Self::Lines(ProgressLines::begin(steps, EVERY, move |words| note!("{what}: {words}")));
        }
        let bar = ProgressBar::new(steps as u64).with_prefix(what);
        let style = ProgressStyle::with_template("{prefix} [{wide_bar}] {percent} %, {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.enable_steady_tick(TICK);
        Self::Bar(bar)
    }

    /// One step is done.
    pub(crate) fn step(&self) {
        match self {
            Self::Bar(bar) => bar.inc(1),
            Self::Lines(lines) => {
                lines.done.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

impl Drop for StepProgress {
    fn drop(&mut self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// A thread that prints the progress from time to time.
#[derive(Debug)]
pub(crate) struct ProgressLines {
    done: Arc<AtomicUsize>,
    /// Steps of an earlier run, which do not count for the speed of this one.
    before: Arc<AtomicUsize>,
    end: Option<Sender<()>>,
    reporter: Option<JoinHandle<()>>,
}

impl ProgressLines {
    fn begin(steps: usize, every: Duration, tell: impl Fn(&str) + Send + 'static) -> Self {
        let (done, before) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let (counted, skipped) = (done.clone(), before.clone());
        let (end, ended) = mpsc::channel();
        let since = Instant::now();
        let reports = move || {
            while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                let (done, before) = (counted.load(Ordering::Relaxed), skipped.load(Ordering::Relaxed));
                tell(&words(done, before, steps, since.elapsed()));
            }
        };
        // Without the thread the command works, but is silent.
        let reporter = std::thread::Builder::new().name("foretrace-tells".to_owned()).spawn(reports).ok();
        Self { done, before, end: Some(end), reporter }
    }
}

impl ProgressLines {
    /// `count` steps were done before.
    pub(crate) fn skip(&self, count: usize) {
        self.done.fetch_add(count, Ordering::Relaxed);
        self.before.fetch_add(count, Ordering::Relaxed);
    }
}

impl Drop for ProgressLines {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(reporter) = self.reporter.take() {
            // A failed thread has nothing more to print.
            let _ = reporter.join();
        }
    }
}

/// `37 % done after 20 s, about 34 s left`; `done` of `steps`, `before` of them not in this run.
fn words(done: usize, before: usize, steps: usize, elapsed: Duration) -> String {
    let share = 100 * done.min(steps) / steps.max(1);
    let after = spoken(elapsed);
    let (here, left) = (done.saturating_sub(before), steps.saturating_sub(done));
    if here == 0 {
        return format!("{share} % done after {after}, no estimate of the rest yet");
    }
    let rest = elapsed.mul_f64(left as f64 / here as f64);
    format!("{share} % done after {after}, about {} left", spoken(rest))
}

fn spoken(time: Duration) -> String {
    match time.as_secs() {
        seconds @ 0..120 => format!("{seconds} s"),
        seconds @ 120..7200 => format!("{} min", (seconds + 30) / 60),
        seconds => format!("{:.1} h", seconds as f64 / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[test]
    fn share_and_rest_are_told() {
        let after = Duration::from_secs(20);
        assert_eq!(words(37, 0, 100, after), "37 % done after 20 s, about 34 s left");
        assert_eq!(words(0, 0, 100, after), "0 % done after 20 s, no estimate of the rest yet");
        assert_eq!(words(50, 50, 100, after), "50 % done after 20 s, no estimate of the rest yet");
        assert_eq!(words(60, 50, 100, after), "60 % done after 20 s, about 80 s left");
        assert_eq!(words(1, 0, 1000, after), "0 % done after 20 s, about 5.5 h left");
        assert_eq!(words(3, 0, 0, after), "0 % done after 20 s, about 0 s left");
    }

    #[test]
    fn a_step_that_takes_long_is_told_too_and_the_end_ends_the_lines() {
        let reports = Arc::new(Mutex::new(Vec::new()));
        let kept = reports.clone();
        let tell = move |words: &str| kept.lock().unwrap().push(words.to_owned());
        let lines = StepProgress::Lines(ProgressLines::begin(4, Duration::from_millis(2), tell));
        let many = |count: usize| {
            while reports.lock().unwrap().len() < count {
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        many(2);
        lines.step();
        let before = reports.lock().unwrap().len();
        many(before + 2);
        drop(lines);
        let reports = reports.lock().unwrap();
        assert!(reports[0].starts_with("0 % done"), "{reports:?}");
        assert!(reports.last().unwrap().starts_with("25 % done"), "{reports:?}");
    }
}
