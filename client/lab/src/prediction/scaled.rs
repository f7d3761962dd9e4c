//! [`Scaled`]: a contestant that wants normalised displacements, fed from raw units through the running scale
//! of the loop.
//!
//! The scale is the daemon's own [`SpeedScale`] with raw units in place of metres. It starts from the first
//! moving step of the set, since an unknown device gives no better guess, and carries over from sequence to
//! sequence.

use foretrace_control::pen::{GridStep, Motion, SpeedScale, SpeedScaleSettings, TARGET_RMS};

use super::model::Contestant;

/// Largest relative change per step: faster than in the loop, because there is no initial guess to start
/// from.
const MAX_CHANGE: f64 = 0.25;
/// How far the scale may move from its first value, either way.
const RANGE: f64 = 1e6;

/// The running scale of an unknown device.
#[derive(Debug, Clone, Default)]
pub struct RunningScale(Option<SpeedScale>);

impl RunningScale {
    /// Follows one displacement \[raw units\].
    pub fn observe(&mut self, v: [f64; 2]) {
        let length = v[0].hypot(v[1]);
        if self.0.is_none() && length > 0.0 && length.is_finite() {
            self.0 = SpeedScale::new(settings(length)).ok();
        }
        if let Some(scale) = &mut self.0 {
            scale.observe(&GridStep { displacement: v, motion: Motion::Continues, ..GridStep::default() });
        }
    }

    /// Raw units per normalised unit; 1 before the pen moves.
    #[must_use]
    pub fn raw_per_unit(&self) -> f64 {
        self.0.as_ref().map_or(1.0, SpeedScale::metres_per_unit)
    }
}

/// Raw units outside, displacements of a known RMS inside.
#[derive(Debug, Clone)]
pub struct Scaled<C> {
    inner: C,
    /// RMS per component of moving steps that `inner` is made for.
    rms: f64,
    scale: RunningScale,
}

impl<C> Scaled<C> {
    /// Wraps `inner`, made for moving steps of this RMS per component; the scale is unknown until the pen
    /// moves.
    pub fn new(inner: C, rms: f64) -> Self {
        Self { inner, rms, scale: RunningScale::default() }
    }

    fn raw_per_input(&self) -> f64 {
        self.scale.raw_per_unit() * TARGET_RMS / self.rms
    }
}

impl<C: Contestant> Contestant for Scaled<C> {
    fn start_sequence(&mut self) {
        self.inner.start_sequence();
    }

    fn observe(&mut self, v: [f64; 2]) {
        self.scale.observe(v);
        let unit = self.raw_per_input();
        self.inner.observe(v.map(|component| component / unit));
    }

    fn preview(&self, out: &mut [[f64; 2]]) {
        self.inner.preview(out);
        let unit = self.raw_per_input();
        out.iter_mut().flatten().for_each(|component| *component *= unit);
    }

    fn end_training(&mut self) {
        self.inner.end_training();
    }
}

/// Settings of a scale whose first moving step is `length` long.
fn settings(length: f64) -> SpeedScaleSettings {
    // RMS per component of steps of this length, over the target RMS.
    let initial_m = length / (std::f64::consts::SQRT_2 * TARGET_RMS);
    SpeedScaleSettings {
        initial_m,
        min_m: initial_m / RANGE,
        max_m: initial_m * RANGE,
        still_m: 0.0,
        max_change: MAX_CHANGE,
        ..SpeedScaleSettings::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prediction::model::constant_velocity;
    use proptest::prelude::*;

    #[derive(Default)]
    struct Listener(Vec<[f64; 2]>);

    impl Contestant for Listener {
        fn start_sequence(&mut self) {}
        fn observe(&mut self, v: [f64; 2]) {
            self.0.push(v);
        }
        fn preview(&self, out: &mut [[f64; 2]]) {
            out.fill([1.0; 2]);
        }
    }

    fn circle(radius: f64) -> impl Iterator<Item = [f64; 2]> {
        (0..600).map(move |i| [radius * (f64::from(i) * 0.1).cos(), radius * (f64::from(i) * 0.1).sin()])
    }

    #[test]
    fn any_device_is_brought_to_the_same_size() {
        for radius in [1e-5, 0.02, 7.0, 4000.0] {
            let mut scaled = Scaled::new(Listener::default(), 10.0);
            circle(radius).for_each(|v| scaled.observe(v));
            let late: Vec<f64> = scaled.inner.0[300..].iter().map(|[x, y]| x.hypot(*y)).collect();
            // RMS 10 per component is a length of 14.1 in two dimensions.
            assert!(late.iter().all(|l| (l - 14.14).abs() < 0.2), "{radius}: {late:?}");
            let mut preview = [[0.0; 2]; 1];
            scaled.preview(&mut preview);
            assert!((preview[0][0] / radius - 1.0 / 14.14).abs() < 0.01, "{preview:?}");
        }
    }

    proptest! {
        #[test]
        fn what_is_linear_passes_through_unchanged(v in prop::collection::vec([-50.0..50.0f64, -50.0..50.0],
            1..60)) {
            let mut scaled = Scaled::new(constant_velocity(), 3.0);
            scaled.start_sequence();
            for v in v {
                scaled.observe(v);
                let mut out = [[0.0; 2]; 3];
                scaled.preview(&mut out);
                for (a, b) in out.iter().flatten().zip(v.iter().cycle()) {
                    prop_assert!((a - b).abs() <= 1e-12 * b.abs());
                }
            }
        }
    }
}
