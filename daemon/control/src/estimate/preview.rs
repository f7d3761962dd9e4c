//! The preview in force: as predicted, and as followed after refinement.
//!
//! Contract: fixed size, no allocation, total. Positions in the plane frame \[m\].

use super::LEADS;
use super::record::NewPreview;
use super::refine::{Refinement, Refiner};
use crate::pen::PenReading;
use crate::predict::bands::PreviewBands;
use crate::predict::{MAX_PREVIEW, PreviewReport, Previewer};
use crate::state::state;
use crate::units::Stamp;

/// The newest preview, kept between grid steps, because most ticks close none.
#[derive(Debug, Clone)]
pub(crate) struct RefinedPreview {
    step_ns: u64,
    /// Capacity in steps, and steps of the newest preview.
    most: usize,
    steps: usize,
    /// Displacement that led to entry 0 of `path` \[m per step\].
    pub(crate) velocity: [f64; 2],
    /// Entry 0 is the newest closed grid point, entry i the predicted position i steps later.
    path: [[f64; 2]; MAX_PREVIEW + 1],
    /// The path to be followed: the same, corrected by samples newer than entry 0 and shrunk to its shares.
    /// Entry 0 is then the newest sample, `origin` steps after the base; 0 if the preview is used as it is.
    used: [[f64; 2]; MAX_PREVIEW + 1],
    pub(crate) origin: f64,
    /// The sample up to which `used` is refined, and whether per step.
    refined: Option<(Stamp, bool)>,
    /// The newest closed grid point when it was made; `None` before the first.
    pub(crate) base: Option<Stamp>,
    /// The predictor's output was finite.
    pub(crate) finite: bool,
    bands: Option<PreviewBands>,
}

/// Where a sample lies in a preview.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Noted {
    /// Before its base, which was made by newer ones.
    Before,
    /// In its first step.
    Within(Refinement),
    /// After that: the preview says nothing of it.
    After,
}

state! {
    [] RefinedPreview { steps, velocity, path, used, origin, refined, base, finite, bands }
    fixed { step_ns, most }
}

impl RefinedPreview {
    /// Up to `steps` ≤ [`MAX_PREVIEW`] predicted steps of `step_ns`.
    pub(crate) fn new(step_ns: u64, steps: usize) -> Self {
        Self {
            step_ns,
            most: steps.min(MAX_PREVIEW),
            steps: steps.min(MAX_PREVIEW),
            velocity: [0.0; 2],
            path: [[0.0; 2]; MAX_PREVIEW + 1],
            used: [[0.0; 2]; MAX_PREVIEW + 1],
            origin: 0.0,
            refined: None,
            base: None,
            finite: true,
            bands: None,
        }
    }

    /// Computes the preview again, `steps` far if there is room.
    pub(crate) fn refresh(&mut self, previewer: &Previewer, steps: usize) {
        let _ = self.refresh_by(previewer, steps, Previewer::preview);
    }

    /// The same, as `predict` makes it; whether it made one.
    pub(crate) fn refresh_by(
        &mut self,
        previewer: &Previewer,
        steps: usize,
        predict: impl FnOnce(&Previewer, &mut [[f64; 2]]) -> Option<PreviewReport>,
    ) -> bool {
        self.steps = steps.min(self.most);
        let Some((first, rest)) = self.path.split_first_mut() else { return false };
        let Some(predicted) = rest.get_mut(..self.steps) else { return false };
        if let Some(PreviewReport { base_index, base_position, finite, bands, .. }) =
            predict(previewer, predicted)
        {
            *first = base_position;
            self.velocity = previewer.newest().map_or([0.0; 2], |step| step.displacement);
            self.base = Some(Stamp(base_index.saturating_mul(self.step_ns)));
            self.finite = finite;
            self.bands = Some(bands);
            self.take_as_it_is();
            self.refined = None;
            return true;
        }
        false
    }

    /// What is to be followed: between what two previews from the same base came to, `part` of the way from
    /// `own` to `theirs`.
    pub(super) fn blend(&mut self, own: &Self, theirs: &Self, part: f64) {
        let nearer = if part < 1.0 { own } else { theirs };
        (self.used, self.origin, self.refined) = (nearer.used, nearer.origin, nearer.refined);
        if part > 0.0 && part < 1.0 {
            for ([x, y], [tx, ty]) in self.used.iter_mut().zip(&theirs.used) {
                (*x, *y) = (*x + part * (tx - *x), *y + part * (ty - *y));
            }
        }
    }

    /// The next sample refines it again, whichever that is.
    pub(super) fn refine_again(&mut self) {
        self.refined = None;
    }

