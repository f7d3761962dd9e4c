//! Claims about primary packages: sizes of the guide, round trips, bytes of nobody.

use super::*;
use proptest::prelude::*;

fn parts() -> Vec<(SubPackage, usize)> {
    let joint = OneJoint {
        q_actual: 0.5,
        q_target: 0.6,
        qd_actual: -0.7,
        current: 1.5,
        voltage: 48.0,
        temperature: 30.0,
        mode: 253,
    };
    let row = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    let kinematics = KinematicsInfo {
        checksum: [1, 2, 3, 4, 5, 6],
        theta: row,
        a: row,
        d: row,
        alpha: row,
        calibration_status: 1,
    };
    let configuration = ConfigurationData {
        position_limits: [[-6.3, 6.3]; 6],
        motion_limits: [[3.3, 40.0]; 6],
        defaults: [1.0, 1.4, 0.25, 1.2, 0.5],
        a: row,
        d: row,
        alpha: row,
        theta: row,
        masterboard_version: 5,
        controller_box_type: 3,
        robot_type: 1,
        robot_subtype: 2,
    };
    let mode = RobotModeData {
        timestamp_us: 7,
        connected: true,
        program_running: true,
        robot_mode: 7,
        target_speed_fraction: 0.5,
        speed_scaling: 0.25,
        target_speed_fraction_limit: 1.0,
        ..RobotModeData::default()
    };
    let tool = ToolData { analog_input: [0.1, 0.2], output_voltage: 24, mode: 253 };
    let board = MasterboardData {
        digital_input_bits: 3,
        digital_output_bits: 1 << 17,
        analog_input: [1.0, 2.0],
        analog_output: [3.0, 4.0],
        safety_mode: 1,
    };
    // Sizes of the client interface guide for 3.5 and later.
    vec![
        (SubPackage::RobotMode(mode), 47),
        (SubPackage::Joints(JointData([joint; 6])), 251),
        (SubPackage::Tool(tool), 37),
        (SubPackage::Masterboard(board), 74),
        (SubPackage::Cartesian(CartesianInfo { pose: row, tcp_offset: [0.0; 6] }), 101),
        (SubPackage::Kinematics(kinematics), 225),
        (SubPackage::Configuration(configuration), 445),
        (SubPackage::Additional([false, true, true]), 9),
    ]
}

#[test]
fn sub_packages_have_the_guides_sizes_and_come_back() {
    for (part, size) in parts() {
        let package = PrimaryPackage::State(RobotState { parts: vec![part] });
        let bytes = package.encode();
        assert_eq!(bytes.len(), HEADER + size, "{package:?}");
        let mut rest = &bytes[..];
        assert_eq!(PrimaryPackage::take(&mut rest), Ok(Some(package)));
        assert!(rest.is_empty());
    }
}

#[test]
fn messages_come_back() {
    let content = [
        MessageContent::Text("hello".to_owned()),
        MessageContent::Version {
            project: "URControl".to_owned(),
            major: 5,
            minor: 11,
            bugfix: 1,
            build: 2,
            date: "today".to_owned(),
        },
        MessageContent::Code { code: 153, argument: 0, level: 3, text: "deviates".to_owned() },
        MessageContent::Key {
            code: 0,
            argument: 0,
            title: "PROGRAM_XXX_STOPPED".to_owned(),
            text: "p".to_owned(),
        },
        MessageContent::RuntimeException { line: 3, column: 4, text: "no".to_owned() },
        MessageContent::Other(9),
    ];
    for content in content {
        let package = PrimaryPackage::Message(RobotMessage { timestamp_us: 9, source: -1, content });
        let bytes = package.encode();
        let mut rest = &bytes[..];
        assert_eq!(PrimaryPackage::take(&mut rest), Ok(Some(package)));
    }
}

#[test]
fn a_version_message_has_the_bytes_that_clients_read() {
    let content = MessageContent::Version {
        project: "UR".to_owned(),
        major: 3,
        minor: 15,
        bugfix: 8,
        build: 258,
        date: "d".to_owned(),
    };
    let bytes = PrimaryPackage::Message(RobotMessage { timestamp_us: 1, source: -2, content }).encode();
    let wanted =
        [0, 0, 0, 29, 20, 0, 0, 0, 0, 0, 0, 0, 1, 254, 3, 2, b'U', b'R', 3, 15, 0, 0, 0, 8, 0, 0, 1, 2, b'd'];
    assert_eq!(bytes, wanted);
}

