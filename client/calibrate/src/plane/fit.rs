//! The writing plane that fits touches of pen and tool on the same marks best.
//!
//! Contract: pure. A similarity in closed form: the pen's two axes, one scale and a shift, so that the
//! squared distances between the tool's tip and where the pen's touch belongs are least. What would fit
//! badly or by chance is refused. Source: Umeyama, IEEE TPAMI 13(4), 1991, equations 40 to 43, for two
//! axes in space.

use nalgebra::{Matrix3x2, Vector2, Vector3};

/// The marks have to spread at least this far in their narrower direction, as rms distance \[m\].
const NARROWEST_M: f64 = 0.015;
/// Least and greatest scale of the settings' key.
const SCALES: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// One mark, touched by both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneTouch {
    /// The pen there, in its device's plane \[m\].
    pub pen: Vector2<f64>,
    /// The tool's tip there, in the base frame \[m\].
    pub tip: Vector3<f64>,
    /// Direction of the tool, in the base frame, of length 1.
    pub axis: Vector3<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneFit {
    /// Where the pen's point `pen_origin` is, in the base frame \[m\].
    pub origin: Vector3<f64>,
    pub x_axis: Vector3<f64>,
    pub y_axis: Vector3<f64>,
    pub normal: Vector3<f64>,
    /// Plane metres per pen metre.
    pub scale: f64,
    pub pen_origin: Vector2<f64>,
}

/// Why there is no plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoFit {
    /// Fewer than three marks.
    TooFew(usize),
    /// The marks lie nearly on a line, or close together: rms spread in the narrower direction \[m\].
    Narrow(f64),
    /// The tool's touches do.
    TipsNarrow(f64),
    /// The scale is none that the settings take.
    Scale(f64),
    /// The pen's axes are mirrored against the paper.
    Mirrored,
}

impl std::fmt::Display for NoFit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooFew(count) => write!(f, "{count} marks give no plane: at least 3 are needed, and one as proof"),
            Self::Narrow(m) => write!(
                f,
                "the pen's touches lie nearly on a line or too close together: {:.1} mm in the narrower \
                 direction, at least {:.0} mm are needed; make a triangle as large as the paper",
                m * 1e3,
                NARROWEST_M * 1e3
            ),
            Self::TipsNarrow(m) => write!(
                f,
                "the tool's touches lie nearly on a line or too close together: {:.1} mm in the narrower \
                 direction; touch the same marks as the pen, in the same order",
                m * 1e3
            ),
            Self::Scale(scale) => write!(
                f,
                "the tool moved {scale:.4} times as far as the pen, and plane.scale takes {} to {}; check the \
                 size of the tablet (--mm)",
                SCALES.start(),
                SCALES.end()
            ),
            Self::Mirrored => f.write_str(
                "the pen's plane is mirrored: seen from the tool, its marks run the other way round; touch them \
                 in the same order, or mirror the pen (`foretrace tablet --mirror x`)",
            ),
        }
    }
}

