//! From a preview on the grid to the references of the plan, at the instants the arm will be there.
//!
//! Contract: no memory of its own beyond the last preview; positions in the plane frame [m].

use crate::pen::PenReading;
use crate::predict::bands::PreviewBands;
use crate::predict::{MAX_PREVIEW, PreviewReport, Previewer};
use crate::skill::Skill;
use crate::units::{AxisState, Stamp};

/// Longest time between samples that a device may be used to [ns]; longer ones are pauses.
const LONGEST_INTERVAL_NS: u64 = 40_000_000;
/// No device is taken to be silent sooner [ns].
const LEAST_PATIENCE_NS: u64 = 20_000_000;

/// References lead by the mean velocity of so many steps before and after: how neighbouring predictions differ is noisier than
/// they are. Least error for the lag taken out on ten train writers of unipen-tos behind 30 ms, among 0 to 12.
const VELOCITY_STEPS: f64 = 3.5;

/// The newest preview, kept between grid steps, because most ticks close none.
#[derive(Debug, Clone)]
pub(crate) struct Preview {
    step_ns: u64,
    /// Steps that there is room for, and those of the newest preview.
    most: usize,
    steps: usize,
    /// References lie this many steps of the predicted velocity farther on.
    velocity_lead: f64,
    /// The grid point before entry 0 of `path`.
    before: [f64; 2],
    /// Entry 0 is the newest closed grid point, entry i the predicted position i steps later.
    path: [[f64; 2]; MAX_PREVIEW + 1],
    /// What is followed: the same, moved by what samples newer than entry 0 say, and believed as far as it pays. Entry 0
    /// is the newest sample then, `origin` steps after the base; 0 where the preview is taken as it is.
    used: [[f64; 2]; MAX_PREVIEW + 1],
    origin: f64,
    /// The sample that `used` is up to date with, and whether it was believed per step.
    corrected: Option<(Stamp, bool)>,
    /// The newest sample, and the usual time between samples [ns].
    heard: Option<(Stamp, [f64; 2])>,
    interval_ns: u64,
    base: Option<Stamp>,
    finite: bool,
    bands: Option<PreviewBands>,
}

impl Preview {
    /// Up to `steps` ≤ [`MAX_PREVIEW`] predicted steps of `step_ns`.
    pub(crate) fn new(step_ns: u64, steps: usize) -> Self {
        Self {
            step_ns,
            most: steps.min(MAX_PREVIEW),
            steps: steps.min(MAX_PREVIEW),
            velocity_lead: 0.0,
            before: [0.0; 2],
            path: [[0.0; 2]; MAX_PREVIEW + 1],
            used: [[0.0; 2]; MAX_PREVIEW + 1],
            origin: 0.0,
            corrected: None,
            heard: None,
            interval_ns: step_ns,
            base: None,
            finite: true,
            bands: None,
        }
    }

    /// The same with references `ns` of the predicted velocity farther on than the pen is predicted. What is foreseen badly is
    /// foreseen late, in the mean: of all ways to take that lag out, this one adds least error, because the predicted velocity is
    /// what is known of the true one.
    pub(crate) fn leading(self, ns: u64) -> Self {
        Self { velocity_lead: ns as f64 / self.step_ns as f64, ..self }
    }

    /// Rolls the predictor out anew, `steps` far if there is room.
    pub(crate) fn refresh(&mut self, previewer: &Previewer, steps: usize) {
        self.steps = steps.min(self.most);
        let Some((first, rest)) = self.path.split_first_mut() else { return };
        let Some(predicted) = rest.get_mut(..self.steps) else { return };
        if let Some(PreviewReport { base_index, base_position, finite, bands, .. }) =
            previewer.preview(predicted)
        {
            *first = base_position;
            let ([x, y], [dx, dy]) =
                (base_position, previewer.newest().map_or([0.0; 2], |step| step.displacement));
            self.before = [x - dx, y - dy];
            self.base = Some(Stamp(base_index.saturating_mul(self.step_ns)));
            self.finite = finite;
            self.bands = Some(bands);
            self.raw();
            self.corrected = None;
        }
    }

    /// The predicted positions [m], the first one step after the base.
    pub(crate) fn predicted(&self) -> &[[f64; 2]] {
        self.path.get(1..=self.steps).unwrap_or_default()
    }

