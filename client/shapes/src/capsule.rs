//! The smallest capsule around a cloud of points, nearly.
//!
//! For a line (direction u, point c) let t be a point's place along it and ρ its distance from it. A capsule
//! of radius r ≥ max ρ holds all points when its axis reaches from a = min(t + √(r² − ρ²)) to b = max(t −
//! √(r² − ρ²)); where a > b a sphere does. The volume πr²·max(b − a, 0) + 4πr³/3 is minimised over u (2
//! angles), c (2 offsets) and r, by Nelder and Mead's simplex from each principal axis. Only the points that
//! are farthest in some direction count.
//!
//! Contract: what is returned holds every point, whatever the search found. *Source*: Nelder and Mead, "A
//! simplex method for function minimization", The Computer Journal 7, 1965.

use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Vector3};

/// Directions in which the farthest points are looked for.
const DIRECTIONS: usize = 800;
/// The same where a fit is only a beginning.
const FEW_DIRECTIONS: usize = 150;
/// Evaluations of one search.
const EVALUATIONS: usize = 900;
/// Numbers that are searched: two angles, two offsets, the radius' excess.
const SEARCHED: usize = 5;
/// Written with this many metres per unit: a tenth of a micrometre.
pub(crate) const WRITTEN_M: f64 = 1e-7;

/// All points within `radius` of the piece from −length/2 to length/2 of the z axis of a frame \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshCapsule {
    /// Origin of that frame \[m\].
    pub centre: [f64; 3],
    /// Its roll, pitch and yaw \[rad\], as in URDF.
    pub rpy: [f64; 3],
    /// Between the centres of its half-spheres \[m\]; 0: a sphere.
    pub length: f64,
    /// \[m\].
    pub radius: f64,
}

impl MeshCapsule {
    pub(crate) fn volume(&self) -> f64 {
        volume(self.radius, self.length)
    }

    /// How far `point` is from the axis \[m\].
    pub(crate) fn distance(&self, point: &Vector3<f64>) -> f64 {
        let [roll, pitch, yaw] = self.rpy;
        let axis = Rotation3::from_euler_angles(roll, pitch, yaw) * Vector3::z();
        let seen = point - Vector3::from(self.centre);
        let along = axis.dot(&seen).clamp(-0.5 * self.length, 0.5 * self.length);
        (seen - axis * along).norm()
    }

    /// The same with a radius smaller by `outside` \[m\], as far as there is one.
    pub(crate) fn smaller(self, outside: f64) -> Self {
        Self { radius: (self.radius - outside).max(WRITTEN_M), ..self }
    }

    /// The same with numbers as they are written, and a radius that still holds all `points`.
    pub(crate) fn written(self, points: &[Vector3<f64>]) -> Self {
        let round = |x: f64| (x / WRITTEN_M).round() * WRITTEN_M;
        let rough = Self {
            centre: self.centre.map(round),
            rpy: self.rpy.map(round),
            length: round(self.length),
            radius: 0.0,
        };
        let radius = points.iter().map(|point| rough.distance(point)).fold(0.0, f64::max);
        Self { radius: ((radius / WRITTEN_M).ceil() + 1.0) * WRITTEN_M, ..rough }
    }
}

/// A capsule by the ends of its axis \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CapsuleAxis {
    pub(crate) from: Vector3<f64>,
    pub(crate) to: Vector3<f64>,
    pub(crate) radius: f64,
}

impl CapsuleAxis {
    pub(crate) fn of(capsule: &MeshCapsule) -> Self {
        let [roll, pitch, yaw] = capsule.rpy;
        let half = Rotation3::from_euler_angles(roll, pitch, yaw) * Vector3::z() * (0.5 * capsule.length);
        let centre = Vector3::from(capsule.centre);
        Self { from: centre - half, to: centre + half, radius: capsule.radius }
    }

    pub(crate) fn capsule(&self) -> MeshCapsule {
        let along = self.to - self.from;
        MeshCapsule {
            centre: ((self.from + self.to) * 0.5).into(),
            rpy: turned(&along.try_normalize(0.0).unwrap_or_else(Vector3::z)),
            length: along.norm(),
            radius: self.radius,
        }
    }

    pub(crate) fn volume(&self) -> f64 {
        volume(self.radius, (self.to - self.from).norm())
    }

    /// The square of how far `point` is from the axis \[m²\].
    pub(crate) fn squared(&self, point: &Vector3<f64>) -> f64 {
        let (along, seen) = (self.to - self.from, point - self.from);
        let share = along.dot(&seen) / along.norm_squared().max(f64::MIN_POSITIVE);
        (seen - along * share.clamp(0.0, 1.0)).norm_squared()
    }

