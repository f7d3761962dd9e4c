//! `foretrace man` and `foretrace completions`: what shells and `man` want to know of the command line.

use std::path::PathBuf;

use clap::{Command, CommandFactory as _};
use clap_complete::Shell;

use crate::failure::Failure;
use crate::output::{print, say, write_file};
use crate::{CommandLine, version};

/// Write man pages, one of the program and one of each command, into a folder
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  foretrace man ~/.local/share/man/man1    # then: man foretrace-status")]
pub(crate) struct ManArgs {
    /// Folder, made if it is missing
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Print what a shell needs to complete commands and options
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    mkdir -p ~/.local/share/bash-completion/completions\n  \
    foretrace completions bash > ~/.local/share/bash-completion/completions/foretrace\n  \
    mkdir -p ~/.zfunc    # a folder of $fpath\n  \
    foretrace completions zsh > ~/.zfunc/_foretrace\n  \
    mkdir -p ~/.config/fish/completions\n  \
    foretrace completions fish > ~/.config/fish/completions/foretrace.fish")]
pub(crate) struct CompletionsArgs {
    /// Shell that is to complete
    #[arg(value_name = "SHELL", value_parser = crate::values::word(
        [("bash", Shell::Bash), ("zsh", Shell::Zsh), ("fish", Shell::Fish)], "bash, zsh or fish"))]
    shell: Shell,
}

pub(crate) fn completions(args: &CompletionsArgs) -> Result<(), Failure> {
    print(&script(args.shell))
}

fn script(shell: Shell) -> Vec<u8> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut CommandLine::command(), "foretrace", &mut script);
    script
}

pub(crate) fn man(args: &ManArgs) -> Result<(), Failure> {
    std::fs::create_dir_all(&args.folder).map_err(|error| {
        Failure::bad_input(format_args!("{}: {error}", args.folder.display()), "give a folder (DIR)")
    })?;
    let mut command = CommandLine::command().version(version::program());
    command.build();
    let pages = pages(&command);
    for (name, text) in &pages {
        write_file(&args.folder.join(name), text, "DIR")?;
    }
    say!("{} man pages in {}", pages.len(), args.folder.display());
    Ok(())
}

/// The pages of a command and of all that is below it, by file name; what is hidden has none.
fn pages(command: &Command) -> Vec<(String, String)> {
    let mut page = Vec::new();
    // Into memory nothing fails.
    let _ = clap_mangen::Man::new(command.clone())
        .source(format!("foretrace {}", version::program()))
        .render(&mut page);
    let name = command.get_display_name().unwrap_or(command.get_name());
    let mut pages = vec![(format!("{name}.1"), String::from_utf8_lossy(&page).into_owned())];
    let below = command.get_subcommands().filter(|one| !one.is_hide_set() && one.get_name() != "help");
    pages.extend(below.flat_map(self::pages));
    pages
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_that_is_shown_has_a_page_that_names_its_options() {
        let mut command = CommandLine::command();
        command.build();
        let pages = pages(&command);
        let page = |name: &str| &pages.iter().find(|(file, _)| file == name).unwrap().1;
        assert!(page("foretrace.1").contains("foretrace\\-status(1)"));
        assert!(page("foretrace-request-stop.1").contains("timeout"));
        assert!(page("foretrace-status.1").contains("\\-\\-watch"));
        assert!(!pages.iter().any(|(file, _)| file.contains("ur-echo") || file.contains("help")));
        let shown = command.get_subcommands().filter(|one| !one.is_hide_set() && one.get_name() != "help");
        assert!(pages.len() > shown.count());
    }

    #[test]
    fn every_shell_learns_every_command() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let script = String::from_utf8(script(shell)).unwrap();
            for word in ["status", "completions", "take-over", "shard"] {
                assert!(
                    cfg!(not(feature = "lab")) && word == "shard" || script.contains(word),
                    "{shell}: {word}"
                );
            }
        }
    }
}