    /// Base of the preview [m].
    pub(crate) fn base_position(&self) -> [f64; 2] {
        let [base, ..] = self.path;
        base
    }

    /// Moves the preview by what `newest` says and shortens it to the shares that `skill` justifies, if `per_step`.
    pub(crate) fn correct(&mut self, newest: &PenReading, skill: &mut Skill, per_step: bool) {
        self.hear(newest);
        let Some(base) = self.base else { return };
        let seen = Some((newest.stamp, per_step));
        if self.corrected == seen {
            return;
        }
        self.corrected = seen;
        let phase = newest.stamp.since(base) as f64 / self.step_ns as f64;
        if phase >= 1.5 {
            // The preview knows nothing of this sample, as after a pause.
            self.used = [newest.position; MAX_PREVIEW + 1];
            self.origin = 0.0;
            return;
        }
        if !(phase >= 0.0) {
            self.raw();
            return;
        }
        let expected = self.expected(phase);
        skill.sample(newest.stamp, newest.position, phase, expected);
        if !per_step {
            self.raw();
            return;
        }
        let moved = self.used.iter_mut().zip(&self.path).take(self.steps + 1);
        for (lead, (used, predicted)) in moved.enumerate().skip(1) {
            *used = skill.believed(phase, lead, *predicted);
        }
        self.used[0] = newest.position;
        self.origin = phase;
    }

    fn hear(&mut self, newest: &PenReading) {
        let elapsed_ns = self.heard.map_or(0, |(heard, _)| newest.stamp.0.saturating_sub(heard.0));
        if (1..=LONGEST_INTERVAL_NS).contains(&elapsed_ns) {
            self.interval_ns = self.interval_ns - self.interval_ns / 8 + elapsed_ns / 8;
        }
        self.heard = Some((newest.stamp, newest.position));
    }

    /// Where the pen is taken to have come to rest [m]: devices that are silent for longer than they usually are have nothing to tell.
    fn silent_at(&self, now: Stamp) -> Option<[f64; 2]> {
        let patience_ns = (self.interval_ns * 5 / 2).max(LEAST_PATIENCE_NS);
        let (_, position) = self.heard.filter(|(heard, _)| now.0.saturating_sub(heard.0) > patience_ns)?;
        Some(position)
    }

    fn raw(&mut self) {
        self.used = self.path;
        self.origin = 0.0;
    }

    /// The preview `phase` steps after its base: on the parabola through the point before the base, the base and the first
    /// predicted point, so that a curve that was foreseen is no news.
    fn expected(&self, phase: f64) -> [f64; 2] {
        let [[x0, y0], [x1, y1], ..] = self.path;
        let [bx, by] = self.before;
        let along = |before: f64, here: f64, next: f64| {
            here + phase * (0.5 * (next - before) + phase * (0.5 * (next + before) - here))
        };
        [along(bx, x0, x1), along(by, y0, y1)]
    }

    /// The predictor's numbers were usable.
    pub(crate) fn is_finite(&self) -> bool {
        self.finite
    }

    /// Displacement predicted for the step after the newest closed one [m].
    pub(crate) fn next_displacement(&self) -> Option<[f64; 2]> {
        self.base?;
        let [[x0, y0], [x1, y1], ..] = self.path;
        Some([x1 - x0, y1 - y0])
    }

    /// References at `now` + dead time + i·`plan_step_s`, i = 1..N, for the plane's x and y.
    ///
    /// On cubic pieces through the newest sample and the predicted grid points, with the slopes of their neighbours: a kink
    /// at every grid point would cost a sharp plan more jerk than the letter does. Beyond the last predicted point the pen is
    /// taken to stand still; where samples stay away it is taken to have stopped at the last one.
    pub(crate) fn references<const N: usize>(
        &self,
        now: Stamp,
        dead_time_ns: u64,
        plan_step_s: f64,
    ) -> Option<[[AxisState; N]; 2]> {
        let base = self.base?;
        let step_s = self.step_ns as f64 * 1e-9;
        let lead = self.lead(base, now, dead_time_ns);
        let stride = plan_step_s / step_s;
        if let Some([x, y]) = self.silent_at(now) {
            return Some([[AxisState::at_rest(x); N], [AxisState::at_rest(y); N]]);
        }
        let mut xs = [AxisState::default(); N];
        let mut ys = [AxisState::default(); N];
        for (i, (x, y)) in xs.iter_mut().zip(&mut ys).enumerate() {
            let s = lead + (i + 1) as f64 * stride;
            let ([at_x, at_y], [further_x, further_y]) = (self.at(s), self.further(s));
            let si = |[position, velocity, acceleration]: [f64; 3], further: f64| AxisState {
                position: position + further,
                velocity: velocity / step_s,
                acceleration: acceleration / (step_s * step_s),
            };
            (*x, *y) = (si(at_x, further_x), si(at_y, further_y));
        }
        Some([xs, ys])
    }

