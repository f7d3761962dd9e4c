//! A daemon with its own instance, an arm that obeys exactly, and a pen that draws circles.
#![allow(dead_code, unreachable_pub)]

#[path = "../../../tests/src/turn.rs"]
mod places;

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_control::guard::CommandChecker;
use foretrace_control::units::Stamp;
use foretrace_shm::{
    ControlOp, ControlRequest, ControlResponse, HeaderBounds, Instance, JointCommand, JointState, Message,
    PenPreview, PenSample, PenStep, PredictorName, SafetyMode, Services, Session, Status, monotonic_now_ns,
    pen_flags,
};
use foretraced::{DaemonError, ExitReport, Options, Rights, Source, StopHandle};

/// Real-time rights only on machines meant for that.
pub fn rights() -> Rights {
    if std::env::var_os("FORETRACE_RT_TESTS").is_some_and(|value| value == "1") {
        Rights::Ask
    } else {
        Rights::Leave
    }
}

/// One daemon test at a time on this machine, as all need the processor.
pub fn turn() -> places::Turn {
    places::Turn::alone()
}

/// A directory of this test only; removed at the end.
pub struct Site {
    pub root: std::path::PathBuf,
    pub number: u32,
}

impl Site {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let root = std::env::temp_dir().join(format!("ftd-{}-{count}", std::process::id()));
        Self { root, number: 60 + count % 30 }
    }

    pub fn source(&self) -> Source {
        Source::preset("ur5")
            .with("instance.number", self.number)
            .with("instance.root_dir", format!("\"{}\"", self.root.display()))
    }

    pub fn instance(&self) -> Instance {
        Instance::at(self.number, &self.root).unwrap()
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        let instance = self.instance();
        if let Ok(lock) = instance.lock() {
            let _ = instance.purge(&lock);
        }
        let _ = std::fs::remove_dir_all(&self.root);
    }
}

/// Calls `ask` until it answers; gives up after 20 s.
pub fn until<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let since = Instant::now();
    loop {
        if let Some(answer) = ask() {
            return answer;
        }
        assert!(since.elapsed() < Duration::from_secs(20), "{what}: did not happen within 20 s");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A daemon in a thread of this process.
pub struct Running {
    pub stop: StopHandle,
    thread: JoinHandle<Result<ExitReport, DaemonError>>,
}

impl Running {
    pub fn start(site: &Site, source: Source) -> Self {
        let options = Options { rights: rights(), signals: false, ..Options::new(source) };
        let stop = options.stop.clone();
        let thread = std::thread::spawn(move || foretraced::run(&options));
        let instance = site.instance();
        let running = Self { stop, thread };
        until("the daemon comes up", || {
            (instance.daemon().is_some() || running.thread.is_finished()).then_some(())
        });
        running
    }

    pub fn end(self) -> Result<ExitReport, DaemonError> {
        self.stop.stop();
        self.thread.join().unwrap()
    }
}

/// An operator.
pub struct Operator {
    control: foretrace_shm::ControlClient,
    status: foretrace_shm::Subscriber<Status>,
    pub newest: Status,
    _session: Session,
}

impl Operator {
    pub fn attach(site: &Site) -> Self {
        let session = Session::open(&site.instance(), "operator").unwrap();
        let services = Services::open(&session).unwrap();
        Self {
            control: services.control.client().unwrap(),
            status: services.status.subscriber(4, HeaderBounds::DEFAULT).unwrap(),
            newest: Status::default(),
            _session: session,
        }
    }

    pub fn ask(&mut self, op: ControlOp, value: f64) -> ControlResponse {
        let request = ControlRequest { value, ..ControlRequest::new(0, 0, op) };
        self.control.ask(request, Duration::from_secs(5)).unwrap()
    }

    /// Asks with the date `sent_ns`.
    pub fn ask_dated(&mut self, op: ControlOp, sent_ns: u64) -> ControlResponse {
        let request = ControlRequest { sent_ns, ..ControlRequest::new(0, 0, op) };
        self.control.ask(request, Duration::from_secs(5)).unwrap()
    }

    pub fn switch_predictor(&mut self, name: &str) -> ControlResponse {
        let predictor = PredictorName::new(name).unwrap();
        let request = ControlRequest { predictor, ..ControlRequest::new(0, 0, ControlOp::SwitchPredictor) };
        self.control.ask(request, Duration::from_secs(5)).unwrap()
    }

    pub fn status_when(&mut self, what: &str, mut claim: impl FnMut(&Status) -> bool) -> Status {
        until(what, || {
            let status = self.status.latest()?;
            self.newest = status;
            claim(&status).then_some(status)
        })
    }
}

/// What the arm received.
#[derive(Default)]
pub struct ArmLog {
    pub commands: AtomicU64,
    pub illegal: AtomicU64,
    /// Streams that began.
    pub begun: AtomicU64,
    /// The newest command.
    pub last: Mutex<Option<JointCommand>>,
}

/// A peer in a separate thread, ended on drop.
pub struct Peer {
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Peer {
    pub fn start(work: impl FnOnce(&AtomicBool) + Send + 'static) -> Self {
        let quit = Arc::new(AtomicBool::new(false));
        let seen = quit.clone();
        Self { quit, thread: Some(std::thread::spawn(move || work(&seen))) }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Release);
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || !matches!(ended, Some(Err(_))), "a peer failed");
    }
}

