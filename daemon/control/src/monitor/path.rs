//! The recent range of K numbers: minimum and maximum in blocks of 10 ms.
//!
//! Contract: samples are joined by straight lines, also over gaps in time, for more than half a second.
//! Nothing is known from before the first sample. Bounded work per sample, no allocation.

#![expect(clippy::indexing_slicing, reason = "indices run over the K numbers, the length of every array")]

use crate::history::History;
use crate::state::state;
use crate::units::Stamp;

/// Length of a block \[ns\].
pub(super) const BLOCK_NS: u64 = 10_000_000;
/// Blocks kept: the longest lag, the spread of a filter with that lag, and a window.
const KEPT: usize = 128;
/// The longest time that can be queried \[ns\].
pub(super) const KEPT_NS: u64 = (KEPT as u64 - 2) * BLOCK_NS;

/// Minimum and maximum of each number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span<const K: usize> {
    pub(super) low: [f64; K],
    pub(super) high: [f64; K],
}

state! { [const K: usize] Span<K> { low, high } }

impl<const K: usize> Span<K> {
    const NOTHING: Self = Self { low: [f64::INFINITY; K], high: [f64::NEG_INFINITY; K] };

    fn include(&mut self, point: &[f64; K]) {
        self.merge(&Self { low: *point, high: *point });
    }

    fn merge(&mut self, other: &Self) {
        for k in 0..K {
            self.low[k] = if other.low[k] < self.low[k] { other.low[k] } else { self.low[k] };
            self.high[k] = if other.high[k] > self.high[k] { other.high[k] } else { self.high[k] };
        }
    }

    /// Distance of `point` outside the range, positive above, negative below.
    pub(super) fn outside(&self, point: &[f64; K]) -> [f64; K] {
        std::array::from_fn(|k| (point[k] - self.high[k]).max(0.0) + (point[k] - self.low[k]).min(0.0))
    }

    /// Maximum minus minimum of each.
    pub(super) fn width(&self) -> [f64; K] {
        std::array::from_fn(|k| self.high[k] - self.low[k])
    }
}

/// The samples of 10 ms.
#[derive(Debug, Clone, Copy)]
struct RangeBlock<const K: usize> {
    span: Span<K>,
    end: [f64; K],
}

state! { [const K: usize] RangeBlock<K> { span, end } }

#[derive(Debug, Clone)]
pub(super) struct RangeHistory<const K: usize> {
    blocks: History<RangeBlock<K>, KEPT>,
    last: Option<(Stamp, [f64; K])>,
    /// Cache of the last query: first and last block, and their range.
    known: (u64, u64, Span<K>),
}

state! { [const K: usize] RangeHistory<K> { blocks, last, known } }

impl<const K: usize> RangeHistory<K> {
    pub(super) const fn new() -> Self {
        let nothing = RangeBlock { span: Span::NOTHING, end: [0.0; K] };
        Self { blocks: History::new(nothing), last: None, known: (1, 0, Span::NOTHING) }
    }

    pub(super) fn clear(&mut self) {
        self.last = None;
        self.known = (1, 0, Span::NOTHING);
    }

    pub(super) fn last(&self) -> Option<&(Stamp, [f64; K])> {
        self.last.as_ref()
    }

    /// The newest block; it changes every 10 ms.
    pub(super) fn newest(&self) -> u64 {
        self.blocks.end().saturating_sub(1)
    }

    /// Adds `point` at `stamp`; ignored unless newer than the last one.
    pub(super) fn push(&mut self, stamp: Stamp, point: &[f64; K]) {
        let block = stamp.0 / BLOCK_NS;
        match self.last {
            Some((before, _)) if before >= stamp => return,
            Some((_, from)) => {
                let mut line = Span::NOTHING;
                line.include(&from);
                line.include(point);
                let grows = self.blocks.end() > block;
                if let Some(newest) = self.blocks.newest_mut() {
                    newest.span.include(point);
                    newest.end = if grows { *point } else { newest.end };
                }
                let oldest = block.saturating_sub(KEPT as u64) + 1;
                self.blocks.go_on_at(self.blocks.end().max(oldest));
                // At most KEPT turns.
                while self.blocks.end() <= block {
                    self.blocks.push(RangeBlock { span: line, end: *point });
                }
            }
            None => {
                self.blocks.restart(block);
                self.blocks.push(RangeBlock { span: Span { low: *point, high: *point }, end: *point });
            }
        }
        self.last = Some((stamp, *point));
    }

    /// Adds a point to the newest block besides the samples; ignored before the first of these.
    pub(super) fn widen(&mut self, point: &[f64; K]) {
        if self.last.is_some()
            && point.iter().all(|number| number.is_finite())
            && let Some(newest) = self.blocks.newest_mut()
        {
            newest.span.include(point);
        }
    }

    /// How far the numbers moved in a complete block, from the end of the block before; `None` where that is
    /// unknown.
    pub(super) fn step(&self, block: u64) -> Option<[f64; K]> {
        self.last.as_ref()?;
        if block >= self.newest() {
            return None;
        }
        let (before, end) = (self.blocks.get(block.checked_sub(1)?)?.end, self.blocks.get(block)?.end);
        Some(std::array::from_fn(|k| end[k] - before[k]))
    }

