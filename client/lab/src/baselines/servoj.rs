//! The servoj baselines: a 1€ filter on the pen, its value sent to the arm's servo, which smooths by its
//! look-ahead.
//!
//! [`SoftServo`] is that servo in software, for arms that have none: per axis a critically damped second
//! order whose group delay is the look-ahead, the mathematics of [`foretrace_sim::arm`] without limits, joint
//! loop and cycle of delay. Not modelled: servoj's gain. Universal Robots publish no law for it; measured
//! lags fit the look-ahead alone.

use super::intake::{GAP_S, Intake, SampleRole};
use super::{Baseline, BaselineSettings, Feed, OneEuro, ServoKnobs};
use foretrace_sim::path::PathSample;

/// 1€ filter on the pen; no prediction, so the arm's lag comes on top.
#[derive(Debug, Clone)]
pub struct ServojWay {
    intake: Intake,
    filter: OneEuro,
    feed: Feed,
    period_s: f64,
}

impl ServojWay {
    pub(super) fn new(settings: &BaselineSettings) -> Self {
        Self {
            intake: Intake::default(),
            filter: OneEuro::new(settings.one_euro),
            feed: settings.feed,
            period_s: settings.period_s,
        }
    }
}

impl Baseline for ServojWay {
    fn target(&mut self, now_s: f64, pen: &[PathSample]) -> Option<[f64; 2]> {
        for sample in pen {
            let position = [sample.x_m, sample.y_m];
            match (self.intake.take(now_s, sample), self.feed) {
                (SampleRole::Dropped, _) => {}
                // Only a long silence makes the filter forget: a jump of the target would shake the arm.
                (SampleRole::First, Feed::Samples) => {
                    self.filter.step(GAP_S, position);
                }
                (SampleRole::Next(elapsed_s), Feed::Samples) => {
                    self.filter.step(elapsed_s, position);
                }
                (SampleRole::First | SampleRole::Next(_), Feed::Periods) => {}
            }
        }
        if let (Feed::Periods, Some(position)) = (self.feed, self.intake.position()) {
            self.filter.step(self.period_s, position);
        }
        self.filter.position()
    }
}

/// The effect of servoj's look-ahead on a stream of targets, in the plane.
#[derive(Debug, Clone, Copy)]
pub struct SoftServo {
    period_s: f64,
    look_ahead_s: f64,
    /// Target of the last period \[m\], position \[m\] and velocity \[m/s\].
    state: Option<[SoftServoAxis; 2]>,
}

#[derive(Debug, Clone, Copy)]
struct SoftServoAxis {
    target: f64,
    x: f64,
    v: f64,
}

impl SoftServo {
    /// A servo that starts at rest on its first target.
    #[must_use]
    pub fn new(period_s: f64, knobs: ServoKnobs) -> Self {
        Self { period_s, look_ahead_s: knobs.look_ahead_s, state: None }
    }

    /// Where the tool is at the end of a period in which the target went straight from the last one to
    /// `target` \[m\].
    ///
    /// A non-finite target counts as the last one.
    pub fn step(&mut self, target: [f64; 2]) -> [f64; 2] {
        let mut state =
            self.state.unwrap_or(target.map(|target| SoftServoAxis { target, x: target, v: 0.0 }));
        for (axis, target) in state.iter_mut().zip(target) {
            let to = if target.is_finite() { target } else { axis.target };
            axis.follow(to, self.look_ahead_s, self.period_s);
        }
        self.state = Some(state).filter(|state| state.iter().all(|axis| axis.x.is_finite()));
        state.map(|axis| axis.x)
    }
}

impl SoftServoAxis {
    /// Exact over the period: with ω = 2/look-ahead, in the frame that follows the ramp with its steady lag,
    /// e(t) = (e₀ + (ė₀ + ωe₀)t)·exp(−ωt).
    fn follow(&mut self, to: f64, look_ahead_s: f64, dt: f64) {
        let slope = (to - self.target) / dt;
        let lag = look_ahead_s * slope;
        let w = 2.0 / look_ahead_s;
        let decay = (-w * dt).exp();
        let (e, ed) = (self.x - (self.target - lag), self.v - slope);
        self.x = to - lag + (e + (ed + w * e) * dt) * decay;
        self.v = slope + (ed - w * (ed + w * e) * dt) * decay;
        self.target = to;
    }
}

/// `way` with the servo in software behind it.
#[must_use]
pub fn soften(way: Box<dyn Baseline>, settings: &BaselineSettings) -> Box<dyn Baseline> {
    Box::new(Softened { way, servo: SoftServo::new(settings.period_s, settings.servo) })
}

struct Softened {
    way: Box<dyn Baseline>,
    servo: SoftServo,
}

impl Baseline for Softened {
    fn target(&mut self, now_s: f64, pen: &[PathSample]) -> Option<[f64; 2]> {
        self.way.target(now_s, pen).map(|target| self.servo.step(target))
    }

    fn failures(&self) -> u64 {
        self.way.failures()
    }
}
