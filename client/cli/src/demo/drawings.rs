//! The pictures of a demo, one per claim, from the records of the run.
//!
//! Contract: time starts at 0 where the approach to the paper ends; what came before is in no picture, so
//! that it does not stretch an axis. The ghost stands beside the arm wherever both are known.

use foretrace_client::Stage;
use foretrace_control::extent::ExtentBounds;
use foretrace_sim::metrics::ToolSample;
use foretrace_sim::path::PathSample;
use foretrace_sim::plot::Distribution;
use foretrace_sim::plot::page::{
    Bound, Curve, CurvePanel, Picture, Shares, Shown, Traced, curves, durations, paths, shares,
};

use super::figures::{Figures, Scored};
use super::gathered::Gathered;
use super::told::{Against, arm, ghost};

const ARM: &str = "the arm";
const GHOST: &str = "the ghost (no prediction)";
/// Instants farther apart are not joined by a line [s].
const GAP_S: f64 = 0.05;
/// Long enough for a few strokes, short enough to see milliseconds [s].
const LENS_S: f64 = 0.8;

/// All of them; none where there was nothing to draw.
#[derive(Debug, Default)]
pub(crate) struct Drawings {
    pub(crate) path: Option<Picture>,
    pub(crate) error: Option<Picture>,
    pub(crate) lag: Option<Picture>,
    pub(crate) times: Option<Picture>,
    pub(crate) limits: Option<Picture>,
    pub(crate) heights: Option<Picture>,
}

impl Drawings {
    /// `scored`: the part of the run that counts; `turn_s`: one repetition of the pen's path [s], of which
    /// the last is shown.
    pub(crate) fn of(
        gathered: &Gathered,
        figures: &Figures,
        scored: Option<&Scored>,
        bounds: &ExtentBounds,
        turn_s: f64,
    ) -> Self {
        let run = Run::new(gathered, scored);
        let about = about(figures);
        Self {
            path: run.path(&about, turn_s),
            error: run.error(&about),
            lag: run.lag(&about),
            times: times(gathered, figures),
            limits: limits(figures),
            heights: run.heights(figures, bounds),
        }
    }
}

/// The figures in the pictures' descriptions: the same in all of them.
fn about(figures: &Figures) -> String {
    let words = |name, against: Option<Against>| {
        against.map_or_else(
            || format!("{name}: not compared"),
            |Against { rms_m, max_m, lag_ms }| {
                let (rms, most) = (rms_m.words(1e3, 2, "mm"), max_m.words(1e3, 1, "mm"));
                format!("{name}: {rms} rms, {most} at most, {} late", lag_ms.words(1.0, 1, "ms"))
            },
        )
    };
    format!("{}; {}", words("arm", arm(figures)), words("ghost", ghost(figures)))
}

/// The run from the end of the approach to the paper.
struct Run<'a> {
    gathered: &'a Gathered,
    tool: Vec<ToolSample>,
    ghost: Vec<ToolSample>,
    /// Errors of the arm and of the ghost while the pen wrote [s, mm].
    errors: [Vec<(f64, f64)>; 2],
    /// Begin and end [s].
    span: (f64, f64),
}

