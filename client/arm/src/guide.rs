//! A simulated arm that is moved by hand, with the keys of a terminal: to rehearse what needs a real one.
//!
//! Contract: moves only an arm at rest that has no command in force, as free-drive of a real one does; keeps
//! the tool's direction, and the joints inside their limits. What cannot be reached is reported, and not
//! tried.

use std::collections::VecDeque;
use std::time::Duration;

use foretrace_control::arm::{Chain, JointLimits};
use foretrace_control::ik::{ToolTarget, solve_pose};
use foretrace_sim::arm::JOINTS;
use nalgebra::Vector3;

use foretrace_report::Tell;

/// Lengths of a step, by the keys 1, 2 and 3 \[m\].
const STEPS_M: [f64; 3] = [1e-4, 1e-3, 1e-2];
/// A joint that turns further in one step is on its way to another posture \[rad\].
const FURTHEST_RAD: f64 = 0.3;
/// Keys that are followed in one cycle of the arm: the rest waits, because a pasted text must not take the
/// cycles' time.
const AT_ONCE: usize = 4;
/// After so long without a key the tip's position is reported.
const PAUSE: Duration = Duration::from_millis(500);

/// What the keys ask for.
#[derive(Debug, Clone, Copy, PartialEq)]
enum GuideKey {
    /// Along an axis of the base frame.
    Move(Vector3<f64>),
    /// Length of the next steps \[m\].
    Step(f64),
}

impl GuideKey {
    /// Of the last byte of a key: those of the arrows are `ESC [ A` to `ESC [ D`.
    fn of(key: u8) -> Option<Self> {
        let [finest, fine, coarse] = STEPS_M;
        Some(match key {
            b'A' => Self::Move(Vector3::x()),
            b'B' => Self::Move(-Vector3::x()),
            b'D' => Self::Move(Vector3::y()),
            b'C' => Self::Move(-Vector3::y()),
            b'+' | b'=' => Self::Move(Vector3::z()),
            b'-' | b'_' => Self::Move(-Vector3::z()),
            b'1' => Self::Step(finest),
            b'2' => Self::Step(fine),
            b'3' => Self::Step(coarse),
            _ => return None,
        })
    }
}

/// The keys, and the arm that they move.
pub struct Guide {
    keys: Box<dyn FnMut() -> Vec<u8>>,
    waiting: VecDeque<GuideKey>,
    chain: Chain<JOINTS>,
    limits: JointLimits<JOINTS>,
    step_m: f64,
    /// When the tip was moved and its position not reported yet \[ns\].
    moved: Option<u64>,
}

/// What the keys do.
pub const HELP: &str = "guided by hand while it is not armed: arrows move the tip along the base's x (up, down) \
                        and y (left, right), + and - along z; 1, 2 and 3 set the step to 0.1, 1 and 10 mm";

impl Guide {
    /// `keys` gives what was typed since it was last asked, and does not wait.
    pub fn new(
        chain: &Chain<JOINTS>,
        limits: &JointLimits<JOINTS>,
        keys: Box<dyn FnMut() -> Vec<u8>>,
    ) -> Self {
        let waiting = VecDeque::new();
        Self { keys, waiting, chain: chain.clone(), limits: *limits, step_m: STEPS_M[1], moved: None }
    }

