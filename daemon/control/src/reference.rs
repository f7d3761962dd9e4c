//! From the preview to the references of the plan, at the times when the arm will be there.
//!
//! Contract: no memory; positions in the plane frame \[m\].

use crate::estimate::RefinedPreview;
use crate::units::{AxisState, Stamp};

/// Half-width of the mean velocity by which references lead \[steps\]: differences of neighbouring
/// predictions are noisier than the predictions. The best of 0 to 12 on ten train writers of unipen-tos
/// behind 30 ms.
const VELOCITY_STEPS: f64 = 3.5;

/// How references are made from a preview.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reference {
    /// Lead of the references, in steps of the predicted velocity.
    velocity_lead: f64,
    plan_step_s: f64,
}

impl Reference {
    /// References `plan_step_s` \[s\] apart, advanced by `lead_ns` of the predicted velocity, in grid steps
    /// of `step_ns`. Badly predicted motion is predicted late on average; advancing by the predicted velocity
    /// removes that lag with the least added error.
    pub(crate) fn leading(step_ns: u64, lead_ns: u64, plan_step_s: f64) -> Self {
        Self { velocity_lead: lead_ns as f64 / step_ns as f64, plan_step_s }
    }

    /// The references of a tick: where the preview has the pen, or at rest at `resting_at` \[m\]. `None`
    /// before the first preview.
    pub(crate) fn of_pen<const N: usize>(
        self,
        preview: &RefinedPreview,
        resting_at: Option<[f64; 2]>,
        now: Stamp,
        ahead_ns: u64,
    ) -> Option<[[AxisState; N]; 2]> {
        match resting_at {
            Some(position) => preview.base.map(|_| position.map(|at| [AxisState::at_rest(at); N])),
            None => self.references(preview, now, ahead_ns),
        }
    }

    /// References at `now` + `ahead_ns` + i times the plan's step, i = 1..N, for the plane's x and y.
    ///
    /// On cubic segments through the newest sample and the predicted grid points, with slopes from their
    /// neighbours: a corner at every grid point would cost an aggressive plan more jerk than the letter does.
    /// Beyond the last predicted point the pen is assumed to rest.
    fn references<const N: usize>(
        self,
        preview: &RefinedPreview,
        now: Stamp,
        ahead_ns: u64,
    ) -> Option<[[AxisState; N]; 2]> {
        let step_s = preview.step_s();
        let lead = preview.lead(now, ahead_ns)?;
        let stride = self.plan_step_s / step_s;
        let spline = Spline::through(preview);
        let mut xs = [AxisState::default(); N];
        let mut ys = [AxisState::default(); N];
        for (i, (x, y)) in xs.iter_mut().zip(&mut ys).enumerate() {
            let s = lead + (i + 1) as f64 * stride;
            let ([at_x, at_y], [further_x, further_y]) = (spline.at(s), self.further(&spline, s));
            let si = |[position, velocity, acceleration]: [f64; 3], further: f64| AxisState {
                position: position + further,
                velocity: velocity / step_s,
                acceleration: acceleration / (step_s * step_s),
            };
            (*x, *y) = (si(at_x, further_x), si(at_y, further_y));
        }
        Some([xs, ys])
    }

    /// The lead by predicted velocity around `s` \[m\].
    fn further(self, spline: &Spline<'_>, s: f64) -> [f64; 2] {
        let (from, to) =
            ((s - VELOCITY_STEPS).max(spline.origin), (s + VELOCITY_STEPS).min(spline.steps as f64));
        if !(self.velocity_lead > 0.0 && to > from) {
            return [0.0; 2];
        }
        let ([[x0, ..], [y0, ..]], [[x1, ..], [y1, ..]]) = (spline.at(from), spline.at(to));
        [x1 - x0, y1 - y0].map(|way| self.velocity_lead * way / (to - from))
    }
}

/// The cubic segments through the path to be followed.
struct Spline<'a> {
    /// Entry 0 is `origin` steps after the base of the preview, entry i i steps; the last is entry `steps`.
    points: &'a [[f64; 2]],
    origin: f64,
    steps: usize,
}

impl<'a> Spline<'a> {
    fn through(preview: &'a RefinedPreview) -> Self {
        let points = preview.followed();
        Self { points, origin: preview.origin, steps: points.len().saturating_sub(1) }
    }

