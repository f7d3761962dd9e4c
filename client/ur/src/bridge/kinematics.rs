//! An arm's own kinematics: from the Denavit-Hartenberg parameters that its controller tells, to a chain and
//! a URDF.
//!
//! The factory measures every arm and stores parameters that differ from the nominal ones by up to
//! millimetres and milliradians. Where two axes are nearly parallel (shoulder and elbow) the measured d may
//! be hundreds of metres and cancel out; frames taken from the parameters as they are would lie far outside
//! the arm. Here each joint's frame stands on its measured axis, as near to the nominal frame as the axis
//! comes.

use foretrace_client::JOINTS;
use foretrace_config::Config;
use foretrace_control::arm::Chain;
use foretrace_control::ik::{ToolTarget, solve_pose};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;
use std::f64::consts::PI;

/// Denavit-Hartenberg parameters (standard convention): T_i = Rz(q + θ) Tz(d) Tx(a) Rx(α).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DhParameters {
    /// Offset of each joint \[rad\].
    pub theta: [f64; JOINTS],
    /// \[m\]
    pub a: [f64; JOINTS],
    /// \[m\]
    pub d: [f64; JOINTS],
    /// \[rad\]
    pub alpha: [f64; JOINTS],
}

/// Arms of Universal Robots by their nominal a2, a3 and d1 \[m\] (description package of the maker).
const ARMS: [(&str, [f64; 3]); 7] = [
    ("a UR3", [-0.24365, -0.21325, 0.1519]),
    ("a UR5", [-0.425, -0.39225, 0.089159]),
    ("a UR10", [-0.612, -0.5723, 0.1273]),
    ("a UR3e", [-0.24355, -0.2132, 0.15185]),
    ("a UR5e or UR7e", [-0.425, -0.3922, 0.1625]),
    ("a UR10e or UR12e", [-0.6127, -0.57155, 0.1807]),
    ("a UR16e", [-0.4784, -0.36, 0.1807]),
];

/// Largest parameter that is believed \[m\], \[rad\]: a thousand metres of parallel axes.
const LARGEST: f64 = 1e3;

impl DhParameters {
    /// Whether they are numbers of an arm at all.
    #[must_use]
    pub fn are_sound(&self) -> bool {
        let all = [self.theta, self.a, self.d, self.alpha];
        all.iter().flatten().all(|value| value.abs() <= LARGEST)
    }

