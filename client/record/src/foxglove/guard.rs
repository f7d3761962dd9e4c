//! Who may come in: hosts, origins, subprotocols, and the token.
//!
//! Contract: pure but for the making of a token. A page of a foreign site that a browser is made to open has
//! another origin, and a name that was made to point here has another host: both are refused. Viewers that
//! are no browsers send no origin.

use std::io::{self, Read as _};
use std::net::{IpAddr, SocketAddr};

use tungstenite::handshake::server::Request;

/// Bytes of a token.
const TOKEN_BYTES: usize = 16;
/// The subprotocols in use, the preferred one first. The messages of all three are the same: those of
/// `foxglove.websocket.v1`.
pub(crate) const SUBPROTOCOLS: [&str; 3] = ["foxglove.sdk.v1", "foxglove.websocket.v1", "foxglove.sdk.v1.1"];
/// Origins of the viewers' own: Foxglove's page, and programs made of a page.
const VIEWERS: [&str; 2] = ["https://app.foxglove.dev", "file://"];

/// What a viewer says before it may arm or set anything. Made anew at each start.
#[derive(Clone)]
pub(crate) struct Token(String);

impl Token {
    /// A token of 128 random bits.
    pub(crate) fn random() -> io::Result<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    pub(crate) fn text(&self) -> &str {
        &self.0
    }

    /// Whether `said` is it; takes as long whatever differs.
    pub(crate) fn is(&self, said: &str) -> bool {
        let differs = self.0.bytes().zip(said.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        self.0.len() == said.len() && differs == 0
    }
}

/// Why a connection is refused: a word for the count, and a sentence for the viewer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Refusal {
    pub(crate) reason: &'static str,
    pub(crate) words: String,
}

/// A viewer that may come in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Admitted {
    pub(crate) protocol: &'static str,
    /// Its address has the token.
    pub(crate) controls: bool,
}

/// The door of one server.
pub(crate) struct Door {
    at: SocketAddr,
    origins: Vec<String>,
    pub(crate) token: Token,
}

impl Door {
    /// Of a server that listens at `at`; `origins` are allowed beside those of the viewers.
    pub(crate) const fn new(at: SocketAddr, origins: Vec<String>, token: Token) -> Self {
        Self { at, origins, token }
    }

    /// Judges the request that would open a socket.
    pub(crate) fn judge(&self, request: &Request) -> Result<Admitted, Refusal> {
        let only = |name: &str| {
            let mut found = request.headers().get_all(name).iter();
            match (found.next().and_then(|value| value.to_str().ok()), found.next()) {
                (Some(value), None) => Some(value),
                _ => None,
            }
        };
        let refuse = |reason, words| Err(Refusal { reason, words });
        if !only("host").is_some_and(|host| self.knows(host)) {
            return refuse(
                "foreign host",
                "this address does not name this server: open ws:// with the address it printed".to_owned(),
            );
        }
        if request.headers().contains_key("origin") && !only("origin").is_some_and(|from| self.own(from)) {
            let from = only("origin").unwrap_or("several origins");
            return refuse(
                "foreign origin",
                format!("pages of {from} may not come in: start with --allow-origin {from} if it is yours"),
            );
        }
        let offered: Vec<&str> = request
            .headers()
            .get_all("sec-websocket-protocol")
            .iter()
            .filter_map(|value| value.to_str().ok())
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
        let query = request.uri().query().unwrap_or_default();
        let said = query.split('&').find_map(|pair| pair.strip_prefix("token="));
        if said.is_some_and(|said| !self.token.is(said)) {
            return refuse(
                "wrong token",
                "the token in the address is not the one that this server printed at its start".to_owned(),
            );
        }
        Ok(Admitted { protocol, controls: said.is_some() })
    }

    /// Whether `host` of a request is this machine. Names other than localhost may be made to point here.
    fn knows(&self, host: &str) -> bool {
        let (name, port) =
            host.rsplit_once(':').map_or((host, Some(80)), |(name, port)| (name, port.parse().ok()));
        if port != Some(self.at.port()) {
            return false;
        }
        let address: Option<IpAddr> = name.trim_start_matches('[').trim_end_matches(']').parse().ok();
        match address {
            Some(address) => address.is_loopback() || !self.at.ip().is_loopback(),
            None => name.eq_ignore_ascii_case("localhost"),
        }
    }

    /// Whether pages of `origin` may come in.
    fn own(&self, origin: &str) -> bool {
        let listed = VIEWERS.contains(&origin) || self.origins.iter().any(|known| known == origin);
        let here = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
        let host = here.map(|host| host.split(':').next().unwrap_or_default());
        listed || host.is_some_and(|host| host == "localhost" || host == "127.0.0.1")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn door() -> Door {
        Door::new("127.0.0.1:8765".parse().unwrap(), vec!["https://mine.example".into()], Token("ab".into()))
    }

    fn asked(headers: &[(&str, &str)], path: &str) -> Request {
        let mut request = tungstenite::http::Request::builder().uri(path);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        request.body(()).unwrap()
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
            assert!(refused.words.contains("foxglove.websocket.v1"), "{refused:?}");
        }
    }

    #[test]
    fn only_this_machine_and_pages_of_viewers_come_in_and_a_wrong_token_does_not() {
        let protocol = ("sec-websocket-protocol", SUBPROTOCOLS[0]);
        let reason = |headers: &[(&str, &str)], path: &str| {
            door().judge(&asked(&[headers, &[protocol]].concat(), path)).map_err(|refused| refused.reason)
        };
        for host in ["127.0.0.1:8765", "LOCALHOST:8765", "[::1]:8765"] {
            assert!(reason(&[("host", host)], "/").is_ok(), "{host}");
        }
        for host in
            ["", "localhost", "localhost:80", "evil.example:8765", "127.0.0.1.evil:8765", "10.0.0.1:8765"]
        {
            assert_eq!(reason(&[("host", host)], "/"), Err("foreign host"), "{host}");
        }
        for origin in ["https://app.foxglove.dev", "file://", "http://localhost:8080", "https://mine.example"]
        {
            assert!(reason(&[HOST, ("origin", origin)], "/").is_ok(), "{origin}");
        }
        for origin in
            ["null", "", "https://evil.example", "http://localhost.evil.example", "http://127.0.0.10"]
        {
            assert_eq!(reason(&[HOST, ("origin", origin)], "/"), Err("foreign origin"), "{origin}");
        }
        assert!(reason(&[HOST], "/?x=1&token=ab").unwrap().controls);
        for wrong in ["/?token=", "/?token=a", "/?token=abc", "/?token=AB"] {
            assert_eq!(reason(&[HOST], wrong), Err("wrong token"), "{wrong}");
        }
        // Asked for on another address than loopback, every literal address may be this machine's.
        let open = Door::new("0.0.0.0:8765".parse().unwrap(), Vec::new(), Token("ab".into()));
        assert!(open.knows("192.0.2.7:8765") && !open.knows("evil.example:8765"));
    }
}
