//! The IK step: optimal, inside the box, exact along reachable paths, smooth through singularities.

use foretrace_control::guard::{Commanded, Guard};
use foretrace_control::ik::{
    Chain, Ik, IkBackend, IkReport, IkSettings, IkSource, JointLimits, JointMotion, ToolTarget, solve_pose,
    task, velocity_box,
};
use foretrace_control::qp::clarabel::ClarabelProfile;
use foretrace_control::units::Stamp;
use nalgebra::{SVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{FRAC_PI_2, PI};

const UR5: &str = include_str!("../../../config/robots/ur5.urdf");
const UR5E: &str = include_str!("../../../config/robots/ur5e.urdf");
const TICK_S: f64 = 2e-3;
const TICK_NS: u64 = 2_000_000;

/// Tool down, 0.45 m in front of the base and 0.2 m above its foot.
const UR5_HOME: [f64; 6] = [0.0, -1.48188, 2.10901, -2.19792, -FRAC_PI_2, 0.0];
const UR5E_HOME: [f64; 6] = [0.0, -1.3895, 2.188, -2.36929, -FRAC_PI_2, 0.0];

fn chain(text: &str) -> Chain<6> {
    Chain::from_urdf(text, None, None).unwrap()
}

fn limits(chain: &Chain<6>, acceleration: f64) -> JointLimits<6> {
    let ends = chain.limits();
    JointLimits::new(ends.position, ends.velocity, [acceleration; 6])
        .unwrap()
        .with_stale_braking(5.0 * TICK_S, [0.5 * acceleration; 6])
        .unwrap()
}

/// An arm that follows its own commands: IK, guard, integration.
struct Arm<'a> {
    chain: &'a Chain<6>,
    ik: Ik<6>,
    guard: Guard<6>,
    last: Commanded<6>,
}

impl<'a> Arm<'a> {
    fn new(chain: &'a Chain<6>, q: [f64; 6], acceleration: f64) -> Self {
        let limits = limits(chain, acceleration);
        Self {
            chain,
            ik: Ik::new(limits, IkSettings::for_period(TICK_S, q)),
            guard: Guard::new(limits),
            last: Commanded::at_rest(Stamp(TICK_NS), q).unwrap(),
        }
    }

    fn tick(&mut self, target: &ToolTarget) -> IkReport {
        let kinematics = self.chain.forward(self.last.q());
        let step = self.ik.step(&kinematics, self.last.motion(), target, TICK_S);
        let q: [f64; 6] = std::array::from_fn(|i| self.last.q()[i] + step.qd[i] * TICK_S);
        let verdict = self.guard.clamp(&self.last, &q, self.last.stamp() + TICK_NS);
        assert_eq!(verdict.altered, 0, "the guard had to alter the IK's answer: {:?}", verdict.reasons);
        self.last = verdict.command;
        step.report
    }

    fn tool(&self) -> (Vector3<f64>, Vector3<f64>) {
        let k = self.chain.forward(self.last.q());
        (k.position, k.rotation.column(2).into_owned())
    }
}

/// Wanted motion between the path points of this tick and the next.
fn along(path: impl Fn(f64) -> Vector3<f64>, t: f64) -> ToolTarget {
    let (now, next) = (path(t), path(t + TICK_S));
    ToolTarget { position: now, velocity: (next - now) / TICK_S, axis: -Vector3::z(), spin: None }
}

#[test]
fn home_poses_stand_over_the_writing_plane() {
    for (text, home, expected) in [
        (UR5, UR5_HOME, Vector3::new(-0.45, -0.10915, 0.2)),
        (UR5E, UR5E_HOME, Vector3::new(-0.45, -0.1333, 0.2)),
    ] {
        let k = chain(text).forward(&home);
        assert!((k.position - expected).norm() < 1e-5, "{}", k.position);
        assert!((k.rotation.column(2) + Vector3::z()).norm() < 1e-4);
        assert!((k.rotation.column(0) - Vector3::y()).norm() < 1e-4);
    }
}

