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
mod values;
mod settings;
mod attach;
mod place;
mod robot;
mod ghost;
mod shapes;
mod config;
mod daemon;
mod arm;
mod ur_echo;
mod ur_sim;
mod punctual;
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
mod stopped;
mod torque;
mod extent;
mod status;
mod demo;
mod bench;
mod doctor;
#[cfg(feature = "lab")]
mod lab;
// The documents also name commands of the lab.
#[cfg(all(test, feature = "lab"))]
mod documented;

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
#[command(name = "foretrace", version, after_help = EXIT_CODES, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(Box<demo::DemoArgs>),
    Daemon(daemon::DaemonArgs),
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
        output::note!("{failure}");
        failure.exit_code()
    })
}

fn program() -> ExitCode {
    let parsed = help::grouped(Arguments::command())
        .try_get_matches()
        .and_then(|matches| Arguments::from_arg_matches(&matches));
    let arguments = match parsed {
        Ok(arguments) => arguments,
        Err(answer) => return output::command_line(&answer),
    };
    match run(&arguments.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            output::note!("{failure}");
            // A failure that names the limit itself needs no second line.
            let told = failure.to_string().contains("(ulimit");
            if let Some(low) = limits::low().filter(|_| failure.cause == Cause::Failed && !told) {
                output::note!("foretrace: {low}");
            }
            failure.exit_code()
        }
    }
}

fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Demo(args) => demo::run(args),
        Command::Daemon(args) => daemon::run(args),
        Command::Play(args) => play::run(args),
        Command::Tablet(args) => tablet::run(args),
        Command::Console(args) => console::run(args),
        Command::Gateway(args) => gateway::run(args),
        Command::Record(args) => record::run(args),
        Command::Flight(args) => flight::run(args),
        Command::Relay(args) => relay::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Explain(args) => explain::run(args),
        Command::Export(args) => export::run(args),
        Command::Metrics(args) => metrics::run(args),
        Command::Foxglove(args) => foxglove::run(args),
        Command::Arm(command) => arm::run(command),
        Command::UrSim(args) => ur_sim::run(args),
        Command::UrEcho(args) => ur_echo::run(args),
        Command::Request(args) => request::run(args),
        Command::Enable(args) => enable::run(args),
        Command::Move(command) => move_home::run(command),
        Command::Calibrate(command) => calibrate::run(command),
        Command::Status(args) => status::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Doctor(args) => doctor::run(args),
        #[cfg(feature = "lab")]
        Command::Lab(command) => lab::run(command),
        Command::Config(command) => config::run(command),
    }
}
