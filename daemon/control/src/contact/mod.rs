//! Whether the arm touches something, from the efforts that it reports: torques of its joints against those
//! that its motion needs in free space.
//!
//! Contract: pure, total, no allocation, bounded work per joint state; judges by stamps only. Off for an arm
//! that reports no effort and for a description without masses. Never a safety function: a learned
//! expectation has no guarantee, and a contact that began before it was learned is part of it.
//!
//! The expectation is learned while the tool is commanded to be lifted, moves, and shows no excess; it
//! survives stops. After each arming it counts once it was confirmed by motion for
//! [`ContactSettings::learn_ns`]. Its own uncertainty widens the limit, as does the friction of a joint that
//! hardly moves, which may hold anything up to that. Excesses are summed as in Page's test (1954, *Continuous
//! inspection schemes*, CUSUM): a light one must last, a heavy one need not.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

mod expected;
mod fit;
mod settings;

pub use settings::{ContactSettings, EffortReading, EffortUnit};

use expected::ExpectedJoints;
use fit::{Terms, TorqueFit};

use crate::arm::{Chain, Dynamics, Payload};
use crate::state::state;
use crate::stop::{StopCause, StopDetail};
use crate::units::Stamp;

/// Time constant with which expected and reported efforts are smoothed \[s\].
const SMOOTH_S: f64 = 0.03;
/// A joint faster than this slides; slower, friction may hold it \[rad/s\].
const SLIDES_RADPS: f64 = 0.02;
/// An arm slower than this in all joints shows nothing to learn \[rad/s\].
const MOVES_RADPS: f64 = 0.05;
/// The tool counts as free this long after it was commanded to lift \[s\].
const FREE_S: f64 = 0.15;
/// Evidence fades with this time constant of motion \[s\].
const MEMORY_S: f64 = 120.0;
/// Residuals this far apart are independent \[s\].
const INDEPENDENT_S: f64 = 0.06;
/// Standard deviation of one such residual, as a share of the effort limit.
const NOISE_SHARE: f64 = 0.03;
/// Standard deviations of the expectation that widen the limit.
const UNCERTAIN: f64 = 2.0;
/// A longer gap between joint states begins again \[s\].
const GAP_S: f64 = 0.1;
/// Gain of an arm that reports currents, until it is learned \[A/Nm\]: that of a UR's joints is 0.07 to 0.12.
const AMPERES_PER_NM: f64 = 0.1;

/// What the judgement needs of the arm.
#[derive(Debug, Clone)]
struct TorqueModel<const J: usize> {
    links: Dynamics<J>,
    /// One more kilogram where the payload is.
    kilogram: Dynamics<J>,
    /// \[Nm\]
    effort: [f64; J],
}

/// Judges an arm of `J` joints.
#[derive(Debug, Clone)]
pub struct Contact<const J: usize> {
    settings: ContactSettings,
    body: Option<TorqueModel<J>>,
    expected: ExpectedJoints<J>,
    fits: [TorqueFit; J],
    /// The unit of what was learned.
    unit: EffortUnit,
    /// The newest joint state that was used; `None`: what is smoothed begins again.
    newest: Option<Stamp>,
    terms: [Terms; J],
    /// Reported, in \[Nm\] by the unit's prior.
    reported: [f64; J],
    /// Excess over the limit, summed \[s\].
    sums: [f64; J],
    /// Time with the tool lifted, without a break \[s\].
    lifted_s: f64,
    /// Motion in free space since the arm was taken over \[s\].
    learned_s: f64,
}

state! {
    [const J: usize] Contact<J> {
        expected, fits, unit, newest, terms, reported, sums, lifted_s, learned_s,
    }
    fixed { settings, body }
}

impl<const J: usize> Contact<J> {
    /// Of the arm `chain` with `payload`; what more it may carry is expected at the same place.
    #[must_use]
    pub fn new(settings: ContactSettings, chain: &Chain<J>, payload: &Payload) -> Self {
        let links = chain.dynamics(payload).ok().filter(|_| settings.judged);
        let body = links.map(|links| TorqueModel {
            links,
            kilogram: chain.payload_dynamics(&Payload { mass: 1.0, ..*payload }),
            effort: chain.limits().effort,
        });
        let unit = EffortUnit::default();
        let effort = chain.limits().effort;
        Self {
            settings,
            body,
            expected: ExpectedJoints::new(),
            fits: effort.map(|effort| TorqueFit::prior(&spread(unit, effort))),
            unit,
            newest: None,
            terms: [Terms::zeros(); J],
            reported: [0.0; J],
            sums: [0.0; J],
            lifted_s: 0.0,
            learned_s: 0.0,
        }
    }

    /// The same on the heap; on a stack frame of its own, because it is large.
    #[must_use]
    #[inline(never)]
    pub fn boxed(settings: ContactSettings, chain: &Chain<J>, payload: &Payload) -> Box<Self> {
        Box::new(Self::new(settings, chain, payload))
    }

    /// The loop takes charge of an arm that stands still. What was learned stays, and has to be confirmed.
    pub fn begin(&mut self) {
        self.expected.forget();
        self.pause();
        self.learned_s = 0.0;
    }

    /// The arm is not in charge, or stopped: nothing is compared.
    pub fn pause(&mut self) {
        self.newest = None;
        self.sums = [0.0; J];
        self.lifted_s = 0.0;
    }

