//! What ports 30001, 30002 and 30003 send: states and messages, and the fixed record of the real-time
//! interface.

use super::kinematics::{ArmDh, POSITION_LIMIT_RAD, nominal};
use super::options::Series;
use super::outputs::joint_mode;
use super::robot::SPEED_LIMIT_RADPS;
use super::world::{Runtime, World};
use foretrace_ur::primary::{
    CartesianInfo, ConfigurationData, JointData, KinematicsInfo, MasterboardData, MessageContent, OneJoint,
    PrimaryPackage, RobotMessage, RobotModeData, RobotState, SubPackage, ToolData,
};

/// Bytes of a real-time record: 3.5 and later, 5.10 and later.
const REAL_TIME_BYTES: [usize; 2] = [1108, 1220];

fn timestamp_us(world: &World) -> u64 {
    // Whole cycles are whole milliseconds.
    (world.robot.timestamp() * 1e6).round() as u64
}

/// The message with which a connection begins.
#[must_use]
pub fn greeting(world: &World) -> Vec<u8> {
    let version = world.robot.options.version;
    let small = |number: u32| u8::try_from(number).unwrap_or(u8::MAX);
    let large = |number: u32| i32::try_from(number).unwrap_or(i32::MAX);
    let content = MessageContent::Version {
        project: "URControl".to_owned(),
        major: small(version.major),
        minor: small(version.minor),
        bugfix: large(version.bugfix),
        build: large(version.build),
        date: "simulated".to_owned(),
    };
    message(world, content)
}

/// A message as a package.
#[must_use]
pub fn message(world: &World, content: MessageContent) -> Vec<u8> {
    PrimaryPackage::Message(RobotMessage { timestamp_us: timestamp_us(world), source: -1, content }).encode()
}

/// The state as ports 30001 and 30002 send it ten times a second.
#[must_use]
pub fn state(world: &World) -> Vec<u8> {
    let robot = &world.robot;
    let (actual, target) = (robot.actual(), robot.target);
    let runtime = world.runtime();
    let safety = robot.safety;
    let mode = RobotModeData {
        timestamp_us: timestamp_us(world),
        connected: true,
        enabled: true,
        power_on: robot.mode.number() >= 4,
        emergency_stopped: safety.emergency_stopped(),
        protective_stopped: safety.protective().is_some(),
        program_running: runtime != Runtime::Stopped,
        program_paused: matches!(runtime, Runtime::Pausing | Runtime::Paused),
        robot_mode: u8::try_from(robot.mode.number()).unwrap_or(0),
        control_mode: 0,
        target_speed_fraction: robot.slider,
        speed_scaling: robot.speed_scaling,
        target_speed_fraction_limit: 1.0,
    };
    let mut joints = [OneJoint::default(); 6];
    let values = actual.q.iter().zip(target.q).zip(actual.qd);
    for (joint, ((q_actual, q_target), qd_actual)) in joints.iter_mut().zip(values) {
        *joint = OneJoint {
            q_actual: *q_actual,
            q_target,
            qd_actual,
            current: 0.0,
            voltage: 48.0,
            temperature: 30.0,
            mode: joint_mode(world),
        };
    }
    let low = |bits: u64| (bits & 0xffff_ffff) as u32;
    let board = MasterboardData {
        digital_input_bits: low(robot.digital_inputs),
        digital_output_bits: low(robot.digital_outputs),
        analog_input: [0.004; 2],
        analog_output: robot.analog_outputs,
        safety_mode: u8::try_from(safety.number()).unwrap_or(11),
    };
    let tool = ToolData {
        analog_input: [0.0; 2],
        output_voltage: u8::try_from(robot.setup.tool_voltage).unwrap_or(0),
        mode: joint_mode(world),
    };
    let cartesian = CartesianInfo { pose: robot.tcp_pose(&actual.q), tcp_offset: robot.tcp_offset };
    let parts = vec![
        SubPackage::RobotMode(mode),
        SubPackage::Joints(JointData(joints)),
        SubPackage::Tool(tool),
        SubPackage::Masterboard(board),
        SubPackage::Cartesian(cartesian),
        SubPackage::Kinematics(kinematics(&robot.dh, robot.options.calibration_error_m > 0.0)),
        SubPackage::Configuration(configuration(robot.options.series)),
        SubPackage::Additional([false, true, true]),
    ];
    PrimaryPackage::State(RobotState { parts }).encode()
}

