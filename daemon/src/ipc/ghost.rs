//! The ghost in the daemon: one tick behind the loop, on the ipc thread.
//!
//! Contract: costs the real-time thread nothing. When records pile up, telemetry comes first: the ghost skips
//! ticks, and reports that it cannot be compared for a while. Pure except for the clock that times its own
//! cost.

use std::fmt::Debug;

use hdrhistogram::Histogram;

use foretrace_control::follower::{FollowerError, FollowerSettings};
use foretrace_control::ghost::{Ghost, GhostFigures, GhostReport, GhostTick};

use crate::rt::facts::TickFacts;
use crate::rt::os;
use crate::wire::JOINTS;

/// The ghost pauses while more records than this are waiting: an eighth of the ring.
const TOO_MANY_WAITING: usize = 64;

/// A ghost of any horizon.
trait Beside: Debug + Send {
    fn follow(&mut self, tick: &GhostTick<'_, JOINTS>) -> GhostReport;
    fn figures(&self) -> GhostFigures;
}

impl<const N: usize> Beside for Ghost<N, JOINTS> {
    fn follow(&mut self, tick: &GhostTick<'_, JOINTS>) -> GhostReport {
        Self::follow(self, tick)
    }
    fn figures(&self) -> GhostFigures {
        Self::figures(self)
    }
}

/// The ghost, if there is one, and its cost.
#[derive(Debug)]
pub struct GhostShell {
    ghost: Option<Box<dyn Beside>>,
    cost: Option<Histogram<u64>>,
}

impl GhostShell {
    #[must_use]
    pub const fn none() -> Self {
        Self { ghost: None, cost: None }
    }

    /// The ghost of a loop with these settings and this horizon: 10, 20, else 30.
    ///
    /// # Errors
    /// As [`Ghost::new`].
    pub fn new(settings: FollowerSettings<JOINTS>, horizon: u32) -> Result<Self, FollowerError> {
        let ghost: Box<dyn Beside> = match horizon {
            10 => Box::new(Ghost::<10, JOINTS>::new(settings)?),
            20 => Box::new(Ghost::<20, JOINTS>::new(settings)?),
            _ => Box::new(Ghost::<30, JOINTS>::new(settings)?),
        };
        // The crate accepts these constant bounds; without a histogram the cost would be unknown.
        Ok(Self { ghost: Some(ghost), cost: Histogram::new_with_bounds(1, 1_000_000_000, 2).ok() })
    }

    /// Follows one tick; `waiting` records come after it.
    pub fn follow(&mut self, facts: &TickFacts, waiting: usize) -> GhostReport {
        let Some(ghost) = self.ghost.as_mut().filter(|_| waiting <= TOO_MANY_WAITING) else {
            return GhostReport::default();
        };
        let began = os::monotonic_ns();
        let output = &facts.output;
        // The measured shift; until it is known, the plan's dead time.
        let measured = output.lag.map(|lag| (lag.shift_s * 1e9) as i64);
        let report = ghost.follow(&GhostTick {
            tick: facts.tick,
            now: facts.wake.release,
            budget: facts.given.budget,
            output,
            measured: facts.measured,
            lag_ns: measured.unwrap_or_else(|| i64::try_from(output.dead_time_ns).unwrap_or(i64::MAX)),
        });
        if report.tool.is_some()
            && let Some(cost) = &mut self.cost
        {
            cost.saturating_record(os::monotonic_ns().saturating_sub(began).max(1));
        }
        report
    }

    /// Scores of the loop and its ghost.
    #[must_use]
    pub fn figures(&self) -> GhostFigures {
        self.ghost.as_ref().map_or_else(GhostFigures::default, |ghost| ghost.figures())
    }

    /// Median cost per tick in which the ghost moved \[ns\]; 0: none yet.
    #[must_use]
    pub fn cost_ns(&self) -> u32 {
        let known = self.cost.as_ref().filter(|cost| !cost.is_empty());
        known.map_or(0, |cost| u32::try_from(cost.value_at_quantile(0.5)).unwrap_or(u32::MAX))
    }
}