    /// When each block that is kept begins, and its newest sample, from the oldest on.
    pub(super) fn ends(&self) -> impl Iterator<Item = (Stamp, &[f64; K])> {
        let blocks = self.last.is_some().then_some(self.blocks.begin()..self.blocks.end());
        let blocks = blocks.into_iter().flatten();
        blocks.filter_map(|block| Some((Stamp(block * BLOCK_NS), &self.blocks.get(block)?.end)))
    }

    /// The range of the samples at the ends of the blocks from `from` to `to`, as far as it is known, without
    /// what was added besides; `None` before the first sample.
    pub(super) fn span_of_ends(&self, from: Stamp, to: Stamp) -> Option<Span<K>> {
        self.last.as_ref()?;
        let (first, last) = self.known_blocks(from, to);
        let mut span = Span::NOTHING;
        for block in (first..=last).filter_map(|block| self.blocks.get(block)) {
            span.include(&block.end);
        }
        Some(span)
    }

    /// The range from `from` to `to`, as far as it is known; the nearest block if that is empty. `None`
    /// before the first sample.
    pub(super) fn span(&mut self, from: Stamp, to: Stamp) -> Option<Span<K>> {
        self.last.as_ref()?;
        let (first, last) = self.known_blocks(from, to);
        // The newest block still grows; those before it do not.
        let complete = last.min(self.newest().saturating_sub(1));
        if (self.known.0, self.known.1) != (first, complete) {
            let mut span = Span::NOTHING;
            for block in (first..=complete).filter_map(|block| self.blocks.get(block)) {
                span.merge(&block.span);
            }
            self.known = (first, complete, span);
        }
        let (.., mut span) = self.known;
        if last == self.newest()
            && let Some(newest) = self.blocks.get(last)
        {
            span.merge(&newest.span);
        }
        Some(span)
    }

    /// The first and the last block from `from` to `to`, as far as they are known; else the nearest one.
    fn known_blocks(&self, from: Stamp, to: Stamp) -> (u64, u64) {
        let newest = self.newest();
        let first = (from.0 / BLOCK_NS).clamp(self.blocks.begin().min(newest), newest);
        (first, (to.0 / BLOCK_NS).clamp(first, newest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    /// One second of a ramp of 1/s, sampled every 7 ms.
    fn ramp() -> RangeHistory<1> {
        let mut path = RangeHistory::new();
        for t in (1000..2000).step_by(7) {
            path.push(ms(t), &[t as f64 * 1e-3]);
        }
        path
    }

    #[test]
    fn spans_hold_all_that_was_and_a_block_more_at_most() {
        let mut path = ramp();
        for (from, to) in [(1500, 1700), (1503, 1504), (1000, 1994)] {
            let span = path.span(ms(from), ms(to)).unwrap();
            let (from, to) = (from as f64 * 1e-3, to as f64 * 1e-3);
            assert!(span.low[0] <= from && span.low[0] > from - 0.0171, "{from}: {span:?}");
            assert!(span.high[0] >= to - 1e-9 && span.high[0] < to + 0.0171, "{to}: {span:?}");
        }
    }

    #[test]
    fn spans_by_the_memory_are_those_without_it() {
        let mut path = RangeHistory::<1>::new();
        for t in (1000..3000_u64).step_by(3) {
            path.push(ms(t), &[(t as f64 * 0.01).sin()]);
            let seen = path.span(ms(t.saturating_sub(200)), ms(t)).unwrap();
            let mut fresh = path.clone();
            fresh.known = (1, 0, Span::NOTHING);
            assert_eq!(fresh.span(ms(t.saturating_sub(200)), ms(t)), Some(seen));
        }
    }

    #[test]
    fn steps_are_from_end_to_end_of_complete_blocks() {
        let path = ramp();
        for block in 101..199 {
            let step = path.step(block).unwrap()[0];
            assert!((0.003..=0.0171).contains(&step), "{block}: {step}");
        }
        assert_eq!((path.step(100), path.step(199), path.step(10)), (None, None, None));
    }

    #[test]
    fn what_is_not_known_is_the_nearest_that_is() {
        let mut path = ramp();
        assert_eq!(RangeHistory::<1>::new().span(ms(0), ms(1)), None);
        let before = path.span(ms(10), ms(20)).unwrap();
        assert!(before.low[0] >= 1.0 && before.high[0] < 1.02);
        let after = path.span(ms(5000), ms(6000)).unwrap();
        assert!(after.low[0] > 1.97 && after.high[0] < 2.0, "{after:?}");
    }

    #[test]
    fn gaps_are_lines_and_time_does_not_go_back() {
        let mut path = RangeHistory::<1>::new();
        path.push(ms(1000), &[0.0]);
        path.push(ms(1300), &[3.0]);
        path.push(ms(1200), &[99.0]);
        assert_eq!(path.span(ms(1100), ms(1110)).unwrap(), Span { low: [0.0], high: [3.0] });
        path.push(ms(1_000_000_000), &[1.0]);
        assert_eq!(path.span(ms(999_999_500), ms(1_000_000_000)).unwrap(), Span { low: [1.0], high: [3.0] });
    }

    #[test]
    fn what_is_outside_has_its_side() {
        let span = Span { low: [0.0, 0.0, 0.0], high: [1.0, 1.0, 1.0] };
        assert_eq!(span.outside(&[0.5, 1.25, -0.5]), [0.0, 0.25, -0.5]);
        assert_eq!(span.width(), [1.0; 3]);
    }
}
