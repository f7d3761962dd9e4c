//! A record button: everything that the daemon sees and does, into a new file of a folder.
//!
//! Contract: a thread of its own listens and ends the file, at the button or at the bound on its size; what
//! is shown is what that thread last reported. One recording at a time; one that is under way when this is
//! dropped is finished first.

use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use foretrace_client::{Instance, JOINTS};
use foretrace_control::arm::JointLimits;
use foretrace_host::calendar::UtcMoment;
use foretrace_record::figures::{Figures, figures};
use foretrace_record::write::{FileFacts, part_of};
use foretrace_shm::{Status, TickInput, TickRecord, Wire, monotonic_now_ns};
use serde::Serialize;

use crate::recorder::{Recorder, RecorderOptions, unix_minus_monotonic};
use crate::source::{LiveSource, Wants};

/// Between two looks at what has come.
const NAP: Duration = Duration::from_millis(4);
/// Between two looks at the size of the file.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// What a page is shown; keys are stable.
#[derive(Debug, Clone, Default, Serialize)]
struct RecordingState {
    /// It listens.
    on: bool,
    /// It has ended, and its figures are being worked out.
    ending: bool,
    path: Option<PathBuf>,
    seconds: f64,
    bytes: u64,
    lost: u64,
    /// It reached this bound and was ended \[bytes\].
    full: Option<u64>,
    figures: Option<Figures>,
    failed: Option<String>,
}

/// Takes lines for people, from any thread.
pub type Log = Arc<dyn Fn(&str) + Send + Sync>;

/// The folder of the recordings, and the one under way.
pub struct RecordButton {
    folder: Result<PathBuf, String>,
    max_bytes: u64,
    instance: Instance,
    limits: JointLimits<JOINTS>,
    shown: Arc<Mutex<RecordingState>>,
    over: Arc<AtomicBool>,
    work: Option<JoinHandle<()>>,
    log: Log,
}

impl RecordButton {
    /// Into `folder`, else the user's own below `$XDG_DATA_HOME`; no file grows beyond `max_bytes` by more
    /// than what comes between two looks. Commands are judged by `limits`.
    pub fn new(
        folder: Option<&Path>,
        max_bytes: u64,
        instance: &Instance,
        limits: JointLimits<JOINTS>,
        log: Log,
    ) -> Self {
        Self {
            folder: folder.map_or_else(usual, |folder| Ok(folder.to_owned())),
            max_bytes,
            instance: instance.clone(),
            limits,
            shown: Arc::default(),
            over: Arc::default(),
            work: None,
            log,
        }
    }

    fn is_at_work(&self) -> bool {
        self.work.as_ref().is_some_and(|work| !work.is_finished())
    }

    /// Begins a recording; what it says of it.
    ///
    /// # Errors
    ///
    /// One is under way, or there is no folder or thread for it.
    pub fn begin(&mut self) -> Result<String, String> {
        if self.is_at_work() {
            return Err("a recording is under way, or being finished".to_owned());
        }
        let folder = self.folder.clone()?;
        DirBuilder::new().recursive(true).mode(0o700).create(&folder).map_err(|error| {
            format!("{} cannot be made: {error}; give another --recordings", folder.display())
        })?;
        let target = vacant(&folder, SystemTime::now());
        self.over = Arc::default();
        *locked(&self.shown) =
            RecordingState { on: true, path: Some(target.clone()), ..RecordingState::default() };
        let (shown, over, limits, log) =
            (self.shown.clone(), self.over.clone(), self.limits, self.log.clone());
        let (instance, goal, most) = (self.instance.clone(), target.clone(), self.max_bytes);
        let work = std::thread::Builder::new().name("console-record".to_owned()).spawn(move || {
            let ended = records(&instance, goal, most, &over, &shown, &log);
            let judged = ended.and_then(|path| {
                log(&format!("console: recorded {}", path.display()));
                let mut shown = locked(&shown);
                shown.bytes = std::fs::metadata(&path).map_or(shown.bytes, |file| file.len());
                (shown.on, shown.ending) = (false, true);
                drop(shown);
                figures(&path, limits).map_err(|error| error.to_string())
            });
            let mut shown = locked(&shown);
            (shown.on, shown.ending) = (false, false);
            match judged {
                Ok(figures) => shown.figures = Some(figures),
                Err(words) => {
                    log(&format!("console: {words}"));
                    shown.failed = Some(words);
                }
            }
        });
        match work {
            Ok(work) => self.work = Some(work),
            Err(error) => {
                *locked(&self.shown) = RecordingState::default();
                return Err(format!("no thread can be started: {error}"));
            }
        }
        Ok(format!("recording into {}", target.display()))
    }

