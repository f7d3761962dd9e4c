//! Who may come in: the token, and the hosts and origins that are this console's own.
//!
//! Contract: pure but for the making of a token. A token that works once gives its page a key of its own, so
//! that an address that somebody else has seen since then opens nothing. A page of another site that the
//! browser is made to open has another origin, and a name that was made to point here has another host: both
//! are refused.

use std::io::{self, Read};
use std::net::SocketAddr;

/// Bytes of a token.
const TOKEN_BYTES: usize = 16;

/// What a page has to say before it may control anything. Made anew at each start.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Token(String);

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
    pub(crate) fn random() -> io::Result<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// Its text, for the address that is printed.
    #[must_use]
    pub(crate) fn text(&self) -> &str {
        &self.0
    }

    /// Whether `said` is it; takes as long whatever differs.
    pub(crate) fn is(&self, said: &str) -> bool {
        let differs = self.0.bytes().zip(said.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        self.0.len() == said.len() && differs == 0
    }
}

/// What opens the control: the token in the printed address, and the key that a page got for it.
#[derive(Debug)]
pub(crate) struct Keys {
    token: Token,
    /// The token works once; `None`: as often as it is said.
    once: Option<Once>,
}

#[derive(Debug, Default)]
struct Once {
    used: bool,
    key: Option<Token>,
}

/// What was said to get the control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Said {
    /// It opens.
    Right,
    /// It opens, this once.
    RightOnce,
    Wrong,
    /// It was right, and has been used.
    Used,
}

impl Keys {
    pub(crate) fn new(token: Token, once: bool) -> Self {
        Self { token, once: once.then(Once::default) }
    }

    /// The token's text, for the address that is printed.
    pub(crate) fn text(&self) -> &str {
        self.token.text()
    }

    /// Judges what a page says.
    pub(crate) fn judge(&self, said: &str) -> Said {
        let token = self.token.is(said);
        match &self.once {
            None if token => Said::Right,
            Some(once) if token => {
                if once.used {
                    Said::Used
                } else {
                    Said::RightOnce
                }
            }
            Some(Once { key: Some(key), .. }) if key.is(said) => Said::Right,
            _ => Said::Wrong,
        }
    }

    /// The token has been used: from here on only the key opens, which takes the place of any before it.
    pub(crate) fn use_up(&mut self, key: Token) {
        if let Some(once) = &mut self.once {
            *once = Once { used: true, key: Some(key) };
        }
    }

    /// A token that works once more; the key of a page stays until that is used.
    pub(crate) fn renew(&mut self, token: Token) {
        self.token = token;
        if let Some(once) = &mut self.once {
            once.used = false;
        }
    }
}

/// The names under which this console may be asked for.
#[derive(Debug, Clone)]
pub(crate) struct Hosts {
    scheme: &'static str,
    known: Vec<String>,
}

impl Hosts {
    /// Of a console on the loopback addresses, at `port`.
    pub(crate) fn local(port: u16) -> Self {
        Self {
            scheme: "http://",
            known: ["127.0.0.1", "localhost"].map(|host| format!("{host}:{port}")).to_vec(),
        }
    }

    /// Of a console under TLS at these addresses and these names of this machine.
    pub(crate) fn secure(at: &[SocketAddr], names: &[String]) -> Self {
        let port = at.first().map_or(0, SocketAddr::port);
        let named = names.iter().map(|name| format!("{name}:{port}"));
        let mut known: Vec<String> = at.iter().map(ToString::to_string).chain(named).collect();
        if port == 443 {
            // Browsers leave the usual port out.
            let without: Vec<String> =
                known.iter().filter_map(|host| host.strip_suffix(":443")).map(str::to_owned).collect();
            known.extend(without);
        }
        Self { scheme: "https://", known }
    }

    /// The `Host` of a request.
    pub(crate) fn knows(&self, host: &str) -> bool {
        self.known.iter().any(|known| known.eq_ignore_ascii_case(host))
    }

    /// The `Origin` of a page that opens a socket.
    pub(crate) fn own(&self, origin: &str) -> bool {
        origin.strip_prefix(self.scheme).is_some_and(|host| self.knows(host))
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
        let hosts = Hosts::local(8420);
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

    #[test]
    fn under_tls_only_the_addresses_and_names_that_it_was_started_on_are_its_own() {
        let at = ["127.0.0.1:8420", "192.0.2.2:8420", "[fd00::2]:8420"].map(|at| at.parse().unwrap());
        let hosts = Hosts::secure(&at, &["localhost".to_owned(), "desk".to_owned()]);
        for host in ["192.0.2.2:8420", "[fd00::2]:8420", "Desk:8420", "localhost:8420"] {
            assert!(hosts.knows(host) && hosts.own(&format!("https://{host}")), "{host}");
            assert!(!hosts.own(&format!("http://{host}")), "{host}");
        }
        for host in ["192.0.2.3:8420", "192.0.2.2", "desk", "desk.evil.example:8420"] {
            assert!(!hosts.knows(host) && !hosts.own(&format!("https://{host}")), "{host}");
        }
        assert!(Hosts::secure(&["192.0.2.2:443".parse().unwrap()], &[]).knows("192.0.2.2"));
    }

    #[test]
    fn a_token_that_works_once_gives_a_key_and_a_new_token_takes_its_place_when_it_is_used() {
        let token = || Token::random().unwrap();
        let (first, key, second, other) = (token(), token(), token(), token());
        let mut always = Keys::new(first.clone(), false);
        always.use_up(key.clone());
        assert_eq!((always.judge(first.text()), always.judge(key.text())), (Said::Right, Said::Wrong));
        let mut keys = Keys::new(first.clone(), true);
        assert_eq!((keys.judge(first.text()), keys.judge(key.text())), (Said::RightOnce, Said::Wrong));
        keys.use_up(key.clone());
        assert_eq!((keys.judge(first.text()), keys.judge(key.text())), (Said::Used, Said::Right));
        keys.renew(second.clone());
        let judged = [&first, &key, &second].map(|said| keys.judge(said.text()));
        assert_eq!(judged, [Said::Wrong, Said::Right, Said::RightOnce]);
        keys.use_up(other.clone());
        let judged = [&key, &second, &other].map(|said| keys.judge(said.text()));
        assert_eq!(judged, [Said::Wrong, Said::Used, Said::Right]);
    }
}
