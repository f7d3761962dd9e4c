//! The pictures of a demo, one per claim, from the records of the run.
//!
//! Contract: the replay, path, error, lag and costs are those that every run has (`foretrace_record::page`);
//! limits and height are a demo's own.

use foretrace_client::Stage;
use foretrace_config::Config;
use foretrace_control::extent::ExtentBounds;
use foretrace_record::page::{self, DeskGeometry, ReplayFrames, View};
use foretrace_sim::plot::{Bound, CurvePanel, PageCurve, Picture, Shares, Shown, curves, shares};

use super::figures::{RunFigures, ScoredPart};
use super::gathered::Gathered;
use super::table::{Against, arm, ghost};

/// All of them; none where there was nothing to draw.
#[derive(Debug, Default)]
pub struct Drawings {
    pub moving: Option<ReplayFrames>,
    pub path: Option<Picture>,
    pub error: Option<Picture>,
    pub lag: Option<Picture>,
    pub times: Option<Picture>,
    pub limits: Option<Picture>,
    pub heights: Option<Picture>,
}

impl Drawings {
    /// `scored`: the part of the run that counts; `turn_s`: one repetition of the pen's path \[s\], of which
    /// the last is shown.
    pub fn of(
        gathered: &Gathered,
        figures: &RunFigures,
        scored: Option<&ScoredPart>,
        config: &Config,
        turn_s: f64,
    ) -> Self {
        let run = gathered.run(scored.map(|scored| scored.errors.clone()).unwrap_or_default());
        let (view, about, settings) = (View::of(&run), about(figures), config.follower_settings());
        let [x_m, y_m, _] = config.settings().plane.workspace_m;
        let place =
            DeskGeometry { chain: &config.robot().chain, plane: &settings.plane, paper_m: [x_m, y_m] };
        Self {
            moving: ReplayFrames::of(&run, &view, &place, view.span().0),
            path: view.path(&about, turn_s),
            error: view.error(&about),
            lag: view.lag(&about),
            times: times(gathered, figures),
            limits: limits(figures),
            heights: heights(&view, &gathered.heights, figures, &ExtentBounds::of(&settings)),
        }
    }
}

/// The figures in the pictures' descriptions: the same in all of them.
fn about(figures: &RunFigures) -> String {
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

fn heights(
    view: &View<'_>,
    heights_m: &[(f64, f64)],
    figures: &RunFigures,
    bounds: &ExtentBounds,
) -> Option<Picture> {
    let rows: Vec<_> = view.since_begin(heights_m).iter().map(|(t_s, z_m)| (*t_s, 1e3 * z_m)).collect();
    let drawn = [PageCurve {
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
    curves("Height over the paper", &about, "time [s]", &[panel], ("the pen writes", &view.strokes()))
}

fn times(gathered: &Gathered, figures: &RunFigures) -> Option<Picture> {
    let ticks = gathered.ticks.iter();
    let costs: Vec<_> =
        ticks.map(|tick| (tick.stage_ns(Stage::Wakeup), tick.stage_ns(Stage::Step))).collect();
    let looped = &figures.control_loop;
    let about = format!(
        "{:.0} Hz, {} ticks, {} ended too late; computing p99 {:.1} µs, waking up p99 {:.1} µs",
        looped.rate_hz, looped.ticks, looped.overruns, looped.step_us.p99, looped.wakeup_us.p99
    );
    page::times(&costs, &about, 1e6 / looped.rate_hz)
}

fn limits(figures: &RunFigures) -> Option<Picture> {
    let used = &figures.joints;
    let groups = [
        Shares { label: "fastest command", of_limit: &used.velocity_share },
        Shares { label: "largest acceleration", of_limit: &used.acceleration_share },
    ];
    let about = format!("{} commands broke a limit", figures.limit_violations());
    shares("How near the commands came to the joints' limits", &about, &groups)
}
