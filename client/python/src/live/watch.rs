//! `WatchHandle`: every message of a kind, collected in a thread, taken in bulk as bytes.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use foretrace_client::wire::{Message, Wire};
use foretrace_client::{
    Commands, Foretrace, Instance, JointCommand, JointState, JointWatch, Lasting, PenSample, PenWatch,
    ServiceError, Telemetry, TickRecord,
};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::failure::LiveFailure;
use super::pen::PATIENCE;
use super::worker::{Closing, HandleWorker, closed, locked, seconds};

/// The middleware keeps 256 messages: at 8000 Hz they last 32 ms.
const COLLECT: Duration = Duration::from_millis(5);
/// What waits for Python at most \[bytes\]: eight seconds of tick records at 500 Hz.
const ROOM: usize = 8 << 20;
const NAME: &str = "the watch";

/// Where messages come from.
enum WatchSource {
    Ticks(Telemetry),
    Pen(PenWatch),
    Joints(JointWatch),
    Commands(Commands),
}

/// A kind of message, by its name in Python.
#[derive(Clone, Copy)]
enum SourceKind {
    Ticks,
    Pen,
    Joints,
    Commands,
}

impl SourceKind {
    fn of(name: &str) -> Result<Self, LiveFailure> {
        Ok(match name {
            "ticks" => Self::Ticks,
            "pen" => Self::Pen,
            "joints" => Self::Joints,
            "commands" => Self::Commands,
            other => {
                let text = format!("{other:?} cannot be watched: ticks, pen, joints or commands");
                return Err(LiveFailure::invalid(text));
            }
        })
    }

    fn open(self, foretrace: &Foretrace) -> Result<WatchSource, ServiceError> {
        Ok(match self {
            Self::Ticks => WatchSource::Ticks(foretrace.telemetry()?),
            Self::Pen => WatchSource::Pen(foretrace.pen_watch()?),
            Self::Joints => WatchSource::Joints(foretrace.joint_watch()?),
            Self::Commands => WatchSource::Commands(foretrace.commands(Commands::MAX_BUFFER)?),
        })
    }

    /// Of one message \[bytes\].
    const fn size(self) -> usize {
        match self {
            Self::Ticks => size_of::<TickRecord>(),
            Self::Pen => size_of::<PenSample>(),
            Self::Joints => size_of::<JointState>(),
            Self::Commands => size_of::<JointCommand>(),
        }
    }
}

fn put<T: Message + Wire>(bytes: &mut Vec<u8>) -> impl FnMut(&T) {
    |message| message.put(bytes)
}

impl WatchSource {
    fn drain(&mut self, bytes: &mut Vec<u8>) {
        match self {
            Self::Ticks(watch) => watch.drain(put(bytes)),
            Self::Pen(watch) => watch.drain(put(bytes)),
            Self::Joints(watch) => watch.drain(put(bytes)),
            Self::Commands(commands) => commands.drain(put(bytes)),
        };
    }

    /// Lost on the way, and refused.
    fn missing(&self) -> [u64; 2] {
        match self {
            Self::Ticks(watch) => [watch.lost(), watch.rejections().total()],
            Self::Pen(watch) => [watch.lost(), watch.rejections().total()],
            Self::Joints(watch) => [watch.lost(), watch.rejections().total()],
            Self::Commands(commands) => [commands.dropped(), commands.rejections().total()],
        }
    }
}

/// What waits for Python.
#[derive(Default)]
struct Basket {
    bytes: VecDeque<u8>,
    /// Messages that found no room here.
    overflowed: u64,
    /// Lost and refused, of the source now and of those before a restart of the daemon.
    now: [u64; 2],
    before: [u64; 2],
    /// Nothing comes any more.
    over: bool,
}

type SharedBasket = Arc<(Mutex<Basket>, Condvar)>;

struct Collector {
    source: Lasting<WatchSource>,
    kind: SourceKind,
    basket: SharedBasket,
}

