//! Start of the daemon: services, threads with their ports, memory, then the ticks.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crossbeam::channel::{self, Receiver, RecvTimeoutError};
use tracing::{info, warn};

use foretrace_config::Config;
use foretrace_control::extent::ExtentWatch;
use foretrace_control::follower::Follower;
use foretrace_control::learn::Learner;
use foretrace_shm::layout::fnv1a;
use foretrace_shm::{Instance, InstanceLock, Services, Session, missing_rights};

use super::notify::Manager;
use super::stop_log::StopLog;
use super::{Daemon, OPENING, STOPPING, settings_hash};
use crate::error::DaemonError;
use crate::ipc::bearing::Bearing;
use crate::ipc::ghost::GhostShell;
use crate::ipc::homeward::Homeward;
use crate::ipc::inputs::Inputs;
use crate::ipc::{self, IpcLinks, IpcOrder, IpcSettings};
use crate::learner::{self, LearnerBoard, LearnerLinks};
use crate::memory::{self, ReserveError};
use crate::options::{Options, Rights};
use crate::ports::shm::{IpcPorts, ShmPorts};
use crate::reload::Reloads;
use crate::rt::os::{self, Right};
use crate::rt::stops::StopFlag;
use crate::rt::thread::{self, RtLinks, RtNews, RtOrders};
use crate::rt::tick::{self, TickRings};
use crate::stop_socket::StopTally;
use crate::wire::JOINTS;

/// Warm-up: ticks in this time count neither in distributions nor in allocations.
const WARM_UP_S: f64 = 0.5;

/// Joins the instance and creates its services, in a separate thread because damaged files can make that
/// hang.
pub(super) fn open_services(
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
        seconds: OPENING.as_secs(),
        number: instance.number(),
        prefix: instance.prefix().to_owned(),
        root: instance.root().display().to_string(),
    }
}

