//! The page of `status --watch`, for the screen that is there: mode, reason and what to do first.
//!
//! Contract: at most one line less than the screen has, none wider than it, whatever the status holds; two
//! columns from [`WIDE`]. After the reason come the chain, the loop, pen, arm and trust; `foretrace status`
//! without `--watch` has everything.

use foretrace_shm::{Latency, Mode, Stage, Status, TrustReason, missing_rights};

use super::external;
use super::holders::Holders;
use super::view::{age, label, milliseconds, refusals, seconds};
use super::{arm_line, bearing};
use crate::extent::ExtentFigures;
use crate::ghost::Comparison;
use crate::stopped;

/// From so many columns on there are two.
const WIDE: usize = 120;
const GAP: usize = 2;
/// Columns of a line's name.
const NAME: usize = 10;
/// The narrowest screen that lines are broken for.
const NARROWEST: usize = 30;

/// What a mode means for whoever looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    Stopped,
    Moving,
    Waiting,
}

impl Tone {
    /// Its colour, a parameter of SGR; none for the usual one.
    pub const fn colour(self) -> Option<u8> {
        match self {
            Self::Stopped => Some(31),
            Self::Moving => Some(32),
            Self::Waiting => None,
        }
    }
}

/// A page: what matters most, and the rest.
#[derive(Debug)]
pub struct Screen {
    pub tone: Tone,
    pub top: String,
    pub rest: String,
}

/// The page for a screen of so many columns and lines.
pub fn page((columns, lines): (usize, usize), status: &Status, holders: &Holders, age_ns: u64) -> Screen {
    let mode = Mode::try_from(status.mode).ok();
    let tone = match mode {
        Some(Mode::Stopped | Mode::Fault) | None => Tone::Stopped,
        Some(Mode::Following | Mode::Homing) => Tone::Moving,
        _ => Tone::Waiting,
    };
    let columns = columns.max(NARROWEST);
    // The last line would scroll the first one away.
    let mut room = lines.saturating_sub(1).max(2);
    let mut fit = |all: Vec<String>| {
        let kept: Vec<String> = all.iter().take(room).map(|line| cut(line, columns)).collect();
        room -= kept.len();
        kept.join("\n")
    };
    let top = fit(matters(columns, mode, status, age_ns));
    let mut lines = Vec::new();
    if mode != Some(Mode::Stopped) && mode != Some(Mode::Fault) {
        lines.extend(wrapped(columns, "to do", &to_do(status, mode)));
    }
    for (who, refused) in refusals(status) {
        // Old refusals are no longer shown.
        let ago_ns = status.header.stamp_ns.saturating_sub(refused.at_ns);
        if ago_ns < 10_000_000_000 {
            lines.extend(wrapped(columns, "refused", &format!("{who}: {refused}")));
        }
    }
    let figures = figures(status, holders);
    if columns >= WIDE {
        lines.extend(side_by_side(&figures, columns));
    } else {
        lines.extend(figures);
    }
    Screen { tone, top, rest: fit(lines) }
}

/// Mode, and of a stop the reason and what to do.
fn matters(columns: usize, mode: Option<Mode>, status: &Status, age_ns: u64) -> Vec<String> {
    let mut lines = vec![format!(
        "{:<NAME$}{:<22}daemon {}, up {}, status {} old",
        "mode",
        mode_and_way(status),
        status.pid,
        seconds(status.uptime_ns),
        milliseconds(age_ns)
    )];
    if matches!(mode, Some(Mode::Stopped | Mode::Fault)) {
        let (why, to_do) = stopped::explained(status);
        lines.extend(wrapped(columns, "stopped", &why));
        lines.extend(wrapped(columns, "to do", &to_do));
    }
    if let Some(note) = bearing::note(status) {
        lines.extend(wrapped(columns, "arm says", &note));
    }
    lines
}

/// Lines in two columns, the first half on the left.
fn side_by_side(lines: &[String], columns: usize) -> Vec<String> {
    let half = (columns - GAP) / 2;
    let (left, right) = lines.split_at(lines.len().div_ceil(2));
    let beside = right.iter().map(String::as_str).chain(std::iter::repeat(""));
    let pairs = left.iter().zip(beside);
    pairs.map(|(left, right)| format!("{:<half$}{:GAP$}{}", cut(left, half), "", cut(right, half))).collect()
}

