//! `foretraced`: what systemd starts. A thin shell around [`foretraced::run`].

use std::process::ExitCode;

use clap::Parser;
use foretrace_config::plain_lines;
use foretraced::alloc_count::CountingAllocator;
use foretraced::{DaemonArgs, DaemonError, LogError, limits};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// The real-time daemon of foretrace: follows a pen with a robot arm, ahead of time
#[derive(Debug, Parser)]
#[command(
    name = "foretraced",
    version,
    after_help = "Exit codes: 0 done, 1 failed while it ran, 2 wrong command line, 5 wrong settings"
)]
struct Args {
    #[command(flatten)]
    daemon: DaemonArgs,
    /// What to log: error, warn, info, debug
    #[arg(long, value_name = "FILTER", default_value = "info")]
    log: String,
}

fn main() -> ExitCode {
    if let Some(code) = foretraced::reload::child() {
        return code;
    }
    limits::ignore_sigxfsz();
    limits::with_large_stack(program).unwrap_or_else(|error| {
        eprintln!(
            "foretraced: no room to run in: {error}; raise the limits of this process (ulimit -s, -v, -u)"
        );
        ExitCode::FAILURE
    })
}

fn program() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(answer) if !answer.use_stderr() => answer.exit(),
        Err(answer) => {
            eprintln!("{}", plain_lines(&answer.render().to_string()));
            return ExitCode::from(2);
        }
    };
    let ended = |code: u8, text: &str| {
        eprintln!("foretraced: {}", plain_lines(text));
        if let Some(low) = limits::low().filter(|_| code == 1 && !text.contains("(ulimit")) {
            eprintln!("foretraced: {low}");
        }
        ExitCode::from(code)
    };
    let _log = match foretraced::log_to_stderr(&args.log) {
        Ok(log) => log,
        Err(LogError::Filter(text)) => return ended(2, &text),
        Err(LogError::Start(text)) => return ended(1, &text),
    };
    match foretraced::run(&args.daemon.options()) {
        Ok(_) => ExitCode::SUCCESS,
        Err(error @ DaemonError::Config(_)) => ended(5, &error.to_string()),
        Err(error) => ended(1, &error.to_string()),
    }
}
