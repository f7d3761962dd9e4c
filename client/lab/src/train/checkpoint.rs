//! The state of a training in a file, exact to the bit.
//!
//! A safetensors container (`F32`): `parameters`, `adam.mean`, `adam.square`, `best`; the rest as text in its
//! metadata, floating-point numbers as the hexadecimal digits of their bits. Written whole (temporary file,
//! then rename). `plan` is a description of everything that must be the same to continue.

use std::collections::BTreeMap;
use std::path::Path;

use foretrace_config::files::read_regular;
use foretrace_config::models::{Container, DType, container_bytes};

use super::adam::{Adam, AdamSettings};
use super::engine::Scores;
use super::fit::{Epoch, TrainState};

/// Longest checkpoint \[bytes\]: four times the largest network that is loaded.
const LONGEST: u64 = 64 << 20;

/// A checkpoint that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CheckpointError {
    /// The file system refused.
    #[error("{file}: cannot {what}: {why}")]
    File { file: String, what: &'static str, why: String },
    /// Not a checkpoint, or a damaged one.
    #[error("{file}: not a checkpoint of a training ({why}); remove it and start again without --resume")]
    Damaged { file: String, why: String },
    /// Made with other options or data.
    #[error(
        "{file}: was made with other options or data ({found}, now {wanted}); give the same ones, or start \
         again without --resume"
    )]
    Different { file: String, found: String, wanted: String },
}

/// Writes `state` of the training described by `plan`.
///
/// # Errors
/// [`CheckpointError::File`]; what stood there before is untouched then.
pub fn save(file: &Path, plan: &str, state: &TrainState) -> Result<(), CheckpointError> {
    let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|&x| f64::from(x)).collect() };
    let mut metadata = BTreeMap::from([
        ("plan".to_owned(), plan.to_owned()),
        ("adam.step".to_owned(), state.adam.step.to_string()),
        ("epochs".to_owned(), state.history.iter().map(line).collect::<Vec<_>>().join("\n")),
    ]);
    let mut tensors = vec![
        ("parameters", wide(&state.parameters)),
        ("adam.mean", wide(&state.adam.mean)),
        ("adam.square", wide(&state.adam.square)),
    ];
    if let Some((epoch, best)) = &state.best {
        metadata.insert("best.epoch".to_owned(), epoch.to_string());
        tensors.push(("best", wide(best)));
    }
    let shaped = tensors.iter().map(|(name, values)| (*name, (vec![values.len()], values.as_slice())));
    let bytes = container_bytes(&metadata, &shaped.collect(), DType::F32);
    let mut name = file.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.partial", std::process::id()));
    let partial = file.with_file_name(name);
    std::fs::write(&partial, bytes).and_then(|()| std::fs::rename(&partial, file)).map_err(|error| {
        // The first error is reported; a left-over file does no harm.
        let _ = std::fs::remove_file(&partial);
        CheckpointError::File { file: file.display().to_string(), what: "write", why: error.to_string() }
    })
}

/// Reads the state of the training described by `plan` with `count` parameters.
///
/// # Errors
/// [`CheckpointError`]: unreadable, damaged, or of another training.
pub fn load(file: &Path, plan: &str, count: usize) -> Result<TrainState, CheckpointError> {
    let name = file.display().to_string();
    let bytes = read_regular(file, LONGEST).map_err(|error| CheckpointError::File {
        file: name.clone(),
        what: "read",
        why: error.to_string(),
    })?;
    let damaged = |why: String| CheckpointError::Damaged { file: name.clone(), why };
    let container = Container::read(&name, &bytes).map_err(|error| damaged(error.to_string()))?;
    let text = |key: &str| container.metadata.get(key).cloned().ok_or_else(|| damaged(format!("no {key}")));
    let found = text("plan")?;
    if found != plan {
        let (found, wanted) = first_difference(&found, plan);
        return Err(CheckpointError::Different { file: name.clone(), found, wanted });
    }
    let tensor = |key: &str| -> Result<Vec<f32>, CheckpointError> {
        let values = container.tensors.get(key).and_then(|tensor| tensor.numbers());
        let values = values.filter(|values| values.len() == count && values.iter().all(|x| x.is_finite()));
        let values = values.ok_or_else(|| damaged(format!("{key} is not {count} finite numbers")))?;
        Ok(values.into_iter().map(|x| x as f32).collect())
    };
    let number = |key: &str| text(key)?.parse::<u64>().map_err(|_| damaged(format!("{key} is not a number")));
    let epochs = text("epochs")?;
    let history: Option<Vec<Epoch>> = epochs.lines().map(epoch).collect();
    let history = history.ok_or_else(|| damaged("its list of epochs cannot be read".to_owned()))?;
    let best = if container.metadata.contains_key("best.epoch") {
        let epoch = number("best.epoch")? as usize;
        if history.get(epoch).is_none_or(|e| e.held_out.is_none()) {
            return Err(damaged(format!("its best epoch {epoch} is not in its list")));
        }
        Some((epoch, tensor("best")?))
    } else {
        None
    };
    let mut adam = Adam::new(AdamSettings::default(), count);
    (adam.step, adam.mean, adam.square) =
        (number("adam.step")?, tensor("adam.mean")?, tensor("adam.square")?);
    Ok(TrainState { parameters: tensor("parameters")?, adam, history, best })
}

/// One epoch as a line of hexadecimal numbers.
fn line(epoch: &Epoch) -> String {
    let mut numbers = vec![epoch.rate, epoch.train_loss];
    numbers.extend(epoch.held_out.iter().flat_map(|s| [s.loss, s.mse, s.within, s.position]));
    numbers.iter().map(|x| format!("{:016x}", x.to_bits())).collect::<Vec<_>>().join(" ")
}

fn epoch(line: &str) -> Option<Epoch> {
    let bits = line.split(' ').map(|word| u64::from_str_radix(word, 16).ok().map(f64::from_bits));
    match bits.collect::<Option<Vec<f64>>>()?[..] {
        [rate, train_loss] => Some(Epoch { rate, train_loss, held_out: None }),
        [rate, train_loss, loss, mse, within, position] => {
            Some(Epoch { rate, train_loss, held_out: Some(Scores { loss, mse, within, position }) })
        }
        _ => None,
    }
}

/// The first lines of two descriptions that differ.
fn first_difference(found: &str, wanted: &str) -> (String, String) {
    let pairs = found.lines().map(Some).chain(std::iter::repeat(None));
    let others = wanted.lines().map(Some).chain(std::iter::repeat(None));
    let most = found.lines().count().max(wanted.lines().count());
    let different = pairs.zip(others).take(most).find(|(a, b)| a != b).unwrap_or((None, None));
    let word = |line: Option<&str>| line.unwrap_or("nothing").to_owned();
    (word(different.0), word(different.1))
}
