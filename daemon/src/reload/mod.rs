//! Settings read again while the loop runs: by another process first.
//!
//! Contract: whatever is in the files, the daemon lives on and no tick waits. A child of the same program
//! (`child.rs`) reads and judges them with little memory, processor time and stack; it sends what it read,
//! and the daemon reads only that, never the disk. A child is started without a copy of this process
//! (`posix_spawn`), so that locked memory is neither copied nor write-protected. Any number of requests leads
//! to one check at a time, and one more for those that came meanwhile.

mod answer;
mod child;

use std::ffi::OsString;
use std::io::{self, Read as _};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam::channel::{self, Receiver, Sender, TryRecvError};
use foretrace_config::Config;
use foretrace_config::files::{Files, Taken};

use crate::ipc::requests::ReloadOutcome;
use crate::limits;
use crate::options::{Base, Reading, Source};
use answer::CheckAnswer;
pub use child::child;

/// Longest check, which takes some tens of milliseconds; less than an operator's patience.
pub const LONGEST_CHECK: Duration = Duration::from_secs(4);
/// Longest wait for the end of a child that was killed.
const ENDING: Duration = Duration::from_secs(1);
/// Interval between looks at the time.
const LOOK: Duration = Duration::from_millis(20);
/// Time between two checks: a flood of requests costs little.
const PAUSE: Duration = Duration::from_millis(200);
/// Operators that wait for a check at most.
const MOST_WAITING: usize = 16;

/// Requests to read the settings again, and the check that is under way.
#[derive(Debug, Default)]
pub struct Reloads {
    check: Option<Check>,
    /// Those who asked before the check began.
    waiting: Vec<Sender<ReloadOutcome>>,
    /// Those who asked since.
    next: Vec<Sender<ReloadOutcome>>,
    /// Somebody asked since, perhaps without waiting for an answer.
    wanted: bool,
    ended: Option<Instant>,
}

/// The settings, or why there are none; and who waits for the outcome.
pub type Read = (Result<Config, String>, Vec<Sender<ReloadOutcome>>);

impl Reloads {
    /// Notes a request; gives the channel for its answer back if too many wait.
    pub fn ask(&mut self, answer: Option<Sender<ReloadOutcome>>) -> Option<Sender<ReloadOutcome>> {
        self.wanted = true;
        match answer {
            Some(answer) if self.next.len() < MOST_WAITING => self.next.push(answer),
            other => return other,
        }
        None
    }

    /// Begins what is wanted; returns what a check that has ended brought. Never waits.
    pub fn look(&mut self, reading: Reading, source: &Source) -> Option<Read> {
        let brought = match &self.check {
            None if !self.wanted || self.ended.is_some_and(|ended| ended.elapsed() < PAUSE) => return None,
            None => {
                self.wanted = false;
                self.waiting = std::mem::take(&mut self.next);
                match reading {
                    Reading::Here => source.load().map_err(|error| error.to_string()),
                    Reading::Child => match Check::begin(source) {
                        Ok(check) => {
                            self.check = Some(check);
                            return None;
                        }
                        Err(error) => Err(format!("no thread for the check can be started: {error}")),
                    },
                }
            }
            Some(check) => {
                let files = check.look()?.map(|taken| Files::Only(Arc::new(taken)));
                files.and_then(|files| source.load_from(&files).map_err(|error| error.to_string()))
            }
        };
        self.check = None;
        self.ended = Some(Instant::now());
        Some((brought, std::mem::take(&mut self.waiting)))
    }
}

/// A check that is under way in a thread, which waits for a child.
#[derive(Debug)]
struct Check {
    outcome: Receiver<Result<Taken, String>>,
}

impl Check {
    fn begin(source: &Source) -> io::Result<Self> {
        let (done, outcome) = channel::bounded(1);
        let source = source.clone();
        std::thread::Builder::new().name("foretrace-check".to_owned()).spawn(move || {
            let checked = checked(checker(&source), LONGEST_CHECK);
            // The daemon may be at its end.
            let _ = done.send(checked);
        })?;
        Ok(Self { outcome })
    }

