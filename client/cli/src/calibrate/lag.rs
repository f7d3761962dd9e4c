//! `foretrace calibrate lag`: a small test motion, and the lag with which the arm follows it.
//!
//! Contract: the motion enters the loop as a hovering pen, so all limits and stops of the loop hold. Before
//! this ends, in whatever way, the pen comes to rest where it is, and an arm that was armed here is released.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_client::{
    Claimant, Foretrace, HolderKind, Mode, PenFeed, PenReading, Requests, StatusReader, Telemetry,
    monotonic_now_ns, pen_flags,
};
use foretrace_config::Config;
use foretrace_sim::lag::{LagError, identify};
use foretrace_sim::path::PathSample;

use super::agreement::same_tool;
use super::listen::Listener;
use super::report::CalibrationReport;
use crate::attach::{attach_within, instance_of, unattached};
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::os;
use crate::output::{JsonArgs, note, note_replaced};
use crate::request::{may_pass, refused};
use crate::settings::SettingsArgs;
use crate::stopped;
use foretrace_calibrate::motion::{Place, motion};
use foretrace_calibrate::picture;

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

/// Measure the arm's lag: make a small test motion and compare commands with joint states
///
/// Plays a gentle, hovering pen motion around the tool's position, a few frequencies at once, from rest to
/// rest. The daemon must be armed (or give --arm). Fits a pure delay and a delay with a servo behind it to
/// all joints that move, and says which one the arm is, how certain that is, and what to write into the
/// settings. No pen may be feeding the loop. Needs the settings that the daemon runs with.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  foretrace calibrate lag --arm\n  foretrace calibrate lag --amplitude-mm 5 \
                  --seconds 10 --json lag.json"
)]
pub(crate) struct LagArgs {
    /// Arm the daemon for the motion, and disarm it at the end
    #[arg(long)]
    arm: bool,

    /// Amplitude of the motion along each axis, at the tool [mm], 1 to 50
    #[arg(long, value_name = "MM", default_value_t = 10.0, value_parser = amplitude)]
    amplitude_mm: f64,

    /// Length of the motion [s], 2 to 120
    #[arg(long, value_name = "S", default_value_t = 6.0, value_parser = seconds)]
    seconds: f64,

    /// File for the picture
    #[arg(long, value_name = "FILE.svg", default_value = "foretrace-lag.svg")]
    plot: PathBuf,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &LagArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let config = args.settings.load()?;
    let foretrace = attach_within(&instance_of(config.settings())?, Duration::ZERO)?;
    let mut stage = Stage::open(&foretrace, interrupt)?;
    let ran = stage.perform(args, &config);
    let let_go = stage.let_go();
    ran.and(let_go)?;

    let Stage { listener, .. } = &stage;
    let heard = listener.heard();
    let found = identify(&listener.commanded, &listener.measured).map_err(|error| match error {
        LagError::NotCommanded { .. } if listener.disabled() > 0 => Failure::failed(
            format_args!("{error} ({} commands had the arm disabled)", listener.disabled()),
            "",
        ),
        error => Failure::failed(
            format_args!(
                "{error} (received {} commands, {} lost; {} joint states, {} lost)",
                heard.commands, heard.commands_lost, heard.states, heard.states_lost
            ),
            "",
        ),
    })?;
    let report = CalibrationReport::new(&found, heard);
    note_replaced(&args.plot, "--plot FILE.svg");
    picture::draw(&args.plot, &report.words, &found, &listener.commanded, &listener.measured)
        .map_err(|error| Failure::failed(error, "give a writable --plot FILE.svg"))?;
    report.say(&args.plot);
    args.json.write(&report)
}

/// Everything the motion needs.
struct Stage {
    interrupt: Interrupt,
    status: StatusReader,
    telemetry: Telemetry,
    requests: Option<Requests>,
    feed: PenFeed,
    listener: Listener,
    armed_here: bool,
    /// Where the pen is.
    last: Option<PathSample>,
    unheard: u64,
}

impl Stage {
    fn open(foretrace: &Foretrace, interrupt: Interrupt) -> Result<Self, Failure> {
        let who = Claimant::new(HolderKind::Program, "foretrace calibrate lag");
        let feed = foretrace.pen_feed_as(&who).map_err(unattached)?;
        Ok(Self {
            interrupt,
            status: foretrace.status().map_err(unattached)?,
            telemetry: foretrace.telemetry().map_err(unattached)?,
            requests: Some(foretrace.requests().map_err(unattached)?),
            feed,
            listener: Listener::open(foretrace)?,
            armed_here: false,
            last: None,
            unheard: 0,
        })
    }

    fn perform(&mut self, args: &LagArgs, config: &Config) -> Result<(), Failure> {
        let q = self.measured_joints()?;
        self.ready(args.arm)?;
        same_tool(&mut self.telemetry, config)?;
        let settings = config.follower_settings();
        let plane = settings.plane;
        let tool = plane.point_from_base(&config.robot().chain.forward(&q).position);
        let [x, y, _] = config.settings().plane.workspace_m;
        let place =
            Place { tool: [tool.x, tool.y], workspace: [x, y], amplitude_m: args.amplitude_mm * 1e-3 };
        let path = motion(&place, args.seconds, &plane).map_err(super::uncalibrated)?;
        let duration_s = path.last().map_or(0.0, |last| last.t_s);
        note!(
            "calibrate: the tool moves by ±{} mm about where it stands, {duration_s:.0} s in all",
            args.amplitude_mm
        );
        let played = self.play(&path);
        if played.is_err() {
            self.rest();
        }
        played
    }

    /// The joints as they are now [rad].
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
            self.interrupt.check()?;
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
            os::sleep_until(due);
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
        let told = self.status.latest().map(stopped::told);
        let (reason, remedy) =
            told.unwrap_or_else(|| ("unknown".to_owned(), "see `foretrace status`".to_owned()));
        Failure::failed(
            format_args!("the daemon stopped following in mid-motion (mode {mode}, {reason})"),
            remedy,
        )
    }

    fn pause(&self) -> Result<(), Failure> {
        self.interrupt.check()?;
        std::thread::sleep(STRIDE);
        Ok(())
    }
}

/// A loop in this mode follows a pen that comes.
fn follows(mode: Mode) -> bool {
    matches!(mode, Mode::Armed | Mode::Following | Mode::Holding)
}

fn amplitude(text: &str) -> Result<f64, String> {
    between(text, 1.0, 50.0).ok_or_else(|| "a number of millimetres from 1 to 50".to_owned())
}

fn seconds(text: &str) -> Result<f64, String> {
    between(text, 2.0, 120.0).ok_or_else(|| "a number of seconds from 2 to 120".to_owned())
}

fn between(text: &str, low: f64, high: f64) -> Option<f64> {
    text.parse().ok().filter(|value| (low..=high).contains(value))
}
