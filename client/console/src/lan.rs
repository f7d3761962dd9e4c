//! Where other machines find the page, and the certificate by which they know it.
//!
//! Contract: listens at addresses that were named, or at the one that leads to other machines, never at all
//! of them. The certificate is kept in the user's state folder.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, UdpSocket};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::SystemTime;

use foretrace_failure::Failure;

use crate::certificate::Certificate;
use crate::server::Lan;

const REMEDY: &str = "name an address of this machine with --lan=ADDRESS; `ip address` lists them";

/// Where to listen beside 127.0.0.1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LanAddress {
    /// Where the way to other machines begins.
    Usual,
    At(IpAddr),
}

impl FromStr for LanAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "usual" {
            return Ok(Self::Usual);
        }
        let address: IpAddr =
            text.parse().map_err(|_| "an address of this machine, such as 192.168.7.2".to_owned())?;
        // `::ffff:0.0.0.0` is every address of version 4.
        let address = address.to_canonical();
        let local = matches!(address, IpAddr::V6(v6) if v6.is_unicast_link_local());
        if address.is_unspecified() || address.is_multicast() || local || address == Ipv4Addr::LOCALHOST {
            return Err("one address of this machine that others reach, such as 192.168.7.2".to_owned());
        }
        Ok(Self::At(address))
    }
}

impl Lan {
    /// The addresses, names and certificate for `all`.
    ///
    /// # Errors
    ///
    /// No way leads to other machines, or the certificate cannot be kept.
    pub fn prepared(all: &[LanAddress]) -> Result<Self, Failure> {
        let mut addresses = Vec::new();
        for wanted in all {
            let address = match wanted {
                LanAddress::At(address) => *address,
                LanAddress::Usual => usual()?,
            };
            if !addresses.contains(&address) {
                addresses.push(address);
            }
        }
        let mut names = vec!["localhost".to_owned()];
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        if let Some(host) = named(host.trim()) {
            names.extend([format!("{host}.local"), host]);
        }
        let mut covered: Vec<String> = addresses.iter().map(ToString::to_string).collect();
        covered.push(Ipv4Addr::LOCALHOST.to_string());
        covered.extend(names.iter().cloned());
        let certificate = Certificate::kept(&kept_in()?, &covered, SystemTime::now())
            .map_err(|error| Failure::failed(error, ""))?;
        Ok(Self { addresses, names, certificate })
    }
}

/// A name that a certificate and a browser take.
fn named(host: &str) -> Option<String> {
    let legal = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'.';
    let is_name = !host.is_empty() && host.len() <= 200 && host.bytes().all(legal);
    (is_name && host != "localhost").then(|| host.to_ascii_lowercase())
}

/// The address from which the way to other networks begins, else to other networks by version 6. Nothing is
/// sent: a datagram socket that connects only looks the way up.
fn usual() -> Result<IpAddr, Failure> {
    // Addresses for documentation (RFC 5737, RFC 3849): they lead to nobody, by the usual way.
    let ways: [(IpAddr, IpAddr); 2] = [
        (Ipv4Addr::UNSPECIFIED.into(), Ipv4Addr::new(203, 0, 113, 1).into()),
        (Ipv6Addr::UNSPECIFIED.into(), Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1).into()),
    ];
    let found = ways.into_iter().find_map(|(from, to)| {
        let socket = UdpSocket::bind((from, 0)).ok()?;
        socket.connect((to, 9)).ok()?;
        Some(socket.local_addr().ok()?.ip()).filter(|at| !at.is_loopback() && !at.is_unspecified())
    });
    found.ok_or_else(|| Failure::failed("this machine has no way to other machines just now", REMEDY))
}

/// The file of the certificate: below `$XDG_STATE_HOME`, else `~/.local/state`.
fn kept_in() -> Result<PathBuf, Failure> {
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let state = folder("XDG_STATE_HOME").or_else(|| folder("HOME").map(|home| home.join(".local/state")));
    let state = state.ok_or_else(|| {
        Failure::failed(
            "there is no folder to keep the certificate in",
            "set XDG_STATE_HOME to one of this user's",
        )
    })?;
    Ok(state.join("foretrace/console-certificate"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_address_of_this_machine_is_taken_and_all_of_them_are_not() {
        assert_eq!("192.168.7.2".parse(), Ok(LanAddress::At(Ipv4Addr::new(192, 168, 7, 2).into())));
        assert_eq!("usual".parse(), Ok(LanAddress::Usual));
        for wrong in [
            "0.0.0.0",
            "::",
            "127.0.0.1",
            "224.0.0.1",
            "::ffff:0.0.0.0",
            "fe80::1",
            "desk",
            "",
            "192.168.7.2:80",
        ] {
            assert!(wrong.parse::<LanAddress>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn names_of_machines_are_those_that_a_browser_can_ask_for() {
        assert_eq!(named("Desk-7").as_deref(), Some("desk-7"));
        for wrong in ["", "localhost", "d\u{e9}sk", "a b", "a_b"] {
            assert_eq!(named(wrong), None, "{wrong}");
        }
    }
}
