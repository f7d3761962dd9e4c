//! The demo's processes over a run: up, armed, following, disarmed, down; the console's beside it.
//!
//! Contract: every wait looks for Ctrl-C and for children that ended; whatever goes wrong, dropping the crew
//! ends them all, the newest first.

use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use foretrace_client::{Foretrace, Instance, Mode, Requests, ServiceError};
use foretrace_report::failures::{may_pass, refused};
use foretrace_report::run::{LastWords, RunWatch};
use foretraced::{Base, Source};
use indicatif::{ProgressBar, ProgressStyle};

use super::children::Child;
use crate::attach::unattached;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{may_draw, note};

/// A busy machine takes seconds to start three processes.
const STARTING: Duration = Duration::from_secs(30);
/// A jerk-limited stop takes well under a second.
const STOPPING: Duration = Duration::from_secs(5);
const ANSWER: Duration = Duration::from_secs(2);
const STRIDE: Duration = Duration::from_millis(20);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Followed {
    /// After the time asked for.
    Whole,
    /// A stop latched.
    Stopped,
}

/// Where a crew says what it does.
enum Sayings {
    Bar(ProgressBar),
    Notes,
    Nowhere,
}

/// The children, and what they are doing.
pub(crate) struct Crew {
    interrupt: Interrupt,
    children: Vec<(&'static str, Child)>,
    sayings: Sayings,
}

impl Crew {
    /// One that says what it does: with a bar of `seconds` where there is a terminal.
    pub(crate) fn new(interrupt: Interrupt, seconds: f64) -> Self {
        let mut sayings = Sayings::Notes;
        if may_draw() {
            let bar = ProgressBar::new((seconds * 1e3) as u64);
            if let Ok(style) = ProgressStyle::with_template("{msg:<34} {wide_bar} {percent:>3} %") {
                bar.set_style(style);
            }
            sayings = Sayings::Bar(bar);
        }
        Self { interrupt, children: Vec::new(), sayings }
    }

    /// One that says nothing.
    pub(crate) fn quiet(interrupt: Interrupt) -> Self {
        Self { interrupt, children: Vec::new(), sayings: Sayings::Nowhere }
    }

    /// Starts `foretrace ARGUMENTS...`.
    pub(crate) fn start(&mut self, name: &'static str, arguments: &[String]) -> Result<(), Failure> {
        self.say(&format!("starting the {name}"));
        self.children.push((name, Child::start(name, arguments)?));
        Ok(())
    }

    /// Looks again and again, for as long as it takes to start, until there is an answer; `look` may say that
    /// there is none yet, and why.
    fn awaited<T>(
        &mut self,
        mut look: impl FnMut() -> Result<Result<T, Failure>, Failure>,
    ) -> Result<T, Failure> {
        let deadline = Instant::now() + STARTING;
        loop {
            self.check()?;
            match look()? {
                Err(_) if Instant::now() < deadline => std::thread::sleep(STRIDE),
                answer => return answer,
            }
        }
    }

    /// Waits for the daemon.
    pub(crate) fn attached(&mut self, instance: &Instance) -> Result<Foretrace, Failure> {
        self.awaited(|| match Foretrace::attach_within(instance, STRIDE) {
            Ok(foretrace) => Ok(Ok(foretrace)),
            Err(error @ ServiceError::NoDaemon { .. }) => Ok(Err(unattached(error))),
            Err(error) => Err(unattached(error)),
        })
    }

    /// Waits until somebody listens at `address`.
    pub(crate) fn listening(&mut self, address: SocketAddr) -> Result<(), Failure> {
        self.awaited(|| {
            let connected = TcpStream::connect_timeout(&address, STRIDE).map(drop);
            Ok(connected
                .map_err(|error| Failure::failed(format_args!("nobody listens at {address}: {error}"), "")))
        })
    }

    /// Asks to arm until the arm has reported its joints.
    pub(crate) fn arm(&mut self, requests: &mut Requests) -> Result<(), Failure> {
        self.awaited(|| match requests.arm(ANSWER) {
            Ok(_) => Ok(Ok(())),
            Err(error) if may_pass(&error) => Ok(Err(refused(&error))),
            Err(error) => Err(refused(&error)),
        })?;
        self.say("armed");
        Ok(())
    }

    /// Lets the arm follow for `seconds`.
    pub(crate) fn follow(&mut self, watch: &mut RunWatch, seconds: f64) -> Result<Followed, Failure> {
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
                    if let Sayings::Bar(bar) = &self.sayings {
                        bar.set_position((now - begin).as_millis() as u64);
                    }
                }
                None => {}
            }
            std::thread::sleep(STRIDE);
        }
    }

    /// Stops the arm smoothly and disarms it.
    pub(crate) fn let_go(&mut self, watch: &mut RunWatch) -> Result<(), Failure> {
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

    /// Fails if a child has ended.
    pub(crate) fn expect_alive(&mut self) -> Result<(), Failure> {
        self.children.iter_mut().try_for_each(|(_, child)| child.expect_alive())
    }

    fn check(&mut self) -> Result<(), Failure> {
        self.interrupt.check()?;
        self.expect_alive()
    }

    fn say(&self, words: &str) {
        match &self.sayings {
            Sayings::Bar(bar) => {
                bar.set_message(words.to_owned());
                bar.tick();
            }
            Sayings::Notes => note!("demo: {words}"),
            Sayings::Nowhere => {}
        }
    }
}

impl Drop for Crew {
    fn drop(&mut self) {
        if let Sayings::Bar(bar) = &self.sayings {
            bar.finish_and_clear();
        }
        while self.children.pop().is_some() {}
    }
}

/// The options that select `source`, without the rate, which only the daemon needs.
pub(crate) fn settings_arguments(source: &Source) -> Vec<String> {
    let mut out = match &source.base {
        Base::File(file) => words(&["--config", &file.display().to_string()]),
        Base::Preset(name) => words(&["--preset", name]),
    };
    for (key, value) in &source.overrides {
        out.extend(["--set".to_owned(), format!("{key}={value}")]);
    }
    out
}

pub(crate) fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}
