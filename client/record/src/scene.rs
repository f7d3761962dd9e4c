//! What stands around the pen: the arm's shapes, what it keeps away from, and the paper.
//!
//! Contract: the shapes are those that the clearance uses. They are told once, each in the frame that it
//! moves with; where the frames are is told again and again, from the measured joints.

use std::time::Duration;

use foretrace_config::{Config, JOINTS};
use foretrace_control::arm::{Capsule, Chain, Kinematics};
use foretrace_control::geometry::Segment;
use foretrace_shm::TickRecord;
use foretrace_shm::layout::fnv1a;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::topics::scene::{Color, Entity, Solid, update};
use crate::topics::{Turn, frame_transform};

const BASE: &str = "base";
/// The writing plane: z points away from it.
const PAPER: &str = "paper";
/// Between two looks at the previewed path.
const PREVIEW_NS: u64 = Duration::from_millis(20).as_nanos() as u64;
/// Between two looks at where the arm is.
const EVERY_NS: u64 = Duration::from_millis(50).as_nanos() as u64;
/// Radius of the line from the last joint to the tip \[m\]: for the eye, without a part in the clearance.
const PEN_RADIUS_M: f64 = 0.004;
/// A plane has no end; so much of it is shown \[m\].
const PLANE_M: f64 = 2.0;
/// What has no thickness is shown with this one \[m\].
const THIN_M: f64 = 0.001;

const ARM: Color = [0.55, 0.6, 0.68, 1.0];
const PEN: Color = [0.1, 0.1, 0.12, 1.0];
const SHEET: Color = [1.0, 1.0, 1.0, 0.9];
const PREVIEW: Color = [0.48, 0.25, 0.77, 1.0];
const KEEP_OUT: Color = [0.85, 0.25, 0.2, 0.25];

/// The scene of some settings.
#[derive(Debug)]
pub struct Scene {
    hash: u64,
    chain: Chain<JOINTS>,
    plane: ([f64; 3], Turn),
    entities: Vec<Entity>,
    /// When the frames were told.
    told_ns: Option<u64>,
}

impl Scene {
    /// That of the settings in `toml`.
    ///
    /// # Errors
    ///
    /// They are not legal here, in words: they name a file that is not here, for example.
    pub fn of(toml: &[u8]) -> Result<Self, String> {
        let text = std::str::from_utf8(toml).map_err(|error| error.to_string())?;
        let config = Config::recorded(text).map_err(|error| error.to_string())?;
        let (settings, robot) = (config.settings(), config.robot());
        let rotation = settings.plane.rotation();
        let plane = (settings.plane.origin_m, turn(rotation.matrix()));
        let entities = entities(&config);
        Ok(Self { hash: fnv1a(toml), chain: robot.chain.clone(), plane, entities, told_ns: None })
    }

    /// Whether it is that of the settings in `toml`.
    pub fn is_of(&self, toml: &[u8]) -> bool {
        self.hash == fnv1a(toml)
    }

    /// The `SceneUpdate` that replaces all before, at `time_ns` since 1970.
    pub fn update(&self, time_ns: u64) -> Vec<u8> {
        update(&self.entities, time_ns)
    }

    /// Where its frames are at `record`, twenty times a second; nothing in between, and the paper alone while
    /// the arm does not say where it is. `time_ns` is since 1970.
    pub fn frames(&mut self, record: &TickRecord, time_ns: u64) -> Vec<Vec<u8>> {
        let since = |told_ns: u64| record.release_ns.checked_sub(told_ns);
        if self.told_ns.and_then(since).is_some_and(|since_ns| since_ns < EVERY_NS) {
            return Vec::new();
        }
        self.told_ns = Some(record.release_ns);
        let (origin, upright) = &self.plane;
        let mut frames = vec![frame_transform(BASE, PAPER, (origin, *upright), time_ns)];
        if record.joint_state_age_ns != u64::MAX && record.measured_q.iter().all(|q| q.is_finite()) {
            let pose = self.chain.forward(&record.measured_q);
            frames.extend((1..=JOINTS).map(|link| {
                let (rotation, origin) = frame(&pose, link);
                frame_transform(BASE, &link_frame(link), (&origin.into(), turn(&rotation)), time_ns)
            }));
        }
        frames
    }
}