/// A line of 20 cm in 2 s with smooth ends, then back: the tool is where it should be at every tick.
#[test]
fn a_line_in_the_workspace_is_tracked_to_a_micrometre() {
    for (text, home) in [(UR5, UR5_HOME), (UR5E, UR5E_HOME)] {
        let chain = chain(text);
        let start = chain.forward(&home).position;
        let path = |t: f64| start + Vector3::new(0.06, 0.08, -0.02) * (1.0 - (PI * t / 2.0).cos());
        let mut arm = Arm::new(&chain, home, 20.0);
        for tick in 0..2000 {
            let t = f64::from(tick) * TICK_S;
            let report = arm.tick(&along(path, t));
            let (position, axis) = arm.tool();
            let error = (position - path(t + TICK_S)).norm();
            assert!(error < 1e-6, "{error} m at {t} s");
            assert!((axis + Vector3::z()).norm() < 1e-4, "{axis}");
            assert_eq!((report.source, report.active.count()), (IkSource::Optimum, 0));
            assert!(report.velocity_error.norm() < 1e-6 && report.kkt_residual <= 1e-9, "{report:?}");
        }
    }
}

/// Letters of 30 mm with peaks of 10 m/s² and 0.45 m/s: inside 40 rad/s² nothing is altered.
#[test]
fn handwriting_peaks_fit_into_the_arms_acceleration() {
    for (text, home) in [(UR5, UR5_HOME), (UR5E, UR5E_HOME)] {
        let chain = chain(text);
        let start = chain.forward(&home).position;
        let omega = (10.0f64 / 0.015).sqrt();
        // Eased in over half a second: a circle of radius 15 mm has 10 m/s² all the time.
        let path = |t: f64| {
            let ease = (t / 0.5).min(1.0);
            let r = 0.015 * ease * ease * ease * (10.0 - 15.0 * ease + 6.0 * ease * ease);
            start + Vector3::new((omega * t).cos(), (omega * t).sin(), 0.0) * r
        };
        let mut arm = Arm::new(&chain, home, 40.0);
        let mut peak: f64 = 0.0;
        for tick in 0..1500 {
            let t = f64::from(tick) * TICK_S;
            let report = arm.tick(&along(path, t));
            assert_eq!(report.active.count(), 0);
            assert!((arm.tool().0 - path(t + TICK_S)).norm() < 5e-6);
            peak = arm.last.qdd().iter().fold(peak, |p, a| p.max(a.abs()));
        }
        assert!(peak > 20.0 && peak < 35.0, "{peak} rad/s²");
    }
}

/// The rotation about the tool axis is free, yet does not wander off while writing.
#[test]
fn the_wrist_does_not_drift_over_many_letters() {
    let chain = chain(UR5);
    let start = chain.forward(&UR5_HOME).position;
    let path = |t: f64| start + Vector3::new((7.0 * t).sin(), 1.0 - (5.0 * t).cos(), 0.0) * 0.03;
    let mut arm = Arm::new(&chain, UR5_HOME, 20.0);
    for tick in 0..30_000 {
        arm.tick(&along(path, f64::from(tick) * TICK_S));
    }
    assert!((arm.last.q()[5] - UR5_HOME[5]).abs() < 0.2, "{:?}", arm.last.q());
}

#[test]
fn a_tilted_and_spun_tool_is_turned_upright() {
    let chain = chain(UR5);
    let mut q = UR5_HOME;
    (q[3], q[4], q[5]) = (q[3] + 0.4, q[4] - 0.3, 1.2);
    let position = chain.forward(&q).position;
    let mut arm = Arm::new(&chain, q, 20.0);
    let target = ToolTarget::at_rest(position, -Vector3::z(), Some(Vector3::y()));
    for _ in 0..3000 {
        arm.tick(&target);
    }
    let k = chain.forward(arm.last.q());
    assert!((k.position - position).norm() < 1e-9);
    assert!((k.rotation.column(2) + Vector3::z()).norm() < 1e-9);
    assert!((k.rotation.column(0) - Vector3::y()).norm() < 1e-6);
    assert!(arm.last.qd().iter().all(|v| v.abs() < 1e-9));
}