    /// Which arm has nominal parameters like these, to a centimetre.
    #[must_use]
    pub fn name(&self) -> Option<&'static str> {
        let [_, a2, a3, ..] = self.a;
        let [d1, ..] = self.d;
        let near = |nominal: &[f64; 3]| nominal.iter().zip([a2, a3, d1]).all(|(n, is)| (n - is).abs() < 0.01);
        ARMS.iter().find(|(_, nominal)| near(nominal)).map(|(name, _)| *name)
    }

    /// Pose of the flange in the base frame at joint positions `q` \[rad\].
    #[must_use]
    pub fn flange(&self, q: &[f64; JOINTS]) -> Isometry3<f64> {
        self.frames(q).last().copied().unwrap_or_else(Isometry3::identity)
    }

    /// Poses of the DH frames 0 to 6 in the base frame.
    #[must_use]
    pub fn frames(&self, q: &[f64; JOINTS]) -> [Isometry3<f64>; JOINTS + 1] {
        let mut frames = [Isometry3::identity(); JOINTS + 1];
        let mut at = Isometry3::identity();
        let rows = q.iter().zip(&self.theta).zip(&self.a).zip(&self.d).zip(&self.alpha);
        for (frame, ((((q, theta), a), d), alpha)) in frames.iter_mut().skip(1).zip(rows) {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), q + theta);
            let twist = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), *alpha);
            at = at
                * Isometry3::from_parts(Translation3::identity(), turn)
                * Isometry3::from_parts(Translation3::new(*a, 0.0, *d), twist);
            *frame = at;
        }
        frames
    }

    /// Origins of the joints of a URDF with these kinematics, each in the frame before, and of the tip: xyz
    /// \[m\] and rpy \[rad\]. The frames stand as near to those of `nominal` as the axes come.
    fn origins(&self, nominal: &Chain<JOINTS>) -> [Isometry3<f64>; JOINTS + 1] {
        let zero = [0.0; JOINTS];
        let frames = self.frames(&zero);
        let near = nominal.forward(&zero);
        let mut origins = [Isometry3::identity(); JOINTS + 1];
        let mut before = Isometry3::identity();
        let nominal_frames = near.frames.iter().zip(near.origins.column_iter());
        for ((origin, dh), (rotation, position)) in origins.iter_mut().zip(&frames).zip(nominal_frames) {
            // Joint i turns about z of DH frame i − 1.
            let axis = dh.rotation * Vector3::z();
            let on_axis = dh.translation.vector;
            let nearest = on_axis + axis * axis.dot(&(position - on_axis));
            let frame = Isometry3::from_parts(Translation3::from(nearest), upright(rotation, &axis));
            *origin = before.inverse() * frame;
            before = frame;
        }
        if let (Some(tip), Some(flange)) = (origins.last_mut(), frames.last()) {
            *tip = before.inverse() * flange;
        }
        origins
    }

    /// The URDF `nominal` with the origins of its seven joints replaced, so that it has these kinematics.
    ///
    /// # Errors
    ///
    /// Where `nominal` is not a chain of six joints and one fixed one from `base_link` to `tool0`, each with
    /// an origin.
    pub fn urdf(&self, nominal: &str) -> Result<String, UrdfError> {
        let chain = Chain::from_urdf(nominal, Some("base_link"), Some("tool0"))
            .map_err(|error| UrdfError::Chain(error.to_string()))?;
        let mut rest = nominal;
        let mut text = String::with_capacity(nominal.len() + 1024);
        for origin in self.origins(&chain) {
            let (head, tail) = rest.split_once("<joint ").ok_or(UrdfError::Joints)?;
            let (joint, after) = tail.split_once("</joint>").ok_or(UrdfError::Joints)?;
            let (first, old) = joint.split_once("<origin ").ok_or(UrdfError::Joints)?;
            let (_, last) = old.split_once("/>").ok_or(UrdfError::Joints)?;
            let [x, y, z]: [f64; 3] = origin.translation.vector.into();
            let (roll, pitch, yaw) = origin.rotation.euler_angles();
            text += &format!("{head}<joint {first}<origin xyz=\"{x:.9} {y:.9} {z:.9}\" ");
            text += &format!("rpy=\"{roll:.9} {pitch:.9} {yaw:.9}\"/>{last}</joint>");
            rest = after;
        }
        text += rest;
        Ok(text)
    }
}

/// Why no URDF could be written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UrdfError {
    /// Not the chain that was expected.
    #[error("the nominal description cannot be used: {0}")]
    Chain(String),
    /// Joints without origins, or too few.
    #[error("the nominal description has not seven joints with an origin each")]
    Joints,
}

/// A rotation whose z is `axis` and whose x is as near to that of `nominal` as can be.
fn upright(nominal: &Matrix3<f64>, axis: &Vector3<f64>) -> UnitQuaternion<f64> {
    let x: Vector3<f64> = nominal.column(0).into();
    let y = axis.cross(&x).normalize();
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(axis), y, *axis]));
    UnitQuaternion::from_rotation_matrix(&rotation)
}

/// How far the tip is from where the settings' model believes it, over the paper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Deviation {
    /// Farthest anywhere on the paper \[mm\].
    pub most_mm: f64,
    /// Farthest, once the plane has been calibrated with this arm: the mean is taken out \[mm\].
    pub uneven_mm: f64,
    /// The same along the plane's normal: how much the pen presses or floats \[mm\].
    pub height_mm: f64,
    /// Farthest, if the model's base frame were turned by 180 degrees about z \[mm\].
    pub turned_mm: f64,
}

