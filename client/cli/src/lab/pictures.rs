//! `foretrace lab pictures`: makes every picture of the documents, each by a command that a reader can type.
//!
//! Contract: the table below is the only list that says which picture comes from what. A picture that cannot
//! be made here is named with its command and left as it is; one that can is written whole or not at all.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use clap::Parser;
use foretrace_sim::plot::Picture;

use crate::demo::{DemoPlan, scratch::Scratch};
use crate::failure::Failure;
use crate::output::{note, say};
use crate::{CommandLine, ProgramCommand};

/// What the demo's pictures are called in the documents.
const OF_THE_DEMO: [&str; 4] = ["path.svg", "error.svg", "lag.svg", "times.svg"];

/// Picture, data set that it needs, command after `foretrace lab`, and what that command calls it.
const OF_RECORDINGS: [(&str, &str, &str, &str); 5] = [
    (
        "closed-loop-letters-ur5.svg",
        "character-trajectories",
        "closed-loop --data {} --limit 60 --arms ur5 --predictors hold,mixture",
        "closed-loop-letters-ur5.svg",
    ),
    ("fig3-unipen-ced.svg", "unipen-ced", "fig3 --data {}", "fig3.svg"),
    (
        "leadtime.svg",
        "unipen-ced,unipen-tos,pendigits-orig,character-trajectories",
        "leadtime --data {} --models mixture,ar-rls,lstm32,dybm,constant-velocity",
        "leadtime.svg",
    ),
    (
        "fig2-unipen-tos.svg",
        "unipen-tos",
        "fig2 --data {} --label all --predictors hold,constant-velocity,dybm,mixture,oracle",
        "fig2.svg",
    ),
    (
        "closed-loop-pareto.svg",
        "unipen-tos",
        "closed-loop --data {} --limit 2 --pareto --arms ideal,ur5 --predictors \
         mixture,servoj-ros,otg,kalman",
        "closed-loop-pareto.svg",
    ),
];

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  foretrace lab pictures\n  foretrace lab pictures --recordings DATA --only \
                  fig3-unipen-ced.svg"
)]
pub(crate) struct PicturesArgs {
    /// Folder of the pictures
    #[arg(long, value_name = "DIR", default_value = "docs/pictures")]
    out: PathBuf,

    /// Folder with the data sets unipen-ced, unipen-tos, pendigits-orig and character-trajectories
    #[arg(long, value_name = "DIR")]
    recordings: Option<PathBuf>,

    /// Only these, comma-separated
    #[arg(long, value_name = "FILES", value_delimiter = ',')]
    only: Vec<String>,
}

pub(super) fn run(args: &PicturesArgs) -> Result<(), Failure> {
    let known = || OF_THE_DEMO.iter().chain(OF_RECORDINGS.iter().map(|(file, ..)| file));
    if let Some(unknown) = args.only.iter().find(|wanted| !known().any(|file| file == wanted)) {
        let names: Vec<&str> = known().copied().collect();
        return Err(Failure::usage(
            format_args!("no picture of the documents is called {unknown:?}"),
            format_args!("choose from {} (--only)", names.join(", ")),
        ));
    }
    if !args.out.is_dir() {
        return Err(Failure::bad_input(
            format_args!("there is no folder {}", args.out.display()),
            "run it where the repository lies, or give a folder with --out",
        ));
    }
    let wanted = |file: &str| args.only.is_empty() || args.only.iter().any(|name| name == file);
    if OF_THE_DEMO.into_iter().any(wanted) {
        of_the_demo(&args.out, wanted)?;
    }
    for (file, sets, line, made) in OF_RECORDINGS.into_iter().filter(|(file, ..)| wanted(file)) {
        match args.recordings.as_deref().map(|folder| folders(folder, sets)) {
            Some(Ok(data)) => of_recordings(&args.out, file, &line.replace("{}", &data), made)?,
            Some(Err(missing)) => skipped(file, &format!("there is no {}", missing.display()), line, sets),
            None => skipped(file, "it needs recordings, --recordings says where", line, sets),
        }
    }
    Ok(())
}