/// A distant target is approached by a braking profile: no overshoot in spite of weak joints.
#[test]
fn a_jump_of_the_target_is_approached_without_overshoot() {
    let chain = chain(UR5);
    let start = chain.forward(&UR5_HOME).position;
    let goal = start + Vector3::new(0.1, 0.05, 0.0);
    let mut arm = Arm::new(&chain, UR5_HOME, 10.0);
    let target = ToolTarget::at_rest(goal, -Vector3::z(), None);
    let mut altered = 0;
    for _ in 0..2000 {
        altered += u32::from(arm.tick(&target).velocity_error.norm() > 1e-3);
        let progress = (arm.tool().0 - start).dot(&(goal - start)) / (goal - start).norm_squared();
        assert!(progress < 1.001, "{progress}");
    }
    assert!((arm.tool().0 - goal).norm() < 1e-8);
    assert!(altered > 0, "the acceleration limit must have shown in the report");
}

/// Straight through the wrist singularity (q5 = 0), and into full stretch: finite, continuous, inside the box.
#[test]
fn singularities_are_passed_without_stop_jump_or_nan() {
    let chain = chain(UR5);
    for (mut q, direction, tilt) in [
        (UR5_HOME, Vector3::new(0.0, 0.15, 0.0), 1.2),
        (UR5_HOME, Vector3::new(-0.6, 0.0, 0.1), 0.0),
        (UR5_HOME, Vector3::new(0.45, 0.1, 0.0), 0.0),
    ] {
        if tilt > 0.0 {
            // Wrist 2 starts beyond zero, and the axis wanted leads it across.
            q[4] = 0.3;
        }
        let k = chain.forward(&q);
        let (start, axis) = (k.position, k.rotation.column(2).into_owned());
        let turn = chain
            .forward(&{
                let mut q = q;
                q[4] -= tilt;
                q
            })
            .rotation
            .column(2)
            .into_owned();
        let mut arm = Arm::new(&chain, q, 20.0);
        let (mut nearest, mut damped, mut moved) = (f64::INFINITY, 0.0f64, 0.0);
        for tick in 0..3000 {
            let t = f64::from(tick) * TICK_S / 6.0;
            let path = |t: f64| start + direction * (0.5 - 0.5 * (PI * (t / 6.0).min(1.0)).cos());
            let mut target = along(path, t * 6.0);
            target.axis = axis.lerp(&turn, t).normalize();
            let before = arm.last;
            let report = arm.tick(&target);
            assert!(arm.last.motion().is_finite());
            assert_eq!(report.source, IkSource::Optimum);
            for i in 0..6 {
                assert!((arm.last.qd()[i] - before.qd()[i]).abs() <= 20.0 * TICK_S + 1e-9);
            }
            nearest = report.singularity.min(nearest);
            damped = report.damping.max(damped);
            moved = arm.last.qd().iter().fold(moved, |m: f64, v| m.max(v.abs()));
        }
        assert!(nearest < 0.01 && damped > 1e-4, "never came near: {nearest} {damped}");
        assert!(moved > 0.01);
    }
}

#[test]
fn damping_is_a_smooth_function_of_the_joints() {
    let chain = chain(UR5);
    let settings = IkSettings::for_period(TICK_S, UR5_HOME);
    let damping = |q4: f64| {
        let mut q = UR5_HOME;
        q[4] = q4;
        let target = ToolTarget::at_rest(Vector3::zeros(), -Vector3::z(), None);
        task::assemble(&chain.forward(&q), &q, &[0.0; 6], &target, &settings, TICK_S).damping
    };
    let mut last = damping(-1.0);
    for k in -9_999..10_000 {
        let next = damping(f64::from(k) * 1e-4);
        // Peak 1e-3 over a range of about 0.1 rad: 1e-4 rad change it by 1e-6 at the usual slope.
        assert!((next - last).abs() < 5e-6, "{} at {k}", next - last);
        last = next;
    }
    assert!(damping(0.0) > 0.9 * settings.damping_peak_m2 && damping(-1.0) == settings.damping_floor_m2);
}

