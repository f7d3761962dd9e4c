//! Universal Robots arms: what a controller speaks, and the bridge between it and foretrace.
//!
//! Rooms, in order: `rtde` (packages, fields, client), `primary` (packages of ports 30001 and 30002),
//! `dashboard` (port 29999), `series`, `bridge` (foretrace to a controller and back). Std threads and
//! sockets. Everything a socket brings is untrusted. A simulated controller is in `foretrace-ur-sim`.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod rtde;
pub mod primary;
pub mod dashboard;
pub mod series;
pub mod bridge;

use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// A connection to a controller, made within `patience`, whose writes wait no longer than that.
fn connect(address: SocketAddr, patience: Duration) -> std::io::Result<TcpStream> {
    let stream = TcpStream::connect_timeout(&address, patience)?;
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(patience))?;
    Ok(stream)
}

#[cfg(test)]
#[path = "tests/fuzz.rs"]
mod fuzz;
