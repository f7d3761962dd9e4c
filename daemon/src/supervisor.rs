//! The supervisor: brings the threads up in order, watches over them, takes them down in order.
//!
//! Start: settings → lock of the instance → leftovers purged → services created under a watchdog → threads with their
//! ports → shared memory reserved → memory locked → ticks begin → announced. End: the arm stops smoothly and is let go,
//! ticks end, then the other threads, then the services. Every wait is bounded.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam::channel::{self, Receiver, RecvTimeoutError, Sender};
use tracing::{error, info, warn};

use foretrace_config::{Config, ConfigError};
use foretrace_control::follower::{Follower, FollowerError, Request};
use foretrace_control::learn::{LearnError, Learner};
use foretrace_control::trust::TrustRequest;
use foretrace_shm::layout::fnv1a;
use foretrace_shm::{
    ControlStatus, Instance, InstanceError, InstanceLock, Purge, ServiceError, Services, Session, Status,
};

use crate::ipc::requests::{ReloadOutcome, ReloadRequest};
use crate::ipc::{self, IpcLinks, IpcOrder, IpcSettings, IpcSummary};
use crate::learner::{self, LearnerBoard, LearnerLinks, LearnerOrder};
use crate::memory::{self, NoSpace, ReserveError};
use crate::options::{Options, Rights, StopHandle};
use crate::ports::shm::{IpcPorts, ShmPorts};
use crate::ports::{JOINTS, convert};
use crate::rt::cyclic::Rhythm;
use crate::rt::os;
use crate::rt::thread::{self, RtNews, RtOrders, RtSettings};
use crate::rt::tick::{self, TickRings};

/// Opening shared memory takes milliseconds; damaged files can make it hang.
const OPENING: Duration = Duration::from_secs(10);
/// An arm at full speed comes to rest in well under a second.
const STOPPING: Duration = Duration::from_secs(5);
/// Threads end within a few periods.
const ENDING: Duration = Duration::from_secs(2);
/// How often signals and threads are looked at.
const LOOK: Duration = Duration::from_millis(20);
/// Ticks that count neither in spreads nor in allocations: this much time after the start.
const WARM_UP_S: f64 = 0.5;

