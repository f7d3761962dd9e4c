//! The head of a request, and answers: as much of HTTP/1.1 as scrapes, pages of a few files and the start of
//! a WebSocket need.
//!
//! Contract: a head has a bounded size and has to come within a bounded time; what is malformed gives an
//! error and is never guessed at. Answers close the connection. Source: RFC 9112; RFC 6455, section 4.2.

use std::io::{self, Read, Write};
use std::time::{Duration, Instant};

use crate::peers::Slot;

/// Largest head \[bytes\].
const HEAD_BYTES: usize = 8192;
/// Most headers of a request; browsers send about twenty.
const MOST_HEADERS: usize = 64;
/// Longest time for a head, from the first look at the connection to its last byte.
pub const HEAD_TIME: Duration = Duration::from_secs(3);

/// Headers that every answer carries. A page may run its own scripts and talk to its own server only; it is
/// isolated from other pages, which also makes the browser's clock finer.
const HEADERS: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
                       connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; \
                       frame-ancestors 'none'\r\nCross-Origin-Opener-Policy: \
                       same-origin\r\nCross-Origin-Embedder-Policy: require-corp\r\n\
                       Cross-Origin-Resource-Policy: same-origin\r\nX-Content-Type-Options: \
                       nosniff\r\nReferrer-Policy: no-referrer\r\nCache-Control: no-store\r\n";

/// The content type of plain text.
pub const TEXT: &str = "text/plain; charset=utf-8";

/// The head of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Head {
    /// Such as `GET`.
    pub method: String,
    /// The target without its query.
    pub path: String,
    /// What follows the question mark.
    pub query: String,
    /// 0 or 1, of HTTP/1.
    pub minor_version: u8,
    /// Names in lower case.
    headers: Vec<(String, String)>,
}

/// Why a request has no head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoHead {
    /// The connection ended before it was whole.
    Incomplete,
    /// It was not whole after [`HEAD_TIME`].
    TooSlow,
    /// It is larger than 8192 bytes, or has more than 64 headers.
    TooLong,
    /// It is not HTTP/1, or something follows it.
    Malformed,
}

impl NoHead {
    /// The reason as words to count by.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Incomplete => "incomplete request",
            Self::TooSlow => "request too slow",
            Self::TooLong => "request too long",
            Self::Malformed => "malformed request",
        }
    }
}

impl Head {
    /// Reads a head. The stream has a read timeout, which bounds how late [`HEAD_TIME`] is noticed.
    ///
    /// # Errors
    ///
    /// See [`NoHead`].
    pub fn read(stream: &mut impl Read) -> Result<Self, NoHead> {
        let (begin, mut bytes, mut chunk) = (Instant::now(), Vec::new(), [0; 1024]);
        loop {
            let count = match stream.read(&mut chunk) {
                Ok(0) => return Err(NoHead::Incomplete),
                Ok(count) => count,
                Err(error) if waits(&error) => 0,
                Err(_) => return Err(NoHead::Incomplete),
            };
            bytes.extend_from_slice(chunk.get(..count).unwrap_or_default());
            if let Some(head) = Self::parse(&bytes)? {
                return Ok(head);
            }
            if bytes.len() > HEAD_BYTES {
                return Err(NoHead::TooLong);
            }
            if begin.elapsed() > HEAD_TIME {
                return Err(NoHead::TooSlow);
            }
        }
    }

    /// Reads what the peer in `slot` asks for, which keeps its slot from then on.
    ///
    /// # Errors
    ///
    /// The status of the answer, and why it gets no other one, in words to count by.
    pub fn asked(stream: &mut impl Read, slot: &Slot) -> Result<Self, (&'static str, &'static str)> {
        let head = Self::read(stream).map_err(|error| ("400 Bad Request", error.label()))?;
        slot.asked().map_err(|reason| ("503 Service Unavailable", reason))?;
        Ok(head)
    }

    /// `None`: it is not whole yet.
    fn parse(bytes: &[u8]) -> Result<Option<Self>, NoHead> {
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        let mut request = httparse::Request::new(&mut headers);
        match request.parse(bytes) {
            // A client sends nothing behind the head before it was answered, but for the body of a method
            // that has one: that is refused by its name.
            Ok(httparse::Status::Complete(end)) if end == bytes.len() || has_body(&request) => {}
            Ok(httparse::Status::Partial) => return Ok(None),
            Err(httparse::Error::TooManyHeaders) => return Err(NoHead::TooLong),
            _ => return Err(NoHead::Malformed),
        }
        let (Some(method), Some(target), Some(minor_version)) =
            (request.method, request.path, request.version)
        else {
            return Err(NoHead::Malformed);
        };
        let named = |header: &httparse::Header<'_>| {
            let value = std::str::from_utf8(header.value).map_err(|_| NoHead::Malformed)?;
            Ok((header.name.to_ascii_lowercase(), value.trim().to_owned()))
        };
        let headers = request.headers.iter().map(named).collect::<Result<_, _>>()?;
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let (method, path, query) = (method.to_owned(), path.to_owned(), query.to_owned());
        Ok(Some(Self { method, path, query, minor_version, headers }))
    }

    /// The values of every header of this name, in lower case.
    #[must_use]
    pub fn all(&self, name: &str) -> Vec<&str> {
        self.headers.iter().filter(|(known, _)| known == name).map(|(_, value)| value.as_str()).collect()
    }

    /// The only header of this name; none where it is missing or doubled.
    #[must_use]
    pub fn only(&self, name: &str) -> Option<&str> {
        match self.all(name)[..] {
            [value] => Some(value),
            _ => None,
        }
    }

    /// Whether the only header of this name lists `word`.
    fn lists(&self, name: &str, word: &str) -> bool {
        self.only(name).is_some_and(|value| value.split(',').any(|one| one.trim().eq_ignore_ascii_case(word)))
    }

    /// The key of a request that wants to become a WebSocket of version 13. Source: RFC 6455, 4.2.1.
    #[must_use]
    pub fn socket_key(&self) -> Option<&str> {
        let wants = self.minor_version == 1
            && self.method == "GET"
            && self.lists("connection", "upgrade")
            && self.lists("upgrade", "websocket")
            && self.only("sec-websocket-version") == Some("13");
        self.only("sec-websocket-key").filter(|key| wants && key.len() == 24)
    }
}