/// Everything else, the most important first.
fn figures(status: &Status, holders: &Holders) -> Vec<String> {
    let counts = &status.counters;
    let mut lines = Vec::new();
    lines.push(latency("pen-cmd", &status.pen_to_command, &format!("pen {}", age(status.pen_age_ns))));
    let lag = &status.arm_lag;
    let late = if lag.is_known() {
        format!(
            "arm {:.1} ± {:.1} late, planned {:.1}",
            lag.lag_s * 1e3,
            lag.std_s * 1e3,
            lag.dead_time_ns as f64 * 1e-6
        )
    } else {
        "arm not measured yet".to_owned()
    };
    lines.push(latency("cmd-move", &status.command_to_motion, &late));
    let ghost = Comparison::of(status);
    lines.push(match (ghost.recent.saved_m, ghost.recent.rms_m, ghost.recent.ghost_rms_m) {
        (Some(saved), Some(rms), Some(alone)) => format!(
            "{:<10}{:.2} mm rms; feedback alone {:.2}: prediction saves {:.2} mm, {:.0} ms",
            "tracking",
            rms * 1e3,
            alone * 1e3,
            saved * 1e3,
            ghost.recent.saved_ms.unwrap_or(f64::NAN)
        ),
        _ => format!("{:<10}not compared ({})", "tracking", ghost.state),
    });
    lines.push(format!(
        "{:<10}{:.0} Hz set, {:.1} measured; {} overruns, {} skipped, {} shed",
        "loop",
        status.rate_hz,
        status.measured_rate_hz,
        counts.overruns,
        counts.skipped_ticks,
        counts.shed_ticks
    ));
    lines.push(format!("{:<10}{:>10}{:>10}{:>10}{:>10}", "  µs", "p50", "p99", "p99.9", "max"));
    for stage in [Stage::Wakeup, Stage::Predict, Stage::Mpc, Stage::Ik, Stage::Step] {
        let spread = status.stage(stage);
        let us = |ns: u32| f64::from(ns) / 1e3;
        lines.push(format!(
            "  {:<8}{:>10.1}{:>10.1}{:>10.1}{:>10.1}",
            stage.label(),
            us(spread.p50_ns),
            us(spread.p99_ns),
            us(spread.p99_9_ns),
            us(spread.max_ns)
        ));
    }
    lines.push(format!(
        "{:<10}{} samples, {} dropped, {} rejected, {} outliers, {} gaps",
        "pen",
        counts.pen_received,
        counts.pen_dropped,
        counts.pen_rejected.total(),
        counts.pen_outliers,
        counts.pen_gaps
    ));
    if let Some(holder) = &holders.pen {
        lines.push(format!("{:<10}held by {holder}", ""));
    }
    lines.push(format!(
        "{:<10}newest {}; {} states, {} dropped, {} rejected",
        "arm",
        age(status.joint_state_age_ns),
        counts.joint_state_received,
        counts.joint_state_dropped,
        counts.joint_state_rejected.total()
    ));
    if let (Some(joints), Some(pose)) = (bearing::joints(status), bearing::pose(status)) {
        lines.push(format!("{:<NAME$}{joints}", "joints"));
        lines.push(format!("{:<NAME$}{pose}", "pose"));
    }
    if let Some(words) = arm_line::words(&status.arm_line) {
        lines.push(format!("{:<10}{words}", "line"));
    }
    if let Some(extent) = ExtentFigures::reported(&status.extent) {
        lines.push(format!(
            "{:<10}{:.1} to {:.1} mm over the paper, {:.1} mm outside, tilt {:.3} rad",
            "tool",
            extent.height_min_m * 1e3,
            extent.height_max_m * 1e3,
            extent.outside_max_m * 1e3,
            extent.tilt_max_rad
        ));
    }
    lines.push(format!(
        "{:<10}{:.2}, to {:.2} ({}); predictor {}",
        "trust",
        status.trust,
        status.trust_target,
        label::<TrustReason>(status.trust_reason),
        status.predictor
    ));
    if let Some(words) = external::text(&status.external) {
        lines.push(format!("{:<10}{words}", "external"));
    }
    lines.push(format!(
        "{:<10}weights {}, {} updates, {} refused",
        "learner", status.learner_version, status.learner_updates, status.learner_refused
    ));
    let missing: Vec<&str> = missing_rights::labels(status.missing_rights).collect();
    if !missing.is_empty() {
        lines.push(format!("{:<10}missing: {}", "rights", missing.join(", ")));
    }
    lines
}