/// How far the tip of an arm with kinematics `dh` is from where the model of `config` believes it, over the
/// writing plane, from corner to corner; `None` where the model reaches no point of the paper. The
/// controller's base frame is the model's, or turned as `robot.ur.base_turned` says. Its flange is that link
/// at the end of the model that is nearest to it: the tool may be fixed to it as links of the description.
#[must_use]
pub fn deviation(dh: &DhParameters, config: &Config) -> Option<Deviation> {
    let over = OverPaper::of(dh, config)?;
    let (same, turned) = (Isometry3::identity(), half_turn());
    let (said, other) =
        if config.settings().robot.ur.base_turned { (&turned, &same) } else { (&same, &turned) };
    let (_, off) = over.nearest(said);
    let mean = off.iter().sum::<Vector3<f64>>() / off.len().max(1) as f64;
    let normal = config.settings().plane.rotation() * Vector3::z();
    let most = |size: &dyn Fn(&Vector3<f64>) -> f64| 1e3 * off.iter().map(size).fold(0.0, f64::max);
    Some(Deviation {
        most_mm: most(&|off| off.norm()),
        uneven_mm: most(&|off| (off - mean).norm()),
        height_mm: most(&|off| normal.dot(&(off - mean)).abs()),
        turned_mm: 1e3 * farthest(&over.nearest(other).1),
    })
}

/// The base link that fits an arm, and what `robot.ur.base_turned` then is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FittingBase {
    /// Name of the link.
    pub link: String,
    /// Its frame is turned by 180 degrees about z against the controller's.
    pub turned: bool,
}

/// A link of the model, fixed to its base but not that itself, whose frame brings the tip to within `most_mm`
/// of where an arm with kinematics `dh` has it: one that stands as the controller's frame rather than one
/// that is turned against it. `None` where there is none.
#[must_use]
pub fn fitting_base(dh: &DhParameters, config: &Config, most_mm: f64) -> Option<FittingBase> {
    let over = OverPaper::of(dh, config)?;
    let (base, _) = config.robot().chain.ends();
    frames(config).into_iter().filter(|(fits, _)| fits.link != base).find_map(|(fits, controller)| {
        (1e3 * farthest(&over.nearest(&controller).1) <= most_mm).then_some(fits)
    })
}

/// The frames of all links that do not move against the model's base, in that of the base: as they are, then
/// turned by 180 degrees about z.
fn frames(config: &Config) -> Vec<(FittingBase, Isometry3<f64>)> {
    let links = config.robot().chain.still_links();
    let of = |turned: bool| {
        links.iter().map(move |link| {
            let rotation = Rotation3::from_matrix_unchecked(link.rotation);
            let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
            let place = Isometry3::from_parts(link.translation.into(), rotation);
            let place = if turned { place * half_turn() } else { place };
            (FittingBase { link: link.name.clone(), turned }, place)
        })
    };
    of(false).chain(of(true)).collect()
}

/// Where the tip of the tool is, seen from the flange of an arm with kinematics `dh` \[m\]: from that link at
/// the end of the model of `config` that is nearest to it, whichever link at its base is the right one.
/// `None` where the model is off by more than `most_mm`, or reaches no point of the paper.
#[must_use]
pub fn tool_from_flange(dh: &DhParameters, config: &Config, most_mm: f64) -> Option<[f64; 3]> {
    let over = OverPaper::of(dh, config)?;
    let all = frames(config).into_iter().map(|(_, base)| over.nearest(&base));
    let (tool, off) = all.min_by(|(_, a), (_, b)| farthest(a).total_cmp(&farthest(b)))?;
    (1e3 * farthest(&off) <= most_mm).then(|| tool.into())
}

