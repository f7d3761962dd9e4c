//! `PenTracker`: judges readings and closes grid steps.
//!
//! Jumps and glitches: a reading too far for the jump gate is refused as `Outlier` and remembered as a
//! suspect. If the next reading is back near the pen, the suspect was a glitch. If it is nearer to the
//! suspect, the pen has jumped: it is accepted and the steps it closes are `Jump`. So a single outlier has no
//! effect, a real jump is followed one sample late, and an ordinary sample is never delayed.

use super::queue::StepQueue;
use super::{GridStep, Motion, PenError, PenReading, PenRefusal, PenRejection, PenSettings, Receipt, Touch};
use crate::state::state;
use crate::units::Stamp;

/// Counts over all readings: `received` = `accepted` + sum of the rejections.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PenCounters {
    /// Readings given to `ingest`.
    pub received: u64,
    /// Taken into the grid.
    pub accepted: u64,
    /// Refused: NaN or infinite.
    pub non_finite: u64,
    /// Refused: outside the position bounds.
    pub out_of_range: u64,
    /// Refused: stamped too far in the future.
    pub from_future: u64,
    /// Refused: same stamp again.
    pub repeats: u64,
    /// Refused: stamp before the newest.
    pub time_backwards: u64,
    /// Refused: glitches, and the first sample of each jump.
    pub outliers: u64,
    /// Jumps that were confirmed and accepted.
    pub jumps: u64,
    /// Restarts of the grid (the first sample ever, and every gap).
    pub restarts: u64,
    /// Closed grid steps lost because they were not pulled.
    pub overwritten: u64,
}

state! {
    whole [] PenCounters {
        received, accepted, non_finite, out_of_range, from_future, repeats, time_backwards, outliers,
        jumps, restarts, overwritten,
    }
}

impl PenCounters {
    /// Readings that were refused, of all kinds.
    #[must_use]
    pub fn rejected(&self) -> u64 {
        self.non_finite
            + self.out_of_range
            + self.from_future
            + self.repeats
            + self.time_backwards
            + self.outliers
    }

    fn count(&mut self, receipt: Receipt) {
        self.received += 1;
        let counter = match receipt {
            Receipt::Accepted => &mut self.accepted,
            Receipt::Rejected(PenRejection::NonFinite) => &mut self.non_finite,
            Receipt::Rejected(PenRejection::OutOfRange) => &mut self.out_of_range,
            Receipt::Rejected(PenRejection::FromFuture) => &mut self.from_future,
            Receipt::Rejected(PenRejection::Repeat) => &mut self.repeats,
            Receipt::Rejected(PenRejection::TimeBackwards) => &mut self.time_backwards,
            Receipt::Rejected(PenRejection::Outlier) => &mut self.outliers,
        };
        *counter += 1;
    }
}

/// State of the pen: newest accepted reading, newest closed grid point, steps not yet pulled.
#[derive(Debug, Clone, Copy)]
pub struct PenTracker {
    settings: PenSettings,
    newest: Option<PenReading>,
    suspect: Option<PenReading>,
    /// Position of the newest closed grid point since the last restart, and the pen's touch there.
    closed: Option<([f64; 2], Touch)>,
    /// Position half a step after that, once the pen has passed there.
    middle: Option<[f64; 2]>,
    /// A jump happened since the newest closed grid point.
    jumped: bool,
    queue: StepQueue,
    counters: PenCounters,
    refused: Option<PenRefusal>,
}

state! {
    [] PenTracker { newest, suspect, closed, middle, jumped, queue, counters, refused } fixed { settings }
}

impl PenTracker {
    /// A tracker without readings.
    ///
    /// # Errors
    ///
    /// See [`PenSettings::validate`].
    pub fn new(settings: PenSettings) -> Result<Self, PenError> {
        settings.validate()?;
        Ok(Self {
            settings,
            newest: None,
            suspect: None,
            closed: None,
            middle: None,
            jumped: false,
            queue: StepQueue::new(),
            counters: PenCounters::default(),
            refused: None,
        })
    }

    /// Judges one reading at time `now` and closes the grid points it reaches (at most `max_gap/Δ + 1`).
    pub fn ingest(&mut self, now: Stamp, reading: &PenReading) -> Receipt {
        let receipt = self.judge(now, reading);
        self.counters.count(receipt);
        if let Receipt::Rejected(why) = receipt
            && let Some(refusal) = self.evidence(now, reading, why)
        {
            self.refused = Some(refusal);
        }
        receipt
    }