    /// What it brought, once it has ended.
    fn look(&self) -> Option<Result<Taken, String>> {
        match self.outcome.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err("the check ended by a fault".to_owned())),
        }
    }
}

/// The process that checks the settings of `source`.
fn checker(source: &Source) -> Command {
    let mut command = Command::new("/proc/self/exe");
    // Only the daemon notifies the service manager.
    command
        .arg0("foretrace-check")
        .args(words(source, limits::address_space_left()))
        .env_remove("NOTIFY_SOCKET");
    command
}

/// The files that a child read and found to be good settings; or why there are none.
fn checked(mut command: Command, longest: Duration) -> Result<Taken, String> {
    let failed = |error: io::Error| format!("no process for the check can be started: {error}");
    let until = Instant::now() + longest;
    let (ours, theirs) = UnixStream::pair().map_err(failed)?;
    ours.set_read_timeout(Some(LOOK)).map_err(failed)?;
    command.stdin(Stdio::null()).stdout(Stdio::from(OwnedFd::from(theirs))).stderr(Stdio::null());
    let mut child = command.spawn().map_err(failed)?;
    // It holds the other end of the pipe, which would never end.
    drop(command);
    let bytes = output_of(ours, until);
    // It has sent all that it will, or sends too much, or takes too long.
    let ended = ended(&mut child, if bytes.is_ok() { until } else { Instant::now() });
    let status = match (&bytes, ended) {
        (Err(why), _) => return Err(why.clone()),
        (Ok(_), None) => return Err(late()),
        (Ok(_), Some(status)) => status,
    };
    if !status.success() {
        return Err(fallen(status));
    }
    match bytes.ok().and_then(|bytes| CheckAnswer::from_bytes(&bytes)) {
        Some(CheckAnswer::Good(taken)) => Ok(taken),
        Some(CheckAnswer::Refused(why)) => Err(why),
        None => Err("the process that checks them said something that makes no sense".to_owned()),
    }
}

/// All that a child sends, until it ends.
fn output_of(mut from: UnixStream, until: Instant) -> Result<Vec<u8>, String> {
    let (mut bytes, mut chunk) = (Vec::new(), vec![0; 1 << 16]);
    loop {
        match from.read(&mut chunk) {
            Ok(0) => return Ok(bytes),
            Ok(count) => bytes.extend_from_slice(chunk.get(..count).unwrap_or_default()),
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
            Err(error) => return Err(format!("the process that checks them cannot be heard: {error}")),
        }
        if bytes.len() > answer::LONGEST {
            return Err(format!("they and what they name have more than {} bytes", answer::LONGEST));
        }
        if Instant::now() > until {
            return Err(late());
        }
    }
}