/// An arm and its model in postures over the paper.
struct OverPaper {
    /// The arm's flange in the controller's base frame, and the model's tip in its own \[m\].
    postures: Vec<(Isometry3<f64>, Vector3<f64>)>,
    /// Where the model's tip may be, seen from the flange: the link that the settings name comes first \[m\].
    tools: Vec<Vector3<f64>>,
}

impl OverPaper {
    fn of(dh: &DhParameters, config: &Config) -> Option<Self> {
        let (robot, settings) = (config.robot(), config.settings());
        let rotation = settings.plane.rotation();
        let (origin, normal) = (Vector3::from(settings.plane.origin_m), rotation * Vector3::z());
        let [[x_min, x_max], [y_min, y_max], _] = settings.plane.workspace_m;
        let mut postures = Vec::new();
        for i in 0..5 {
            for j in 0..5 {
                let (u, v) = (f64::from(i) / 4.0, f64::from(j) / 4.0);
                let at = Vector3::new(x_min + u * (x_max - x_min), y_min + v * (y_max - y_min), 0.0);
                let target = ToolTarget::at_rest(origin + rotation * at, -normal, None);
                let Some(q) = solve_pose(&robot.chain, &robot.home, &target) else { continue };
                postures.push((dh.flange(&q), robot.chain.forward(&q).position));
            }
        }
        let said = Vector3::from(settings.robot.tool_m);
        let tools = [said].into_iter().chain(robot.chain.tool_from_links().map(|(_, tool)| tool)).collect();
        (!postures.is_empty()).then_some(Self { postures, tools })
    }

    /// The tool with which the tips are nearest to each other where the controller's base frame stands at
    /// `base` in the model's, and how far they are then in each posture \[m\].
    fn nearest(&self, base: &Isometry3<f64>) -> (Vector3<f64>, Vec<Vector3<f64>>) {
        let off = |tool: &Vector3<f64>| {
            let tip = |flange: &Isometry3<f64>| (base * flange * Point3::from(*tool)).coords;
            self.postures.iter().map(|(flange, believed)| tip(flange) - believed).collect::<Vec<_>>()
        };
        let all = self.tools.iter().map(|tool| (*tool, off(tool)));
        let nearest = all.min_by(|(_, a), (_, b)| farthest(a).total_cmp(&farthest(b)));
        nearest.unwrap_or((Vector3::zeros(), Vec::new()))
    }
}

/// The longest of these; NaN where one is no number.
fn farthest(off: &[Vector3<f64>]) -> f64 {
    off.iter().map(Vector3::norm).fold(0.0, |most, one| if one <= most { most } else { one })
}

