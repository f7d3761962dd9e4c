//! The stop that is always possible: a plan may only lead to states from which the tool can come to rest
//! inside its bounds, axis by axis.
//!
//! The horizon may be shorter than a stop, and its bounds are soft, so the cost alone does not ensure that. A
//! stop here ends at rest, velocity and acceleration both zero: one that only reverses the velocity would
//! come back as fast.
//!
//! Contract: pure, no allocation, bounded work. Where bounds can no longer be kept, the answer is the stop
//! itself; from outside the bounds every motion that leads no farther out is allowed.

use super::limits::AxisLimits;
use crate::units::AxisState;

/// Bisections between plan and stop.
const HALVINGS: u32 = 20;
/// Rounding \[m\]: repeating a stop must not be judged as leaving it.
const ROUNDING_M: f64 = 1e-9;

/// A stop in two segments of constant jerk and one of constant acceleration between them, with the sign
/// chosen so that the velocity decreases.
#[derive(Debug, Clone, Copy)]
struct Stop {
    /// +1 or −1: the direction of the velocity.
    sign: f64,
    jerk: f64,
    /// Durations: acceleration falls to −braking, stays there, comes back to zero \[s\].
    falls_s: f64,
    stays_s: f64,
    returns_s: f64,
}

impl Stop {
    /// The soonest from `state` inside `jerk` \[m/s³\] and `most` \[m/s²\].
    fn of(state: &AxisState, jerk: f64, most: f64) -> Self {
        let unwound = state.velocity + 0.5 * state.acceleration * state.acceleration.abs() / jerk;
        let sign = if unwound < 0.0 { -1.0 } else { 1.0 };
        let (v, a) = (sign * state.velocity, sign * state.acceleration);
        let needed = (jerk * v + 0.5 * a * a).max(0.0).sqrt().max(-a);
        // A state that already brakes harder than the limit is assumed to continue so.
        let most = most.max(-a);
        let braking = needed.min(most);
        let stays_s = if needed > most && most > 0.0 {
            ((v + 0.5 * a * a / jerk) / most - most / jerk).max(0.0)
        } else {
            0.0
        };
        Self { sign, jerk, falls_s: (a + braking) / jerk, stays_s, returns_s: braking / jerk }
    }

    /// The state after `seconds` of it.
    fn after(&self, state: &AxisState, seconds: f64) -> AxisState {
        let mut left = seconds;
        let mut state = *state;
        for (jerk, lasts_s) in [(-self.jerk, self.falls_s), (0.0, self.stays_s), (self.jerk, self.returns_s)]
        {
            let spent = left.min(lasts_s);
            state = state.advanced(self.sign * jerk, spent);
            left -= spent;
        }
        if left > 0.0 { AxisState::at_rest(state.position) } else { state }
    }
}

impl AxisLimits {
    /// Lowest and highest position while `state` comes to rest, as hard as jerk and acceleration allow \[m\].
    #[must_use]
    pub fn stopping_m(&self, state: &AxisState) -> [f64; 2] {
        let here = state.position;
        if self.jerk_mps3 == f64::INFINITY {
            return [here; 2];
        }
        let stop = Stop::of(state, self.jerk_mps3, self.acceleration_mps2);
        let end = stop.after(state, stop.falls_s + stop.stays_s + stop.returns_s).position;
        let (v, a) = (stop.sign * state.velocity, stop.sign * state.acceleration);
        // It first moves the other way, until its acceleration has reversed it.
        let turns = if v < 0.0 {
            let turned_s = (a - (a * a + 2.0 * stop.jerk * v).max(0.0).sqrt()) / stop.jerk;
            stop.after(state, turned_s.max(0.0)).position
        } else {
            here
        };
        [here.min(end).min(turns), here.max(end).max(turns)]
    }

    /// The highest speed that is at rest after `seconds` \[m/s\], at most [`Self::velocity_mps`].
    #[must_use]
    pub fn stoppable_mps(&self, seconds: f64) -> f64 {
        let [jerk, most] = [self.jerk_mps3, self.acceleration_mps2];
        let ramp_s = most / jerk;
        let speed =
            if seconds <= 2.0 * ramp_s { 0.25 * jerk * seconds * seconds } else { most * (seconds - ramp_s) };
        // Infinite limits make NaN, which the minimum drops.
        speed.min(self.velocity_mps)
    }

