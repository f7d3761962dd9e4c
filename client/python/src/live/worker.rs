//! A thread that owns a handle, and does what callers of any Python thread ask of it.
//!
//! Contract: handles of the middleware stay in the thread that made them. No worker touches the interpreter.
//! Every wait is bounded and releases the interpreter lock. A handle that came through `fork` is refused.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, SyncSender, TrySendError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use super::failure::{FailureKind, LiveFailure};

type HandleJob<H> = Box<dyn FnOnce(&mut H) + Send>;

/// Calls that wait for one worker at most.
const QUEUE: usize = 64;
/// Between two looks for Ctrl-C while a call waits.
const LOOK: Duration = Duration::from_millis(100);
/// How long a worker may take to end; one that takes longer is left alone.
const ENDING: Duration = Duration::from_secs(2);

pub struct HandleWorker<H> {
    name: &'static str,
    pid: u32,
    jobs: Mutex<Option<SyncSender<HandleJob<H>>>>,
    /// Never sends; disconnected when the thread is over.
    over: Mutex<Receiver<()>>,
}

/// What the end of the interpreter or of an attachment closes.
pub trait Closing: Send + Sync {
    /// Ends its thread, and waits for it for a bounded time. Needs no interpreter.
    fn close(&self);

    /// Whether closing it stops an arm, which at the end of the interpreter comes before all else.
    fn moves_an_arm(&self) -> bool {
        false
    }
}

static OPEN: Mutex<Vec<Weak<dyn Closing>>> = Mutex::new(Vec::new());

/// The inside of a lock; what a panicking holder left there is still whole: every holder writes whole values.
pub fn locked<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Remembers something that has to be closed before the interpreter ends.
pub fn remember(closing: Weak<dyn Closing>) {
    let mut open = locked(&OPEN);
    open.retain(|one| one.strong_count() > 0);
    open.push(closing);
}

/// Closes everything that is still open: what stops an arm first and at once, then the rest, newest first.
pub fn close_all() {
    let open = std::mem::take(&mut *locked(&OPEN));
    let open: Vec<_> = open.iter().rev().filter_map(Weak::upgrade).collect();
    let (arms, rest): (Vec<_>, Vec<_>) = open.into_iter().partition(|closing| closing.moves_an_arm());
    std::thread::scope(|scope| {
        for arm in &arms {
            // Beside each other: a daemon that hangs must not delay the stop of another one's arm.
            if std::thread::Builder::new().spawn_scoped(scope, || arm.close()).is_err() {
                arm.close();
            }
        }
    });
    rest.iter().for_each(|closing| closing.close());
}

/// Refuses what was made in another process.
pub fn same_process(pid: u32, name: &str) -> Result<(), LiveFailure> {
    if pid == std::process::id() {
        return Ok(());
    }
    let text = format!(
        "{name} belongs to process {pid}, this is its child {}: attach in the child, or start it by `spawn`",
        std::process::id()
    );
    Err(LiveFailure::new(FailureKind::Other, text))
}

/// What a call on a closed handle is told.
pub fn closed(name: &str) -> LiveFailure {
    LiveFailure::new(FailureKind::Other, format!("{name} is closed: open it again"))
}

/// Waits for an answer without the interpreter lock; Ctrl-C ends the wait.
pub fn receive<T: Send>(
    py: Python<'_>,
    mut receiver: Receiver<T>,
    patience: Duration,
    name: &str,
) -> PyResult<T> {
    let deadline = Instant::now() + patience;
    loop {
        let wait = LOOK.min(deadline.saturating_duration_since(Instant::now()));
        let waited = py.detach(move || (receiver.recv_timeout(wait), receiver));
        receiver = waited.1;
        match waited.0 {
            Ok(answer) => return Ok(answer),
            Err(RecvTimeoutError::Disconnected) => return Err(closed(name).into()),
            Err(RecvTimeoutError::Timeout) => {}
        }
        py.check_signals()?;
        if Instant::now() >= deadline {
            let text =
                format!("{name}: no answer within {:.1} s: see `foretrace doctor`", patience.as_secs_f64());
            return Err(LiveFailure::new(FailureKind::NoAnswer, text).into());
        }
    }
}

