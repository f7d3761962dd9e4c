//! `LstmModel`: an LSTM loaded from a file, with the file's notes.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use foretrace_control::predict::models::lstm::{LstmSpec, LstmTensors, LstmWeights};

use super::container::{self, Container, DType, Tensor};
use super::problem::ModelError;
use super::{EXTRA, shipped, shipped_names};
use crate::files::Files;
use crate::nearest;

/// Largest file that is read: a hundred times the largest network in double precision.
const MAX_BYTES: u64 = 16 << 20;
/// Metadata with a meaning.
const KEYS: [&str; 5] = ["input_scale", "step_ns", "input_clip", "residual", "leads"];

/// Values for missing metadata (a bare `state_dict`); `None` = refuse the file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Assumed {
    /// For a missing `input_scale`.
    pub input_scale: Option<f64>,
    /// For a missing `step_ns`.
    pub step_ns: Option<u64>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct LstmModel {
    /// The file, or the name of the shipped model: for messages.
    pub file: String,
    pub weights: Arc<LstmWeights>,
    /// Metadata without meaning here: provenance, licence, citation.
    pub notes: BTreeMap<String, String>,
}

impl LstmModel {
    /// The shipped model of that name, or else the file.
    ///
    /// # Errors
    ///
    /// See [`ModelError`].
    pub fn find(name_or_path: &str) -> Result<Self, ModelError> {
        Self::find_in(name_or_path, &Files::Disk)
    }

    /// As [`LstmModel::find`], with the file read from `files`.
    pub(crate) fn find_in(name_or_path: &str, files: &Files) -> Result<Self, ModelError> {
        match shipped(name_or_path) {
            Some(shipped) => shipped.lstm(),
            None => Self::parse(name_or_path, &named(name_or_path, files)?, Assumed::default()),
        }
    }

    /// Loads a file.
    ///
    /// # Errors
    ///
    /// See [`ModelError`].
    pub fn load(path: &Path) -> Result<Self, ModelError> {
        Self::load_assuming(path, Assumed::default())
    }

    /// As `load`, with values for missing metadata.
    ///
    /// # Errors
    ///
    /// See [`ModelError`].
    pub fn load_assuming(path: &Path, assumed: Assumed) -> Result<Self, ModelError> {
        let bytes = read_bounded(path, &Files::Disk)?;
        Self::parse(&path.display().to_string(), &bytes, assumed)
    }

    /// Reads a file's bytes; `file` is what messages call it.
    ///
    /// # Errors
    ///
    /// See [`ModelError`].
    pub fn parse(file: &str, bytes: &[u8], assumed: Assumed) -> Result<Self, ModelError> {
        let container = Container::read(file, bytes)?;
        let reader = LstmFile { file, container: &container };
        let spec = reader.spec(assumed)?;
        let weights = LstmWeights::new(spec, reader.tensors(&spec)?);
        let weights = weights.map_err(|why| ModelError::Refused { file: file.to_owned(), why })?;
        let notes = container.metadata.into_iter().filter(|(key, _)| !KEYS.contains(&key.as_str()));
        Ok(Self { file: file.to_owned(), weights: Arc::new(weights), notes: notes.collect() })
    }

    /// Checks that the model was trained for a loop with step `loop_ns` \[ns\].
    ///
    /// # Errors
    ///
    /// [`ModelError::Refused`] with both steps, or both scales.
    pub fn fits(&self, loop_ns: u64) -> Result<(), ModelError> {
        self.weights.fits(loop_ns).map_err(|why| ModelError::Refused { file: self.file.clone(), why })
    }

    /// The bytes of the file.
    #[must_use]
    pub fn to_bytes(&self, dtype: DType) -> Vec<u8> {
        let spec = self.weights.spec();
        let mut metadata = self.notes.clone();
        metadata.insert("input_scale".to_owned(), spec.input_scale.to_string());
        metadata.insert("step_ns".to_owned(), spec.step_ns.to_string());
        metadata.insert("residual".to_owned(), spec.residual.to_string());
        metadata.insert("leads".to_owned(), spec.leads.to_string());
        match spec.input_clip {
            Some(clip) => metadata.insert("input_clip".to_owned(), clip.to_string()),
            None => metadata.remove("input_clip"),
        };
        let shapes = LstmTensors::shapes(spec.hidden, spec.leads).map(wanted);
        let named = LstmTensors::NAMES.into_iter().zip(shapes).zip(self.weights.tensors().all());
        let tensors = named.map(|((name, shape), numbers)| (name, (shape, numbers.as_slice()))).collect();
        container::container_bytes(&metadata, &tensors, dtype)
    }

    /// Writes the file whole: into a neighbour, then renamed over `path`.
    ///
    /// # Errors
    ///
    /// [`ModelError::File`]; what stood at `path` before is untouched then.
    pub fn save(&self, path: &Path, dtype: DType) -> Result<(), ModelError> {
        write_whole(path, &self.to_bytes(dtype)).map_err(|error| ModelError::File {
            file: path.display().to_string(),
            what: "written",
            why: error.to_string(),
            remedy: "choose a file in an existing folder with room that you may write to".to_owned(),
        })
    }
}

/// The bytes of the model file of that name, if there is one.
pub(super) fn named(name: &str, files: &Files) -> Result<Vec<u8>, ModelError> {
    if !files.has(Path::new(name)) {
        return Err(ModelError::NoSuchModel { name: name.to_owned(), known: shipped_names() });
    }
    read_bounded(Path::new(name), files)
}

