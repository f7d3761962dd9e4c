//! Faults of the simulated arm: in its motion, or in its reports.
//!
//! Contract: nothing changes before the fault begins; from then on it stays. Joints are counted from 0 at the
//! base.

use std::f64::consts::TAU;
use std::str::FromStr;

use super::servo::ServoState;
use super::{JOINTS, Joints};

/// Swings per second of [`FaultKind::Oscillation`], where it begins \[rad\], and its growth \[1/s\].
const SWING_HZ: f64 = 4.0;
const SWING_RAD: f64 = 1e-3;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// All joints stop at once.
    Stuck,
    Locked(usize),
    /// The report of one joint freezes; it still moves.
    Frozen(usize),
    /// The base joint is reported with this offset \[rad\].
    Offset(f64),
    /// One joint moves in the opposite direction.
    Flipped(usize),
    /// One joint is reported with an offset of one turn.
    Wrapped(usize),
    /// The base joint turns at this speed whatever its commands are \[rad/s\].
    Runaway(f64),
    /// The program is paused: no more targets are accepted, the servo settles.
    Paused,
    /// Speed scaling as by a slider, in \[0, 1\].
    Slow(f64),
    /// The base joint oscillates about its commanded position, growing at this rate \[1/s\].
    Oscillation(f64),
    /// One joint is no faster than this share of its speed limit, in \[0, 1\]; of a UR5's, where that is
    /// less.
    Ceiling(usize, f64),
    /// One joint goes only this share of each way, in \[0, 1\].
    Gain(usize, f64),
    /// One joint moves in steps: not before its setpoint leads it by this much \[rad\]; see
    /// [`Mechanics::stiction_rad`](super::Mechanics::stiction_rad).
    Stiction(usize, f64),
}

/// A fault and when it begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    pub kind: FaultKind,
    /// When, since the arm began to cycle \[s\].
    pub at_s: f64,
}

/// Text that names no fault.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is not a fault; give KIND@SECONDS or KIND@SECONDS:VALUE: stuck, paused; locked, frozen, flipped or \
     wrapped with a joint, 0 to 5 (0); offset [rad, -6.3 to 6.3] (0.2); runaway [rad/s, -3 to 3] (0.5); \
     slow [share, 0 to 1] (0.3); oscillation [growth per second, 0 to 20] (2); ceiling, gain or stiction \
     with JOINT:SIZE, a share of the speed limit or of the way, 0 to 1, or rad, 0 to 0.5"
)]
pub struct NoFault(String);

impl FromStr for Fault {
    type Err = NoFault;

    fn from_str(text: &str) -> Result<Self, NoFault> {
        let wrong = || NoFault(text.to_owned());
        let (kind, rest) = text.split_once('@').ok_or_else(wrong)?;
        let (at, value) = rest.split_once(':').map_or((rest, None), |(at, value)| (at, Some(value)));
        let number = |text: &str, low: f64, high: f64| {
            text.parse().ok().filter(|value| (low..=high).contains(value)).ok_or_else(wrong)
        };
        let given = |low, high, usual| value.map_or(Ok(usual), |value| number(value, low, high));
        let joint = || match value {
            None => Ok(0),
            Some(value) => value.parse().ok().filter(|joint| *joint < JOINTS).ok_or_else(wrong),
        };
        let sized = |high| {
            let (joint, size) = value.and_then(|value| value.split_once(':')).ok_or_else(wrong)?;
            let joint = joint.parse().ok().filter(|joint| *joint < JOINTS).ok_or_else(wrong)?;
            Ok((joint, number(size, 0.0, high)?))
        };
        let kind = match (kind, value) {
            ("stuck", None) => FaultKind::Stuck,
            ("paused", None) => FaultKind::Paused,
            ("locked", _) => FaultKind::Locked(joint()?),
            ("frozen", _) => FaultKind::Frozen(joint()?),
            ("flipped", _) => FaultKind::Flipped(joint()?),
            ("wrapped", _) => FaultKind::Wrapped(joint()?),
            ("offset", _) => FaultKind::Offset(given(-6.3, 6.3, 0.2)?),
            ("runaway", _) => FaultKind::Runaway(given(-3.0, 3.0, 0.5)?),
            ("slow", _) => FaultKind::Slow(given(0.0, 1.0, 0.3)?),
            ("oscillation", _) => FaultKind::Oscillation(given(0.0, 20.0, 2.0)?),
            ("ceiling", _) => sized(1.0).map(|(joint, share)| FaultKind::Ceiling(joint, share))?,
            ("gain", _) => sized(1.0).map(|(joint, share)| FaultKind::Gain(joint, share))?,
            ("stiction", _) => sized(0.5).map(|(joint, lead)| FaultKind::Stiction(joint, lead))?,
            _ => return Err(wrong()),
        };
        Ok(Self { kind, at_s: number(at, 0.0, 1e6)? })
    }
}

