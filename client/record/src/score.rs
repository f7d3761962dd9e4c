//! How a law did: its tool beside the pen, as numbers and as curves for a picture.

use foretrace_sim::metrics::{ErrorSample, PEN_GAP_MAX_S, ToolSample, error_series, motion, tracking};
use foretrace_sim::path::PathSample;
use serde::Serialize;

/// Stretches of time that a curve has at most, each of them [`SHORTEST_S`] or longer.
const STRETCHES: f64 = 400.0;
const SHORTEST_S: f64 = 0.1;

/// How a law did.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct VariantScore {
    /// Name of the row.
    pub name: String,
    /// Distance of tool and pen while it writes, rms \[mm\].
    pub rms_mm: f64,
    /// The largest \[mm\].
    pub max_mm: f64,
    /// Lag of the tool behind the pen \[ms\].
    pub lag_ms: f64,
    /// Jerk of the tool, rms \[m/s³\].
    pub jerk_mps3: f64,
    /// Share of the ticks whose plan ran into a limit; `None`: not known of a recorded run.
    pub saturated: Option<f64>,
    /// Rms of the worst stroke \[mm\].
    pub worst_stroke_mm: f64,
    /// When that stroke began, from the beginning \[s\].
    pub worst_stroke_at_s: f64,
    /// When and why a stop latched, or why the law never took charge.
    pub stopped: Option<String>,
}

/// What a picture shows of a law.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ErrorCurve {
    /// Time from the beginning \[s\], and rms error while the pen writes \[mm\], of stretches of equal
    /// length.
    pub error_mm: Vec<(f64, f64)>,
    /// The tool in the stroke that is shown.
    pub tool: Vec<ToolSample>,
    /// Its rms error there \[mm\].
    pub stroke_mm: f64,
}

/// A stroke of the pen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Stroke {
    pub(crate) rms_m: f64,
    /// From its first to its last sample \[s\].
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
}

/// The pen, and where its time begins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PenTrack<'a> {
    pub(crate) pen: &'a [PathSample],
    pub(crate) origin_s: f64,
    pub(crate) seconds: f64,
}

impl PenTrack<'_> {
    /// Length of the stretches of a curve \[s\].
    pub(crate) fn stretch_s(&self) -> f64 {
        (self.seconds / STRETCHES).max(SHORTEST_S)
    }

    /// How `tool` did; `None`: the pen does not write.
    pub(crate) fn score(
        &self,
        name: &str,
        tool: &[ToolSample],
        saturated: Option<f64>,
    ) -> Option<VariantScore> {
        let all = tracking(self.pen, tool)?;
        let worst = self.worst(tool);
        Some(VariantScore {
            name: name.to_owned(),
            rms_mm: 1e3 * all.rmse_m,
            max_mm: 1e3 * all.max_m,
            lag_ms: all.lag_ms,
            jerk_mps3: motion(tool).rms_jerk_mps3,
            saturated,
            worst_stroke_mm: 1e3 * worst.rms_m,
            worst_stroke_at_s: worst.from_s - self.origin_s,
            stopped: None,
        })
    }

    /// The stroke that `tool` followed worst.
    pub(crate) fn worst(&self, tool: &[ToolSample]) -> Stroke {
        worst_stroke(&error_series(self.pen, tool))
    }

    /// What a picture shows of `tool`, with the tool itself during `stroke`.
    pub(crate) fn curve(&self, tool: &[ToolSample], stroke: Stroke) -> ErrorCurve {
        let errors = error_series(self.pen, tool);
        let during = |t_s: f64| (stroke.from_s..=stroke.to_s).contains(&t_s);
        let squares = errors.iter().filter(|e| e.contact && during(e.t_s)).map(|e| e.error_m * e.error_m);
        let (sum, count) = squares.fold((0.0, 0_u32), |(sum, count), square| (sum + square, count + 1));
        ErrorCurve {
            error_mm: stretches(&errors, self.origin_s, self.stretch_s()),
            tool: tool.iter().filter(|sample| during(sample.t_s)).copied().collect(),
            stroke_mm: 1e3 * f64::sqrt(sum / f64::from(count.max(1))),
        }
    }

    /// The pen during `stroke`.
    pub(crate) fn during(&self, stroke: Stroke) -> Vec<PathSample> {
        let during = |sample: &&PathSample| (stroke.from_s..=stroke.to_s).contains(&sample.t_s);
        self.pen.iter().filter(during).copied().collect()
    }
}

