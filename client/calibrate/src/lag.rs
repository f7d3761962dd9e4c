//! A small test motion, and the lag with which the arm follows it.
//!
//! Contract: the motion enters the loop as a hovering pen, so all limits and stops of the loop hold. Before
//! this ends, in whatever way, the pen comes to rest where it is, and an arm that was armed here is released.

use std::path::Path;
use std::time::{Duration, Instant};

use foretrace_client::wire::pen_flags;
use foretrace_client::{
    Claimant, Foretrace, HolderKind, Mode, PenFeed, PenReading, Requests, StatusReader, Telemetry,
    monotonic_now_ns,
};
use foretrace_config::Config;
use foretrace_failure::{Cause, Failure};
use foretrace_report::Tell;
use foretrace_report::failures::{may_pass, refused, unattached};
use foretrace_report::stopped;
use foretrace_sim::lag::{Identified, LagError, Sample, identify};
use foretrace_sim::path::PathSample;
use foretraced::rt::os::sleep_until_ns;

use crate::lag_report::CalibrationReport;
use crate::listener::MotionListener;
use crate::motion::{MotionSpace, motion};
use crate::picture;
use crate::same_tool::same_tool;

const ANSWER: Duration = Duration::from_secs(2);
/// How long an arm may take to report, and the daemon to arm.
const PATIENCE: Duration = Duration::from_secs(10);
const STRIDE: Duration = Duration::from_millis(20);
/// Time before the pen moves, for the loop to get ready.
const LEAD_NS: u64 = 50_000_000;
/// The loop may take this long to notice a pen.
const NOTICE_S: f64 = 0.3;
/// Samples of rest after an interruption, 5 ms apart.
const REST_SAMPLES: u64 = 60;

/// The motion that is asked for.
#[derive(Debug, Clone, Copy)]
pub struct LagOptions {
    /// Arm the daemon for the motion, and disarm it at the end.
    pub arm: bool,
    /// Along each axis, at the tool \[mm\].
    pub amplitude_mm: f64,
    pub seconds: f64,
}

pub struct MeasuredLag {
    pub report: CalibrationReport,
    found: Identified,
    commanded: Vec<Sample>,
    measured: Vec<Sample>,
}

impl MeasuredLag {
    /// Draws motion and models.
    ///
    /// # Errors
    ///
    /// The picture cannot be written.
    pub fn draw(&self, file: &Path) -> Result<(), Failure> {
        picture::draw(file, &self.report.words, &self.found, &self.commanded, &self.measured)
            .map_err(|error| Failure::failed(error, "give a writable --plot FILE.svg"))
    }
}

/// Moves the arm, and measures how late it is.
///
/// # Errors
///
/// It is not armed or another tool than `config` says, stopped in the motion, or followed by no model.
pub fn measure(
    foretrace: &Foretrace,
    config: &Config,
    options: LagOptions,
    interrupted: &dyn Fn() -> bool,
    tell: Tell<'_>,
) -> Result<MeasuredLag, Failure> {
    let mut motion = TestMotion::open(foretrace, interrupted)?;
    let performed = motion.perform(options, config, tell);
    let let_go = motion.let_go();
    performed.and(let_go)?;

    let listener = motion.listener;
    let counts = listener.counts();
    let found = identify(&listener.commanded, &listener.measured).map_err(|error| match error {
        LagError::NotCommanded { .. } if listener.disabled() > 0 => {
            let disabled = listener.disabled();
            Failure::failed(format_args!("{error} ({disabled} commands had the arm disabled)"), "")
        }
        error => Failure::failed(
            format_args!(
                "{error} (received {} commands, {} lost; {} joint states, {} lost)",
                counts.commands, counts.commands_lost, counts.states, counts.states_lost
            ),
            "",
        ),
    })?;
    let report = CalibrationReport::new(&found, counts);
    Ok(MeasuredLag { report, found, commanded: listener.commanded, measured: listener.measured })
}

/// Everything the motion needs.
struct TestMotion<'a> {
    interrupted: &'a dyn Fn() -> bool,
    status: StatusReader,
    telemetry: Telemetry,
    requests: Option<Requests>,
    feed: PenFeed,
    listener: MotionListener,
    armed_here: bool,
    /// Where the pen is.
    last: Option<PathSample>,
    unheard: u64,
}

impl<'a> TestMotion<'a> {
    fn open(foretrace: &Foretrace, interrupted: &'a dyn Fn() -> bool) -> Result<Self, Failure> {
        let who = Claimant::new(HolderKind::Program, "foretrace calibrate lag");
        let feed = foretrace.pen_feed_as(&who).map_err(unattached)?;
        Ok(Self {
            interrupted,
            status: foretrace.status().map_err(unattached)?,
            telemetry: foretrace.telemetry().map_err(unattached)?,
            requests: Some(foretrace.requests()),
            feed,
            listener: MotionListener::open(foretrace).map_err(unattached)?,
            armed_here: false,
            last: None,
            unheard: 0,
        })
    }

