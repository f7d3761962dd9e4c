//! The supervisor: starts the threads in order, watches them, ends them in order.
//!
//! Start: settings → lock of the instance → leftovers purged → services created under a watchdog → threads
//! with their ports → shared memory reserved → memory locked → ticks begin → announced. End: the arm stops
//! smoothly and is let go, ticks end, then the other threads, then the services. Every wait is bounded. A
//! service manager is notified of each step.

mod notify;
mod start;
mod stop_log;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender};
use tracing::{error, info, warn};

use foretrace_config::Config;
use foretrace_control::follower::Request;
use foretrace_control::trust::TrustRequest;
use foretrace_shm::layout::fnv1a;
use foretrace_shm::{ControlStatus, Instance, InstanceError, Purge, Status};

use crate::error::DaemonError;
use crate::ipc::requests::{ReloadOutcome, ReloadRequest};
use crate::ipc::{IpcOrder, IpcSummary};
use crate::law_rehearsal::rehearse_law;
use crate::learner::{LearnerOrder, panic_text};
use crate::limits;
use crate::memory;
use crate::options::{Options, StopHandle};
use crate::reload::Reloads;
use crate::rt::os;
use crate::rt::stops::StopFlag;
use crate::rt::thread::RtOrders;
use crate::stop_socket::StopSocket;
use notify::Manager;
use start::open_services;
use stop_log::StopLog;

/// Time limit for opening shared memory, which takes milliseconds unless damaged files make it hang.
const OPENING: Duration = Duration::from_secs(10);
/// Time limit for the arm's stop, which takes well under a second.
const STOPPING: Duration = Duration::from_secs(5);
/// Time limit for the end of a thread, which takes a few periods.
const ENDING: Duration = Duration::from_secs(2);
/// Interval between checks of signals and threads.
const LOOK: Duration = Duration::from_millis(20);
/// Interval between checks of the segments' owners.
const SEGMENTS_LOOK: Duration = Duration::from_secs(1);

/// Results of a daemon's run.
#[derive(Debug, Clone, Copy)]
pub struct ExitReport {
    pub status: Status,
}

/// Runs a daemon until it is stopped.
///
/// # Errors
/// It could not start, or a thread ended by a fault; the text says what to do.
pub fn run(options: &Options) -> Result<ExitReport, DaemonError> {
    let mut manager = Manager::of_environment();
    if options.signals {
        // Before any other thread is started.
        os::leave_stops_to_the_loop();
    }
    let config = options.source.load()?;
    limits::check()?;
    let instance = instance(&config)?;
    let mut lock = instance.lock()?;
    // Opened first and closed last, so that a stop is received whatever hangs in between.
    let flag = Arc::new(StopFlag::default());
    let stops = StopSocket::open(&instance, flag.clone())
        .map_err(|source| DaemonError::System { what: "listening to stops", source })?;
    match instance.purge(&lock)? {
        Purge::Removed(0) => {}
        Purge::Removed(count) => info!("removed {count} leftovers of an earlier run"),
        Purge::PeersAlive(pids) => {
            info!("processes {pids:?} still use this instance: going on with its services")
        }
    }
    memory::check_space()?;
    if let Some(complaint) = rehearse_law(&config)?.complaint(&config) {
        warn!("{complaint}");
    }
    let (lock_back, session, services) = open_services(&instance, lock)?;
    lock = lock_back;

    let mut daemon = Daemon::start(options, config, &instance, &services, flag, stops.tally())?;
    lock.announce().map_err(|source| DaemonError::System { what: "writing the lock file", source })?;
    manager.ready(&daemon.greet(&instance));
    let outcome = daemon.watch(options, &instance, &mut manager);
    manager.stopping();
    let report = daemon.end(outcome, &options.stop, &mut manager);

    // Before the services are removed, so that no peer finds them.
    let _ = lock.withdraw();
    drop(services);
    drop(session);
    if let Ok(Purge::PeersAlive(pids)) = instance.purge(&lock) {
        info!("processes {pids:?} still use this instance: left its services to them");
    }
    report
}