    /// How far the capsule reaches along a unit vector \[m\].
    pub(crate) fn reach(&self, direction: &Vector3<f64>) -> f64 {
        self.from.dot(direction).max(self.to.dot(direction)) + self.radius
    }

    /// How far the farthest of `points` is from the axis \[m\].
    pub(crate) fn farthest(&self, points: &[Vector3<f64>]) -> f64 {
        points.iter().map(|point| self.squared(point)).fold(0.0, f64::max).sqrt()
    }

    pub(crate) fn frame(&self) -> SamplingFrame {
        let along = self.to - self.from;
        let length = along.norm();
        let turn = frame(&along.try_normalize(0.0).unwrap_or_else(Vector3::z));
        let tube = length / (length + 4.0 / 3.0 * self.radius).max(f64::MIN_POSITIVE);
        SamplingFrame { centre: (self.from + self.to) * 0.5, turn, length, radius: self.radius, tube }
    }
}

/// A place in the unit cube, as what it means in a cylinder and in a ball of radius 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ProfileSample {
    u: f64,
    root: f64,
    cube_root: f64,
    direction: [f64; 2],
}

impl ProfileSample {
    pub(crate) fn at([u, v, w]: [f64; 3]) -> Self {
        let (sin, cos) = (std::f64::consts::TAU * w).sin_cos();
        Self { u, root: v.sqrt(), cube_root: v.cbrt(), direction: [cos, sin] }
    }
}

/// Maps the unit cube to a capsule, equal volumes to equal volumes.
#[derive(Debug)]
pub(crate) struct SamplingFrame {
    centre: Vector3<f64>,
    turn: Matrix3<f64>,
    length: f64,
    radius: f64,
    /// The cylinder's share of the volume.
    tube: f64,
}

impl SamplingFrame {
    pub(crate) fn at(&self, sample: &ProfileSample) -> Vector3<f64> {
        let (z, across) = if sample.u < self.tube {
            (self.length * (sample.u / self.tube - 0.5), self.radius * sample.root)
        } else {
            let cos = 2.0 * (sample.u - self.tube) / (1.0 - self.tube) - 1.0;
            let far = self.radius * sample.cube_root;
            (cos * far + 0.5 * self.length.copysign(cos), far * (1.0 - cos * cos).max(0.0).sqrt())
        };
        let [cos, sin] = sample.direction;
        self.centre + self.turn * Vector3::new(across * cos, across * sin, z)
    }
}

/// Roll, pitch and yaw that turn z into `axis`. The axis has no direction of its own: z upwards is the
/// shorter turn.
fn turned(axis: &Vector3<f64>) -> [f64; 3] {
    let axis = if axis.z < 0.0 { -axis } else { *axis };
    [0.0, axis.z.clamp(-1.0, 1.0).acos(), axis.y.atan2(axis.x)]
}

fn volume(radius: f64, length: f64) -> f64 {
    let round = std::f64::consts::PI * radius * radius;
    round * (length + 4.0 / 3.0 * radius)
}

/// A capsule that holds all `points`, of nearly the smallest volume; none for no points.
pub(crate) fn around(points: &[Vector3<f64>]) -> Option<MeshCapsule> {
    let fits = fits(points, DIRECTIONS);
    let best = fits.into_iter().min_by(|a, b| a.volume().total_cmp(&b.volume()))?;
    Some(best.written(points))
}

/// The best capsule along each of the principal axes of `points`, to begin a search from: it holds those that
/// are farthest in [`FEW_DIRECTIONS`].
pub(crate) fn along_each_axis(points: &[Vector3<f64>]) -> Vec<CapsuleAxis> {
    fits(points, FEW_DIRECTIONS).iter().map(CapsuleAxis::of).collect()
}

fn fits(points: &[Vector3<f64>], directions: usize) -> Vec<MeshCapsule> {
    let Some(first) = points.first() else { return Vec::new() };
    let middle = points.iter().fold(Vector3::zeros(), |sum, point| sum + point) / points.len() as f64;
    let far = farthest(points, &middle, directions);
    let size = far.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max);
    if !(size > 0.0) {
        let centre = (*first).into();
        return vec![MeshCapsule { centre, rpy: [0.0; 3], length: 0.0, radius: 0.0 }];
    }
    let spread: Matrix3<f64> = far.iter().map(|point| (point - middle) * (point - middle).transpose()).sum();
    let axes = SymmetricEigen::new(spread).eigenvectors;
    let searched = (0..3).map(|axis| {
        let frame = frame(&axes.column(axis).into());
        let cloud = Cloud { points: &far, middle, frame, size };
        let best = simplex(cloud.begin(), |x| cloud.fit(x).cost).0;
        cloud.fit(&best).capsule(&cloud, &best)
    });
    searched.collect()
}

