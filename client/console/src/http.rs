//! The head of a request, and answers: as much of HTTP/1.1 as a page of a few files needs.
//!
//! Contract: a head has a bounded size and has to come within a bounded time; what is malformed gives an
//! error and is never guessed at. Answers close the connection.

use std::io::{self, Read, Write};
use std::time::{Duration, Instant};

/// Largest head [bytes].
const HEAD_BYTES: usize = 8192;
/// Longest time for it.
pub(crate) const HEAD_TIME: Duration = Duration::from_secs(3);
/// Longest time for an answer, so that a peer that takes it byte by byte keeps no place.
const ANSWER_TIME: Duration = Duration::from_secs(30);

/// Headers that every answer carries. The page may run its own scripts and talk to its own server only; it
/// is isolated from other pages, which also makes the browser's clock finer.
const HEADERS: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
                       connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; \
                       frame-ancestors 'none'\r\nCross-Origin-Opener-Policy: \
                       same-origin\r\nCross-Origin-Embedder-Policy: require-corp\r\n\
                       Cross-Origin-Resource-Policy: same-origin\r\nX-Content-Type-Options: \
                       nosniff\r\nReferrer-Policy: no-referrer\r\nCache-Control: no-store\r\n";

/// The head of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Head {
    pub(crate) method: String,
    /// Without what follows a question mark.
    pub(crate) path: String,
    /// Names in lower case.
    headers: Vec<(String, String)>,
}

/// Why a request has no head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NoHead {
    /// It did not come in time, or the connection ended.
    Incomplete,
    TooLong,
    Malformed,
}

impl NoHead {
    pub(crate) const fn label(self) -> &'static str {
        match self {
            Self::Incomplete => "incomplete request",
            Self::TooLong => "request too long",
            Self::Malformed => "malformed request",
        }
    }
}

impl Head {
    /// Reads it; the stream has a short read timeout.
    pub(crate) fn read(stream: &mut impl Read) -> Result<Self, NoHead> {
        let (begin, mut bytes, mut chunk) = (Instant::now(), Vec::new(), [0; 1024]);
        loop {
            let count = match stream.read(&mut chunk) {
                Ok(0) => return Err(NoHead::Incomplete),
                Ok(count) => count,
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                    0
                }
                Err(_) => return Err(NoHead::Incomplete),
            };
            bytes.extend_from_slice(chunk.get(..count).unwrap_or_default());
            if let Some(end) = bytes.windows(4).position(|four| four == b"\r\n\r\n") {
                // A browser sends nothing behind the head before it was answered.
                return if end + 4 == bytes.len() { Self::parse(&bytes) } else { Err(NoHead::Malformed) };
            }
            if bytes.len() > HEAD_BYTES {
                return Err(NoHead::TooLong);
            }
            if begin.elapsed() > HEAD_TIME {
                return Err(NoHead::Incomplete);
            }
        }
    }

    fn parse(bytes: &[u8]) -> Result<Self, NoHead> {
        let text = std::str::from_utf8(bytes).map_err(|_| NoHead::Malformed)?;
        let mut lines = text.split("\r\n");
        let mut words = lines.next().unwrap_or_default().split(' ');
        let (Some(method), Some(target), Some("HTTP/1.1"), None) =
            (words.next(), words.next(), words.next(), words.next())
        else {
            return Err(NoHead::Malformed);
        };
        let mut headers = Vec::new();
        for line in lines.take_while(|line| !line.is_empty()) {
            let (name, value) = line.split_once(':').ok_or(NoHead::Malformed)?;
            if name.is_empty() || name.bytes().any(|byte| !byte.is_ascii_graphic()) {
                return Err(NoHead::Malformed);
            }
            headers.push((name.to_ascii_lowercase(), value.trim().to_owned()));
        }
        let path = target.split('?').next().unwrap_or_default().to_owned();
        Ok(Self { method: method.to_owned(), path, headers })
    }

    /// The only header of this name; none where it is missing or doubled.
    pub(crate) fn only(&self, name: &str) -> Option<&str> {
        let mut found = self.headers.iter().filter(|(known, _)| known == name);
        match (found.next(), found.next()) {
            (Some((_, value)), None) => Some(value),
            _ => None,
        }
    }

    /// Whether the header is there and lists `word`.
    fn lists(&self, name: &str, word: &str) -> bool {
        self.only(name).is_some_and(|value| value.split(',').any(|one| one.trim().eq_ignore_ascii_case(word)))
    }

    /// The key of a request that wants to become a WebSocket of version 13. Source: RFC 6455, 4.2.1.
    pub(crate) fn socket_key(&self) -> Option<&str> {
        let wants = self.lists("connection", "upgrade")
            && self.lists("upgrade", "websocket")
            && self.only("sec-websocket-version") == Some("13");
        self.only("sec-websocket-key").filter(|key| wants && key.len() == 24)
    }
}

