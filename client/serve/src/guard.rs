//! Who may come in: the token, and the hosts and origins that are a server's own.
//!
//! Contract: pure but for the making of a token. A page of another site that the browser is made to open has
//! another origin, and a name that was made to point here has another host: both are refused. Programs that
//! are not browsers send no origin.

use std::io::{self, Read};
use std::net::{IpAddr, SocketAddr};

/// Bytes of a token.
const TOKEN_BYTES: usize = 16;

/// What a peer has to present before it may control anything. Another one at each start.
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

    /// Its text: 32 hexadecimal digits, for the address that is printed.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether `presented` is it; takes as long whatever differs.
    #[must_use]
    pub fn is(&self, presented: &str) -> bool {
        let differs = self.0.bytes().zip(presented.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        self.0.len() == presented.len() && differs == 0
    }
}

/// Literal addresses that are hosts.
#[derive(Debug, Clone, Copy)]
struct Literal {
    port: u16,
    /// Only those of loopback.
    loopback: bool,
}

/// The hosts under which a server may be asked for, and the origins of the pages that may talk to it.
#[derive(Debug, Clone)]
pub struct HostGuard {
    scheme: &'static str,
    hosts: Vec<String>,
    /// Literal addresses with this port are hosts too.
    literal: Option<Literal>,
    /// Beside pages of the server's own hosts.
    origins: Vec<String>,
    /// Pages of this machine at any port may talk to it.
    local_pages: bool,
}

impl HostGuard {
    /// Of a server in the clear on the loopback address, at `port`.
    #[must_use]
    pub fn local(port: u16) -> Self {
        Self::of("http://", ["127.0.0.1", "localhost"].map(|host| format!("{host}:{port}")).to_vec())
    }

    /// Of a server under TLS at these addresses and these names of this machine.
    #[must_use]
    pub fn secure(at: &[SocketAddr], names: &[String]) -> Self {
        let port = at.first().map_or(0, SocketAddr::port);
        let named = names.iter().map(|name| format!("{name}:{port}"));
        let hosts = at.iter().map(ToString::to_string).chain(named).collect();
        Self::of("https://", also_without(":443", hosts))
    }

    /// Of a server in the clear that listens at `at`, for pages of this machine and of `origins`. Where `at`
    /// is not loopback, any literal address may be this machine's; names other than localhost may be made to
    /// point here, and are refused.
    #[must_use]
    pub fn of_pages(at: SocketAddr, origins: Vec<String>) -> Self {
        let port = at.port();
        let hosts = also_without(":80", vec![format!("localhost:{port}")]);
        let literal = Some(Literal { port, loopback: at.ip().is_loopback() });
        Self { literal, origins, local_pages: true, ..Self::of("http://", hosts) }
    }

    /// Of `hosts` alone, and of pages of theirs.
    const fn of(scheme: &'static str, hosts: Vec<String>) -> Self {
        Self { scheme, hosts, literal: None, origins: Vec::new(), local_pages: false }
    }

    /// Whether the `Host` of a request is this server's.
    #[must_use]
    pub fn is_host(&self, host: &str) -> bool {
        self.is_listed(host)
            || self.literal.is_some_and(|literal| {
                let bracketed = host.strip_prefix('[').and_then(|rest| rest.split_once(']'));
                let colon = host.find(':').unwrap_or(host.len());
                let (name, port) = bracketed.unwrap_or_else(|| host.split_at(colon));
                let port = if port.is_empty() { Some("80") } else { port.strip_prefix(':') };
                port.and_then(|port| port.parse().ok()) == Some(literal.port)
                    && name.parse::<IpAddr>().is_ok_and(|at| at.is_loopback() || !literal.loopback)
            })
    }

    fn is_listed(&self, host: &str) -> bool {
        self.hosts.iter().any(|known| known.eq_ignore_ascii_case(host))
    }

    /// Whether pages of `origin` may talk to this server.
    #[must_use]
    pub fn is_origin(&self, origin: &str) -> bool {
        let own = origin.strip_prefix(self.scheme).is_some_and(|host| self.is_listed(host));
        let page = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
        let name = page.map(|host| host.split(':').next().unwrap_or_default());
        own || self.origins.iter().any(|known| known == origin)
            || self.local_pages && name.is_some_and(|name| name == "localhost" || name == "127.0.0.1")
    }
}

