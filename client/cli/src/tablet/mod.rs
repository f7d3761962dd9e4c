//! `foretrace tablet`: a pen tablet, or a mouse or touchscreen in its stead, as the pen.
//!
//! Contract: readings go out as they come, stamped by the kernel; a pen at rest is sent again, and one that
//! leaves is reported once. Outlives the daemon and the device. In the order of a reading's way: `choice`,
//! then foretrace-tablet, then `feeding`; `words` are what a person types meanwhile.

mod choice;
mod feeding;
mod options;
mod words;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foretrace_client::{Claimant, HolderKind, Lasting, monotonic_now_ns};
use foretrace_config::plain;
use foretrace_tablet::{Device, DeviceKind, Input, MappedHand, TabletReader, UDEV_RULE, list};
use serde::Serialize;

use crate::attach::{attach_within, unattached};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::settings::InstanceArgs;
use crate::take_over::TakeOver;
use choice::unusable;
use feeding::{Feeding, MARGIN, TabletCounts};
use options::HandArgs;
use words::Words;

/// Between two attempts to find a device that was unplugged.
const AGAIN: Duration = Duration::from_millis(500);

/// Write with a pen tablet: its pen is the pen that the arm follows
///
/// Finds the tablet, or takes the one of --device; reads position, contact, pressure, tilt, buttons and the
/// eraser end with the kernel's own stamps. The middle of the active area is the pen's origin. Unplugged, it
/// waits for the tablet to come back. Other programs see the tablet as before, unless --grab. Type clutch,
/// scale or lock while it runs.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  foretrace tablet\n  foretrace tablet --list\n  foretrace tablet --device \
                  /dev/input/by-id/usb-Wacom-event-mouse --clutch 1\n  foretrace tablet --pointer        \
                  # a mouse, where there is no tablet\n  foretrace tablet --udev-rule"
)]
pub(crate) struct TabletArgs {
    /// The device, best by its name in /dev/input/by-id
    #[arg(long, value_name = "FILE")]
    device: Option<PathBuf>,

    /// Size of the active area [mm], for devices that do not tell it
    #[arg(long, value_name = "WxH", value_parser = options::millimetres)]
    mm: Option<[f64; 2]>,

    /// Where there is no tablet, take the mouse or touchscreen
    #[arg(long)]
    pointer: bool,

    /// Keep the device from all other programs
    #[arg(long)]
    grab: bool,

    /// List the devices that can be the pen, and end
    #[arg(long)]
    list: bool,

    /// Print a udev rule that lets the person at the machine read pen tablets, and end
    #[arg(long, conflicts_with = "list")]
    udev_rule: bool,

    #[command(flatten)]
    hand: HandArgs,

    #[command(flatten)]
    take_over: TakeOver,

    /// Shortest time between two reports of rate and counts [s]; reports only changes
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = crate::values::positive)]
    status_every: f64,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct TabletReport {
    device: PathBuf,
    name: String,
    kind: &'static str,
    #[serde(flatten)]
    counts: TabletCounts,
    /// Readings that came faster than they could be sent on.
    without_room: u64,
    /// How often the kernel had to drop events.
    dropped: u64,
    unplugged: u64,
    rate_hz: Option<f64>,
    jitter_ms: Option<f64>,
}

pub(crate) fn run(args: &TabletArgs) -> Result<(), Failure> {
    args.json.claim()?;
    if args.udev_rule {
        say!("{}", UDEV_RULE.trim_end());
        return Ok(());
    }
    if args.list {
        return choice::tell(&list().map_err(|error| unusable(&error))?);
    }
    let interrupt = Interrupt::listen()?;
    let path = match &args.device {
        Some(path) => path.clone(),
        None => choice::only(&list().map_err(|error| unusable(&error))?, args.pointer)?.path.clone(),
    };
    let device = Device::open(&path, args.mm, args.grab).map_err(|error| unusable(&error))?;
    if args.device.is_some() && device.kind() != DeviceKind::Pen && !args.pointer {
        let what = format!("{} is no pen tablet but a {} device", path.display(), device.kind().label());
        return Err(Failure::usage(what, "say --pointer to write with it all the same"));
    }
    let kind = if device.kind() == DeviceKind::Pen { HolderKind::Tablet } else { HolderKind::Pointer };
    let who = Claimant::new(kind, &path.display().to_string());
    let foretrace = attach_within(&args.instance.instance()?, Duration::from_secs_f64(args.wait))?;
    let feed = args.take_over.pen(&foretrace, &who).map_err(unattached)?;
    let mut hand = MappedHand::new(args.hand.mapping());
    hand.lock(args.hand.lock);
    let mut feeding = Feeding::new(Lasting::new(foretrace, feed), who, hand, args.hand.clutch);
    let mut plugged = Plugged::begin(device, path, args)?;
    note!("tablet: {} ({}); type: {}", plugged.path.display(), plain(&plugged.name), words::HELP);
    let mut words = Words::listen()?;
    let begin = Instant::now();
    let mut shown =
        CountsReport { every: Duration::from_secs_f64(args.status_every), last: begin, line: String::new() };
    let over = || args.seconds.is_some_and(|seconds| begin.elapsed().as_secs_f64() >= seconds);
    while !interrupt.is_set() && !over() {
        match plugged.next() {
            Input::Decoded(decoded) => feeding.take(decoded, words.clutched())?,
            Input::Quiet => feeding.rest(words.clutched())?,
            Input::Unplugged => feeding.gone(monotonic_now_ns())?,
        }
        words.carry_out(&mut feeding.hand);
        feeding.still_ours()?;
        feeding.follow();
        shown.tell(&feeding, &plugged);
    }
    let report = plugged.report(&feeding);
    say!(
        "{} readings and {} repeats sent, {} unheard, {} refused, {} late, {} lost",
        report.counts.readings,
        report.counts.repeats,
        report.counts.unheard,
        report.counts.refused,
        report.counts.late,
        report.without_room + report.dropped
    );
    args.json.write(&report)
}

