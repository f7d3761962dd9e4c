//! Time from the stamps of a recording: which are of use, what rate they give, and strokes on an even grid.
//!
//! Contract: a recording whose steps agree within [`SAME_STEP_S`] has an even rate and keeps its points as
//! they are. Any other keeps its stamps; who needs even steps gets them from the pen grid of the loop.

#[cfg(feature = "formats")]
use super::{Character, Component};
use super::{GAP_PERIODS, Remark};
use foretrace_control::pen::{PenReading, PenSettings, PenTracker, STEP_QUEUE_CAPACITY};
use foretrace_control::units::Stamp;

/// Steps in time that differ by less are equal \[s\].
pub(crate) const SAME_STEP_S: f64 = 10e-6;
/// Parts by which a stated rate may differ from that of even and of uneven stamps.
const STATED_EVEN: f64 = 0.01;
const STATED_UNEVEN: f64 = 0.1;
/// Steps of the pen grid \[ns\].
const GRID_NS: std::ops::RangeInclusive<u64> = 1_000_000..=1_000_000_000;
/// Shorter steps of an uneven recording are no gaps \[s\], unless they are longer than the grid bridges.
const UNEVEN_GAP_S: f64 = 0.05;
const GRID_GAP_STEPS: f64 = (STEP_QUEUE_CAPACITY / 2 - 1) as f64;
/// Rounding of stamps that count from 1970 \[s\].
const ROUNDING_S: f64 = 1e-6;

/// Takes stamped samples in order: drops what steps back and merges what has one stamp.
#[derive(Debug, Default)]
pub(crate) struct StampJudge {
    newest_s: Option<f64>,
    /// Samples at the newest stamp.
    together: u32,
    merged: u64,
    /// Of these, those at another place.
    moved: u64,
    backwards: u64,
    ahead: u64,
    taken: u64,
}

/// What becomes of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum StampVerdict {
    Next,
    /// It has the stamp of the one before: the mean of both goes on, to which it adds this share.
    Merge(f64),
    Backwards,
}

impl StampJudge {
    pub(crate) fn judge(&mut self, t_s: f64) -> StampVerdict {
        match self.newest_s {
            Some(newest_s) if t_s == newest_s => {
                self.merged += 1;
                self.together += 1;
                StampVerdict::Merge(1.0 / f64::from(self.together))
            }
            Some(newest_s) if t_s < newest_s => {
                self.backwards += 1;
                StampVerdict::Backwards
            }
            _ => {
                self.newest_s = Some(t_s);
                (self.together, self.taken) = (1, self.taken + 1);
                StampVerdict::Next
            }
        }
    }

    /// The next stroke may have a clock of its own.
    #[cfg(feature = "formats")]
    fn restart(&mut self) {
        self.newest_s = None;
    }

    /// The point that goes on when `next` is merged with `point` by [`StampVerdict::Merge`].
    pub(super) fn merge(&mut self, point: [f64; 2], next: [f64; 2], share: f64) -> [f64; 2] {
        self.moved += u64::from(point != next);
        merged(point, next, share)
    }

    /// Counts samples that [`leaps_ahead`] found, which are not judged.
    pub(super) fn leave_out_ahead(&mut self, count: usize) {
        self.ahead += count as u64;
    }

    /// Most places of the pen have no stamp of their own: the clock is coarser than the samples. Rows that
    /// only repeat a sample say nothing of it.
    pub(super) fn coarse(&self) -> Option<String> {
        (self.moved > self.taken).then(|| {
            format!(
                "{} of {} samples have the stamp of the one before: the clock is coarser than the samples; write \
                 stamps that tell them apart",
                self.moved,
                self.merged + self.backwards + self.ahead + self.taken
            )
        })
    }

    /// # Errors
    /// More samples are out of order than there are others: that is no clock.
    pub(crate) fn remarks(&self) -> Result<Vec<Remark>, String> {
        let astray = self.backwards + self.ahead;
        if astray > self.taken {
            return Err(format!(
                "{astray} of {} stamps step back; write the samples in order of time, on one clock",
                astray + self.taken + self.merged
            ));
        }
        let counted = [
            (self.merged, "samples have the stamp of the one before, and are merged"),
            (self.backwards, "samples step back in time, and are left out"),
            (self.ahead, "samples are far ahead in time of those that follow, and are left out"),
        ];
        Ok(counted.into_iter().filter_map(|(count, what)| Remark::counted(count, what)).collect())
    }
}

