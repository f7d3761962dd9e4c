//! Where a controller's ports are.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs};

use crate::{dashboard, primary, rtde};

/// The ports of one controller that foretrace uses. A real one's are fixed; tests may choose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Addresses {
    /// States out, registers in.
    pub rtde: SocketAddr,
    /// Kinematics out, programs in.
    pub primary: SocketAddr,
    /// Remote control, models, words.
    pub dashboard: SocketAddr,
}

/// A host that has no address.
#[derive(Debug, thiserror::Error)]
#[error(
    "{host} has no address ({why}); give the controller's IP address, as the pendant shows it under Network"
)]
pub struct NoAddress {
    host: String,
    why: String,
}

impl Addresses {
    /// The usual ports of `host`, a name or an IP address. IPv4 goes first: controllers have no other.
    ///
    /// # Errors
    ///
    /// Where the name cannot be resolved.
    pub fn of(host: &str) -> Result<Self, NoAddress> {
        let refused = |why: String| NoAddress { host: host.chars().take(80).collect(), why };
        let found: Vec<SocketAddr> =
            (host, rtde::PORT).to_socket_addrs().map_err(|error| refused(error.to_string()))?.collect();
        let first = found.iter().find(|address| address.is_ipv4()).or_else(|| found.first());
        first
            .map(|address| Self::at(address.ip()))
            .ok_or_else(|| refused("it resolves to nothing".to_owned()))
    }

    /// The usual ports of an address.
    #[must_use]
    pub const fn at(ip: IpAddr) -> Self {
        Self {
            rtde: SocketAddr::new(ip, rtde::PORT),
            primary: SocketAddr::new(ip, primary::PRIMARY_PORT),
            dashboard: SocketAddr::new(ip, dashboard::PORT),
        }
    }

    #[must_use]
    pub const fn ip(&self) -> IpAddr {
        self.rtde.ip()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_is_an_address_with_the_usual_ports() {
        let addresses = Addresses::of("127.0.0.3").unwrap();
        assert_eq!(addresses.rtde, "127.0.0.3:30004".parse().unwrap());
        assert_eq!(addresses.dashboard, "127.0.0.3:29999".parse().unwrap());
        assert!(Addresses::of("no such host").unwrap_err().to_string().contains("no such host"));
    }
}
