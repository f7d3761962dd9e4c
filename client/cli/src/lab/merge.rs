//! `foretrace lab merge`: the result of a run whose shards were computed apart.

use std::path::PathBuf;

use foretrace_lab::closed_loop::MethodOutcome;
use foretrace_lab::shards::{MergeError, MergedLeads, MergedLoop, MergedTable, command_of};

use super::lab_run::{LabRun, SettingsSums};
use super::{closed_loop, evaluate, leadtime, table1};
use crate::failure::Failure;
use crate::output::{JsonArgs, note, note_results};

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  \
    for i in 1 2 3; do foretrace lab table1 --data unipen-ced --shard $i/3 --json part-$i.json; done\n  \
    foretrace lab merge part-*.json")]
pub(crate) struct MergeArgs {
    /// Files of all shards of one run, in any order
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,

    /// Folder for the pictures and run.json, which tells how to repeat the run [default: a new one,
    /// foretrace-lab/merge-DATE]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    #[command(flatten)]
    json: JsonArgs,
}

pub(super) fn run(args: &MergeArgs) -> Result<(), Failure> {
    let lab_run = LabRun::begin_merge(&args.files, args.out.as_deref(), &args.json)?;
    let wrong = |error: MergeError| Failure::bad_input(error, "");
    let MergeArgs { files, out, json } = args;
    let command = command_of(files).map_err(wrong)?;
    // That one draws nothing.
    if command != evaluate::NAME {
        lab_run.try_folder()?;
        out.iter().for_each(|out| note_results(out));
    }
    match command.as_str() {
        closed_loop::NAME => {
            let merged = MergedLoop::of(files).map_err(wrong)?;
            let MergedLoop { run, arms, outcomes } = &merged;
            let each = run.each.then(|| MethodOutcome::each(arms, outcomes).collect());
            let result = closed_loop::result(&run.set, &run.lifts, outcomes, each);
            closed_loop::show(&run.set, outcomes, &lab_run, json, &result)?;
            lab_run.finish(SettingsSums::of_values(&run.settings))?;
            note!(
                "lab: the pictures of single letters need the recordings: the same command without --shard \
                 makes them"
            );
            Ok(())
        }
        table1::NAME => {
            let MergedTable { run, set, scored } = MergedTable::of(files).map_err(wrong)?;
            table1::show(&set, &scored, run.by_label, &lab_run, json)
        }
        evaluate::NAME => {
            let MergedTable { set, scored, .. } = MergedTable::of(files).map_err(wrong)?;
            evaluate::show(&set, &scored, json)
        }
        leadtime::NAME => {
            let MergedLeads { each, boards, standings } = MergedLeads::of(files).map_err(wrong)?;
            leadtime::show(&boards, &standings, each, &lab_run, json)
        }
        other => Err(Failure::bad_input(
            format_args!("shards of {other:?}, which this program cannot merge"),
            "merge with the program that wrote them",
        )),
    }
}
