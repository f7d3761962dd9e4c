//! Constant-acceleration Kalman filter per axis, predicting the pen as browsers do for ink.
//!
//! Filter and rules follow what Chromium's `ui/base/prediction` (BSD-3) documents and implements, in code of
//! our own: state \[position, velocity, acceleration\], noise enters as a random change of acceleration g·w
//! with g = \[½dt², dt, 1\], the measurement is the position; a prediction starts at the newest sample, needs
//! four samples, everything is forgotten after 20 ms of silence, predictions reach at most 25 ms. For
//! delegated ink trails Chromium adds two rules: no prediction that would turn back, and acceleration only
//! where the path turned by more than 15° in its last 40 ms. Chromium counts in pixels and milliseconds:
//! process 0.1 px/ms², measurement 1 px. Only their ratio matters, which has no unit of length: 1e5 s⁻². The
//! first covariance is scaled likewise.

use std::collections::VecDeque;

use foretrace_sim::path::PathSample;
use nalgebra::{Matrix3, Vector3};

use super::intake::{Intake, SampleRole};
use super::{Baseline, BaselineSettings, KalmanKnobs, OneEuro, Origin, PostFilter, ServoKnobs, SoftServo};

/// Samples before the first prediction.
const SETTLED: u32 = 4;
/// Window over which the turn of the path is measured \[s\].
const TURN_WINDOW_S: f64 = 0.040;
/// A smaller turn counts as straight \[rad\].
const TURN_MIN_RAD: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// More samples than the turn window holds at 1 kHz.
const RECENT: usize = 64;

/// Kalman filters on both axes, and the rules around their prediction.
#[derive(Debug, Clone)]
pub struct KalmanWay {
    intake: Intake,
    knobs: KalmanKnobs,
    lead_s: f64,
    period_s: f64,
    axes: [AxisFilter; 2],
    recent: VecDeque<(f64, [f64; 2])>,
    post: Option<Post>,
}

impl KalmanWay {
    pub(super) fn new(settings: &BaselineSettings) -> Self {
        Self {
            intake: Intake::default(),
            knobs: settings.kalman,
            lead_s: settings.period_s + settings.dead_time_s + settings.kalman.lead_extra_s,
            period_s: settings.period_s,
            axes: [AxisFilter::default(); 2],
            recent: VecDeque::with_capacity(RECENT),
            post: settings.kalman.post_filter.map(|filter| Post::new(filter, settings.period_s)),
        }
    }

    fn take(&mut self, now_s: f64, sample: &PathSample) {
        let arrival = self.intake.take(now_s, sample);
        let position = [sample.x_m, sample.y_m];
        match arrival {
            SampleRole::Dropped => return,
            SampleRole::First => {
                self.recent.clear();
                self.axes = position.map(|position| AxisFilter::at(position, self.knobs.measurement_m));
            }
            SampleRole::Next(elapsed_s) => {
                for (axis, position) in self.axes.iter_mut().zip(position) {
                    axis.update(elapsed_s, position, &self.knobs);
                }
            }
        }
        self.recent.push_back((sample.t_s, position));
        while self.recent.len() > RECENT
            || self.recent.front().is_some_and(|(t, _)| sample.t_s - t > TURN_WINDOW_S)
        {
            self.recent.pop_front();
        }
    }

