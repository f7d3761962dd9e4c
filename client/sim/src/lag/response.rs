//! A joint's commanded path on a fine uniform grid, and the response of a linear arm to it.
//!
//! Contract: between commands the path is straight, as their consumer evaluates it; before the first one and
//! after the last one it stands still. The filters are exact for such a path, up to the grid. Absent: limits,
//! friction.

use super::Sample;
use crate::arm::JOINTS;

/// Spacing of the grid [s]: between its points a path that the loop commands is straight to less than a
/// microradian.
const GRID_S: f64 = 1e-3;

/// Positions on a grid \[rad\], per joint.
#[derive(Debug, Clone)]
pub(super) struct CommandGrid {
    begin_s: f64,
    q: [Vec<f64>; JOINTS],
}

impl CommandGrid {
    /// The polyline through `commands` (times rising, at least one), for the given joints; the others are
    /// left empty.
    pub(super) fn commanded(commands: &[Sample], joints: &[usize]) -> Self {
        let begin_s = commands.first().map_or(0.0, |first| first.t_s);
        let end_s = commands.last().map_or(0.0, |last| last.t_s);
        let count = ((end_s - begin_s) / GRID_S).ceil() as usize + 1;
        let mut q: [Vec<f64>; JOINTS] = Default::default();
        for joint in joints {
            let mut next = 0;
            q[*joint] = (0..count)
                .map(|index| {
                    let t_s = begin_s + index as f64 * GRID_S;
                    while next < commands.len() && commands[next].t_s < t_s {
                        next += 1;
                    }
                    match (next.checked_sub(1).and_then(|before| commands.get(before)), commands.get(next)) {
                        (Some(a), Some(b)) => {
                            let part = (t_s - a.t_s) / (b.t_s - a.t_s);
                            a.q[*joint] + part * (b.q[*joint] - a.q[*joint])
                        }
                        (Some(only), None) | (None, Some(only)) => only.q[*joint],
                        (None, None) => 0.0,
                    }
                })
                .collect();
        }
        Self { begin_s, q }
    }

    /// Behind a critically damped second-order servo of group delay `filter_s` and a first order of
    /// `joint_loop_s`, both at rest before the path begins; 0: none.
    ///
    /// 1/(1 + L s/2)² · 1/(1 + τ s), for input that is straight between grid points: exact.
    pub(super) fn filtered(&self, filter_s: f64, joint_loop_s: f64) -> Self {
        let mut out = self.clone();
        for q in &mut out.q {
            if filter_s > 0.0 {
                second_order(q, filter_s);
            }
            if joint_loop_s > 0.0 {
                first_order(q, joint_loop_s);
            }
        }
        out
    }

    /// Where `joint` is at `t_s` \[rad\].
    pub(super) fn at(&self, joint: usize, t_s: f64) -> f64 {
        let q = &self.q[joint];
        let position = ((t_s - self.begin_s) / GRID_S).max(0.0);
        let (index, part) = (position as usize, position.fract());
        match (q.get(index), q.get(index + 1)) {
            (Some(a), Some(b)) => a + part * (b - a),
            _ => q.last().copied().unwrap_or_default(),
        }
    }
}

fn second_order(q: &mut [f64], filter_s: f64) {
    let w = 2.0 / filter_s;
    let decay = (-w * GRID_S).exp();
    let Some(&first) = q.first() else { return };
    let (mut from, mut y, mut yd) = (first, first, 0.0);
    for value in q {
        let slope = (*value - from) / GRID_S;
        let lag = filter_s * slope;
        // In the frame of the steady ramp the motion is homogeneous; see the simulated arm's servo.
        let (e, ed) = (y - (from - lag), yd - slope);
        from = *value;
        y = from - lag + (e + (ed + w * e) * GRID_S) * decay;
        yd = slope + (ed - w * (ed + w * e) * GRID_S) * decay;
        *value = y;
    }
}

fn first_order(q: &mut [f64], tau_s: f64) {
    let decay = (-GRID_S / tau_s).exp();
    let Some(&first) = q.first() else { return };
    let (mut from, mut y) = (first, first);
    for value in q {
        let lag = tau_s * (*value - from) / GRID_S;
        y = *value - lag + (y - (from - lag)) * decay;
        from = *value;
        *value = y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_follow_a_ramp_by_their_group_delay_and_stand_where_it_ends() {
        let ramp: Vec<Sample> = (0..=500)
            .map(|k| {
                let t_s = f64::from(k) * 0.002;
                Sample { t_s, q: [0.3 + 0.5 * t_s; JOINTS] }
            })
            .collect();
        let path = CommandGrid::commanded(&ramp, &[0, 3]);
        assert!((path.at(3, 0.4567) - 0.3 - 0.5 * 0.4567).abs() < 1e-12);
        assert_eq!((path.at(0, -1.0), path.at(0, 5.0)), (0.3, 0.8));
        for (filter_s, tau_s) in [(0.03, 0.0), (0.0, 0.02), (0.1, 0.005), (1e-5, 1e-5)] {
            let behind = path.filtered(filter_s, tau_s).at(0, 0.99);
            assert!((behind - (0.3 + 0.5 * (0.99 - filter_s - tau_s))).abs() < 1e-6, "{filter_s} {tau_s}");
        }
    }
}
