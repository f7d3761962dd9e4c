//! A baseline in closed loop: its target in the plane becomes joints, which go to the same arms as the law's.
//!
//! Contract: the baseline receives the pen as the law does (same wait, samples at the first tick at or after
//! their stamp). The tool keeps the height and the orientation that it has at home; joints are found by
//! damped least squares, without limits of ours, as baselines are used in practice: the arm's own clamps
//! apply. On an arm without a servo, baselines that smooth in the servo get one in software. With `-legal`,
//! joints are kept inside velocity and acceleration limits ([`LegalTargets`]). Absent: lift, workspace,
//! guard.

use foretrace_config::Config;
use foretrace_control::arm::{Chain, JointLimits};
use foretrace_control::follower::{FollowerSettings, JointCommand, Request};
use foretrace_control::pen::PenReading;
use foretrace_control::plane::Plane;
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::Stamp;
use foretrace_sim::arm::JOINTS;
use foretrace_sim::metrics::ToolSample;
use foretrace_sim::path::PathSample;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::legal::LegalTargets;
use super::{BenchArm, Flaws};
use crate::baselines::{Baseline, BaselineError, BaselineKind, BaselineSettings, Limits, build, soften};
use crate::experiments::{
    AWAY_NS, ClosedLoop, Desk, DeskArm, Measured, RunError, TickTrace, epoch, exceeds, feed, settings_for,
};

/// The settings of the baseline `kind` on `arm`.
#[must_use]
pub(super) fn baseline_settings(config: &Config, arm: BenchArm, kind: BaselineKind) -> BaselineSettings {
    let period_s = config.settings().period_ns() as f64 * 1e-9;
    let law = settings_for(config, &arm.kind(config).facts(), PredictorKind::HOLD);
    let least = |of: fn(&foretrace_control::mpc::AxisLimits) -> f64| {
        law.mpc.axes.iter().take(2).map(of).fold(f64::INFINITY, f64::min)
    };
    let limits = if arm.limited() {
        Limits {
            velocity_mps: least(|axis| axis.velocity_mps),
            acceleration_mps2: least(|axis| axis.acceleration_mps2),
            jerk_mps3: least(|axis| axis.jerk_mps3),
        }
    } else {
        Limits::OFF
    };
    let with = |dead_time_s| BaselineSettings::new(kind, period_s, dead_time_s, limits, arm.glyph_height_m());
    let facts = arm.kind_for_baseline(config, with(0.0).servo).facts();
    with(facts.group_delay_s.unwrap_or(0.0))
}

/// A baseline and its arm.
pub(super) struct BaselineDesk {
    way: Box<dyn Baseline>,
    reach: PlaneToJoints,
    arm: Box<dyn DeskArm>,
    measured: Measured,
    period_ns: u64,
    pen_age_ns: u64,
    now: Stamp,
    /// Commanded joints \[rad\] and their velocity \[rad/s\].
    q: [f64; JOINTS],
    qd: [f64; JOINTS],
    /// `None` in front of an arm without any.
    limits: Option<JointLimits<JOINTS>>,
    legal: Option<LegalTargets>,
    /// Commanded tool \[m\] and its velocity \[m/s\].
    tool: Option<([f64; 2], [f64; 2])>,
}

impl BaselineDesk {
    /// An arm at home behind the baseline `kind`, with the plane and chain of `law`.
    ///
    /// # Errors
    /// A setting outside its range.
    pub(super) fn new(
        config: &Config,
        law: &FollowerSettings<JOINTS>,
        arm: BenchArm,
        kind: BaselineKind,
        settings: &BaselineSettings,
        flaws: &Flaws,
    ) -> Result<Self, BaselineError> {
        let mut way = build(kind, settings)?;
        let behind = flaws.of(arm.kind_for_baseline(config, settings.servo));
        if kind.smooths_in_the_servo() && !behind.facts().servo {
            way = soften(way, settings);
        }
        let home = config.robot().home;
        let now = epoch(law.period_ns);
        Ok(Self {
            way,
            reach: PlaneToJoints::new(&law.chain, law.plane, &home),
            arm: behind.built(home),
            measured: Measured::plain(now, home, [0.0; JOINTS]),
            period_ns: law.period_ns,
            pen_age_ns: 0,
            now,
            q: home,
            qd: [0.0; JOINTS],
            limits: arm.limited().then_some(law.limits),
            legal: None,
            tool: None,
        })
    }

    /// With commands inside the limits, where there are any.
    pub(super) fn kept_legal(mut self) -> Self {
        let period_s = self.period_ns as f64 * 1e-9;
        self.legal = self.limits.map(|limits| LegalTargets::new(limits, period_s));
        self
    }

