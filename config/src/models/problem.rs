//! What can be wrong with a model file: one variant per bound that can be broken, each with file, tensor or
//! key, and remedy.

use foretrace_control::estimate::refine::PriorError;
use foretrace_control::predict::LstmError;
use foretrace_control::predict::models::foresight::ForesightError;

/// Why a model was not loaded or saved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The operating system refused.
    #[error("{file}: cannot be {what} ({why}): {remedy}")]
    File {
        file: String,
        what: &'static str,
        /// The operating system's reason.
        why: String,
        remedy: String,
    },
    /// Not in the safetensors format.
    #[error(
        "{file}: not a safetensors file, {what}: save the model with `safetensors.torch.save_file` or \
         `foretrace lab train`"
    )]
    Format {
        file: String,
        /// What is broken, with byte positions.
        what: String,
    },
    /// A tensor that the network needs is not there.
    #[error(
        "{file}: tensor {tensor} is missing, the file has {found}: name the tensors as PyTorch does \
         ({needed})"
    )]
    Missing {
        file: String,
        tensor: &'static str,
        /// The names that are there.
        found: String,
        /// The names that are needed.
        needed: String,
    },
    /// A tensor that the network does not have.
    #[error(
        "{file}: tensor {tensor} is unknown, the network has {needed}: remove it, or let its name begin with \
         `extra.`"
    )]
    Unknown {
        file: String,
        tensor: String,
        /// The names that are needed.
        needed: String,
    },
    /// A number format that is not read.
    #[error(
        "{file}: tensor {tensor} is of dtype {found}, legal are F32 and F64: convert it with `.float()` \
         before saving"
    )]
    DType { file: String, tensor: String, found: String },
    /// A tensor of another shape.
    #[error("{file}: tensor {tensor} has shape {found:?}, needed is {wanted}: {remedy}")]
    Shape {
        file: String,
        tensor: String,
        found: Vec<usize>,
        /// What fits, and where that comes from.
        wanted: String,
        remedy: &'static str,
    },
    /// The network that sees contact, direction and time, and must not reach the loop.
    #[error("{file}: {why}")]
    RefusedForesight {
        file: String,
        /// The bound that is broken.
        why: ForesightError,
    },
    /// Another kind of model.
    #[error(
        "{file}: metadata key `{key}` is missing: take a network that `foretrace lab train --model foresight` \
         made"
    )]
    NoForesight { file: String, key: &'static str },
    /// Metadata that must be there.
    #[error(
        "{file}: metadata key `{key}` is missing: save the model with \
         metadata={{\"input_scale\": \"10.13\", \"step_ns\": \"5000000\"}} \
         (RMS and step in ns of the displacements it was trained on)"
    )]
    MissingKey { file: String, key: &'static str },
    /// Metadata that cannot be read.
    #[error(
        "{file}: metadata key `{key}` = {value:?} cannot be read, legal is {legal}: correct it and save again"
    )]
    Key { file: String, key: &'static str, value: String, legal: &'static str },
    /// Metadata whose key is close to a known one.
    #[error(
        "{file}: metadata key `{key}` is unknown but looks like `{meant}`: correct it, or name the note \
         otherwise"
    )]
    Slip {
        file: String,
        key: String,
        /// The key it looks like.
        meant: &'static str,
    },
    /// The network itself was refused: a size, a NaN, another loop.
    #[error("{file}: {why}")]
    Refused {
        file: String,
        /// By the control law.
        why: LstmError,
    },
    /// Not a file of coefficients for refinement: syntax, a missing or unknown key, a wrong type.
    #[error(
        "{file}: not where refinement can start, {what}: take config/models/refine-prior.toml as a pattern"
    )]
    Prior {
        file: String,
        /// What is wrong, with the line.
        what: String,
    },
    /// Coefficients that the control law does not take.
    #[error("{file}: {why}")]
    PriorRefused {
        file: String,
        /// By the control law.
        why: PriorError,
    },
    /// Neither a shipped model nor a file.
    #[error(
        "{name:?} is neither a shipped model ({known}) nor a file: name one of them, or a .safetensors file"
    )]
    NoSuchModel { name: String, known: String },
}
