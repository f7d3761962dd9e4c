//! The demo's processes over a run: up, armed, following, disarmed, down.
//!
//! Contract: every wait looks for Ctrl-C and for children that ended; whatever goes wrong, dropping the crew
//! ends them all, the newest first.

use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use foretrace_client::{Foretrace, Instance, Mode, Requests, ServiceError, StatusReader, Telemetry};
use indicatif::{ProgressBar, ProgressStyle};

use super::children::{Child, LastWords};
use super::gathered::{Gathered, JointUse, StopNote, TickNote};
use crate::attach::unattached;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{may_draw, note};
use crate::request::{may_pass, refused};

/// A busy machine takes seconds to start three processes.
const STARTING: Duration = Duration::from_secs(30);
/// A jerk-limited stop takes well under a second.
const STOPPING: Duration = Duration::from_secs(5);
const ANSWER: Duration = Duration::from_secs(2);
const STRIDE: Duration = Duration::from_millis(20);

/// What is read from the daemon while it runs.
pub(crate) struct Watch {
    status: StatusReader,
    telemetry: Telemetry,
    requests: Requests,
    pub(crate) gathered: Gathered,
    /// When the newest stop that is known latched [ns].
    stopped_ns: u64,
}

/// How following ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Followed {
    /// After the time asked for.
    Whole,
    /// A stop latched.
    Stopped,
}

impl Watch {
    pub(crate) fn open(foretrace: &Foretrace) -> Result<Self, Failure> {
        Ok(Self {
            status: foretrace.status().map_err(unattached)?,
            telemetry: foretrace.telemetry().map_err(unattached)?,
            requests: foretrace.requests().map_err(unattached)?,
            gathered: Gathered::default(),
            stopped_ns: 0,
        })
    }

    /// Takes in what came since the last look.
    fn read(&mut self) {
        let Self { telemetry, gathered, stopped_ns, .. } = self;
        let Gathered { ticks, stops, joints, .. } = gathered;
        telemetry.drain(|record| {
            ticks.push(TickNote::of(record));
            joints.see(record);
            if record.stop.at_ns > *stopped_ns {
                *stopped_ns = record.stop.at_ns;
                stops.push(StopNote::of(record.fault, &record.stop));
            }
        });
        self.gathered.status = self.status.latest().copied().or(self.gathered.status);
        // The record of the tick may have been lost; the status repeats its stop.
        if let Some(status) = self.gathered.status.filter(|status| status.stop.at_ns > self.stopped_ns) {
            self.stopped_ns = status.stop.at_ns;
            self.gathered.stops.push(StopNote::of(status.fault, &status.stop));
        }
    }

    /// Discards everything recorded before this moment.
    fn begin(&mut self) {
        self.read();
        self.gathered.ticks.clear();
        self.gathered.stops.clear();
        self.gathered.joints = JointUse::default();
    }

    /// The daemon's last status.
    pub(crate) fn last_words(mut self) -> Gathered {
        let last = self.status.next_within(ANSWER);
        self.read();
        self.gathered.status = last.or(self.gathered.status);
        self.gathered.ticks_lost = self.telemetry.lost();
        self.gathered
    }

    fn mode(&self) -> Option<Mode> {
        self.gathered.status.and_then(|status| Mode::try_from(status.mode).ok())
    }
}

/// The children and the progress bar.
pub(crate) struct Crew {
    interrupt: Interrupt,
    children: Vec<(&'static str, Child)>,
    bar: Option<ProgressBar>,
}

impl Crew {
    pub(crate) fn new(interrupt: Interrupt, seconds: f64) -> Self {
        let bar = may_draw().then(|| {
            let bar = ProgressBar::new((seconds * 1e3) as u64);
            if let Ok(style) = ProgressStyle::with_template("{msg:<34} {wide_bar} {percent:>3} %") {
                bar.set_style(style);
            }
            bar
        });
        Self { interrupt, children: Vec::new(), bar }
    }

    /// Starts `foretrace ARGUMENTS...`.
    pub(crate) fn start(&mut self, name: &'static str, arguments: &[String]) -> Result<(), Failure> {
        self.say(&format!("starting the {name}"));
        self.children.push((name, Child::start(name, arguments)?));
        Ok(())
    }