    /// One period with the pen samples `due`.
    fn tick(&mut self, due: &[PathSample]) -> Result<TickTrace, RunError> {
        let period_s = self.period_ns as f64 * 1e-9;
        let target = self.way.target(seconds(self.now), due).filter(|at| at.iter().all(|x| x.is_finite()));
        let before = self.q;
        if let Some(target) = target {
            self.q = self.reach.joints(before, target);
            if let Some(legal) = &mut self.legal {
                self.q = legal.command(&before, &self.qd, &self.q);
            }
        }
        let mut qd = self.q;
        for (qd, before) in qd.iter_mut().zip(before) {
            *qd = (*qd - before) / period_s;
        }
        let illegal = self.limits.is_some_and(|limits| exceeds(&limits, &self.qd, &qd, period_s));
        self.qd = qd;
        self.now = self.now + self.period_ns;
        let stamp = self.now;
        let command = JointCommand { stamp, valid_until: stamp, q: self.q, qd, enabled: true };
        self.measured = self.arm.step(stamp, Some(&command)).map_err(RunError::Arm)?;
        let (was, velocity) = self.tool.unwrap_or((target.unwrap_or_default(), [0.0; 2]));
        let setpoint = target.unwrap_or(was);
        let moved = [0, 1].map(|axis| (setpoint[axis] - was[axis]) / period_s);
        if target.is_some() {
            self.tool = Some((setpoint, moved));
        }
        Ok(TickTrace {
            t_s: f64::NAN,
            setpoint,
            reference: setpoint,
            acceleration: [0, 1].map(|axis| (moved[axis] - velocity[axis]) / period_s),
            // Baselines have no trust.
            alpha: f64::NAN,
            limited: self.arm.clamped() || self.way.limited(),
            illegal,
        })
    }
}

impl Desk for BaselineDesk {
    fn delay_pen(&mut self, age_ns: u64) {
        self.pen_age_ns = age_ns;
    }

    /// `requests` are for the law and are ignored.
    fn write(
        &mut self,
        path: &[PathSample],
        wait_s: f64,
        _requests: &[(f64, Request)],
    ) -> Result<ClosedLoop, RunError> {
        let (first, last) = path.first().zip(path.last()).ok_or(RunError::Empty)?;
        let away = self.now + AWAY_NS;
        while self.tool.is_some() && self.now < away {
            self.tick(&[])?;
        }
        let begin = self.now;
        let start_s = first.t_s - wait_s;
        let stamp_of = |t_s: f64| begin + ((t_s - start_s) * 1e9).round().max(0.0) as u64;
        let pen = feed(path, first, last, wait_s, stamp_of);
        let mut out = ClosedLoop::default();
        let mut samples = pen.iter().peekable();
        let mut due = Vec::new();
        let end = pen.last().map_or(begin, |sample| sample.stamp) + self.pen_age_ns;
        while self.now <= end {
            due.clear();
            while let Some(sample) = samples.next_if(|sample| sample.stamp + self.pen_age_ns <= self.now) {
                due.push(self.reach.heard(sample));
            }
            let tick = self.tick(&due)?;
            let t_s = self.now.seconds_since(begin) + start_s;
            let [x_m, y_m] = self.reach.tool(&self.measured.q);
            out.tool.push(ToolSample { t_s, x_m, y_m });
            out.ticks.push(TickTrace { t_s, ..tick });
        }
        Ok(out)
    }
}

fn seconds(stamp: Stamp) -> f64 {
    stamp.0 as f64 * 1e-9
}

/// Longest step of the solver [m]: a farther target takes several.
const STEP_M: f64 = 0.05;
const STEPS: usize = 100;
/// Tolerance of the pose \[m, rad\].
const REACHED: f64 = 1e-10;
/// Damping of the least squares; with a reach of a metre it only shows at singularities.
const DAMPING: f64 = 1e-9;

struct PlaneToJoints {
    chain: Chain<JOINTS>,
    plane: Plane,
    /// Of the tool in the plane's frame \[m\].
    height_m: f64,
    rotation: Matrix3<f64>,
}

impl PlaneToJoints {
    fn new(chain: &Chain<JOINTS>, plane: Plane, home: &[f64; JOINTS]) -> Self {
        let pose = chain.forward(home);
        let height_m = plane.point_from_base(&pose.position).z;
        Self { chain: chain.clone(), plane, height_m, rotation: pose.rotation }
    }

    /// Where the tool of joints at `q` \[rad\] is in the plane \[m\].
    fn tool(&self, q: &[f64; JOINTS]) -> [f64; 2] {
        let tool = self.plane.point_from_base(&self.chain.forward(q).position);
        [tool.x, tool.y]
    }

    fn heard(&self, sample: &PenReading) -> PathSample {
        let [x_m, y_m] = self.plane.from_pen(sample.position);
        PathSample { t_s: seconds(sample.stamp), x_m, y_m, contact: sample.contact }
    }

    /// Joints \[rad\] near `q` with the tool at `target` \[m\] in the plane; as near as the steps get if it
    /// is out of reach.
    fn joints(&self, mut q: [f64; JOINTS], target: [f64; 2]) -> [f64; JOINTS] {
        let goal = self.plane.point_to_base(&Vector3::new(target[0], target[1], self.height_m));
        for _ in 0..STEPS {
            let pose = self.chain.forward(&q);
            let way = goal - pose.position;
            let way = way * (STEP_M / way.norm().max(STEP_M));
            let turn: Vector3<f64> =
                (0..3).map(|i| pose.rotation.column(i).cross(&self.rotation.column(i)) * 0.5).sum();
            let error = Vector6::new(way.x, way.y, way.z, turn.x, turn.y, turn.z);
            if error.norm() <= REACHED {
                break;
            }
            let normal = pose.jacobian * pose.jacobian.transpose() + Matrix6::identity() * DAMPING;
            let Some(solver) = normal.cholesky() else { break };
            let step = pose.jacobian.transpose() * solver.solve(&error);
            for (q, dq) in q.iter_mut().zip(step.iter()) {
                *q += dq;
            }
        }
        q
    }
}
