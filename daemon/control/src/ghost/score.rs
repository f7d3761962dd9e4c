//! Distance and lag of two tools behind the pen, recent and over a whole session.
//!
//! Contract: both tools are judged at the same instants against the same pen. Lag is the shift s with the
//! least mean of |tool(t) − pen(t − s)|², on a grid of 5 ms from −50 to 400 ms, refined by a parabola through
//! the minimum and its neighbours, as in the lab. Keeps sums only; nothing allocates.

use super::track::Track;
use crate::units::Stamp;

/// Smallest shift tried \[ms\].
const FIRST_MS: i64 = -50;
/// Distance of two shifts \[ms\].
const STRIDE_MS: i64 = 5;
/// Shifts tried: up to 400 ms, for a pen that is 300 ms old.
const SHIFTS: usize = 91;
/// Fewest samples for a lag.
const FEWEST: f64 = 50.0;

/// How much later than an instant the pen must be known for every shift \[ns\].
pub const PEN_AHEAD_NS: u64 = FIRST_MS.unsigned_abs() * 1_000_000;

/// How one tool does.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tracking {
    /// Root mean square of the distance to the pen while it writes, recent \[m\].
    pub recent_rms: Option<f64>,
    /// The same over the whole session \[m\].
    pub session_rms: Option<f64>,
    /// The same over the whole session, hovering included \[m\].
    pub hover_rms: Option<f64>,
    /// Lag of the tool, recent \[s\].
    pub recent_lag: Option<f64>,
    /// Lag of the tool over the whole session \[s\].
    pub session_lag: Option<f64>,
}

/// A weighted mean that may forget, and its total weight.
#[derive(Debug, Clone, Copy, Default)]
struct FadingMean {
    sum: f64,
    weight: f64,
}

impl FadingMean {
    fn fade(&mut self, keep: f64) {
        self.sum *= keep;
        self.weight *= keep;
    }

    fn add(&mut self, value: f64) {
        self.sum += value;
        self.weight += 1.0;
    }

    fn root(&self) -> Option<f64> {
        (self.weight > 0.0).then(|| (self.sum / self.weight).sqrt())
    }
}

/// Mean squared distance for each shift.
#[derive(Debug, Clone, Copy)]
struct Shifts([FadingMean; SHIFTS]);

impl Shifts {
    const EMPTY: Self = Self([FadingMean { sum: 0.0, weight: 0.0 }; SHIFTS]);

    /// The shift with the least mean \[s\].
    fn lag(&self) -> Option<f64> {
        let most = self.0.iter().map(|mean| mean.weight).fold(0.0, f64::max);
        // Shifts with few samples were only tried in gaps of the pen.
        let mean = |index: usize| {
            let FadingMean { sum, weight } = *self.0.get(index)?;
            (weight >= FEWEST && weight >= 0.5 * most).then(|| sum / weight)
        };
        let (best, least) = (0..SHIFTS)
            .filter_map(|index| Some((index, mean(index)?)))
            .min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        let before = best.checked_sub(1).and_then(mean);
        let offset = match (before, mean(best + 1)) {
            (Some(before), Some(after)) => vertex(before, least, after),
            _ => 0.0,
        };
        Some((FIRST_MS as f64 + STRIDE_MS as f64 * (best as f64 + offset)) * 1e-3)
    }
}

/// Offset in (−1, 1) of the lowest point of the parabola through three neighbours, the middle one lowest.
fn vertex(before: f64, middle: f64, after: f64) -> f64 {
    let curvature = before - 2.0 * middle + after;
    let offset = 0.5 * (before - after) / curvature;
    if curvature > 0.0 && offset.is_finite() { offset } else { 0.0 }
}

/// The sums of one tool.
#[derive(Debug, Clone, Copy)]
struct ToolSums {
    recent: FadingMean,
    session: FadingMean,
    hover: FadingMean,
    recent_shifts: Shifts,
    session_shifts: Shifts,
}

impl ToolSums {
    const EMPTY: Self = Self {
        recent: FadingMean { sum: 0.0, weight: 0.0 },
        session: FadingMean { sum: 0.0, weight: 0.0 },
        hover: FadingMean { sum: 0.0, weight: 0.0 },
        recent_shifts: Shifts::EMPTY,
        session_shifts: Shifts::EMPTY,
    };

    fn add(&mut self, square: f64, contact: bool, keep: f64) {
        self.hover.add(square);
        if contact {
            self.recent.fade(keep);
            self.recent.add(square);
            self.session.add(square);
        }
    }