/// Samples whose stamps leap ahead of those that follow, which agree with those before: without them, far
/// fewer step back. In order; none where stamps rise.
pub(super) fn leaps_ahead(times: &[f64]) -> Vec<usize> {
    let mut newest = f64::NEG_INFINITY;
    let mut back = 0;
    for t in times {
        back += usize::from(*t < newest);
        newest = newest.max(*t);
    }
    if back == 0 {
        return Vec::new();
    }
    // The most samples whose times do not fall. From the end on: of two that do as well, the earlier stays.
    let mut heads: Vec<(f64, usize)> = Vec::new();
    let mut next: Vec<usize> = vec![usize::MAX; times.len()];
    for (index, t) in times.iter().enumerate().rev() {
        let behind = heads.partition_point(|(head, _)| head >= t);
        if let (Some(slot), Some((_, head))) =
            (next.get_mut(index), behind.checked_sub(1).and_then(|at| heads.get(at)))
        {
            *slot = *head;
        }
        match heads.get_mut(behind) {
            Some(head) => *head = (*t, index),
            None => heads.push((*t, index)),
        }
    }
    // Two recordings, one behind the other, are not mixed for a few samples more.
    if (times.len() - heads.len()) * 2 > back {
        return Vec::new();
    }
    let mut kept = heads.last().map_or(usize::MAX, |(_, index)| *index);
    let mut ahead = Vec::new();
    for (index, t) in times.iter().enumerate() {
        if index == kept {
            kept = next.get(index).copied().unwrap_or(usize::MAX);
        } else if times.get(kept).is_some_and(|following| t > following) {
            ahead.push(index);
        }
    }
    ahead
}

/// The point that goes on when `next` is merged with `point`.
pub(crate) fn merged(point: [f64; 2], next: [f64; 2], share: f64) -> [f64; 2] {
    [0, 1].map(|axis| point[axis] + share * (next[axis] - point[axis]))
}

/// The rhythm of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cadence {
    pub(crate) rate_hz: f64,
    /// Its steps are one over the rate.
    pub(crate) even: bool,
    /// Longer steps are gaps \[s\].
    pub(crate) gap_s: f64,
}

impl Cadence {
    /// From steps between samples, gaps among them \[s\], and the rate that the file states. `None` without a
    /// positive step.
    ///
    /// Even: the stated rate where it fits, else one over the median step. Uneven: the stated rate where it
    /// fits, else one over the mean step, where most are alike over the mean of those: a sample that is
    /// missing now and then does not slow a device down.
    pub(crate) fn of(mut steps: Vec<f64>, stated_hz: Option<f64>) -> Option<Self> {
        steps.retain(|step| *step > 0.0);
        steps.sort_by(f64::total_cmp);
        let median = *steps.get(steps.len() / 2)?;
        let seen = steps.partition_point(|step| *step <= GAP_PERIODS * median);
        let seen = steps.get(..seen).unwrap_or_default();
        let even = seen.iter().all(|step| (step - median).abs() <= SAME_STEP_S + ROUNDING_S);
        let fits = |typical: f64, part: f64| stated_hz.filter(|hz| (hz * typical - 1.0).abs() <= part);
        if even {
            let rate_hz = fits(median, STATED_EVEN).unwrap_or(1.0 / median);
            return Some(Self { rate_hz, even, gap_s: GAP_PERIODS / rate_hz });
        }
        let seen = steps.partition_point(|step| *step <= UNEVEN_GAP_S.max(GAP_PERIODS * median));
        let seen = steps.get(..seen).unwrap_or_default();
        let alike: Vec<f64> =
            seen.iter().copied().filter(|step| (step - median).abs() <= 0.25 * median).collect();
        let most = if alike.len() * 5 >= seen.len() * 4 { &alike } else { seen };
        let typical = most.iter().sum::<f64>() / most.len() as f64;
        let period_ns = fits(typical, STATED_UNEVEN).map_or(typical * 1e9, |hz| 1e9 / hz).round() as u64;
        let period_ns = period_ns.clamp(*GRID_NS.start(), *GRID_NS.end());
        let period_s = period_ns as f64 * 1e-9;
        let gap_s = (GAP_PERIODS * period_s).max(UNEVEN_GAP_S).min(GRID_GAP_STEPS * period_s);
        Some(Self { rate_hz: 1e9 / period_ns as f64, even, gap_s })
    }