    /// Where the `newest` sample, if it was not seen before, lies in the preview; `per_step`: whether that is
    /// to correct it.
    pub(super) fn note(&mut self, newest: &PenReading, refiner: &Refiner, per_step: bool) -> Option<Noted> {
        let base = self.base?;
        let seen = Some((newest.stamp, per_step));
        if self.refined == seen {
            return None;
        }
        self.refined = seen;
        let phase = newest.stamp.since(base) as f64 / self.step_ns as f64;
        if phase >= refiner.latest_phase() {
            return Some(Noted::After);
        }
        if !(phase >= 0.0) {
            return Some(Noted::Before);
        }
        Some(Noted::Within(refiner.refinement(newest.position, phase, self.expected(phase))))
    }

    /// Corrects the preview by the sample at `newest` \[m\], as it was `noted`, and shrinks it to `shares`
    /// per lead; without shares it is used as it is. The way to it is shortened to the share `governor`.
    pub(super) fn draw(
        &mut self,
        newest: [f64; 2],
        noted: &Noted,
        refiner: &Refiner,
        shares: Option<&[f64; LEADS]>,
        governor: f64,
    ) {
        let (refinement, shares) = match (noted, shares) {
            (Noted::After, _) => {
                self.used = [newest; MAX_PREVIEW + 1];
                self.origin = 0.0;
                return;
            }
            (Noted::Within(refinement), Some(shares)) => (refinement, shares),
            (Noted::Before, _) | (Noted::Within(_), None) => {
                self.take_as_it_is();
                self.shorten(newest, governor);
                return;
            }
        };
        let moved = self.used.iter_mut().zip(&self.path).take(self.steps + 1);
        for (lead, (used, predicted)) in moved.enumerate().skip(1) {
            let share = governor * shares.get(lead.min(LEADS) - 1).copied().unwrap_or(0.0);
            *used = refiner.refined(refinement, lead, *predicted, share);
        }
        let [first, ..] = &mut self.used;
        *first = newest;
        self.origin = refinement.phase;
    }

    /// Draws the path towards `newest` \[m\], down to `share` of the way from there.
    fn shorten(&mut self, newest: [f64; 2], share: f64) {
        if share < 1.0 {
            let towards = |x: f64, newest: f64| newest + share * (x - newest);
            let ([nx, ny], steps) = (newest, self.steps);
            self.used
                .iter_mut()
                .take(steps + 1)
                .for_each(|[x, y]| (*x, *y) = (towards(*x, nx), towards(*y, ny)));
        }
    }

    fn take_as_it_is(&mut self) {
        self.used = self.path;
        self.origin = 0.0;
    }

    /// The preview `phase` steps after its base: on the parabola through the point before the base, the base
    /// and the first predicted point, so that a predicted curve causes no innovation.
    fn expected(&self, phase: f64) -> [f64; 2] {
        let [[x0, y0], [x1, y1], ..] = self.path;
        let [dx, dy] = self.velocity;
        let along = |before: f64, here: f64, next: f64| {
            here + phase * (0.5 * (next - before) + phase * (0.5 * (next + before) - here))
        };
        [along(x0 - dx, x0, x1), along(y0 - dy, y0, y1)]
    }

    /// Position there \[m\].
    pub(crate) fn base_position(&self) -> [f64; 2] {
        let [base, ..] = self.path;
        base
    }

    /// For the record of what it is worth.
    pub(super) fn made(&self) -> NewPreview<'_> {
        NewPreview { base: self.base_position(), path: self.predicted() }
    }

    /// The predicted positions \[m\] as the predictor gave them, the first one step after the base.
    pub(crate) fn predicted(&self) -> &[[f64; 2]] {
        self.path.get(1..=self.steps).unwrap_or_default()
    }

    /// The path to be followed \[m\]: the pen at `origin` steps after the base, then its expected
    /// position at each step.
    pub(crate) fn followed(&self) -> &[[f64; 2]] {
        self.used.get(..=self.steps).unwrap_or_default()
    }

    /// Displacement predicted for the step after the newest closed one \[m\].
    pub(crate) fn next_displacement(&self) -> Option<[f64; 2]> {
        self.base?;
        let [[x0, y0], [x1, y1], ..] = self.path;
        Some([x1 - x0, y1 - y0])
    }

    /// Radius \[m\] around the predicted point `lead` steps after the base within which the pen is expected
    /// in nine of ten cases, if known.
    pub(crate) fn band(&self, lead: f64) -> Option<f64> {
        self.bands?.at(lead)
    }

    /// From the base to `ns` after `now` \[steps\].
    pub(crate) fn lead(&self, now: Stamp, ns: u64) -> Option<f64> {
        Some((now.since(self.base?) as f64 + ns as f64) / self.step_ns as f64)
    }

    /// Grid step \[s\].
    pub(crate) fn step_s(&self) -> f64 {
        self.step_ns as f64 * 1e-9
    }
}