/// Whether a body may follow this head: neither `GET` nor `HEAD`, and a header announces one.
fn has_body(request: &httparse::Request<'_, '_>) -> bool {
    let announces = |name: &str| {
        ["content-length", "transfer-encoding"].iter().any(|wanted| name.eq_ignore_ascii_case(wanted))
    };
    !matches!(request.method, Some("GET" | "HEAD"))
        && request.headers.iter().any(|header| announces(header.name))
}

/// Answers with `body` and ends the connection. A peer that takes it byte by byte has `most` for all of it.
///
/// # Errors
///
/// The peer is gone, or too slow (`TimedOut`, `WouldBlock`).
pub fn answer(
    stream: &mut impl Write,
    status: &str,
    kind: &str,
    body: &[u8],
    most: Duration,
) -> io::Result<()> {
    // In one piece: some clients read no further than that.
    put(stream, &[&answer_head(status, kind, body.len()), body].concat(), most)
}

/// Answers a `HEAD` request: as [`answer`], without the body.
///
/// # Errors
///
/// As [`answer`].
pub fn answer_without_body(
    stream: &mut impl Write,
    status: &str,
    kind: &str,
    length: usize,
    most: Duration,
) -> io::Result<()> {
    put(stream, &answer_head(status, kind, length), most)
}

/// Refuses a method where only those in `allowed` are known, such as `GET, HEAD`, with `words`; then hears
/// the rest of a body for a moment, which would otherwise cut the answer off. Source: RFC 9110, 15.5.6.
///
/// # Errors
///
/// As [`answer`].
pub fn not_allowed(
    stream: &mut (impl Read + Write),
    allowed: &str,
    words: &str,
    most: Duration,
) -> io::Result<()> {
    const HEARD: u64 = 1 << 20;
    let status = format!("405 Method Not Allowed\r\nAllow: {allowed}");
    answer(stream, &status, TEXT, format!("{words}\n").as_bytes(), most)?;
    let (begin, mut heard, mut body) = (Instant::now(), 0, [0; 4096]);
    while heard < HEARD && begin.elapsed() < most.min(HEAD_TIME) {
        match stream.read(&mut body) {
            Ok(count @ 1..) => heard += count as u64,
            // It ended, or nothing more comes for now.
            _ => break,
        }
    }
    Ok(())
}

fn answer_head(status: &str, kind: &str, length: usize) -> Vec<u8> {
    let head = format!("Content-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n{HEADERS}");
    format!("HTTP/1.1 {status}\r\n{head}\r\n").into_bytes()
}

/// Writes all of `bytes`, unless that takes longer than `most`.
fn put(stream: &mut impl Write, mut bytes: &[u8], most: Duration) -> io::Result<()> {
    let begin = Instant::now();
    while !bytes.is_empty() {
        if begin.elapsed() > most {
            return Err(io::ErrorKind::TimedOut.into());
        }
        match stream.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    stream.flush()
}

/// Answers with the words of a refusal; the other side need not read them.
pub fn refuse(stream: &mut impl Write, status: &str, words: &str, most: Duration) {
    let _ = answer(stream, status, TEXT, format!("{words}\n").as_bytes(), most);
}

/// Turns the connection into a WebSocket, of a subprotocol where one was chosen.
///
/// # Errors
///
/// The peer is gone.
pub fn upgrade(stream: &mut impl Write, key: &str, protocol: Option<&str>) -> io::Result<()> {
    let accept = tungstenite::handshake::derive_accept_key(key.as_bytes());
    let protocol = protocol.map_or_else(String::new, |name| format!("Sec-WebSocket-Protocol: {name}\r\n"));
    let head = format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: \
         Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n{protocol}\r\n"
    );
    stream.write_all(head.as_bytes())?;
    stream.flush()
}

