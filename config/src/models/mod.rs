//! Trained networks: safetensors files in, [`LstmWeights`](foretrace_control::predict::LstmWeights) out, and
//! back. And the weights from which refinement starts: a TOML file in,
//! [`RefinePrior`](foretrace_control::estimate::refine::RefinePrior) out.
//!
//! Contract: what is loaded is complete, of the right sizes, finite and bounded, or the error names file,
//! tensor, what was found, what is needed and what to do. No file content panics or takes more memory than
//! the file's size allows. Files are written whole (temporary file, then rename) and the same model gives the
//! same bytes.
//!
//! An LSTM file holds PyTorch's tensors, `F32` or `F64`, gate rows in the order i, f, g, o (H cells, K
//! leads): `lstm.weight_ih_l0` 4H x 2, `lstm.weight_hh_l0` 4H x H, `lstm.bias_ih_l0` 4H, `lstm.bias_hh_l0`
//! 4H, `out.weight` 2K x H, `out.bias` 2K; and in its metadata (strings):
//!
//! | key | meaning |
//! |---|---|
//! | `input_scale` | inputs are divided by it, outputs multiplied; required |
//! | `step_ns` | step of the displacements trained on; required |
//! | `input_clip` | scaled inputs are limited to ± this; absent = not limited |
//! | `residual` | `true`: outputs are added to the newest clipped input; absent = `false` |
//! | `leads` | K, steps predicted directly; absent = 1, rolled out |
//!
//! A file of `foresight` holds `layers.N.weight` (outputs x inputs) and `layers.N.bias` for N from 0 to 3,
//! and in its metadata `kind` = `foresight`, `input_scale`, `step_ns`, and `block`, the steps of a block of
//! its history.
//!
//! Other keys are notes and kept. Other tensors are refused, but for those whose names begin with `extra.`,
//! which are ignored.

mod container;
mod problem;
mod lstm;
mod foresight;
mod shipped;
mod prior;

pub use container::{Container, DType, Tensor, container_bytes};
pub use foresight::ForesightModel;
pub use lstm::{Assumed, LstmModel};
pub(crate) use prior::find_prior_in;
pub use prior::{SHIPPED_PRIOR, ShippedPrior, find_prior, parse_prior};
pub use problem::ModelError;
pub use shipped::{Shipped, shipped, shipped_names};

/// Tensors whose names begin so are ignored by the loop.
pub const EXTRA: &str = "extra.";