    /// Ends the recording that is under way; what it says of it.
    ///
    /// # Errors
    ///
    /// None is under way.
    pub fn end(&mut self) -> Result<String, String> {
        if !self.is_at_work() {
            return Err("no recording is under way".to_owned());
        }
        self.over.store(true, Ordering::Release);
        Ok("the recording ends".to_owned())
    }

    /// What a page is shown.
    pub fn shown(&self) -> serde_json::Value {
        // Numbers and words: JSON holds them all.
        serde_json::to_value(&*locked(&self.shown)).unwrap_or_default()
    }
}

impl Drop for RecordButton {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        if let Some(work) = self.work.take() {
            let _ = work.join();
        }
    }
}

fn locked(shown: &Mutex<RecordingState>) -> MutexGuard<'_, RecordingState> {
    shown.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Records into `target` until it is over, or holds `most` bytes; the file that holds it.
fn records(
    instance: &Instance,
    target: PathBuf,
    most: u64,
    over: &AtomicBool,
    shown: &Mutex<RecordingState>,
    log: &Log,
) -> Result<PathBuf, String> {
    let options =
        RecorderOptions { target: target.clone(), max_bytes: None, max_files: None, facts: facts(instance) };
    let source = LiveSource::open(instance, Wants::ALL).map_err(|error| error.to_string())?;
    let mut recorder = Recorder::start(source, options).map_err(|error| error.to_string())?;
    let (begin, part, mut looked) = (Instant::now(), part_of(&target), None::<Instant>);
    while !over.load(Ordering::Acquire) && !recorder.has_failed() {
        if let Some(changed) = recorder.hear() {
            log(&format!("console: recording: {}", changed.words()));
        }
        if looked.is_none_or(|at| at.elapsed() >= LOOK_EVERY) {
            looked = Some(Instant::now());
            let bytes = std::fs::metadata(&part).map_or(0, |file| file.len());
            let mut shown = locked(shown);
            shown.seconds = begin.elapsed().as_secs_f64();
            (shown.bytes, shown.lost) = (bytes, recorder.counts().lost());
            if bytes >= most {
                shown.full = Some(most);
                log(&format!(
                    "console: the recording holds {most} bytes, the most that --max-size allows: it ends"
                ));
                break;
            }
        }
        std::thread::sleep(NAP);
    }
    let (files, counts) = recorder.finish().map_err(|error| error.to_string())?;
    locked(shown).lost = counts.lost();
    Ok(files.into_iter().next().unwrap_or(target))
}

/// A name in `folder` that no file has, by the time of day in UTC.
fn vacant(folder: &Path, now: SystemTime) -> PathBuf {
    // Other systems take no colon in a name.
    let name = UtcMoment::of(now).rfc3339().replace(':', "-");
    let named = |more: &str| folder.join(format!("{name}{more}.mcap"));
    let free = |path: &PathBuf| !path.exists() && !part_of(path).exists();
    let others = (2..).map(|number| named(&format!("-{number}")));
    std::iter::once(named("")).chain(others).find(free).unwrap_or_else(|| named(""))
}

fn usual() -> Result<PathBuf, String> {
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    folder("XDG_DATA_HOME")
        .or_else(|| folder("HOME").map(|home| home.join(".local/share")))
        .map(|data| data.join("foretrace/recordings"))
        .ok_or_else(|| {
            "there is no folder for recordings: start the console with --recordings DIR".to_owned()
        })
}

/// What the file says about itself and the daemon that is up. Takes its time, so call it before a source is
/// open.
pub fn facts(instance: &Instance) -> FileFacts {
    let pid = instance.daemon().map_or(0, |daemon| daemon.pid);
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default().trim().to_owned();
    let layout = |hash: u64| format!("{hash:016x}");
    [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("layout.tick_input", layout(TickInput::LAYOUT_HASH)),
        ("layout.tick_record", layout(TickRecord::LAYOUT_HASH)),
        ("layout.status", layout(Status::LAYOUT_HASH)),
        ("instance", instance.number().to_string()),
        ("daemon_pid", pid.to_string()),
        ("host", read("/proc/sys/kernel/hostname")),
        ("kernel", read("/proc/sys/kernel/osrelease")),
        ("begun_unix_ns", monotonic_now_ns().wrapping_add(unix_minus_monotonic()).to_string()),
        ("unix_minus_monotonic_ns", unix_minus_monotonic().to_string()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into()
}

#[cfg(test)]
mod tests {
    use std::time::UNIX_EPOCH;

    use super::*;

    #[test]
    fn files_are_named_by_the_time_of_day_and_none_is_taken_twice() {
        let folder = tempfile::tempdir().unwrap();
        let first = vacant(folder.path(), UNIX_EPOCH);
        assert!(first.ends_with("1970-01-01T00-00-00Z.mcap"));
        std::fs::write(part_of(&first), "").unwrap();
        assert!(vacant(folder.path(), UNIX_EPOCH).ends_with("1970-01-01T00-00-00Z-2.mcap"));
    }
}
