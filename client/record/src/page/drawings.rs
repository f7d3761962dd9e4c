//! The pictures that every run has: what was written, error and lag over time, and what a tick costs.
//!
//! Contract: time starts at 0 where the approach to the paper ends; what came before is in no picture, so
//! that it does not stretch an axis. The ghost stands beside the arm wherever both are known.

use foretrace_sim::metrics::{ToolSample, error_series};
use foretrace_sim::path::PathSample;
use foretrace_sim::plot::Distribution;
use foretrace_sim::plot::{CurvePanel, PageCurve, Picture, Shown, Traced, curves, durations, paths};

use super::run::{GhostSample, RunTraces};

const ARM: &str = "the arm";
const GHOST: &str = "the ghost (no prediction)";
/// Instants farther apart are not joined by a line \[s\].
pub(super) const GAP_S: f64 = 0.05;
/// Long enough for a few strokes, short enough to see milliseconds \[s\].
const LENS_S: f64 = 0.8;

/// The part of a run that is shown: from the end of the approach on.
#[derive(Debug)]
pub struct View<'a> {
    run: &'a RunTraces,
    tool: Vec<ToolSample>,
    ghost: Vec<ToolSample>,
    /// Errors of the arm and of the ghost while the pen wrote \[s, mm\].
    errors: [Vec<(f64, f64)>; 2],
    span: (f64, f64),
}

impl<'a> View<'a> {
    /// That of `run`.
    #[must_use]
    pub fn of(run: &'a RunTraces) -> Self {
        let notes = &run.compared;
        let errors = if notes.is_empty() {
            // No ghost: the records of arm and pen alone; all of them where the tool never came near.
            let whole = if run.errors.is_empty() { error_series(&run.pen, &run.tool) } else { Vec::new() };
            let rows = run.errors.iter().chain(&whole);
            [broken(rows.map(|e| (e.t_s, 1e3 * e.error_m, e.contact))), Vec::new()]
        } else {
            [
                broken(notes.iter().map(|n| (n.t_s, 1e3 * n.error_m, n.contact))),
                broken(notes.iter().map(|n| (n.t_s, 1e3 * n.ghost_error_m, n.contact))),
            ]
        };
        let known = || errors.iter().flatten().filter(|p| p.1.is_finite()).map(|p| p.0);
        let first = known().fold(f64::INFINITY, f64::min);
        let last = known().fold(f64::NEG_INFINITY, f64::max);
        let inside = |sample: &ToolSample| (first..=last).contains(&sample.t_s);
        let tool = run.tool.iter().filter(|sample| inside(sample)).copied().collect();
        let ghost = run.ghost.iter().map(GhostSample::tool).filter(inside).collect();
        Self { run, tool, ghost, errors, span: (first, last) }
    }

    /// Begin and end \[s\]; the end is before the begin where nothing is known.
    #[must_use]
    pub const fn span(&self) -> (f64, f64) {
        self.span
    }

    /// The last `turn_s` seconds of writing, once by the arm and once by its ghost.
    #[must_use]
    pub fn path(&self, about: &str, turn_s: f64) -> Option<Picture> {
        let from_s = (self.span.1 - turn_s).max(self.span.0);
        let pen = self.pen(from_s, self.span.1);
        let late = |tool: &[ToolSample]| -> Vec<ToolSample> {
            tool.iter().filter(|sample| sample.t_s >= from_s).copied().collect()
        };
        let (tool, ghost) = (late(&self.tool), late(&self.ghost));
        let mut traced = vec![Traced { shown: Shown::Arm, label: ARM, tool: &tool }];
        if !ghost.is_empty() {
            traced.push(Traced { shown: Shown::Ghost, label: GHOST, tool: &ghost });
        }
        paths("What the pen wrote and what the arm made of it", about, &pen, &traced)
    }

    /// Distance from the pen, and trust.
    #[must_use]
    pub fn error(&self, about: &str) -> Option<Picture> {
        let [arm, ghost] = self.errors.each_ref().map(|rows| self.since_begin(rows));
        let trust = self.since_begin(&self.run.trust);
        let drawn = [
            PageCurve { shown: Shown::Ghost, label: GHOST, wide: false, points: &ghost },
            PageCurve { shown: Shown::Arm, label: ARM, wide: false, points: &arm },
        ];
        let from = usize::from(ghost.is_empty());
        let trusted = [PageCurve { shown: Shown::Other, label: "trust", wide: false, points: &trust }];
        let panels = [
            CurvePanel {
                label: "distance from the pen while it writes [mm]",
                height: 250.0,
                y: None,
                curves: drawn.get(from..)?,
                bounds: &[],
            },
            CurvePanel { label: "trust", height: 56.0, y: Some((0.0, 1.05)), curves: &trusted, bounds: &[] },
        ];
        arm.iter().any(|p| p.1.is_finite()).then_some(())?;
        curves("Error over time", about, "time [s]", &panels, ("", &[]))
    }