impl Daemon {
    pub(super) fn start(
        options: &Options,
        config: Config,
        instance: &Instance,
        services: &Services,
        flag: Arc<StopFlag>,
        stops: Arc<StopTally>,
    ) -> Result<Self, DaemonError> {
        let system = |what| move |source| DaemonError::System { what, source };
        let thread = system("starting a thread");
        let (tick_rings, ipc_rings, learner_rings) = tick::rings();
        let quit = Arc::new(AtomicBool::new(false));
        let board = Arc::new(LearnerBoard::default());

        let (learner_events_in, learner_events) = channel::bounded(64);
        let (copies, copied) = channel::bounded(16);
        let (learner_orders, learner_ordered) = channel::bounded(4);
        let links = LearnerLinks {
            board: board.clone(),
            events: learner_events_in,
            copies,
            orders: learner_ordered,
            quit: quit.clone(),
        };
        let learner = Learner::new(config.learner_settings(), config.models())?;
        let enabled = config.settings().learner.enabled;
        let learner = learner::spawn(learner, enabled, learner_rings, links).map_err(&thread)?;

        let settings = ipc_settings(&config);
        let (ipc_orders, ipc_ordered) = channel::bounded(64);
        let (reload_in, reload) = channel::bounded(16);
        let ghost = match config.settings().telemetry.ghost {
            true => GhostShell::new(config.follower_settings(), config.settings().mpc.horizon)?,
            false => GhostShell::none(),
        };
        let links = IpcLinks {
            rings: ipc_rings,
            ghost,
            extent: ExtentWatch::new(&config.follower_settings()),
            homeward: Homeward::new(config.follower_settings()),
            bearing: Bearing::new(&config.follower_settings()),
            inputs: Inputs::new(settings.daemon_id, config.render(), copied),
            board,
            learner: learner_events,
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
            rt_orders: Arc::new(RtOrders::with_stops(flag.clone())),
            stop_log: StopLog::new(flag, stops),
            ipc: Some(ipc),
            ipc_orders,
            reload,
            reloads: Reloads::default(),
            learner: Some(learner),
            learner_orders,
            quit,
            hang_up: Arc::new(AtomicBool::new(false)),
            signals: Vec::new(),
        };
        // From here on an early return must end the threads.
        let started = first_message(&opened, instance).and_then(|news| news.map_err(DaemonError::from));
        let started = started.and_then(|()| daemon.start_loop(options, instance, services, tick_rings));
        let started = started.and_then(|()| daemon.listen_to_signals(options));
        match started {
            Ok(()) => Ok(daemon),
            Err(error) => daemon
                .end(Err(error), &options.stop, &mut Manager::default())
                .and(Err(DaemonError::NotAtRest { seconds: STOPPING.as_secs() })),
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
        let settings = options.rights.rt_settings(self.config.settings());
        let services = services.clone();
        let open = move || ShmPorts::open(&services);
        let (follower, orders) = (self.config.follower_settings(), self.rt_orders.clone());
        let links = RtLinks { rings, orders, news: news_in, go: gone };
        let spawned = match self.config.settings().mpc.horizon {
            10 => thread::spawn(Follower::<10, JOINTS>::new(follower)?, open, settings, links),
            20 => thread::spawn(Follower::<20, JOINTS>::new(follower)?, open, settings, links),
            _ => thread::spawn(Follower::<30, JOINTS>::new(follower)?, open, settings, links),
        };
        self.rt = Some(spawned.map_err(|source| DaemonError::System { what: "starting a thread", source })?);

        let mut missing = Vec::new();
        match first_message(&news, instance)? {
            RtNews::Failed(error) => return Err(error.into()),
            RtNews::Opened | RtNews::Running(_) => {}
        }
        instance.check_segments()?;
        match memory::reserve(instance) {
            Ok(bytes) => info!("{} KiB of shared memory reserved", bytes / 1024),
            Err(ReserveError::NoSpace(error)) => return Err(error.into()),
            Err(ReserveError::Refused(refused)) => missing.push(refused),
        }
        if options.rights == Rights::Ask && self.config.settings().control_loop.lock_memory {
            missing.extend(os::lock_memory().err());
        }
        let _ = go.send(());
        if let RtNews::Running(refused) = first_message(&news, instance)? {
            missing.extend(refused);
        }
        for right in &missing {
            warn!("{right}");
        }
        let asked = if options.rights == Rights::Ask { 0 } else { missing_rights::NOT_ASKED };
        let mask = missing.iter().fold(asked, |mask, missing| mask | missing_right(missing.right));
        let _ = self.ipc_orders.send(IpcOrder::Missing(mask));
        Ok(())
    }

    fn listen_to_signals(&mut self, options: &Options) -> Result<(), DaemonError> {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
        if !options.signals {
            return Ok(());
        }
        let stops = self.stop_log.signal();
        for (signal, flag) in [
            (SIGINT, options.stop.flag()),
            (SIGTERM, options.stop.flag()),
            (SIGHUP, self.hang_up.clone()),
            (SIGUSR1, stops),
        ] {
            let id = signal_hook::flag::register(signal, flag)
                .map_err(|source| DaemonError::System { what: "listening to signals", source })?;
            self.signals.push(id);
        }
        Ok(())
    }
}

/// The status bit of a missing right.
const fn missing_right(right: Right) -> u32 {
    match right {
        Right::Fifo => missing_rights::FIFO,
        Right::Affinity => missing_rights::AFFINITY,
        Right::MemoryLock => missing_rights::MEMORY_LOCK,
        Right::TimerSlack => missing_rights::TIMER_SLACK,
        Right::SharedMemory => missing_rights::SHARED_MEMORY_RESERVED,
    }
}

/// The first message of a starting thread, unless opening hangs.
fn first_message<T>(news: &Receiver<T>, instance: &Instance) -> Result<T, DaemonError> {
    news.recv_timeout(OPENING).map_err(|error| match error {
        RecvTimeoutError::Timeout => hangs(instance),
        RecvTimeoutError::Disconnected => {
            DaemonError::ThreadDied { name: "starting", cause: "it did not report".to_owned() }
        }
    })
}

fn ipc_settings(config: &Config) -> IpcSettings {
    let settings = config.settings();
    let rate_hz = f64::from(settings.control_loop.rate_hz);
    IpcSettings {
        rate_hz,
        warm_after_ticks: (WARM_UP_S * rate_hz) as u64,
        telemetry_every: u64::from(settings.telemetry.every_ticks),
        status_period_ns: 1_000_000_000 / u64::from(settings.telemetry.status_hz.max(1)),
        // Two starts never share a nanosecond of one boot.
        daemon_id: fnv1a(
            &[os::monotonic_ns().to_le_bytes(), u64::from(std::process::id()).to_le_bytes()].concat(),
        ),
        settings_hash: settings_hash(config),
    }
}