/// Whether `error` only says that there is nothing to be done now.
#[must_use]
pub fn waits(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Head, NoHead> {
        Head::read(&mut text.as_bytes())
    }

    #[test]
    fn a_request_is_read_and_its_socket_key_only_where_all_of_it_is_right() {
        let head = read("GET /app.js?x=1 HTTP/1.1\r\nHost: localhost:1\r\n\r\n").unwrap();
        let line = (head.method.as_str(), head.path.as_str(), head.query.as_str());
        assert_eq!(line, ("GET", "/app.js", "x=1"));
        assert_eq!(
            (head.only("host"), head.only("origin"), head.socket_key()),
            (Some("localhost:1"), None, None)
        );
        let whole = "GET /socket HTTP/1.1\r\nConnection: keep-alive, Upgrade\r\nUpgrade: \
                     websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: \
                     dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
        assert_eq!(read(whole).unwrap().socket_key(), Some("dGhlIHNhbXBsZSBub25jZQ=="));
        for (part, wrong) in [
            ("Version: 13", "Version: x"),
            ("websocket\r", "x\r"),
            ("keep-alive, Upgrade", "x"),
            ("dGhl", "x"),
            ("GET", "PUT"),
            ("HTTP/1.1", "HTTP/1.0"),
        ] {
            assert_eq!(read(&whole.replace(part, wrong)).unwrap().socket_key(), None, "{part}");
        }
        let mut out = Vec::new();
        upgrade(&mut out, "dGhlIHNhbXBsZSBub25jZQ==", Some("a.b")).unwrap();
        // The example of RFC 6455, 1.3.
        let text = String::from_utf8(out).unwrap();
        assert!(
            text.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\nSec-WebSocket-Protocol: a.b\r\n\r\n"),
            "{text}"
        );
    }

    #[test]
    fn what_is_malformed_too_long_or_cut_is_refused() {
        let posted = "POST / HTTP/1.1\r\nContent-Length: 2\r\n\r\nhi";
        assert_eq!(read(posted).map(|head| head.method), Ok("POST".to_owned()));
        for wrong in [
            "GET / HTTP/1.1\r\nContent-Length: 2\r\n\r\nhi",
            "POST / HTTP/1.1\r\n\r\nhi",
            "\u{ff}\r\n\r\n",
            "GET / HTTP/2.0\r\n\r\n",
            "GET / SMTP/1.1\r\n\r\n",
            "GET  / HTTP/1.1\r\n\r\n",
            "GET / HTTP/1.1\r\nHost\r\n\r\n",
            "GET / HTTP/1.1\r\n: x\r\n\r\n",
            "GET / HTTP/1.1\r\nA b: x\r\n\r\n",
            "GET / HTTP/1.1\r\nA: x\r\n folded\r\n\r\n",
            "GET / HTTP/1.1\r\n\r\nGET / HTTP/1.1\r\n\r\n",
        ] {
            assert_eq!(read(wrong), Err(NoHead::Malformed), "{wrong:?}");
        }
        assert_eq!(read("GET / HTTP/1.1\r\nHost: x"), Err(NoHead::Incomplete));
        assert_eq!(read(&format!("GET / HTTP/1.1\r\nA: {}", "x".repeat(20_000))), Err(NoHead::TooLong));
        let many = "A: x\r\n".repeat(MOST_HEADERS + 1);
        assert_eq!(read(&format!("GET / HTTP/1.1\r\n{many}\r\n")), Err(NoHead::TooLong));
        let doubled = read("GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n").unwrap();
        assert_eq!((doubled.only("host"), doubled.all("host").len()), (None, 2));
    }

    /// One byte per millisecond, both ways.
    struct Slow(usize);

    impl Read for Slow {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            std::thread::sleep(Duration::from_millis(1));
            self.0 += 1;
            into[0] = *b"GET / HTTP/1.1\r\nA: ".get(self.0 - 1).unwrap_or(&b'x');
            Ok(1)
        }
    }

    impl Write for Slow {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            std::thread::sleep(Duration::from_millis(1));
            Ok(1)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn bytes_that_drip_prolong_neither_a_head_nor_an_answer() {
        assert_eq!(Head::read(&mut Slow(0)), Err(NoHead::TooSlow));
        let most = Duration::from_millis(100);
        let ended = answer(&mut Slow(0), "200 OK", TEXT, &[0; 100_000], most).unwrap_err();
        assert_eq!(ended.kind(), io::ErrorKind::TimedOut);
        assert!(put(&mut Slow(0), &[0; 3], most).is_ok());
    }

    #[test]
    fn every_answer_isolates_the_page_and_one_to_head_has_no_body() {
        let mut out = Vec::new();
        answer(&mut out, "200 OK", "text/html", b"hi", HEAD_TIME).unwrap();
        let text = String::from_utf8(out).unwrap();
        for wanted in
            ["default-src 'none'", "Opener-Policy: same-origin", "Embedder-Policy: require-corp", "Length: 2"]
        {
            assert!(text.contains(wanted), "{wanted} missing in {text}");
        }
        let mut head = Vec::new();
        answer_without_body(&mut head, "200 OK", "text/html", 2, HEAD_TIME).unwrap();
        assert_eq!(format!("{}hi", String::from_utf8(head).unwrap()), text);
    }
}