    /// Radius [m] around the first reference within which the pen is expected in nine of ten cases, if that is known.
    pub(crate) fn band(&self, now: Stamp, dead_time_ns: u64) -> Option<f64> {
        self.bands?.at(self.lead(self.base?, now, dead_time_ns) + 1.0)
    }

    /// Radius [m] around the predicted point `lead` steps after the base, as [`Preview::band`].
    pub(crate) fn claimed(&self, lead: usize) -> Option<f64> {
        self.bands?.at(lead as f64)
    }

    /// From the newest closed grid point to `now` + dead time [steps].
    fn lead(&self, base: Stamp, now: Stamp, dead_time_ns: u64) -> f64 {
        (now.since(base) as f64 + dead_time_ns as f64) / self.step_ns as f64
    }

    /// Position [m], velocity [m/step] and acceleration [m/step²] of x and y, `s` steps after the base; at rest at both ends.
    fn at(&self, s: f64) -> [[f64; 3]; 2] {
        let point = |index: usize| self.used.get(index.min(self.steps)).copied().unwrap_or_default();
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

    /// What the predicted velocity around `s` adds to a reference [m].
    fn further(&self, s: f64) -> [f64; 2] {
        let (from, to) = ((s - VELOCITY_STEPS).max(self.origin), (s + VELOCITY_STEPS).min(self.steps as f64));
        if !(self.velocity_lead > 0.0 && to > from) {
            return [0.0; 2];
        }
        let ([[x0, ..], [y0, ..]], [[x1, ..], [y1, ..]]) = (self.at(from), self.at(to));
        [x1 - x0, y1 - y0].map(|way| self.velocity_lead * way / (to - from))
    }

    /// Index of the first predicted point after the newest sample, and not so close that noise between them would count.
    fn first(&self) -> usize {
        (self.origin + 0.1) as usize + 1
    }

    /// Slope at a point: that of the line between its neighbours; at the ends that to the only neighbour [m/step].
    fn slope(&self, index: usize) -> [f64; 2] {
        let first = self.first();
        let knot = |index: usize| if index < first { (0, self.origin) } else { (index, index as f64) };
        let (before, after) = (knot(index.max(1) - 1), knot((index + 1).max(first).min(self.steps)));
        let ((i0, s0), (i1, s1)) = (before, after);
        let ([x0, y0], [x1, y1]) =
            (self.used.get(i0).copied().unwrap_or_default(), self.used.get(i1).copied().unwrap_or_default());
        let span = (s1 - s0).max(0.1);
        [(x1 - x0) / span, (y1 - y0) / span]
    }
}

/// Position, velocity and acceleration at `t` in [0, 1] on the cubic from `x0` with slope `m0` to `x1` with slope `m1`, `length`
/// steps long.
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

    fn straight(steps: usize) -> Preview {
        let mut preview = Preview::new(10_000_000, steps);
        for (i, point) in preview.path.iter_mut().enumerate() {
            *point = [0.001 * i as f64, -0.002 * i as f64];
        }
        preview.base = Some(Stamp(1_000_000_000));
        preview.used = preview.path;
        preview
    }

    #[test]
    fn references_lie_dead_time_and_age_ahead_of_the_newest_grid_point() {
        let preview = straight(40);
        let [xs, ys] = preview.references::<10>(Stamp(1_004_000_000), 35_000_000, 0.01).unwrap();
        // lead = (4 + 35) / 10 = 3.9 steps; the first reference is one step later.
        assert!((xs[0].position - 0.0049).abs() < 1e-15);
        assert!((ys[9].position + 0.0278).abs() < 1e-15);
        assert!((xs[4].velocity - 0.1).abs() < 1e-12);
        assert!(xs[4].acceleration.abs() < 1e-9);
    }