fn instance(config: &Config) -> Result<Instance, InstanceError> {
    // The settings' check names the bound before the middleware does.
    const { assert!(foretrace_config::LONGEST_ROOT_BYTES == foretrace_shm::LONGEST_ROOT_BYTES) };
    let section = &config.settings().instance;
    match &section.root_dir {
        Some(root) => Instance::at(section.number, root),
        None => Instance::new(section.number),
    }
}

/// The threads and the channels to them.
struct Daemon {
    config: Config,
    rt: Option<JoinHandle<()>>,
    rt_orders: Arc<RtOrders>,
    stop_log: StopLog,
    ipc: Option<JoinHandle<IpcSummary>>,
    ipc_orders: Sender<IpcOrder>,
    reload: Receiver<ReloadRequest>,
    reloads: Reloads,
    learner: Option<JoinHandle<()>>,
    learner_orders: Sender<LearnerOrder>,
    quit: Arc<AtomicBool>,
    hang_up: Arc<AtomicBool>,
    signals: Vec<signal_hook::SigId>,
}

impl Daemon {
    /// Reports that the daemon is ready; returns the message.
    fn greet(&self, instance: &Instance) -> String {
        let settings = self.config.settings();
        let words = format!(
            "instance {}, {} Hz, plan {} x {} ms, predictor {}, settings {} (attach with --instance {})",
            instance.number(),
            settings.control_loop.rate_hz,
            settings.mpc.horizon,
            settings.plan_step_s() * 1e3,
            settings.predictor.kind.name(),
            self.config.name(),
            instance.number(),
        );
        info!("ready: {words}");
        for remark in self.config.remarks() {
            warn!("{remark}");
        }
        for note in self.config.notes() {
            info!("{note}");
        }
        words
    }

