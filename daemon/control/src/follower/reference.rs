//! From a preview on the grid to the references of the plan, at the instants the arm will be there.
//!
//! Contract: no memory of its own beyond the last preview; positions in the plane frame [m].

use crate::pen::PenReading;
use crate::predict::bands::PreviewBands;
use crate::predict::{MAX_PREVIEW, PreviewReport, Previewer};
use crate::trust::Evidence;
use crate::units::{AxisState, Stamp};

/// The newest preview, kept between grid steps, because most ticks close none.
#[derive(Debug, Clone)]
pub(super) struct Preview {
    step_ns: u64,
    /// Steps that there is room for, and those of the newest preview.
    most: usize,
    steps: usize,
    /// Entry 0 is the newest closed grid point, entry i the predicted position i steps later.
    path: [[f64; 2]; MAX_PREVIEW + 1],
    /// The same, moved by what samples newer than entry 0 say, and believed as far as it pays.
    used: [[f64; 2]; MAX_PREVIEW + 1],
    base: Option<Stamp>,
    finite: bool,
    bands: Option<PreviewBands>,
}

impl Preview {
    /// Up to `steps` ≤ [`MAX_PREVIEW`] predicted steps of `step_ns`.
    pub(super) fn new(step_ns: u64, steps: usize) -> Self {
        Self {
            step_ns,
            most: steps.min(MAX_PREVIEW),
            steps: steps.min(MAX_PREVIEW),
            path: [[0.0; 2]; MAX_PREVIEW + 1],
            used: [[0.0; 2]; MAX_PREVIEW + 1],
            base: None,
            finite: true,
            bands: None,
        }
    }

    /// Rolls the predictor out anew, `steps` far if there is room.
    pub(super) fn refresh(&mut self, previewer: &Previewer, steps: usize) {
        self.steps = steps.min(self.most);
        let Some((first, rest)) = self.path.split_first_mut() else { return };
        let Some(predicted) = rest.get_mut(..self.steps) else { return };
        if let Some(PreviewReport { base_index, base_position, finite, bands, .. }) =
            previewer.preview(predicted)
        {
            *first = base_position;
            self.base = Some(Stamp(base_index.saturating_mul(self.step_ns)));
            self.finite = finite;
            self.bands = Some(bands);
            self.used = self.path;
        }
    }

    /// The predicted positions [m], the first one step after the base.
    pub(super) fn predicted(&self) -> &[[f64; 2]] {
        self.path.get(1..=self.steps).unwrap_or_default()
    }

    /// Base of the preview [m].
    pub(super) fn base_position(&self) -> [f64; 2] {
        let [base, ..] = self.path;
        base
    }

    /// Moves the preview by what `newest` says and shortens it to the shares that `evidence` justifies, if `per_step`.
    pub(super) fn correct(&mut self, newest: &PenReading, evidence: &mut Evidence, per_step: bool) {
        let Some(base) = self.base else { return };
        let phase = newest.stamp.since(base) as f64 / self.step_ns as f64;
        if !(0.0..1.5).contains(&phase) {
            self.used = self.path;
            return;
        }
        let [x0, y0] = self.path.first().copied().unwrap_or_default();
        let [x1, y1] = self.path.get(1).copied().unwrap_or([x0, y0]);
        let expected = [x0 + phase * (x1 - x0), y0 + phase * (y1 - y0)];
        let [ex, ey] = evidence.sample(newest.position, phase, expected);
        if !per_step {
            self.used = self.path;
            return;
        }
        let [nx, ny] = newest.position;
        let moved = self.used.iter_mut().zip(&self.path).take(self.steps + 1);
        for (lead, (used, [x, y])) in moved.enumerate().skip(1) {
            let (gain, share) = (evidence.gain(phase, lead), evidence.share(lead));
            *used = [nx + share * (x + gain * ex - nx), ny + share * (y + gain * ey - ny)];
        }
        // Entry 0 is chosen so that the line to entry 1 passes through the newest sample.
        let [first, second, ..] = &mut self.used;
        let [ux, uy] = *second;
        let part = phase.min(0.9);
        *first = [(nx - part * ux) / (1.0 - part), (ny - part * uy) / (1.0 - part)];
    }

    /// The predictor's numbers were usable.
    pub(super) fn is_finite(&self) -> bool {
        self.finite
    }

    /// Displacement predicted for the step after the newest closed one [m].
    pub(super) fn next_displacement(&self) -> Option<[f64; 2]> {
        self.base?;
        let [[x0, y0], [x1, y1], ..] = self.path;
        Some([x1 - x0, y1 - y0])
    }

    /// References at `now` + dead time + i·`plan_step_s`, i = 1..N, for the plane's x and y.
    ///
    /// Position: linear between predicted grid points. Velocity: difference of the positions half a step before and
    /// after, so that it is continuous as `now` moves on. Acceleration: difference of the velocities half a step before
    /// and after. Beyond the last predicted point the pen is taken to stand still.
    pub(super) fn references<const N: usize>(
        &self,
        now: Stamp,
        dead_time_ns: u64,
        plan_step_s: f64,
    ) -> Option<[[AxisState; N]; 2]> {
        let base = self.base?;
        let step_s = self.step_ns as f64 * 1e-9;
        let lead = self.lead(base, now, dead_time_ns);
        let stride = plan_step_s / step_s;
        let mut xs = [AxisState::default(); N];
        let mut ys = [AxisState::default(); N];
        for (i, (x, y)) in xs.iter_mut().zip(&mut ys).enumerate() {
            let s = lead + (i + 1) as f64 * stride;
            let [x0, y0] = self.at(s - 1.0);
            let [xa, ya] = self.at(s - 0.5);
            let [xm, ym] = self.at(s);
            let [xb, yb] = self.at(s + 0.5);
            let [x1, y1] = self.at(s + 1.0);
            let axis = |far_before: f64, before: f64, here: f64, after: f64, far_after: f64| AxisState {
                position: here,
                velocity: (after - before) / step_s,
                acceleration: (far_after - 2.0 * here + far_before) / (step_s * step_s),
            };
            *x = axis(x0, xa, xm, xb, x1);
            *y = axis(y0, ya, ym, yb, y1);
        }
        Some([xs, ys])
    }

    /// Radius [m] around the first reference within which the pen is expected in nine of ten cases, if that is known.
    pub(super) fn band(&self, now: Stamp, dead_time_ns: u64) -> Option<f64> {
        self.bands?.at(self.lead(self.base?, now, dead_time_ns) + 1.0)
    }

    /// From the newest closed grid point to `now` + dead time [steps].
    fn lead(&self, base: Stamp, now: Stamp, dead_time_ns: u64) -> f64 {
        (now.since(base) as f64 + dead_time_ns as f64) / self.step_ns as f64
    }

    /// Position `s` steps after the newest closed grid point, held at both ends.
    fn at(&self, s: f64) -> [f64; 2] {
        let last = self.steps as f64;
        let s = if s > 0.0 { s.min(last) } else { 0.0 };
        let below = s.floor();
        let part = s - below;
        let index = below as usize;
        let [x0, y0] = self.used.get(index).copied().unwrap_or_default();
        let [x1, y1] = self.used.get((index + 1).min(self.steps)).copied().unwrap_or([x0, y0]);
        [x0 + part * (x1 - x0), y0 + part * (y1 - y0)]
    }
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
}