/// The previewed path as a line.
#[derive(Debug, Default)]
pub struct Preview {
    told_ns: u64,
    /// A line is shown.
    shown: bool,
}

impl Preview {
    /// The `SceneUpdate` of the path in `record`, fifty times a second, and once when there is none any more;
    /// `time_ns` is since 1970.
    pub fn update(&mut self, record: &TickRecord, time_ns: u64) -> Option<Vec<u8>> {
        let path = record.path().filter(|at| at.iter().all(|m| m.is_finite()));
        let points: Vec<[f64; 3]> = path.map(|[x, y]| [x.into(), y.into(), 0.0]).collect();
        let soon = record.release_ns.checked_sub(self.told_ns).is_some_and(|since| since < PREVIEW_NS);
        let (shown, shows) = (self.shown, !points.is_empty());
        if !(shown || shows) || (shown && shows && soon) {
            return None;
        }
        (self.told_ns, self.shown) = (record.release_ns, shows);
        let line = Entity {
            frame: PAPER.to_owned(),
            id: "preview".to_owned(),
            color: PREVIEW,
            lines: vec![points],
            ..Entity::default()
        };
        Some(update(if shows { std::slice::from_ref(&line) } else { &[] }, time_ns))
    }
}

/// The frame that `link` moving joints of the base turn.
fn link_frame(link: usize) -> String {
    if link == 0 { BASE.to_owned() } else { format!("arm_{link}") }
}

fn frame(pose: &Kinematics<JOINTS>, link: usize) -> (Matrix3<f64>, Vector3<f64>) {
    let joint = link.checked_sub(1).filter(|joint| *joint < JOINTS);
    joint.map_or((Matrix3::identity(), Vector3::zeros()), |joint| {
        let rotation = pose.frames.get(joint).copied().unwrap_or_else(Matrix3::identity);
        (rotation, pose.origins.column(joint).into_owned())
    })
}

fn turn(matrix: &Matrix3<f64>) -> Turn {
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*matrix));
    [turn.i, turn.j, turn.k, turn.w]
}

fn entities(config: &Config) -> Vec<Entity> {
    let (settings, robot) = (config.settings(), config.robot());
    let chain = &robot.chain;
    let mut entities: Vec<Entity> = (0..=JOINTS)
        .map(|link| {
            let mut entity = Entity {
                frame: link_frame(link),
                id: format!("arm {link}"),
                color: ARM,
                ..Entity::default()
            };
            let own = |capsule: &&Capsule| capsule.link == link;
            for capsule in chain.capsules().iter().filter(own) {
                round(&mut entity, &capsule.segment, capsule.radius);
            }
            entity
        })
        .filter(|entity| !entity.spheres.is_empty())
        .collect();
    // The tip is at the same place of the last link, wherever that is.
    let pose = chain.forward(&robot.home);
    let (rotation, origin) = frame(&pose, JOINTS);
    let tip = rotation.transpose() * (pose.position - origin);
    let mut pen = Entity { frame: link_frame(JOINTS), id: "pen".to_owned(), color: PEN, ..Entity::default() };
    round(&mut pen, &Segment { from: Vector3::zeros(), to: tip }, PEN_RADIUS_M);
    let [[x0, x1], [y0, y1], _] = settings.plane.workspace_m;
    let sheet = Solid {
        centre: [0.5 * (x0 + x1), 0.5 * (y0 + y1), -0.5 * THIN_M],
        turn: turn(&Matrix3::identity()),
        size: [x1 - x0, y1 - y0, THIN_M],
    };
    entities.extend([pen, boxes(PAPER, "paper", SHEET, vec![sheet])]);
    let planes = settings.clearance.planes_m.iter().flatten().map(|[point, normal]| {
        let upright = upright(&Vector3::from(*normal));
        let centre = Vector3::from(*point) - upright * Vector3::new(0.0, 0.0, 0.5 * THIN_M);
        let [x, y, z, w] = [upright.i, upright.j, upright.k, upright.w];
        Solid { centre: centre.into(), turn: [x, y, z, w], size: [PLANE_M, PLANE_M, THIN_M] }
    });
    let cuboids = settings.clearance.boxes_m.iter().flatten().map(|[centre, size, rpy]| {
        let [roll, pitch, yaw] = *rpy;
        let rotation = Rotation3::from_euler_angles(roll, pitch, yaw);
        Solid { centre: *centre, turn: turn(rotation.matrix()), size: *size }
    });
    let keep_out: Vec<Solid> = planes.chain(cuboids).collect();
    if !keep_out.is_empty() {
        entities.push(boxes(BASE, "keep out", KEEP_OUT, keep_out));
    }
    entities
}

