//! `foretrace`: the one program people type, as a library so that tests can run it as a process of their own.
//!
//! Contract: one file per command; a command prints its result on stdout, or as JSON where `--json` says, and
//! fails with one line on stderr and a documented exit code. Nothing here panics on input, on a closed pipe
//! or on Ctrl-C. Without the feature `lab` (on by default) there is no `foretrace lab`, and nothing of
//! `foretrace-lab` is built.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod os;
mod failure;
mod output;
mod interrupt;
mod units;
mod values;
mod version;
mod settings;
mod attach;
mod take_over;
mod robot;
mod schema;
mod shapes;
mod config;
mod daemon;
mod arm;
mod ur_echo;
mod ur_sim;
mod play;
mod gateway;
mod help;
mod tablet;
mod terminal;
mod console;
mod record;
mod flight;
mod relay;
mod replay;
mod explain;
mod export;
mod metrics;
mod foxglove;
mod request;
mod enable;
mod move_home;
mod calibrate;
mod torque;
mod status;
mod demo;
mod run_folder;
mod bench;
mod doctor;
mod service;
mod manual;
#[cfg(feature = "lab")]
mod lab;
// The documents also name commands of the lab.
#[cfg(all(test, feature = "lab"))]
mod documented_tests;

use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use failure::{Cause, EXIT_CODES, Failure};
use foretraced::alloc_count::CountingAllocator;
use foretraced::limits;

/// Lets the daemon count what its real-time thread allocates; costs one addition per allocation.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Make a robot arm follow a hand that writes, ahead of time.
///
/// A real-time daemon reads pen samples from shared memory, predicts where the pen will be when the arm gets
/// there, plans a smooth motion, and writes joint commands; a learner adapts the prediction while it runs.
#[derive(Debug, Parser)]
#[command(name = "foretrace", version = version::line(), after_help = EXIT_CODES, max_term_width = 100)]
struct CommandLine {
    #[command(subcommand)]
    command: ProgramCommand,
}

#[derive(Debug, Subcommand)]
enum ProgramCommand {
    Demo(Box<demo::DemoArgs>),
    Daemon(daemon::DaemonCommandArgs),
    Play(play::PlayArgs),
    Tablet(tablet::TabletArgs),
    Console(console::ConsoleArgs),
    Gateway(gateway::GatewayArgs),
    Record(record::RecordArgs),
    Flight(flight::FlightArgs),
    Relay(relay::RelayArgs),
    Replay(replay::ReplayArgs),
    Explain(explain::ExplainArgs),
    Export(export::ExportArgs),
    Metrics(metrics::MetricsArgs),
    Foxglove(foxglove::FoxgloveArgs),
    /// Arms to plug into the loop
    #[command(subcommand)]
    Arm(arm::ArmCommand),
    UrSim(Box<ur_sim::UrSimArgs>),
    #[command(hide = true)]
    UrEcho(ur_echo::UrEchoArgs),
    Request(request::RequestArgs),
    Enable(enable::EnableArgs),
    /// Move the arm where the pen does not lead it
    #[command(subcommand)]
    Move(move_home::MoveCommand),
    /// Measure what the settings need to know about the arm
    #[command(subcommand)]
    Calibrate(calibrate::CalibrateCommand),
    Status(status::StatusArgs),
    Bench(bench::BenchArgs),
    Doctor(doctor::DoctorArgs),
    /// Train, rank and benchmark predictors, and repeat the paper's experiments
    #[cfg(feature = "lab")]
    #[command(subcommand)]
    Lab(lab::LabCommand),
    /// Check a settings file, show the settings in force, or propose shapes for the links of an arm
    #[command(subcommand)]
    Config(config::ConfigCommand),
    #[command(subcommand)]
    Schema(schema::SchemaCommand),
    #[command(subcommand)]
    Service(service::ServiceCommand),
    Man(manual::ManArgs),
    Completions(manual::CompletionsArgs),
}

/// Runs the program with the arguments of this process.
pub fn main() -> ExitCode {
    if let Some(code) = foretraced::reload::child() {
        return code;
    }
    limits::ignore_sigxfsz();
    limits::with_large_stack(program).unwrap_or_else(|error| {
        let remedy = "raise the limits of this process (ulimit -s, -v, -u)";
        let failure = Failure::failed(format_args!("no room to run in: {error}"), remedy);
        output::note!("foretrace: {failure}");
        ExitCode::from(failure.cause as u8)
    })
}