    /// Where the pen is expected when the arm gets there.
    fn predict(&self, now_s: f64) -> Option<[f64; 2]> {
        let newest = self.intake.position()?;
        if self.axes.iter().any(|axis| axis.samples < SETTLED) {
            return Some(newest);
        }
        let h = (self.intake.age_s(now_s) + self.lead_s).min(self.knobs.horizon_max_s);
        let velocity = self.axes.map(|axis| axis.state[1]);
        let acceleration = self.axes.map(|axis| axis.state[2]);
        let along: f64 = velocity.iter().zip(acceleration).map(|(v, a)| v * (v + a * h)).sum();
        if self.knobs.reversal_rule && along <= 0.0 {
            return Some(newest);
        }
        let bends = !self.knobs.turn_rule || self.turn_rad().abs() > TURN_MIN_RAD;
        let share = if bends { self.knobs.acceleration_share } else { 0.0 };
        let mut predicted = match self.knobs.origin {
            Origin::Measured => newest,
            Origin::Filtered => self.axes.map(|axis| axis.state[0]),
        };
        for (axis, x) in predicted.iter_mut().enumerate() {
            *x += h * (velocity[axis] + 0.5 * share * h * acceleration[axis]);
        }
        Some(predicted)
    }

    /// By how much the path turned over the recent samples \[rad\], left positive.
    fn turn_rad(&self) -> f64 {
        let steps = self.recent.iter().zip(self.recent.iter().skip(1));
        let mut before: Option<[f64; 2]> = None;
        let mut turned = 0.0;
        for ((_, a), (_, b)) in steps {
            let step = [b[0] - a[0], b[1] - a[1]];
            if step == [0.0; 2] {
                continue;
            }
            if let Some(last) = before {
                let (cross, dot) =
                    (last[0] * step[1] - last[1] * step[0], last[0] * step[0] + last[1] * step[1]);
                turned += cross.atan2(dot);
            }
            before = Some(step);
        }
        turned
    }
}

impl Baseline for KalmanWay {
    fn target(&mut self, now_s: f64, pen: &[PathSample]) -> Option<[f64; 2]> {
        for sample in pen {
            self.take(now_s, sample);
        }
        let predicted = self.predict(now_s)?;
        Some(match &mut self.post {
            Some(Post::OneEuro(filter)) => filter.step(self.period_s, predicted),
            Some(Post::Servo(servo)) => servo.step(predicted),
            None => predicted,
        })
    }
}

/// What smooths the prediction.
#[derive(Debug, Clone)]
enum Post {
    OneEuro(OneEuro),
    Servo(SoftServo),
}

impl Post {
    fn new(filter: PostFilter, period_s: f64) -> Self {
        match filter {
            PostFilter::OneEuro(knobs) => Self::OneEuro(OneEuro::new(knobs)),
            PostFilter::Servo(look_ahead_s) => {
                Self::Servo(SoftServo::new(period_s, ServoKnobs { look_ahead_s, gain: 2000.0 }))
            }
        }
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct AxisFilter {
    /// \[m, m/s, m/s²\]
    state: Vector3<f64>,
    covariance: Matrix3<f64>,
    samples: u32,
}

impl AxisFilter {
    fn at(position: f64, measurement_m: f64) -> Self {
        // One pixel, pixel per millisecond and pixel per millisecond², a pixel being the measurement's
        // deviation.
        let per_ms = Vector3::new(1.0, 1e6, 1e12) * measurement_m.powi(2);
        Self {
            state: Vector3::new(position, 0.0, 0.0),
            covariance: Matrix3::from_diagonal(&per_ms),
            samples: 1,
        }
    }

    fn update(&mut self, dt: f64, position: f64, knobs: &KalmanKnobs) {
        let transition = Matrix3::new(1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0);
        let noise = Vector3::new(0.5 * dt * dt, dt, 1.0) * knobs.process_mps2;
        let state = transition * self.state;
        let covariance = transition * self.covariance * transition.transpose() + noise * noise.transpose();
        let measured = knobs.measurement_m.powi(2);
        let gain = covariance.column(0) / (covariance[(0, 0)] + measured);
        // Joseph's form: stays symmetric and positive in floating point.
        let keep = Matrix3::identity() - gain * Vector3::x().transpose();
        self.state = state + gain * (position - state[0]);
        self.covariance = keep * covariance * keep.transpose() + gain * gain.transpose() * measured;
        self.samples = self.samples.saturating_add(1);
    }
}
