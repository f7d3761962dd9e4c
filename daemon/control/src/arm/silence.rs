//! Where a consumer without commands comes to rest, and where it turns on the way.

use super::chain::{Chain, Kinematics};
use super::limits::{JointLimits, JointMotion, VelocityBox};

/// Where a consumer is that receives nothing after the next command, if that continues the last.
pub(crate) struct Silence<const J: usize> {
    pub(crate) kinematics: Kinematics<J>,
    /// Change of that position per change of the next velocity, per joint \[s\].
    pub(crate) gain: [f64; J],
}

impl<const J: usize> Silence<J> {
    /// Where it comes to rest: q + q̇(h + hold) + q̇|q̇|/(2a_b), every joint braking independently, and
    /// h + hold + |q̇|/a_b.
    pub(crate) fn after(
        chain: &Chain<J>,
        limits: &JointLimits<J>,
        motion: &JointMotion<J>,
        elapsed: f64,
    ) -> Self {
        Self::braking(chain, limits, motion, elapsed, f64::INFINITY)
    }

    /// Where it is once its joints have braked for `braked` \[s\].
    pub(crate) fn braking(
        chain: &Chain<J>,
        limits: &JointLimits<J>,
        motion: &JointMotion<J>,
        elapsed: f64,
        braked: f64,
    ) -> Self {
        let (mut q, mut gain) = (motion.q, [elapsed + limits.hold_s(); J]);
        let joints = q.iter_mut().zip(&mut gain).zip(motion.qd.iter().zip(limits.deceleration()));
        for ((q, gain), (qd, decel)) in joints {
            let rests = qd.abs() / decel;
            if braked < rests {
                *q += qd * (*gain + braked) - 0.5 * decel.copysign(*qd) * braked * braked;
                *gain += braked;
            } else {
                *q += qd * (*gain + 0.5 * qd.abs() / decel);
                *gain += rests;
            }
        }
        Self { kinematics: chain.forward(&q), gain }
    }

    /// When the motion along `row` turns back farthest out while the joints brake \[s\]: what moves along it
    /// may stop earlier than what moves against it. `None`: it nowhere turns back.
    pub(crate) fn turns(limits: &JointLimits<J>, motion: &JointMotion<J>, row: &[f64; J]) -> Option<f64> {
        let joints = || row.iter().zip(&motion.qd).zip(limits.deceleration());
        let speed = |t: f64| {
            joints().map(|((c, qd), decel)| c * (qd.abs() - decel * t).max(0.0).copysign(*qd)).sum::<f64>()
        };
        let way = |t: f64| {
            let braked = |qd: f64, decel: f64| {
                let t = t.min(qd.abs() / decel);
                t * (qd - 0.5 * decel.copysign(qd) * t)
            };
            joints().map(|((c, qd), decel)| c * braked(*qd, *decel)).sum::<f64>()
        };
        // Between the moments at which joints come to rest the speed is linear.
        let (mut from, mut out) = (0.0, speed(0.0));
        let mut farthest: Option<(f64, f64)> = None;
        for _ in 0..J {
            let rests = joints().map(|((_, qd), decel)| qd.abs() / decel).filter(|t| *t > from);
            let to = rests.fold(f64::INFINITY, f64::min);
            if to == f64::INFINITY {
                break;
            }
            let back = speed(to);
            if out > 0.0 && back < 0.0 {
                let at = from + (to - from) * out / (out - back);
                let away = way(at);
                if farthest.is_none_or(|(_, most)| away > most) {
                    farthest = Some((at, away));
                }
            }
            (from, out) = (to, back);
        }
        farthest.map(|(at, _)| at)
    }

    /// Largest rotation of each joint until then, for any next velocity in the box \[rad\].
    pub(crate) fn farthest(
        limits: &JointLimits<J>,
        motion: &JointMotion<J>,
        allowed: &VelocityBox<J>,
        elapsed: f64,
    ) -> [f64; J] {
        let mut angle = motion.qd.map(f64::abs);
        let fastest = allowed.lower.iter().zip(&allowed.upper).map(|(low, high)| low.abs().max(high.abs()));
        for ((angle, fastest), decel) in angle.iter_mut().zip(fastest).zip(limits.deceleration()) {
            let speed = angle.max(fastest);
            *angle = speed * (elapsed + limits.hold_s() + 0.5 * speed / decel);
        }
        angle
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::guard::{Commanded, consumer_state};
    use crate::units::Stamp;

    const HOLD_S: f64 = 0.01;

    /// Along random rows, from random velocities, by what consumers do.
    #[test]
    fn the_place_where_it_turns_or_rests_is_the_farthest_on_its_way() {
        let mut rng = Pcg64::seed_from_u64(3);
        let limits = JointLimits::new([[-6.0, 6.0]; 6], [3.0; 6], [40.0; 6]).unwrap();
        let limits = limits.with_stale_braking(HOLD_S, [5.0, 10.0, 20.0, 7.0, 20.0, 30.0]).unwrap();
        let (mut turned, mut outermost) = (0, 0);
        for _ in 0..3000 {
            let mut any = |most: f64| [(); 6].map(|()| rng.random_range(-most..most));
            let (row, qd) = (any(1.0), any(2.0));
            let motion = JointMotion { qd, ..JointMotion::at_rest([0.0; 6]) };
            let command = Commanded::new(Stamp(0), motion).unwrap();
            let at = |braked: f64| {
                let at = Stamp(((HOLD_S + braked) * 1e9) as u64);
                let state = consumer_state(&command, Stamp(10_000_000), limits.deceleration(), at);
                row.iter().zip(&state.q).map(|(c, q)| c * q).sum::<f64>()
            };
            let [begins, rests] = [0.0, 9.0].map(at);
            let farthest = (0..500).map(|i| at(1e-3 * f64::from(i))).fold(rests, f64::max);
            let turn = Silence::turns(&limits, &motion, &row).map(at);
            let found = turn.unwrap_or(begins).max(begins).max(rests);
            assert!((found - farthest).abs() < 2e-5, "{row:?} {qd:?}: {found} of {farthest}");
            turned += u32::from(turn.is_some());
            outermost += u32::from(turn.is_some_and(|turn| turn > begins.max(rests) + 1e-3));
        }
        assert!(
            turned > 300 && outermost > 300,
            "{turned} of 3000 turned, {outermost} of them farthest out there"
        );
    }
}
