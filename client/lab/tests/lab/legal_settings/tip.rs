//! Where a UR's pen is, from its maker's Denavit-Hartenberg parameters: shares no code with the law.

use foretrace_config::Config;

type Matrix = [[f64; 4]; 4];

/// d, a and α of each joint \[m, m, rad\].
type Parameters = [[f64; 3]; 6];

const QUARTER: f64 = std::f64::consts::FRAC_PI_2;
const UR5: Parameters = [
    [0.089159, 0.0, QUARTER],
    [0.0, -0.425, 0.0],
    [0.0, -0.39225, 0.0],
    [0.10915, 0.0, QUARTER],
    [0.09465, 0.0, -QUARTER],
    [0.0823, 0.0, 0.0],
];
const UR5E: Parameters = [
    [0.1625, 0.0, QUARTER],
    [0.0, -0.425, 0.0],
    [0.0, -0.3922, 0.0],
    [0.1333, 0.0, QUARTER],
    [0.0997, 0.0, -QUARTER],
    [0.0996, 0.0, 0.0],
];

/// Pen and plane of one combination.
pub(crate) struct Tip {
    arm: Parameters,
    tool: [f64; 3],
    origin: [f64; 3],
    axes: [[f64; 3]; 3],
}

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl Tip {
    pub(crate) fn new(config: &Config) -> Self {
        let settings = config.settings();
        let z = unit(settings.plane.normal);
        let y = unit(cross(z, settings.plane.x_axis));
        Self {
            arm: if settings.robot.urdf == "ur5" { UR5 } else { UR5E },
            tool: settings.robot.tool_m,
            origin: settings.plane.origin_m,
            axes: [cross(y, z), y, z],
        }
    }

    /// The tip in the plane's frame \[m\], and the angle between pen and normal \[rad\].
    pub(crate) fn at(&self, q: &[f64; 6]) -> ([f64; 3], f64) {
        let mut pose: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
        for (q, [d, a, alpha]) in q.iter().zip(&self.arm) {
            let ((s, c), (sa, ca)) = (q.sin_cos(), alpha.sin_cos());
            let joint = [
                [c, -s * ca, s * sa, a * c],
                [s, c * ca, -c * sa, a * s],
                [0.0, sa, ca, *d],
                [0.0, 0.0, 0.0, 1.0],
            ];
            pose = times(&pose, &joint);
        }
        let [x, y, z] = self.tool;
        let point: [f64; 3] = std::array::from_fn(|i| {
            pose[i][0] * x + pose[i][1] * y + pose[i][2] * z + pose[i][3] - self.origin[i]
        });
        let pen = [pose[0][2], pose[1][2], pose[2][2]];
        (self.axes.map(|axis| dot(axis, point)), (-dot(self.axes[2], pen)).clamp(-1.0, 1.0).acos())
    }
}
