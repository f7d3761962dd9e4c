//! Arms that follow their own commands, shared by the tests of the inverse kinematics.

use foretrace_control::arm::{Chain, JointLimits};
use foretrace_control::guard::{Commanded, Guard};
use foretrace_control::ik::{Ik, IkReport, IkSettings, ToolTarget};
use foretrace_control::units::Stamp;
use nalgebra::Vector3;
use std::f64::consts::FRAC_PI_2;

pub(crate) const UR5: &str = include_str!("../../../../../config/robots/ur5.urdf");
pub(crate) const UR5E: &str = include_str!("../../../../../config/robots/ur5e.urdf");
pub(crate) const TICK_S: f64 = 2e-3;
pub(crate) const TICK_NS: u64 = 2_000_000;

/// Tool down, 0.45 m in front of the base and 0.2 m above its foot.
pub(crate) const UR5_HOME: [f64; 6] = [0.0, -1.48188, 2.10901, -2.19792, -FRAC_PI_2, 0.0];
pub(crate) const UR5E_HOME: [f64; 6] = [0.0, -1.3895, 2.188, -2.36929, -FRAC_PI_2, 0.0];

pub(crate) fn chain(text: &str) -> Chain<6> {
    Chain::from_urdf(text, None, None).unwrap()
}

pub(crate) fn limits(chain: &Chain<6>, acceleration: f64) -> JointLimits<6> {
    let ends = chain.limits();
    JointLimits::new(ends.position, ends.velocity, [acceleration; 6])
        .unwrap()
        .with_stale_braking(5.0 * TICK_S, [0.5 * acceleration; 6])
        .unwrap()
}

/// An arm that follows its own commands: IK, guard, integration.
pub(crate) struct Arm<'a> {
    pub(crate) chain: &'a Chain<6>,
    pub(crate) ik: Ik<6>,
    pub(crate) guard: Guard<6>,
    pub(crate) last: Commanded<6>,
}

impl<'a> Arm<'a> {
    pub(crate) fn new(chain: &'a Chain<6>, q: [f64; 6], acceleration: f64) -> Self {
        let limits = limits(chain, acceleration);
        Self {
            chain,
            ik: Ik::new(limits, IkSettings::for_period(TICK_S, q)),
            guard: Guard::new(limits),
            last: Commanded::at_rest(Stamp(TICK_NS), q).unwrap(),
        }
    }

    pub(crate) fn tick(&mut self, target: &ToolTarget) -> IkReport {
        let kinematics = self.chain.forward(self.last.q());
        let step = self.ik.step(&kinematics, self.last.motion(), target, TICK_S);
        let q: [f64; 6] = std::array::from_fn(|i| self.last.q()[i] + step.qd[i] * TICK_S);
        let verdict = self.guard.clamp(&self.last, &q, self.last.stamp() + TICK_NS);
        assert_eq!(verdict.altered, 0, "the guard had to alter the IK's answer: {:?}", verdict.reasons);
        self.last = verdict.command;
        step.report
    }

    pub(crate) fn tool(&self) -> (Vector3<f64>, Vector3<f64>) {
        let k = self.chain.forward(self.last.q());
        (k.position, k.rotation.column(2).into_owned())
    }
}

/// Wanted motion between the path points of this tick and the next.
pub(crate) fn along(path: impl Fn(f64) -> Vector3<f64>, t: f64) -> ToolTarget {
    let (now, next) = (path(t), path(t + TICK_S));
    ToolTarget { position: now, velocity: (next - now) / TICK_S, axis: -Vector3::z(), spin: None }
}
