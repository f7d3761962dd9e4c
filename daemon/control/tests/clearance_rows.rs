//! Capsules from the URDF, and rows against finite differences of the distances they come from.

#[path = "support/reaching.rs"]
mod reaching;

use reaching::*;

use foretrace_control::ik::clearance::{Clearance, ClearanceError, ClearanceSettings, Obstacle};
use foretrace_control::ik::{Chain, ChainError, JointMotion, Kinematics, VelocityBox, velocity_box};
use foretrace_control::qp::row_qp::RowSet;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn settings() -> ClearanceSettings {
    ClearanceSettings { margin_m: 0.01, itself: true, obstacles: Vec::new() }
}

fn clearance(chain: &Chain<6>, settings: &ClearanceSettings) -> Clearance<6> {
    Clearance::new(chain, &limits(chain, 40.0), TICK_S, settings).unwrap()
}

#[test]
fn shapes_become_capsules_in_the_joints_frames() {
    let text = UR5.replace(
        "<link name=\"tool0\"/>",
        r#"<link name="tool0"/>
        <link name="pen"><collision><origin xyz="0 0 0.05" rpy="0 0 0"/><geometry><box size="0.02 0.02 0.1"/></geometry></collision></link>
        <joint name="holder" type="fixed"><parent link="tool0"/><child link="pen"/><origin xyz="0 0 0.01" rpy="0 0 0"/></joint>
        <link name="ball"><collision><geometry><sphere radius="0.03"/></geometry></collision></link>
        <joint name="side" type="fixed"><parent link="forearm"/><child link="ball"/><origin xyz="0 0 0.2" rpy="0 0 0"/></joint>"#,
    );
    let chain = Chain::<6>::from_urdf(&text, None, Some("tool0")).unwrap();
    let named = |name: &str| chain.capsules().iter().find(|capsule| capsule.name == name).unwrap();
    let pen = named("pen");
    assert_eq!(pen.link, 6);
    assert!((pen.radius - 0.01 * 2f64.sqrt()).abs() < 1e-12);
    assert!((pen.segment.from - pen.segment.to).norm() - 0.1 < 1e-12);
    // The frame of the last joint is turned so that z is its axis; what counts is where the pen is.
    let k = chain.forward(&UR5_HOME);
    let (rotation, origin) = chain.frames(&UR5_HOME)[5];
    let tip = rotation * pen.segment.to + origin;
    let expected = k.position + k.rotation * Vector3::new(0.0, 0.0, 0.11);
    assert!((tip - expected).norm() < 1e-9, "{tip} {expected}");
    assert_eq!((named("ball").link, named("ball").radius), (3, 0.03));
    assert!(chain.mesh_links().is_empty());
}

#[test]
fn meshes_are_named_and_bad_shapes_refused() {
    let mesh = UR5.replace("<cylinder length=\"0.06\" radius=\"0.045\"/>", "<mesh filename=\"wrist.stl\"/>");
    let chain = Chain::<6>::from_urdf(&mesh, None, None).unwrap();
    assert_eq!(chain.mesh_links(), ["wrist_1"]);
    for bad in ["0", "-0.1"] {
        let text = UR5.replace("radius=\"0.0375\"", &format!("radius=\"{bad}\""));
        let error = Chain::<6>::from_urdf(&text, None, None).unwrap_err();
        assert_eq!(error, ChainError::Shape { link: "wrist_3".to_owned() });
    }
    let bare = UR5.replace("<collision>", "<visual>").replace("</collision>", "</visual>");
    let bare = Chain::<6>::from_urdf(&bare, None, None).unwrap();
    let wall = Obstacle::plane([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]).unwrap();
    let with_wall = ClearanceSettings { obstacles: vec![wall], ..settings() };
    let refused = Clearance::new(&bare, &limits(&bare, 40.0), TICK_S, &with_wall).unwrap_err();
    assert!(matches!(refused, ClearanceError::NoShape { .. }));
    let thin = ClearanceSettings { margin_m: 1e-4, ..settings() };
    let refused = Clearance::new(&chain, &limits(&chain, 40.0), TICK_S, &thin).unwrap_err();
    assert!(refused.to_string().contains("0.001 to 0.2 m"), "{refused}");
}

#[test]
fn embedded_arms_are_clear_of_themselves_at_home() {
    for (text, home) in [(UR5, UR5_HOME), (UR5E, UR5E_HOME)] {
        let chain = chain(text);
        let kept = clearance(&chain, &settings());
        let nearest = kept.nearest(&home).unwrap();
        assert!(nearest.distance_m > 0.03, "{nearest:?}");
        let pairs: Vec<_> = kept
            .pairs()
            .iter()
            .map(|[a, b]| (chain.capsules()[*a].link, chain.capsules()[*b].link))
            .collect();
        for wanted in [(1, 3), (2, 4), (1, 4), (0, 4), (1, 5), (2, 6), (1, 6)] {
            assert!(pairs.contains(&wanted), "{wanted:?} {pairs:?}");
        }
        // Joined by two joints, but out of each other's way in every posture.
        assert!(!pairs.contains(&(4, 6)) && !pairs.contains(&(0, 2)), "{pairs:?}");
    }
}