    /// Where the joints go from `rest` by what was typed until `now_ns` \[rad\]; `rest` is `None` while the
    /// arm follows commands.
    pub(crate) fn look(
        &mut self,
        rest: Option<[f64; JOINTS]>,
        now_ns: u64,
        tell: Tell<'_>,
    ) -> Option<[f64; JOINTS]> {
        let mut q = rest;
        if self.waiting.is_empty() {
            self.waiting.extend((self.keys)().into_iter().filter_map(GuideKey::of));
        }
        for _ in 0..AT_ONCE {
            let Some(key) = self.waiting.pop_front() else { break };
            match key {
                GuideKey::Step(step_m) => {
                    self.step_m = step_m;
                    tell(&format!("arm: steps of {} mm", step_m * 1e3));
                }
                GuideKey::Move(along) => {
                    let Some(from) = q else {
                        tell("arm: follows commands: it cannot be guided by hand now");
                        continue;
                    };
                    match reached(&self.chain, &self.limits, &from, &(along * self.step_m)) {
                        Some(to) => (q, self.moved) = (Some(to), Some(now_ns)),
                        None => tell("arm: the tip cannot go further that way"),
                    }
                }
            }
        }
        let q = q?;
        let paused = |since: &u64| now_ns.saturating_sub(*since) >= PAUSE.as_nanos() as u64;
        if self.moved.take_if(|since| paused(since)).is_some() {
            let [x, y, z] = (self.chain.forward(&q).position * 1e3).into();
            tell(&format!("arm: tip at {x:.1}, {y:.1}, {z:.1} mm in the base frame"));
        }
        (Some(q) != rest).then_some(q)
    }
}

/// Joints that have the tip `by` away from where it is at `q`, with the same direction \[rad\]; `None` where
/// the arm does not reach.
fn reached(
    chain: &Chain<JOINTS>,
    limits: &JointLimits<JOINTS>,
    q: &[f64; JOINTS],
    by: &Vector3<f64>,
) -> Option<[f64; JOINTS]> {
    let at = chain.forward(q);
    let [x, axis] = [0, 2].map(|column| at.rotation.column(column).into_owned());
    let found = solve_pose(chain, q, &ToolTarget::at_rest(at.position + by, axis, Some(x)))?;
    let legal = found.iter().zip(limits.position()).all(|(q, [low, high])| *low <= *q && *q <= *high);
    let calm = found.iter().zip(q).all(|(a, b)| (a - b).abs() <= FURTHEST_RAD);
    (legal && calm).then_some(found)
}

#[cfg(test)]
mod tests {
    use foretrace_config::Config;

    use super::*;

    fn robot() -> foretrace_config::Robot {
        Config::parse("preset = \"ur5\"\n", "test", ".").unwrap().robot().clone()
    }

    #[test]
    fn steps_add_up_and_keep_the_tools_direction() {
        let robot = robot();
        let (chain, limits) = (&robot.chain, &robot.limits);
        let begin = chain.forward(&robot.home);
        let mut q = robot.home;
        for _ in 0..50 {
            q = reached(chain, limits, &q, &Vector3::new(1e-3, 0.0, 0.0)).unwrap();
        }
        q = reached(chain, limits, &q, &Vector3::new(0.0, -1e-2, 1e-2)).unwrap();
        let end = chain.forward(&q);
        assert!((end.position - begin.position - Vector3::new(0.05, -0.01, 0.01)).norm() < 1e-5);
        assert!((end.rotation - begin.rotation).norm() < 1e-4);
    }

    #[test]
    fn where_the_arm_does_not_reach_it_stays() {
        let robot = robot();
        let (chain, limits) = (&robot.chain, &robot.limits);
        let mut q = robot.home;
        let mut steps = 0;
        while let Some(next) = reached(chain, limits, &q, &Vector3::new(0.0, 0.0, 1e-2)) {
            assert!(next.iter().zip(&q).all(|(a, b)| (a - b).abs() <= FURTHEST_RAD));
            (q, steps) = (next, steps + 1);
            assert!(steps < 200, "an arm of 0.85 m");
        }
        assert!(steps > 10);
    }

    #[test]
    fn keys_are_known_by_their_last_byte() {
        assert_eq!(GuideKey::of(b'A'), Some(GuideKey::Move(Vector3::x())));
        assert_eq!(GuideKey::of(b'3'), Some(GuideKey::Step(1e-2)));
        assert_eq!(GuideKey::of(b'q'), None);
    }
}
