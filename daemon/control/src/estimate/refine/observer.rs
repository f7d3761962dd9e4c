//! The pen's present motion: velocity and acceleration from the raw samples, at any rate.
//!
//! Contract: Kalman filters of constant acceleration per axis, one gain for both; O(1) per sample, no
//! allocation, total. Only the ratio of process noise to sample noise matters; it has no unit of length, so
//! the size of the writing does not matter. A coarse tablet and a clean one differ in it by a factor of a
//! hundred, and the wrong filter's error grows accordingly: several filters run side by side, and the one
//! that extrapolates best is selected.

use super::filter::MotionFilter;
use crate::estimate::LawParameters;
use crate::state::state;

/// Kalman filters side by side, from coarse tablets to clean ones.
const OBSERVERS: usize = 5;

/// The filters and their scores.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Observers {
    law: LawParameters,
    filters: [MotionFilter; OBSERVERS],
    chosen: usize,
    /// Claims that wait until the pen is `reach_s` further.
    claim: Option<Extrapolation>,
    /// Mean squared errors of the filters and mean squared displacement \[m²\].
    missed: [f64; OBSERVERS],
    moved: f64,
    judged: u32,
}

state! { [] Observers { filters, chosen, claim, missed, moved, judged } fixed { law } }

/// Extrapolations of every filter, made at `time_s` with the pen at `position` \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Extrapolation {
    time_s: f64,
    position: [f64; 2],
    motions: [[[f64; 2]; 2]; OBSERVERS],
}

state! { whole [] Extrapolation { time_s, position, motions } }

impl Observers {
    /// Before the first sample: a coarse tablet.
    pub(super) fn new(law: &LawParameters) -> Self {
        Self {
            law: *law,
            filters: filters(law),
            chosen: 0,
            claim: None,
            missed: [0.0; OBSERVERS],
            moved: 0.0,
            judged: 0,
        }
    }

    pub(super) fn forget(&mut self) {
        self.claim = None;
        for filter in &mut self.filters {
            filter.forget();
        }
    }

    /// A sample at `position` \[m\] and `time_s`; a repeated or older one is ignored.
    pub(super) fn see(&mut self, time_s: f64, position: [f64; 2]) {
        for filter in &mut self.filters {
            filter.see(time_s, position);
        }
        let elapsed_s = self.claim.map_or(f64::INFINITY, |claim| time_s - claim.time_s);
        if elapsed_s < self.law.filter_reach_s {
            return;
        }
        if let Some(claim) = self.claim.filter(|_| elapsed_s < 2.0 * self.law.filter_reach_s) {
            self.judge(&claim, elapsed_s, position);
        }
        self.claim = Some(Extrapolation {
            time_s,
            position,
            motions: self.filters.each_ref().map(MotionFilter::motion),
        });
    }

    /// The filter selected, from 0, a coarse tablet, to 1, a clean one.
    pub(super) fn clarity(&self) -> f64 {
        self.chosen as f64 / (OBSERVERS - 1) as f64
    }

    /// Velocity \[m/s\] and acceleration \[m/s²\] at the newest sample.
    pub(super) fn motion(&self) -> [[f64; 2]; 2] {
        self.filters.get(self.chosen).map_or([[0.0; 2]; 2], MotionFilter::motion)
    }

    fn judge(&mut self, claim: &Extrapolation, elapsed_s: f64, position: [f64; 2]) {
        let square = |[x, y]: [f64; 2]| x * x + y * y;
        let [[px, py], [x, y]] = [claim.position, position];
        let (wx, wy) = (x - px, y - py);
        let way = square([wx, wy]);
        let half = 0.5 * elapsed_s * elapsed_s;
        let errors = claim.motions.map(|[[vx, vy], [ax, ay]]| {
            square([wx - elapsed_s * vx - half * ax, wy - elapsed_s * vy - half * ay])
        });
        // Rest carries no information about filters, so it causes no forgetting.
        let pace = self.law.filter_pace * way / (way + self.moved);
        let sound = errors.iter().all(|error| error.is_finite());
        if !(pace > 0.0 && sound) {
            return;
        }
        self.moved += pace * (way - self.moved);
        for (missed, error) in self.missed.iter_mut().zip(errors) {
            *missed += pace * (error - *missed);
        }
        self.judged = self.judged.saturating_add(1);
        let best = self.missed.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
        if let (Some((best, least)), Some(now)) = (best, self.missed.get(self.chosen))
            && f64::from(self.judged) >= self.law.filter_settled
            && *least < self.law.filter_better * now
        {
            self.chosen = best;
        }
    }
}