#[test]
fn packages_of_later_versions_are_read_as_far_as_they_are_known() {
    let mut inner = framed(4, &[0; 96 + 8]);
    inner.extend(framed(12, &[1, 2, 3]));
    let bytes = framed(16, &inner);
    let Ok(Some(PrimaryPackage::State(state))) = PrimaryPackage::take(&mut &bytes[..]) else {
        panic!("no state")
    };
    assert_eq!(state.parts, [SubPackage::Cartesian(CartesianInfo::default()), SubPackage::Other(12)]);
    let short = framed(16, &framed(4, &[0; 47]));
    assert_eq!(PrimaryPackage::take(&mut &short[..]), Err(Malformed::Payload(4)));
}

#[test]
fn sizes_that_cannot_be_are_refused_and_beginnings_waited_for() {
    for (size, wanted) in [
        (4, Err(Malformed::Size(4))),
        (-1, Err(Malformed::Size(-1))),
        (i32::MAX, Err(Malformed::Size(i64::from(i32::MAX)))),
        (50, Ok(None)),
    ] {
        let mut bytes = i32::to_be_bytes(size).to_vec();
        bytes.extend_from_slice(&[16, 0, 0]);
        assert_eq!(PrimaryPackage::take(&mut &bytes[..]), wanted, "{size}");
    }
    assert_eq!(PrimaryPackage::take(&mut &[0, 0, 0][..]), Ok(None));
}

proptest! {
    #![proptest_config(crate::fuzz::cases(2000))]

    #[test]
    fn any_bytes_are_read_or_refused(
        kind in prop_oneof![Just(16u8), Just(20), any::<u8>()],
        payload in prop::collection::vec(prop_oneof![Just(0u8), any::<u8>()], 0..300),
    ) {
        let bytes = framed(kind, &payload);
        let mut rest = &bytes[..];
        if let Ok(Some(package)) = PrimaryPackage::take(&mut rest) {
            prop_assert!(rest.is_empty());
            prop_assert!(package.encode().len() <= LARGEST);
        }
    }

    #[test]
    fn a_state_with_flipped_bytes_is_read_or_refused(at in 0usize..1100, to in any::<u8>()) {
        let mut bytes =
            PrimaryPackage::State(RobotState { parts: parts().into_iter().map(|(part, _)| part).collect() })
                .encode();
        if let Some(byte) = bytes.get_mut(at) {
            *byte = to;
        }
        let mut rest = &bytes[..];
        for _ in 0..bytes.len() {
            match PrimaryPackage::take(&mut rest) {
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => break,
            }
        }
    }
}

#[test]
fn claimed_sizes_are_checked_before_anything_is_kept_and_trickles_end_in_time() {
    use std::io::Write as _;
    use std::time::{Duration, Instant};
    for (size, believed) in [
        (i32::MIN, false),
        (-1, false),
        (0, false),
        (4, false),
        (65_537, false),
        (i32::MAX, false),
        (65_536, true),
    ] {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let thread = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut sent = stream.write_all(&[&size.to_be_bytes()[..], &[STATE]].concat());
            while sent.is_ok() {
                std::thread::sleep(Duration::from_millis(2));
                sent = stream.write_all(&[0]);
            }
        });
        let mut client = PrimaryClient::connect(address, Duration::from_secs(5)).unwrap();
        let asked = Instant::now();
        let came = client.receive(Duration::from_millis(200));
        assert!(asked.elapsed() < Duration::from_secs(10), "{size}");
        match came {
            Ok(None) => assert!(believed, "{size}"),
            Err(PrimaryError::Malformed(Malformed::Size(reported))) => {
                assert!(!believed && reported == i64::from(size), "{size}: {reported}");
            }
            other => panic!("{size}: {other:?}"),
        }
        drop(client);
        thread.join().unwrap();
    }
}