/// Answers with `body` and ends the connection.
pub(crate) fn answer(stream: &mut impl Write, status: &str, kind: &str, body: &[u8]) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: \
         close\r\n{HEADERS}\r\n",
        body.len()
    );
    let begin = Instant::now();
    put(stream, head.as_bytes(), begin, ANSWER_TIME)?;
    put(stream, body, begin, ANSWER_TIME)?;
    stream.flush()
}

/// Writes all of `bytes`, unless `most` has passed since `begin`.
fn put(stream: &mut impl Write, mut bytes: &[u8], begin: Instant, most: Duration) -> io::Result<()> {
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
    Ok(())
}

/// Turns the connection into a WebSocket.
pub(crate) fn upgrade(stream: &mut impl Write, key: &str) -> io::Result<()> {
    let accept = tungstenite::handshake::derive_accept_key(key.as_bytes());
    let head = format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: \
         Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n\r\n"
    );
    stream.write_all(head.as_bytes())?;
    stream.flush()
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
        assert_eq!((head.method.as_str(), head.path.as_str()), ("GET", "/app.js"));
        assert_eq!(
            (head.only("host"), head.only("origin"), head.socket_key()),
            (Some("localhost:1"), None, None)
        );
        let whole = "GET /socket HTTP/1.1\r\nConnection: keep-alive, Upgrade\r\nUpgrade: \
                     websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: \
                     dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
        assert_eq!(read(whole).unwrap().socket_key(), Some("dGhlIHNhbXBsZSBub25jZQ=="));
        for part in ["13", "websocket", "keep-alive, Upgrade", "dGhl"] {
            assert_eq!(read(&whole.replace(part, "x")).unwrap().socket_key(), None, "{part}");
        }
        let mut out = Vec::new();
        upgrade(&mut out, "dGhlIHNhbXBsZSBub25jZQ==").unwrap();
        // The example of RFC 6455, 1.3.
        assert!(String::from_utf8(out).unwrap().contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="));
    }

    #[test]
    fn what_is_malformed_too_long_or_cut_is_refused() {
        for wrong in [
            "\r\n\r\n",
            "GET / HTTP/1.0\r\n\r\n",
            "GET  / HTTP/1.1\r\n\r\n",
            "GET / HTTP/1.1\r\nHost\r\n\r\n",
            "GET / HTTP/1.1\r\n: x\r\n\r\n",
            "GET / HTTP/1.1\r\nA b: x\r\n\r\n",
            "GET / HTTP/1.1\r\n\r\nGET / HTTP/1.1\r\n\r\n",
        ] {
            assert_eq!(read(wrong), Err(NoHead::Malformed), "{wrong:?}");
        }
        assert_eq!(read("GET / HTTP/1.1\r\nHost: x"), Err(NoHead::Incomplete));
        assert_eq!(read(&"x".repeat(20_000)), Err(NoHead::TooLong));
        let doubled = read("GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n").unwrap();
        assert_eq!(doubled.only("host"), None);
    }

    #[test]
    fn an_answer_that_is_taken_byte_by_byte_ends() {
        struct Slow;
        impl Write for Slow {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                std::thread::sleep(Duration::from_millis(1));
                Ok(1)
            }

            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let most = Duration::from_millis(100);
        let ended = put(&mut Slow, &[0; 100_000], Instant::now(), most).unwrap_err();
        assert_eq!(ended.kind(), io::ErrorKind::TimedOut);
        assert!(put(&mut Slow, &[0; 3], Instant::now(), most).is_ok());
    }

    #[test]
    fn every_answer_isolates_the_page() {
        let mut out = Vec::new();
        answer(&mut out, "200 OK", "text/html", b"hi").unwrap();
        let text = String::from_utf8(out).unwrap();
        for wanted in
            ["default-src 'none'", "Opener-Policy: same-origin", "Embedder-Policy: require-corp", "Length: 2"]
        {
            assert!(text.contains(wanted), "{wanted} missing in {text}");
        }
    }
}