    /// That a file states another rate than its stamps give.
    #[cfg(feature = "formats")]
    pub(crate) fn apart_from(&self, stated_hz: f64) -> Option<Remark> {
        ((stated_hz / self.rate_hz - 1.0).abs() > STATED_UNEVEN).then(|| {
            let stamped_hz = self.rate_hz;
            Remark::new(format!(
                "the file states {stated_hz} Hz, its stamps give {stamped_hz:.1} Hz and count"
            ))
        })
    }
}

/// Turns the stamps of components as a file has them into what [`Component`] promises: in order, without
/// gaps, and none where the rate is even. `None`: no stroke has two stamps.
///
/// Stamps that are no clock of the points, as those of the strokes' beginnings, or in whole seconds, are
/// dropped where the file states a rate, and the points stay.
///
/// # Errors
/// Without a stated rate: stamps that are no clock, or coarser than the points. Stamps too far apart for
/// strokes.
#[cfg(feature = "formats")]
pub(crate) fn settle(
    segments: &mut [Character],
    stated_hz: Option<f64>,
) -> Result<Option<(Cadence, Vec<Remark>)>, String> {
    let mut judge = StampJudge::default();
    let components = || segments.iter().flat_map(|c| &c.components);
    let mended: Vec<Option<StampedStroke>> = components().map(|c| in_order(c, &mut judge)).collect();
    let steps = components().zip(&mended).flat_map(|(component, mended)| {
        let stamps_s = mended.as_ref().map_or(&component.stamps_s, |(_, stamps_s)| stamps_s);
        stamps_s.windows(2).map(|w| w[1] - w[0])
    });
    let cadence = Cadence::of(steps.collect(), stated_hz);
    let (remarks, coarse) = (judge.remarks(), judge.coarse());
    let lost = judge.merged + judge.backwards > 0;
    let settled = match (cadence, remarks, coarse) {
        (Some(cadence), Ok(remarks), None) => Some((cadence, remarks)),
        (None, ..) if !lost => None,
        (cadence, remarks, coarse) => match stated_hz {
            Some(rate_hz) => {
                let why = "the times of the points do not rise, or far more seldom than there are points: the rate \
                           that the file states counts instead";
                let even = Cadence { rate_hz, even: true, gap_s: GAP_PERIODS / rate_hz };
                segments.iter_mut().flat_map(|c| &mut c.components).for_each(|c| c.stamps_s.clear());
                return Ok(Some((even, vec![Remark::new(why)])));
            }
            None => match coarse.filter(|_| cadence.is_some()) {
                Some(coarse) => return Err(coarse),
                None => remarks.map(|_| None)?,
            },
        },
    };
    let Some((cadence, mut remarks)) = settled else {
        segments.iter_mut().flat_map(|c| &mut c.components).for_each(|c| c.stamps_s.clear());
        return Ok(None);
    };
    for (component, mended) in segments.iter_mut().flat_map(|c| &mut c.components).zip(mended) {
        if let Some(mended) = mended {
            (component.points, component.stamps_s) = mended;
        }
    }
    if !(1e-3..=1e6).contains(&cadence.rate_hz) {
        return Err(format!(
            "the stamps give a rate of {} Hz; legal: 0.001 to 1000000; is their unit right?",
            cadence.rate_hz
        ));
    }
    remarks.extend(stated_hz.and_then(|stated_hz| cadence.apart_from(stated_hz)));
    for character in segments {
        let whole = std::mem::take(&mut character.components);
        character.components = without_gaps(whole, cadence);
        if cadence.even {
            character.components.iter_mut().for_each(|c| c.stamps_s.clear());
        }
    }
    Ok(Some((cadence, remarks)))
}

