//! The page of a recording: what is kept of it while it is read, and what is told of it.
//!
//! Contract: keeps one piece of a minute at most, the one in which the pen wrote most, and one that is being
//! read, whatever the file's length. Stamps that leap and numbers that are not finite, which only a forged
//! file holds, are left out.

use std::fmt::Write as _;
use std::path::Path;

use foretrace_config::Config;
use foretrace_shm::{GhostState, Mode, PieceKind, Stage, TickRecord, pen_flags};
use foretrace_sim::metrics::{ToolSample, error_series, tracking};
use foretrace_sim::path::PathSample;
use foretrace_sim::plot::escaped;

use super::drawings::{View, times};
use super::moving::{DeskGeometry, FARTHEST_M, LONGEST_S, ReplayFrames};
use super::run::{GhostComparison, GhostSample, Late, LateTicks, RunTraces, approached, tool_at};
use super::{claim, late_words, table, tiles, whole};
use crate::RecordError;
use crate::explain::{Explanation, moments};
use crate::read::{Content, RecordingEntry, RecordingReader};

/// Between two ticks of one piece, and from a tick to the stamps in its record \[ns\].
const MAX_STEP_NS: u64 = 1_000_000_000;

/// Whether `metres` are those of a table, and not of a forged file.
fn plausible(metres: &[f64]) -> bool {
    metres.iter().all(|m| m.abs() <= FARTHEST_M)
}

/// A stretch without a gap in which the loop followed the pen, or a part of one.
#[derive(Default)]
struct FollowedStretch {
    /// Releases of its first tick and its last \[ns\].
    times_ns: Option<(u64, u64)>,
    run: RunTraces,
    /// Waking up and computing of each tick \[ns\].
    costs: Vec<(u32, u32)>,
    /// Late ticks: woken late, and with too much work.
    late: (u64, u64),
    lateness: LateTicks,
    /// What the pen wrote \[m\].
    written_m: f64,
    ghost_state: u32,
    predictor: String,
}

impl FollowedStretch {
    /// Whether `record` is the next tick of this piece.
    fn goes_on(&self, record: &TickRecord) -> bool {
        self.times_ns.is_none_or(|(first, last)| {
            let step = record.release_ns.checked_sub(last);
            step.is_some_and(|step| (1..=MAX_STEP_NS).contains(&step))
                && ((record.release_ns - first) as f64) < 1e9 * LONGEST_S
        })
    }

    fn seconds(&self) -> f64 {
        self.times_ns.map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9)
    }

    fn take(&mut self, record: &TickRecord) {
        let now = record.release_ns;
        self.times_ns = Some((self.times_ns.map_or(now, |times| times.0), now));
        let near = |stamp_ns: u64| stamp_ns.abs_diff(now) <= MAX_STEP_NS;
        let run = &mut self.run;
        let [x_m, y_m, _] = record.pen_m;
        let sample = PathSample {
            t_s: record.pen_stamp_ns as f64 * 1e-9,
            x_m,
            y_m,
            contact: record.pen_flags & pen_flags::CONTACT != 0,
        };
        if record.pen_stamp_ns != 0 && near(record.pen_stamp_ns) && plausible(&[x_m, y_m]) {
            let before = run.pen.last().copied();
            if before.is_none_or(|before| before.t_s < sample.t_s) {
                let drawn = before.filter(|before| before.contact && sample.contact);
                self.written_m += drawn.map_or(0.0, |b| (x_m - b.x_m).hypot(y_m - b.y_m));
                run.pen.push(sample);
            }
        }
        if record.joint_state_age_ns <= MAX_STEP_NS && record.measured_q.iter().all(|q| q.is_finite()) {
            let t_s = now.saturating_sub(record.joint_state_age_ns) as f64 * 1e-9;
            if run.joints.last().is_none_or(|last| last.0 < t_s) {
                run.joints.push((t_s, record.measured_q));
            }
        }
        let ghost = GhostSample::of(record).filter(|_| near(record.command_stamp_ns));
        let rises = |ghost: &GhostSample| run.ghost.last().is_none_or(|last| last.t_s < ghost.t_s);
        if let Some(ghost) = ghost.filter(rises).filter(|ghost| plausible(&ghost.at_m)) {
            run.ghost.push(ghost);
        }
        let compared = GhostComparison::of(record)
            .filter(|note| near(record.compared_ns) && plausible(&[note.error_m, note.ghost_error_m]));
        run.compared.extend(compared);
        run.trust.push((now as f64 * 1e-9, record.trust));
        self.costs.push((record.stage(Stage::Wakeup), record.stage(Stage::Step)));
        match self.lateness.see(record) {
            Some(Late::Woken) => self.late.0 += 1,
            Some(Late::Worked) => self.late.1 += 1,
            None => {}
        }
        self.ghost_state = self.ghost_state.max(record.ghost_state);
        self.predictor = record.predictor.to_string();
    }
}

