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
/// So many short gaps, and such a share of all steps, are the rhythm of the device.
const BURSTS_LEAST: f64 = 3.0;
const BURSTS_SHARE: f64 = 0.1;
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
    backwards: u64,
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

    /// # Errors
    /// More samples step back than there are others: that is no clock.
    pub(crate) fn remarks(&self) -> Result<Vec<Remark>, String> {
        if self.backwards > self.taken {
            return Err(format!(
                "{} of {} stamps step back; write the samples in order of time, on one clock",
                self.backwards,
                self.backwards + self.taken + self.merged
            ));
        }
        let merged = Remark::counted(self.merged, "samples have the stamp of the one before, and are merged");
        let back = Remark::counted(self.backwards, "samples step back in time, and are left out");
        Ok(merged.into_iter().chain(back).collect())
    }
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
        // Events that come in bursts have no gap between two bursts.
        let short = steps.partition_point(|step| *step <= UNEVEN_GAP_S) as f64 - seen.len() as f64;
        let bursts = short >= BURSTS_LEAST && short >= BURSTS_SHARE * steps.len() as f64;
        let even = !bursts && seen.iter().all(|step| (step - median).abs() <= SAME_STEP_S + ROUNDING_S);
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
}

/// Turns the stamps of components as a file has them into what [`Component`] promises: in order, without
/// gaps, and none where the rate is even. `None`: no stroke has two stamps.
///
/// # Errors
/// Stamps that are no clock, or too far apart for strokes.
#[cfg(feature = "formats")]
pub(crate) fn settle(
    segments: &mut [Character],
    stated_hz: Option<f64>,
) -> Result<Option<(Cadence, Vec<Remark>)>, String> {
    let mut judge = StampJudge::default();
    for component in segments.iter_mut().flat_map(|c| &mut c.components) {
        judge.restart();
        in_order(component, &mut judge);
    }
    let mut remarks = judge.remarks()?;
    let stamped = segments.iter().flat_map(|c| &c.components).map(|c| &c.stamps_s);
    let steps = stamped.flat_map(|stamps| stamps.windows(2).map(|w| w[1] - w[0])).collect();
    let Some(cadence) = Cadence::of(steps, stated_hz) else {
        segments.iter_mut().flat_map(|c| &mut c.components).for_each(|c| c.stamps_s.clear());
        return Ok(None);
    };
    if !(1e-3..=1e6).contains(&cadence.rate_hz) {
        return Err(format!(
            "the stamps give a rate of {} Hz; legal: 0.001 to 1000000; is their unit right?",
            cadence.rate_hz
        ));
    }
    if let Some(stated_hz) = stated_hz.filter(|hz| (hz / cadence.rate_hz - 1.0).abs() > STATED_UNEVEN) {
        remarks.push(Remark::new(format!(
            "the file states {stated_hz} Hz, its stamps give {:.1} Hz and count",
            cadence.rate_hz
        )));
    }
    for character in segments {
        let whole = std::mem::take(&mut character.components);
        character.components = without_gaps(whole, cadence);
        if cadence.even {
            character.components.iter_mut().for_each(|c| c.stamps_s.clear());
        }
    }
    Ok(Some((cadence, remarks)))
}