/// From coarse to clean.
fn filters(law: &LawParameters) -> [MotionFilter; OBSERVERS] {
    let mut change = law.filter_coarsest;
    [(); OBSERVERS].map(|()| {
        let filter = MotionFilter::new(change, law);
        change *= law.filter_ratio;
        filter
    })
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    const SHIPPED: &LawParameters = &LawParameters::SHIPPED;
    const RATE_HZ: f64 = 100.0;

    /// Writes for `seconds` on a tablet with this noise \[m\]; returns the RMS error of the selected filter's
    /// velocity over the last second \[m/s\].
    fn write(observers: &mut Observers, from_s: f64, seconds: f64, noise_m: f64) -> f64 {
        let mut rng = Pcg64::seed_from_u64(11);
        let (mut sum, mut count) = (0.0, 0);
        for k in 0..(seconds * RATE_HZ) as u32 {
            let t = from_s + f64::from(k) / RATE_HZ;
            let (w, u) = (17.0, 23.0);
            let path = [0.02 * (w * t).sin(), 0.015 * (u * t).cos()];
            observers.see(t, path.map(|x| x + noise_m * rng.random_range(-1.0..1.0)));
            if f64::from(k) > (seconds - 1.0) * RATE_HZ {
                let [[vx, vy], _] = observers.motion();
                sum += (vx - 0.02 * w * (w * t).cos()).powi(2) + (vy + 0.015 * u * (u * t).sin()).powi(2);
                count += 1;
            }
        }
        (sum / f64::from(count)).sqrt()
    }

    #[test]
    fn a_coarse_tablet_and_a_clean_one_get_the_filter_that_suits_them() {
        for (noise_m, suits) in [(2e-3, 0.0..=0.25), (1e-6, 0.75..=1.0)] {
            let mut observers = Observers::new(SHIPPED);
            let error = write(&mut observers, 0.0, 6.0, noise_m);
            assert!(suits.contains(&observers.clarity()), "{noise_m} m: {}", observers.clarity());
            // Better than the filter for the other kind.
            for other in [0, OBSERVERS - 1].into_iter().filter(|other| *other != observers.chosen) {
                let mut wrong = Observers::new(SHIPPED);
                wrong.filters = [filters(SHIPPED)[other]; OBSERVERS];
                let wrong = write(&mut wrong, 0.0, 6.0, noise_m);
                assert!(error < 0.8 * wrong, "{noise_m} m: {error} m/s, with {other} {wrong} m/s");
            }
        }
    }

    #[test]
    fn another_tablet_is_noticed_and_rest_changes_nothing() {
        let mut observers = Observers::new(SHIPPED);
        write(&mut observers, 0.0, 4.0, 1e-6);
        let clean = observers.clarity();
        for k in 0..3000 {
            observers.see(5.0 + f64::from(k) / RATE_HZ, [0.01, 0.02]);
        }
        assert_eq!(observers.clarity(), clean);
        write(&mut observers, 40.0, 10.0, 2e-3);
        assert!(observers.clarity() < clean, "{} after {clean}", observers.clarity());
    }

    #[test]
    fn numbers_that_are_none_choose_nothing() {
        let mut observers = Observers::new(SHIPPED);
        write(&mut observers, 0.0, 2.0, 1e-6);
        let chosen = observers.chosen;
        for (k, bad) in [f64::NAN, f64::INFINITY, -1e300, 1e300].into_iter().cycle().take(200).enumerate() {
            observers.see(3.0 + k as f64 * 0.03, [bad, 0.0]);
        }
        assert_eq!(observers.chosen, chosen);
        assert!(observers.missed.iter().all(|missed| missed.is_finite()));
    }

    /// Every filter's claim, 20 ms later, weighted by the pen's displacement.
    #[test]
    fn filters_are_judged_by_where_they_said_that_the_pen_goes() {
        let mut rng = Pcg64::seed_from_u64(13);
        let mut observers = Observers::new(SHIPPED);
        let mut filters = filters(SHIPPED);
        let (mut missed, mut moved) = ([0.0; OBSERVERS], 0.0);
        let mut claimed = None;
        for k in 0..400 {
            let t = 0.02 * f64::from(k);
            // It writes, rests, and writes faster.
            let speed = if (150..200).contains(&k) { 0.0 } else { 1.0 + 0.005 * f64::from(k) };
            let noise = 1e-4 * rng.random_range(-1.0..1.0);
            let position = [0.02 * (9.0 * speed * t).sin() + noise * speed, 0.01 * (14.0 * speed * t).cos()];
            observers.see(t, position);
            filters.iter_mut().for_each(|filter| filter.see(t, position));
            if let Some((from, motions)) =
                claimed.replace((position, filters.each_ref().map(MotionFilter::motion)))
            {
                let from: [f64; 2] = from;
                let way: f64 = (0..2).map(|i| (position[i] - from[i]).powi(2)).sum();
                let counts = SHIPPED.filter_pace * way / (way + moved);
                if counts > 0.0 {
                    moved += counts * (way - moved);
                    let motions: [[[f64; 2]; 2]; OBSERVERS] = motions;
                    for (missed, [velocity, acceleration]) in missed.iter_mut().zip(motions) {
                        let predicted =
                            |i: usize| from[i] + 0.02 * velocity[i] + 0.5 * 0.02 * 0.02 * acceleration[i];
                        let error: f64 = (0..2).map(|i| (position[i] - predicted(i)).powi(2)).sum();
                        *missed += counts * (error - *missed);
                    }
                }
            }
            let pairs = observers.missed.iter().chain([&observers.moved]).zip(missed.iter().chain([&moved]));
            for (found, expected) in pairs {
                assert!((found - expected).abs() <= 1e-9 * expected, "{k}: {found} {expected}");
            }
            // No filter is 15 % better than the selected one.
            if f64::from(observers.judged) > SHIPPED.filter_settled {
                let least = missed.iter().copied().fold(f64::INFINITY, f64::min);
                assert!(
                    least >= SHIPPED.filter_better * missed[observers.chosen] * (1.0 - 1e-9),
                    "{k}: {missed:?}"
                );
            }
        }
        assert!(observers.judged > 300 && observers.chosen != 0, "{observers:?}");
    }
}
