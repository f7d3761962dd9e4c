//! The real-time thread: opens its ports, takes its rights, runs ticks until ordered to leave.
//!
//! Contract: everything that may fail, block or allocate happens before the first tick. When ordered to
//! leave, the thread stops the arm smoothly and ends once the loop is idle; the order to quit ends it at
//! once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use crossbeam::channel::{Receiver, Sender};

use foretrace_control::follower::{Follower, Mode};

use super::clock::MonotonicClock;
use super::cyclic::{Cyclic, Rhythm};
use super::os::{self, Missing};
use super::overruns::OverrunLimit;
use super::stops::{StopFlag, Stops};
use super::tick::{Tick, TickRings};
use crate::ports::Ports;
use crate::wire::JOINTS;

/// Rights and rhythm of the thread.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RtSettings {
    /// When ticks are released.
    pub rhythm: Rhythm,
    /// SCHED_FIFO priority; `None`: an ordinary thread.
    pub priority: Option<u32>,
    /// CPU to pin to; `None`: any.
    pub cpu: Option<usize>,
    /// Iteration cap of each QP per tick.
    pub max_iterations: u32,
    /// How many ticks may be late before the arm is stopped.
    pub overruns: OverrunLimit,
}

/// Messages to the supervisor before the first tick.
#[derive(Debug)]
pub enum RtNews<E> {
    /// The ports are open; waiting for `go`.
    Opened,
    /// They could not be opened; the thread has ended.
    Failed(E),
    /// The ticks begin; these rights are missing.
    Running(Vec<Missing>),
}

/// Orders of the supervisor to the running thread, and its sign of life.
#[derive(Debug, Default)]
pub struct RtOrders {
    leave: AtomicBool,
    quit: AtomicBool,
    ticks: AtomicU64,
    stops: Arc<StopFlag>,
}

impl RtOrders {
    /// Orders to a loop that also listens to `stops`.
    #[must_use]
    pub fn with_stops(stops: Arc<StopFlag>) -> Self {
        Self { stops, ..Self::default() }
    }

    /// Stop the arm smoothly, then end.
    pub fn leave(&self) {
        self.leave.store(true, Ordering::Release);
    }

    /// End after the present tick; consumers brake by themselves.
    pub fn quit(&self) {
        self.quit.store(true, Ordering::Release);
    }

    /// Ticks run so far.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.ticks.load(Ordering::Relaxed)
    }
}

/// The thread's ends of its rings and channels.
#[derive(Debug)]
pub struct RtLinks<E> {
    /// To the other threads.
    pub rings: TickRings,
    /// From the supervisor, while ticks run.
    pub orders: Arc<RtOrders>,
    /// To the supervisor, before the first tick.
    pub news: Sender<RtNews<E>>,
    /// The ticks may begin: all memory is mapped and locked.
    pub go: Receiver<()>,
}

/// Starts the thread. It opens its ports, reports that, and waits until it may go.
///
/// # Errors
/// The system refuses another thread.
pub fn spawn<const N: usize, P, E>(
    follower: Follower<N, JOINTS>,
    open: impl FnOnce() -> Result<P, E> + Send + 'static,
    settings: RtSettings,
    links: RtLinks<E>,
) -> std::io::Result<JoinHandle<()>>
where
    P: Ports + 'static,
    E: Send + 'static,
{
    let RtLinks { rings, orders, news, go } = links;
    std::thread::Builder::new().name(foretrace_shm::LOOP.to_owned()).stack_size(1 << 20).spawn(move || {
        let ports = match open() {
            Ok(ports) => ports,
            Err(error) => {
                // A supervisor that is gone does not need the news.
                let _ = news.send(RtNews::Failed(error));
                return;
            }
        };
        let mut tick = Tick::new(follower, ports, rings, settings.max_iterations);
        tick.supervise(Stops::new(orders.stops.clone()), settings.overruns);
        let _ = news.send(RtNews::Opened);
        if go.recv().is_err() {
            return;
        }
        let missing = take_rights(&settings);
        let _ = news.send(RtNews::Running(missing));
        run(tick, settings.rhythm, &orders);
    })
}

/// Requests the rights for punctual ticks; returns those refused.
pub(super) fn take_rights(settings: &RtSettings) -> Vec<Missing> {
    os::hear_stops_only();
    os::prefault_stack();
    let rights =
        [settings.cpu.map(os::pin_to), settings.priority.map(os::set_fifo), Some(os::set_timer_slack(1))];
    rights.into_iter().flatten().filter_map(Result::err).collect()
}

fn run<const N: usize, P: Ports>(mut tick: Tick<N, P>, rhythm: Rhythm, orders: &RtOrders) {
    let mut cyclic = Cyclic::new(MonotonicClock, rhythm);
    while !orders.quit.load(Ordering::Acquire) {
        let leaving = orders.leave.load(Ordering::Acquire);
        if leaving {
            tick.leave();
        }
        let wake = cyclic.wait();
        let mode = tick.run(&wake, cyclic.clock());
        orders.ticks.fetch_add(1, Ordering::Relaxed);
        if leaving && mode == Mode::Idle {
            break;
        }
    }
}
