//! Recordings of the law's decisions in a file: a line of JSON, then the values, eight bytes each.

use std::io::{BufWriter, Read as _, Write as _};
use std::path::Path;

use serde_json::{Value, json};

use crate::fields::{COUNT, NAMES};

/// FNV-1a, 64 bit: small, and the same everywhere.
const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0100_0000_01b3;

/// One run of the law.
pub(crate) struct Scene {
    pub(crate) name: String,
    /// `COUNT` values a tick.
    pub(crate) values: Vec<u64>,
}

/// A figure of the lab, with the place where it stands.
pub(crate) struct Figure {
    pub(crate) place: String,
    pub(crate) bits: u64,
}

#[derive(Default)]
pub(crate) struct Golden {
    pub(crate) scenes: Vec<Scene>,
    pub(crate) figures: Vec<Figure>,
}

pub(crate) fn digest(values: impl Iterator<Item = u64>) -> u64 {
    let bytes = values.flat_map(u64::to_le_bytes);
    bytes.fold(OFFSET, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(PRIME))
}

impl Scene {
    pub(crate) fn ticks(&self) -> usize {
        self.values.len() / COUNT
    }

    pub(crate) fn digest(&self) -> u64 {
        digest(self.values.iter().copied())
    }

    fn difference(&self, other: &Self) -> Option<String> {
        let name = &self.name;
        if let Some(at) = self.values.iter().zip(&other.values).position(|(a, b)| a != b) {
            let (a, b, field) = (self.values[at], other.values[at], NAMES[at % COUNT]);
            return Some(format!("{name}, tick {}, {field}: {} against {}", at / COUNT, told(a), told(b)));
        }
        (self.values.len() != other.values.len())
            .then(|| format!("{name}: {} ticks against {}", self.ticks(), other.ticks()))
    }
}

fn told(bits: u64) -> String {
    format!("{bits:#018x} (integer {bits}, float {:e})", f64::from_bits(bits))
}

impl Golden {
    pub(crate) fn figures_digest(&self) -> u64 {
        digest(self.figures.iter().map(|figure| figure.bits))
    }

    pub(crate) fn write(&self, path: &Path) -> Result<(), String> {
        let wrong = |error: std::io::Error| format!("{}: {error}", path.display());
        let head = json!({
            "fields": NAMES,
            "scenes": self.scenes.iter().map(|scene| json!([scene.name, scene.values.len()]))
                .collect::<Vec<_>>(),
            "figures": self.figures.iter().map(|figure| json!([figure.place, figure.bits]))
                .collect::<Vec<_>>(),
        });
        let mut out = BufWriter::new(std::fs::File::create(path).map_err(wrong)?);
        writeln!(out, "{head}").map_err(wrong)?;
        for value in self.scenes.iter().flat_map(|scene| &scene.values) {
            out.write_all(&value.to_le_bytes()).map_err(wrong)?;
        }
        out.flush().map_err(wrong)
    }

    pub(crate) fn read(path: &Path) -> Result<Self, String> {
        let wrong = |what: &dyn std::fmt::Display| format!("{}: {what}", path.display());
        let mut bytes = Vec::new();
        std::fs::File::open(path)
            .and_then(|mut file| file.read_to_end(&mut bytes))
            .map_err(|error| wrong(&error))?;
        let end = bytes.iter().position(|byte| *byte == b'\n').ok_or_else(|| wrong(&"no head"))?;
        let head: Value = serde_json::from_slice(&bytes[..end]).map_err(|error| wrong(&error))?;
        if head["fields"] != json!(NAMES) {
            return Err(wrong(&"made with another list of fields"));
        }
        let mut rest = bytes[end + 1..].chunks_exact(8).map(|word| {
            let mut bytes = [0; 8];
            bytes.copy_from_slice(word);
            u64::from_le_bytes(bytes)
        });
        let pairs = |key: &str| {
            let list = head[key].as_array().cloned().unwrap_or_default();
            list.into_iter().filter_map(|pair| Some((pair[0].as_str()?.to_owned(), pair[1].as_u64()?)))
        };
        let scenes: Vec<Scene> = pairs("scenes")
            .map(|(name, count)| Scene { name, values: rest.by_ref().take(count as usize).collect() })
            .collect();
        let figures = pairs("figures").map(|(place, bits)| Figure { place, bits }).collect();
        Ok(Self { scenes, figures })
    }

    /// One line for each scene and each figure that differs, the first of all differences first.
    pub(crate) fn differences(&self, other: &Self) -> Vec<String> {
        let mut found: Vec<String> =
            self.scenes.iter().zip(&other.scenes).filter_map(|(a, b)| scene_difference(a, b)).collect();
        if self.scenes.len() != other.scenes.len() {
            found.push(format!("{} scenes against {}", self.scenes.len(), other.scenes.len()));
        }
        let figures = self.figures.iter().zip(&other.figures);
        found.extend(figures.filter(|(a, b)| a.bits != b.bits || a.place != b.place).map(|(a, b)| {
            let value = |figure: &Figure| f64::from_bits(figure.bits);
            format!("{}: {} against {} of {}", a.place, value(a), value(b), b.place)
        }));
        if self.figures.len() != other.figures.len() {
            found.push(format!("{} figures against {}", self.figures.len(), other.figures.len()));
        }
        found
    }
}

fn scene_difference(a: &Scene, b: &Scene) -> Option<String> {
    if a.name == b.name { a.difference(b) } else { Some(format!("{} against {}", a.name, b.name)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn golden() -> Golden {
        let values = (0..3 * COUNT as u64).map(|i| (i as f64).to_bits()).collect();
        let figure = Figure { place: "set/table/0".to_owned(), bits: 0.5f64.to_bits() };
        Golden { scenes: vec![Scene { name: "life".to_owned(), values }], figures: vec![figure] }
    }

    #[test]
    fn what_was_written_is_read_and_equal_to_itself() {
        let path = std::env::temp_dir().join(format!("golden-test-{}", std::process::id()));
        golden().write(&path).unwrap();
        let read = Golden::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(golden().differences(&read), Vec::<String>::new());
        assert_eq!((read.scenes[0].ticks(), read.figures.len()), (3, 1));
    }

    #[test]
    fn the_first_difference_is_named_with_scene_tick_field_and_both_values() {
        let mut other = golden();
        other.scenes[0].values[COUNT + 4] = 7.25f64.to_bits();
        other.scenes[0].values[2 * COUNT] = 0;
        other.figures[0].bits = 0.25f64.to_bits();
        let [life, figure] = &golden().differences(&other)[..] else { panic!("two parts differ") };
        let was = format!("float {:e}", (COUNT + 4) as f64);
        assert!(life.starts_with(&format!("life, tick 1, {}: ", NAMES[4])), "{life}");
        assert!(life.contains(&was) && life.contains("float 7.25e0"), "{life}");
        assert!(figure.contains("set/table/0: 0.5 against 0.25"), "{figure}");
        // Fewer ticks or scenes are a difference too.
        other = golden();
        other.scenes[0].values.truncate(COUNT);
        assert_eq!(golden().differences(&other), ["life: 3 ticks against 1"]);
        assert_eq!(golden().differences(&Golden::default()).len(), 2);
    }
}