/// The best piece of a recording.
#[derive(Default)]
struct BestStretch {
    piece: FollowedStretch,
    /// Settings in force; `None`: the file has none.
    settings: Option<Vec<u8>>,
    /// Release of the first tick record \[ns\].
    begin_ns: u64,
    /// From the first tick record to the last \[s\].
    seconds: f64,
    /// Pieces that there are.
    pieces: u32,
}

fn found(path: &Path) -> Result<BestStretch, RecordError> {
    let mut reader = RecordingReader::open(path)?;
    let (mut best, mut now, mut settings) = (BestStretch::default(), FollowedStretch::default(), None);
    let mut times: Option<(u64, u64)> = None;
    let end = |best: &mut BestStretch, now: &mut FollowedStretch, settings: &Option<Vec<u8>>| {
        let piece = std::mem::take(now);
        best.pieces += u32::from(piece.times_ns.is_some());
        if (piece.written_m, piece.seconds()) > (best.piece.written_m, best.piece.seconds()) {
            best.piece = piece;
            best.settings.clone_from(settings);
        }
    };
    while let Some(entry) = reader.next_entry()? {
        let RecordingEntry::Message(message) = entry else { continue };
        match reader.ticks_and_things(&message)? {
            Content::Thing(thing) if thing.kind == PieceKind::Settings => settings = Some(thing.bytes),
            Content::Tick(record) => {
                let first = times.map_or(record.release_ns, |times| times.0);
                times = Some((first, record.release_ns));
                let follows = matches!(Mode::try_from(record.mode), Ok(Mode::Following | Mode::Holding));
                if !follows || !now.goes_on(&record) {
                    end(&mut best, &mut now, &settings);
                }
                if follows {
                    now.take(&record);
                }
            }
            _ => {}
        }
    }
    end(&mut best, &mut now, &settings);
    // A recorder is given the settings some records after the first one.
    best.settings = best.settings.or(settings);
    let (first, last) = times.unwrap_or_default();
    (best.begin_ns, best.seconds) = (first, last.saturating_sub(first) as f64 * 1e-9);
    Ok(best)
}

/// The page of the recording `path`, and what `explain` tells of it.
///
/// # Errors
///
/// It is not a recording of this program's layout, the loop never followed a pen in it, or its settings,
/// which hold the arm's geometry, are not there or not legal here.
pub fn of_recording(path: &Path) -> Result<(String, Explanation), RecordError> {
    let told = moments(path)?;
    let mut found = found(path)?;
    let wrong = |why: String| RecordError::Format { path: path.to_path_buf(), why };
    if found.piece.run.pen.len() < 2 || found.piece.run.joints.len() < 2 {
        let early = told.damage.map_or_else(String::new, |damage| format!("; it ends early, {damage}"));
        return Err(wrong(format!("the loop never follows a pen in it, so there is nothing to show{early}")));
    }
    let config = found
        .settings
        .as_deref()
        .ok_or_else(|| "it holds no settings".to_owned())
        .and_then(|bytes| std::str::from_utf8(bytes).map_err(|error| error.to_string()))
        .and_then(|text| Config::recorded(text).map_err(|error| error.to_string()))
        .map_err(|why| wrong(format!("the arm's geometry is not known: {why}")))?;
    measure(&mut found.piece.run, &config);
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    Ok((told_as_page(&name, &found, &config, &told), told))
}

/// Completes `run` by what follows from its joints.
fn measure(run: &mut RunTraces, config: &Config) {
    let plane = config.follower_settings().plane;
    for (t_s, q) in &run.joints {
        let (tool, height) = tool_at(*t_s, &config.robot().chain.forward(q).position, &plane);
        run.tool.push(tool);
        run.heights.push(height);
    }
    let errors = error_series(&run.pen, &run.tool);
    let near = approached(&errors, 0.0, config.settings().safety.approach_distance_m);
    run.errors = near.unwrap_or_default().to_vec();
}

/// A tool against the pen.
#[derive(Default)]
struct ToolScore {
    rms_mm: Option<f64>,
    max_mm: Option<f64>,
    lag_ms: Option<f64>,
}

/// The arm and, where there is one, its ghost.
fn scores(run: &RunTraces, view: &View<'_>) -> [ToolScore; 2] {
    let inside = |t_s: f64| (view.span().0..=view.span().1).contains(&t_s);
    let tool: Vec<ToolSample> = run.tool.iter().filter(|s| inside(s.t_s)).copied().collect();
    let ghost: Vec<ToolSample> = run.ghost.iter().map(GhostSample::tool).filter(|s| inside(s.t_s)).collect();
    let of = |tool: &[ToolSample], errors: &[f64]| {
        let all = tracking(&run.pen, tool);
        let square: f64 = errors.iter().map(|m| m * m).sum();
        let live = (!errors.is_empty()).then(|| (square / errors.len() as f64).sqrt());
        let most = errors.iter().copied().reduce(f64::max);
        ToolScore {
            rms_mm: live.or(all.map(|all| all.rmse_m)).map(|m| 1e3 * m),
            max_mm: most.or(all.map(|all| all.max_m)).map(|m| 1e3 * m),
            lag_ms: all.map(|all| all.lag_ms),
        }
    };
    // At the instants at which the daemon judged both.
    let written = || run.compared.iter().filter(|note| note.contact);
    let arm: Vec<f64> = written().map(|note| note.error_m).collect();
    let behind: Vec<f64> = written().map(|note| note.ghost_error_m).collect();
    [of(&tool, &arm), if ghost.is_empty() { ToolScore::default() } else { of(&ghost, &behind) }]
}

