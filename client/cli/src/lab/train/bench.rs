//! `foretrace lab train --bench`: time per step on one thread, and the exchange file for another
//! implementation.

use foretrace_lab::train::Strokes;
use foretrace_lab::train::bench::{bench, made_up};
use foretrace_lab::train::corpus;
use foretrace_sim::data::DataSet;
use serde_json::json;

use super::TrainArgs;
use crate::failure::Failure;
use crate::output::{note, say};

/// Made-up sequences: about as many steps as a data set of thousands of characters has in a third of an
/// epoch.
const SEQUENCES: usize = 1000;
const EPOCHS: u32 = 5;

pub(super) fn run(args: &TrainArgs) -> Result<(), Failure> {
    let mut sequences: Vec<Strokes> = Vec::new();
    for folder in &args.data {
        let set =
            DataSet::load(folder, &args.split, args.strict).map_err(|error| Failure::bad_input(error, ""))?;
        sequences.extend(corpus::items(&set).into_iter().map(|item| item.strokes));
    }
    if args.data.is_empty() {
        sequences = made_up(SEQUENCES, args.seed);
    }
    if !(corpus::rms(&sequences) > 0.0) {
        return Err(Failure::bad_input(
            "the data have no motion",
            "give a set with pen-down points (--data)",
        ));
    }
    let (batch, epochs) = (args.batch.unwrap_or(16) as usize, args.epochs.unwrap_or(EPOCHS) as usize);
    note!("lab: lstm{}, batches of {batch}, {} sequences, one thread", args.cells(), sequences.len());
    let result = bench(sequences, args.cells(), batch, epochs, args.seed);
    let mut times = result.us_per_step.clone();
    times.sort_by(f64::total_cmp);
    let (least, median) = (times[0], times[times.len() / 2]);
    say!(
        "training lstm{} {median:.3} us per step (median of {epochs} epochs; least {least:.3})",
        args.cells()
    );
    if let Some(file) = &args.exchange {
        let unwritten = |error: &dyn std::fmt::Display| {
            Failure::failed(
                format_args!("cannot write {}: {error}", file.display()),
                "give a writable --exchange FILE",
            )
        };
        let text = serde_json::to_vec(&result).map_err(|error| unwritten(&error))?;
        std::fs::write(file, text).map_err(|error| unwritten(&error))?;
    }
    args.json.write(&json!({
        "model": format!("lstm{}", args.cells()),
        "batch": batch,
        "steps": result.steps,
        "us_per_step": { "median": median, "least": least, "epochs": result.us_per_step },
    }))
}
