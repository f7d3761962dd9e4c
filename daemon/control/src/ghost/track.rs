//! A recent path: stamped positions in the plane, with linear interpolation between them.
//!
//! Contract: keeps the newest points only, all allocated at construction. Stamps increase; points that do not
//! are ignored.

use std::collections::VecDeque;

use crate::units::Stamp;

/// A position in the plane, with its stamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// When the tool or pen was there.
    pub stamp: Stamp,
    /// Plane frame \[m\].
    pub position: [f64; 2],
    /// It was on the paper.
    pub contact: bool,
}

/// The newest points of a path.
#[derive(Debug, Clone)]
pub struct Track {
    points: VecDeque<Point>,
    capacity: usize,
    max_gap_ns: i64,
}

impl Track {
    /// Room for `capacity` points; no interpolation between points further apart than `max_gap_ns`.
    #[must_use]
    pub fn new(capacity: usize, max_gap_ns: i64) -> Self {
        let capacity = capacity.max(2);
        Self { points: VecDeque::with_capacity(capacity), capacity, max_gap_ns }
    }

    /// Adds a point newer than all others.
    pub fn push(&mut self, point: Point) {
        if self.points.back().is_some_and(|newest| point.stamp <= newest.stamp) {
            return;
        }
        if self.points.len() >= self.capacity {
            self.points.pop_front();
        }
        self.points.push_back(point);
    }

    /// The point at `instant`, on the paper if both neighbours are; `None` before, after and in gaps.
    #[must_use]
    pub fn at(&self, instant: Stamp) -> Option<Point> {
        let next = self.points.partition_point(|point| point.stamp <= instant);
        let before = self.points.get(next.checked_sub(1)?)?;
        if before.stamp == instant {
            return Some(*before);
        }
        let after = self.points.get(next)?;
        let span_ns = after.stamp.since(before.stamp);
        if span_ns > self.max_gap_ns {
            return None;
        }
        let share = instant.since(before.stamp) as f64 / span_ns as f64;
        let ([x0, y0], [x1, y1]) = (before.position, after.position);
        Some(Point {
            stamp: instant,
            position: [x0 + share * (x1 - x0), y0 + share * (y1 - y0)],
            contact: before.contact && after.contact,
        })
    }

    /// Stamp of the newest point.
    #[must_use]
    pub fn newest(&self) -> Option<Stamp> {
        self.points.back().map(|point| point.stamp)
    }

    /// Forgets all points that it has.
    pub fn clear(&mut self) {
        self.points.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn point(ms: u64, x: f64, contact: bool) -> Point {
        Point { stamp: Stamp(ms * MS), position: [x, -x], contact }
    }

    fn track() -> Track {
        let mut track = Track::new(8, 50 * MS as i64);
        for k in 0..12_u32 {
            track.push(point(100 + u64::from(k) * 10, f64::from(k), k != 9));
        }
        track
    }

    #[test]
    fn between_points_it_moves_in_straight_lines_and_touches_only_between_touching_ones() {
        let at = track().at(Stamp(165 * MS)).unwrap();
        assert_eq!(at.position, [6.5, -6.5]);
        assert!(at.contact && !track().at(Stamp(185 * MS)).unwrap().contact);
        assert_eq!(track().at(Stamp(210 * MS)).unwrap().position, [11.0, -11.0]);
    }

    #[test]
    fn before_after_and_in_gaps_nothing_is_known() {
        // Eight of twelve are kept.
        assert_eq!(track().at(Stamp(139 * MS)), None);
        assert!(track().at(Stamp(140 * MS)).is_some());
        assert_eq!(track().at(Stamp(211 * MS)), None);
        let mut track = track();
        track.push(point(261, 0.0, true));
        assert_eq!(track.at(Stamp(250 * MS)), None);
        assert!(track.at(Stamp(261 * MS)).is_some());
        track.clear();
        assert_eq!(track.at(Stamp(261 * MS)), None);
    }

    #[test]
    fn a_stamp_that_repeats_or_goes_back_is_left_out() {
        let mut track = track();
        track.push(point(210, 99.0, true));
        track.push(point(205, 99.0, true));
        assert_eq!(track.at(Stamp(205 * MS)).unwrap().position, [10.5, -10.5]);
    }
}
