//! `foretrace record --pen`: records the pen samples of a running instance.
//!
//! Contract: every sample that the daemon receives is written, or counted as lost; the recording appears
//! under its name when it is whole, and what was recorded until then is beside it. Ctrl-C is the ordinary
//! end. Outlives the daemon.

use std::path::Path;
use std::time::{Duration, Instant};

use foretrace_client::{DaemonChange, Foretrace, Lookout, PenWatch};
use foretrace_sim::data::PenLog;
use serde::Serialize;

use crate::attach::unattached;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{note, say};

use super::RecordArgs;

/// Between two looks; 256 samples are kept meanwhile.
const NAP: Duration = Duration::from_millis(50);

/// The result; keys are stable.
#[derive(Debug, Default, Serialize)]
struct PenRecordReport {
    samples: u64,
    rate_hz: f64,
    /// From the first sample to the last.
    seconds: f64,
    /// Sent by the pen, but not received here.
    lost: u64,
    /// Left out: stamps that repeat or go back.
    out_of_order: u64,
}

pub(super) fn run(args: &RecordArgs, pen: &Path) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let mut foretrace = args.instance.attach()?;
    let mut watch = foretrace.pen_watch().map_err(unattached)?;
    let mut log = PenLog::create(pen, &args.writer).map_err(|error| {
        Failure::bad_input(error, "give a new --pen FILE in a folder that can be written")
    })?;
    if let Some(aside) = log.aside() {
        note!("record: an interrupted recording of that name is kept: {}", aside.display());
    }
    note!("record: recording the pen into {} until Ctrl-C", pen.display());
    let part = log.part().to_path_buf();
    let kept = |error: std::io::Error| {
        let remedy = format!("what was recorded is in {}", part.display());
        Failure::failed(format_args!("cannot write the recording: {error}"), remedy)
    };
    let mut report = PenRecordReport::default();
    let deadline = args.seconds.map(|s| Instant::now() + Duration::from_secs_f64(s));
    let mut lookout = Lookout::default();
    let mut ends = false;
    while !ends {
        ends = interrupt.is_set() || deadline.is_some_and(|deadline| Instant::now() >= deadline);
        report.out_of_order += written(&mut watch, &mut log).map_err(kept)?;
        if let Some(renewed) = renewed(&mut lookout, &mut foretrace) {
            report.lost += watch.lost();
            watch = renewed;
        }
        if !ends {
            std::thread::sleep(NAP);
        }
    }
    report.lost += watch.lost();
    let summary = log.finish().map_err(kept)?;
    let Some(rate_hz) = summary.rate_hz else {
        let what = format!("{} pen samples came, and a recording needs 2", summary.samples);
        return Err(Failure::failed(what, "feed the pen meanwhile, for example by foretrace play"));
    };
    let report = PenRecordReport { samples: summary.samples, rate_hz, seconds: summary.seconds, ..report };
    say!(
        "{}: {} samples, {:.1} s at {:.0} Hz, {} lost, {} out of order",
        pen.display(),
        report.samples,
        report.seconds,
        report.rate_hz,
        report.lost,
        report.out_of_order
    );
    args.json.write(&report)
}

/// Writes the unread samples; returns how many were left out.
fn written(watch: &mut PenWatch, log: &mut PenLog) -> std::io::Result<u64> {
    let mut left_out = 0;
    let mut failure = None;
    watch.drain(|sample| {
        if failure.is_none() {
            match log.push(sample.device_stamp_ns, sample.x_m, sample.y_m, sample.contact()) {
                Ok(written) => left_out += u64::from(!written),
                Err(error) => failure = Some(error),
            }
        }
    });
    failure.map_or(Ok(left_out), Err)
}

/// Makes a new watch after a new daemon has replaced the services.
fn renewed(lookout: &mut Lookout, foretrace: &mut Foretrace) -> Option<PenWatch> {
    let change = lookout.look(foretrace);
    if let Some(words) = change.words("waiting for another") {
        note!("record: {words}");
    }
    (change == DaemonChange::Renewed)
        .then(|| foretrace.pen_watch().map_err(|error| note!("foretrace: {error}")).ok())
        .flatten()
}