fn program() -> ExitCode {
    let parsed = help::grouped(CommandLine::command())
        .try_get_matches_from(arguments(std::env::args_os()))
        .and_then(|matches| CommandLine::from_arg_matches(&matches));
    let arguments = match parsed {
        Ok(arguments) => arguments,
        Err(answer) => return output::command_line(&answer),
    };
    match run(&arguments.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            output::note!("foretrace: {failure}");
            // A failure that names the limit itself needs no second line.
            let named = failure.to_string().contains("(ulimit");
            if let Some(low) = limits::low().filter(|_| failure.cause == Cause::Failed && !named) {
                output::note!("foretrace: {low}");
            }
            ExitCode::from(failure.cause as u8)
        }
    }
}

/// The command line; under the name `foretraced`, as packages link it, this program is `foretrace daemon`.
fn arguments(given: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let mut words: Vec<OsString> = given.collect();
    let linked =
        words.first().is_some_and(|name| Path::new(name).file_name() == Some(OsStr::new("foretraced")));
    let version = words.get(1).is_some_and(|word| word == "--version" || word == "-V");
    if linked && !version {
        words.insert(1, OsString::from("daemon"));
    }
    words
}

fn run(command: &ProgramCommand) -> Result<(), Failure> {
    match command {
        ProgramCommand::Demo(args) => demo::run(args),
        ProgramCommand::Daemon(args) => daemon::run(args),
        ProgramCommand::Play(args) => play::run(args),
        ProgramCommand::Tablet(args) => tablet::run(args),
        ProgramCommand::Console(args) => console::run(args),
        ProgramCommand::Gateway(args) => gateway::run(args),
        ProgramCommand::Record(args) => record::run(args),
        ProgramCommand::Flight(args) => flight::run(args),
        ProgramCommand::Relay(args) => relay::run(args),
        ProgramCommand::Replay(args) => replay::run(args),
        ProgramCommand::Explain(args) => explain::run(args),
        ProgramCommand::Export(args) => export::run(args),
        ProgramCommand::Metrics(args) => metrics::run(args),
        ProgramCommand::Foxglove(args) => foxglove::run(args),
        ProgramCommand::Arm(command) => arm::run(command),
        ProgramCommand::UrSim(args) => ur_sim::run(args),
        ProgramCommand::UrEcho(args) => ur_echo::run(args),
        ProgramCommand::Request(args) => request::run(args),
        ProgramCommand::Enable(args) => enable::run(args),
        ProgramCommand::Move(command) => move_home::run(command),
        ProgramCommand::Calibrate(command) => calibrate::run(command),
        ProgramCommand::Status(args) => status::run(args),
        ProgramCommand::Bench(args) => bench::run(args),
        ProgramCommand::Doctor(args) => doctor::run(args),
        #[cfg(feature = "lab")]
        ProgramCommand::Lab(command) => lab::run(command),
        ProgramCommand::Config(command) => config::run(command),
        ProgramCommand::Schema(command) => schema::run(command),
        ProgramCommand::Service(command) => service::run(command),
        ProgramCommand::Man(args) => manual::man(args),
        ProgramCommand::Completions(args) => manual::completions(args),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_called_foretraced_is_the_daemon() {
        let of = |words: &[&str]| {
            let words = arguments(words.iter().map(OsString::from));
            words.iter().map(|word| word.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(
            of(&["/usr/bin/foretraced", "--preset", "ur5e"]),
            "/usr/bin/foretraced daemon --preset ur5e"
        );
        assert_eq!(of(&["foretrace", "status"]), "foretrace status");
        assert_eq!(of(&["foretraced", "--version"]), "foretraced --version");
        assert_eq!(of(&[]), "");
    }

    /// What starts `foretraced` may start the link.
    #[test]
    fn the_daemon_takes_every_option_of_foretraced() {
        let ours = CommandLine::command();
        let ours = ours.find_subcommand("daemon").unwrap();
        let theirs = <foretraced::DaemonArgs as clap::Args>::augment_args(clap::Command::new("foretraced"));
        for option in theirs.get_arguments() {
            assert!(ours.get_arguments().any(|own| own.get_long() == option.get_long()), "{option}");
        }
    }
}