    /// The joints `q` \[rad\] were commanded for `stamp`, which an arm with the group delay `lag_s` \[s\]
    /// follows; `lifted`: that holds the tool in free space.
    pub fn commanded(&mut self, stamp: Stamp, q: &[f64; J], lag_s: f64, lifted: bool) {
        if self.body.is_some() {
            self.expected.commanded(stamp, q, lag_s, lifted);
        }
    }

    /// Whether the expectation counts.
    #[must_use]
    pub fn judges(&self) -> bool {
        self.learned_s * 1e9 >= self.settings.learn_ns as f64
    }

    /// The efforts of a joint state of an arm in charge, at joints `q` \[rad\]. Returns the contact, once it
    /// has lasted: the joint, the torque beyond the expectation and its limit \[Nm\].
    pub fn measured(&mut self, q: &[f64; J], reading: &EffortReading<J>) -> Option<StopDetail> {
        let body = self.body.as_ref()?;
        if !reading.effort.iter().chain(q).all(|number| number.is_finite()) {
            return None;
        }
        let motion = self.expected.at(reading.stamp)?;
        if reading.unit != self.unit {
            let priors = body.effort.map(|effort| TorqueFit::prior(&spread(reading.unit, effort)));
            (self.unit, self.fits, self.learned_s) = (reading.unit, priors, 0.0);
            self.newest = None;
        }
        let links = body.links.torque(q, &motion.qd, &motion.qdd);
        let kilogram = body.kilogram.torque(q, &motion.qd, &motion.qdd);
        let dt = self.newest.map(|newest| reading.stamp.since(newest) as f64 * 1e-9);
        if dt.is_some_and(|dt| dt <= 0.0) {
            return None;
        }
        let dt = dt.filter(|dt| *dt <= GAP_S);
        self.newest = Some(reading.stamp);
        // Without a past the smoothed values begin at the newest.
        let share = dt.map_or(1.0, |dt| 1.0 - (-dt / SMOOTH_S).exp());
        let dt = dt.unwrap_or(0.0);
        for j in 0..J {
            let qd = motion.qd[j];
            let way = (qd / SLIDES_RADPS).clamp(-1.0, 1.0);
            let terms = Terms::new(links[j], kilogram[j], way, qd, 1.0);
            let torque = reading.effort[j] / per_nm(reading.unit, body.effort[j]);
            self.terms[j] += (terms - self.terms[j]) * share;
            self.reported[j] += (torque - self.reported[j]) * share;
        }
        self.lifted_s = if motion.free { self.lifted_s + dt } else { 0.0 };
        let learns = self.lifted_s >= FREE_S && motion.qd.iter().any(|qd| qd.abs() > MOVES_RADPS);
        self.compare(dt, learns)
    }

    /// Sums excesses, and learns where there is none.
    fn compare(&mut self, dt: f64, learns: bool) -> Option<StopDetail> {
        let body = self.body.as_ref()?;
        let judges = self.judges();
        let ContactSettings { torque_share, hold_ns, .. } = self.settings;
        let hold_s = hold_ns as f64 * 1e-9;
        let mut worst: Option<(f64, StopDetail)> = None;
        let mut calm = true;
        for j in 0..J {
            let (fit, terms, sum) = (&self.fits[j], &self.terms[j], &mut self.sums[j]);
            let held = fit.friction() * (1.0 - terms.z.abs()).max(0.0);
            let limit =
                torque_share * body.effort[j] + (held + UNCERTAIN * fit.uncertain(terms)) / fit.gain();
            let excess = (self.reported[j] - fit.expected(terms)).abs() / fit.gain();
            calm &= excess <= limit;
            *sum = if judges { (*sum + (excess / limit - 1.0) * dt).max(0.0) } else { 0.0 };
            if *sum > hold_s && worst.is_none_or(|(most, _)| *sum > most) {
                let (cause, joint) = (StopCause::Effort, u8::try_from(j).ok());
                worst =
                    Some((*sum, StopDetail { cause, joint, amount: excess, limit, ..StopDetail::default() }));
            }
        }
        if learns && calm && dt > 0.0 {
            self.learned_s += dt;
            let kept = (-dt / MEMORY_S).exp();
            for j in 0..J {
                let noise = NOISE_SHARE * body.effort[j] * (INDEPENDENT_S / dt).max(1.0).sqrt();
                let spread = spread(self.unit, body.effort[j]);
                self.fits[j].learn(&self.terms[j], self.reported[j], noise, kept, &spread);
            }
        }
        worst.map(|(_, detail)| detail)
    }
}

/// What a torque of 1 Nm is in the reported unit, before anything is learned; `limit` \[Nm\].
fn per_nm(unit: EffortUnit, limit: f64) -> f64 {
    match unit {
        EffortUnit::NewtonMetres => 1.0,
        EffortUnit::Amperes => AMPERES_PER_NM,
        EffortUnit::Share => 1.0 / limit.max(1e-3),
    }
}

/// Standard deviations of the prior: gain, payload \[kg\], Coulomb \[Nm\] and viscous friction \[Nm s/rad\],
/// offset \[Nm\]; `limit` \[Nm\].
fn spread(unit: EffortUnit, limit: f64) -> Terms {
    let gain = if unit == EffortUnit::Amperes { 0.4 } else { 0.1 };
    Terms::new(gain, 3.0, 0.1 * limit, 0.07 * limit, 0.1 * limit)
}