#[cfg(test)]
impl RefinedPreview {
    /// Notes a sample and draws the path; whether it was new and belongs to the preview.
    fn refine(
        &mut self,
        newest: &PenReading,
        refiner: &Refiner,
        shares: Option<&[f64; LEADS]>,
        governor: f64,
    ) -> bool {
        let noted = self.note(newest, refiner, shares.is_some());
        noted.iter().for_each(|noted| self.draw(newest.position, noted, refiner, shares, governor));
        matches!(noted, Some(Noted::Within(_)))
    }

    /// One of `points` \[m\] from the base at `base` on, used as it is.
    pub(crate) fn of(step_ns: u64, base: Stamp, points: &[[f64; 2]]) -> Self {
        let mut preview = Self::new(step_ns, points.len() - 1);
        preview.path[..points.len()].copy_from_slice(points);
        preview.base = Some(base);
        preview.take_as_it_is();
        preview
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn preview_from_before_a_pause_says_nothing_of_what_comes_after() {
        let points: [[f64; 2]; 41] = std::array::from_fn(|i| [0.001 * i as f64, -0.002 * i as f64]);
        for shares in [None, Some(&[1.0; LEADS])] {
            let mut preview = RefinedPreview::of(10_000_000, Stamp(1_000_000_000), &points);
            let refiner = Refiner::new(0.01);
            let after = PenReading::new(Stamp(1_150_000_000), [0.05, 0.02], true);
            assert!(!preview.refine(&after, &refiner, shares, 1.0));
            assert!(preview.followed().iter().all(|point| *point == after.position));
        }
    }

    #[test]
    fn a_sample_refines_once_and_moves_what_is_followed_from_there_on() {
        let points: [[f64; 2]; 21] = std::array::from_fn(|i| [0.001 * i as f64, 0.0]);
        let mut preview = RefinedPreview::of(10_000_000, Stamp(1_000_000_000), &points);
        let mut refiner = Refiner::new(0.01);
        let sample = PenReading::new(Stamp(1_004_000_000), [0.0005, 0.0001], true);
        refiner.observe(sample.stamp, sample.position);
        assert!(preview.refine(&sample, &refiner, Some(&[0.5; LEADS]), 1.0));
        assert!(!preview.refine(&sample, &refiner, Some(&[0.5; LEADS]), 1.0));
        assert_eq!(preview.followed().first(), Some(&sample.position));
        assert!((preview.origin - 0.4).abs() < 1e-12);
        // Used as it is again, with the same sample.
        assert!(preview.refine(&sample, &refiner, None, 1.0));
        assert_eq!(preview.followed(), &points);
        assert_eq!(preview.origin, 0.0);
    }

    /// With and without corrections, and where the newest sample is older than the preview.
    #[test]
    fn the_governor_shortens_the_way_from_the_newest_sample_and_turns_it_nowhere() {
        let points: [[f64; 2]; 21] = std::array::from_fn(|i| [0.001 * i as f64, 2e-5 * (i * i) as f64]);
        for (stamp, shares) in [(4_000_000, Some(&[0.8; LEADS])), (4_000_000, None), (-2_000_000_i64, None)] {
            let stamp = Stamp(1_000_000_000_u64.saturating_add_signed(stamp));
            let sample = PenReading::new(stamp, [0.0005, 0.0001], true);
            let followed = |governor: f64| {
                let mut preview = RefinedPreview::of(10_000_000, Stamp(1_000_000_000), &points);
                let mut refiner = Refiner::new(0.01);
                refiner.measure(1e-4);
                refiner.observe(sample.stamp, sample.position);
                preview.refine(&sample, &refiner, shares, governor);
                (preview.origin, preview.followed().to_vec())
            };
            let (origin, all) = followed(1.0);
            assert_eq!(all.len(), points.len());
            for governor in [0.1, 0.4, 1.0] {
                let (same, shortened) = followed(governor);
                assert_eq!(same, origin, "time is not shortened");
                for (all, shortened) in all.iter().zip(&shortened) {
                    for axis in 0..2 {
                        let from = sample.position[axis];
                        let expected = from + governor * (all[axis] - from);
                        assert!((shortened[axis] - expected).abs() < 1e-15, "{governor}: {shortened:?}");
                    }
                }
            }
        }
    }
}
