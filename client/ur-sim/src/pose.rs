//! Poses as programs and clients write them: position \[m\] and rotation vector \[rad\].

use nalgebra::{Isometry3, Vector3};

/// The frame of a pose.
#[must_use]
pub fn frame(pose: &[f64; 6]) -> Isometry3<f64> {
    let [x, y, z, rx, ry, rz] = *pose;
    Isometry3::new(Vector3::new(x, y, z), Vector3::new(rx, ry, rz))
}

/// The pose of a frame; of the two rotation vectors the shorter one.
#[must_use]
pub fn pose(frame: &Isometry3<f64>) -> [f64; 6] {
    let ([x, y, z], [rx, ry, rz]) = (frame.translation.vector.into(), frame.rotation.scaled_axis().into());
    [x, y, z, rx, ry, rz]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_come_back_also_at_half_a_turn() {
        for turn in
            [[0.0; 3], [0.3, -1.2, 0.5], [3.0, 0.2, 0.1], [std::f64::consts::PI, 0.0, 0.0], [0.0, 2.2, 2.2]]
        {
            let [rx, ry, rz] = turn;
            let first = frame(&[0.1, 0.2, 0.3, rx, ry, rz]);
            let again = frame(&pose(&first));
            assert!((again.to_homogeneous() - first.to_homogeneous()).norm() < 1e-9, "{turn:?}");
        }
    }
}
