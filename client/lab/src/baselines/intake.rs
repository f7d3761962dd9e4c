//! Which pen samples a baseline accepts, and what a gap is.

use foretrace_sim::path::PathSample;

/// A longer silence resets the filter: Chromium's predictors forget everything after 20 ms.
pub(super) const GAP_S: f64 = 0.020;
/// How far a stamp may lie in the future [s]: clocks are read one after another.
const FUTURE_S: f64 = 0.010;

/// The role of a sample for a filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum SampleRole {
    /// The first one, or the first after a gap.
    First,
    /// Time since the last one \[s\].
    Next(f64),
    /// Not to be used.
    Dropped,
}

/// The newest sample that was taken.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Intake {
    newest: Option<(f64, [f64; 2])>,
}

impl Intake {
    /// Accepts or drops `sample`, received at `now_s`.
    pub(super) fn take(&mut self, now_s: f64, sample: &PathSample) -> SampleRole {
        let PathSample { t_s, x_m, y_m, .. } = *sample;
        if !(x_m.is_finite() && y_m.is_finite() && t_s <= now_s + FUTURE_S && t_s.is_finite()) {
            return SampleRole::Dropped;
        }
        let before = self.newest.map(|(t, _)| t);
        if before.is_some_and(|t| t_s <= t) {
            return SampleRole::Dropped;
        }
        self.newest = Some((t_s, [x_m, y_m]));
        match before {
            Some(t) if t_s - t <= GAP_S => SampleRole::Next(t_s - t),
            _ => SampleRole::First,
        }
    }

    /// The last position of the pen.
    pub(super) fn position(&self) -> Option<[f64; 2]> {
        self.newest.map(|(_, position)| position)
    }

    /// Age of the newest sample \[s\]; a pen silent for longer than a gap counts as standing where it was led
    /// to by then.
    pub(super) fn age_s(&self, now_s: f64) -> f64 {
        self.newest.map_or(0.0, |(t, _)| (now_s - t).clamp(0.0, GAP_S))
    }
}