fn told_as_page(name: &str, found: &BestStretch, config: &Config, told: &Explanation) -> String {
    let piece = &found.piece;
    let (run, view) = (&piece.run, View::of(&piece.run));
    let has_ghost = !run.ghost.is_empty();
    let [arm, ghost] = scores(run, &view);
    let unit = |value: Option<f64>, digits: usize, unit: &str| {
        value.map_or_else(|| "unknown".to_owned(), |value| format!("{value:.digits$} {unit}"))
    };
    let without =
        |words: String| if has_ghost { format!(", {words} without prediction") } else { String::new() };
    let (rms, lag) = (unit(arm.rms_mm, 2, "mm"), unit(arm.lag_ms, 1, "ms"));
    let (ghost_rms, ghost_lag) = (unit(ghost.rms_mm, 2, "mm"), unit(ghost.lag_ms, 1, "ms"));
    let about =
        format!("arm: {rms} rms, {lag} late{}", without(format!("{ghost_rms} rms, {ghost_lag} late")));

    let mut body = format!(
        "<h1>{}</h1>\n<p>The arm followed the pen for {:.1} s of the {:.1} s in this recording. <span \
         class=\"muted\">Predictor {}.</span></p>\n",
        escaped(name),
        piece.seconds(),
        found.seconds,
        escaped(&piece.predictor)
    );
    if found.pieces > 1 {
        let _ = writeln!(
            body,
            "<p>Of {} pieces in which it followed, each {LONGEST_S:.0} s long at most, this page shows the one in \
             which the pen wrote most.</p>",
            found.pieces
        );
    }
    if !has_ghost {
        let state = GhostState::try_from(piece.ghost_state).map_or("unknown", GhostState::label);
        let _ = writeln!(
            body,
            "<p class=\"told\">This recording has no ghost, the arm as it would be without prediction ({state}): \
             pen and arm are shown alone.</p>"
        );
    }
    if let Some(damage) = &told.damage {
        let _ = writeln!(body, "<p class=\"told bad\">The file ends early: {}.</p>", escaped(damage));
    }
    let zero_s = found.begin_ns as f64 * 1e-9;
    let plane = config.follower_settings().plane;
    let [x_m, y_m, _] = config.settings().plane.workspace_m;
    let desk = DeskGeometry { chain: &config.robot().chain, plane: &plane, paper_m: [x_m, y_m] };
    let moving = ReplayFrames::of(run, &view, &desk, zero_s);
    body.push_str(&moving.map_or_else(String::new, |moving| moving.section()));
    let late = piece.late.0 + piece.late.1;
    let beside = |words: &str| if has_ghost { format!("{words} without prediction") } else { String::new() };
    body.push_str(&tiles(&[
        ("error (rms)", rms.clone(), beside(&ghost_rms)),
        ("lag", lag.clone(), beside(&ghost_lag)),
        ("ticks too late", late.to_string(), format!("of {}", piece.costs.len())),
    ]));
    body.push_str(&claim(
        &format!("Lag: {lag}{}", without(ghost_lag)),
        "The liveliest strokes in slow motion: how far a curve lies to the right of the pen's is how late it comes. \
         The figures are the shift in time that fits best.",
        view.lag(&about).as_ref(),
    ));
    body.push_str(&claim(
        &format!("Error: {rms}{}", without(ghost_rms)),
        &format!(
            "How far the arm's tool is from the pen at the same instant while the pen writes (root mean square; at \
             most {}{}). Trust says how much of the prediction the arm acts on.",
            unit(arm.max_mm, 1, "mm"),
            without(unit(ghost.max_mm, 1, "mm"))
        ),
        view.error(&about).as_ref(),
    ));
    let period_us = 1e6 / f64::from(config.settings().control_loop.rate_hz);
    let causes = late_words(piece.late.0, piece.late.1);
    body.push_str(&claim(
        &format!("Deadlines: {late} of {} ticks ended too late", piece.costs.len()),
        &format!(
            "A tick wakes up, computes one command and must be done before the next one{}{causes}.",
            if causes.is_empty() { "" } else { ". Late were " }
        ),
        times(&piece.costs, &format!("{late} ended too late"), period_us).as_ref(),
    ));
    body.push_str("<section>\n<h2>Moments that matter</h2>\n");
    body.push_str(&table(told.moments.iter().map(|m| (format!("{:.3} s", m.after_s), m.what.clone()))));
    body.push_str(
        "<p class=\"muted\">Times are those since the first tick in the file, as in the replay. More: foretrace \
         explain, foretrace replay.</p>\n</section>\n",
    );
    whole(name, &body)
}