/// Unit vectors spread evenly over the sphere: a Fibonacci lattice.
pub(crate) fn sphere(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        Vector3::new(flat * cos, flat * sin, z)
    })
}

/// Points that are the farthest in some of `directions` directions.
fn farthest(points: &[Vector3<f64>], middle: &Vector3<f64>, directions: usize) -> Vec<Vector3<f64>> {
    if points.len() <= directions {
        return points.to_vec();
    }
    let mut chosen: Vec<usize> = sphere(directions)
        .filter_map(|direction| {
            let reach = points.iter().map(|point| direction.dot(&(point - middle)));
            reach.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
        })
        .collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().filter_map(|index| points.get(index)).copied().collect()
}

/// Columns: two directions across `axis`, and `axis`.
fn frame(axis: &Vector3<f64>) -> Matrix3<f64> {
    let z = axis.normalize();
    let other = if z.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let x = z.cross(&other).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}

/// Points, and the frame in which lines near its third axis are described.
struct Cloud<'a> {
    points: &'a [Vector3<f64>],
    middle: Vector3<f64>,
    frame: Matrix3<f64>,
    size: f64,
}

/// The best capsule along one line.
struct CapsuleFit {
    frame: Matrix3<f64>,
    ends: [f64; 2],
    radius: f64,
    cost: f64,
}

impl Cloud<'_> {
    /// In the middle between the outermost points across the axis.
    fn begin(&self) -> [f64; SEARCHED] {
        let across = |axis: usize| {
            let seen = self.points.iter().map(|point| self.frame.column(axis).dot(&(point - self.middle)));
            let [low, high] = seen.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], x| [l.min(x), h.max(x)]);
            0.5 * (low + high) / self.size
        };
        [0.0, 0.0, across(0), across(1), 0.0]
    }

    fn fit(&self, x: &[f64; SEARCHED]) -> CapsuleFit {
        let [tilt_x, tilt_y, off_x, off_y, excess] = *x;
        let frame = self.frame * Rotation3::from_euler_angles(tilt_x, tilt_y, 0.0).matrix();
        let seen = |point: &Vector3<f64>| {
            let local = frame.transpose() * (point - self.middle);
            let (x, y) = (local.x - off_x * self.size, local.y - off_y * self.size);
            (local.z, x * x + y * y)
        };
        let widest = self.points.iter().map(|point| seen(point).1).fold(0.0, f64::max);
        let radius = widest.sqrt() * (1.0 + excess * excess);
        let ends = self.points.iter().map(seen).fold(
            [f64::INFINITY, f64::NEG_INFINITY],
            |[low, high], (z, flat)| {
                let cap = (radius * radius - flat).max(0.0).sqrt();
                [low.min(z + cap), high.max(z - cap)]
            },
        );
        let [low, high] = ends;
        let ends = if low <= high { ends } else { [0.5 * (low + high); 2] };
        CapsuleFit { frame, ends, radius, cost: volume(radius, (high - low).max(0.0)) }
    }
}

impl CapsuleFit {
    fn capsule(&self, cloud: &Cloud<'_>, x: &[f64; SEARCHED]) -> MeshCapsule {
        let [low, high] = self.ends;
        let [_, _, off_x, off_y, _] = *x;
        let local = Vector3::new(off_x * cloud.size, off_y * cloud.size, 0.5 * (low + high));
        MeshCapsule {
            centre: (cloud.middle + self.frame * local).into(),
            rpy: turned(&self.frame.column(2).into_owned()),
            length: high - low,
            radius: self.radius,
        }
    }
}

/// The least `cost` that a simplex finds from `begin`, restarted a few times where it has shrunk.
fn simplex(begin: [f64; SEARCHED], cost: impl Fn(&[f64; SEARCHED]) -> f64) -> ([f64; SEARCHED], f64) {
    let mut best = (begin, cost(&begin));
    for step in [0.3, 0.1, 0.03] {
        let mut corners = vec![best];
        for axis in 0..SEARCHED {
            let mut corner = best.0;
            corner.iter_mut().enumerate().filter(|(i, _)| *i == axis).for_each(|(_, x)| *x += step);
            corners.push((corner, cost(&corner)));
        }
        for _ in 0..EVALUATIONS / 3 {
            corners.sort_by(|a, b| a.1.total_cmp(&b.1));
            shrink_or_move(&mut corners, &cost);
        }
        corners.sort_by(|a, b| a.1.total_cmp(&b.1));
        best = corners.first().copied().filter(|found| found.1 <= best.1).unwrap_or(best);
    }
    best
}