/// Does `work` in a thread of its own and waits for it; Ctrl-C ends the wait, not the work.
pub fn in_a_thread<T: Send + 'static>(
    py: Python<'_>,
    name: &'static str,
    patience: Duration,
    work: impl FnOnce() -> Result<T, LiveFailure> + Send + 'static,
) -> PyResult<T> {
    let (answer, answered) = mpsc::sync_channel(1);
    let working = move || {
        // The caller may have given up.
        let _ = answer.send(work());
    };
    std::thread::Builder::new().name("foretrace-asking".to_owned()).spawn(working).map_err(|error| {
        LiveFailure::new(FailureKind::Other, format!("{name}: starting a thread: {error}: free some memory"))
    })?;
    Ok(receive(py, answered, patience, name)??)
}

impl<H: 'static> HandleWorker<H> {
    /// Starts a thread that opens a handle and keeps it; `idle` is called every `pause` between calls.
    pub fn start(
        py: Python<'_>,
        name: &'static str,
        pause: Duration,
        patience: Duration,
        open: impl FnOnce() -> Result<H, LiveFailure> + Send + 'static,
        idle: impl Fn(&mut H) + Send + 'static,
    ) -> PyResult<Arc<Self>> {
        let (jobs, queue) = mpsc::sync_channel::<HandleJob<H>>(QUEUE);
        let (opened, opening) = mpsc::sync_channel(1);
        let (alive, over) = mpsc::sync_channel::<()>(1);
        let work = move || {
            let _alive = alive;
            let mut handle = match open() {
                Ok(handle) => handle,
                Err(failure) => {
                    // The caller may have given up.
                    let _ = opened.send(Err(failure));
                    return;
                }
            };
            if opened.send(Ok(())).is_err() {
                return;
            }
            let mut next = Instant::now() + pause;
            loop {
                match queue.recv_timeout(next.saturating_duration_since(Instant::now())) {
                    Ok(job) => job(&mut handle),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return,
                }
                if Instant::now() >= next {
                    idle(&mut handle);
                    next = Instant::now() + pause;
                }
            }
        };
        std::thread::Builder::new()
            .name(format!("foretrace-{}", name.split(' ').next_back().unwrap_or(name)))
            .spawn(work)
            .map_err(|error| {
                LiveFailure::new(
                    FailureKind::Other,
                    format!("{name}: starting a thread: {error}: free some memory"),
                )
            })?;
        receive(py, opening, patience, name)??;
        let worker = Arc::new(Self {
            name,
            pid: std::process::id(),
            jobs: Mutex::new(Some(jobs)),
            over: Mutex::new(over),
        });
        let closing: Arc<dyn Closing> = worker.clone();
        remember(Arc::downgrade(&closing));
        Ok(worker)
    }

    /// Does `job` in the thread of the handle, and waits for it.
    pub fn call<R: Send + 'static>(
        &self,
        py: Python<'_>,
        patience: Duration,
        job: impl FnOnce(&mut H) -> R + Send + 'static,
    ) -> PyResult<R> {
        same_process(self.pid, self.name)?;
        let (answer, answered) = mpsc::sync_channel(1);
        let job: HandleJob<H> = Box::new(move |handle| {
            // The caller may have given up.
            let _ = answer.send(job(handle));
        });
        let jobs = locked(&self.jobs).clone().ok_or_else(|| closed(self.name))?;
        match jobs.try_send(job) {
            Ok(()) => {}
            Err(TrySendError::Disconnected(_)) => return Err(closed(self.name).into()),
            Err(TrySendError::Full(_)) => {
                let text = format!("{}: {QUEUE} calls wait already: call it from fewer threads", self.name);
                return Err(LiveFailure::new(FailureKind::Other, text).into());
            }
        }
        drop(jobs);
        receive(py, answered, patience, self.name)
    }
}

impl<H: 'static> Closing for HandleWorker<H> {
    fn close(&self) {
        if locked(&self.jobs).take().is_some() && self.pid == std::process::id() {
            let _ = locked(&self.over).recv_timeout(ENDING);
        }
    }
}

/// A duration that Python gave \[s\]: 0 to an hour.
pub fn seconds(name: &str, value: f64) -> Result<Duration, LiveFailure> {
    if (0.0..=3600.0).contains(&value) {
        return Ok(Duration::from_secs_f64(value));
    }
    Err(LiveFailure::invalid(format!("{name} = {value} s: from 0 to 3600")))
}
