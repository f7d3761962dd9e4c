//! Arms that are not shipped: kinematics from what their makers publish, settings as a user would write them,
//! and the simulated arm in the loop.

use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Write as _;

use foretrace_config::Config;
use foretrace_control::follower::{Budget, Follower, JointReading, Mode, NoClock, Request, StepInput};
use foretrace_control::guard::CommandChecker;
use foretrace_control::pen::PenReading;
use foretrace_control::stop::StopReason;
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings, JOINTS};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// a \[m\], d \[m\], α \[rad\] and θ₀ \[rad\] of a joint, standard convention: Rz(q + θ₀) Tz(d) Tx(a) Rx(α).
type Row = [f64; 4];

/// An arm as its maker describes it.
struct Arm {
    name: &'static str,
    rows: [Row; JOINTS],
    /// Lowest and highest position \[deg\].
    limits: [[f64; 2]; JOINTS],
    /// Highest speed \[deg/s\].
    speeds: [f64; JOINTS],
    /// With the pen straight down over the middle of the paper \[rad\].
    home: [f64; JOINTS],
}

const H: f64 = FRAC_PI_2;
/// The pen below the flange \[m\].
const PEN_M: f64 = 0.12;
const LIFT_M: f64 = 0.01;

/// Universal Robots: Denavit-Hartenberg parameters of the maker's page "DH Parameters for calculations of
/// kinematics and dynamics"; d1, a2, a3, d4, d5, d6 in metres. All joints turn ±360°, `last` of the UR3s
/// without end.
const fn ur(name: &'static str, [d1, a2, a3, d4, d5, d6]: [f64; 6], speeds: [f64; 6], last: [f64; 2]) -> Arm {
    Arm {
        name,
        rows: [
            [0.0, d1, H, 0.0],
            [a2, 0.0, 0.0, 0.0],
            [a3, 0.0, 0.0, 0.0],
            [0.0, d4, H, 0.0],
            [0.0, d5, -H, 0.0],
            [0.0, d6, 0.0, 0.0],
        ],
        limits: [TURN, TURN, TURN, TURN, TURN, last],
        speeds,
        home: [PI, -1.3, 1.8, -2.0708, -H, 0.0],
    }
}

const TURN: [f64; 2] = [-360.0, 360.0];
const ENDLESS: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

const SMALLEST: [f64; 6] = [180.0, 180.0, 180.0, 360.0, 360.0, 360.0];
const SMALL: [f64; 6] = [180.0; 6];
const LARGE: [f64; 6] = [120.0, 120.0, 180.0, 180.0, 180.0, 180.0];
const LARGEST: [f64; 6] = [120.0, 120.0, 150.0, 210.0, 210.0, 210.0];

/// An arm with a spherical wrist whose upper arm stands upright and whose forearm points forwards at zero:
/// height of the second axis, its offset, upper arm, offset of the forearm, forearm, flange \[m\].
const fn elbowed([d1, a1, a2, a3, d4, d6]: [f64; 6]) -> [Row; JOINTS] {
    [
        [a1, d1, -H, 0.0],
        [a2, 0.0, 0.0, -H],
        [a3, 0.0, -H, 0.0],
        [0.0, d4, H, 0.0],
        [0.0, 0.0, -H, 0.0],
        [0.0, d6, 0.0, 0.0],
    ]
}

/// The same with the forearm upright at zero: height, sideways offsets of upper arm and forearm, upper arm,
/// forearm, flange \[m\].
const fn upright([d1, d2, d3, a2, d4, d6]: [f64; 6]) -> [Row; JOINTS] {
    [
        [0.0, d1, -H, 0.0],
        [a2, d2, 0.0, -H],
        [0.0, d3, H, H],
        [0.0, d4, -H, 0.0],
        [0.0, 0.0, H, 0.0],
        [0.0, d6, 0.0, 0.0],
    ]
}

