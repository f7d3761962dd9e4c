//! `foretraced`: what systemd starts. A thin shell around [`foretraced::run`].

use std::process::ExitCode;

use clap::Parser;
use foretraced::DaemonArgs;
use foretraced::alloc_count::CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// The real-time daemon of foretrace: follows a pen with a robot arm, ahead of time
#[derive(Debug, Parser)]
#[command(name = "foretraced", version)]
struct Args {
    #[command(flatten)]
    daemon: DaemonArgs,
    /// What to log: error, warn, info, debug
    #[arg(long, value_name = "FILTER", default_value = "info")]
    log: String,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let outcome = foretraced::log_to_stderr(&args.log)
        .and_then(|_log| foretraced::run(&args.daemon.options()).map_err(|error| error.to_string()));
    match outcome {
        Ok(_) => ExitCode::SUCCESS,
        Err(text) => {
            eprintln!("foretraced: {text}");
            ExitCode::FAILURE
        }
    }
}