/// A fault that has begun.
#[derive(Debug, Clone, Copy)]
pub(super) struct Broken {
    kind: FaultKind,
    /// Where the joints and their motors were then \[rad\], and for how long it has lasted \[s\].
    from: [f64; JOINTS],
    motors: [f64; JOINTS],
    since_s: f64,
}

impl Broken {
    pub(super) fn new(kind: FaultKind, joints: &Joints, motors: [f64; JOINTS]) -> Self {
        Self { kind, from: joints.q, motors, since_s: 0.0 }
    }

    /// Speed scaling, if that is the fault.
    pub(super) fn scaling(&self) -> Option<f64> {
        match self.kind {
            FaultKind::Paused => Some(0.0),
            FaultKind::Slow(share) => Some(share.clamp(0.0, 1.0)),
            _ => None,
        }
    }

    /// Share of its speed limit that joint `axis` has left, if that is the fault.
    pub(super) fn ceiling(&self, axis: usize) -> Option<f64> {
        match self.kind {
            FaultKind::Ceiling(joint, share) if joint == axis => Some(share.clamp(0.0, 1.0)),
            _ => None,
        }
    }

    /// Another cycle has passed; joints that stand hold their servo and their loop.
    pub(super) fn cycle(&mut self, cycle_s: f64, axes: &mut [&mut [ServoState; JOINTS]; 2]) {
        self.since_s += cycle_s;
        for motions in axes {
            for (axis, (motion, from)) in motions.iter_mut().zip(self.motors).enumerate() {
                let stands = match self.kind {
                    FaultKind::Stuck => true,
                    FaultKind::Locked(joint) => joint == axis,
                    _ => false,
                };
                if stands {
                    *motion = ServoState { q: from, qd: 0.0 };
                }
            }
        }
    }

    /// True positions of joints that a healthy arm would have at `joints`.
    pub(super) fn really(&self, joints: Joints) -> Joints {
        let Joints { mut q, mut qd } = joints;
        match self.kind {
            FaultKind::Flipped(joint) if joint < JOINTS => {
                q[joint] = 2.0 * self.from[joint] - q[joint];
                qd[joint] = -qd[joint];
            }
            FaultKind::Gain(joint, share) if joint < JOINTS => {
                q[joint] = self.from[joint] + share * (q[joint] - self.from[joint]);
                qd[joint] *= share;
            }
            FaultKind::Runaway(speed) => {
                q[0] = self.from[0] + speed * self.since_s;
                qd[0] = speed;
            }
            FaultKind::Oscillation(growth) => {
                let size = SWING_RAD * (growth * self.since_s).exp().min(1e3);
                let phase = TAU * SWING_HZ * self.since_s;
                q[0] += size * phase.sin();
                qd[0] += size * (TAU * SWING_HZ * phase.cos() + growth * phase.sin());
            }
            _ => {}
        }
        Joints { q, qd }
    }