    fn perform(&mut self, options: LagOptions, config: &Config, tell: Tell<'_>) -> Result<(), Failure> {
        let q = self.measured_joints()?;
        self.ready(options.arm)?;
        same_tool(&mut self.telemetry, config)?;
        let settings = config.follower_settings();
        let plane = settings.plane;
        let tool = plane.point_from_base(&config.robot().chain.forward(&q).position);
        let [x, y, _] = config.settings().plane.workspace_m;
        let amplitude_m = options.amplitude_mm * 1e-3;
        let space = MotionSpace { tool: [tool.x, tool.y], workspace: [x, y], amplitude_m };
        let path = motion(&space, options.seconds, &plane)?;
        let duration_s = path.last().map_or(0.0, |last| last.t_s);
        tell(&format!(
            "calibrate: the tool moves by ±{} mm about where it stands, {duration_s:.0} s in all",
            options.amplitude_mm
        ));
        let played = self.play(&path);
        if played.is_err() {
            self.rest();
        }
        played
    }

    /// The joints as they are now \[rad\].
    fn measured_joints(&mut self) -> Result<[f64; 6], Failure> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            self.listener.listen();
            if let Some(state) = self.listener.measured.last() {
                return Ok(state.q);
            }
            if Instant::now() > deadline {
                return Err(Failure::failed(
                    format_args!("no arm reports its joints (waited {} s)", PATIENCE.as_secs()),
                    "start the hardware interface, or `foretrace arm sim`",
                ));
            }
            self.pause()?;
        }
    }

    /// Waits until the loop would follow a pen; arms it where that is wanted.
    fn ready(&mut self, arm: bool) -> Result<(), Failure> {
        let deadline = Instant::now() + PATIENCE;
        let status = self.status.next_within(ANSWER).ok_or_else(|| {
            Failure::failed("the daemon does not report its status", "see `foretrace status`")
        })?;
        let mode = Mode::try_from(status.mode).unwrap_or(Mode::Idle);
        if follows(mode) {
            return Ok(());
        }
        if !arm {
            return Err(Failure::new(
                Cause::Refused,
                format_args!("the arm is not armed (mode {})", mode.label()),
                "ask `foretrace request arm`, or give --arm",
            ));
        }
        while let Some(requests) = &mut self.requests {
            match requests.arm(ANSWER) {
                Ok(_) => break,
                Err(error) if may_pass(&error) && Instant::now() < deadline => self.pause()?,
                Err(error) => return Err(refused(&error)),
            }
        }
        self.armed_here = true;
        while !self.mode().is_some_and(follows) {
            if Instant::now() > deadline {
                return Err(Failure::failed("the daemon did not arm in time", "see `foretrace status`"));
            }
            self.pause()?;
        }
        Ok(())
    }

    fn play(&mut self, path: &[PathSample]) -> Result<(), Failure> {
        let begin = monotonic_now_ns() + LEAD_NS;
        self.listener.begin(begin);
        for sample in path {
            self.check()?;
            self.send(begin + (sample.t_s * 1e9) as u64, sample);
            self.listener.listen();
            let mode = self.mode();
            if sample.t_s > NOTICE_S && !mode.is_some_and(follows) {
                return Err(self.stopped(mode));
            }
        }
        if self.unheard > 0 {
            return Err(Failure::failed(
                format_args!("{} pen samples did not reach the daemon", self.unheard),
                "see that it still runs: `foretrace status`",
            ));
        }
        Ok(())
    }

    /// The pen stays where it is, so that the loop sees it at rest and not gone.
    fn rest(&mut self) {
        let Some(last) = self.last else { return };
        let begin = monotonic_now_ns();
        for index in 0..REST_SAMPLES {
            self.send(begin + index * 5_000_000, &last);
        }
    }

    fn send(&mut self, due: u64, sample: &PathSample) {
        while monotonic_now_ns() < due {
            sleep_until_ns(due);
        }
        let reading = PenReading {
            device_stamp_ns: due,
            x_m: sample.x_m,
            y_m: sample.y_m,
            contact: sample.contact,
            more_flags: pen_flags::IN_RANGE,
            ..PenReading::default()
        };
        self.unheard += u64::from(!matches!(self.feed.send(reading), Ok(true)));
        self.last = Some(*sample);
    }

    /// Releases an arm that was armed here.
    fn let_go(&mut self) -> Result<(), Failure> {
        match &mut self.requests {
            Some(requests) if self.armed_here => {
                requests.disarm(ANSWER).map(|_| ()).map_err(|error| refused(&error))
            }
            _ => Ok(()),
        }
    }

    fn mode(&mut self) -> Option<Mode> {
        self.status.latest().and_then(|status| Mode::try_from(status.mode).ok())
    }

    fn stopped(&mut self, mode: Option<Mode>) -> Failure {
        let mode = mode.map_or("unknown", Mode::label);
        let explained = self.status.latest().map(stopped::explained);
        let (reason, remedy) =
            explained.unwrap_or_else(|| ("unknown".to_owned(), "see `foretrace status`".to_owned()));
        Failure::failed(
            format_args!("the daemon stopped following in mid-motion (mode {mode}, {reason})"),
            remedy,
        )
    }

    fn check(&self) -> Result<(), Failure> {
        if (self.interrupted)() { Err(Failure::interrupted("interrupted", "")) } else { Ok(()) }
    }

    fn pause(&self) -> Result<(), Failure> {
        self.check()?;
        std::thread::sleep(STRIDE);
        Ok(())
    }
}

/// A loop in this mode follows a pen that comes.
fn follows(mode: Mode) -> bool {
    matches!(mode, Mode::Armed | Mode::Following | Mode::Holding)
}