/// Lengths, ranges and speeds are those of the makers' data sheets and manuals. Which end of a range is which
/// matters little here: home and paper are in the middle.
const ARMS: [Arm; 15] = [
    ur("UR3", [0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819], SMALLEST, ENDLESS),
    ur("UR5", [0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823], SMALL, TURN),
    ur("UR10", [0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922], LARGE, TURN),
    ur("UR3e", [0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921], SMALLEST, ENDLESS),
    ur("UR5e", [0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996], SMALL, TURN),
    ur("UR10e", [0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655], LARGE, TURN),
    ur("UR16e", [0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655], LARGE, TURN),
    ur("UR20", [0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543], LARGEST, TURN),
    ur("UR30", [0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543], LARGEST, TURN),
    // KUKA, data sheet "KR 6 R900 sixx": A2 counts from the horizontal, A3 from the stretched arm.
    Arm {
        name: "KUKA KR 6 R900 sixx",
        rows: [
            [0.025, 0.4, -H, 0.0],
            [0.455, 0.0, 0.0, 0.0],
            [0.035, 0.0, -H, -H],
            [0.0, 0.42, H, 0.0],
            [0.0, 0.0, -H, 0.0],
            [0.0, 0.08, 0.0, 0.0],
        ],
        limits: [
            [-170.0, 170.0],
            [-190.0, 45.0],
            [-120.0, 156.0],
            [-185.0, 185.0],
            [-120.0, 120.0],
            [-350.0, 350.0],
        ],
        speeds: [360.0, 300.0, 360.0, 381.0, 388.0, 615.0],
        home: [0.0, -0.9708, 1.8708, 0.0, 0.6708, 0.0],
    },
    // ABB, product specification IRB 120.
    Arm {
        name: "ABB IRB 120",
        rows: elbowed([0.29, 0.0, 0.27, 0.07, 0.302, 0.072]),
        limits: [
            [-165.0, 165.0],
            [-110.0, 110.0],
            [-110.0, 70.0],
            [-160.0, 160.0],
            [-120.0, 120.0],
            [-400.0, 400.0],
        ],
        speeds: [250.0, 250.0, 250.0, 320.0, 320.0, 420.0],
        home: [0.0, 0.6, 0.3, 0.0, 0.6708, 0.0],
    },
    // FANUC, data sheet LR Mate 200iD; J3 counts from J2 here and about this file's y, not from the floor and
    // against it.
    Arm {
        name: "FANUC LR Mate 200iD",
        rows: elbowed([0.33, 0.05, 0.33, 0.035, 0.335, 0.08]),
        limits: [
            [-170.0, 170.0],
            [-100.0, 145.0],
            [-205.0, 70.0],
            [-190.0, 190.0],
            [-125.0, 125.0],
            [-360.0, 360.0],
        ],
        speeds: [450.0, 380.0, 520.0, 550.0, 545.0, 1000.0],
        home: [0.0, 0.6, 0.3, 0.0, 0.6708, 0.0],
    },
    // Stäubli, instruction manual TX2 series 60.
    Arm {
        name: "Staubli TX2-60",
        rows: upright([0.375, 0.0, 0.02, 0.29, 0.31, 0.07]),
        limits: [
            [-180.0, 180.0],
            [-127.5, 127.5],
            [-152.5, 152.5],
            [-270.0, 270.0],
            [-121.0, 132.5],
            [-270.0, 270.0],
        ],
        speeds: [435.0, 385.0, 500.0, 995.0, 1065.0, 1445.0],
        home: [0.0, 0.5, 1.9, 0.0, 0.7416, 0.0],
    },
    // Doosan Robotics, user manual M1013.
    Arm {
        name: "Doosan M1013",
        rows: upright([0.1525, 0.0345, 0.0, 0.62, 0.559, 0.121]),
        limits: [
            [-360.0, 360.0],
            [-360.0, 360.0],
            [-160.0, 160.0],
            [-360.0, 360.0],
            [-360.0, 360.0],
            [-360.0, 360.0],
        ],
        speeds: [120.0, 120.0, 180.0, 225.0, 225.0, 225.0],
        home: [0.0, 0.5, 1.9, 0.0, 0.7416, 0.0],
    },
    // Kinova, Gen3 lite user guide: classical DH parameters, without the gripper.
    Arm {
        name: "Kinova Gen3 lite",
        rows: [
            [0.0, 0.2433, H, 0.0],
            [0.28, 0.03, PI, H],
            [0.0, 0.02, H, H],
            [0.0, 0.245, H, H],
            [0.0, 0.057, H, PI],
            [0.0, 0.105, 0.0, H],
        ],
        limits: [
            [-153.6, 153.6],
            [-150.1, 150.1],
            [-150.1, 150.1],
            [-148.98, 148.98],
            [-144.97, 145.0],
            [-148.98, 148.98],
        ],
        speeds: [91.6, 91.6, 91.6, 91.6, 91.6, 183.0],
        home: [0.0, -0.5, 1.9, H, 0.7416, 0.0],
    },
];