    #[test]
    fn references_that_lead_are_where_the_predicted_velocity_takes_them() {
        let (now, ahead_ns) = (Stamp(1_000_000_000), 50_000_000);
        let [xs, ys] = straight(12).references::<10>(now, ahead_ns, 0.01).unwrap();
        let [led_xs, led_ys] =
            straight(12).leading(25_000_000).references::<10>(now, ahead_ns, 0.01).unwrap();
        // 0.1 m/s and −0.2 m/s for 25 ms.
        assert!((led_xs[0].position - xs[0].position - 0.0025).abs() < 1e-12);
        assert!((led_ys[0].position - ys[0].position + 0.005).abs() < 1e-12);
        assert_eq!(led_xs[0].velocity, xs[0].velocity);
        let beyond = |preview: Preview| preview.references::<1>(now, 145_000_000, 0.01).unwrap();
        assert_eq!(
            beyond(straight(12).leading(25_000_000)),
            beyond(straight(12)),
            "where the pen stands, so does the arm"
        );
    }

    #[test]
    fn beyond_the_preview_the_pen_stands_still() {
        let preview = straight(12);
        let [xs, _] = preview.references::<10>(Stamp(1_000_000_000), 50_000_000, 0.01).unwrap();
        assert_eq!(xs[9].position, 0.012);
        assert_eq!(xs[9].velocity, 0.0);
    }

    #[test]
    fn references_move_continuously_with_time() {
        let mut preview = straight(30);
        for (i, point) in preview.path.iter_mut().enumerate() {
            *point = [0.003 * (i as f64 * 0.4).sin(), 0.0];
        }
        preview.used = preview.path;
        let mut last = preview.references::<10>(Stamp(1_000_000_000), 0, 0.01).unwrap();
        for ns in (0..30_000_000).step_by(100_000) {
            let next = preview.references::<10>(Stamp(1_000_000_000 + ns), 0, 0.01).unwrap();
            for (a, b) in last[0].iter().zip(&next[0]) {
                assert!((a.position - b.position).abs() < 2e-5);
                assert!((a.velocity - b.velocity).abs() < 2e-3);
            }
            last = next;
        }
    }

    fn told(stamp: u64, position: [f64; 2]) -> PenReading {
        PenReading { stamp: Stamp(stamp), position, contact: true, origin: Default::default() }
    }

    #[test]
    fn pen_whose_samples_stay_away_has_stopped_at_the_last_one() {
        for interval_ns in [5_000_000, 16_000_000] {
            let mut preview = straight(40);
            let mut stamp = 1_000_000_000 - 40 * interval_ns;
            for _ in 0..41 {
                preview.hear(&told(stamp, [0.0007, -0.0001]));
                stamp += interval_ns;
            }
            let newest = stamp - interval_ns;
            let patience = (interval_ns * 5 / 2).max(20_000_000);
            let moving = |after| {
                let [xs, _] = preview.references::<10>(Stamp(newest + after), 30_000_000, 0.01).unwrap();
                xs[0].velocity != 0.0
            };
            assert!(moving(0) && moving(patience - 500_000), "{interval_ns} ns");
            assert!(!moving(patience + 500_000), "{interval_ns} ns");
            let silent = Stamp(newest + patience + 500_000);
            let [xs, ys] = preview.references::<10>(silent, 30_000_000, 0.01).unwrap();
            assert!(xs.iter().all(|x| *x == AxisState::at_rest(0.0007)));
            assert!(ys.iter().all(|y| *y == AxisState::at_rest(-0.0001)));
        }
    }

    #[test]
    fn preview_from_before_a_pause_says_nothing_of_what_comes_after() {
        for per_step in [false, true] {
            let mut preview = straight(40);
            let mut skill = Skill::new(0.01, per_step);
            let after = told(1_150_000_000, [0.05, 0.02]);
            preview.correct(&after, &mut skill, per_step);
            let [xs, ys] = preview.references::<10>(Stamp(1_151_000_000), 0, 0.01).unwrap();
            assert!(xs.iter().all(|x| x.position == 0.05 && x.velocity == 0.0), "{xs:?}");
            assert!(ys.iter().all(|y| y.position == 0.02 && y.velocity == 0.0), "{ys:?}");
        }
    }
}