/// An arm at home that is exactly where it was commanded, and checks every command.
pub fn arm(site: &Site) -> (Peer, Arc<ArmLog>) {
    let log = Arc::new(ArmLog::default());
    let (seen, instance, source) = (log.clone(), site.instance(), site.source());
    let peer = Peer::start(move |quit| {
        let config = source.load().unwrap();
        let settings = config.follower_settings();
        let mut checker = CommandChecker::new(settings.limits);
        let session = Session::open(&instance, "arm").unwrap();
        let services = Services::open(&session).unwrap();
        let mut states = services.joint_state.publisher().unwrap();
        let mut commands = services
            .joint_cmd
            .subscriber(256, HeaderBounds { future_ns: 100_000_000, age_ns: u64::MAX })
            .unwrap();
        let mut state = JointState {
            q: settings.ik.home,
            safety_mode: SafetyMode::Normal.into(),
            ..JointState::default()
        };
        while !quit.load(Ordering::Acquire) {
            let now = monotonic_now_ns();
            commands.drain(|command| {
                let (stamp, until) = (Stamp(command.header.stamp_ns), Stamp(command.valid_until_ns));
                if command.flags & foretrace_shm::command_flags::BEGINS != 0 {
                    seen.begun.fetch_add(1, Ordering::Relaxed);
                    checker.restart();
                }
                if !checker.observe(stamp, until, &command.q, &command.qd) {
                    seen.illegal.fetch_add(1, Ordering::Relaxed);
                }
                seen.commands.fetch_add(1, Ordering::Relaxed);
                *seen.last.lock().unwrap() = Some(command);
                state.echo(&command, now);
                state.q = command.q;
                state.qd = command.qd;
            });
            states.publish(monotonic_now_ns(), state).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
    });
    (peer, log)
}

/// A pen that draws circles of 2 cm, 200 samples per second.
pub fn pen(site: &Site) -> Peer {
    let instance = site.instance();
    Peer::start(move |quit| {
        let session = Session::open(&instance, "pen").unwrap();
        let services = Services::open(&session).unwrap();
        let mut feed = services.pen.publisher().unwrap();
        let begin = monotonic_now_ns();
        while !quit.load(Ordering::Acquire) {
            let now = monotonic_now_ns();
            let angle = 6.0 * (now - begin) as f64 * 1e-9;
            let sample = PenSample {
                device_stamp_ns: now,
                x_m: 0.02 * angle.cos(),
                y_m: 0.02 * angle.sin(),
                pressure: 0.5,
                flags: pen_flags::CONTACT | pen_flags::IN_RANGE,
                ..PenSample::default()
            };
            feed.publish(now, sample).unwrap();
            std::thread::sleep(Duration::from_millis(5));
        }
    })
}

/// A process that repeats the last displacement.
pub fn predictor(site: &Site) -> Peer {
    let instance = site.instance();
    Peer::start(move |quit| {
        let session = Session::open(&instance, "predictor").unwrap();
        let services = Services::open(&session).unwrap();
        let mut steps = services.pen_step.subscriber(PenStep::QOS.buffer, HeaderBounds::DEFAULT).unwrap();
        let mut previews = services.preview.publisher().unwrap();
        while !quit.load(Ordering::Acquire) {
            steps.drain(|step| {
                let mut preview =
                    PenPreview { base_index: step.index, count: step.wanted, ..PenPreview::default() };
                for (ahead, (x, y)) in (1..).map(f64::from).zip(preview.x_m.iter_mut().zip(&mut preview.y_m))
                {
                    (*x, *y) = (step.x_m + ahead * step.dx_m, step.y_m + ahead * step.dy_m);
                }
                previews.publish(monotonic_now_ns(), preview).unwrap();
            });
            std::thread::sleep(Duration::from_millis(1));
        }
    })
}