    /// The newest refusal that its sender can remedy; glitches and repeated samples are not stored.
    #[must_use]
    pub fn refused(&self) -> Option<PenRefusal> {
        self.refused
    }

    fn evidence(&self, now: Stamp, reading: &PenReading, why: PenRejection) -> Option<PenRefusal> {
        let seconds = |ns: u64| ns as f64 * 1e-9;
        let limits = self.settings.position_min_m.iter().zip(&self.settings.position_max_m);
        let mut coordinates = (0_u8..).zip(reading.position.iter().zip(limits));
        let (axis, value, bound) = match why {
            PenRejection::Repeat | PenRejection::Outlier => return None,
            PenRejection::NonFinite => {
                let (axis, (value, _)) = coordinates.find(|(_, (value, _))| !value.is_finite())?;
                (Some(axis), *value, f64::NAN)
            }
            PenRejection::OutOfRange => {
                let outside = |value: &f64, (min, max): (&f64, &f64)| !(min <= value && value <= max);
                let (axis, (value, (min, max))) =
                    coordinates.find(|(_, (value, limits))| outside(value, *limits))?;
                (Some(axis), *value, if value < min { *min } else { *max })
            }
            PenRejection::FromFuture => {
                let ahead = seconds(reading.stamp.0.saturating_sub(now.0));
                (None, ahead, seconds(self.settings.max_future_ns))
            }
            PenRejection::TimeBackwards => {
                let newest = self.newest.map_or(reading.stamp, |newest| newest.stamp);
                (None, seconds(newest.0.saturating_sub(reading.stamp.0)), 0.0)
            }
        };
        Some(PenRefusal { why, axis, value, bound, at: now })
    }

    /// The oldest closed step that was not pulled yet.
    pub fn next_step(&mut self) -> Option<GridStep> {
        self.queue.pop()
    }