    /// Waits for the daemon.
    pub(crate) fn attached(&mut self, instance: &Instance) -> Result<Foretrace, Failure> {
        let deadline = Instant::now() + STARTING;
        loop {
            self.check()?;
            match Foretrace::attach_within(instance, STRIDE) {
                Ok(foretrace) => return Ok(foretrace),
                Err(ServiceError::NoDaemon { .. }) if Instant::now() < deadline => {}
                Err(error) => return Err(unattached(error)),
            }
        }
    }

    /// Waits until somebody listens at `address`.
    pub(crate) fn listening(&mut self, address: SocketAddr) -> Result<(), Failure> {
        let deadline = Instant::now() + STARTING;
        loop {
            self.check()?;
            match TcpStream::connect_timeout(&address, STRIDE) {
                Ok(_) => return Ok(()),
                Err(_) if Instant::now() < deadline => std::thread::sleep(STRIDE),
                Err(error) => {
                    return Err(Failure::failed(format_args!("nobody listens at {address}: {error}"), ""));
                }
            }
        }
    }

    /// Asks to arm until the arm has reported its joints.
    pub(crate) fn arm(&mut self, watch: &mut Watch) -> Result<(), Failure> {
        let deadline = Instant::now() + STARTING;
        loop {
            self.check()?;
            match watch.requests.arm(ANSWER) {
                Ok(_) => break,
                Err(error) if may_pass(&error) && Instant::now() < deadline => std::thread::sleep(STRIDE),
                Err(error) => return Err(refused(&error)),
            }
        }
        watch.begin();
        self.say("armed");
        Ok(())
    }

    /// Lets the arm follow for `seconds`.
    pub(crate) fn follow(&mut self, watch: &mut Watch, seconds: f64) -> Result<Followed, Failure> {
        self.say("the arm follows the pen");
        let mut begin = None;
        let patience = Instant::now() + STARTING;
        loop {
            self.check()?;
            watch.read();
            let now = Instant::now();
            match watch.mode() {
                Some(Mode::Following) if begin.is_none() => begin = Some(now),
                Some(Mode::Fault | Mode::Stopped) => return Ok(Followed::Stopped),
                _ => {}
            }
            match begin {
                None if now > patience => {
                    return Err(Failure::failed(
                        format_args!("the arm did not follow the pen within {} s", STARTING.as_secs()),
                        "see the messages above",
                    ));
                }
                Some(begin) if (now - begin).as_secs_f64() >= seconds => return Ok(Followed::Whole),
                Some(begin) => {
                    if let Some(bar) = &self.bar {
                        bar.set_position((now - begin).as_millis() as u64);
                    }
                }
                None => {}
            }
            std::thread::sleep(STRIDE);
        }
    }

    /// Stops the arm smoothly and disarms it.
    pub(crate) fn let_go(&mut self, watch: &mut Watch) -> Result<(), Failure> {
        watch.read();
        let stops = watch.gathered.stops.len();
        watch.requests.disarm(ANSWER).map_err(|error| refused(&error))?;
        let deadline = Instant::now() + STOPPING;
        while watch.mode() != Some(Mode::Idle) {
            self.check()?;
            if Instant::now() > deadline {
                return Err(Failure::failed("the arm was not let go in time", "see the messages above"));
            }
            watch.read();
            std::thread::sleep(STRIDE);
        }
        // The stop that the demo itself has just asked for is not reported.
        watch.gathered.stops.truncate(stops);
        Ok(())
    }

    /// What a child says on stderr.
    pub(crate) fn words(&self, name: &str) -> LastWords {
        let child = self.children.iter().find(|(known, _)| *known == name);
        child.map(|(_, child)| child.words()).unwrap_or_default()
    }

    /// Ends one child in order and returns what it printed.
    pub(crate) fn end(&mut self, name: &str) -> Result<(), Failure> {
        let Some(index) = self.children.iter().position(|(known, _)| *known == name) else { return Ok(()) };
        let (name, mut child) = self.children.remove(index);
        child.end()?;
        for line in child.last_words() {
            if line.contains("WARN") || line.contains("ERROR") {
                self.say(&format!("{name}: {line}"));
            }
        }
        Ok(())
    }

    /// Takes the progress bar away.
    pub(crate) fn done(self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn check(&mut self) -> Result<(), Failure> {
        self.interrupt.check()?;
        self.children.iter_mut().try_for_each(|(_, child)| child.expect_alive())
    }

    fn say(&self, words: &str) {
        match &self.bar {
            Some(bar) => {
                bar.set_message(words.to_owned());
                bar.tick();
            }
            None => note!("demo: {words}"),
        }
    }
}

impl Drop for Crew {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        while self.children.pop().is_some() {}
    }
}