    /// Position \[m\], velocity \[m/step\] and acceleration \[m/step²\] of x and y, `s` steps after the base;
    /// at rest at both ends.
    fn at(&self, s: f64) -> [[f64; 3]; 2] {
        let point = |index: usize| self.points.get(index.min(self.steps)).copied().unwrap_or_default();
        let first = self.first();
        if !(s > self.origin && s < self.steps as f64) {
            let end = if s > self.origin { self.steps } else { 0 };
            return point(end).map(|x| [x, 0.0, 0.0]);
        }
        let (from, to, begin, length) = if s < first as f64 {
            (0, first, self.origin, first as f64 - self.origin)
        } else {
            let index = s as usize;
            (index, index + 1, index as f64, 1.0)
        };
        let t = (s - begin) / length;
        let ([x0, y0], [x1, y1]) = (point(from), point(to));
        let ([mx0, my0], [mx1, my1]) = (self.slope(from), self.slope(to));
        [hermite([x0, mx0, x1, mx1], t, length), hermite([y0, my0, y1, my1], t, length)]
    }

    /// Index of the first predicted point after the newest sample that is far enough for their noise not to
    /// matter.
    fn first(&self) -> usize {
        (self.origin + 0.1) as usize + 1
    }

    /// Slope at a point: from neighbour to neighbour; at the ends to the only neighbour \[m/step\].
    fn slope(&self, index: usize) -> [f64; 2] {
        let first = self.first();
        let knot = |index: usize| if index < first { (0, self.origin) } else { (index, index as f64) };
        let (before, after) = (knot(index.max(1) - 1), knot((index + 1).max(first).min(self.steps)));
        let ((i0, s0), (i1, s1)) = (before, after);
        let ([x0, y0], [x1, y1]) = (
            self.points.get(i0).copied().unwrap_or_default(),
            self.points.get(i1).copied().unwrap_or_default(),
        );
        let span = (s1 - s0).max(0.1);
        [(x1 - x0) / span, (y1 - y0) / span]
    }
}

