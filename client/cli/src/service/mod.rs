//! `foretrace service`: the daemon as a service of systemd, installed and removed.
//!
//! Contract: shows what it is about to write and do, and asks, before it changes anything. Writes one file,
//! which says in its first line who wrote it, and replaces or removes no other. Absent: making users, and
//! services of the other programs.

mod host;
#[cfg(test)]
mod script_tests;
mod unit;

use std::io::IsTerminal as _;
use std::path::PathBuf;

use crate::failure::{Cause, Failure};
use crate::output::{note, say};
use crate::terminal;
use host::Host;
use unit::ServiceUnit;

/// Run the daemon as a service of systemd
#[derive(Debug, clap::Subcommand)]
pub(crate) enum ServiceCommand {
    /// Write the unit, enable it and start the daemon, after showing what will be done
    ///
    /// The daemon starts idle: no arm moves before `foretrace request arm`. One of the unit that runs already
    /// goes on as it is. As a system service it runs as the system user `foretrace`; with --user as yourself,
    /// while you are logged in.
    Install(InstallArgs),
    /// Stop the daemon, disable its unit and remove the file, if `install` wrote it
    Remove(WhichArgs),
}

#[derive(Debug, clap::Args)]
pub(crate) struct WhichArgs {
    /// Your own service, without root, instead of one of the system
    #[arg(long)]
    user: bool,

    /// Show what would be done, and do nothing
    #[arg(long)]
    dry_run: bool,

    /// Do it without asking
    #[arg(long)]
    yes: bool,
}

#[derive(Debug, clap::Args)]
pub(crate) struct InstallArgs {
    /// Settings file that the service runs with
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,

    /// Built-in settings that the service runs with: ur5, ur5e or ur5-first-run
    #[arg(long, value_name = "NAME", default_value = "ur5", value_parser = crate::values::preset)]
    preset: String,

    #[command(flatten)]
    which: WhichArgs,
}

pub(crate) fn run(command: &ServiceCommand) -> Result<(), Failure> {
    match command {
        ServiceCommand::Install(args) => install(args),
        ServiceCommand::Remove(args) => remove(args),
    }
}

fn install(args: &InstallArgs) -> Result<(), Failure> {
    let host = Host::of_this_machine(args.which.user)?;
    let unit = ServiceUnit::new(&host, args.config.as_deref(), &args.preset)?;
    let active = host.active();
    let steps = host.install_steps(active);
    say!("{} will be:\n\n{}", host.unit_file().display(), unit.text().trim_end());
    say!("\nThen: {}", steps.iter().map(host::ServiceStep::words).collect::<Vec<_>>().join("; "));
    if args.which.user {
        say!("It runs while you are logged in; loginctl enable-linger keeps it after that.");
    }
    if active {
        say!("The daemon that runs is not restarted.");
    }
    if !go_on(&args.which, || host.ready(true), "Install this service?")? {
        return Ok(());
    }
    host.write(unit.text())?;
    if let Err(failure) = host.run(&steps) {
        note!("foretrace: {} is written; `foretrace service remove` removes it", host.unit_file().display());
        return Err(failure);
    }
    say!("{}", host.outcome(active));
    Ok(())
}

fn remove(args: &WhichArgs) -> Result<(), Failure> {
    let host = Host::of_this_machine(args.user)?;
    host.ours()?;
    let (before, after) = host.remove_steps();
    let words: Vec<_> = before.iter().chain(&after).map(host::ServiceStep::words).collect();
    say!("{} will be removed. Also: {}", host.unit_file().display(), words.join("; "));
    if !go_on(args, || host.ready(false), "Remove this service?")? {
        return Ok(());
    }
    host.run(&before)?;
    host.delete()?;
    host.run(&after)?;
    say!("Removed. Settings and the system user are as they were.");
    Ok(())
}

/// Whether to do what was shown, where the host is `ready` for it.
fn go_on(
    args: &WhichArgs,
    ready: impl FnOnce() -> Result<(), Failure>,
    question: &str,
) -> Result<bool, Failure> {
    if args.dry_run {
        if let Err(failure) = ready() {
            note!("foretrace: it would be refused here: {failure}");
        }
        say!("Nothing was done (--dry-run).");
        return Ok(false);
    }
    ready()?;
    if args.yes {
        return Ok(true);
    }
    if !(std::io::stdin().is_terminal() && std::io::stderr().is_terminal()) {
        let what = "a service would be changed, and there is no terminal to ask on";
        return Err(Failure::usage(what, "give --yes, or --dry-run to look only"));
    }
    if terminal::agreed(question)? {
        return Ok(true);
    }
    Err(Failure::new(Cause::Interrupted, "nothing was changed", "answer yes to go on"))
}
