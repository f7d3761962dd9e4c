//! Who may come in: the token, and the hosts and origins that are this console's own.
//!
//! Contract: pure but for the making of a token. A page of another site that the browser is made to open has
//! another origin, and a name that was made to point here has another host: both are refused.

use std::io::{self, Read};
use std::net::SocketAddr;

/// Bytes of a token.
const TOKEN_BYTES: usize = 16;

/// What a page has to say before it may control anything. Made anew at each start.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(..)")
    }
}

impl Token {
    /// A token of 128 random bits.
    ///
    /// # Errors
    ///
    /// The system gives no random numbers.
    pub fn random() -> io::Result<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// Its text, for the address that is printed.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether `said` is it; takes as long whatever differs.
    pub(crate) fn is(&self, said: &str) -> bool {
        let differs = self.0.bytes().zip(said.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        self.0.len() == said.len() && differs == 0
    }
}

/// The names under which this console may be asked for.
#[derive(Debug, Clone)]
pub(crate) struct Hosts(Vec<String>);

impl Hosts {
    /// Of a console on the loopback address `at`.
    pub(crate) fn of(at: SocketAddr) -> Self {
        let port = at.port();
        Self(["127.0.0.1", "localhost"].map(|host| format!("{host}:{port}")).to_vec())
    }

    /// The `Host` of a request.
    pub(crate) fn knows(&self, host: &str) -> bool {
        self.0.iter().any(|known| known.eq_ignore_ascii_case(host))
    }

    /// The `Origin` of a page that opens a socket.
    pub(crate) fn own(&self, origin: &str) -> bool {
        origin.strip_prefix("http://").is_some_and(|host| self.knows(host))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_differ_and_only_the_whole_one_is_it() {
        let (one, two) = (Token::random().unwrap(), Token::random().unwrap());
        assert_ne!(one, two);
        assert_eq!(one.text().len(), 2 * TOKEN_BYTES);
        assert!(one.is(one.text()));
        for wrong in ["", &one.text()[1..], &format!("{}0", one.text()), two.text()] {
            assert!(!one.is(wrong), "{wrong}");
        }
        assert!(!format!("{one:?}").contains(one.text()));
    }

    #[test]
    fn only_names_of_this_machine_with_this_port_are_its_own() {
        let hosts = Hosts::of("127.0.0.1:8420".parse().unwrap());
        for host in ["127.0.0.1:8420", "localhost:8420", "LOCALHOST:8420"] {
            assert!(hosts.knows(host) && hosts.own(&format!("http://{host}")), "{host}");
        }
        for host in [
            "",
            "localhost",
            "localhost:80",
            "[::1]:8420",
            "evil.example:8420",
            "127.0.0.1:8420.evil",
            "127.0.0.2:8420",
        ] {
            assert!(!hosts.knows(host) && !hosts.own(&format!("http://{host}")), "{host}");
        }
        for origin in ["", "null", "https://localhost:8420", "http://localhost:8420/", "file://"] {
            assert!(!hosts.own(origin), "{origin}");
        }
    }
}
