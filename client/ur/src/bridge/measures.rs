//! The arm's own measures, read from the primary interface: kinematics info, sub-package 5 of a robot state.
//!
//! Contract: reads only, for a bounded time, packages of bounded size.
//!
//! *Source*: client interface document of Universal Robots (primary and secondary interface).

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use foretrace_client::JOINTS;

use super::kinematics::DhParameters;

const ROBOT_STATE: u8 = 16;
const KINEMATICS_INFO: u8 = 5;
/// Largest package that is believed; real ones have some 1500 bytes.
const LARGEST: usize = 1 << 16;

/// What the primary interface showed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    /// Robot states came.
    pub states: bool,
    /// The arm's kinematics.
    pub dh: Option<DhParameters>,
}

/// Listens to the primary interface at `address` until the kinematics came, for `patience` at most.
///
/// # Errors
///
/// Where there is no connection, or it breaks before anything came.
pub fn listen(address: SocketAddr, patience: Duration) -> std::io::Result<Measures> {
    let end = Instant::now() + patience;
    let mut stream = TcpStream::connect_timeout(&address, patience)?;
    let (mut unread, mut some) = (Vec::new(), [0; 4096]);
    let mut found = Measures { states: false, dh: None };
    loop {
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(found);
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(&mut some) {
            Ok(0) => return Ok(found),
            Ok(count) => unread.extend(some.iter().take(count)),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return Ok(found);
            }
            Err(error) if !found.states => return Err(error),
            Err(_) => return Ok(found),
        }
        while let Some(package) = next(&mut unread)? {
            if let [ROBOT_STATE, rest @ ..] = package.as_slice() {
                found.states = true;
                found.dh = found.dh.or_else(|| kinematics(rest));
            }
            if found.dh.is_some() {
                return Ok(found);
            }
        }
    }
}

/// The next whole package, without its size.
fn next(unread: &mut Vec<u8>) -> std::io::Result<Option<Vec<u8>>> {
    let [a, b, c, d, ..] = unread.as_slice() else { return Ok(None) };
    let size = usize::try_from(i32::from_be_bytes([*a, *b, *c, *d])).unwrap_or(0);
    if !(5..=LARGEST).contains(&size) {
        return Err(std::io::Error::new(ErrorKind::InvalidData, "this is no primary interface"));
    }
    if unread.len() < size {
        return Ok(None);
    }
    let package: Vec<u8> = unread.drain(..size).collect();
    Ok(Some(package.into_iter().skip(4).collect()))
}

/// The kinematics among the sub-packages of a robot state.
fn kinematics(mut rest: &[u8]) -> Option<DhParameters> {
    while let [a, b, c, d, kind, ..] = rest {
        let size = usize::try_from(u32::from_be_bytes([*a, *b, *c, *d])).ok().filter(|size| *size >= 5)?;
        let (package, after) = rest.split_at_checked(size)?;
        if *kind == KINEMATICS_INFO {
            // Six checksums of four bytes, then four rows of six doubles.
            let numbers = package.get(5 + 6 * 4..)?;
            let mut rows = numbers.chunks_exact(8 * JOINTS);
            let mut row = || rows.next().map(doubles);
            let dh = DhParameters { theta: row()?, a: row()?, d: row()?, alpha: row()? };
            return Some(dh).filter(DhParameters::are_sound);
        }
        rest = after;
    }
    None
}

fn doubles(bytes: &[u8]) -> [f64; JOINTS] {
    let mut numbers = [f64::NAN; JOINTS];
    for (number, chunk) in numbers.iter_mut().zip(bytes.chunks_exact(8)) {
        *number = f64::from_be_bytes(<[u8; 8]>::try_from(chunk).unwrap_or_default());
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Write;
    use std::net::TcpListener;
    use std::thread;

    const DH: DhParameters = DhParameters {
        theta: [0.1; 6],
        a: [0.0, -0.425, -0.39, 0.0, 0.0, 0.0],
        d: [0.16, 0.0, 0.0, 0.13, 0.1, 0.1],
        alpha: [1.5, 0.0, 0.0, 1.5, -1.5, 0.0],
    };

    fn sub(kind: u8, payload: &[u8]) -> Vec<u8> {
        let mut bytes = u32::try_from(payload.len() + 5).unwrap().to_be_bytes().to_vec();
        bytes.push(kind);
        bytes.extend(payload);
        bytes
    }

    fn state(subs: &[Vec<u8>]) -> Vec<u8> {
        let payload = subs.concat();
        let mut bytes = i32::try_from(payload.len() + 5).unwrap().to_be_bytes().to_vec();
        bytes.push(ROBOT_STATE);
        bytes.extend(payload);
        bytes
    }

    fn info(dh: &DhParameters) -> Vec<u8> {
        let mut payload = vec![0; 24];
        for row in [dh.theta, dh.a, dh.d, dh.alpha] {
            row.iter().for_each(|value| payload.extend(value.to_be_bytes()));
        }
        payload.extend(1u32.to_be_bytes());
        sub(KINEMATICS_INFO, &payload)
    }

    /// Serves `bytes` in small pieces.
    fn served(bytes: Vec<u8>) -> std::io::Result<Measures> {
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

    #[test]
    fn kinematics_are_found_among_other_packages() {
        let bytes =
            [state(&[sub(0, &[1; 42])]), state(&[sub(6, &[7; 400]), info(&DH), sub(4, &[0; 30])])].concat();
        assert_eq!(served(bytes).unwrap(), Measures { states: true, dh: Some(DH) });
    }

    #[test]
    fn states_without_kinematics_are_states() {
        assert_eq!(served(state(&[sub(0, &[1; 42])])).unwrap(), Measures { states: true, dh: None });
    }

    #[test]
    fn kinematics_that_are_no_numbers_are_none() {
        let wrong = DhParameters { a: [f64::NAN; 6], ..DH };
        assert_eq!(served(state(&[info(&wrong)])).unwrap().dh, None);
        let far = DhParameters { d: [1e9; 6], ..DH };
        assert_eq!(served(state(&[info(&far)])).unwrap().dh, None);
    }

    #[test]
    fn another_protocol_is_told() {
        assert!(served(b"HTTP/1.1 400 Bad Request\r\n".to_vec()).is_err());
    }

    proptest! {
        #[test]
        fn any_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
            let mut unread = bytes.clone();
            while let Ok(Some(package)) = next(&mut unread) {
                let _ = kinematics(&package);
            }
            let _ = kinematics(&bytes);
        }
    }
}
