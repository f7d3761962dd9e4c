//! Pen paths: what `foretrace play` feeds to the loop, as samples.

use foretrace_sim::source::{PathOptions, load};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use super::settings::NamedSettings;
use super::values::{bytes_of, table};
use super::work::apart;
use crate::problem::{invalid, problem};

/// How the path is chosen and laid out.
#[derive(FromPyObject)]
struct PathWishes {
    #[pyo3(item)]
    height_m: f64,
    #[pyo3(item)]
    scale: f64,
    #[pyo3(item)]
    speed: f64,
    #[pyo3(item)]
    style: u64,
    #[pyo3(item)]
    label: Option<String>,
    #[pyo3(item)]
    segments: Option<(usize, usize)>,
    #[pyo3(item)]
    unit: Option<String>,
}

impl PathWishes {
    fn options(self) -> PyResult<PathOptions> {
        for (name, value) in [("height_m", self.height_m), ("scale", self.scale), ("speed", self.speed)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(invalid(format_args!("{name} is {value}; legal: positive and finite")));
            }
        }
        if let Some((first, last)) = self.segments.filter(|(first, last)| first > last) {
            return Err(invalid(format_args!(
                "segments are {first} to {last}; legal: the first not above the last"
            )));
        }
        let unit = self.unit.as_deref();
        let units = unit.map_or_else(|| Ok(Default::default()), str::parse);
        let units = units.map_err(|legal| invalid(format_args!("unit is {unit:?}; legal: {legal}")))?;
        let Self { height_m, scale, speed, style, label, segments, .. } = self;
        Ok(PathOptions { height_m, scale, speed, style, label, segments, units })
    }
}

/// The path of `names` in the workspace of the settings: rows of 25 bytes, t [s], x and y [m], contact; its
/// rate, spans of characters, notes.
#[pyfunction]
fn pen_path<'py>(
    python: Python<'py>,
    names: Vec<String>,
    wishes: PathWishes,
    settings: NamedSettings,
) -> PyResult<Bound<'py, PyDict>> {
    let options = wishes.options()?;
    let source = apart(python, move |_| {
        let config = settings.load()?;
        load(&names, &options, config.settings()).map_err(problem)
    })??;
    let mut rows = Vec::with_capacity(25 * source.path.samples.len());
    for sample in &source.path.samples {
        rows.extend(bytes_of([sample.t_s, sample.x_m, sample.y_m]));
        rows.push(sample.contact.into());
    }
    let spans = source.path.spans.iter();
    let spans: Vec<_> = spans.map(|span| (&span.label, span.samples.start, span.samples.end)).collect();
    Ok(table!(python;
        "rows" => PyBytes::new(python, &rows),
        "rate_hz" => source.path.rate_hz,
        "spans" => spans,
        "travels" => source.path.inserted_travels,
        "gaps" => source.path.gaps,
        "notes" => source.notes,
    ))
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(pen_path, module)?)
}