    /// Waits for a reason to end; handles reloads meanwhile.
    fn watch(
        &mut self,
        options: &Options,
        instance: &Instance,
        manager: &mut Manager,
    ) -> Result<(), DaemonError> {
        let (mut segments_seen, mut warned) = (Instant::now(), false);
        loop {
            manager.alive(self.rt_orders.ticks());
            self.stop_log.report();
            if !warned && segments_seen.elapsed() >= SEGMENTS_LOOK {
                segments_seen = Instant::now();
                if let Err(error) = instance.check_segments() {
                    warn!("{error}; said only once");
                    warned = true;
                }
            }
            if options.stop.take() {
                info!("stopping");
                return Ok(());
            }
            if self.hang_up.swap(false, Ordering::AcqRel) {
                self.reloads.ask(None);
            }
            while let Ok(request) = self.reload.try_recv() {
                if let Some(answer) = self.reloads.ask(Some(request.answer)) {
                    let text = "too many wait for a reload: ask again".to_owned();
                    let _ = answer.try_send(ReloadOutcome { status: ControlStatus::Busy, text });
                }
            }
            if let Some((read, waiting)) = self.reloads.look(options.reading, &options.source) {
                let outcome = self.reload(read);
                for answer in waiting {
                    let _ = answer.try_send(outcome.clone());
                }
            }
            if self.rt.as_ref().is_some_and(JoinHandle::is_finished) {
                return Err(DaemonError::ThreadDied { name: "real-time", cause: cause(self.rt.take()) });
            }
            if self.ipc.as_ref().is_some_and(JoinHandle::is_finished) {
                return Err(DaemonError::ThreadDied { name: "ipc", cause: cause(self.ipc.take()) });
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Applies the live ones of settings that were read again; all or nothing.
    fn reload(&mut self, read: Result<Config, String>) -> ReloadOutcome {
        let refused = |status, text: String| {
            warn!("settings not reloaded: {text}");
            ReloadOutcome { status, text }
        };
        let new = match read {
            Ok(new) => new,
            Err(why) => return refused(ControlStatus::SettingsRejected, why),
        };
        let change = match self.config.live_diff(&new) {
            Ok(change) => change,
            Err(keys) => {
                let text = keys.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
                return refused(ControlStatus::NeedsRestart, text);
            }
        };
        let (before, after) = (self.config.settings(), new.settings());
        let mut orders = Vec::new();
        if before.predictor.kind != after.predictor.kind {
            orders.push(IpcOrder::Loop(Request::SwitchPredictor(after.predictor.kind)));
        }
        if before.trust.request() != after.trust.request() {
            orders.push(IpcOrder::Loop(match after.trust.request() {
                TrustRequest::Auto => Request::TrustAuto,
                TrustRequest::Manual(trust) | TrustRequest::Frozen(trust) => Request::SetTrust(trust.alpha()),
            }));
        }
        orders.push(IpcOrder::Settings { hash: settings_hash(&new), text: new.render() });
        for order in orders {
            let _ = self.ipc_orders.try_send(order);
        }
        let order = LearnerOrder { enabled: after.learner.enabled, settings: new.learner_settings() };
        let _ = self.learner_orders.try_send(order);
        let keys: Vec<_> = change.keys.iter().map(|change| change.key.as_str()).collect();
        let text = if keys.is_empty() {
            "nothing has changed".to_owned()
        } else {
            format!("changed: {}", keys.join(", "))
        };
        info!("settings reloaded, {text}");
        self.config = new;
        ReloadOutcome { status: ControlStatus::Ok, text }
    }

    /// Ends everything; the first error is reported. If stopped once more meanwhile, no longer waits for
    /// the arm.
    fn end(
        mut self,
        outcome: Result<(), DaemonError>,
        stop: &StopHandle,
        manager: &mut Manager,
    ) -> Result<ExitReport, DaemonError> {
        let mut outcome = outcome;
        self.rt_orders.leave();
        let impatient = || {
            manager.alive(self.rt_orders.ticks());
            let again = stop.take();
            if again {
                warn!("told to stop again: not waiting for the arm, which brakes by itself");
            }
            again
        };
        if !ended_unless(self.rt.as_ref(), STOPPING, impatient) {
            self.rt_orders.quit();
            outcome = outcome.and(Err(DaemonError::NotAtRest { seconds: STOPPING.as_secs() }));
        }
        if ended(self.rt.as_ref(), ENDING)
            && let Some(Err(panic)) = self.rt.take().map(JoinHandle::join)
        {
            let cause = panic_text(panic.as_ref());
            outcome = outcome.and(Err(DaemonError::ThreadDied { name: "real-time", cause }));
        }
        self.stop_log.flush();
        self.quit.store(true, Ordering::Release);
        if ended(self.learner.as_ref(), ENDING) {
            let _ = self.learner.take().map(JoinHandle::join);
        }
        let mut summary = IpcSummary::default();
        if ended(self.ipc.as_ref(), ENDING) {
            match self.ipc.take().map(JoinHandle::join) {
                Some(Ok(last)) => summary = last,
                Some(Err(panic)) => {
                    let cause = panic_text(panic.as_ref());
                    outcome = outcome.and(Err(DaemonError::ThreadDied { name: "ipc", cause }));
                }
                None => {}
            }
        }
        for id in self.signals.drain(..) {
            signal_hook::low_level::unregister(id);
        }
        if let Err(error) = &outcome {
            error!("{error}");
        }
        outcome.map(|()| ExitReport { status: summary.status })
    }
}

/// Waits until a thread has ended, or was never there.
fn ended<T>(thread: Option<&JoinHandle<T>>, patience: Duration) -> bool {
    ended_unless(thread, patience, || false)
}

/// As [`ended`], but gives up early when `enough`.
fn ended_unless<T>(
    thread: Option<&JoinHandle<T>>,
    patience: Duration,
    mut enough: impl FnMut() -> bool,
) -> bool {
    let since = Instant::now();
    while thread.is_some_and(|thread| !thread.is_finished()) {
        if since.elapsed() > patience || enough() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    true
}

fn cause<T>(thread: Option<JoinHandle<T>>) -> String {
    match thread.map(JoinHandle::join) {
        Some(Err(panic)) => panic_text(panic.as_ref()),
        _ => "it returned".to_owned(),
    }
}

/// Of all settings, as the daemon's status has it: programs that judge by settings of their own compare.
#[must_use]
pub fn settings_hash(config: &Config) -> u64 {
    fnv1a(format!("{:?}", config.settings()).as_bytes())
}
