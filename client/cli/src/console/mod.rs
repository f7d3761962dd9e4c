//! `foretrace console`: a page in a browser, with a pad to write on and the arm that follows.
//!
//! Contract: listens on this machine alone, with `--lan` also at addresses of it, under TLS. Whoever has the
//! printed address controls; everybody else who can reach it can watch, and stop. With `--sim` it brings a
//! daemon and a simulated arm of its own, which end with it.

mod lan;
mod recordings;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_client::{FaultReason, Foretrace, Instance, RequestError, StopDetail};
use foretrace_config::Settings;
use foretrace_console::{Console, Link};
use foretraced::{Base, Source};

use self::recordings::Recordings;
use crate::attach::{attach_within, instance_of, unattached};
use crate::demo::children::{Child, LastWords};
use crate::demo::scratch::{Leftovers, Scratch};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::play::source::{self, PathArgs};
use crate::request::{may_pass, refused};
use crate::settings::{SettingsArgs, judged};
use crate::stopped;

/// A busy machine takes seconds to start two processes.
const STARTING: Duration = Duration::from_secs(30);
const ANSWER: Duration = Duration::from_secs(2);
const STRIDE: Duration = Duration::from_millis(50);

/// Write in a browser and see the arm follow
///
/// Serves a page on 127.0.0.1: a pad for pen, finger or mouse, the arm in space, its state and its controls.
/// Open the address that it prints; the token in it lets that page control. Pages without it watch, and can
/// stop the arm. One page controls at a time. Its hold-to-run button is no safety function. With --sim it
/// also prints how other programs reach its daemon, a tablet's above all.
///
/// With --lan other machines reach it too, under TLS with a certificate that this machine made for itself:
/// it prints an address that works once, a QR code of it, and the fingerprint to compare.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  foretrace console --sim                  # with a daemon and a simulated \
                        arm, for a first look\n  foretrace console --config table.toml    # beside a daemon \
                        that runs\n  foretrace console --sim --lan            # also for a tablet or phone \
                        of this network"
)]
pub(crate) struct ConsoleArgs {
    /// Port to listen at; 0 takes a free one
    #[arg(long, value_name = "N", default_value_t = 8420)]
    port: u16,

    /// Let other machines in, under TLS, at ADDRESS of this one, or at the one that leads to others
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, require_equals = true,
          default_missing_value = "usual")]
    lan: Vec<lan::Place>,

    /// Start a daemon and a simulated arm as well, on an instance of their own, and arm it
    #[arg(long)]
    sim: bool,

    /// Folder of what the record button records; without it below $XDG_DATA_HOME or ~/.local/share
    #[arg(long, value_name = "DIR")]
    recordings: Option<PathBuf>,

    /// End a recording of the record button at this many bytes: 4G is about half an hour at 500 Hz
    #[arg(long, value_name = "BYTES", default_value = "4G", value_parser = crate::record::bytes)]
    max_size: u64,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &ConsoleArgs) -> Result<(), Failure> {
    args.json.claim()?;
    recordings::checked(args.recordings.as_deref())?;
    let interrupt = Interrupt::listen()?;
    let scratch = if args.sim { Some(Scratch::create()?) } else { None };
    let mut source = args.settings.source()?;
    if let Some(scratch) = &scratch {
        source = source.with("instance.root_dir", format!("\"{}\"", scratch.root().display()));
    }
    let config = judged(&source)?;
    let instance = instance_of(config.settings())?;
    let log = |words: &str| note!("console: {words}");
    let lan = if args.lan.is_empty() { None } else { Some(lan::prepared(&args.lan)?) };
    let certificate = lan.as_ref().map(|lan| lan.certificate.clone());
    let console = Console::open(args.port, lan, Box::new(log)).map_err(|error| Failure::failed(error, ""))?;
    // Goes after the processes have ended.
    let _leftovers = scratch.is_some().then(|| Leftovers(instance.clone()));
    let mut crew = match &scratch {
        Some(_) => simulated(&source, &instance, &interrupt)?,
        None => {
            attach_within(&instance, Duration::from_secs_f64(args.wait))?;
            Vec::new()
        }
    };
    let settings = config.settings().clone();
    let arm = crew.last().map(Child::words);
    let recordings = Recordings::new(args.recordings.as_deref(), args.max_size, &instance, &config);
    let link = Link {
        instance,
        config,
        writer: Box::new(move |text| written(text, &settings)),
        remedy: Box::new(move |fault, stop| remedy(fault, stop, arm.as_ref())),
        recordings: Box::new(recordings),
    };
    say!("open {}", console.address());
    if let Some(scratch) = &scratch {
        say!("with a tablet: foretrace tablet --root {}", scratch.root().display());
    }
    match &certificate {
        Some(certificate) => {
            lan::tell(&console.address(), certificate);
            lan::listen(&console)?;
        }
        None => note!("console: the address holds the token: whoever opens it controls; Ctrl-C ends"),
    }
    let begin = Instant::now();
    let mut died = None;
    let over = || {
        died = crew.iter_mut().find_map(|child| child.expect_alive().err());
        let lasted = args.seconds.is_some_and(|seconds| begin.elapsed().as_secs_f64() >= seconds);
        interrupt.is_set() || lasted || died.is_some()
    };
    let tally = console.run(link, over).map_err(|error| Failure::failed(error, ""))?;
    if let Some(failure) = died {
        return Err(failure);
    }
    // The arm before its daemon.
    while let Some(mut child) = crew.pop() {
        child.end()?;
    }
    let refused: u64 = tally.refused.values().sum();
    let lost: u64 = tally.samples_refused.values().sum();
    if tally.lines_dropped > 0 {
        note!("console: {} more lines found no room here", tally.lines_dropped);
    }
    say!(
        "{} pages, {} pen samples passed on, {lost} refused; {refused} messages and connections refused, \
         {} stops",
        tally.pages,
        tally.samples,
        tally.stops
    );
    args.json.write(&tally)
}