fn kinematics(dh: &ArmDh, calibrated: bool) -> KinematicsInfo {
    let mut checksum = [0; 6];
    let rows = dh.theta.iter().zip(dh.a).zip(dh.d).zip(dh.alpha);
    for (sum, (((theta, a), d), alpha)) in checksum.iter_mut().zip(rows) {
        let bits = [*theta, a, d, alpha].map(f64::to_bits);
        let mixed = bits.iter().fold(0u64, |sum, bits| (sum ^ bits).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        *sum = (mixed >> 32) as u32;
    }
    let ArmDh { theta, a, d, alpha } = *dh;
    KinematicsInfo { checksum, theta, a, d, alpha, calibration_status: u32::from(!calibrated) }
}

fn configuration(series: Series) -> ConfigurationData {
    let ArmDh { theta, a, d, alpha } = nominal(series);
    ConfigurationData {
        position_limits: [[-POSITION_LIMIT_RAD, POSITION_LIMIT_RAD]; 6],
        motion_limits: [[SPEED_LIMIT_RADPS, 40.0]; 6],
        // 60 °/s and 80 °/s².
        defaults: [60f64.to_radians(), 80f64.to_radians(), 0.25, 1.2, 0.5],
        a,
        d,
        alpha,
        theta,
        masterboard_version: 5,
        controller_box_type: 2,
        robot_type: 1,
        robot_subtype: if series == Series::E { 4 } else { 3 },
    }
}

/// The record of port 30003 in this cycle.
///
/// *Source*: real-time interface guide: 139 doubles behind the size for 3.5 and later, 153 for 5.10 and
/// later.
#[must_use]
pub fn real_time(world: &World) -> Vec<u8> {
    let robot = &world.robot;
    let (actual, target) = (robot.actual(), robot.target);
    let still = [0.0; 6];
    let mode = f64::from(robot.mode.number());
    let bits = |bits: u64| bits as f64;
    let pose = robot.tcp_pose(&actual.q);
    let target_pose = robot.tcp_pose(&target.q);
    let ([vx, vy, vz], [ex, ey, ez]) = robot.elbow();
    let mut v = vec![robot.timestamp()];
    let vectors = [target.q, target.qd, robot.target_qdd, still, still, actual.q, actual.qd, still, still];
    vectors.iter().for_each(|vector| v.extend(vector));
    // Pose and speed of the tool, its force, and where it is sent to.
    [pose, robot.tcp_speed(&actual), still, target_pose, robot.tcp_speed(&target)]
        .iter()
        .for_each(|vector| v.extend(vector));
    v.push(bits(robot.digital_inputs));
    // Temperatures of the motors, timer of the controller, a value for the maker's tests.
    v.extend([30.0; 6]);
    v.extend([0.2, 0.0, mode]);
    v.extend([f64::from(joint_mode(world)); 6]);
    v.push(f64::from(robot.safety.number()));
    // Six of the maker's own, the tool's accelerometer, six more of the maker's own.
    v.extend(still);
    v.extend([0.0, 0.0, 9.81]);
    v.extend(still);
    v.extend([robot.speed_scaling, 0.0, 0.0, 0.0, 48.0, 48.0, 1.0]);
    v.extend([48.0; 6]);
    v.extend([bits(robot.digital_outputs), f64::from(world.runtime().number())]);
    v.extend([ex, ey, ez, vx, vy, vz]);
    v.push(f64::from(robot.safety.number()));
    let [cb3, e] = REAL_TIME_BYTES;
    let size = if robot.options.series == Series::E { e } else { cb3 };
    if robot.options.series == Series::E {
        // Three of the maker's own, the payload, its centre of gravity, its inertia.
        v.extend([0.0; 3]);
        let (mass, [x, y, z]) = robot.payload;
        v.extend([mass, x, y, z]);
        v.extend(still);
    }
    let mut bytes = Vec::with_capacity(size);
    bytes.extend_from_slice(&i32::try_from(size).unwrap_or(0).to_be_bytes());
    v.iter().for_each(|number| bytes.extend_from_slice(&number.to_be_bytes()));
    bytes.resize(size, 0);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::ControllerOptions;

    #[test]
    fn real_time_records_have_the_guides_size_and_places() {
        for (series, size) in [(Series::Cb3, 1108), (Series::E, 1220)] {
            let world = World::new(ControllerOptions::new(series));
            let bytes = real_time(&world);
            assert_eq!(bytes.len(), size);
            assert_eq!(bytes[..4], i32::try_from(size).unwrap().to_be_bytes());
            let at = |byte: usize| f64::from_be_bytes(bytes[byte..byte + 8].try_into().unwrap());
            // Bytes of the guide's table: actual q, tool pose, robot mode, speed scaling, program state.
            assert_eq!(at(252), world.robot.actual().q[0]);
            assert_eq!(at(444), world.robot.tcp_pose(&world.robot.actual().q)[0]);
            assert_eq!([at(756), at(812), at(940), at(1052)], [7.0, 1.0, 1.0, 1.0]);
            assert_eq!(at(1060), world.robot.elbow().1[0]);
        }
    }

    #[test]
    fn states_are_read_by_our_own_client() {
        let mut options = ControllerOptions::new(Series::E);
        options.calibration_error_m = 0.003;
        let world = World::new(options);
        let bytes = state(&world);
        let Ok(Some(PrimaryPackage::State(state))) = PrimaryPackage::take(&mut &bytes[..]) else {
            panic!("no state")
        };
        assert_eq!(state.parts.len(), 8);
        let kinematics = state.kinematics().unwrap();
        assert_eq!((kinematics.a, kinematics.calibration_status), (world.robot.dh.a, 0));
        assert_ne!(kinematics.a, nominal(Series::E).a);
    }
}