    /// The fraction of a second in which the pen wrote most, along the axis of its largest motion.
    #[must_use]
    pub fn lag(&self, about: &str) -> Option<Picture> {
        let (from, to) = self.liveliest(LENS_S)?;
        let pen = self.pen(from, to);
        let reach = |of: fn(&PathSample) -> f64| {
            let (low, high) = pen
                .iter()
                .map(of)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
            high - low
        };
        let along_y = reach(|s| s.y_m) > reach(|s| s.x_m);
        let pick = |x_m: f64, y_m: f64| 1e3 * if along_y { y_m } else { x_m };
        let tool = |tool: &[ToolSample]| -> Vec<(f64, f64)> {
            let inside = tool.iter().filter(|sample| (from..=to).contains(&sample.t_s));
            inside.map(|s| (1e3 * (s.t_s - from), pick(s.x_m, s.y_m))).collect()
        };
        let points: Vec<_> = pen.iter().map(|s| (1e3 * (s.t_s - from), pick(s.x_m, s.y_m))).collect();
        let (arm, ghost) = (tool(&self.tool), tool(&self.ghost));
        let mut drawn = vec![PageCurve { shown: Shown::Pen, label: "the pen", wide: true, points: &points }];
        if !ghost.is_empty() {
            drawn.push(PageCurve { shown: Shown::Ghost, label: GHOST, wide: false, points: &ghost });
        }
        drawn.push(PageCurve { shown: Shown::Arm, label: ARM, wide: false, points: &arm });
        let label =
            if along_y { "across the line of writing [mm]" } else { "along the line of writing [mm]" };
        let values = || drawn.iter().flat_map(|curve| curve.points).map(|p| p.1);
        let (low, high) =
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        let pad = 0.05 * (high - low).max(1.0);
        let panel = CurvePanel {
            label,
            height: 280.0,
            y: Some((low - pad, high + pad)),
            curves: &drawn,
            bounds: &[],
        };
        curves("The liveliest strokes, in slow motion", about, "time [ms]", &[panel], ("", &[]))
    }

    /// Begin and end of the stretch of `length_s` in which the pen went farthest while it was down \[s\].
    pub(super) fn liveliest(&self, length_s: f64) -> Option<(f64, f64)> {
        let pen = self.pen(self.span.0, self.span.1);
        // What the pen wrote up to each sample [m].
        let mut written = vec![(pen.first()?.t_s, 0.0)];
        for (a, b) in pen.iter().zip(pen.iter().skip(1)) {
            let way = if a.contact && b.contact { (b.x_m - a.x_m).hypot(b.y_m - a.y_m) } else { 0.0 };
            written.push((b.t_s, written.last().map_or(0.0, |last| last.1) + way));
        }
        let (mut end, mut best) = (written.iter().peekable(), (f64::NEG_INFINITY, (0.0, 0.0)));
        for &(from, before) in &written {
            while end.next_if(|next| next.0 < from + length_s).is_some() {}
            let Some(&&(to, after)) = end.peek() else { break };
            if after - before > best.0 {
                best = (after - before, (from, to));
            }
        }
        (best.0 > 0.0).then_some(best.1)
    }

    fn pen(&self, from_s: f64, to_s: f64) -> Vec<PathSample> {
        self.run.pen.iter().filter(|sample| (from_s..=to_s).contains(&sample.t_s)).copied().collect()
    }

    /// Stretches of time with the pen down \[s since the begin\].
    #[must_use]
    pub fn strokes(&self) -> Vec<(f64, f64)> {
        let mut strokes: Vec<(f64, f64)> = Vec::new();
        let mut down = false;
        for sample in self.pen(self.span.0, self.span.1) {
            let t_s = sample.t_s - self.span.0;
            match strokes.last_mut() {
                Some(stroke) if down => stroke.1 = t_s,
                _ if sample.contact => strokes.push((t_s, t_s)),
                _ => {}
            }
            down = sample.contact;
        }
        strokes
    }

    /// What of `rows` (when \[s\], value) is shown, since the begin.
    #[must_use]
    pub fn since_begin(&self, rows: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let inside = rows.iter().filter(|p| !p.1.is_finite() || (self.span.0..=self.span.1).contains(&p.0));
        inside.map(|(t_s, value)| (t_s - self.span.0, *value)).collect()
    }
}

/// Rows (t [s], value, counts) as points with a break wherever something is missing or does not count.
fn broken(rows: impl Iterator<Item = (f64, f64, bool)>) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    let mut last_s = f64::NEG_INFINITY;
    for (t_s, value, counts) in rows {
        if (!counts || t_s - last_s > GAP_S) && points.last().is_some_and(|p| p.1.is_finite()) {
            points.push((f64::NAN, f64::NAN));
        }
        if counts {
            points.push((t_s, value));
            last_s = t_s;
        }
    }
    points
}

/// What ticks cost: waking up and computing, each \[ns\], beside the period \[µs\].
#[must_use]
pub fn times(costs: &[(u32, u32)], about: &str, period_us: f64) -> Option<Picture> {
    let of = |label: &str, pick: fn(&(u32, u32)) -> u32| {
        Distribution::from_values_us(label, costs.iter().map(|cost| f64::from(pick(cost)) * 1e-3))
    };
    let shown = [
        of("waking up: how late a tick begins", |cost| cost.0),
        of("computing: from its beginning to the command sent", |cost| cost.1),
    ];
    durations("What a tick costs", about, &shown, period_us)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_breaks_where_the_pen_is_up_and_where_nothing_is_known() {
        let rows = [(0.0, 1.0, true), (0.01, 2.0, false), (0.02, 3.0, true), (0.5, 4.0, true)];
        let points = broken(rows.into_iter());
        let finite: Vec<bool> = points.iter().map(|p| p.1.is_finite()).collect();
        assert_eq!(finite, [true, false, true, false, true]);
        assert_eq!(
            points.iter().filter(|p| p.1.is_finite()).map(|p| p.1).collect::<Vec<_>>(),
            [1.0, 3.0, 4.0]
        );
    }
}
