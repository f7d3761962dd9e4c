//! `foretrace console`: a page in a browser, with a pad to write on and the arm that follows.
//!
//! Contract: listens on this machine alone, with `--lan` also at addresses of it, under TLS. Whoever has the
//! printed address controls; everybody else who can reach it can watch, and stop. With `--sim` it brings a
//! daemon and a simulated arm of its own, which end with it.

mod lan;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_client::Instance;
use foretrace_client::wire::{FaultReason, StopDetail};
use foretrace_config::Settings;
use foretrace_console::{Console, DaemonLink, Lan, LanAddress, Records};
use foretrace_live::record_button::RecordButton;
use foretrace_report::run::LastWords;
use foretrace_report::stopped;
use foretrace_sim::source::{PathOptions, load};
use foretraced::Source;

use crate::attach::{attach_within, instance_of};
use crate::demo::crew::{Crew, settings_arguments, words};
use crate::demo::scratch::{PrivateFiles, Scratch};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::settings::{SettingsArgs, judged};

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
    lan: Vec<LanAddress>,

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
    checked(args.recordings.as_deref())?;
    let interrupt = Interrupt::listen()?;
    let scratch = if args.sim { Some(Scratch::create()?) } else { None };
    let mut source = args.settings.source()?;
    if let Some(scratch) = &scratch {
        source = source.with("instance.root_dir", format!("\"{}\"", scratch.root().display()));
    }
    let config = judged(&source)?;
    let instance = instance_of(config.settings())?;
    let log = |words: &str| note!("console: {words}");
    let lan = if args.lan.is_empty() { None } else { Some(Lan::prepared(&args.lan)?) };
    let certificate = lan.as_ref().map(|lan| lan.certificate.clone());
    let console = Console::open(args.port, lan, Box::new(log)).map_err(|error| Failure::failed(error, ""))?;
    // Goes after the processes have ended.
    let _files = scratch.is_some().then(|| PrivateFiles(instance.clone()));
    let mut crew = match &scratch {
        Some(_) => Some(simulated(&source, &instance, &interrupt)?),
        None => {
            attach_within(&instance, Duration::from_secs_f64(args.wait))?;
            None
        }
    };
    let settings = config.settings().clone();
    let arm = crew.as_ref().map(|crew| crew.words("arm"));
    let limits = config.follower_settings().limits;
    let log = Arc::new(|words: &str| note!("{words}"));
    let recordings = RecordButton::new(args.recordings.as_deref(), args.max_size, &instance, limits, log);
    let link = DaemonLink {
        instance,
        config,
        writer: Box::new(move |text| written(text, &settings)),
        remedy: Box::new(move |fault, stop| remedy(fault, stop, arm.as_ref())),
        recordings: Box::new(Recordings(recordings)),
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
        died = crew.as_mut().and_then(|crew| crew.expect_alive().err());
        let lasted = args.seconds.is_some_and(|seconds| begin.elapsed().as_secs_f64() >= seconds);
        interrupt.is_set() || lasted || died.is_some()
    };
    let tally = console.run(link, over).map_err(|error| Failure::failed(error, ""))?;
    if let Some(failure) = died {
        return Err(failure);
    }
    if let Some(crew) = &mut crew {
        crew.end("arm")?;
        crew.end("daemon")?;
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

/// The record button of a page.
struct Recordings(RecordButton);

impl Records for Recordings {
    fn begin(&mut self) -> Result<String, String> {
        self.0.begin()
    }

    fn end(&mut self) -> Result<String, String> {
        self.0.end()
    }

    fn shown(&self) -> serde_json::Value {
        self.0.shown()
    }
}

/// Refuses a folder that cannot be one before anything is started.
fn checked(folder: Option<&Path>) -> Result<(), Failure> {
    match folder {
        Some(folder) if folder.exists() && !folder.is_dir() => Err(Failure::bad_input(
            format_args!("{} is no folder", folder.display()),
            "give a folder for --recordings DIR",
        )),
        _ => Ok(()),
    }
}

/// A daemon and a simulated arm, armed.
fn simulated(source: &Source, instance: &Instance, interrupt: &Interrupt) -> Result<Crew, Failure> {
    let common = settings_arguments(source);
    let mut crew = Crew::quiet(interrupt.clone());
    crew.start("daemon", &[words(&["daemon", "--log", "warn"]), common.clone()].concat())?;
    let foretrace = crew.attached(instance)?;
    crew.start("arm", &[words(&["arm", "sim"]), common].concat())?;
    crew.arm(&mut foretrace.requests())?;
    Ok(crew)
}

/// What to do about a stop; where the simulated arm says at that time that it got no CPU, that.
fn remedy(fault: FaultReason, stop: &StopDetail, arm: Option<&LastWords>) -> String {
    match arm.and_then(|arm| arm.starved(fault, stop)) {
        Some(starved) => format!("{starved}: arm again"),
        None => stopped::remedy(fault),
    }
}

/// The built-in writer's path of a text: seconds, metres, contact.
fn written(text: &str, settings: &Settings) -> Result<Vec<(f64, f64, f64, bool)>, String> {
    let source = load(&[format!("glyphs:{text}")], &PathOptions::default(), settings)
        .map_err(|failure| failure.to_string())?;
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
        let message = written("\u{1b}", config.settings()).unwrap_err();
        assert!(!message.is_empty() && !message.starts_with("foretrace:"), "{message}");
    }
}