/// The mode, on the way home with how far that is.
fn mode_and_way(status: &Status) -> String {
    let mode = label::<Mode>(status.mode);
    let share = status.way_home.share;
    if status.mode == u32::from(Mode::Homing) && share >= 0.0 {
        format!("{mode}, {:.0} %", 100.0 * share)
    } else {
        mode.to_owned()
    }
}

/// What the operator can do now.
fn to_do(status: &Status, mode: Option<Mode>) -> String {
    match mode {
        Some(Mode::Idle) if status.joint_state_age_ns == u64::MAX => {
            "start the arm's program (`foretrace arm sim`), then `foretrace request arm`".to_owned()
        }
        Some(Mode::Idle) => "`foretrace request arm` takes the arm over".to_owned(),
        Some(Mode::Homing) => "keep clear of the arm; Ctrl-C or `foretrace request stop` stops it".to_owned(),
        Some(Mode::Armed | Mode::Holding) => {
            "start the pen, or `foretrace play glyphs:hello --loop`".to_owned()
        }
        _ if (0.0..0.95).contains(&status.arm_speed_share) => format!(
            "the arm moves at about {:.0} % of the commanded speed: look at its speed slider",
            status.arm_speed_share * 100.0
        ),
        _ => "nothing".to_owned(),
    }
}

/// A latency on one line.
fn latency(name: &str, latency: &Latency, more: &str) -> String {
    if latency.count == 0 {
        return format!("{name:<10}not measured yet; {more}");
    }
    let spread = &latency.percentiles;
    let ms = |ns: u32| f64::from(ns) * 1e-6;
    format!(
        "{name:<10}p50 {:.1} p99 {:.1} p99.9 {:.1} max {:.1} ms; {more}",
        ms(spread.p50_ns),
        ms(spread.p99_ns),
        ms(spread.p99_9_ns),
        ms(spread.max_ns)
    )
}