    fn tracking(&self) -> Tracking {
        Tracking {
            recent_rms: self.recent.root(),
            session_rms: self.session.root(),
            hover_rms: self.hover.root(),
            recent_lag: self.recent_shifts.lag(),
            session_lag: self.session_shifts.lag(),
        }
    }
}

/// The score of both tools.
#[derive(Debug, Clone)]
pub struct Score {
    sums: [ToolSums; 2],
    memory_ns: f64,
    judged: Option<Stamp>,
    /// Newest sample used for the lag.
    shifted: Option<Stamp>,
    seconds: f64,
}

/// Samples for the lag are at least this far apart \[ns\]: closer ones carry no new information.
const SHIFT_EVERY_NS: i64 = 5_000_000;
/// A pause in writing does not age the figures; samples further apart than this count as this far apart
/// \[ns\].
const LONGEST_STEP_NS: i64 = 20_000_000;

impl Score {
    /// Nothing judged yet; recent figures forget within about `memory_ns` of judged time.
    #[must_use]
    pub fn new(memory_ns: u64) -> Self {
        Self {
            sums: [ToolSums::EMPTY; 2],
            memory_ns: memory_ns as f64,
            judged: None,
            shifted: None,
            seconds: 0.0,
        }
    }

    /// Judges both tools at their positions at `instant` \[m\]; returns their distances to the pen \[m\] and
    /// whether it wrote.
    ///
    /// `pen` must reach [`PEN_AHEAD_NS`] beyond `instant` for all shifts to count. `None` where the pen is
    /// unknown.
    pub fn judge(&mut self, instant: Stamp, tools: [[f64; 2]; 2], pen: &Track) -> Option<([f64; 2], bool)> {
        self.shift(instant, tools, pen);
        let at = pen.at(instant)?;
        let step_ns = step(self.judged.replace(instant), instant);
        let squares = tools.map(|tool| square(tool, at.position));
        for (sums, square) in self.sums.iter_mut().zip(squares) {
            sums.add(square, at.contact, (-step_ns / self.memory_ns).exp());
        }
        if at.contact {
            self.seconds += step_ns * 1e-9;
        }
        Some((squares.map(f64::sqrt), at.contact))
    }

    fn shift(&mut self, instant: Stamp, tools: [[f64; 2]; 2], pen: &Track) {
        if self.shifted.is_some_and(|last| instant.since(last) < SHIFT_EVERY_NS) {
            return;
        }
        let keep = (-step(self.shifted.replace(instant), instant) / self.memory_ns).exp();
        for sums in &mut self.sums {
            sums.recent_shifts.0.iter_mut().for_each(|mean| mean.fade(keep));
        }
        let mut shift_ns = FIRST_MS * 1_000_000;
        for index in 0..SHIFTS {
            let then = Stamp(instant.0.saturating_add_signed(-shift_ns));
            shift_ns += STRIDE_MS * 1_000_000;
            let Some(at) = pen.at(then).filter(|at| at.contact) else { continue };
            for (sums, tool) in self.sums.iter_mut().zip(tools) {
                let square = square(tool, at.position);
                let both = [sums.recent_shifts.0.get_mut(index), sums.session_shifts.0.get_mut(index)];
                both.into_iter().flatten().for_each(|mean| mean.add(square));
            }
        }
    }

    /// The figures of both tools.
    #[must_use]
    pub fn tracking(&self) -> [Tracking; 2] {
        self.sums.each_ref().map(ToolSums::tracking)
    }

    /// How long the pen wrote while both were judged \[s\].
    #[must_use]
    pub const fn seconds(&self) -> f64 {
        self.seconds
    }
}

/// Time that a sample stands for \[ns\].
fn step(last: Option<Stamp>, instant: Stamp) -> f64 {
    last.map_or(0, |last| instant.since(last).clamp(0, LONGEST_STEP_NS)) as f64
}

fn square([x, y]: [f64; 2], [px, py]: [f64; 2]) -> f64 {
    (x - px) * (x - px) + (y - py) * (y - py)
}

#[cfg(test)]
mod tests {
    use super::super::track::Point;
    use super::*;

    const MS: u64 = 1_000_000;

    fn writing(t_s: f64) -> [f64; 2] {
        [0.02 * (9.0 * t_s).sin(), 0.015 * (14.0 * t_s + 0.3).sin()]
    }