impl<'a> Run<'a> {
    fn new(gathered: &'a Gathered, scored: Option<&Scored>) -> Self {
        let notes: Vec<_> = gathered.ticks.iter().filter_map(|tick| tick.compared).collect();
        let whole = Scored::whole(gathered);
        let errors = if notes.is_empty() {
            // No ghost: the records of arm and pen alone.
            let rows = scored.unwrap_or(&whole).errors.iter();
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
        let tool = gathered.tool.iter().filter(|sample| inside(sample)).copied().collect();
        let ghost = gathered.ticks.iter().filter_map(|tick| tick.ghost).filter(inside).collect();
        Self { gathered, tool, ghost, errors, span: (first, last) }
    }

    fn path(&self, about: &str, turn_s: f64) -> Option<Picture> {
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

    fn error(&self, about: &str) -> Option<Picture> {
        let [arm, ghost] = self.errors.each_ref().map(|rows| self.since_begin(rows));
        let trust: Vec<_> = self.gathered.ticks.iter().map(|tick| (tick.t_s, tick.trust)).collect();
        let trust = self.since_begin(&trust);
        let drawn = [
            Curve { shown: Shown::Ghost, label: GHOST, wide: false, points: &ghost },
            Curve { shown: Shown::Arm, label: ARM, wide: false, points: &arm },
        ];
        let from = usize::from(ghost.is_empty());
        let trusted = [Curve { shown: Shown::Other, label: "trust", wide: false, points: &trust }];
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
    fn lag(&self, about: &str) -> Option<Picture> {
        let (from, to) = self.liveliest()?;
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
        let mut drawn = vec![Curve { shown: Shown::Pen, label: "the pen", wide: true, points: &points }];
        if !ghost.is_empty() {
            drawn.push(Curve { shown: Shown::Ghost, label: GHOST, wide: false, points: &ghost });
        }
        drawn.push(Curve { shown: Shown::Arm, label: ARM, wide: false, points: &arm });
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

    /// Begin and end of the stretch in which the pen went farthest while it was down [s].
    fn liveliest(&self) -> Option<(f64, f64)> {
        let pen = self.pen(self.span.0, self.span.1);
        // What the pen wrote up to each sample [m].
        let mut written = vec![(pen.first()?.t_s, 0.0)];
        for (a, b) in pen.iter().zip(pen.iter().skip(1)) {
            let way = if a.contact && b.contact { (b.x_m - a.x_m).hypot(b.y_m - a.y_m) } else { 0.0 };
            written.push((b.t_s, written.last().map_or(0.0, |last| last.1) + way));
        }
        let (mut end, mut best) = (written.iter().peekable(), (f64::NEG_INFINITY, (0.0, 0.0)));
        for &(from, before) in &written {
            while end.next_if(|next| next.0 < from + LENS_S).is_some() {}
            let Some(&&(to, after)) = end.peek() else { break };
            if after - before > best.0 {
                best = (after - before, (from, to));
            }
        }
        (best.0 > 0.0).then_some(best.1)
    }

    fn heights(&self, figures: &Figures, bounds: &ExtentBounds) -> Option<Picture> {
        let inside = self.gathered.heights.iter().filter(|p| (self.span.0..=self.span.1).contains(&p.0));
        let rows: Vec<_> = inside.map(|(t_s, z_m)| (t_s - self.span.0, 1e3 * z_m)).collect();
        let drawn = [Curve {
            shown: Shown::Arm,
            label: "height of the pen's tip on the arm",
            wide: false,
            points: &rows,
        }];
        let lowest = 1e3 * bounds.height_m[0];
        let bound = [Bound { at: lowest, label: "lower than this is a breach" }];
        let panel = CurvePanel {
            label: "height over the paper [mm]",
            height: 170.0,
            y: None,
            curves: &drawn,
            bounds: &bound,
        };
        let about = figures.envelope.as_ref().map_or_else(|| "not measured".to_owned(), ToString::to_string);
        curves("Height over the paper", &about, "time [s]", &[panel], ("the pen writes", &self.strokes()))
    }

    fn pen(&self, from_s: f64, to_s: f64) -> Vec<PathSample> {
        self.gathered.pen.iter().filter(|sample| (from_s..=to_s).contains(&sample.t_s)).copied().collect()
    }

    /// Stretches of time with the pen down [s].
    fn strokes(&self) -> Vec<(f64, f64)> {
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

    fn since_begin(&self, rows: &[(f64, f64)]) -> Vec<(f64, f64)> {
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

fn times(gathered: &Gathered, figures: &Figures) -> Option<Picture> {
    let of = |label: &str, stage: Stage| {
        let us = gathered.ticks.iter().map(|tick| f64::from(tick.stage_ns(stage)) * 1e-3);
        Distribution::from_values_us(label, us)
    };
    let shown = [
        of("waking up: how late a tick begins", Stage::Wakeup),
        of("computing: from its beginning to the command sent", Stage::Step),
    ];
    let looped = &figures.control_loop;
    let about = format!(
        "{:.0} Hz, {} ticks, {} ended too late; computing p99 {:.1} µs, waking up p99 {:.1} µs",
        looped.rate_hz, looped.ticks, looped.overruns, looped.step_us.p99, looped.wakeup_us.p99
    );
    durations("What a tick costs", &about, &shown, 1e6 / looped.rate_hz)
}

fn limits(figures: &Figures) -> Option<Picture> {
    let used = &figures.joints;
    let groups = [
        Shares { label: "fastest command", of_limit: &used.velocity_share },
        Shares { label: "largest acceleration", of_limit: &used.acceleration_share },
    ];
    let about = format!("{} commands broke a limit", figures.limit_violations());
    shares("How near the commands came to the joints' limits", &about, &groups)
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
