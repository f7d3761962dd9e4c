//! The currents of the joints: torques of our own description of the arm, over a constant per joint.
//!
//! Contract: an assumption, not a measurement. Motors of 0.125 Nm/A (the three large joints) and 0.092 Nm/A
//! (the wrists) behind gears of 101, without loss: 12.6 and 9.3 Nm/A at the joint; Coulomb friction of
//! [`foretrace_config::FRICTION_SHARE`] of the effort limit. The payload is what the installation says.

use foretrace_config::{FRICTION_SHARE, presets};
use foretrace_control::arm::{Chain, Payload};

use super::options::Series;

/// \[Nm/A\] at the joint.
pub(super) const NM_PER_A: [f64; 6] = [12.6, 12.6, 12.6, 9.3, 9.3, 9.3];
/// A joint faster than this slides \[rad/s\].
const SLIDES_RADPS: f64 = 0.01;

#[derive(Debug, Clone)]
pub(super) struct Motors {
    /// `None`: the description cannot be read, which a test excludes.
    chain: Option<Chain<6>>,
}

impl Motors {
    pub(super) fn of(series: Series) -> Self {
        let name = match series {
            Series::Cb3 => "ur5",
            Series::E => "ur5e",
        };
        let chain = presets::robot(name).and_then(|text| Chain::from_urdf(text, None, None).ok());
        Self { chain }
    }

    /// Currents \[A\] at positions `q` \[rad\], velocities `qd` \[rad/s\] and accelerations `qdd` \[rad/s²\],
    /// with a payload of `mass` \[kg\] at `centre` \[m\] from the flange.
    pub(super) fn currents(
        &self,
        q: &[f64; 6],
        qd: &[f64; 6],
        qdd: &[f64; 6],
        (mass, centre): (f64, [f64; 3]),
    ) -> [f64; 6] {
        let mut currents = [0.0; 6];
        let Some(chain) = &self.chain else { return currents };
        let Ok(dynamics) = chain.dynamics(&Payload { mass, centre }) else { return currents };
        let joints = dynamics.torque(q, qd, qdd).into_iter().zip(qd).zip(chain.limits().effort).zip(NM_PER_A);
        for (current, (((torque, qd), effort), nm_per_a)) in currents.iter_mut().zip(joints) {
            let friction = FRICTION_SHARE * effort * (qd / SLIDES_RADPS).clamp(-1.0, 1.0);
            *current = (torque + friction) / nm_per_a;
        }
        currents
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kilogram_at_the_flange_of_a_stretched_arm_costs_its_weight_in_current() {
        for (series, reach) in [(Series::Cb3, 0.425 + 0.39225), (Series::E, 0.425 + 0.3922)] {
            let motors = Motors::of(series);
            let still = [0.0; 6];
            let at = |mass| motors.currents(&still, &still, &still, (mass, [0.0; 3]));
            let (empty, loaded) = (at(0.0), at(1.0));
            // At zero the arm lies stretched out, its flange that far from the shoulder lift's axis.
            let expected = 9.80665 * reach / NM_PER_A[1];
            let more = (loaded[1] - empty[1]).abs();
            assert!((more - expected).abs() < 1e-9, "{more} {expected}");
            assert!(empty[1].abs() > 1.0 && empty[0].abs() < 1e-9);
        }
    }

    #[test]
    fn motion_costs_friction_against_its_way() {
        let motors = Motors::of(Series::E);
        let currents =
            |qd: f64| motors.currents(&[0.0; 6], &[qd, 0.0, 0.0, 0.0, 0.0, 0.0], &[0.0; 6], (0.0, [0.0; 3]));
        let [there, back] = [currents(0.5), currents(-0.5)];
        assert!((there[0] - back[0] - 2.0 * FRICTION_SHARE * 150.0 / NM_PER_A[0]).abs() < 1e-9);
    }
}