impl PlaneFit {
    /// Of at least three touches; `pen_origin` is the pen's point that becomes the plane's origin.
    pub fn of(touches: &[PlaneTouch], pen_origin: Vector2<f64>) -> Result<Self, NoFit> {
        if touches.len() < 3 {
            return Err(NoFit::TooFew(touches.len()));
        }
        let count = touches.len() as f64;
        let pen_mean = touches.iter().map(|touch| touch.pen).sum::<Vector2<f64>>() / count;
        let tip_mean = touches.iter().map(|touch| touch.tip).sum::<Vector3<f64>>() / count;
        let mut across = Matrix3x2::zeros();
        let (mut pens, mut tips) = (nalgebra::Matrix2::zeros(), nalgebra::Matrix3::zeros());
        for touch in touches {
            let (pen, tip) = (touch.pen - pen_mean, touch.tip - tip_mean);
            across += tip * pen.transpose();
            pens += pen * pen.transpose();
            tips += tip * tip.transpose();
        }
        let rms = |variance: f64| (variance.max(0.0) / count).sqrt();
        let narrow = rms(pens.symmetric_eigenvalues().min());
        if narrow < NARROWEST_M {
            return Err(NoFit::Narrow(narrow));
        }
        // Touches of a plane vary in two directions; the least one is its unevenness.
        let mut spreads = tips.symmetric_eigenvalues();
        spreads.as_mut_slice().sort_unstable_by(f64::total_cmp);
        let narrow_tip = rms(spreads[1]);
        let svd = across.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(NoFit::TipsNarrow(narrow_tip)) };
        let scale = svd.singular_values.sum() / pens.trace();
        if narrow_tip < 0.5 * scale * NARROWEST_M || svd.singular_values.min() <= 0.0 {
            return Err(NoFit::TipsNarrow(narrow_tip));
        }
        if !SCALES.contains(&scale) {
            return Err(NoFit::Scale(scale));
        }
        let axes = u * v_t;
        let (x_axis, y_axis): (Vector3<f64>, Vector3<f64>) =
            (axes.column(0).into_owned(), axes.column(1).into_owned());
        let normal = x_axis.cross(&y_axis);
        let into_paper: f64 = touches.iter().map(|touch| -touch.axis.dot(&normal)).sum();
        if !(into_paper > 0.0) {
            return Err(NoFit::Mirrored);
        }
        let origin = tip_mean + scale * axes * (pen_origin - pen_mean);
        Ok(Self { origin, x_axis, y_axis, normal, scale, pen_origin })
    }

    /// Where a touch of the pen belongs, in the base frame \[m\].
    pub fn place(&self, pen: &Vector2<f64>) -> Vector3<f64> {
        let at = self.scale * (pen - self.pen_origin);
        self.origin + self.x_axis * at.x + self.y_axis * at.y
    }

    /// How far the tip was from where the pen's touch belongs: along the paper and above it \[m\].
    pub fn residual(&self, touch: &PlaneTouch) -> [f64; 2] {
        let off = touch.tip - self.place(&touch.pen);
        let above = off.dot(&self.normal);
        [(off - self.normal * above).norm(), above]
    }

    /// Angle between the tool and the line into the paper \[rad\].
    pub fn tilt(&self, touch: &PlaneTouch) -> f64 {
        (-touch.axis.dot(&self.normal)).clamp(-1.0, 1.0).acos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    const SCALE: f64 = 0.8;

    fn rotation() -> Rotation3<f64> {
        Rotation3::from_euler_angles(0.2, -0.1, 2.0)
    }

    /// Touches of a plane whose pen point (0.01, 0.02) is at (0.5, 0.1, 0.07).
    fn touches(pens: &[[f64; 2]], off: impl Fn(usize) -> Vector3<f64>) -> Vec<PlaneTouch> {
        let (origin, rotation) = (Vector3::new(0.5, 0.1, 0.07), rotation());
        let touch = |(index, [x, y]): (usize, &[f64; 2])| PlaneTouch {
            pen: Vector2::new(*x, *y),
            tip: origin + rotation * Vector3::new(SCALE * (x - 0.01), SCALE * (y - 0.02), 0.0) + off(index),
            axis: -(rotation * Vector3::z()),
        };
        pens.iter().enumerate().map(touch).collect()
    }

    const MARKS: [[f64; 2]; 4] = [[-0.08, -0.05], [0.09, -0.06], [0.01, 0.08], [0.07, 0.05]];

    fn fit(touches: &[PlaneTouch]) -> Result<PlaneFit, NoFit> {
        PlaneFit::of(touches, Vector2::new(0.01, 0.02))
    }

    #[test]
    fn exact_touches_give_back_the_plane_and_its_scale() {
        let exact = touches(&MARKS, |_| Vector3::zeros());
        let fit = fit(&exact[..3]).unwrap();
        assert!((fit.scale - SCALE).abs() < 1e-12);
        assert!((fit.origin - Vector3::new(0.5, 0.1, 0.07)).norm() < 1e-12);
        assert!((fit.normal - rotation() * Vector3::z()).norm() < 1e-12);
        assert!((fit.normal.cross(&fit.x_axis) - fit.y_axis).norm() < 1e-12);
        for touch in &exact {
            let [along, above] = fit.residual(touch);
            assert!(along < 1e-12 && above.abs() < 1e-12 && fit.tilt(touch) < 1e-6);
        }
    }

    #[test]
    fn a_touch_that_was_set_wrong_shows_in_its_residual() {
        let off =
            |index| if index == 3 { rotation() * Vector3::new(0.0, 0.0, 0.004) } else { Vector3::zeros() };
        let touches = touches(&MARKS, off);
        // As a proof, which is no part of the fit, it shows whole; in the fit, spread.
        let [along, above] = fit(&touches[..3]).unwrap().residual(&touches[3]);
        assert!(along < 1e-12 && (above - 0.004).abs() < 1e-12);
        let all = fit(&touches).unwrap();
        assert!(touches.iter().map(|touch| all.residual(touch)[1].abs()).fold(0.0, f64::max) > 5e-4);
    }

    #[test]
    fn the_fit_leaves_less_than_any_plane_near_it() {
        let off = |index: usize| Vector3::new(1e-3, -2e-3, 5e-4) * ((index * 7 % 5) as f64 - 2.0);
        let touches = touches(&MARKS, off);
        let best = fit(&touches).unwrap();
        let cost =
            |fit: &PlaneFit| touches.iter().map(|t| (t.tip - fit.place(&t.pen)).norm_squared()).sum::<f64>();
        let least = cost(&best);
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            for step in [-1e-3, 1e-3] {
                let turn = Rotation3::from_scaled_axis(axis * step);
                let turned = PlaneFit { x_axis: turn * best.x_axis, y_axis: turn * best.y_axis, ..best };
                let moved = PlaneFit { origin: best.origin + axis * step, ..best };
                let scaled = PlaneFit { scale: best.scale * (1.0 + step), ..best };
                for other in [turned, moved, scaled] {
                    assert!(cost(&other) > least, "{other:?}");
                }
            }
        }
    }

    #[test]
    fn lines_small_triangles_and_mirrored_pens_are_refused() {
        let none = |_| Vector3::zeros();
        let line: Vec<[f64; 2]> = (0..5).map(|i| [0.05 * f64::from(i), 0.02 * f64::from(i) + 1e-4]).collect();
        assert!(matches!(fit(&touches(&line, none)), Err(NoFit::Narrow(_))));
        let small = MARKS.map(|[x, y]| [0.1 * x, 0.1 * y]);
        assert!(matches!(fit(&touches(&small, none)), Err(NoFit::Narrow(_))));
        assert_eq!(fit(&touches(&MARKS[..2], none)), Err(NoFit::TooFew(2)));
        let mirrored: Vec<PlaneTouch> = touches(&MARKS, none)
            .into_iter()
            .map(|touch| PlaneTouch { pen: Vector2::new(-touch.pen.x, touch.pen.y), ..touch })
            .collect();
        assert_eq!(fit(&mirrored), Err(NoFit::Mirrored));
        let same: Vec<PlaneTouch> = touches(&MARKS, none)
            .into_iter()
            .map(|touch| PlaneTouch { tip: Vector3::new(0.5, 0.1, 0.07), ..touch })
            .collect();
        assert!(matches!(fit(&same), Err(NoFit::TipsNarrow(_))));
    }
}