/// Position, velocity and acceleration at `t` in \[0, 1\] on the cubic from `x0` with slope `m0` to `x1` with
/// slope `m1`, `length` steps long.
fn hermite([x0, m0, x1, m1]: [f64; 4], t: f64, length: f64) -> [f64; 3] {
    let way = x1 - x0;
    let (a, b) = (m0 * length - way, way - m1 * length);
    // x0 + way t + t (1 − t) (a (1 − t) + b t)
    let bend = a * (1.0 - t) + b * t;
    let slope = way + (1.0 - 2.0 * t) * bend + t * (1.0 - t) * (b - a);
    let curve = -2.0 * bend + 2.0 * (1.0 - 2.0 * t) * (b - a);
    [x0 + way * t + t * (1.0 - t) * bend, slope / length, curve / (length * length)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_NS: u64 = 10_000_000;
    const BASE: Stamp = Stamp(1_000_000_000);

    fn straight(steps: usize) -> RefinedPreview {
        let points: Vec<_> = (0..=steps).map(|i| [0.001 * i as f64, -0.002 * i as f64]).collect();
        RefinedPreview::of(STEP_NS, BASE, &points)
    }

    fn references<const N: usize>(
        preview: &RefinedPreview,
        now: Stamp,
        ahead_ns: u64,
        led_ns: u64,
    ) -> [[AxisState; N]; 2] {
        Reference::leading(STEP_NS, led_ns, 0.01).references(preview, now, ahead_ns).unwrap()
    }

    #[test]
    fn references_lie_dead_time_and_age_ahead_of_the_newest_grid_point() {
        let preview = straight(40);
        let [xs, ys] = references::<10>(&preview, Stamp(1_004_000_000), 35_000_000, 0);
        // lead = (4 + 35) / 10 = 3.9 steps; the first reference is one step later.
        assert!((xs[0].position - 0.0049).abs() < 1e-15);
        assert!((ys[9].position + 0.0278).abs() < 1e-15);
        assert!((xs[4].velocity - 0.1).abs() < 1e-12);
        assert!(xs[4].acceleration.abs() < 1e-9);
    }

    #[test]
    fn references_that_lead_are_where_the_predicted_velocity_takes_them() {
        let (now, ahead_ns) = (Stamp(1_000_000_000), 50_000_000);
        let [xs, ys] = references::<10>(&straight(12), now, ahead_ns, 0);
        let [led_xs, led_ys] = references::<10>(&straight(12), now, ahead_ns, 25_000_000);
        // 0.1 m/s and −0.2 m/s for 25 ms.
        assert!((led_xs[0].position - xs[0].position - 0.0025).abs() < 1e-12);
        assert!((led_ys[0].position - ys[0].position + 0.005).abs() < 1e-12);
        assert_eq!(led_xs[0].velocity, xs[0].velocity);
        let beyond = |led_ns| references::<1>(&straight(12), now, 145_000_000, led_ns);
        assert_eq!(beyond(25_000_000), beyond(0), "where the pen stands, so does the arm");
    }

    #[test]
    fn beyond_the_preview_the_pen_stands_still() {
        let preview = straight(12);
        let [xs, _] = references::<10>(&preview, BASE, 50_000_000, 0);
        assert_eq!(xs[9].position, 0.012);
        assert_eq!(xs[9].velocity, 0.0);
    }

    /// Against differences over 0.2 ms, between knots; the plan's steps differ from the grid's.
    #[test]
    fn references_move_with_the_velocity_and_acceleration_that_they_have() {
        let wave = |i: u32| [0.003 * (f64::from(i) * 0.4).sin(), 0.002 * (f64::from(i) * 0.3).cos()];
        let preview = RefinedPreview::of(STEP_NS, BASE, &(0..=30).map(wave).collect::<Vec<_>>());
        let (plan_step_s, dt_ns) = (0.0173, 100_000);
        let at = |ns: u64| -> [[AxisState; 5]; 2] {
            Reference::leading(STEP_NS, 0, plan_step_s).references(&preview, BASE + ns, 3_000_000).unwrap()
        };
        let mut curved = 0.0_f64;
        for ns in (0..100_000_000).step_by(1_700_000) {
            let [before, now, after] = [ns, ns + dt_ns, ns + 2 * dt_ns].map(at);
            for i in 0..5 {
                // Acceleration is discontinuous where cubic segments meet.
                let grid = |ns: u64| (ns as f64 + 3e6 + (i + 1) as f64 * plan_step_s * 1e9) / STEP_NS as f64;
                if grid(ns).floor() != grid(ns + 2 * dt_ns).floor() {
                    continue;
                }
                for axis in 0..2 {
                    let [a, b, c] = [before, now, after].map(|states| states[axis][i]);
                    let span_s = 2e-9 * dt_ns as f64;
                    assert!(((c.position - a.position) / span_s - b.velocity).abs() < 1e-5, "{a:?} {c:?}");
                    let curve = (c.velocity - a.velocity) / span_s;
                    assert!((curve - b.acceleration).abs() < 1e-6, "{curve} {b:?}");
                    curved = curved.max(curve.abs());
                }
            }
            // The reference one plan step later is the next.
            let [xs, ys] = at(ns + 17_300_000);
            for ((now, later), axis) in at(ns).iter().zip([xs, ys]).zip(0..) {
                for (next, first) in now[1..].iter().zip(&later) {
                    assert!(
                        (next.position - first.position).abs() < 1e-12,
                        "axis {axis}: {next:?} {first:?}"
                    );
                }
            }
        }
        assert!(curved > 3.0, "{curved} m/s²");
    }

    #[test]
    fn references_move_continuously_with_time() {
        let points: Vec<_> = (0..=30).map(|i| [0.003 * (f64::from(i) * 0.4).sin(), 0.0]).collect();
        let preview = RefinedPreview::of(STEP_NS, BASE, &points);
        let mut last = references::<10>(&preview, BASE, 0, 0);
        for ns in (0..30_000_000).step_by(100_000) {
            let next = references::<10>(&preview, BASE + ns, 0, 0);
            for (a, b) in last[0].iter().zip(&next[0]) {
                assert!((a.position - b.position).abs() < 2e-5);
                assert!((a.velocity - b.velocity).abs() < 2e-3);
            }
            last = next;
        }
    }
}
