//! The pen: samples onto the grid, and where a silent pen rests.

use super::io::{Health, MAX_STEPS_PER_TICK};
use super::settings::{FollowerError, FollowerSettings};
use crate::pen::{GridStep, PenReading, PenSilence, PenTracker};
use crate::plane::Plane;
use crate::state::state;
use crate::units::Stamp;

/// The grid of the pen, in the plane's frame.
#[derive(Debug)]
pub(super) struct PenIntake {
    tracker: PenTracker,
    silence: PenSilence,
    plane: Plane,
    stale_after_ns: u64,
}

state! { [] PenIntake { tracker, silence } fixed { plane, stale_after_ns } }

/// What the pen reported in one tick.
pub(super) struct PenTick {
    steps: [GridStep; MAX_STEPS_PER_TICK],
    count: usize,
    /// Age of the newest sample \[ns\].
    pub(super) age_ns: Option<u64>,
    /// Time since it arrived \[ns\].
    pub(super) silent_ns: Option<u64>,
    /// Age that it had when it arrived \[ns\].
    pub(super) late_ns: Option<u64>,
    /// The newest accepted sample.
    pub(super) newest: Option<PenReading>,
    /// Where the pen is assumed to rest \[m\], if it is silent.
    pub(super) resting_at: Option<[f64; 2]>,
}

impl PenTick {
    /// The grid steps that closed.
    pub(super) fn steps(&self) -> &[GridStep] {
        self.steps.get(..self.count).unwrap_or_default()
    }
}

impl PenIntake {
    pub(super) fn new<const J: usize>(settings: &FollowerSettings<J>) -> Result<Self, FollowerError> {
        Ok(Self {
            tracker: PenTracker::new(settings.pen)?,
            silence: PenSilence::new(settings.pen.step_ns),
            plane: settings.plane,
            stale_after_ns: settings.trust.stale_after_ns,
        })
    }

    /// Takes in the pen samples, and closes grid steps with them.
    pub(super) fn read(&mut self, now: Stamp, samples: &[PenReading], health: &mut Health) -> PenTick {
        let before = self.tracker.counters().rejected();
        for sample in samples {
            let position = self.plane.from_pen(sample.position);
            self.tracker.ingest(now, &PenReading { position, ..*sample });
        }
        if self.tracker.counters().rejected() > before {
            health.set(Health::PEN_REJECTED);
        }
        let (mut steps, mut count) = ([GridStep::default(); MAX_STEPS_PER_TICK], 0);
        for slot in &mut steps {
            let Some(step) = self.tracker.next_step() else { break };
            *slot = step;
            count += 1;
        }
        let (age_ns, newest) = (self.tracker.age_ns(now), self.tracker.newest());
        if age_ns.is_none_or(|age| age > self.stale_after_ns) {
            health.set(Health::PEN_STALE);
        }
        self.silence.observe(now, newest.as_ref());
        let (silent_ns, late_ns) = (self.silence.silent_ns(now), self.silence.late_ns());
        PenTick { steps, count, age_ns, silent_ns, late_ns, newest, resting_at: self.silence.resting_at(now) }
    }

    pub(super) const fn tracker(&self) -> &PenTracker {
        &self.tracker
    }
}