/// The bytes of a model file of a size that models have.
pub(super) fn read_bounded(path: &Path, files: &Files) -> Result<Vec<u8>, ModelError> {
    let file = path.display().to_string();
    let failed = |error: &std::io::Error| ModelError::File {
        file: file.clone(),
        what: "read",
        why: error.to_string(),
        remedy: format!("name a readable .safetensors file, or a shipped model ({})", shipped_names()),
    };
    files.read(path, MAX_BYTES).map_err(|error| failed(&error))
}

pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.partial", std::process::id()));
    let partial = path.with_file_name(name);
    let written = std::fs::File::create(&partial)
        .and_then(|mut file| std::io::Write::write_all(&mut file, bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&partial, path));
    if written.is_err() {
        // The first error is reported; a left-over file does no harm.
        let _ = std::fs::remove_file(&partial);
    }
    written
}

/// Rows and columns as a shape; 0 columns = a vector.
fn wanted((rows, columns): (usize, usize)) -> Vec<usize> {
    if columns == 0 { vec![rows] } else { vec![rows, columns] }
}

fn needed() -> String {
    LstmTensors::NAMES.join(", ")
}

/// A file being checked.
struct LstmFile<'a> {
    file: &'a str,
    container: &'a Container<'a>,
}

impl LstmFile<'_> {
    fn spec(&self, assumed: Assumed) -> Result<LstmSpec, ModelError> {
        let slip = |key: &&String| {
            KEYS.into_iter()
                .find(|known| *key != known && key.len() < 20 && nearest::distance(key, known) == 1)
        };
        if let Some((key, meant)) = self.container.metadata.keys().find_map(|key| Some((key, slip(&key)?))) {
            return Err(ModelError::Slip { file: self.file.to_owned(), key: key.clone(), meant });
        }
        let input_scale = self.number("input_scale", "a positive number")?.or(assumed.input_scale);
        let step_ns = self.number("step_ns", "a whole number of nanoseconds")?.or(assumed.step_ns);
        Ok(LstmSpec {
            hidden: self.hidden()?,
            leads: self.number("leads", "a whole number, 1 to 64")?.unwrap_or(1),
            residual: self.number("residual", "true or false")?.unwrap_or(false),
            input_clip: self.number("input_clip", "a positive number")?,
            input_scale: input_scale.ok_or_else(|| self.missing_key("input_scale"))?,
            step_ns: step_ns.ok_or_else(|| self.missing_key("step_ns"))?,
        })
    }

    /// Only the shape of the recurrent weights gives H.
    fn hidden(&self) -> Result<usize, ModelError> {
        let [_, name, ..] = LstmTensors::NAMES;
        let tensor = self.tensor(name)?;
        match tensor.shape.as_slice() {
            [rows, hidden] if Some(*rows) == hidden.checked_mul(4) => Ok(*hidden),
            found => Err(ModelError::Shape {
                file: self.file.to_owned(),
                tensor: name.to_owned(),
                found: found.to_vec(),
                wanted: "[4H, H] (H cells, four gates each)".to_owned(),
                remedy: "save an nn.LSTM with one layer, one direction and no projection",
            }),
        }
    }

    fn tensors(&self, spec: &LstmSpec) -> Result<LstmTensors, ModelError> {
        // The control law refuses absurd sizes; here they must not be allocated.
        let shapes = LstmTensors::shapes(spec.hidden.min(1 << 16), spec.leads.min(1 << 16)).map(wanted);
        let mut tensors = LstmTensors::default();
        for ((numbers, name), wanted) in tensors.all_mut().into_iter().zip(LstmTensors::NAMES).zip(shapes) {
            let tensor = self.tensor(name)?;
            *numbers = tensor.numbers().ok_or_else(|| ModelError::DType {
                file: self.file.to_owned(),
                tensor: name.to_owned(),
                found: tensor.dtype.clone(),
            })?;
            if tensor.shape != wanted {
                return Err(ModelError::Shape {
                    file: self.file.to_owned(),
                    tensor: name.to_owned(),
                    found: tensor.shape.clone(),
                    wanted: format!("{wanted:?} (H = {}, leads = {})", spec.hidden, spec.leads),
                    remedy: "all tensors must come from one network on two inputs, and metadata `leads` from \
                             its training",
                });
            }
        }
        let known = |name: &str| LstmTensors::NAMES.contains(&name) || name.starts_with(EXTRA);
        match self.container.tensors.keys().find(|name| !known(name)) {
            Some(name) => Err(ModelError::Unknown {
                file: self.file.to_owned(),
                tensor: name.clone(),
                needed: needed(),
            }),
            None => Ok(tensors),
        }
    }

    fn tensor(&self, name: &'static str) -> Result<&Tensor<'_>, ModelError> {
        self.container.tensors.get(name).ok_or_else(|| {
            let mut names: Vec<_> = self.container.tensors.keys().map(String::as_str).take(8).collect();
            if self.container.tensors.len() > names.len() {
                names.push("…");
            }
            let found = if names.is_empty() { "no tensors".to_owned() } else { names.join(", ") };
            ModelError::Missing { file: self.file.to_owned(), tensor: name, found, needed: needed() }
        })
    }

    fn number<T: std::str::FromStr>(
        &self,
        key: &'static str,
        legal: &'static str,
    ) -> Result<Option<T>, ModelError> {
        let Some(text) = self.container.metadata.get(key) else { return Ok(None) };
        text.trim().parse().map(Some).map_err(|_| ModelError::Key {
            file: self.file.to_owned(),
            key,
            value: text.clone(),
            legal,
        })
    }

    fn missing_key(&self, key: &'static str) -> ModelError {
        ModelError::MissingKey { file: self.file.to_owned(), key }
    }
}