/// Middle \[s from the origin\] and rms error \[mm\] of every stretch of `length_s` in which the pen writes.
fn stretches(errors: &[ErrorSample], origin_s: f64, length_s: f64) -> Vec<(f64, f64)> {
    let index = |error: &ErrorSample| ((error.t_s - origin_s) / length_s).floor();
    let mut found = Vec::new();
    for part in errors.chunk_by(|a, b| index(a) == index(b)) {
        let written = part.iter().filter(|error| error.contact);
        let (sum, count) = written
            .fold((0.0, 0_u32), |(sum, count), error| (sum + error.error_m * error.error_m, count + 1));
        if let (Some(first), true) = (part.first(), count > 0) {
            found.push(((index(first) + 0.5) * length_s, 1e3 * f64::sqrt(sum / f64::from(count))));
        }
    }
    found
}

/// The stroke with the largest rms error.
fn worst_stroke(errors: &[ErrorSample]) -> Stroke {
    let begin_s = errors.first().map_or(0.0, |error| error.t_s);
    // Where the pen was silent, another stroke begins.
    let goes_on = |a: &ErrorSample, b: &ErrorSample| a.contact == b.contact && b.t_s - a.t_s <= PEN_GAP_MAX_S;
    let strokes = errors.chunk_by(goes_on).filter(|part| part.first().is_some_and(|error| error.contact));
    let rated = strokes.filter_map(|part| {
        let sum: f64 = part.iter().map(|error| error.error_m * error.error_m).sum();
        let (first, last) = (part.first()?, part.last()?);
        Some(Stroke { rms_m: f64::sqrt(sum / part.len() as f64), from_s: first.t_s, to_s: last.t_s })
    });
    let none = Stroke { rms_m: 0.0, from_s: begin_s, to_s: begin_s };
    rated.fold(none, |worst, stroke| if stroke.rms_m > worst.rms_m { stroke } else { worst })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(k: u32, error_m: f64, contact: bool) -> ErrorSample {
        ErrorSample { t_s: f64::from(k), error_m, contact }
    }

    #[test]
    fn the_worst_stroke_is_a_stroke_and_not_a_moment() {
        let at = |ms: u32, error_m, contact| ErrorSample { t_s: f64::from(ms) * 1e-3, error_m, contact };
        let errors = [at(0, 1.0, true), at(1, 1.0, true), at(2, 9.0, false), at(3, 2.0, true)];
        assert_eq!(worst_stroke(&errors), Stroke { rms_m: 2.0, from_s: 0.003, to_s: 0.003 });
        assert_eq!(worst_stroke(&errors[..3]), Stroke { rms_m: 1.0, from_s: 0.0, to_s: 0.001 });
        assert_eq!(worst_stroke(&[]), Stroke::default());
        // A pen that is silent for seconds and writes elsewhere writes another stroke.
        let silent = [at(0, 1.0, true), at(1, 1.0, true), at(9000, 3.0, true), at(9001, 3.0, true)];
        assert_eq!(worst_stroke(&silent), Stroke { rms_m: 3.0, from_s: 9.0, to_s: 9001.0 * 1e-3 });
    }

    #[test]
    fn a_curve_has_the_stretches_in_which_the_pen_writes() {
        let errors = [
            error(10, 1e-3, true),
            error(11, 7e-3, true),
            error(12, 9.0, false),
            error(13, 9.0, false),
            error(14, 2e-3, true),
            error(15, 9.0, false),
        ];
        let found = stretches(&errors, 10.0, 2.0);
        assert_eq!(found.iter().map(|(t_s, _)| *t_s).collect::<Vec<_>>(), [1.0, 5.0]);
        assert!((found[0].1 - 5.0).abs() < 1e-9 && (found[1].1 - 2.0).abs() < 1e-9, "{found:?}");
        let hand = PenTrack { pen: &[], origin_s: 0.0, seconds: 600.0 };
        assert_eq!(hand.stretch_s(), 1.5);
        assert_eq!(PenTrack { seconds: 4.0, ..hand }.stretch_s(), 0.1);
    }
}
