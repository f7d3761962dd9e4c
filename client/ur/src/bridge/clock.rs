//! The controller's clock on this host's: its `timestamp` mapped to the monotonic clock by the packages that
//! were least late.
//!
//! A package that left the controller at T arrives at T + offset + delay, delay ≥ 0. The smallest arrival − T
//! of the last seconds is therefore the best guess of the offset there is; what is left is the shortest delay
//! of the line itself.

/// Seconds of packages that are looked back on: clocks that drift apart by 100 ppm are wrong by 0.4 ms after
/// them.
const BUCKETS: usize = 4;
const BUCKET_NS: u64 = 1_000_000_000;
/// The offset may rise by this much per nanosecond: a millisecond per second.
const RISE: f64 = 1e-3;
/// Beyond this the clocks have parted for another reason, and the offset jumps \[ns\].
const APART_NS: i64 = 20_000_000;
/// Largest timestamp that is believed \[s\]: thirty years.
const LONGEST_S: f64 = 1e9;

/// Maps the controller's clock to this host's.
#[derive(Debug, Clone, Default)]
pub struct ClockMap {
    /// Smallest arrival − T of each of the last seconds \[ns\], newest first.
    smallest: [Option<i64>; BUCKETS],
    /// When the newest of them began \[ns\].
    begun_ns: u64,
    offset_ns: Option<i64>,
    /// Of the newest package: T \[ns\], and where it was mapped to.
    newest: Option<(i64, u64)>,
}

/// What a package's timestamp says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mapped {
    /// The instant on this host's clock \[ns\].
    At(u64),
    /// The controller's clock went backwards: it was restarted. The instant is that of arrival.
    Restarted(u64),
    /// Not a time, or the same one again.
    Unusable,
}

impl ClockMap {
    /// Takes the package stamped `timestamp_s` that arrived at `arrival_ns`. Stamps grow strictly.
    pub fn observe(&mut self, timestamp_s: f64, arrival_ns: u64) -> Mapped {
        if !(0.0..=LONGEST_S).contains(&timestamp_s) {
            return Mapped::Unusable;
        }
        let t_ns = (timestamp_s * 1e9).round() as i64;
        let before = self.newest;
        if before.is_some_and(|(newest, _)| t_ns == newest) {
            return Mapped::Unusable;
        }
        let restarted = before.is_some_and(|(newest, _)| t_ns < newest);
        if restarted {
            *self = Self::default();
        }
        let seen = i64::try_from(arrival_ns).unwrap_or(i64::MAX).saturating_sub(t_ns);
        let passed_ns = before.filter(|_| !restarted).map_or(0, |(newest, _)| t_ns.saturating_sub(newest));
        let offset = self.offset(seen, arrival_ns, passed_ns);
        let mut stamp = u64::try_from(t_ns.saturating_add(offset)).unwrap_or(0);
        if let Some((_, last)) = before {
            stamp = stamp.max(last.saturating_add(1));
        }
        self.newest = Some((t_ns, stamp));
        if restarted { Mapped::Restarted(stamp) } else { Mapped::At(stamp) }
    }

    /// Forgets everything but how far stamps have come: the line is another one now.
    pub fn reconnected(&mut self) {
        self.smallest = [None; BUCKETS];
        self.offset_ns = None;
    }