/// The device, while it is there and while it is not.
struct Plugged<'a> {
    args: &'a TabletArgs,
    path: PathBuf,
    name: String,
    kind: DeviceKind,
    reader: Option<TabletReader>,
    next_attempt: Instant,
    unplugged: u64,
    /// Of readers that have ended.
    without_room: u64,
    dropped: u64,
}

impl<'a> Plugged<'a> {
    fn begin(device: Device, path: PathBuf, args: &'a TabletArgs) -> Result<Self, Failure> {
        let (name, kind) = (device.name().to_owned(), device.kind());
        let reader = Some(TabletReader::start(device).map_err(no_thread)?);
        let next_attempt = Instant::now();
        Ok(Self { args, path, name, kind, reader, next_attempt, unplugged: 0, without_room: 0, dropped: 0 })
    }

    fn next(&mut self) -> Input {
        let Some(reader) = &self.reader else {
            std::thread::sleep(MARGIN);
            self.look_again();
            return Input::Quiet;
        };
        let input = reader.next(MARGIN);
        if matches!(input, Input::Unplugged) {
            (self.without_room, self.dropped) = self.losses();
            self.reader = None;
            self.unplugged += 1;
            note!("tablet: {} is gone; waiting for it", self.path.display());
        }
        input
    }

    fn look_again(&mut self) {
        if Instant::now() < self.next_attempt {
            return;
        }
        self.next_attempt = Instant::now() + AGAIN;
        let Some(device) = self.found_again() else { return };
        match TabletReader::start(device) {
            Ok(reader) => {
                self.reader = Some(reader);
                note!("tablet: {} is back", self.path.display());
            }
            Err(error) => note!("foretrace: {}", no_thread(error)),
        }
    }

    fn found_again(&mut self) -> Option<Device> {
        // A name in /dev/input/by-id leads to the device whatever its number is.
        let open = |path: &Path| Device::open(path, self.args.mm, self.args.grab).ok();
        let is_it = |device: &Device| device.name() == self.name && device.kind() == self.kind;
        if let Some(device) = open(&self.path).filter(is_it) {
            return Some(device);
        }
        let path = choice::again(&list().ok()?, &self.path, &self.name, self.kind)?;
        let device = open(&path).filter(is_it)?;
        self.path = path;
        Some(device)
    }

    /// Readings without room, and dropped events, of all readers.
    fn losses(&self) -> (u64, u64) {
        let now = self.reader.as_ref();
        (
            self.without_room + now.map_or(0, TabletReader::without_room),
            self.dropped + now.map_or(0, TabletReader::dropped),
        )
    }

    fn report(&self, feeding: &Feeding) -> TabletReport {
        let (without_room, dropped) = self.losses();
        let rate = feeding.rate.measured();
        TabletReport {
            device: self.path.clone(),
            name: self.name.clone(),
            kind: self.kind.label(),
            counts: feeding.counts.clone(),
            without_room,
            dropped,
            unplugged: self.unplugged,
            rate_hz: rate.map(|rate| rate.hz),
            jitter_ms: rate.map(|rate| rate.jitter_ms),
        }
    }
}

/// The last report of rate and counts.
struct CountsReport {
    every: Duration,
    last: Instant,
    line: String,
}

impl CountsReport {
    fn tell(&mut self, feeding: &Feeding, plugged: &Plugged<'_>) {
        if self.last.elapsed() < self.every {
            return;
        }
        self.last = Instant::now();
        let report = plugged.report(feeding);
        let rate = match (report.rate_hz, report.jitter_ms) {
            (Some(hz), Some(jitter)) => format!("{hz:.0} Hz, jitter {jitter:.1} ms"),
            _ => "rate not known yet".to_owned(),
        };
        let pen = match feeding.pen() {
            None => "no pen in range",
            Some(true) => "writing",
            Some(false) => "hovering",
        };
        let counts = &report.counts;
        let line = format!(
            "{pen}; {rate}; {} readings, {} unheard, {} refused, {} late, {} lost",
            counts.readings,
            counts.unheard,
            counts.refused,
            counts.late,
            report.without_room + report.dropped
        );
        if line != self.line {
            note!("tablet: {line}");
            self.line = line;
        }
    }
}

fn no_thread(error: std::io::Error) -> Failure {
    Failure::failed(format_args!("no thread can be started: {error}"), "raise `ulimit -u`")
}