fn boxes(frame: &str, id: &str, color: Color, cubes: Vec<Solid>) -> Entity {
    Entity { frame: frame.to_owned(), id: id.to_owned(), color, cubes, ..Entity::default() }
}

/// The turn that takes z to `direction`.
fn upright(direction: &Vector3<f64>) -> UnitQuaternion<f64> {
    // Any half turn about an axis at right angles takes z to its opposite.
    let over = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    UnitQuaternion::rotation_between(&Vector3::z(), direction).unwrap_or_else(over)
}

/// Adds a capsule: a ball at each end, and a cylinder between them.
fn round(entity: &mut Entity, segment: &Segment, radius: f64) {
    let wide = 2.0 * radius;
    let (axis, middle) = (segment.to - segment.from, 0.5 * (segment.from + segment.to));
    let turn_of = upright(&axis);
    let turn = [turn_of.i, turn_of.j, turn_of.k, turn_of.w];
    let solid =
        |centre: Vector3<f64>, high: f64| Solid { centre: centre.into(), turn, size: [wide, wide, high] };
    entity.spheres.push(solid(segment.from, wide));
    if axis.norm() > 0.0 {
        entity.spheres.push(solid(segment.to, wide));
        entity.cylinders.push(solid(middle, axis.norm()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rotated(turn: Turn, vector: Vector3<f64>) -> Vector3<f64> {
        let [i, j, k, w] = turn;
        UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k)) * vector
    }

    #[test]
    fn the_drawn_capsules_are_those_of_the_clearance_wherever_the_arm_is() {
        let config = Config::preset("ur5").unwrap();
        let chain = &config.robot().chain;
        let entities = entities(&config);
        let q = [0.3, -1.1, 1.4, -0.7, 0.5, 0.2];
        let pose = chain.forward(&q);
        let mut drawn = Vec::new();
        for (link, entity) in (0..=JOINTS)
            .filter_map(|link| Some((link, entities.iter().find(|one| one.id == format!("arm {link}"))?)))
        {
            assert_eq!(entity.frame, link_frame(link));
            let (rotation, origin) = frame(&pose, link);
            // As a viewer places it: the frame's place by its quaternion, then the solid's own.
            let position = |at: Vector3<f64>| rotated(turn(&rotation), at) + origin;
            for solid in &entity.cylinders {
                let half = rotated(solid.turn, Vector3::new(0.0, 0.0, 0.5 * solid.size[2]));
                let centre = Vector3::from(solid.centre);
                drawn.push((position(centre - half), position(centre + half), 0.5 * solid.size[0]));
            }
        }
        let long = chain.capsules().iter().filter(|capsule| capsule.segment.from != capsule.segment.to);
        let wanted: Vec<_> = long
            .map(|capsule| {
                let (rotation, origin) = frame(&pose, capsule.link);
                let [a, b] = [0.0, 1.0].map(|share| rotation * capsule.segment.at(share) + origin);
                (a, b, capsule.radius)
            })
            .collect();
        assert!(wanted.len() >= 4, "{}", wanted.len());
        assert_eq!(drawn.len(), wanted.len());
        for (a, b, radius) in wanted {
            let same = |one: &&(Vector3<f64>, Vector3<f64>, f64)| {
                (one.0 - a).norm() < 1e-9 && (one.1 - b).norm() < 1e-9 && (one.2 - radius).abs() < 1e-12
            };
            assert!(drawn.iter().any(|one| same(&one)), "{a} {b} {radius} of {drawn:?}");
        }
        let pen = entities.iter().find(|one| one.id == "pen").unwrap();
        let (rotation, origin) = frame(&pose, JOINTS);
        let tip = Vector3::from(pen.spheres[1].centre);
        assert!((rotated(turn(&rotation), tip) + origin - pose.position).norm() < 1e-9);
    }

    #[test]
    fn frames_come_twenty_times_a_second_and_the_arms_only_while_it_says_where_it_is() {
        let text = Config::preset("ur5").unwrap().render();
        let mut scene = Scene::of(text.as_bytes()).unwrap();
        assert!(scene.is_of(text.as_bytes()) && !scene.is_of(b"other"));
        let known = |tick: u64| TickRecord {
            tick,
            release_ns: 1_000_000_000 + tick * 2_000_000,
            ..TickRecord::default()
        };
        let told: Vec<usize> = (0..100).map(|tick| scene.frames(&known(tick), 1).len()).collect();
        assert_eq!(told.iter().filter(|count| **count > 0).count(), 4, "{told:?} in 0.2 s");
        assert_eq!(told[0], 1 + JOINTS);
        let unknown = TickRecord { joint_state_age_ns: u64::MAX, ..known(200) };
        assert_eq!(scene.frames(&unknown, 1).len(), 1, "the paper is known");
        // A clock that went back, as that of another daemon may.
        assert_eq!(scene.frames(&known(1), 1).len(), 1 + JOINTS);
    }

    #[test]
    fn the_previewed_path_is_reported_fifty_times_a_second_and_its_end_once() {
        let mut preview = Preview::default();
        let mut record = TickRecord::default();
        record.path_m[..6].copy_from_slice(&[0.01, 0.02, 0.03, 0.04, f32::NAN, 0.0]);
        let mut told = |path_points: u32, tick: u64| {
            record.release_ns = 1_000_000_000 + tick * 2_000_000;
            record.path_points = path_points;
            preview.update(&record, 1)
        };
        let has = |bytes: &[u8], number: f32| {
            let wanted = f64::from(number).to_le_bytes();
            bytes.windows(8).any(|eight| eight == wanted)
        };
        let mut lines = Vec::new();
        for tick in 0..100 {
            lines.extend(told(3, tick));
        }
        assert_eq!(lines.len(), 10, "in 0.2 s");
        assert!([0.01, 0.02, 0.03, 0.04].iter().all(|m| has(&lines[0], *m)));
        assert!(!has(&lines[0], f32::NAN), "a point that is not known is left out");
        let end = told(0, 100).unwrap();
        assert!(!has(&end, 0.01) && end.len() < lines[0].len() / 2);
        assert_eq!((told(0, 101), told(0, 200)), (None, None));
        assert!(told(3, 201).is_some());
        // A forged number of points, and a clock that was set back.
        assert!(told(u32::MAX, 300).is_some() && told(3, 250).is_some());
    }

    #[test]
    fn planes_and_boxes_are_shown_where_the_settings_have_them() {
        let text = Config::preset("ur5").unwrap().render();
        let with = |plane: &str| {
            let boxes = "boxes_m = [[[0.0, 0.9, 0.2], [0.1, 0.2, 0.3], [0.0, 0.0, 0.5]]]";
            let text = text.replace("# planes_m is not set", &format!("planes_m = [{plane}]"));
            Scene::of(text.replace("# boxes_m is not set", boxes).as_bytes())
        };
        let refused = with("[[0.0, 0.0, 0.0], [0.0, 0.0, 7.0]]").unwrap_err();
        assert!(refused.contains("clearance.planes_m"), "{refused}");
        let scene = with("[[0.0, 0.0, 1.9], [0.0, 0.0, -1.0]]").unwrap();
        let keep_out = scene.entities.iter().find(|one| one.id == "keep out").unwrap();
        assert_eq!(keep_out.frame, BASE);
        let [ceiling, cuboid] = keep_out.cubes[..] else { panic!("{keep_out:?}") };
        let inwards = rotated(ceiling.turn, Vector3::z());
        assert!((inwards + Vector3::z()).norm() < 1e-12, "{inwards}");
        assert!(ceiling.centre[2] > 1.9, "all of it is behind the plane");
        assert_eq!((cuboid.centre, cuboid.size), ([0.0, 0.9, 0.2], [0.1, 0.2, 0.3]));
        let none = Scene::of(text.as_bytes()).unwrap();
        assert!(none.entities.iter().all(|one| one.id != "keep out"));
        assert!(scene.update(1).len() > none.update(1).len() + 100);
    }
}