impl Arm {
    /// The tip of the pen in the base frame at joint positions `q`, straight from the parameters.
    fn tip(&self, q: &[f64; JOINTS]) -> Isometry3<f64> {
        let mut at = Isometry3::identity();
        for ([a, d, alpha, theta], q) in self.rows.iter().zip(q) {
            at *= UnitQuaternion::from_axis_angle(&Vector3::z_axis(), q + theta);
            at *= Translation3::new(*a, 0.0, *d);
            at *= UnitQuaternion::from_axis_angle(&Vector3::x_axis(), *alpha);
        }
        at * Translation3::new(0.0, 0.0, PEN_M)
    }

    /// Its kinematics as URDF: joint i stands at row i − 1 and turns about its z.
    fn urdf(&self) -> String {
        let mut text =
            format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n<link name=\"base_link\"/>\n", self.name);
        let mut row: Row = [0.0; 4];
        for joint in 0..=JOINTS {
            let [a, d, alpha, theta] = row;
            let (x, y) = (a * theta.cos(), a * theta.sin());
            let parent = if joint == 0 { "base_link".to_owned() } else { format!("l{joint}") };
            let (child, kind) = if joint == JOINTS {
                ("tool0".to_owned(), "fixed")
            } else {
                let endless = self.limits.get(joint).is_some_and(|[low, _]| low.is_infinite());
                (format!("l{}", joint + 1), if endless { "continuous" } else { "revolute" })
            };
            let _ = write!(
                text,
                "<link name=\"{child}\"/>\n<joint name=\"to_{child}\" type=\"{kind}\"><parent \
                 link=\"{parent}\"/><child link=\"{child}\"/><origin xyz=\"{x} {y} {d}\" rpy=\"{alpha} 0 {theta}\"/>"
            );
            if let (Some([low, high]), Some(speed)) = (self.limits.get(joint), self.speeds.get(joint)) {
                let [low, high, speed] = [low, high, speed].map(|degrees| degrees.to_radians());
                let ends = format!("lower=\"{low}\" upper=\"{high}\" ");
                let ends = if kind == "continuous" { "" } else { &ends };
                let _ =
                    write!(text, "<axis xyz=\"0 0 1\"/><limit {ends}velocity=\"{speed}\" effort=\"100\"/>");
            }
            text += "</joint>\n";
            row = self.rows.get(joint).copied().unwrap_or_default();
        }
        text + "</robot>\n"
    }

    /// Settings over the preset: this arm, and the paper where its home has the pen.
    fn config(&self) -> Config {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("arm.urdf"), self.urdf()).unwrap();
        let tip = self.tip(&self.home).translation.vector;
        let settings = format!(
            "preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, {PEN_M}]\nhome_rad = {:?}\n\
             controller_rate_hz = 500\n[plane]\norigin_m = [{:.4}, {:.4}, {:.4}]\nx_axis = [0.0, -1.0, 0.0]\n\
             workspace_m = [[-0.1, 0.1], [-0.06, 0.06], [-0.0005, 0.05]]\n[timing]\ndead_time_ms = 36.0\n",
            self.home,
            tip.x,
            tip.y,
            tip.z - LIFT_M
        );
        let path = folder.path().join("table.toml");
        std::fs::write(&path, settings).unwrap();
        Config::load(&path).unwrap_or_else(|error| panic!("{}: {error}", self.name))
    }
}