/// Why a daemon did not start, or did not end as it should.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The settings are wrong.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// The instance cannot be used; above all: another daemon has it.
    #[error("{0}")]
    Instance(#[from] InstanceError),
    /// The services cannot be created.
    #[error("{0}")]
    Service(#[from] ServiceError),
    /// /dev/shm is too small.
    #[error("{0}")]
    NoSpace(#[from] NoSpace),
    /// The control law refuses the settings.
    #[error("{0}")]
    Follower(#[from] FollowerError),
    /// The learner refuses the settings.
    #[error("{0}")]
    Learner(#[from] LearnError),
    /// Opening shared memory hangs.
    #[error(
        "opening the shared memory of instance {number} takes longer than {} s: end all programs of this instance, \
         then remove /dev/shm/{prefix}* and {root}/iox2", OPENING.as_secs()
    )]
    Hangs {
        /// Number of the instance.
        number: u32,
        /// Prefix of its names.
        prefix: String,
        /// Its directory.
        root: String,
    },
    /// The system refuses something.
    #[error("{what}: {source}")]
    System {
        /// What was tried.
        what: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// A thread ended that should not have.
    #[error("the {name} thread ended by a fault ({cause}); consumers of commands brake by themselves")]
    ThreadDied {
        /// Which.
        name: &'static str,
        /// What it said.
        cause: String,
    },
    /// The arm did not come to rest in time, or nobody wanted to wait for it.
    #[error("ended before the arm was at rest (at most {} s are waited for it): it brakes by itself", STOPPING.as_secs())]
    NotAtRest,
}

/// What there was to see over the life of a daemon.
#[derive(Debug, Clone, Copy)]
pub struct ExitReport {
    /// The last status.
    pub status: Status,
}

/// Runs a daemon until it is told to end.
///
/// # Errors
/// It could not start, or a thread ended by a fault; the text says what to do.
pub fn run(options: &Options) -> Result<ExitReport, DaemonError> {
    let config = options.source.load()?;
    let instance = instance(&config)?;
    let mut lock = instance.lock()?;
    match instance.purge(&lock)? {
        Purge::Removed(0) => {}
        Purge::Removed(count) => info!("removed {count} leftovers of an earlier run"),
        Purge::PeersAlive(pids) => {
            info!("processes {pids:?} still use this instance: going on with its services")
        }
    }
    memory::check_space()?;
    let (lock_back, session, services) = open_services(&instance, lock)?;
    lock = lock_back;

    let mut daemon = Daemon::start(options, config, &instance, &services)?;
    lock.announce().map_err(|source| DaemonError::System { what: "writing the lock file", source })?;
    daemon.greet(&instance);
    let outcome = daemon.watch(options);
    let report = daemon.end(outcome, &options.stop);

    // Nobody may find services that are about to go.
    let _ = lock.withdraw();
    drop(services);
    drop(session);
    if let Ok(Purge::PeersAlive(pids)) = instance.purge(&lock) {
        info!("processes {pids:?} still use this instance: left its services to them");
    }
    report
}

fn instance(config: &Config) -> Result<Instance, InstanceError> {
    let section = &config.settings().instance;
    match &section.root_dir {
        Some(root) => Instance::at(section.number, root),
        None => Instance::new(section.number),
    }
}

/// Joins the instance and creates its services, in a thread of its own because damaged files can make that hang.
fn open_services(
    instance: &Instance,
    lock: InstanceLock,
) -> Result<(InstanceLock, Session, Services), DaemonError> {
    let (done, opened) = channel::bounded(1);
    let there = instance.clone();
    std::thread::Builder::new()
        .name("foretrace-open".to_owned())
        .spawn(move || {
            let session = Session::create(&there, "foretraced", &lock);
            let both =
                session.and_then(|session| Services::create(&session).map(|services| (session, services)));
            let _ = done.send(both.map(|(session, services)| (lock, session, services)));
        })
        .map_err(|source| DaemonError::System { what: "starting a thread", source })?;
    match opened.recv_timeout(OPENING) {
        Ok(opened) => Ok(opened?),
        Err(_) => Err(hangs(instance)),
    }
}

fn hangs(instance: &Instance) -> DaemonError {
    DaemonError::Hangs {
        number: instance.number(),
        prefix: instance.prefix().to_owned(),
        root: instance.root().display().to_string(),
    }
}

/// The threads and the ways to them.
struct Daemon {
    config: Config,
    rt: Option<JoinHandle<()>>,
    rt_orders: Arc<RtOrders>,
    ipc: Option<JoinHandle<IpcSummary>>,
    ipc_orders: Sender<IpcOrder>,
    reload: Receiver<ReloadRequest>,
    learner: Option<JoinHandle<()>>,
    learner_orders: Sender<LearnerOrder>,
    quit: Arc<AtomicBool>,
    hang_up: Arc<AtomicBool>,
    signals: Vec<signal_hook::SigId>,
}

impl Daemon {
    fn start(
        options: &Options,
        config: Config,
        instance: &Instance,
        services: &Services,
    ) -> Result<Self, DaemonError> {
        let system = |what| move |source| DaemonError::System { what, source };
        let thread = system("starting a thread");
        let (tick_rings, ipc_rings, learner_rings) = tick::rings();
        let quit = Arc::new(AtomicBool::new(false));
        let board = Arc::new(LearnerBoard::default());

        let (learner_told, learner_tells) = channel::bounded(64);
        let (learner_orders, learner_ordered) = channel::bounded(4);
        let links = LearnerLinks {
            board: board.clone(),
            events: learner_told,
            orders: learner_ordered,
            quit: quit.clone(),
        };
        let learner = Learner::new(config.learner_settings())?;
        let enabled = config.settings().learner.enabled;
        let learner = learner::spawn(learner, enabled, learner_rings, links).map_err(&thread)?;

        let settings = ipc_settings(&config);
        let (ipc_orders, ipc_ordered) = channel::bounded(64);
        let (reload_in, reload) = channel::bounded(1);
        let links = IpcLinks {
            rings: ipc_rings,
            board,
            learner: learner_tells,
            orders: ipc_ordered,
            reload: reload_in,
            quit: quit.clone(),
        };
        let (opened_in, opened) = channel::bounded(1);
        let (there, services_there) = (instance.clone(), services.clone());
        let open = move || IpcPorts::open(&services_there, &there, settings.daemon_id);
        let ipc = ipc::spawn(open, settings, links, opened_in).map_err(&thread)?;

        let mut daemon = Self {
            config,
            rt: None,
            rt_orders: Arc::new(RtOrders::default()),
            ipc: Some(ipc),
            ipc_orders,
            reload,
            learner: Some(learner),
            learner_orders,
            quit,
            hang_up: Arc::new(AtomicBool::new(false)),
            signals: Vec::new(),
        };
        // From here on an early return has to take the threads down.
        let started = heard(&opened, instance).and_then(|news| news.map_err(DaemonError::from));
        let started = started.and_then(|()| daemon.start_loop(options, instance, services, tick_rings));
        let started = started.and_then(|()| daemon.listen_to_signals(options));
        match started {
            Ok(()) => Ok(daemon),
            Err(error) => daemon.end(Err(error), &options.stop).and(Err(DaemonError::NotAtRest)),
        }
    }

    /// Starts the real-time thread, reserves and locks memory, and lets the ticks begin.
    fn start_loop(
        &mut self,
        options: &Options,
        instance: &Instance,
        services: &Services,
        rings: TickRings,
    ) -> Result<(), DaemonError> {
        let (news_in, news) = channel::bounded(4);
        let (go, gone) = channel::bounded(1);
        let settings = rt_settings(&self.config, options.rights);
        let services = services.clone();
        let open = move || ShmPorts::open(&services);
        let (follower, orders) = (self.config.follower_settings(), self.rt_orders.clone());
        let spawned = match self.config.settings().mpc.horizon {
            10 => thread::spawn(
                Follower::<10, JOINTS>::new(follower)?,
                open,
                rings,
                settings,
                orders,
                news_in,
                gone,
            ),
            20 => thread::spawn(
                Follower::<20, JOINTS>::new(follower)?,
                open,
                rings,
                settings,
                orders,
                news_in,
                gone,
            ),
            _ => thread::spawn(
                Follower::<30, JOINTS>::new(follower)?,
                open,
                rings,
                settings,
                orders,
                news_in,
                gone,
            ),
        };
        self.rt = Some(spawned.map_err(|source| DaemonError::System { what: "starting a thread", source })?);

        let mut missing = Vec::new();
        match heard(&news, instance)? {
            RtNews::Failed(error) => return Err(error.into()),
            RtNews::Opened | RtNews::Running(_) => {}
        }
        match memory::reserve(instance) {
            Ok(bytes) => info!("{} KiB of shared memory reserved", bytes / 1024),
            Err(ReserveError::NoSpace(error)) => return Err(error.into()),
            Err(ReserveError::Refused(refused)) => missing.push(refused),
        }
        if options.rights == Rights::Ask && self.config.settings().control_loop.lock_memory {
            missing.extend(os::lock_memory().err());
        }
        let _ = go.send(());
        if let RtNews::Running(refused) = heard(&news, instance)? {
            missing.extend(refused);
        }
        for right in &missing {
            warn!("{right}");
        }
        let mask = missing.iter().fold(0, |mask, missing| mask | convert::missing_right(missing.right));
        let _ = self.ipc_orders.send(IpcOrder::Missing(mask));
        Ok(())
    }

    fn listen_to_signals(&mut self, options: &Options) -> Result<(), DaemonError> {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
        if !options.signals {
            return Ok(());
        }
        for (signal, flag) in
            [(SIGINT, options.stop.flag()), (SIGTERM, options.stop.flag()), (SIGHUP, self.hang_up.clone())]
        {
            let id = signal_hook::flag::register(signal, flag)
                .map_err(|source| DaemonError::System { what: "listening to signals", source })?;
            self.signals.push(id);
        }
        Ok(())
    }

    fn greet(&self, instance: &Instance) {
        let settings = self.config.settings();
        info!(
            "ready: instance {}, {} Hz, horizon {} x {} ms, predictor {}, settings {} (attach with --instance {})",
            instance.number(),
            settings.control_loop.rate_hz,
            settings.mpc.horizon,
            settings.pen.step_ms,
            settings.predictor.kind.kind().name(),
            self.config.name(),
            instance.number(),
        );
    }

    /// Waits for a reason to end; reloads meanwhile.
    fn watch(&mut self, options: &Options) -> Result<(), DaemonError> {
        loop {
            if options.stop.take() {
                info!("stopping");
                return Ok(());
            }
            if self.hang_up.swap(false, Ordering::AcqRel) {
                self.reload(options);
            }
            if let Ok(request) = self.reload.try_recv() {
                let _ = request.answer.try_send(self.reload(options));
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

    /// Reads the settings again and puts the live ones into force; all or nothing.
    fn reload(&mut self, options: &Options) -> ReloadOutcome {
        let refused = |status, text: String| {
            warn!("settings not reloaded: {text}");
            ReloadOutcome { status, text }
        };
        let new = match options.source.load() {
            Ok(new) => new,
            Err(error) => return refused(ControlStatus::SettingsRejected, error.to_string()),
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
            orders.push(IpcOrder::Loop(Request::SwitchPredictor(after.predictor.kind.kind())));
        }
        if before.trust.request() != after.trust.request() {
            orders.push(IpcOrder::Loop(match after.trust.request() {
                TrustRequest::Auto => Request::TrustAuto,
                TrustRequest::Manual(trust) => Request::SetTrust(trust.alpha()),
            }));
        }
        orders.push(IpcOrder::Settings { hash: settings_hash(&new) });
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

    /// Takes everything down; the first thing that went wrong is what is reported. Told to stop once more meanwhile, it
    /// no longer waits for the arm.
    fn end(mut self, outcome: Result<(), DaemonError>, stop: &StopHandle) -> Result<ExitReport, DaemonError> {
        let mut outcome = outcome;
        self.rt_orders.leave();
        let impatient = || {
            let again = stop.take();
            if again {
                warn!("told to stop once more: not waiting for the arm, which brakes by itself");
            }
            again
        };
        if !ended_unless(self.rt.as_ref(), STOPPING, impatient) {
            self.rt_orders.quit();
            outcome = outcome.and(Err(DaemonError::NotAtRest));
        }
        if ended(self.rt.as_ref(), ENDING)
            && let Some(Err(panic)) = self.rt.take().map(JoinHandle::join)
        {
            let cause = panic_text(panic.as_ref());
            outcome = outcome.and(Err(DaemonError::ThreadDied { name: "real-time", cause }));
        }
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

/// What a starting thread says, unless opening hangs.
fn heard<T>(news: &Receiver<T>, instance: &Instance) -> Result<T, DaemonError> {
    news.recv_timeout(OPENING).map_err(|error| match error {
        RecvTimeoutError::Timeout => hangs(instance),
        RecvTimeoutError::Disconnected => {
            DaemonError::ThreadDied { name: "starting", cause: "it said nothing".to_owned() }
        }
    })
}

/// Waits until a thread has ended, or was never there.
fn ended<T>(thread: Option<&JoinHandle<T>>, patience: Duration) -> bool {
    ended_unless(thread, patience, || false)
}

/// As [`ended`], but gives up early when `enough`.
fn ended_unless<T>(thread: Option<&JoinHandle<T>>, patience: Duration, enough: impl Fn() -> bool) -> bool {
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

fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "unknown cause".to_owned())
}

fn rt_settings(config: &Config, rights: Rights) -> RtSettings {
    let section = &config.settings().control_loop;
    let max_iterations = config.settings().mpc.max_iterations;
    let period_ns = config.settings().period_ns();
    match rights {
        Rights::Ask => RtSettings {
            rhythm: Rhythm { period_ns, spin_ns: u64::from(section.spin_us) * 1000 },
            priority: Some(section.priority),
            cpu: section.cpu.map(|cpu| cpu as usize),
            max_iterations,
        },
        Rights::Leave => {
            RtSettings { rhythm: Rhythm { period_ns, spin_ns: 0 }, priority: None, cpu: None, max_iterations }
        }
    }
}

fn ipc_settings(config: &Config) -> IpcSettings {
    let settings = config.settings();
    let rate_hz = f64::from(settings.control_loop.rate_hz);
    IpcSettings {
        rate_hz,
        warm_after_ticks: (WARM_UP_S * rate_hz) as u64,
        telemetry_every: u64::from(settings.telemetry.every_ticks),
        status_period_ns: 1_000_000_000 / u64::from(settings.telemetry.status_hz.max(1)),
        // Two starts are never at the same nanosecond of one boot.
        daemon_id: fnv1a(
            &[os::monotonic_ns().to_le_bytes(), u64::from(std::process::id()).to_le_bytes()].concat(),
        ),
        settings_hash: settings_hash(config),
    }
}

fn settings_hash(config: &Config) -> u64 {
    fnv1a(format!("{:?}", config.settings()).as_bytes())
}