/// A daemon and a simulated arm, armed.
fn simulated(source: &Source, instance: &Instance, interrupt: &Interrupt) -> Result<Vec<Child>, Failure> {
    let mut common = match &source.base {
        Base::File(file) => vec!["--config".to_owned(), file.display().to_string()],
        Base::Preset(name) => vec!["--preset".to_owned(), name.clone()],
    };
    for (key, value) in &source.overrides {
        common.extend(["--set".to_owned(), format!("{key}={value}")]);
    }
    let words = |first: &[&str]| -> Vec<String> {
        first.iter().map(|word| (*word).to_owned()).chain(common.iter().cloned()).collect()
    };
    let mut crew = vec![Child::start("daemon", &words(&["daemon", "--log", "warn"]))?];
    let deadline = Instant::now() + STARTING;
    let foretrace = loop {
        match Foretrace::attach_within(instance, STRIDE) {
            Ok(foretrace) => break foretrace,
            Err(foretrace_client::ServiceError::NoDaemon { .. }) if Instant::now() < deadline => {
                looked(&mut crew, interrupt)?;
            }
            Err(error) => return Err(unattached(error)),
        }
    };
    crew.push(Child::start("arm", &words(&["arm", "sim"]))?);
    let mut requests = foretrace.requests().map_err(unattached)?;
    let may_wait = |error: &RequestError| may_pass(error) && Instant::now() < deadline;
    loop {
        looked(&mut crew, interrupt)?;
        match requests.arm(ANSWER) {
            Ok(_) => return Ok(crew),
            Err(error) if may_wait(&error) => std::thread::sleep(STRIDE),
            Err(error) => return Err(refused(&error)),
        }
    }
}

/// What to do about a stop; where the simulated arm says at that time that it got no CPU, that.
fn remedy(fault: FaultReason, stop: &StopDetail, arm: Option<&LastWords>) -> String {
    match arm.and_then(|arm| arm.starved(fault, stop)) {
        Some(starved) => format!("{starved}: arm again"),
        None => stopped::remedy(fault),
    }
}

fn looked(crew: &mut [Child], interrupt: &Interrupt) -> Result<(), Failure> {
    interrupt.check()?;
    crew.iter_mut().try_for_each(Child::expect_alive)
}

/// The built-in writer's path of a text: seconds, metres, contact.
fn written(text: &str, settings: &Settings) -> Result<Vec<(f64, f64, f64, bool)>, String> {
    let name = format!("glyphs:{text}");
    let source = source::load(&[name], &PathArgs::default(), settings).map_err(|failure| {
        let words = failure.to_string();
        words.strip_prefix("foretrace: ").unwrap_or(&words).to_owned()
    })?;
    let samples = &source.path.samples;
    let first = samples.first().map_or(0.0, |sample| sample.t_s);
    Ok(samples.iter().map(|sample| (sample.t_s - first, sample.x_m, sample.y_m, sample.contact)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_config::Config;

    #[test]
    fn a_text_becomes_a_path_on_the_paper_and_a_sign_that_nobody_can_write_is_told() {
        let config = Config::preset("ur5").unwrap();
        let path = written("Hi", config.settings()).unwrap();
        assert!(path.len() > 100 && path[0].0 == 0.0 && path.iter().any(|(.., contact)| *contact));
        let [[x_min, x_max], ..] = config.settings().plane.workspace_m;
        assert!(path.iter().all(|(_, x, ..)| (x_min..=x_max).contains(x)));
        let told = written("\u{1b}", config.settings()).unwrap_err();
        assert!(!told.is_empty() && !told.starts_with("foretrace:"), "{told}");
    }
}