impl Collector {
    fn collect(&mut self) {
        let (mutex, filled) = &*self.basket;
        let mut fresh = Vec::new();
        if let Some(source) = &mut self.source.handle {
            source.drain(&mut fresh);
            let mut basket = locked(mutex);
            basket.now = source.missing();
            let size = self.kind.size();
            let most = ROOM - ROOM % size;
            basket.bytes.extend(fresh);
            let over = basket.bytes.len().saturating_sub(most);
            if over > 0 {
                basket.bytes.drain(..over);
                basket.overflowed += (over / size) as u64;
            }
            if !basket.bytes.is_empty() {
                filled.notify_all();
            }
        }
        let kind = self.kind;
        let basket = &self.basket;
        // An error is no end: the next look tries again.
        let _ = self.source.look(|foretrace| {
            let mut basket = locked(&basket.0);
            let [lost, refused] = std::mem::take(&mut basket.now);
            basket.before = [basket.before[0] + lost, basket.before[1] + refused];
            drop(basket);
            kind.open(foretrace)
        });
    }
}

impl Drop for Collector {
    fn drop(&mut self) {
        locked(&self.basket.0).over = true;
        self.basket.1.notify_all();
    }
}

/// Every message of a kind from now on.
#[pyclass(frozen, module = "foretrace._native")]
pub struct WatchHandle {
    worker: Arc<HandleWorker<Collector>>,
    basket: SharedBasket,
    size: usize,
}

impl WatchHandle {
    pub fn open(py: Python<'_>, instance: Instance, kind: &str) -> PyResult<Self> {
        let kind = SourceKind::of(kind)?;
        let basket = SharedBasket::default();
        let shared = basket.clone();
        let open = move || -> Result<Collector, LiveFailure> {
            let foretrace = Foretrace::attach_within(&instance, Duration::ZERO)?;
            let source = kind.open(&foretrace)?;
            Ok(Collector { source: Lasting::new(foretrace, source), kind, basket: shared })
        };
        let worker = HandleWorker::start(py, NAME, COLLECT, PATIENCE, open, Collector::collect)?;
        Ok(Self { worker, basket, size: kind.size() })
    }
}

#[pymethods]
impl WatchHandle {
    /// Takes every message that has come, oldest first, and waits up to `timeout_s` for the first.
    fn drain<'py>(&self, py: Python<'py>, timeout_s: f64) -> PyResult<Bound<'py, PyBytes>> {
        let deadline = Instant::now() + seconds("timeout", timeout_s)?;
        self.worker.call(py, PATIENCE, Collector::collect)?;
        loop {
            let (bytes, over) = py.detach(|| {
                let (mutex, filled) = &*self.basket;
                let left = deadline.saturating_duration_since(Instant::now()).min(Duration::from_millis(100));
                let basket = locked(mutex);
                let nothing = |basket: &mut Basket| basket.bytes.is_empty() && !basket.over;
                let waited = filled.wait_timeout_while(basket, left, nothing);
                let mut basket = waited.unwrap_or_else(PoisonError::into_inner).0;
                let (bytes, over) = (std::mem::take(&mut basket.bytes), basket.over);
                drop(basket);
                (Vec::from(bytes), over)
            });
            py.check_signals()?;
            if over && bytes.is_empty() {
                return Err(closed(NAME).into());
            }
            if !bytes.is_empty() || Instant::now() >= deadline {
                return Ok(PyBytes::new(py, &bytes));
            }
        }
    }

    /// Messages that were sent and never reached Python; refused ones apart.
    #[getter]
    fn lost(&self) -> u64 {
        let basket = locked(&self.basket.0);
        basket.before[0] + basket.now[0] + basket.overflowed
    }

    #[getter]
    fn refused(&self) -> u64 {
        let basket = locked(&self.basket.0);
        basket.before[1] + basket.now[1]
    }

    #[getter]
    fn record_size(&self) -> usize {
        self.size
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }
}
