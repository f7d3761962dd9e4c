//! Which viewers may come in: hosts and origins, the subprotocol, the token.
//!
//! Contract: pure. Viewers that are not browsers send no origin.

use std::net::SocketAddr;

use foretrace_serve::guard::{HostGuard, Token};
use foretrace_serve::http::Head;

/// The subprotocols in use, the preferred one first. The messages of all three are the same: those of
/// `foxglove.websocket.v1`.
pub(crate) const SUBPROTOCOLS: [&str; 3] = ["foxglove.sdk.v1", "foxglove.websocket.v1", "foxglove.sdk.v1.1"];
/// Origins of the viewers' own: Foxglove's page, and programs made of a page.
const VIEWERS: [&str; 2] = ["https://app.foxglove.dev", "file://"];

/// Why a connection is refused.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ViewerRefusal {
    /// In words to count by.
    pub(crate) reason: &'static str,
    /// For the viewer, with what to do.
    pub(crate) message: String,
}

/// A viewer that may come in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Admitted {
    pub(crate) protocol: &'static str,
    /// Its address has the token.
    pub(crate) controls: bool,
}

/// The door of one server.
pub(crate) struct ViewerDoor {
    guard: HostGuard,
    pub(crate) token: Token,
}

impl ViewerDoor {
    /// Of a server that listens at `at`; `origins` are allowed beside those of the viewers.
    pub(crate) fn new(at: SocketAddr, origins: Vec<String>, token: Token) -> Self {
        let viewers = VIEWERS.map(str::to_owned);
        Self { guard: HostGuard::of_pages(at, origins.into_iter().chain(viewers).collect()), token }
    }

    /// Judges the request that would open a socket.
    pub(crate) fn judge(&self, request: &Head) -> Result<Admitted, ViewerRefusal> {
        let refuse = |reason, message| Err(ViewerRefusal { reason, message });
        if !request.only("host").is_some_and(|host| self.guard.is_host(host)) {
            return refuse(
                "foreign host",
                "this address does not name this server: open ws:// with the address it printed".to_owned(),
            );
        }
        let from = request.only("origin");
        if !request.all("origin").is_empty() && !from.is_some_and(|from| self.guard.is_origin(from)) {
            let from = from.unwrap_or("several origins");
            return refuse(
                "foreign origin",
                format!("pages of {from} may not come in: start with --allow-origin {from} if it is yours"),
            );
        }
        let offered: Vec<&str> = request
            .all("sec-websocket-protocol")
            .into_iter()
            .flat_map(|value| value.split(','))
            .map(str::trim)
            .collect();
        let Some(protocol) = SUBPROTOCOLS.into_iter().find(|known| offered.contains(known)) else {
            let known = SUBPROTOCOLS.join(", ");
            let offered = if offered.is_empty() { "none".to_owned() } else { offered.join(", ") };
            return refuse(
                "another subprotocol",
                format!("subprotocol {offered:.100}: this server speaks {known}; choose one of them"),
            );
        };
        let presented = request.query.split('&').find_map(|pair| pair.strip_prefix("token="));
        if presented.is_some_and(|token| !self.token.is(token)) {
            return refuse(
                "wrong token",
                "the token in the address is not the one that this server printed at its start".to_owned(),
            );
        }
        Ok(Admitted { protocol, controls: presented.is_some() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn door() -> ViewerDoor {
        let origins = vec!["https://mine.example".to_owned()];
        ViewerDoor::new("127.0.0.1:8765".parse().unwrap(), origins, Token::random().unwrap())
    }

    fn asked(headers: &[(&str, &str)], path: &str) -> Head {
        let headers: String = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        Head::read(&mut format!("GET {path} HTTP/1.1\r\n{headers}\r\n").as_bytes()).unwrap()
    }

    const HOST: (&str, &str) = ("host", "localhost:8765");

    #[test]
    fn each_of_the_three_subprotocols_is_taken_and_others_get_a_sentence() {
        for protocol in SUBPROTOCOLS {
            let request = asked(&[HOST, ("sec-websocket-protocol", &format!("x.y, {protocol}"))], "/");
            assert_eq!(door().judge(&request), Ok(Admitted { protocol, controls: false }));
        }
        let both = asked(&[HOST, ("sec-websocket-protocol", "foxglove.websocket.v1,foxglove.sdk.v1")], "/");
        assert_eq!(door().judge(&both).unwrap().protocol, "foxglove.sdk.v1");
        for headers in [&[HOST][..], &[HOST, ("sec-websocket-protocol", "foxglove.sdk.v2")]] {
            let refused = door().judge(&asked(headers, "/")).unwrap_err();
            assert_eq!(refused.reason, "another subprotocol");
            assert!(refused.message.contains("foxglove.websocket.v1"), "{refused:?}");
        }
    }

    #[test]
    fn only_this_machine_and_pages_of_viewers_come_in_and_a_wrong_token_does_not() {
        let (door, protocol) = (door(), ("sec-websocket-protocol", SUBPROTOCOLS[0]));
        let reason = |headers: &[(&str, &str)], path: &str| {
            door.judge(&asked(&[headers, &[protocol]].concat(), path)).map_err(|refused| refused.reason)
        };
        assert!(reason(&[HOST], "/").is_ok());
        assert_eq!(reason(&[("host", "evil.example:8765")], "/"), Err("foreign host"));
        assert_eq!(reason(&[HOST, HOST], "/"), Err("foreign host"), "two of them");
        for origin in ["https://app.foxglove.dev", "file://", "http://localhost:8080", "https://mine.example"]
        {
            assert!(reason(&[HOST, ("origin", origin)], "/").is_ok(), "{origin}");
        }
        for origin in ["null", "", "https://evil.example"] {
            assert_eq!(reason(&[HOST, ("origin", origin)], "/"), Err("foreign origin"), "{origin}");
        }
        let token = door.token.text();
        assert!(reason(&[HOST], &format!("/?x=1&token={token}")).unwrap().controls);
        for wrong in ["", &token[1..], &format!("{token}0")] {
            assert_eq!(reason(&[HOST], &format!("/?token={wrong}")), Err("wrong token"), "{wrong}");
        }
    }
}