#[cfg(feature = "formats")]
fn in_order(component: &mut Component, judge: &mut StampJudge) {
    let (mut points, mut stamps_s) = (Vec::new(), Vec::new());
    for (point, t_s) in component.points.iter().zip(&component.stamps_s) {
        match (judge.judge(*t_s), points.last_mut()) {
            (StampVerdict::Merge(share), Some(last)) => *last = merged(*last, *point, share),
            (StampVerdict::Backwards, _) => {}
            _ => {
                points.push(*point);
                stamps_s.push(*t_s);
            }
        }
    }
    if !stamps_s.is_empty() {
        (component.points, component.stamps_s) = (points, stamps_s);
    }
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
mod tests {
    use super::*;

    fn cadence(steps_ms: &[f64], stated_hz: Option<f64>) -> Cadence {
        Cadence::of(steps_ms.iter().map(|ms| ms * 1e-3).collect(), stated_hz).unwrap()
    }

    #[test]
    fn steps_within_ten_microseconds_are_even_and_a_gap_is_no_step() {
        let even = cadence(&[5.0, 5.009, 4.991, 5.0, 300.0], None);
        assert_eq!((even.rate_hz, even.even), (1.0 / (5.0 * 1e-3), true));
        assert!(!cadence(&[5.0, 5.02, 5.0], None).even);
        // A stated rate holds where it fits, and not where the stamps tell otherwise.
        assert_eq!(cadence(&[7.5, 7.5], Some(133.0)).rate_hz, 133.0);
        assert_eq!(cadence(&[8.0, 8.0], Some(100.0)).rate_hz, 125.0);
        assert_eq!(Cadence::of(vec![0.0, -1.0], None), None);
    }

    #[test]
    fn an_uneven_rate_is_the_mean_and_lost_samples_do_not_lower_it() {
        assert!((cadence(&[8.0, 24.0, 8.0, 24.0], None).rate_hz - 62.5).abs() < 1e-6);
        let lossy: Vec<f64> = (0..50).map(|k| if k % 10 == 3 { 10.0 } else { 5.0 }).collect();
        assert!((cadence(&lossy, None).rate_hz - 200.0).abs() < 1e-6);
        // Whole milliseconds of a device of 133 Hz.
        let whole: Vec<f64> =
            (0..300).map(|k| ((k + 1) as f64 * 7.52).floor() - (k as f64 * 7.52).floor()).collect();
        assert!((cadence(&whole, None).rate_hz - 132.98).abs() < 0.1);
        // Finer than the loop's grid can be, and coarser.
        assert_eq!(cadence(&[0.1, 0.2, 0.1], None).rate_hz, 1000.0);
        // Bursts of events with the frames of a screen between them.
        let bursts = [[1.0, 1.0, 1.0, 13.0]; 3].concat();
        let bursts = cadence(&[bursts, vec![700.0]].concat(), None);
        assert!((bursts.rate_hz - 250.0).abs() < 1e-6 && bursts.gap_s == 0.05, "{bursts:?}");
    }

    #[test]
    fn equal_stamps_are_merged_and_steps_back_left_out() {
        let mut judge = StampJudge::default();
        let verdicts = [0.0, 1.0, 1.0, 1.0, 0.5, 2.0].map(|t_s| judge.judge(t_s));
        let share = |n: f64| StampVerdict::Merge(1.0 / n);
        let next = StampVerdict::Next;
        assert_eq!(verdicts, [next, next, share(2.0), share(3.0), StampVerdict::Backwards, next]);
        let [merged, back] = &judge.remarks().unwrap()[..] else { panic!("two remarks") };
        assert_eq!((merged.count, back.count), (2, 1));
        let mut judge = StampJudge::default();
        let _ = [9.0, 1.0, 2.0, 3.0].map(|t_s| judge.judge(t_s));
        assert!(judge.remarks().unwrap_err().starts_with("3 of 4 stamps step back"));
        assert_eq!(
            super::merged(super::merged([0.0, 3.0], [3.0, 3.0], 0.5), [6.0, 0.0], 1.0 / 3.0),
            [3.0, 2.0]
        );
    }

    #[test]
    fn a_line_drawn_at_uneven_times_has_even_steps_on_the_grid() {
        let stamps_s: Vec<f64> = (0..40)
            .scan(0.0, |t, k| {
                let now = *t;
                *t += if k % 3 == 0 { 0.012 } else { 0.004 };
                Some(now + 1.7e9)
            })
            .collect();
        let points: Vec<[f64; 2]> =
            stamps_s.iter().map(|t| [3e6 * (t - 1.7e9), -50.0 * (t - 1.7e9)]).collect();
        let even = on_grid(&points, &stamps_s, 200.0);
        assert_eq!(even.len(), ((stamps_s[39] - stamps_s[0]) / 0.005) as usize + 1);
        for (k, [x, y]) in even.iter().enumerate() {
            // Stamps of today's seconds are right to a quarter of a microsecond.
            assert!((x - 15e3 * k as f64).abs() < 2.0 && (y + 0.25 * k as f64).abs() < 1e-4, "{k}: {x} {y}");
        }
        assert_eq!(on_grid(&[[1.0, 2.0]], &[5.0], 200.0), [[1.0, 2.0]]);
    }
}
