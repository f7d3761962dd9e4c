//! `ForesightModel`: the network that sees contact, direction and time, loaded from a file, with the file's
//! notes.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use foretrace_control::predict::models::foresight::{
    Dense, ForesightSpec, ForesightWeights, LAYERS, NAMES, SHAPES,
};

use super::container::{self, Container, DType, Tensor};
use super::lstm::{named, read_bounded, write_whole};
use super::problem::ModelError;
use super::{EXTRA, shipped};
use crate::files::Files;

/// What `kind` says in the metadata.
pub(super) const KIND: &str = "foresight";
/// Metadata with a meaning.
const KEYS: [&str; 4] = ["kind", "input_scale", "step_ns", "block"];

#[derive(Debug, Clone, PartialEq)]
pub struct ForesightModel {
    /// The file, or the name of the shipped model: for messages.
    pub file: String,
    pub weights: Arc<ForesightWeights>,
    /// Metadata without meaning here: provenance, licence, citation.
    pub notes: BTreeMap<String, String>,
}

impl ForesightModel {
    /// The shipped model of that name, or else the file.
    ///
    /// # Errors
    ///
    /// See [`ModelError`].
    pub fn find(name_or_path: &str) -> Result<Self, ModelError> {
        Self::find_in(name_or_path, &Files::Disk)
    }

    /// As [`ForesightModel::find`], with the file read from `files`.
    pub(crate) fn find_in(name_or_path: &str, files: &Files) -> Result<Self, ModelError> {
        match shipped(name_or_path) {
            Some(shipped) => Self::parse(shipped.name, shipped.bytes),
            None => Self::parse(name_or_path, &named(name_or_path, files)?),
        }
    }

    /// Loads a file.
    ///
    /// # Errors
    ///
    /// See [`ModelError`].
    pub fn load(path: &Path) -> Result<Self, ModelError> {
        let bytes = read_bounded(path, &Files::Disk)?;
        Self::parse(&path.display().to_string(), &bytes)
    }

    /// Reads a file's bytes; `file` is what messages call it.
    ///
    /// # Errors
    ///
    /// See [`ModelError`].
    pub fn parse(file: &str, bytes: &[u8]) -> Result<Self, ModelError> {
        let container = Container::read(file, bytes)?;
        let reader = ForesightFile { file, container: &container };
        let kind = reader.text("kind")?;
        if kind != KIND {
            return Err(reader.wrong("kind", kind, "\"foresight\""));
        }
        let spec = ForesightSpec {
            step_ns: reader.number("step_ns", "a whole number of nanoseconds")?,
            input_scale: reader.number("input_scale", "a positive number")?,
            block: reader.number("block", "a whole number, 1 to 12")?,
        };
        let weights = ForesightWeights::new(spec, reader.layers()?);
        let weights = weights.map_err(|why| ModelError::RefusedForesight { file: file.to_owned(), why })?;
        let notes = container.metadata.into_iter().filter(|(key, _)| !KEYS.contains(&key.as_str()));
        Ok(Self { file: file.to_owned(), weights: Arc::new(weights), notes: notes.collect() })
    }

    /// Checks that the model was trained for a loop with step `loop_ns` \[ns\].
    ///
    /// # Errors
    ///
    /// [`ModelError::RefusedForesight`] with both steps, or both scales.
    pub fn fits(&self, loop_ns: u64) -> Result<(), ModelError> {
        let refused = |why| ModelError::RefusedForesight { file: self.file.clone(), why };
        self.weights.fits(loop_ns).map_err(refused)
    }

    /// The bytes of the file, in single precision, as the network computes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let spec = self.weights.spec();
        let mut metadata = self.notes.clone();
        metadata.insert("kind".to_owned(), KIND.to_owned());
        metadata.insert("input_scale".to_owned(), spec.input_scale.to_string());
        metadata.insert("step_ns".to_owned(), spec.step_ns.to_string());
        metadata.insert("block".to_owned(), spec.block.to_string());
        let mut tensors = BTreeMap::new();
        for ((layer, [weight, bias]), (inputs, outputs)) in
            self.weights.layers().iter().zip(NAMES).zip(SHAPES)
        {
            tensors.insert(weight, (vec![outputs, inputs], layer.weight.as_slice()));
            tensors.insert(bias, (vec![outputs], layer.bias.as_slice()));
        }
        container::container_bytes(&metadata, &tensors, DType::F32)
    }

    /// Writes the file whole: into a neighbour, then renamed over `path`.
    ///
    /// # Errors
    ///
    /// [`ModelError::File`]; what stood at `path` before is untouched then.
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        write_whole(path, &self.to_bytes()).map_err(|error| ModelError::File {
            file: path.display().to_string(),
            what: "written",
            why: error.to_string(),
            remedy: "choose a file in an existing folder with room that you may write to".to_owned(),
        })
    }
}

fn needed() -> String {
    NAMES.as_flattened().join(", ")
}

/// A file being checked.
struct ForesightFile<'a> {
    file: &'a str,
    container: &'a Container<'a>,
}