#[test]
fn singularity_lies_between_its_bounds() {
    let chain = chain(UR5E);
    let mut rng = Pcg64::seed_from_u64(1);
    let settings = IkSettings::for_period(TICK_S, UR5_HOME);
    for _ in 0..5_000 {
        let q: [f64; 6] = std::array::from_fn(|_| rng.random_range(-PI..PI));
        let target = ToolTarget::at_rest(Vector3::zeros(), -Vector3::z(), None);
        let task = task::assemble(&chain.forward(&q), &q, &[0.0; 6], &target, &settings, TICK_S);
        let smallest = task.rows.fixed_rows::<5>(0).into_owned().singular_values().min();
        let floor = settings.damping_floor_m2.sqrt();
        assert!(task.singularity <= smallest + floor && task.singularity >= (smallest - floor) / 5f64.sqrt());
    }
}

/// A random state and a random wish, often beyond the limits.
fn random_problem(
    rng: &mut Pcg64,
    chain: &Chain<6>,
    limits: &JointLimits<6>,
) -> (JointMotion<6>, ToolTarget) {
    let q: [f64; 6] = std::array::from_fn(|i| UR5_HOME[i] + rng.random_range(-0.8..0.8));
    let mut motion = JointMotion::at_rest(q);
    motion.qd = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
    assert!(limits.is_viable(&motion));
    let mut around = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
    let k = chain.forward(&q);
    let target = ToolTarget {
        position: k.position + around(0.002),
        velocity: around(0.5),
        axis: (-Vector3::z() + around(0.2)).normalize(),
        spin: Some(around(1.0)),
    };
    (motion, target)
}

/// The optimum by another method: projected gradient with Nesterov's momentum, restarted, to convergence.
fn projected_gradient(task: &task::Task<6>, lower: &[f64; 6], upper: &[f64; 6]) -> SVector<f64, 6> {
    let step = 1.0 / task.h.symmetric_eigenvalues().max();
    let project = |x: SVector<f64, 6>| {
        x.zip_zip_map(&SVector::from(*lower), &SVector::from(*upper), |x, l, u| x.max(l).min(u))
    };
    let (mut x, mut y, mut momentum) = (project(SVector::zeros()), project(SVector::zeros()), 1.0f64);
    for _ in 0..200_000 {
        let next = project(y - (task.h * y + task.g) * step);
        if (next - x).norm() < 1e-15 && momentum > 1.0 {
            break;
        }
        if (y - next).dot(&(next - x)) > 0.0 {
            (momentum, y) = (1.0, x);
            continue;
        }
        let grown = 0.5 + (0.25 + momentum * momentum).sqrt();
        y = next + (next - x) * ((momentum - 1.0) / grown);
        (x, momentum) = (next, grown);
    }
    x
}

#[test]
fn the_step_is_the_optimum_in_the_box() {
    let chain = chain(UR5);
    let limits = limits(&chain, 15.0);
    let mut settings = IkSettings::for_period(TICK_S, UR5_HOME);
    // A well-conditioned cost, so that the slow second method gets close enough to compare.
    settings.damping_floor_m2 = 1e-4;
    settings.spin_weight = 1.0;
    let mut ik = Ik::new(limits, settings);
    let mut rng = Pcg64::seed_from_u64(2);
    let mut active = [0u32; 7];
    for _ in 0..400 {
        let (motion, target) = random_problem(&mut rng, &chain, &limits);
        let k = chain.forward(&motion.q);
        let step = ik.step(&k, &motion, &target, TICK_S);
        let allowed = velocity_box(&motion, &limits, TICK_S);
        let task = task::assemble(&k, &motion.q, &motion.qd, &target, &settings, TICK_S);
        let other = projected_gradient(&task, &allowed.lower, &allowed.upper);
        let x = SVector::from(step.qd);
        assert!((x - other).amax() < 1e-6, "{x} {other}");
        let cost = |x: &SVector<f64, 6>| (0.5 * task.h * x + task.g).dot(x);
        assert!(cost(&x) <= cost(&other) + 1e-12);
        active[step.report.active.count() as usize] += 1;
    }
    assert!(active[0] < 400 && active[2..].iter().sum::<u32>() > 50, "the box must matter: {active:?}");
}