    fn offset(&mut self, seen: i64, arrival_ns: u64, passed_ns: i64) -> i64 {
        if arrival_ns.saturating_sub(self.begun_ns) >= BUCKET_NS {
            self.smallest.rotate_right(1);
            self.smallest[0] = None;
            self.begun_ns = arrival_ns;
        }
        let newest = &mut self.smallest[0];
        *newest = Some(newest.map_or(seen, |smallest| smallest.min(seen)));
        let least = self.smallest.iter().flatten().copied().min().unwrap_or(seen);
        let offset = match self.offset_ns {
            Some(offset) if least > offset && least.saturating_sub(offset) < APART_NS => {
                least.min(offset.saturating_add((passed_ns as f64 * RISE) as i64))
            }
            _ => least,
        };
        self.offset_ns = Some(offset);
        offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;

    /// Host clock at controller time 0 \[ns\].
    const APART: u64 = 5_000_000_000;
    const CYCLE_NS: u64 = 8_000_000;

    fn at(mapped: Mapped) -> u64 {
        match mapped {
            Mapped::At(stamp) | Mapped::Restarted(stamp) => stamp,
            Mapped::Unusable => panic!("unusable"),
        }
    }

    /// Where a package of `cycle` is mapped that comes `late_ns` after it was made.
    fn sent(map: &mut ClockMap, cycle: u64, late_ns: u64) -> u64 {
        let t_ns = cycle * CYCLE_NS;
        at(map.observe(t_ns as f64 * 1e-9, APART + t_ns + late_ns))
    }

    #[test]
    fn late_packages_do_not_move_the_stamp() {
        let mut map = ClockMap::default();
        for cycle in 1..500 {
            let late = if cycle % 7 == 0 { 3_000_000 } else { 100_000 };
            let error = sent(&mut map, cycle, late).abs_diff(APART + cycle * CYCLE_NS);
            assert!(error <= 110_000, "cycle {cycle}: {error} ns");
        }
    }

    #[test]
    fn a_clock_that_drifts_by_200_ppm_is_followed_within_a_millisecond() {
        for ppm in [-200i64, 200] {
            let mut map = ClockMap::default();
            for cycle in 1..4000u64 {
                let t_ns = (cycle * CYCLE_NS) as i64;
                let true_ns = (APART as i64 + t_ns + t_ns * ppm / 1_000_000) as u64;
                let stamp = at(map.observe(t_ns as f64 * 1e-9, true_ns));
                assert!(stamp.abs_diff(true_ns) < 1_000_000, "{ppm} ppm, cycle {cycle}");
            }
        }
    }

    #[test]
    fn a_clock_that_goes_backwards_is_a_restart_and_stamps_go_on() {
        let mut map = ClockMap::default();
        let before = sent(&mut map, 1000, 0);
        let arrival = APART + 1000 * CYCLE_NS + 30_000_000;
        assert_eq!(map.observe(0.008, arrival), Mapped::Restarted(arrival));
        assert!(at(map.observe(0.016, arrival + CYCLE_NS)) > before);
    }

    #[test]
    fn what_is_no_time_is_not_used() {
        let mut map = ClockMap::default();
        for t in [f64::NAN, f64::INFINITY, -1.0, 1e300] {
            assert_eq!(map.observe(t, 1), Mapped::Unusable);
        }
        map.observe(1.0, 10_000_000_000);
        assert_eq!(map.observe(1.0, 10_008_000_000), Mapped::Unusable);
    }

    #[test]
    fn a_controller_that_stood_still_is_caught_up_with_at_once() {
        let mut map = ClockMap::default();
        sent(&mut map, 1, 0);
        // Its clock was halted for 5 s of ours, longer than is looked back.
        let stamp = at(map.observe(0.016, APART + 5_016_000_000));
        let later = at(map.observe(0.024, APART + 5_024_000_000));
        assert!(stamp.abs_diff(APART + 5_016_000_000) <= 5_000_000_000);
        for cycle in 4..1000u64 {
            map.observe(cycle as f64 * 0.008, APART + 5_000_000_000 + cycle * CYCLE_NS);
        }
        let end = at(map.observe(8.0, APART + 5_000_000_000 + 8_000_000_000));
        assert!(end > later && end.abs_diff(APART + 13_000_000_000) < 1_000_000, "{end}");
    }

    proptest! {
        #[test]
        fn stamps_grow_and_never_lie_after_arrival(late in vec(0u64..50_000_000, 1..400)) {
            let mut map = ClockMap::default();
            let (mut arrival, mut last) = (0, 0);
            for (cycle, late) in (1u64..).zip(late) {
                // TCP keeps the order.
                arrival = (APART + cycle * CYCLE_NS + late).max(arrival + 1);
                let stamp = at(map.observe((cycle * CYCLE_NS) as f64 * 1e-9, arrival));
                prop_assert!(stamp > last && stamp <= arrival.max(last + 1));
                last = stamp;
            }
        }

        #[test]
        fn any_bits_as_a_timestamp_are_survived(bits in vec((any::<u64>(), any::<u64>()), 1..200)) {
            let mut map = ClockMap::default();
            for (timestamp, arrival) in bits {
                let _ = map.observe(f64::from_bits(timestamp), arrival);
            }
        }
    }
}