impl ForesightFile<'_> {
    fn text(&self, key: &'static str) -> Result<&str, ModelError> {
        let text = self.container.metadata.get(key).map(String::as_str);
        text.ok_or_else(|| ModelError::NoForesight { file: self.file.to_owned(), key })
    }

    fn number<T: std::str::FromStr>(&self, key: &'static str, legal: &'static str) -> Result<T, ModelError> {
        let text = self.text(key)?;
        text.trim().parse().map_err(|_| self.wrong(key, text, legal))
    }

    fn wrong(&self, key: &'static str, value: &str, legal: &'static str) -> ModelError {
        ModelError::Key { file: self.file.to_owned(), key, value: value.to_owned(), legal }
    }

    fn layers(&self) -> Result<[Dense; LAYERS], ModelError> {
        let mut layers: [Dense; LAYERS] = Default::default();
        for ((layer, [weight, bias]), (inputs, outputs)) in layers.iter_mut().zip(NAMES).zip(SHAPES) {
            layer.weight = self.tensor(weight, &[outputs, inputs])?;
            layer.bias = self.tensor(bias, &[outputs])?;
        }
        let known = |name: &str| NAMES.as_flattened().contains(&name) || name.starts_with(EXTRA);
        match self.container.tensors.keys().find(|name| !known(name)) {
            Some(name) => Err(ModelError::Unknown {
                file: self.file.to_owned(),
                tensor: name.clone(),
                needed: needed(),
            }),
            None => Ok(layers),
        }
    }

    fn tensor(&self, name: &'static str, wanted: &[usize]) -> Result<Vec<f64>, ModelError> {
        let file = || self.file.to_owned();
        let tensor: &Tensor<'_> = self.container.tensors.get(name).ok_or_else(|| {
            let names: Vec<_> = self.container.tensors.keys().map(String::as_str).take(8).collect();
            let found = if names.is_empty() { "no tensors".to_owned() } else { names.join(", ") };
            ModelError::Missing { file: file(), tensor: name, found, needed: needed() }
        })?;
        if tensor.shape != wanted {
            return Err(ModelError::Shape {
                file: file(),
                tensor: name.to_owned(),
                found: tensor.shape.clone(),
                wanted: format!("{wanted:?}"),
                remedy: "train the network with this version (`foretrace lab train --model foresight`)",
            });
        }
        let dtype =
            || ModelError::DType { file: file(), tensor: name.to_owned(), found: tensor.dtype.clone() };
        tensor.numbers().ok_or_else(dtype)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> ForesightModel {
        let spec = ForesightSpec { step_ns: 10_000_000, input_scale: 10.0, block: 2 };
        let layers = SHAPES.map(|(inputs, outputs)| Dense {
            weight: (0..inputs * outputs).map(|k| (k % 17) as f64 * 0.125).collect(),
            bias: (0..outputs).map(|k| (k % 5) as f64 * -0.25).collect(),
        });
        let weights = Arc::new(ForesightWeights::new(spec, layers).unwrap());
        let notes = BTreeMap::from([("seed".to_owned(), "3".to_owned())]);
        ForesightModel { file: "mine".to_owned(), weights, notes }
    }

    #[test]
    fn what_is_saved_is_what_is_loaded_with_its_notes() {
        let folder = std::env::temp_dir().join(format!("foretrace-foresight-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("mine.safetensors");
        model().save(&file).unwrap();
        let loaded = ForesightModel::find(&file.display().to_string()).unwrap();
        assert_eq!((&loaded.weights, &loaded.notes), (&model().weights, &model().notes));
        assert_eq!(loaded.to_bytes(), model().to_bytes());
        // By its key it reaches the loop, and a loop with another step refuses it.
        let key = "predictor.mixture.foresight";
        let path = file.display().to_string();
        let config = crate::Draft::preset("ur5").set(key, &path).finish().unwrap();
        assert!(config.models().networks().foresight.is_some());
        let other = crate::Draft::preset("ur5").set("pen.step_ms", "5").set(key, &path).finish();
        let error = other.unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("10000000 ns"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
        let gone = crate::Draft::preset("ur5").set(key, &path).finish().unwrap_err().to_string();
        assert!(gone.contains(key), "{gone}");
        // Without the key it is the shipped one of the step; "none" does without.
        let networks = |draft: crate::Draft| draft.finish().unwrap().models().networks().foresight.clone();
        let preset = || crate::Draft::preset("ur5");
        let shipped = |ms: u32| ForesightModel::find(&format!("foresight-{ms}ms")).unwrap().weights;
        assert_eq!(networks(preset()), Some(shipped(10)));
        assert_eq!(networks(preset().set(key, "none")), None);
    }

    #[test]
    fn other_models_and_damaged_files_are_refused_with_the_reason() {
        let parse = |bytes: &[u8]| ForesightModel::parse("mine", bytes).unwrap_err().to_string();
        let lstm = shipped("mixture-10ms").unwrap();
        assert!(parse(lstm.bytes).contains("--model foresight"), "{}", parse(lstm.bytes));
        let whole = model().to_bytes();
        for cut in [0, 7, 100, whole.len() - 1] {
            assert!(parse(&whole[..cut]).contains("mine"), "{cut}");
        }
        // The same length, another name or shape.
        let changed = |from: &str, to: &str| {
            let at = whole.windows(from.len()).position(|bytes| bytes == from.as_bytes()).unwrap();
            let mut bytes = whole.clone();
            bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
            parse(&bytes)
        };
        assert!(changed("layers.2.bias", "layers.2.bits").contains("layers.2.bias is missing"));
        assert!(changed("[128, 72]", "[72, 128]").contains("needed is [128, 72]"));
        assert!(changed("\"10000000\"", "\"1000000x\"").contains("step_ns"));
        assert!(changed("\"block\":\"2\"", "\"block\":\"0\"").contains("block is 0, legal are 1 to 12"));
    }
}
