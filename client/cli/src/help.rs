//! `foretrace --help`: the commands in groups, in the order in which somebody meets them.

use clap::Command;

/// Groups of commands by their names; every command that is shown is in one.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Start here", &["demo", "console", "doctor"]),
    ("Run", &["daemon", "play", "tablet", "gateway", "arm", "ur-sim", "enable"]),
    ("Ask and watch", &["request", "move", "status", "metrics", "foxglove", "relay"]),
    ("Keep and look back", &["record", "flight", "replay", "explain", "export"]),
    ("Set up", &["config", "calibrate", "bench", "schema", "service", "man", "completions"]),
    ("Research", &["lab", "help"]),
];

/// `command` with its help in groups.
pub(crate) fn grouped(mut command: Command) -> Command {
    // So that the command that clap adds is there.
    command.build();
    let width = command.get_subcommands().map(|one| one.get_name().len()).max().unwrap_or(0);
    let mut text = String::from("{about-with-newline}\n{usage-heading} {usage}\n");
    for (heading, names) in GROUPS {
        text.push_str(&format!("\n{heading}:\n"));
        for one in names.iter().filter_map(|name| command.find_subcommand(name)) {
            let about = one.get_about().map(ToString::to_string).unwrap_or_default();
            text.push_str(&format!("  {:<width$}  {}\n", one.get_name(), about));
        }
    }
    text.push_str("\nOptions:\n{options}{after-help}");
    command.help_template(text)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::CommandLine;

    #[test]
    fn every_command_that_is_shown_is_in_one_group() {
        let mut command = CommandLine::command();
        command.build();
        let mut listed: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        let mut shown: Vec<&str> =
            command.get_subcommands().filter(|one| !one.is_hide_set()).map(Command::get_name).collect();
        if cfg!(not(feature = "lab")) {
            listed.retain(|name| *name != "lab");
        }
        listed.sort_unstable();
        shown.sort_unstable();
        assert_eq!(listed, shown);
        let help = grouped(CommandLine::command()).render_help().to_string();
        for words in ["Start here:", "  demo ", "Exit codes:", "--version", "Usage: foretrace <COMMAND>"] {
            assert!(help.contains(words), "{words} is not in\n{help}");
        }
    }
}