/// The pictures of one run of the demo, the same as in its report.
fn of_the_demo(out: &Path, wanted: impl Fn(&str) -> bool) -> Result<(), Failure> {
    let CommandLine { command: ProgramCommand::Demo(args) } = arguments("demo")? else {
        return Err(failed("demo is not the demo"));
    };
    let drawings = DemoPlan::of(&args)?.performed(&args)?.drawings;
    for (file, picture) in
        OF_THE_DEMO.iter().zip([drawings.path, drawings.error, drawings.lag, drawings.times])
    {
        let picture: Picture =
            picture.ok_or_else(|| failed(format_args!("the demo gave nothing for {file}")))?;
        if wanted(file) {
            picture.write(&out.join(file)).map_err(failed)?;
            say!("{file}: {}\n  foretrace demo", picture.about());
        }
    }
    Ok(())
}

/// Runs a command of the lab and takes its picture.
fn of_recordings(out: &Path, file: &str, line: &str, made: &str) -> Result<(), Failure> {
    let scratch = Scratch::create()?;
    let folder = scratch.file("pictures");
    std::fs::create_dir_all(&folder).map_err(failed)?;
    say!("{file}\n  foretrace lab {line}");
    crate::run(&arguments(&format!("lab {line} --out {}", folder.display()))?.command)?;
    let picture = std::fs::read(folder.join(made)).map_err(failed)?;
    foretrace_host::whole::write(&out.join(file), |out| std::io::Write::write_all(out, &picture))
        .map_err(failed)
}

fn arguments(line: &str) -> Result<CommandLine, Failure> {
    let words = line.split_whitespace();
    CommandLine::try_parse_from(std::iter::once("foretrace").chain(words)).map_err(failed)
}

/// The sets' folders as one argument, or the first that is not there.
fn folders(folder: &Path, sets: &str) -> Result<String, PathBuf> {
    let mut found = Vec::new();
    for set in sets.split(',') {
        let path = folder.join(set);
        if !path.is_dir() {
            return Err(path);
        }
        found.push(path.display().to_string());
    }
    Ok(found.join(","))
}

fn skipped(file: &str, why: &str, line: &str, sets: &str) {
    note!("skipped {file}: {why}\n  foretrace lab {}", line.replace("{}", sets));
}

fn failed(error: impl Display) -> Failure {
    Failure::failed(error, "")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Made by `tests/console/judge.sh`, with a browser.
    const OF_THE_CONSOLE: [&str; 10] = [
        "console-light.png",
        "console-dark.png",
        "console-wide-light.png",
        "console-wide-dark.png",
        "console-phone-light.png",
        "console-phone-dark.png",
        "console-strip.png",
        "pad-mouse.png",
        "pad-pen.png",
        "pad-touch.png",
    ];

    #[test]
    fn every_picture_of_the_documents_has_a_command_that_parses_and_none_is_left_over() {
        for (_, sets, line, _) in OF_RECORDINGS {
            assert!(arguments(&format!("lab {} --out x", line.replace("{}", sets))).is_ok(), "{line}");
        }
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let documents: Vec<String> =
            crate::documented_tests::documents().into_iter().map(|(_, text)| text).collect();
        let mut files: Vec<String> = std::fs::read_dir(root.join("docs/pictures"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        let mut made: Vec<String> = OF_THE_DEMO
            .iter()
            .chain(OF_RECORDINGS.iter().map(|(file, ..)| file))
            .chain(&OF_THE_CONSOLE)
            .map(|file| (*file).to_owned())
            .collect();
        files.sort();
        made.sort();
        assert_eq!(files, made, "the folder and the table");
        for file in made {
            let [from_the_top, from_a_page] =
                ["docs", ".."].map(|folder| format!("]({folder}/pictures/{file})"));
            assert!(
                documents.iter().any(|text| text.contains(&from_the_top) || text.contains(&from_a_page)),
                "no document shows {file}"
            );
        }
    }
}
