//! `foretrace lab train`: a network from recorded handwriting, as a file that the tables and the loop load.

mod bench;
mod options;

use foretrace_lab::train::{TrainingProgress, TrainingWatch};

use super::progress::StepProgress;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{note_line, say_lines, tell};
pub(crate) use options::TrainArgs;
use options::TrainedModel;
pub(in crate::lab) use options::threads;

pub(super) fn run(args: &TrainArgs) -> Result<(), Failure> {
    args.json.claim()?;
    if args.bench {
        return bench::run(args);
    }
    let Some(out) = &args.out else { return Err(Failure::usage("no --out", "give --out FILE")) };
    let interrupt = Interrupt::listen()?;
    let watch = TrainingWatch {
        interrupted: &|| interrupt.is_set(),
        tell: &tell,
        progress: &|steps| Box::new(StepProgress::of("lab train", steps)),
    };
    let report = match args.model {
        TrainedModel::Foresight => args.foresight(out)?.run(&watch)?,
        TrainedModel::Lstm(_) => args.lstm(out)?.run(&watch)?,
    };
    say_lines(report.lines);
    args.json.write(&report.json)
}

impl TrainingProgress for StepProgress {
    fn step(&self) {
        self.step();
    }

    fn skip(&self, count: usize) {
        match self {
            Self::Bar(bar) => {
                bar.inc(count as u64);
                bar.reset_eta();
            }
            Self::Lines(lines) => lines.skip(count),
        }
    }

    /// The bar makes room for the line.
    fn note(&self, line: &str) {
        match self {
            Self::Bar(bar) => bar.suspend(|| note_line(format_args!("{line}"))),
            Self::Lines(_) => note_line(format_args!("{line}")),
        }
    }
}
