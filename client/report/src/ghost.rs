//! What the prediction saves, from a status: the loop beside its ghost, which runs at trust 0.
//!
//! Contract: figures as the daemon measured them, only differences are computed; an unknown value is null in
//! JSON and a dash in words.

use foretrace_client::Status;
use foretrace_client::wire::{GhostState, Tracking};
use serde::Serialize;

/// The loop and its ghost; keys are stable.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Whether they are compared at present.
    pub state: &'static str,
    /// How long the pen wrote while they were.
    pub compared_s: f64,
    /// Over the last seconds of writing.
    pub recent: Saved,
    /// Since arming.
    pub session: Saved,
    /// Since arming, hovering included.
    pub hover_rms_m: Option<f64>,
    pub ghost_hover_rms_m: Option<f64>,
    /// Median cost per tick on the thread that publishes.
    pub cost_us: Option<f64>,
}

/// Both at the same instants.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Saved {
    pub rms_m: Option<f64>,
    pub ghost_rms_m: Option<f64>,
    pub saved_m: Option<f64>,
    pub lag_ms: Option<f64>,
    pub ghost_lag_ms: Option<f64>,
    pub saved_ms: Option<f64>,
}

impl Comparison {
    /// What `status` says.
    pub fn of(status: &Status) -> Self {
        let (real, ghost) = (&status.tracking, &status.ghost);
        Self {
            state: GhostState::try_from(status.ghost_state).map_or("unknown", GhostState::label),
            compared_s: status.compared_s,
            recent: Saved::of(real, ghost, |one| (one.recent_rms_m, one.recent_lag_s)),
            session: Saved::of(real, ghost, |one| (one.session_rms_m, one.session_lag_s)),
            hover_rms_m: metres(real.hover_rms_m),
            ghost_hover_rms_m: metres(ghost.hover_rms_m),
            cost_us: (status.ghost_cost_ns > 0).then(|| f64::from(status.ghost_cost_ns) * 1e-3),
        }
    }

    /// One line about the last seconds, for a screen that is looked at while it runs.
    pub fn now(&self) -> String {
        match self.recent.rms_m {
            None => format!("not compared yet ({})", self.state),
            Some(_) if self.state == GhostState::Comparable.label() => self.recent.words(),
            Some(_) => format!("{} (now {})", self.recent.words(), self.state),
        }
    }
}

impl Saved {
    fn of(real: &Tracking, ghost: &Tracking, pick: impl Fn(&Tracking) -> (f64, f64)) -> Self {
        let ((rms, lag), (ghost_rms, ghost_lag)) = (pick(real), pick(ghost));
        let (rms_m, ghost_rms_m) = (metres(rms), metres(ghost_rms));
        let ms = |seconds: f64| seconds.is_finite().then_some(seconds * 1e3);
        let (lag_ms, ghost_lag_ms) = (ms(lag), ms(ghost_lag));
        let less = |ghost: Option<f64>, real: Option<f64>| Some(ghost? - real?);
        Self {
            rms_m,
            ghost_rms_m,
            saved_m: less(ghost_rms_m, rms_m),
            lag_ms,
            ghost_lag_ms,
            saved_ms: less(ghost_lag_ms, lag_ms),
        }
    }

    /// "(trust 0): 7.3 mm rms, 62 ms late; you: 3.0 mm, 15 ms: saved 4.3 mm, 47 ms".
    fn words(&self) -> String {
        let mm = |m: Option<f64>| m.map_or_else(|| "-".to_owned(), |m| format!("{:.2}", m * 1e3));
        let ms = |ms: Option<f64>| ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.1}"));
        format!(
            "(trust 0): {} mm rms, {} ms late; you: {} mm, {} ms: saved {} mm, {} ms",
            mm(self.ghost_rms_m),
            ms(self.ghost_lag_ms),
            mm(self.rms_m),
            ms(self.lag_ms),
            mm(self.saved_m),
            ms(self.saved_ms)
        )
    }
}

fn metres(value: f64) -> Option<f64> {
    (value >= 0.0).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tracking(rms_m: f64, lag_s: f64) -> Tracking {
        Tracking {
            recent_rms_m: rms_m,
            session_rms_m: 2.0 * rms_m,
            hover_rms_m: 3.0 * rms_m,
            recent_lag_s: lag_s,
            session_lag_s: lag_s + 0.001,
        }
    }

    #[test]
    fn what_is_saved_is_the_ghosts_figure_less_the_loops() {
        let mut status = Status {
            tracking: tracking(0.0030, 0.015),
            ghost: tracking(0.0073, 0.062),
            ghost_state: GhostState::Comparable.into(),
            ..Status::default()
        };
        let words = "(trust 0): 7.30 mm rms, 62.0 ms late; you: 3.00 mm, 15.0 ms: saved 4.30 mm, 47.0 ms";
        assert_eq!(Comparison::of(&status).now(), words);
        let json = serde_json::to_value(Comparison::of(&status)).unwrap();
        assert!((json["session"]["saved_m"].as_f64().unwrap() - 0.0086).abs() < 1e-12, "{json}");
        assert!((json["session"]["ghost_lag_ms"].as_f64().unwrap() - 63.0).abs() < 1e-9, "{json}");
        status.ghost_state = GhostState::Settling.into();
        assert_eq!(Comparison::of(&status).now(), format!("{words} (now settling)"));
    }

    #[test]
    fn what_is_not_known_is_neither_zero_nor_a_saving() {
        let status = Status { tracking: Tracking::UNKNOWN, ghost: Tracking::UNKNOWN, ..Status::default() };
        let comparison = Comparison::of(&status);
        assert_eq!(comparison.now(), "not compared yet (off)");
        let json = serde_json::to_value(comparison).unwrap();
        for key in ["rms_m", "ghost_rms_m", "saved_m", "lag_ms", "ghost_lag_ms", "saved_ms"] {
            assert!(json["recent"][key].is_null() && json["session"][key].is_null(), "{json}");
        }
        let status = Status { tracking: tracking(0.003, f64::NAN), ..status };
        assert!(Comparison::of(&status).recent.words().contains("you: 3.00 mm, - ms: saved - mm"));
    }
}