    /// Reported positions of joints that truly are at `joints`.
    pub(super) fn reported(&self, joints: Joints) -> Joints {
        let Joints { mut q, mut qd } = joints;
        match self.kind {
            FaultKind::Frozen(joint) if joint < JOINTS => {
                q[joint] = self.from[joint];
                qd[joint] = 0.0;
            }
            FaultKind::Offset(by) => q[0] += by,
            FaultKind::Wrapped(joint) if joint < JOINTS => q[joint] += TAU,
            _ => {}
        }
        Joints { q, qd }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::{ArmModel, ArmSettings};

    #[test]
    fn faults_are_read_with_and_without_a_value() {
        let read = |text: &str| text.parse::<Fault>().map(|fault| (fault.kind, fault.at_s));
        assert_eq!(read("stuck@2.5"), Ok((FaultKind::Stuck, 2.5)));
        assert_eq!(read("locked@1:3"), Ok((FaultKind::Locked(3), 1.0)));
        assert_eq!(read("offset@0:-0.1"), Ok((FaultKind::Offset(-0.1), 0.0)));
        assert_eq!(read("slow@4"), Ok((FaultKind::Slow(0.3), 4.0)));
        assert_eq!(read("ceiling@2:1:0.1"), Ok((FaultKind::Ceiling(1, 0.1), 2.0)));
        assert_eq!(read("gain@2:5:0.5"), Ok((FaultKind::Gain(5, 0.5), 2.0)));
        assert_eq!(read("stiction@0:2:0.02"), Ok((FaultKind::Stiction(2, 0.02), 0.0)));
        for wrong in ["ceiling@2", "ceiling@2:1", "gain@2:6:0.5", "gain@2:1:1.5", "stiction@2:1:nan"] {
            assert!(read(wrong).unwrap_err().to_string().contains("KIND@SECONDS"), "{wrong}");
        }
        for wrong in
            ["stuck", "stuck@", "stuck@-1", "stuck@nan", "stuck@1:2", "locked@1:6", "slow@1:1.5", "bent@1"]
        {
            assert!(read(wrong).unwrap_err().to_string().contains("KIND@SECONDS"), "{wrong}");
        }
    }

    /// Reported and true position of the base joint 0.2 s after a fault during a motion of 0.5 rad/s.
    fn after(kind: FaultKind) -> [f64; 3] {
        let settings =
            ArmSettings { fault: Some(Fault { kind, at_s: 0.5 }), ..ArmSettings::delayed(0.002, 0.002) };
        let mut arm = ArmModel::at_rest(settings, [0.0; JOINTS]);
        let mut target = 0.0;
        for cycle in 0..350 {
            target = 0.001 * f64::from(cycle);
            let joints = arm.cycle([target; JOINTS]);
            assert!(cycle > 240 || (joints.q[0] - target).abs() < 1e-9, "before the fault: {joints:?}");
        }
        [arm.joints().q[0], arm.really().q[0], target]
    }

    #[test]
    fn each_fault_does_what_it_says() {
        let near = |a: f64, b: f64| (a - b).abs() < 5e-3;
        for kind in [FaultKind::Stuck, FaultKind::Locked(0), FaultKind::Paused] {
            let [reported, is, _] = after(kind);
            assert!(near(reported, 0.25) && near(is, 0.25), "{kind:?}: {reported} {is}");
        }
        let [reported, is, target] = after(FaultKind::Frozen(0));
        assert!(near(reported, 0.25) && near(is, target), "{reported} {is}");
        let [reported, is, target] = after(FaultKind::Offset(0.2));
        assert!(near(reported, target + 0.2) && near(is, target), "{reported} {is}");
        let [reported, is, target] = after(FaultKind::Wrapped(0));
        assert!(near(reported, target + TAU) && near(is, target), "{reported} {is}");
        let [reported, is, target] = after(FaultKind::Flipped(0));
        assert!(near(reported, 0.5 - target) && near(is, 0.5 - target), "{reported} {is}");
        let [reported, is, _] = after(FaultKind::Runaway(-1.0));
        assert!(near(reported, 0.05) && near(is, 0.05), "{reported} {is}");
        let [reported, is, target] = after(FaultKind::Oscillation(0.0));
        assert!(reported == is && (reported - target).abs() < 2.0 * SWING_RAD, "{reported} {is}");
        let [reported, is, _] = after(FaultKind::Ceiling(0, 0.05));
        assert!(near(reported, is) && near(is, 0.25 + 0.05 * 3.342 * 0.2), "{reported} {is}");
        let [reported, is, target] = after(FaultKind::Gain(0, 0.5));
        assert!(near(reported, is) && near(is, 0.25 + 0.5 * (target - 0.25)), "{reported} {is}");
        let [reported, is, target] = after(FaultKind::Stiction(0, 0.15));
        assert!(reported == is && target - is < 0.16, "{reported} {is}");
        // A third of each way, and the rest skipped: two cycles late.
        let [reported, _, target] = after(FaultKind::Slow(1.0 / 3.0));
        assert!(target - reported > 1e-3 && target - reported < 4e-3, "{reported} {target}");
    }
}