    /// Closed steps that wait to be pulled.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.queue.len()
    }

    /// The newest accepted reading.
    #[must_use]
    pub fn newest(&self) -> Option<PenReading> {
        self.newest
    }

    /// Age of the newest accepted reading \[ns\], 0 if it is stamped after `now`; `None` before the first
    /// one.
    #[must_use]
    pub fn age_ns(&self, now: Stamp) -> Option<u64> {
        self.newest.map(|newest| now.0.saturating_sub(newest.stamp.0))
    }

    /// What happened to all readings so far.
    #[must_use]
    pub fn counters(&self) -> PenCounters {
        self.counters
    }

    /// The settings in force.
    #[must_use]
    pub fn settings(&self) -> &PenSettings {
        &self.settings
    }

    fn judge(&mut self, now: Stamp, reading: &PenReading) -> Receipt {
        use PenRejection::{FromFuture, NonFinite, OutOfRange, Outlier, Repeat, TimeBackwards};
        if !reading.position.iter().all(|p| p.is_finite()) {
            return Receipt::Rejected(NonFinite);
        }
        let limits = self.settings.position_min_m.iter().zip(&self.settings.position_max_m);
        if !reading.position.iter().zip(limits).all(|(p, (min, max))| min <= p && p <= max) {
            return Receipt::Rejected(OutOfRange);
        }
        if reading.stamp.0.saturating_sub(now.0) > self.settings.max_future_ns {
            return Receipt::Rejected(FromFuture);
        }
        let Some(newest) = self.newest else {
            self.restart(reading);
            return Receipt::Accepted;
        };
        let ahead_of = self.suspect.map_or(newest.stamp, |suspect| suspect.stamp.max(newest.stamp));
        if reading.stamp == ahead_of || reading.stamp == newest.stamp {
            return Receipt::Rejected(Repeat);
        }
        if reading.stamp < ahead_of {
            return Receipt::Rejected(TimeBackwards);
        }
        if reading.stamp.0 - newest.stamp.0 > self.settings.max_gap_ns {
            self.restart(reading);
            return Receipt::Accepted;
        }
        let speed = speed_mps(&newest, reading, &self.settings);
        let suspected = self.suspect.map_or(f64::INFINITY, |it| speed_mps(&it, reading, &self.settings));
        let fastest = self.settings.max_speed_mps;
        if speed.min(suspected) > fastest {
            self.suspect = Some(*reading);
            return Receipt::Rejected(Outlier);
        }
        // With every refused reading the apparent speed from the last position falls, until it may pass for
        // motion. A suspect that is fast by its stamp alone lies on the way, and half of the speed remains.
        let jumped = speed > fastest || 2.0 * suspected < speed;
        let motion = if jumped { Motion::Jump } else { Motion::Continues };
        self.counters.jumps += u64::from(jumped);
        self.close_until(&newest, reading, motion);
        Receipt::Accepted
    }

    fn restart(&mut self, reading: &PenReading) {
        self.counters.restarts += 1;
        (self.closed, self.middle) = (None, None);
        self.jumped = false;
        self.suspect = None;
        self.newest = Some(*reading);
        if reading.stamp.0.is_multiple_of(self.settings.step_ns) {
            let index = reading.stamp.0 / self.settings.step_ns;
            self.close(index, reading.position, reading.contact, ([0.0; 2], 0));
        }
    }

    fn close_until(&mut self, from: &PenReading, to: &PenReading, motion: Motion) {
        let step_ns = self.settings.step_ns;
        let (first, last) = (from.stamp.0 / step_ns + 1, to.stamp.0 / step_ns);
        let span_ns = (to.stamp.0 - from.stamp.0) as f64;
        let position_at = |stamp_ns: u64| match motion {
            // The path of a jumping pen is unknown: it stays until the sample that shows it elsewhere.
            Motion::Jump if stamp_ns < to.stamp.0 => from.position,
            Motion::Jump => to.position,
            _ => {
                let into_ns = stamp_ns.saturating_sub(from.stamp.0);
                interpolate(from.position, to.position, into_ns as f64 / span_ns)
            }
        };
        for index in first..=last.saturating_add(1) {
            let middle_ns = index.saturating_mul(step_ns).saturating_sub(step_ns / 2);
            if from.stamp.0 < middle_ns && middle_ns <= to.stamp.0 {
                self.middle = Some(position_at(middle_ns));
            }
            if index > last {
                break;
            }
            self.jumped |= motion == Motion::Jump;
            // index <= to.stamp / step_ns, so the product cannot overflow.
            let position = position_at(index * step_ns);
            let contact = if index * step_ns == to.stamp.0 { to.contact } else { from.contact && to.contact };
            let ahead = if index == last && motion == Motion::Continues {
                (difference(to.position, position), to.stamp.0 - index * step_ns)
            } else {
                ([0.0; 2], 0)
            };
            self.close(index, position, contact, ahead);
        }
        // The part of the jump after the last closed point belongs to the next one.
        self.jumped |= motion == Motion::Jump && !to.stamp.0.is_multiple_of(step_ns);
        self.suspect = None;
        self.newest = Some(*to);
    }

    fn close(&mut self, index: u64, position: [f64; 2], contact: bool, (ahead, ahead_ns): ([f64; 2], u64)) {
        let (motion, displacement) = match self.closed {
            None => (Motion::Start, [0.0; 2]),
            Some((before, _)) if self.jumped => (Motion::Jump, difference(position, before)),
            Some((before, _)) => (Motion::Continues, difference(position, before)),
        };
        let half = match (motion, self.closed, self.middle.take()) {
            (Motion::Start, ..) => [0.0; 2],
            (Motion::Continues, Some((before, _)), Some(middle)) => difference(middle, before),
            _ => displacement.map(|x| 0.5 * x),
        };
        let contact_steps = match self.closed {
            Some((_, touch)) if motion == Motion::Continues && touch.contact == contact => {
                touch.steps.saturating_add(1)
            }
            _ => 0,
        };
        self.closed = Some((position, Touch { contact, steps: contact_steps }));
        self.jumped = false;
        let step =
            GridStep { index, position, displacement, half, ahead, ahead_ns, motion, contact, contact_steps };
        self.counters.overwritten += self.queue.push(step);
    }
}

/// Speed of a pen that is at `to` after `from` \[m/s\]: what the jump gate judges.
fn speed_mps(from: &PenReading, to: &PenReading, settings: &PenSettings) -> f64 {
    let elapsed_ns = to.stamp.0.saturating_sub(from.stamp.0).max(settings.min_interval_ns);
    let [x, y] = difference(to.position, from.position);
    x.hypot(y) / (elapsed_ns as f64 * 1e-9)
}

fn difference(to: [f64; 2], from: [f64; 2]) -> [f64; 2] {
    let ([to_x, to_y], [from_x, from_y]) = (to, from);
    [to_x - from_x, to_y - from_y]
}

fn interpolate(from: [f64; 2], to: [f64; 2], fraction: f64) -> [f64; 2] {
    let ([from_x, from_y], [dx, dy]) = (from, difference(to, from));
    [from_x + fraction * dx, from_y + fraction * dy]
}