/// By 180 degrees about z.
fn half_turn() -> Isometry3<f64> {
    Isometry3::rotation(Vector3::z() * PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_config::presets;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    /// Nominal UR5 (maker's table).
    const UR5: DhParameters = DhParameters {
        theta: [0.0; 6],
        a: [0.0, -0.425, -0.39225, 0.0, 0.0, 0.0],
        d: [0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823],
        alpha: [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0],
    };

    fn chain(urdf: &str) -> Chain<JOINTS> {
        Chain::from_urdf(urdf, Some("base_link"), Some("tool0")).unwrap()
    }

    fn ur5() -> &'static str {
        presets::robot("ur5").unwrap()
    }

    /// As a factory might have measured: millimetres, milliradians, and two nearly parallel axes far away
    /// from each other.
    fn measured() -> DhParameters {
        let mut dh = UR5;
        dh.theta = [0.001, -0.4, 0.395, 0.006, 0.0005, -0.0007];
        dh.a[1] = -0.4243;
        dh.a[2] = -0.3917;
        dh.d[1] = 212.0;
        dh.d[2] = -211.9991;
        dh.alpha[1] = 0.0006;
        dh.alpha[2] = -0.0014;
        dh
    }

    #[test]
    fn nominal_parameters_are_the_embedded_model() {
        let model = chain(ur5());
        let q = [0.3, -1.2, 1.4, -0.7, 0.9, 2.0];
        let (flange, known) = (UR5.flange(&q), model.forward(&q));
        assert!((flange.translation.vector - known.position).norm() < 1e-12);
        assert!((flange.rotation.to_rotation_matrix().matrix() - known.rotation).norm() < 1e-12);
        assert_eq!(UR5.name(), Some("a UR5"));
        assert_eq!(measured().name(), Some("a UR5"));
    }

    #[test]
    fn a_written_urdf_has_the_measured_kinematics_and_frames_near_the_nominal_ones() {
        let dh = measured();
        let text = dh.urdf(ur5()).unwrap();
        let (written, nominal) = (chain(&text), chain(ur5()));
        for q in [[0.0; 6], [0.3, -1.2, 1.4, -0.7, 0.9, 2.0], [-2.0, -0.4, 2.2, -2.0, -1.5, 5.0]] {
            let (flange, known) = (dh.flange(&q), written.forward(&q));
            // Nine digits in the file; DH of 200 m loses four of a double's sixteen.
            assert!((flange.translation.vector - known.position).norm() < 2e-8);
            assert!((flange.rotation.to_rotation_matrix().matrix() - known.rotation).norm() < 2e-8);
        }
        let (of_written, of_nominal) = (written.forward(&[0.0; 6]), nominal.forward(&[0.0; 6]));
        let apart = (of_written.origins - of_nominal.origins).abs().max();
        assert!(apart < 0.3, "frames are {apart} m away");
        assert_eq!(written.limits(), nominal.limits());
        assert_eq!(written.capsules().len(), nominal.capsules().len());
    }

    #[test]
    fn nominal_parameters_give_the_nominal_urdf_back() {
        let (written, nominal) = (chain(&UR5.urdf(ur5()).unwrap()), chain(ur5()));
        let q = [0.1, -1.0, 1.0, -1.0, -1.5, 0.4];
        let (of_written, of_nominal) = (written.forward(&q), nominal.forward(&q));
        assert!((of_written.origins - of_nominal.origins).abs().max() < 1e-8);
        assert!((of_written.position - of_nominal.position).norm() < 1e-8);
    }

    #[test]
    fn a_description_without_its_joints_is_refused() {
        assert!(matches!(UR5.urdf("<robot/>"), Err(UrdfError::Chain(_))));
    }

    #[test]
    fn deviation_is_zero_for_the_model_itself_and_in_millimetres_else() {
        let config = Config::preset("ur5").unwrap();
        let off = |dh: &DhParameters| deviation(dh, &config).unwrap();
        assert!(off(&UR5).most_mm < 1e-6);
        // A base that is 3 mm higher is 3 mm everywhere, and nothing once the plane is calibrated.
        let mut higher = UR5;
        higher.d[0] += 3e-3;
        let reported = off(&higher);
        assert!((reported.most_mm - 3.0).abs() < 1e-6 && reported.uneven_mm < 1e-6, "{reported:?}");
        // An upper arm that is 2 mm longer is uneven over the paper.
        let mut longer = UR5;
        longer.a[1] -= 2e-3;
        let reported = off(&longer);
        assert!(
            reported.most_mm > 1.0 && reported.uneven_mm > 0.05 && reported.height_mm <= reported.uneven_mm,
            "{reported:?}"
        );
    }

    proptest! {
        #[test]
        fn any_sound_parameters_are_survived(values in proptest::collection::vec(-1e3f64..1e3, 24)) {
            let row = |i: usize| <[f64; 6]>::try_from(&values[6 * i..6 * i + 6]).unwrap();
            let dh = DhParameters { theta: row(0), a: row(1), d: row(2), alpha: row(3) };
            prop_assert!(dh.are_sound());
            let _ = dh.urdf(ur5()).unwrap();
        }
    }
}
