//! Capsules from the URDF, and rows against finite differences of their distances.

use crate::support::reaching;

use reaching::*;

use foretrace_control::arm::{Chain, ChainError, JointMotion, VelocityBox, velocity_box};
use foretrace_control::clearance::Inside;
use foretrace_control::clearance::{Clearance, ClearanceError, ClearanceSettings, Obstacle};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn settings() -> ClearanceSettings {
    ClearanceSettings { margin_m: 0.01, itself: true, obstacles: Vec::new() }
}

fn clearance(chain: &Chain<6>, settings: &ClearanceSettings) -> Clearance<6> {
    Clearance::new(chain, &limits(chain, 40.0), TICK_S, settings).unwrap()
}

/// The UR5 with other shapes in place of those of one link.
fn reshaped(link: &str, shape: impl Fn(&str) -> String) -> String {
    let (before, rest) = UR5.split_once(&format!("<link name=\"{link}\">")).unwrap();
    let (inside, after) = rest.split_once("</link>").unwrap();
    let mut parts = inside.split("<geometry>");
    let first = parts.next().unwrap().to_owned();
    let others = parts.map(|part| {
        let (old, beyond) = part.split_once("</geometry>").unwrap();
        format!("<geometry>{}</geometry>{beyond}", shape(old))
    });
    let inside = others.fold(first, |all, part| all + &part);
    format!("{before}<link name=\"{link}\">{inside}</link>{after}")
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
    // The frame of the last joint is rotated so that z is its axis; only the position of the pen matters.
    let k = chain.forward(&UR5_HOME);
    let (rotation, origin) = (k.frames[5], k.origins.column(5));
    let tip = rotation * pen.segment.to + origin;
    let expected = k.position + k.rotation * Vector3::new(0.0, 0.0, 0.11);
    assert!((tip - expected).norm() < 1e-9, "{tip} {expected}");
    assert_eq!((named("ball").link, named("ball").radius), (3, 0.03));
    assert!(chain.mesh_links().is_empty());
}

#[test]
fn meshes_are_named_and_bad_shapes_refused() {
    let mesh = reshaped("wrist_1", |_| r#"<mesh filename="wrist.stl"/>"#.to_owned());
    let chain = Chain::<6>::from_urdf(&mesh, None, None).unwrap();
    assert_eq!(chain.mesh_links(), ["wrist_1"]);
    for bad in ["0", "-0.1"] {
        let text = reshaped("wrist_3", |_| format!(r#"<sphere radius="{bad}"/>"#));
        let error = Chain::<6>::from_urdf(&text, None, None).unwrap_err();
        assert!(matches!(&error, ChainError::Shape { link } if link.name == "wrist_3"), "{error}");
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
        let nearest = kept.nearest(&chain.forward(&home)).unwrap();
        assert!(nearest.distance_m > 0.03, "{nearest:?}");
        let pairs: Vec<_> = kept.links().map(|[a, b]| (a, b)).collect();
        for wanted in [(1, 3), (2, 4), (1, 4), (0, 4), (1, 5), (2, 6), (1, 6)] {
            assert!(pairs.contains(&wanted), "{wanted:?} {pairs:?}");
        }
        // Joined by two joints, but without collision in every posture.
        assert!(!pairs.contains(&(4, 6)), "{pairs:?}");
        // A connector stands out of the UR5's base: an upper arm that hangs down meets it.
        assert_eq!(pairs.contains(&(0, 2)), text == UR5, "{pairs:?}");
    }
}

/// Σ c_j q̇_j is the rate of the row's distance.
#[test]
fn rows_are_the_gradients_of_distances() {
    let mut rng = Pcg64::seed_from_u64(1);
    let chain = chain(UR5);
    let mut itself = clearance(&chain, &settings());
    let mut checked = [0; 3];
    for round in 0..9_000 {
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
        let here = kept.nearest(&chain.forward(&q)).unwrap();
        if here.distance_m < 0.005 {
            continue;
        }
        let h = 1e-6;
        let numeric: [f64; 6] = std::array::from_fn(|j| {
            let at = |delta: f64| {
                let mut q = q;
                q[j] += delta;
                kept.nearest(&chain.forward(&q)).unwrap().distance_m
            };
            (at(h) - at(-h)) / (2.0 * h)
        });
        // A wide box, so that every row could matter; some are displaced by rows with less room.
        let allowed = VelocityBox { lower: [-100.0; 6], upper: [100.0; 6] };
        let bound = -kept.rate_hz() * (here.distance_m - 0.01);
        let rows = kept.rows(&chain.forward(&q), &JointMotion::at_rest(q), &allowed, TICK_S, Inside::Retreat);
        let mut found = rows.iter().filter(|(_, b)| (b - bound).abs() < 1e-9);
        // Where two bodies are equally near the difference quotient is meaningless.
        let (Some((row, _)), None) = (found.next(), found.next()) else { continue };
        let error = row.iter().zip(&numeric).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(error < 1e-4, "{round}: {row:?} {numeric:?} {here:?}");
        checked[kind] += 1;
    }
    assert!(checked.iter().all(|count| *count > 30), "{checked:?}");
}

/// Skipping pairs that cannot have come near makes no difference: slow and fast motion, sudden stops, and
/// jumps of the joint positions as in a re-synchronisation.
#[test]
fn what_is_remembered_changes_no_row() {
    let chain = chain(UR5);
    let wanted = ClearanceSettings {
        obstacles: vec![
            Obstacle::plane([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]).unwrap(),
            Obstacle::cuboid([-0.55, 0.2, 0.1], [0.2, 0.2, 0.3], [0.0, 0.2, 0.5]).unwrap(),
        ],
        ..settings()
    };
    let anew = clearance(&chain, &wanted);
    let mut kept = anew.clone();
    let limits = limits(&chain, 40.0);
    let mut rng = Pcg64::seed_from_u64(2);
    let mut motion = JointMotion::at_rest(UR5_HOME);
    let (mut rowed, mut bare) = (0, 0);
    for tick in 0..20_000 {
        if tick % 50 == 0 {
            let speed = [0.0, 0.02, 0.3, 3.0][rng.random_range(0..4)];
            motion.qd = std::array::from_fn(|_| speed * rng.random_range(-1.0..1.0));
        }
        if rng.random_bool(0.01) {
            let size = [1e-3, 0.05, 1.5][rng.random_range(0..3)];
            motion.q = std::array::from_fn(|i| motion.q[i] + size * rng.random_range(-1.0..1.0));
        }
        for i in 0..6 {
            motion.q[i] = (motion.q[i] + motion.qd[i] * TICK_S).clamp(UR5_HOME[i] - 1.5, UR5_HOME[i] + 1.5);
        }
        let elapsed = if rng.random_bool(0.05) { 4.0 * TICK_S } else { TICK_S };
        let allowed = velocity_box(&motion, &limits, elapsed);
        let k = chain.forward(&motion.q);
        let inside = if rng.random_bool(0.3) { Inside::Stay } else { Inside::Retreat };
        let remembered = kept.rows(&k, &motion, &allowed, elapsed, inside);
        let mut anew = anew.clone();
        let fresh = anew.rows(&k, &motion, &allowed, elapsed, inside);
        assert_eq!(remembered, fresh, "{tick}");
        rowed += usize::from(!fresh.is_empty());
        bare += usize::from(fresh.is_empty());
    }
    assert!(rowed > 2_000 && bare > 2_000, "{rowed} {bare}");
}