#[test]
fn clarabel_finds_the_same_step() {
    let chain = chain(UR5);
    let limits = limits(&chain, 15.0);
    let settings = IkSettings::for_period(TICK_S, UR5_HOME);
    let mut exact = Ik::new(limits, settings);
    let mut clarabel =
        Ik::new(limits, settings).with_backend(IkBackend::Clarabel(ClarabelProfile::Default)).unwrap();
    let mut rng = Pcg64::seed_from_u64(3);
    for _ in 0..300 {
        let (motion, target) = random_problem(&mut rng, &chain, &limits);
        let k = chain.forward(&motion.q);
        let (a, b) = (exact.step(&k, &motion, &target, TICK_S), clarabel.step(&k, &motion, &target, TICK_S));
        assert_eq!((a.report.source, b.report.source), (IkSource::Optimum, IkSource::Optimum));
        let task = task::assemble(&k, &motion.q, &motion.qd, &target, &settings, TICK_S);
        let cost = |qd: [f64; 6]| (task.rows * SVector::from(qd) - task.wanted).norm_squared();
        let scale = task.wanted.norm_squared() + 1e-6;
        assert!(cost(a.qd) <= cost(b.qd) + 1e-7 * scale, "{} {}", cost(a.qd), cost(b.qd));
        assert!((cost(a.qd) - cost(b.qd)).abs() <= 1e-5 * scale, "{} {}", cost(a.qd), cost(b.qd));
    }
}

#[test]
fn any_wish_gives_velocities_in_the_box() {
    let chain = chain(UR5);
    let limits = limits(&chain, 15.0);
    let mut ik = Ik::new(limits, IkSettings::for_period(TICK_S, UR5_HOME));
    let mut rng = Pcg64::seed_from_u64(4);
    let mut seen = [0u32; 3];
    for _ in 0..50_000 {
        let (motion, mut target) = random_problem(&mut rng, &chain, &limits);
        let bad = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300, -1e308, 0.0, 1e-320]
            [rng.random_range(0..7usize)];
        match rng.random_range(0..6) {
            0 => target.position[rng.random_range(0..3usize)] = bad,
            1 => target.velocity[rng.random_range(0..3usize)] = bad,
            2 => target.axis[rng.random_range(0..3usize)] = bad,
            3 => target.spin = Some(Vector3::repeat(bad)),
            4 => target.axis = Vector3::z(),
            _ => {}
        }
        let step = ik.step(&chain.forward(&motion.q), &motion, &target, TICK_S);
        let allowed = velocity_box(&motion, &limits, TICK_S);
        for i in 0..6 {
            assert!(step.qd[i] >= allowed.lower[i] && step.qd[i] <= allowed.upper[i], "{step:?}");
        }
        seen[step.report.source as usize] += 1;
    }
    assert!(seen[IkSource::Optimum as usize] > 10_000 && seen[IkSource::Brake as usize] > 1_000, "{seen:?}");
}

#[test]
fn poses_the_arm_can_reach_are_found() {
    let chain = chain(UR5);
    let mut rng = Pcg64::seed_from_u64(5);
    for _ in 0..500 {
        let q: [f64; 6] = std::array::from_fn(|i| UR5_HOME[i] + rng.random_range(-0.5..0.5));
        let k = chain.forward(&q);
        let (x, z) = (k.rotation.column(0).into_owned(), k.rotation.column(2).into_owned());
        let found =
            solve_pose(&chain, &UR5_HOME, &ToolTarget::at_rest(k.position, z, Some(x))).expect("reachable");
        let reached = chain.forward(&found);
        assert!(
            (reached.position - k.position).norm() < 2e-9 && (reached.rotation - k.rotation).norm() < 1e-7
        );
    }
}