/// Σ c_j q̇_j is the rate of the distance that the row is about.
#[test]
fn rows_are_the_gradients_of_distances() {
    let mut rng = Pcg64::seed_from_u64(1);
    let chain = chain(UR5);
    let mut itself = clearance(&chain, &settings());
    let mut checked = [0; 3];
    for round in 0..1_500 {
        let mut q: [f64; 6] = std::array::from_fn(|_| rng.random_range(-3.0..3.0));
        let mut around = |size: f64| std::array::from_fn(|_| rng.random_range(-size..size));
        let normal: Vector3<f64> = Vector3::from(around(1.0)).normalize();
        let kind = round % 3;
        let obstacle = match kind {
            1 => Obstacle::plane(around(0.4), normal.into()).unwrap(),
            _ => Obstacle::cuboid(around(0.6), [0.2, 0.3, 0.1], around(3.0)).unwrap(),
        };
        if kind == 0 {
            q[2] = rng.random_range(2.3..2.9);
        }
        let alone = ClearanceSettings { itself: false, obstacles: vec![obstacle], ..settings() };
        let mut other = clearance(&chain, &alone);
        let kept = if kind == 0 { &mut itself } else { &mut other };
        let here = kept.nearest(&q).unwrap();
        if here.distance_m < 0.005 {
            continue;
        }
        let h = 1e-6;
        let numeric: [f64; 6] = std::array::from_fn(|j| {
            let at = |delta: f64| {
                let mut q = q;
                q[j] += delta;
                kept.nearest(&q).unwrap().distance_m
            };
            (at(h) - at(-h)) / (2.0 * h)
        });
        // A wide box, so that every row that there is could matter; some are crowded out by rows that are nearer to breaking.
        let allowed = VelocityBox { lower: [-100.0; 6], upper: [100.0; 6] };
        let bound = -kept.rate_hz() * (here.distance_m - 0.01);
        let rows = kept.rows(&chain.forward(&q), &JointMotion::at_rest(q), &allowed, TICK_S);
        let mut found = rows.iter().filter(|(_, b)| (b - bound).abs() < 1e-9);
        // Where two bodies are equally near the difference means nothing.
        let (Some((row, _)), None) = (found.next(), found.next()) else { continue };
        let error = row.iter().zip(&numeric).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(error < 1e-4, "{round}: {row:?} {numeric:?} {here:?}");
        checked[kind] += 1;
    }
    assert!(checked.iter().all(|count| *count > 30), "{checked:?}");
}

/// What a tick leaves out because nothing can have come near makes no difference.
#[test]
fn skipped_looks_would_have_found_nothing() {
    let chain = chain(UR5);
    let table = Obstacle::plane([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]).unwrap();
    let wanted = ClearanceSettings { obstacles: vec![table], ..settings() };
    let mut kept = clearance(&chain, &wanted);
    let limits = limits(&chain, 40.0);
    let mut rng = Pcg64::seed_from_u64(2);
    let (mut motion, mut rowed) = (JointMotion::at_rest(UR5_HOME), 0);
    for tick in 0..2_000 {
        if tick % 100 == 0 {
            motion.qd = std::array::from_fn(|_| rng.random_range(-3.0..3.0));
        }
        for i in 0..6 {
            motion.q[i] = (motion.q[i] + motion.qd[i] * TICK_S).clamp(UR5_HOME[i] - 1.5, UR5_HOME[i] + 1.5);
        }
        let allowed = velocity_box(&motion, &limits, TICK_S);
        let k = chain.forward(&motion.q);
        let remembered = kept.rows(&k, &motion, &allowed, TICK_S);
        let fresh = sometimes_anew(&chain, &wanted, &mut rng, tick, &k, &motion, &allowed);
        if let Some(fresh) = fresh {
            assert_eq!(remembered, fresh);
            rowed += usize::from(!fresh.is_empty());
        }
    }
    assert!(rowed > 5, "{rowed}");
}

/// A look without memory, in some of the ticks (setting one up takes long).
fn sometimes_anew(
    chain: &Chain<6>,
    wanted: &ClearanceSettings,
    rng: &mut Pcg64,
    tick: usize,
    k: &Kinematics<6>,
    motion: &JointMotion<6>,
    allowed: &VelocityBox<6>,
) -> Option<RowSet<6>> {
    (tick % 40 == 39 || rng.random_range(0..200) == 0)
        .then(|| clearance(chain, wanted).rows(k, motion, allowed, TICK_S))
}