/// How the child ended; kills it at `until`. `None`: not even that ended it in time.
fn ended(child: &mut Child, until: Instant) -> Option<ExitStatus> {
    let mut killed = false;
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return (!killed).then_some(status),
            Ok(None) if Instant::now() > until + ENDING => return None,
            Ok(None) => {}
            Err(_) => return None,
        }
        if !killed && Instant::now() >= until {
            // Already gone, if this fails.
            let _ = child.kill();
            killed = true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn late() -> String {
    format!("reading them takes longer than {} s", LONGEST_CHECK.as_secs())
}

/// Why a child that sent nothing useful ended.
fn fallen(status: ExitStatus) -> String {
    let how = match status.signal() {
        Some(libc::SIGXCPU) => format!("takes more than {} s of processor time", child::LONGEST_CPU_S),
        Some(libc::SIGABRT | libc::SIGSEGV | libc::SIGBUS) => format!(
            "exhausts the stack or the memory that settings may need ({} MiB)",
            child::MOST_MEMORY >> 20
        ),
        Some(signal) => format!("was ended by signal {signal}"),
        None => format!("failed ({status})"),
    };
    format!("reading them {how}; see `foretrace config check`")
}

/// What a child has to know, as arguments: see [`child`].
fn words(source: &Source, memory: Option<u64>) -> Vec<OsString> {
    let (kind, name) = match &source.base {
        Base::File(path) => ("file", path.clone().into_os_string()),
        Base::Preset(name) => ("preset", name.into()),
    };
    let number = |number: Option<u64>| OsString::from(number.unwrap_or(0).to_string());
    let mut words = vec![child::WORD.into(), number(memory), kind.into(), name];
    words.push(number(source.rate_hz.map(u64::from)));
    for (key, value) in &source.overrides {
        words.extend([key.into(), value.into()]);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_give_the_source_back() {
        let file = Source::file("/a b/c.toml").with("loop.spin_us", 0).with("a", "x y = z");
        for source in [file, Source { rate_hz: Some(250), ..Source::preset("ur5e") }] {
            let words = words(&source, Some(7));
            assert_eq!(child::asked(words.into_iter()), Some((Some(7), source)));
        }
        for wrong in [vec![], vec!["daemon"], vec!["check-settings", "0", "folder", "x", "0"]] {
            assert_eq!(child::asked(wrong.into_iter().map(OsString::from)), None);
        }
    }

    #[test]
    fn many_requests_lead_to_one_check_and_one_more_for_those_that_came_meanwhile() {
        let mut reloads = Reloads::default();
        let (sender, _answers) = channel::bounded(100);
        let source = Source::preset("ur5");
        assert!(reloads.look(Reading::Here, &source).is_none(), "nobody asked");
        let mut refused = 0;
        for _ in 0..MOST_WAITING + 3 {
            refused += usize::from(reloads.ask(Some(sender.clone())).is_some());
        }
        assert!(reloads.ask(None).is_none());
        assert_eq!(refused, 3);
        let (read, waiting) = reloads.look(Reading::Here, &source).unwrap();
        assert_eq!((read.is_ok(), waiting.len()), (true, MOST_WAITING));
        assert!(reloads.look(Reading::Here, &source).is_none(), "all were one");
        reloads.ask(None);
        assert!(reloads.look(Reading::Here, &source).is_none(), "not before the pause is over");
        std::thread::sleep(PAUSE);
        let (_, waiting) = reloads.look(Reading::Here, &Source::preset("ur6")).unwrap();
        assert!(waiting.is_empty());
    }

    #[test]
    fn whatever_becomes_of_a_check_it_ends_in_time_with_a_reason() {
        let shell = |script: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", script]);
            command
        };
        let (short, long) = (Duration::from_millis(300), Duration::from_secs(30));
        for (script, longest, words) in [
            ("kill -ABRT $$", long, "exhausts the stack or the memory"),
            ("kill -SEGV $$", long, "exhausts the stack or the memory"),
            ("kill -XCPU $$", long, "more than 3 s of processor time"),
            ("kill -KILL $$", long, "was ended by signal 9"),
            ("exit 3", long, "failed (exit status: 3)"),
            // It hangs; it hangs and holds the pipe no more; it stands still; it never ends to talk.
            ("exec sleep 60", short, "takes longer than 4 s"),
            ("exec sleep 60 >/dev/null", short, "takes longer than 4 s"),
            ("kill -STOP $$", short, "takes longer than 4 s"),
            ("exec cat /dev/zero", long, "have more than 67108864 bytes"),
            ("echo good", long, "makes no sense"),
            ("printf 'foretrace settings  all'", long, "makes no sense"),
        ] {
            let begin = Instant::now();
            let why = checked(shell(script), longest).unwrap_err();
            assert!(why.contains(words), "{script}: {why}");
            assert!(begin.elapsed() < longest + 2 * ENDING, "{script}: {:?}", begin.elapsed());
        }
        let why = checked(Command::new("/nowhere"), long).unwrap_err();
        assert!(why.contains("no process for the check can be started"), "{why}");
    }
}