#[test]
fn poses_the_arm_cannot_reach_are_not_claimed() {
    let chain = chain(UR5);
    for position in
        [Vector3::new(-1.2, 0.0, 0.2), Vector3::new(0.0, 0.0, 3.0), Vector3::new(f64::NAN, 0.0, 0.0)]
    {
        assert_eq!(solve_pose(&chain, &UR5_HOME, &ToolTarget::at_rest(position, -Vector3::z(), None)), None);
    }
}

#[test]
fn seven_joints_follow_too() {
    // The UR5 on a turntable of its own: one joint more than the task needs.
    let turntable = r#"<link name="world"/><joint name="table" type="continuous"><parent link="world"/>
        <child link="base_link"/><origin xyz="0.2 0 0"/><axis xyz="0 0 1"/><limit velocity="1" effort="10"/></joint>"#;
    let chain =
        Chain::<7>::from_urdf(&UR5.replace("</robot>", &format!("{turntable}</robot>")), None, None).unwrap();
    let ends = chain.limits();
    let limits = JointLimits::new(ends.position, ends.velocity, [20.0; 7]).unwrap();
    let mut home = [0.0; 7];
    home[1..].copy_from_slice(&UR5_HOME);
    let mut ik = Ik::new(limits, IkSettings::for_period(TICK_S, home));
    let start = chain.forward(&home).position;
    let path = |t: f64| start + Vector3::new((7.0 * t).sin(), 1.0 - (5.0 * t).cos(), 0.0) * 0.03;
    let mut motion = JointMotion::at_rest(home);
    for tick in 0..20_000 {
        let t = f64::from(tick) * TICK_S;
        let k = chain.forward(&motion.q);
        if tick > 100 {
            assert!((k.position - path(t)).norm() < 1e-6, "{} at {t}", (k.position - path(t)).norm());
        }
        let step = ik.step(&k, &motion, &along(path, t), TICK_S);
        motion.qdd = std::array::from_fn(|i| (step.qd[i] - motion.qd[i]) / TICK_S);
        motion.qd = step.qd;
        motion.q = std::array::from_fn(|i| motion.q[i] + step.qd[i] * TICK_S);
    }
    for (q, home) in motion.q.iter().zip(home) {
        assert!((q - home).abs() < 0.5, "drifted: {:?}", motion.q);
    }
}

/// IK and guard share the box: whatever the target does, the guard finds nothing to alter, close to limits too.
#[test]
fn the_guard_never_alters_the_ik() {
    let chain = chain(UR5);
    let mut rng = Pcg64::seed_from_u64(6);
    for jerk in [None, Some([800.0; 6])] {
        let mut arm = Arm::new(&chain, UR5_HOME, 20.0);
        // Narrow joints: every one of them meets its limits.
        let position = UR5_HOME.map(|q| [q - 0.2, q + 0.15]);
        let mut limits = JointLimits::new(position, [1.5; 6], [20.0; 6]).unwrap();
        limits = limits.with_stale_braking(5.0 * TICK_S, [10.0; 6]).unwrap();
        if let Some(jerk) = jerk {
            limits = limits.with_jerk(jerk).unwrap();
        }
        arm.ik = Ik::new(limits, *arm.ik.settings());
        arm.guard = Guard::new(limits);
        let start = arm.tool().0;
        let mut at_limit = 0;
        let mut target = ToolTarget::at_rest(start, -Vector3::z(), None);
        for _ in 0..20_000 {
            if rng.random_bool(0.01) {
                let mut around = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
                target.position = start + around(0.4);
                target.velocity = around(0.6);
                target.axis = (-Vector3::z() + around(0.5)).normalize();
                target.spin = Some(around(1.0));
            }
            arm.tick(&target);
            let near = arm
                .last
                .q()
                .iter()
                .zip(position)
                .any(|(q, [low, high])| *q < low + 0.005 || *q > high - 0.005);
            at_limit += u32::from(near);
        }
        assert!(at_limit > 1_000, "{at_limit}");
    }
}