/// Where the pen is `t_s` after it set off: round and round, 15 cm/s on circles of 3 cm.
fn pen(t_s: f64) -> [f64; 2] {
    let begun = if t_s < 1.0 { 0.5 * t_s.max(0.0) * t_s.max(0.0) } else { t_s - 0.5 };
    let angle = 5.0 * begun;
    [0.03 * angle.cos() - 0.03, 0.03 * angle.sin()]
}

/// Lets the arm follow the pen for some seconds of simulated time; root mean square distance of the real tip
/// from the pen once both are under way \[m\].
fn follow(arm: &Arm, config: &Config) -> f64 {
    let settings = config.follower_settings();
    let (limits, plane, period_ns) = (settings.limits, settings.plane, settings.period_ns);
    let home = config.robot().home;
    let controller = ArmSettings { velocity_radps: *limits.velocity(), ..ArmSettings::ur5(0.002, 0.03) };
    let mut model = ArmModel::at_rest(controller, home);
    let mut follower = Follower::<20, JOINTS>::new(settings).unwrap();
    let mut judge = CommandChecker::new(limits);
    let mut now = Stamp(10_000_000_000);
    let begin = Stamp(11_000_000_000);
    let (mut squares, mut count) = (0.0, 0_u32);
    while now.seconds_since(begin) < 4.0 {
        let t_s = now.seconds_since(begin);
        let joints = model.joints();
        let reading = JointReading { stamp: now, q: joints.q, qd: joints.qd, motion_allowed: true };
        let sample = PenReading::new(now, pen(t_s), t_s > 0.0);
        let request = (now == Stamp(10_000_000_000)).then_some(Request::Arm);
        let input = StepInput { pen: &[sample], joints: Some(&reading), request, ..StepInput::nothing(now) };
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        assert_eq!(output.stop_reason, StopReason::None, "{} at {t_s} s: {:?}", arm.name, output.stop_detail);
        if request.is_some() {
            assert_eq!(output.answer, Some(Ok(())), "{}", arm.name);
        }
        if let Some(command) = &output.command {
            assert!(
                judge.observe(command.stamp, command.valid_until, &command.q, &command.qd),
                "{}",
                arm.name
            );
            model.cycle(command.q);
        }
        now = now + period_ns;
        if now.seconds_since(begin) > 2.0 {
            assert_eq!(output.mode, Mode::Following, "{}", arm.name);
            let tip = arm.tip(&model.really().q);
            let [x, y] = plane.from_pen(pen(now.seconds_since(begin)));
            let wanted = plane.point_to_base(&Vector3::new(x, y, 0.0));
            squares += (tip.translation.vector - wanted).norm_squared();
            count += 1;
        }
    }
    (squares / f64::from(count)).sqrt()
}

#[test]
fn arms_of_other_makers_pass_the_check_and_follow() {
    for arm in &ARMS {
        let config = arm.config();
        let model = &config.robot().chain;
        for q in [[0.0; JOINTS], arm.home, [0.3, -0.7, 0.9, -0.4, 1.1, 0.6]] {
            let (tip, believed) = (arm.tip(&q), model.forward(&q));
            let turned = tip.rotation.to_rotation_matrix();
            assert!((tip.translation.vector - believed.position).norm() < 1e-9, "{} {q:?}", arm.name);
            assert!((turned.matrix() - believed.rotation).norm() < 1e-9, "{} {q:?}", arm.name);
        }
        let rms_m = follow(arm, &config);
        println!("{}: {:.2} mm rms", arm.name, 1e3 * rms_m);
        assert!(rms_m < 1.5e-3, "{}: {rms_m} m", arm.name);
    }
}