    /// Judges tools that are late by these times \[ms\] for `seconds`, every 2 ms, against a pen of 200 Hz.
    fn score(late_ms: [f64; 2], seconds: u64, contact: impl Fn(u64) -> bool) -> Score {
        let mut pen = Track::new(512, 50 * MS as i64);
        let mut score = Score::new(3_000 * MS);
        for ms in (0..seconds * 1000).step_by(5) {
            let stamp = Stamp((1000 + ms) * MS);
            pen.push(Point { stamp, position: writing(ms as f64 * 1e-3), contact: contact(ms) });
            if ms >= 400 {
                for then in [ms - 105, ms - 102] {
                    let tools = late_ms.map(|late| writing((then as f64 - late) * 1e-3));
                    score.judge(Stamp((1000 + then) * MS), tools, &pen);
                }
            }
        }
        score
    }

    #[test]
    fn lag_is_found_within_a_millisecond_whichever_its_sign() {
        for late in [-32.0, -1.3, 0.0, 12.5, 61.0, 148.0, 307.0] {
            let [one, other] = score([late, 40.0], 6, |_| true).tracking();
            for (lag, truth) in [(one.recent_lag, late), (one.session_lag, late), (other.session_lag, 40.0)] {
                let lag_ms = lag.unwrap() * 1e3;
                assert!((lag_ms - truth).abs() < 1.0, "{lag_ms} instead of {truth}");
            }
        }
    }

    #[test]
    fn a_lag_beyond_the_range_stays_at_its_border() {
        let [early, late] = score([-90.0, 430.0], 4, |_| true).tracking();
        assert_eq!((early.session_lag, late.session_lag), (Some(-0.05), Some(0.4)));
    }

    #[test]
    fn error_is_the_root_mean_square_by_hand() {
        // A pen at constant speed, two tools 3 and 4 mm beside it in one axis, 0 and 3 mm in the other.
        let mut pen = Track::new(64, 50 * MS as i64);
        for k in 0..40_u32 {
            let stamp = Stamp(u64::from(k) * 10 * MS);
            pen.push(Point { stamp, position: [0.001 * f64::from(k), 0.0], contact: k < 30 });
        }
        let mut score = Score::new(3_000 * MS);
        for ms in [100_u32, 200, 320] {
            let x = 1e-4 * f64::from(ms);
            let tools = [[x + 0.003, 0.0], [x + 0.004, 0.003]];
            let (errors, contact) = score.judge(Stamp(u64::from(ms) * MS), tools, &pen).unwrap();
            assert!((errors[0] - 0.003).abs() < 1e-15 && (errors[1] - 0.005).abs() < 1e-15);
            assert_eq!(contact, ms < 290);
        }
        let [one, other] = score.tracking();
        assert!((one.session_rms.unwrap() - 0.003).abs() < 1e-15);
        assert!((other.recent_rms.unwrap() - 0.005).abs() < 1e-15);
        assert!((other.hover_rms.unwrap() - 0.005).abs() < 1e-15);
        assert_eq!(one.session_lag, None, "three instants are no evidence");
    }

    #[test]
    fn recent_forgets_and_session_does_not() {
        let mut pen = Track::new(512, 50 * MS as i64);
        let mut score = Score::new(1_000 * MS);
        for k in 0..2000_u64 {
            let stamp = Stamp(k * 10 * MS);
            pen.push(Point { stamp, position: [0.0; 2], contact: true });
            let error = if k < 1000 { 0.01 } else { 0.001 };
            score.judge(stamp, [[error, 0.0]; 2], &pen);
        }
        let [one, _] = score.tracking();
        assert!((one.recent_rms.unwrap() - 0.001).abs() < 1e-5);
        assert!((one.session_rms.unwrap() - (0.5 * (1e-4_f64 + 1e-6)).sqrt()).abs() < 1e-9);
        assert!((score.seconds() - 19.99).abs() < 1e-9);
    }

    #[test]
    fn hovering_counts_apart_and_an_unknown_pen_not_at_all() {
        let written = score([20.0, 30.0], 4, |ms| ms % 1000 < 600);
        let [one, _] = written.tracking();
        assert!(one.hover_rms.is_some() && (one.session_lag.unwrap() - 0.02).abs() < 1e-3);
        assert!((1.9..2.4).contains(&written.seconds()), "{}", written.seconds());
        let hovered = score([20.0, 30.0], 4, |_| false);
        assert_eq!(hovered.tracking()[0].recent_rms, None);
        assert_eq!(hovered.tracking()[0].session_lag, None);
        let mut unknown = Score::new(MS);
        assert_eq!(unknown.judge(Stamp(5), [[0.0; 2]; 2], &Track::new(4, 1)), None);
        assert_eq!(unknown.tracking(), [Tracking::default(); 2]);
    }
}