/// Text in as many lines as it takes, at most four, broken between words.
fn wrapped(columns: usize, name: &str, text: &str) -> Vec<String> {
    let mut lines = vec![format!("{name:<NAME$}")];
    for word in text.split_whitespace() {
        let full = lines.last().is_some_and(|line| width(line) + width(word) + 1 > columns);
        if full {
            if lines.len() == 4 {
                break;
            }
            lines.push(" ".repeat(NAME));
        }
        if let Some(line) = lines.last_mut() {
            if width(line) > NAME {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

fn width(text: &str) -> usize {
    text.chars().count()
}

/// A line that fits, with control characters taken out: names in a status come from elsewhere.
fn cut(line: &str, columns: usize) -> String {
    let plain = line.chars().map(|c| if c.is_control() { '?' } else { c });
    if width(line) <= columns {
        return plain.collect();
    }
    // Of a path the end tells most: what is left out is in its middle.
    if let Some(at) = line.find(" /") {
        let path = line.get(at + 1..).unwrap_or_default();
        let before = width(line) - width(path);
        let name = width(path.rsplit('/').next().unwrap_or(path));
        if before + 1 + name <= columns {
            let rest = plain.clone().skip(width(line) + before + 1 - columns);
            return plain.take(before).chain(['…']).chain(rest).collect();
        }
    }
    plain.take(columns - 1).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use foretrace_shm::{
        FaultReason, NoteWords, Percentiles, Refused, RejectReason, Rejection, StopCause, StopDetail,
        ToolExtent,
    };

    use super::*;

    #[test]
    fn a_long_path_is_cut_in_its_middle_and_other_lines_at_their_end() {
        let path = format!("/{}/flight-17-stop.mcap", "folder".repeat(20));
        let told = cut(&format!("  flight  stop, 12 s ago: {path}"), 60);
        assert!(told.contains(": …"), "{told}");
        assert!(told.ends_with("/flight-17-stop.mcap") && width(&told) == 60, "{told}");
        let speed = cut("the tool moves with 0.25 m/s and the arm with some rad/s", 30);
        assert!(speed.starts_with("the tool moves with 0.25 m/s") && speed.ends_with('…'), "{speed}");
        let name = cut(&format!("file: /{}", "n".repeat(80)), 30);
        assert!(width(&name) == 30 && name.ends_with('…'), "{name}");
    }

    fn busy() -> Status {
        let mut status = Status {
            mode: Mode::Stopped.into(),
            fault: FaultReason::TrackingError.into(),
            missing_rights: missing_rights::ALL,
            pid: u32::MAX,
            uptime_ns: u64::MAX,
            pen_age_ns: u64::MAX,
            measured_rate_hz: 499.97,
            rate_hz: 500.0,
            arm_speed_share: 0.3,
            extent: ToolExtent {
                height_min_m: -0.04,
                height_max_m: 0.05,
                outside_max_m: 0.1,
                tilt_max_rad: 3.1,
            },
            stop: StopDetail {
                cause: StopCause::JointDeviation.into(),
                joint: 3,
                amount: 0.213,
                limit: 0.05,
                at_ns: 1,
            },
            ..Status::default()
        };
        status.header.stamp_ns = 5;
        status.counters.overruns = u64::MAX;
        status.counters.pen_received = u64::MAX;
        let degrees = Rejection::new(RejectReason::OutOfRange, "q").because(57.3, 12.6).at(2);
        status.joints_refused = Refused::of(&degrees, 4);
        status.pen_refused = Refused::of(&degrees, 4);
        status.pen_to_command = Latency {
            count: 7,
            percentiles: Percentiles {
                p50_ns: u32::MAX,
                p99_ns: u32::MAX,
                p99_9_ns: u32::MAX,
                max_ns: u32::MAX,
            },
            ..Latency::default()
        };
        status
    }

    fn whole((columns, lines): (usize, usize), status: &Status) -> String {
        let Screen { top, rest, .. } = page((columns, lines), status, &Holders::default(), u64::MAX);
        format!("{top}\n{rest}")
    }

    #[test]
    fn any_status_fits_any_screen_with_mode_reason_and_remedy_on_top() {
        for (columns, lines) in [(80, 24), (40, 10), (120, 30), (200, 50), (30, 5)] {
            for status in [busy(), Status::default()] {
                let page = whole((columns, lines), &status);
                assert!(page.trim_end().lines().count() < lines, "{columns}x{lines}\n{page}");
                assert!(page.lines().all(|line| line.chars().count() <= columns), "{page}");
                assert!(page.starts_with("mode"), "{page}");
            }
        }
        let page = whole((80, 24), &busy());
        let line = |index: usize| page.lines().nth(index).unwrap_or_default().to_owned();
        assert!(line(1).starts_with("stopped   tracking error: joint 3 is 0.213 rad"), "{page}");
        assert!(page.contains("disarm and arm again") && page.contains("q[2] = 57.3000 rad"), "{page}");
        let small = whole((40, 10), &busy());
        for words in ["tracking error", "joint 3 is 0.213 rad", "to do"] {
            let joined = small.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(joined.contains(words), "{words} is not on\n{small}");
        }
    }

    #[test]
    fn a_wide_screen_shows_more_than_a_narrow_one() {
        let rows = |columns| whole((columns, 100), &busy()).lines().count();
        assert!(rows(160) + 8 < rows(80), "{} and {}", rows(160), rows(80));
        let wide = whole((160, 24), &busy());
        for name in ["pen-cmd", "cmd-move", "trust", "learner", "rights", "pose"] {
            assert!(wide.contains(name), "{name} is not on\n{wide}");
        }
    }

    #[test]
    fn what_the_arm_says_stands_beside_the_reason() {
        let note = NoteWords::new("speed scaling is at 50 %", "set the speed slider to 100 %");
        let fault = FaultReason::RobotStopped.into();
        let page = whole((80, 24), &Status { mode: Mode::Fault.into(), fault, note, ..Status::default() });
        let head: Vec<&str> = page.lines().take(3).collect();
        assert!(
            head[1].ends_with("speed scaling is at 50 %") && head[2].contains("slider to 100 %"),
            "{page}"
        );
    }

    #[test]
    fn what_to_do_follows_the_mode() {
        let at = |mode: Mode| {
            whole((80, 24), &Status { mode: mode.into(), arm_speed_share: -1.0, ..Status::default() })
        };
        assert!(at(Mode::Idle).contains("foretrace request arm"));
        assert!(at(Mode::Holding).contains("start the pen"));
        assert!(at(Mode::Following).contains("to do     nothing"));
        let slow = Status { mode: Mode::Following.into(), arm_speed_share: 0.3, ..Status::default() };
        assert!(whole((80, 24), &slow).contains("about 30 % of the commanded speed"));
    }
}