/// The points and stamps that are left of a stroke.
#[cfg(feature = "formats")]
type StampedStroke = (Vec<[f64; 2]>, Vec<f64>);

/// The stroke with its stamps in order; `None`: as it stands.
#[cfg(feature = "formats")]
fn in_order(component: &Component, judge: &mut StampJudge) -> Option<StampedStroke> {
    judge.restart();
    let ahead = leaps_ahead(&component.stamps_s);
    judge.leave_out_ahead(ahead.len());
    let (mut points, mut stamps_s) = (Vec::new(), Vec::new());
    for (index, (point, t_s)) in component.points.iter().zip(&component.stamps_s).enumerate() {
        if ahead.binary_search(&index).is_ok() {
            continue;
        }
        match (judge.judge(*t_s), points.last_mut()) {
            (StampVerdict::Merge(share), Some(last)) => *last = judge.merge(*last, *point, share),
            (StampVerdict::Backwards, _) => {}
            _ => {
                points.push(*point);
                stamps_s.push(*t_s);
            }
        }
    }
    (stamps_s.len() < component.stamps_s.len()).then_some((points, stamps_s))
}

/// Components that are parted at their gaps, with the time before each where it is more than a step.
#[cfg(feature = "formats")]
fn without_gaps(components: Vec<Component>, cadence: Cadence) -> Vec<Component> {
    let mut parted: Vec<Component> = Vec::new();
    let mut last_s: Option<f64> = None;
    for component in components {
        if component.stamps_s.is_empty() {
            last_s = None;
            parted.push(component);
            continue;
        }
        let Component { contact, points, stamps_s, dt_before_s, continues } = component;
        for (index, (point, now_s)) in points.into_iter().zip(stamps_s).enumerate() {
            let elapsed_s = last_s.map(|last| now_s - last);
            let longest_s = if index == 0 { 1.5 / cadence.rate_hz } else { cadence.gap_s };
            let gap_s = elapsed_s.filter(|elapsed| *elapsed > longest_s);
            last_s = Some(now_s);
            match parted.last_mut() {
                Some(open) if index > 0 && gap_s.is_none() => {
                    open.points.push(point);
                    open.stamps_s.push(now_s);
                }
                _ => parted.push(Component {
                    contact,
                    points: vec![point],
                    stamps_s: vec![now_s],
                    dt_before_s: if index == 0 { dt_before_s.or(gap_s) } else { gap_s },
                    continues: if index == 0 { continues } else { true },
                }),
            }
        }
    }
    parted
}

/// Points of one stroke, stamped `stamps_s`, on a grid of one over `rate_hz` from its first point on.
///
/// # Panics
/// Never: settings are made legal.
pub(super) fn on_grid(points: &[[f64; 2]], stamps_s: &[f64], rate_hz: f64) -> Vec<[f64; 2]> {
    let step_ns = ((1e9 / rate_hz).round() as u64).clamp(*GRID_NS.start(), *GRID_NS.end());
    // Device units have no bounds and no speed that a hand could not reach: nothing here is a jump.
    let settings = PenSettings {
        step_ns,
        max_gap_ns: STEP_QUEUE_CAPACITY as u64 / 2 * step_ns,
        max_speed_mps: f64::MAX,
        min_interval_ns: 1,
        position_min_m: [-f64::MAX; 2],
        position_max_m: [f64::MAX; 2],
        ..PenSettings::default()
    };
    let Ok(mut grid) = PenTracker::new(settings) else { return points.to_vec() };
    let first_s = stamps_s.first().copied().unwrap_or_default();
    let mut even = Vec::new();
    for (point, t_s) in points.iter().zip(stamps_s) {
        let stamp = Stamp(((t_s - first_s) * 1e9).round() as u64);
        grid.ingest(stamp, &PenReading::new(stamp, *point, true));
        even.extend(std::iter::from_fn(|| grid.next_step()).map(|step| step.position));
    }
    even
}

#[cfg(test)]
mod tests;
