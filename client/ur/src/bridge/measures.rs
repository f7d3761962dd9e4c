//! The arm's own measures, read from the primary interface: kinematics info of a robot state.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use super::kinematics::DhParameters;
use crate::primary::{KinematicsInfo, PrimaryClient, PrimaryError, PrimaryPackage, SubPackage};

/// What the primary interface showed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    pub states: bool,
    pub dh: Option<DhParameters>,
    /// Tool centre point, seen from the flange \[m\].
    pub tcp_m: Option<[f64; 3]>,
}

/// Listens to the primary interface at `address` until the kinematics came, for `patience` at most.
///
/// # Errors
///
/// Where there is no connection, or it breaks before a state came.
pub fn listen(address: SocketAddr, patience: Duration) -> Result<Measures, PrimaryError> {
    let end = Instant::now() + patience;
    let mut client = PrimaryClient::connect(address, patience)?;
    let mut found = Measures { states: false, dh: None, tcp_m: None };
    while found.dh.is_none() {
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            break;
        }
        match client.receive(left) {
            Ok(Some(PrimaryPackage::State(state))) => {
                found.states = true;
                found.dh = state.kinematics().map(DhParameters::from).filter(DhParameters::are_sound);
                found.tcp_m = found.tcp_m.or_else(|| state.parts.iter().find_map(tool_centre_point));
            }
            Ok(Some(_)) => {}
            Ok(None) => break,
            Err(error) if !found.states => return Err(error),
            Err(_) => break,
        }
    }
    Ok(found)
}

fn tool_centre_point(part: &SubPackage) -> Option<[f64; 3]> {
    let SubPackage::Cartesian(info) = part else { return None };
    let [x, y, z, ..] = info.tcp_offset;
    Some([x, y, z]).filter(|position| position.iter().all(|value| value.is_finite()))
}

impl From<&KinematicsInfo> for DhParameters {
    fn from(info: &KinematicsInfo) -> Self {
        Self { theta: info.theta, a: info.a, d: info.d, alpha: info.alpha }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primary::{CartesianInfo, RobotState};
    use std::io::Write;
    use std::net::TcpListener;
    use std::thread;

    const INFO: KinematicsInfo = KinematicsInfo {
        checksum: [1; 6],
        theta: [0.1; 6],
        a: [0.0, -0.425, -0.39, 0.0, 0.0, 0.0],
        d: [0.16, 0.0, 0.0, 0.13, 0.1, 0.1],
        alpha: [1.5, 0.0, 0.0, 1.5, -1.5, 0.0],
        calibration_status: 1,
    };

    fn served(bytes: Vec<u8>) -> Result<Measures, PrimaryError> {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let server = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            for piece in bytes.chunks(100) {
                if stream.write_all(piece).is_err() {
                    return;
                }
            }
            thread::sleep(Duration::from_millis(50));
        });
        let found = listen(address, Duration::from_millis(500));
        server.join().unwrap();
        found
    }

    fn state(parts: Vec<SubPackage>) -> Vec<u8> {
        PrimaryPackage::State(RobotState { parts }).encode()
    }

    #[test]
    fn kinematics_are_found_in_the_state_that_has_them() {
        let tool = CartesianInfo { pose: [0.0; 6], tcp_offset: [0.0, 0.01, 0.15, 0.0, 0.0, 0.0] };
        let parts = vec![SubPackage::Cartesian(tool), SubPackage::Kinematics(INFO)];
        let bytes = [state(Vec::new()), state(parts)].concat();
        let (dh, tcp_m) = (Some(DhParameters::from(&INFO)), Some([0.0, 0.01, 0.15]));
        assert_eq!(served(bytes).unwrap(), Measures { states: true, dh, tcp_m });
    }

    #[test]
    fn states_without_kinematics_are_states() {
        assert_eq!(served(state(Vec::new())).unwrap(), Measures { states: true, dh: None, tcp_m: None });
    }

    #[test]
    fn kinematics_that_are_no_numbers_are_none() {
        let wrong = |a, d| state(vec![SubPackage::Kinematics(KinematicsInfo { a, d, ..INFO })]);
        assert_eq!(served(wrong([f64::NAN; 6], INFO.d)).unwrap().dh, None);
        assert_eq!(served(wrong(INFO.a, [1e9; 6])).unwrap().dh, None);
    }

    #[test]
    fn another_protocol_is_reported() {
        assert!(served(b"HTTP/1.1 400 Bad Request\r\n".to_vec()).is_err());
    }
}
