//! The inverse kinematics as an optimum: against projected gradients, Clarabel, and targets beyond the
//! limits.

use crate::support::reaching;

use reaching::*;

use foretrace_clarabel::ClarabelProfile;
use foretrace_control::arm::{Chain, JointLimits, JointMotion, velocity_box};
use foretrace_control::guard::Guard;
use foretrace_control::ik::{Ik, IkSettings, IkSource, ToolTarget, solve_pose, task};
use foretrace_control::qp::backend::Backend;
use nalgebra::{SVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A random state and a random target, often beyond the limits.
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
    // A well-conditioned cost, so that the slow second method converges closely enough for a comparison.
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
        Ik::new(limits, settings).with_backend(Backend::Other(&ClarabelProfile::Default)).unwrap();
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

/// IK and guard share the box: whatever the target does, the guard finds nothing to alter, close to limits
/// too.
#[test]
fn the_guard_never_alters_the_ik() {
    let chain = chain(UR5);
    let mut rng = Pcg64::seed_from_u64(6);
    for jerk in [None, Some([800.0; 6])] {
        let mut arm = Arm::new(&chain, UR5_HOME, 20.0);
        // Narrow joints: every one of them reaches its limits.
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
