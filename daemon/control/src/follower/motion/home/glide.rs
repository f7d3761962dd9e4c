//! A motion from 0 to 1, from rest to rest, with bounded velocity, acceleration and jerk: at most seven
//! segments of constant jerk.
//!
//! The velocity rises from 0 to V in t_r = V/A + A/K (if A is reached, else 2√(V/K)), point-symmetric about
//! its middle, and falls alike; rise and fall together cover V·t_r. If that exceeds 1, V is lowered until it
//! is 1: V(V/A + A/K) = 1 if A is reached, else 2V√(V/K) = 1. The second half mirrors the first, s(t) = 1 −
//! s(T − t).
//!
//! Contract: pure, total; limits that are not positive give a motion that ends at once.

use crate::state::state;

/// Velocity, acceleration and jerk of the share \[1/s, 1/s², 1/s³\], or those of joints \[rad/s, rad/s²,
/// rad/s³\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GlideLimits {
    pub(super) velocity: f64,
    pub(super) acceleration: f64,
    pub(super) jerk: f64,
}

state! { [] GlideLimits { velocity, acceleration, jerk } }

/// The motion in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Glide {
    pace: GlideLimits,
    /// Duration of the constant jerk, of the rise of the velocity, and of the whole motion \[s\].
    jerk_s: f64,
    rise_s: f64,
    whole_s: f64,
}

state! { [] Glide { pace, jerk_s, rise_s, whole_s } }

impl Glide {
    /// The motion that is over before it begins.
    pub(super) const OVER: Self = Self {
        pace: GlideLimits { velocity: 0.0, acceleration: 0.0, jerk: 0.0 },
        jerk_s: 0.0,
        rise_s: 0.0,
        whole_s: 0.0,
    };

    /// As fast as `limits` allow.
    pub(super) fn within(limits: &GlideLimits) -> Self {
        let GlideLimits { velocity, acceleration, jerk } = *limits;
        if ![velocity, acceleration, jerk].iter().all(|limit| *limit > 0.0 && limit.is_finite()) {
            return Self::OVER;
        }
        let full_s = acceleration / jerk;
        let ramped = |velocity: f64| velocity >= acceleration * full_s;
        let whole = |velocity: f64| {
            let rise_s = if ramped(velocity) {
                velocity / acceleration + full_s
            } else {
                2.0 * (velocity / jerk).sqrt()
            };
            (velocity * rise_s, rise_s)
        };
        let mut velocity = velocity;
        if whole(velocity).0 > 1.0 {
            let half = 0.5 * acceleration * full_s;
            let with_ramp = (half * half + acceleration).sqrt() - half;
            velocity = if ramped(with_ramp) { with_ramp } else { (0.25 * jerk).cbrt() };
        }
        let (way, rise_s) = whole(velocity);
        let jerk_s = if ramped(velocity) { full_s } else { 0.5 * rise_s };
        let cruise_s = ((1.0 - way) / velocity).max(0.0);
        Self {
            pace: GlideLimits { velocity, acceleration: jerk * jerk_s, jerk },
            jerk_s,
            rise_s,
            whole_s: 2.0 * rise_s + cruise_s,
        }
    }

    /// How long the whole way takes \[s\].
    pub(super) const fn seconds(&self) -> f64 {
        self.whole_s
    }

    /// The fraction of the way after `t` \[s\]; exactly 1 at its end and later.
    pub(super) fn share(&self, t: f64) -> f64 {
        if !(t < self.whole_s) {
            1.0
        } else if t > 0.5 * self.whole_s {
            1.0 - self.first_half(self.whole_s - t)
        } else {
            self.first_half(t.max(0.0))
        }
    }

    fn first_half(&self, t: f64) -> f64 {
        let GlideLimits { velocity, acceleration, jerk } = self.pace;
        let rising = |t: f64| {
            if t <= self.jerk_s {
                jerk * t * t * t / 6.0
            } else {
                let (after, before) = (t - self.jerk_s, self.jerk_s);
                jerk * before * before * before / 6.0
                    + (0.5 * jerk * before * before + 0.5 * acceleration * after) * after
            }
        };
        if t <= 0.5 * self.rise_s {
            rising(t)
        } else if t <= self.rise_s {
            velocity * (t - 0.5 * self.rise_s) + rising(self.rise_s - t)
        } else {
            velocity * (t - 0.5 * self.rise_s)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Differences of the share over steps of `h`: largest velocity, acceleration and jerk.
    fn largest(glide: &Glide, h: f64) -> [f64; 3] {
        let steps = (glide.seconds() / h) as usize + 4;
        let mut rows = vec![(0..steps).map(|k| glide.share((k as f64 - 2.0) * h)).collect::<Vec<_>>()];
        for _ in 0..3 {
            let before = rows.last().unwrap();
            rows.push(before.windows(2).map(|w| (w[1] - w[0]) / h).collect());
        }
        // Before it begins the share is that of the beginning.
        [1, 2, 3].map(|order| rows[order].iter().fold(0.0, |most: f64, x| most.max(x.abs())))
    }

    #[test]
    fn every_kind_of_way_ends_at_one_inside_its_limits() {
        for (limits, seconds) in [
            // Cruises: 1/V + V/A + A/K. Reaches A, not V. Reaches neither: (32/K)^⅓.
            (GlideLimits { velocity: 0.2, acceleration: 0.5, jerk: 2.0 }, Some(5.0 + 0.4 + 0.25)),
            (GlideLimits { velocity: 9.0, acceleration: 1.0, jerk: 100.0 }, None),
            (GlideLimits { velocity: 9.0, acceleration: 50.0, jerk: 4.0 }, Some(2.0)),
            (GlideLimits { velocity: 1e-4, acceleration: 1.0, jerk: 1.0 }, None),
            (GlideLimits { velocity: 1e6, acceleration: 1e6, jerk: 1e7 }, None),
        ] {
            let glide = Glide::within(&limits);
            if let Some(seconds) = seconds {
                assert!((glide.seconds() - seconds).abs() < 1e-9, "{glide:?}");
            }
            let h = glide.seconds() / 4000.0;
            let [velocity, acceleration, jerk] = largest(&glide, h);
            let near = |seen: f64, limit: f64| seen <= limit * (1.0 + 1e-4) + 1e-9;
            assert!(near(velocity, limits.velocity) && near(acceleration, limits.acceleration), "{glide:?}");
            assert!(jerk <= limits.jerk * 1.01 + 1e-9, "{glide:?}: {jerk}");
            assert!(glide.share(0.0) == 0.0 && glide.share(glide.seconds()) == 1.0);
            // At least one limit is reached.
            let bound = [velocity / limits.velocity, acceleration / limits.acceleration, jerk / limits.jerk];
            assert!(bound.iter().any(|share| *share > 0.99), "{bound:?}");
        }
    }

    #[test]
    fn limits_that_are_none_end_the_way_at_once() {
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let glide = Glide::within(&GlideLimits { velocity: wrong, acceleration: 1.0, jerk: 1.0 });
            assert_eq!((glide.seconds(), glide.share(0.0)), (0.0, 1.0));
        }
    }
}