/// One step of the simplex; `corners` are sorted, the best first.
fn shrink_or_move(corners: &mut [([f64; SEARCHED], f64)], cost: &impl Fn(&[f64; SEARCHED]) -> f64) {
    let (Some(best), Some((worst, rest))) = (corners.first().copied(), corners.split_last()) else { return };
    let second = rest.last().map_or(worst.1, |corner| corner.1);
    let mut middle = [0.0; SEARCHED];
    for (corner, _) in rest {
        middle.iter_mut().zip(corner).for_each(|(sum, x)| *sum += x / rest.len() as f64);
    }
    let towards = |share: f64| {
        let mut x = middle;
        x.iter_mut().zip(&worst.0).for_each(|(x, w)| *x += share * (*x - w));
        (x, cost(&x))
    };
    let reflected = towards(1.0);
    let moved = if reflected.1 < best.1 {
        let expanded = towards(2.0);
        if expanded.1 < reflected.1 { expanded } else { reflected }
    } else if reflected.1 < second {
        reflected
    } else {
        towards(-0.5)
    };
    if moved.1 < worst.1 {
        corners.iter_mut().last().into_iter().for_each(|corner| *corner = moved);
        return;
    }
    for corner in corners.iter_mut().skip(1) {
        corner.0.iter_mut().zip(&best.0).for_each(|(x, b)| *x = 0.5 * (*x + b));
        corner.1 = cost(&corner.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// xorshift64*, from −1 to 1.
    fn dice() -> impl FnMut() -> f64 {
        let mut state = 0x5eed_u64;
        move || {
            state ^= state >> 12;
            state ^= state << 25;
            state ^= state >> 27;
            (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    fn holds_all(capsule: &MeshCapsule, points: &[Vector3<f64>]) {
        for point in points {
            assert!(capsule.distance(point) <= capsule.radius, "{point} is outside of {capsule:?}");
        }
    }

    /// Points on the surface of a capsule that lies askew.
    fn askew(radius: f64, length: f64, count: usize) -> Vec<Vector3<f64>> {
        let mut dice = dice();
        let turn = Rotation3::from_euler_angles(0.3, 1.1, -2.0);
        let place = Vector3::new(0.2, -0.1, 0.4);
        let surface = |_| {
            let direction = Vector3::new(dice(), dice(), dice()).normalize() * radius;
            let z = if direction.z > 0.0 { 0.5 * length } else { -0.5 * length };
            turn * (direction + Vector3::z() * z) + place
        };
        (0..count).map(surface).collect()
    }

    #[test]
    fn a_capsule_is_found_again() {
        for (radius, length, count) in [(0.06, 0.4, 5000), (0.05, 0.1, 600), (0.08, 0.0, 3000)] {
            let points = askew(radius, length, count);
            let found = around(&points).unwrap();
            holds_all(&found, &points);
            let excess = found.volume() / volume(radius, length);
            assert!((0.9..=1.03).contains(&excess), "{excess} of {radius} {length}: {found:?}");
        }
    }

    #[test]
    fn every_vertex_of_random_clouds_is_inside_and_the_sphere_around_the_box_is_larger() {
        let mut dice = dice();
        for round in 0..40_u32 {
            let size = Vector3::new(dice().abs() + 0.01, dice().abs() + 0.01, dice().abs() + 0.01);
            let count = 8 + 70 * round as usize;
            let points: Vec<_> =
                (0..count).map(|_| Vector3::new(dice(), dice(), dice()).component_mul(&size)).collect();
            let found = around(&points).unwrap();
            holds_all(&found, &points);
            assert!(found.volume() <= volume(size.norm(), 0.0) * 1.0001, "{found:?}");
        }
    }

    #[test]
    fn a_long_box_gets_nearly_the_best_capsule() {
        // 0.1 x 0.1 x 0.5: around its corners r = √2·0.05 with the ends cut off by the corners.
        let corner = |i: u32| {
            let sign = |bit: u32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
            Vector3::new(0.05 * sign(0), 0.05 * sign(1), 0.25 * sign(2))
        };
        let points: Vec<_> = (0..8).map(corner).collect();
        let found = around(&points).unwrap();
        holds_all(&found, &points);
        let plain = volume(0.05 * 2.0_f64.sqrt(), 0.5);
        assert!(found.volume() <= plain * 1.001, "{} against {plain}", found.volume());
    }

    #[test]
    fn points_on_a_line_in_one_place_or_missing_are_no_fault() {
        assert_eq!(around(&[]), None);
        let one = [Vector3::new(1.0, 2.0, 3.0); 4];
        holds_all(&around(&one).unwrap(), &one);
        let line: Vec<_> = (0..9).map(|i| Vector3::new(0.1 * f64::from(i), 0.0, 1.0)).collect();
        let found = around(&line).unwrap();
        holds_all(&found, &line);
        assert!(found.radius < 1e-5 && (found.length - 0.8).abs() < 1e-4, "{found:?}");
    }
}
