//! The page of `status --watch`: 80 columns by 24 lines, the most important first.
//!
//! Contract: at most [`LINES`] lines of at most [`COLUMNS`] columns, whatever the status holds. Mode, reason
//! and what to do come first, then the chain, the loop, pen, arm and trust; `foretrace status` without
//! `--watch` has everything.

use foretrace_shm::{FaultReason, Latency, Mode, Stage, Status, TrustReason, missing_rights};

use super::arm_line;
use super::held::Held;
use super::view::{age, label, milliseconds, refusals, seconds};
use crate::extent::ExtentFigures;
use crate::ghost::Comparison;
use crate::stopped;

/// The smallest supported screen.
pub(crate) const COLUMNS: usize = 80;
/// One less than 24, so that the last line does not scroll the first one away.
pub(crate) const LINES: usize = 23;

/// The page.
pub(crate) fn page(status: &Status, held: &Held, age_ns: u64) -> String {
    let counts = &status.counters;
    let mode = Mode::try_from(status.mode).ok();
    let fault = FaultReason::try_from(status.fault).unwrap_or(FaultReason::Internal);
    let mut lines = vec![format!(
        "{:<10}{:<22}daemon {}, up {}, status {} old",
        "mode",
        mode_and_way(status),
        status.pid,
        seconds(status.uptime_ns),
        milliseconds(age_ns)
    )];
    if matches!(mode, Some(Mode::Stopped | Mode::Fault)) {
        lines.extend(wrapped("stopped", &stopped::reason(fault, &status.stop)));
    }
    lines.extend(wrapped("to do", &to_do(status, mode, fault)));
    for (who, refused) in refusals(status) {
        // Old refusals are no longer shown.
        let ago_ns = status.header.stamp_ns.saturating_sub(refused.at_ns);
        if refused.at_ns != 0 && ago_ns < 10_000_000_000 {
            lines.extend(wrapped("refused", &format!("{who}: {refused}")));
        }
    }
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
    if let Some(holder) = &held.pen {
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
    if let Some(words) = arm_line::words(&status.arm_line) {
        lines.push(format!("{:<10}{words}", "line"));
    }
    if let Some(extent) = ExtentFigures::told(&status.extent) {
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
    lines.push(format!(
        "{:<10}weights {}, {} updates, {} refused",
        "learner", status.learner_version, status.learner_updates, status.learner_refused
    ));
    let missing: Vec<&str> = missing_rights::labels(status.missing_rights).collect();
    if !missing.is_empty() {
        lines.push(format!("{:<10}missing: {}", "rights", missing.join(", ")));
    }
    let fitted = lines.iter().take(LINES).map(|line| cut(line));
    fitted.collect::<Vec<_>>().join("\n")
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
fn to_do(status: &Status, mode: Option<Mode>, fault: FaultReason) -> String {
    match mode {
        Some(Mode::Stopped | Mode::Fault) => stopped::remedy(fault),
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

/// Text in as many lines as it takes, at most three, broken between words.
fn wrapped(name: &str, text: &str) -> Vec<String> {
    let mut lines = vec![format!("{name:<10}")];
    for word in text.split_whitespace() {
        let full = lines.last().is_some_and(|line| width(line) + width(word) + 1 > COLUMNS);
        if full {
            if lines.len() == 3 {
                break;
            }
            lines.push(" ".repeat(10));
        }
        if let Some(line) = lines.last_mut() {
            if width(line) > 10 {
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
fn cut(line: &str) -> String {
    let plain = line.chars().map(|c| if c.is_control() { '?' } else { c });
    if width(line) <= COLUMNS {
        return plain.collect();
    }
    plain.take(COLUMNS - 1).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use foretrace_shm::{Percentiles, Refused, RejectReason, Rejection, StopCause, StopDetail, ToolExtent};

    use super::*;

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

    #[test]
    fn any_status_fits_the_least_screen_with_mode_reason_and_remedy_on_top() {
        for status in [busy(), Status::default()] {
            let page = page(&status, &Held::default(), u64::MAX);
            assert!(page.lines().count() <= LINES, "{page}");
            assert!(page.lines().all(|line| line.chars().count() <= COLUMNS), "{page}");
            assert!(page.starts_with("mode"), "{page}");
        }
        let page = page(&busy(), &Held::default(), 0);
        let line = |index: usize| page.lines().nth(index).unwrap_or_default().to_owned();
        assert!(line(1).starts_with("stopped   tracking error: joint 3 is 0.213 rad"), "{page}");
        assert!(page.contains("disarm and arm again") && page.contains("q[2] = 57.3000 rad"), "{page}");
    }

    #[test]
    fn what_to_do_follows_the_mode() {
        let at = |mode: Mode| {
            page(
                &Status { mode: mode.into(), arm_speed_share: -1.0, ..Status::default() },
                &Held::default(),
                0,
            )
        };
        assert!(at(Mode::Idle).contains("foretrace request arm"));
        assert!(at(Mode::Holding).contains("start the pen"));
        assert!(at(Mode::Following).contains("to do     nothing"));
        let slow = Status { mode: Mode::Following.into(), arm_speed_share: 0.3, ..Status::default() };
        assert!(page(&slow, &Held::default(), 0).contains("about 30 % of the commanded speed"));
    }
}
