//! The writing plane from touches of pen and tool on the same marks.
//!
//! In the order of their use: `still` (when nothing moves), `touches` (marks as a file), `listen` (marks as
//! they are touched), `fit`, `reach` (what
//! of the plane the arm reaches), `written` (into a settings file).

mod fit;
mod listen;
mod reach;
mod still;
mod touches;
mod written;

use foretrace_config::Config;
use nalgebra::{Vector2, Vector3};
use serde::Serialize;

pub use fit::{NoFit, PlaneFit, PlaneTouch};
use foretrace_failure::Failure;
pub use listen::TouchListener;
pub use reach::missing;
pub use still::Still;
pub use touches::{TouchMark, read, text};
pub use written::{lines, write};

/// The result; keys are stable.
#[derive(Debug, Serialize)]
pub struct PlaneReport {
    /// Of the paper in the base frame \[m\].
    pub origin_m: [f64; 3],
    pub x_axis: [f64; 3],
    /// Unit vector, away from the paper.
    pub normal: [f64; 3],
    /// The pen's point that lies at the origin \[m\].
    pub pen_origin_m: [f64; 2],
    /// Plane metres per pen metre.
    pub scale: f64,
    pub touches: Vec<TouchReport>,
    /// That of the last mark, which is no part of the fit.
    pub proof: TouchReport,
}

/// How far a touch is off.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct TouchReport {
    pub along_mm: f64,
    pub above_mm: f64,
    /// Of the tool, from the normal.
    pub tilt_rad: f64,
}

impl TouchReport {
    fn of(fit: &PlaneFit, touch: &PlaneTouch) -> Self {
        let [along, above] = fit.residual(touch);
        Self { along_mm: along * 1e3, above_mm: above * 1e3, tilt_rad: fit.tilt(touch) }
    }

    fn off_mm(&self) -> f64 {
        self.along_mm.hypot(self.above_mm)
    }
}

/// The plane that fits `marks` best, without the last one, which is the proof; forward kinematics are those
/// of `config`'s robot.
///
/// # Errors
///
/// Too few marks, or marks that give no plane.
pub fn fit(config: &Config, marks: &[TouchMark]) -> Result<(PlaneFit, PlaneReport), Failure> {
    let touch = |mark: &TouchMark| {
        let pose = config.robot().chain.forward(&mark.q);
        PlaneTouch { pen: mark.pen, tip: pose.position, axis: pose.rotation * Vector3::z() }
    };
    let touches: Vec<PlaneTouch> = marks.iter().map(touch).collect();
    let Some((proof, fitted)) = touches.split_last() else {
        return Err(Failure::bad_input("there is no mark", "give three or more, and one as proof"));
    };
    let pen_origin = Vector2::from(config.settings().plane.pen_origin_m);
    let fit =
        PlaneFit::of(fitted, pen_origin).map_err(|error| Failure::bad_input(error, "nothing was written"))?;
    let report = PlaneReport {
        origin_m: fit.origin.into(),
        x_axis: fit.x_axis.into(),
        normal: fit.normal.into(),
        pen_origin_m: fit.pen_origin.into(),
        scale: fit.scale,
        touches: fitted.iter().map(|touch| TouchReport::of(&fit, touch)).collect(),
        proof: TouchReport::of(&fit, proof),
    };
    Ok((fit, report))
}

impl PlaneReport {
    /// Refuses touches, and a proof, that are farther than `within_mm` off the plane.
    ///
    /// # Errors
    ///
    /// The worst touch, else the proof.
    pub fn check(&self, within_mm: f64) -> Result<(), Failure> {
        let worst = self.touches.iter().zip(1..).max_by(|(a, _), (b, _)| a.off_mm().total_cmp(&b.off_mm()));
        if let Some((touch, number)) = worst.filter(|(touch, _)| !(touch.off_mm() <= within_mm)) {
            return Err(Failure::bad_input(
                format_args!(
                    "touch {number} is {:.2} mm off the plane, allowed are {within_mm} mm",
                    touch.off_mm()
                ),
                "nothing was written: touch the marks anew, more exactly; see also `foretrace calibrate \
                 kinematics`",
            ));
        }
        if !(self.proof.off_mm() <= within_mm) {
            return Err(Failure::bad_input(
                format_args!(
                    "the proof is {:.2} mm off the plane of the other touches, allowed are {within_mm} mm",
                    self.proof.off_mm(),
                ),
                "nothing was written: touch all marks anew, and choose them farther apart",
            ));
        }
        Ok(())
    }
}