/// `hosts`, and those that name the usual port also without it: browsers leave it out.
fn also_without(usual: &str, mut hosts: Vec<String>) -> Vec<String> {
    let without: Vec<_> =
        hosts.iter().filter_map(|host| host.strip_suffix(usual)).map(str::to_owned).collect();
    hosts.extend(without);
    hosts
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
        assert_eq!(format!("{one:?}"), "Token(..)");
    }

    #[test]
    fn only_names_of_this_machine_with_this_port_are_its_own() {
        let guard = HostGuard::local(8420);
        for host in ["127.0.0.1:8420", "localhost:8420", "LOCALHOST:8420"] {
            assert!(guard.is_host(host) && guard.is_origin(&format!("http://{host}")), "{host}");
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
            assert!(!guard.is_host(host) && !guard.is_origin(&format!("http://{host}")), "{host}");
        }
        for origin in ["", "null", "https://localhost:8420", "http://localhost:8420/", "file://"] {
            assert!(!guard.is_origin(origin), "{origin}");
        }
    }

    #[test]
    fn under_tls_only_the_addresses_and_names_that_it_was_started_on_are_its_own() {
        let at = ["127.0.0.1:8420", "192.0.2.2:8420", "[fd00::2]:8420"].map(|at| at.parse().unwrap());
        let guard = HostGuard::secure(&at, &["localhost".to_owned(), "desk".to_owned()]);
        for host in ["192.0.2.2:8420", "[fd00::2]:8420", "Desk:8420", "localhost:8420"] {
            assert!(guard.is_host(host) && guard.is_origin(&format!("https://{host}")), "{host}");
            assert!(!guard.is_origin(&format!("http://{host}")), "{host}");
        }
        for host in ["192.0.2.3:8420", "192.0.2.2", "desk", "desk.evil.example:8420"] {
            assert!(!guard.is_host(host) && !guard.is_origin(&format!("https://{host}")), "{host}");
        }
        assert!(HostGuard::secure(&["192.0.2.2:443".parse().unwrap()], &[]).is_host("192.0.2.2"));
    }

    #[test]
    fn a_server_for_pages_knows_this_machine_only_and_lets_pages_of_it_and_of_a_list_talk() {
        let guard =
            HostGuard::of_pages("127.0.0.1:8765".parse().unwrap(), vec!["https://mine.example".to_owned()]);
        for host in ["127.0.0.1:8765", "LOCALHOST:8765", "[::1]:8765", "127.0.0.2:8765"] {
            assert!(guard.is_host(host), "{host}");
        }
        for host in
            ["", "localhost", "localhost:80", "evil.example:8765", "127.0.0.1.evil:8765", "10.0.0.1:8765"]
        {
            assert!(!guard.is_host(host), "{host}");
        }
        for origin in ["http://localhost:8080", "https://localhost", "https://mine.example"] {
            assert!(guard.is_origin(origin), "{origin}");
        }
        for origin in
            ["null", "", "https://evil.example", "http://localhost.evil.example", "http://127.0.0.10"]
        {
            assert!(!guard.is_origin(origin), "{origin}");
        }
        let open = HostGuard::of_pages("0.0.0.0:8765".parse().unwrap(), Vec::new());
        assert!(open.is_host("192.0.2.7:8765") && open.is_host("[fd00::2]:8765"));
        assert!(!open.is_host("evil.example:8765") && !open.is_host("192.0.2.7:80"));
        assert!(!open.is_origin("http://192.0.2.7:8765"), "any machine may have a page there");
    }

    #[test]
    fn letters_in_another_order_are_another_token() {
        // Both pairs differ by the same bits.
        assert!(!Token("ab".to_owned()).is("ba") && Token("ab".to_owned()).is("ab"));
        assert!(!Token("ab".to_owned()).is("aa") && !Token("ab".to_owned()).is("bb"));
    }

    #[test]
    fn the_usual_port_may_be_left_out_and_pages_of_this_machine_stand_at_any() {
        let guard = HostGuard::of_pages("127.0.0.1:80".parse().unwrap(), Vec::new());
        for host in ["127.0.0.1", "127.0.0.1:80", "localhost", "localhost:80", "[::1]"] {
            assert!(guard.is_host(host), "{host}");
        }
        for host in ["127.0.0.1:81", "localhost:81", "10.0.0.1", "10.0.0.1:80", ":80"] {
            assert!(!guard.is_host(host), "{host}");
        }
        for origin in ["http://127.0.0.1:3000", "https://127.0.0.1", "http://localhost:1"] {
            assert!(guard.is_origin(origin), "{origin}");
        }
        for origin in ["127.0.0.1", "ftp://127.0.0.1", "http://127.0.0.2", "http://", "http://:80"] {
            assert!(!guard.is_origin(origin), "{origin}");
        }
        // A server that knows no pages but its own lets no other one in, also of this machine.
        assert!(!HostGuard::local(8420).is_origin("http://127.0.0.1:3000"));
        assert!(!HostGuard::secure(&["192.0.2.2:443".parse().unwrap()], &[]).is_origin("https://localhost"));
    }
}
