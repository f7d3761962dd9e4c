//! The baselines: what foretrace is compared with in closed loop.
//!
//! Contract: a [`Baseline`] receives the pen's samples as they arrive and gives once per control period the
//! tool's target for the end of that period, in the plane \[m\]. Deterministic; no clock, no file. Each is
//! implemented from its published description with its published defaults, then tuned for least error on
//! training data ([`BaselineSettings::new`]). Samples that are non-finite, not later than the last one taken,
//! or stamped in the future are dropped. Absent: the arm, inverse kinematics, and the daemon; nothing here is
//! linked into the real-time loop.

mod settings;
mod tuned;
mod sweep;
mod intake;
mod one_euro;
mod servoj;
mod trend;
mod otg;
mod kalman;
mod open_loop;

pub use kalman::KalmanWay;
pub use one_euro::OneEuro;
pub use open_loop::{OpenLoop, open_loop};
pub use otg::OtgWay;
pub use servoj::{ServojWay, SoftServo, soften};
pub use settings::{
    BaselineError, BaselineKind, BaselineSettings, Feed, KalmanKnobs, Limits, OneEuroKnobs, Origin, OtgKnobs,
    PostFilter, ServoKnobs,
};
pub use sweep::sweep;

use foretrace_sim::path::PathSample;

/// A baseline: pen samples in, a tool target out, once per control period.
pub trait Baseline: Send {
    /// The tool's target in the plane \[m\] for the end of the period that begins at `now_s`.
    ///
    /// `pen`: samples received since the last call, in order. `None` before the first sample.
    fn target(&mut self, now_s: f64, pen: &[PathSample]) -> Option<[f64; 2]>;

    /// Periods in which the baseline's own solver failed and it continued the last safe motion.
    fn failures(&self) -> u64 {
        0
    }

    /// The baseline's own limit on speed or acceleration was active in the last target.
    fn limited(&self) -> bool {
        false
    }
}

/// The baseline `kind` with these settings; those of other kinds in `settings` are ignored.
///
/// # Errors
///
/// A number outside its legal range, by name.
pub fn build(kind: BaselineKind, settings: &BaselineSettings) -> Result<Box<dyn Baseline>, BaselineError> {
    settings.check(kind)?;
    Ok(match kind {
        BaselineKind::ServojGello | BaselineKind::ServojRos => Box::new(ServojWay::new(settings)),
        BaselineKind::Otg => Box::new(OtgWay::new(settings)),
        BaselineKind::Kalman => Box::new(KalmanWay::new(settings)),
    })
}

/// Look-ahead and gain that a baseline with these settings sends to the arm's servo, where the arm takes
/// `servoj`.
#[must_use]
pub fn servo(settings: &BaselineSettings) -> ServoKnobs {
    settings.servo
}

#[cfg(test)]
mod tests;