    /// The state nearest to `planned`, on the way to a stop, from which the tool can still come to rest
    /// inside its bounds; `planned` itself, bit for bit, if it can. `seconds`: from `state` to `planned`.
    #[must_use]
    pub fn kept_stoppable(&self, state: &AxisState, planned: &AxisState, seconds: f64) -> AxisState {
        if self.jerk_mps3 == f64::INFINITY {
            return *planned;
        }
        let [low, high] = self.position_m;
        let inside = |state: &AxisState, [low, high]: [f64; 2]| {
            let [lowest, highest] = self.stopping_m(state);
            lowest >= low && highest <= high
        };
        if inside(planned, [low, high]) {
            return *planned;
        }
        // Excess that cannot be avoided does not count; it must not grow.
        let [lowest, highest] = self.stopping_m(state);
        let open = [low.min(lowest - ROUNDING_M), high.max(highest + ROUNDING_M)];
        if inside(planned, open) {
            return *planned;
        }
        let stop = Stop::of(state, self.jerk_mps3, self.acceleration_mps2).after(state, seconds);
        // Jerks between those of plan and stop lead to states between theirs.
        let between = |share: f64| {
            let mix = |plan: f64, stop: f64| plan + share * (stop - plan);
            AxisState {
                position: mix(planned.position, stop.position),
                velocity: mix(planned.velocity, stop.velocity),
                acceleration: mix(planned.acceleration, stop.acceleration),
            }
        };
        let (mut bad, mut good) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (bad + good);
            if inside(&between(middle), open) {
                good = middle;
            } else {
                bad = middle;
            }
        }
        let kept = between(good);
        if kept.is_finite() { kept } else { *planned }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: AxisLimits =
        AxisLimits { jerk_mps3: 800.0, acceleration_mps2: 12.0, velocity_mps: 1.0, position_m: [-0.2, 0.2] };

    /// How long `speed` takes to rest within `limits` \[s\].
    fn stopping_s(limits: &AxisLimits, speed: f64) -> f64 {
        let [jerk, most] = [limits.jerk_mps3, limits.acceleration_mps2];
        if speed * jerk <= most * most { 2.0 * (speed / jerk).sqrt() } else { speed / most + most / jerk }
    }

    fn states() -> impl Iterator<Item = AxisState> {
        let speeds = [-0.9, -0.3, -0.02, 0.0, 0.05, 0.4, 0.9];
        let accelerations = [-12.0, -5.0, -1.0, 0.0, 2.0, 8.0, 12.0];
        speeds.into_iter().flat_map(move |velocity| {
            accelerations.map(move |acceleration| AxisState { position: 0.01, velocity, acceleration })
        })
    }

    #[test]
    fn stops_end_at_rest_inside_their_limits_and_where_they_are_said_to() {
        for state in states() {
            let stop = Stop::of(&state, LIMITS.jerk_mps3, LIMITS.acceleration_mps2);
            let lasts_s = stop.falls_s + stop.stays_s + stop.returns_s;
            let (mut low, mut high, mut last) = (state.position, state.position, state);
            let steps = 4000;
            for step in 1..=steps {
                let next = stop.after(&state, lasts_s * f64::from(step) / f64::from(steps));
                assert!(next.acceleration.abs() <= 12.0 + 1e-9, "{state:?}");
                let jerk = (next.acceleration - last.acceleration).abs() / (lasts_s / f64::from(steps));
                assert!(!(jerk > 800.0 * (1.0 + 1e-6)), "{state:?}: {jerk}");
                (low, high, last) = (low.min(next.position), high.max(next.position), next);
            }
            assert!(last.velocity.abs() < 1e-9 && last.acceleration.abs() < 1e-9, "{state:?}: {last:?}");
            let [lowest, highest] = LIMITS.stopping_m(&state);
            assert!((lowest - low).abs() < 1e-6 && (highest - high).abs() < 1e-6, "{state:?}");
        }
    }

    #[test]
    fn the_speed_that_is_at_rest_in_time_is() {
        for seconds in [0.002, 0.02, 0.05, 0.5] {
            let speed = LIMITS.stoppable_mps(seconds);
            let exact = stopping_s(&LIMITS, speed);
            assert!(
                speed == 1.0 && exact <= seconds || (exact - seconds).abs() < 1e-12,
                "{seconds}: {speed}"
            );
        }
    }

    /// A plan that always accelerates towards a bound comes to rest in front of it.
    #[test]
    fn whatever_is_planned_stays_inside() {
        for (sign, jerk) in [(1.0, 800.0), (-1.0, 800.0), (1.0, 20.0)] {
            let limits = AxisLimits { jerk_mps3: jerk, ..LIMITS };
            let mut state = AxisState::at_rest(0.0);
            for tick in 0..3000 {
                let wanted = state.advanced(sign * jerk * if tick % 7 == 0 { -1.0 } else { 1.0 }, 0.002);
                state = limits.kept_stoppable(&state, &wanted, 0.002);
                assert!(state.position.abs() <= 0.2 + 1e-6, "{tick}: {state:?}");
            }
            assert!((state.position - sign * 0.2).abs() < 0.01, "it gets there: {state:?}");
        }
    }

    #[test]
    fn from_outside_the_way_leads_only_inward() {
        let state = AxisState::at_rest(0.23);
        let out = state.advanced(800.0, 0.002);
        assert!(LIMITS.kept_stoppable(&state, &out, 0.002).position <= 0.23 + 2e-9);
        let inward = state.advanced(-800.0, 0.002);
        assert_eq!(LIMITS.kept_stoppable(&state, &inward, 0.002), inward);
    }
}
