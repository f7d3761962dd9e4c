//! Under TLS: who is let in, and what an address is worth that works once.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::json;

use crate::rig::{Page, Rig, wait_until};

fn control(page: &mut Page, said: &str) -> serde_json::Value {
    page.say(json!({ "control": said }));
    page.hears("control")
}

#[test]
fn a_page_is_served_under_tls_by_a_server_that_proves_its_address_and_its_name() {
    let rig = Rig::start_lan();
    assert!(rig.get("/").contains("<title>foretrace</title>"));
    let (mut named, _below) = rig.line("localhost");
    write!(named, "GET / HTTP/1.1\r\nHost: localhost:{}\r\n\r\n", rig.at.port()).unwrap();
    let mut answer = String::new();
    named.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer:.200}");
    // A certificate for other names than these would be one for anybody's machine.
    let (mut other, _below) = rig.line("127.0.0.3");
    let refused = other.write_all(b"GET / HTTP/1.1\r\n\r\n").and_then(|()| other.flush());
    let refused = refused.and_then(|()| other.read(&mut [0; 64]).map(drop)).unwrap_err();
    assert!(refused.to_string().contains("not valid for name"), "{refused}");
}

#[test]
fn addresses_and_origins_that_it_was_not_started_on_are_refused_and_plain_http_is_reported_where_to_go() {
    let rig = Rig::start_lan();
    for host in ["192.0.2.9:1".to_owned(), "evil.example".to_owned(), format!("desk:{}", rig.at.port())] {
        let reported = rig.request(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n"));
        assert!(reported.starts_with("HTTP/1.1 403") && reported.contains("foreign host"), "{reported}");
    }
    let clear = rig.origin().replace("https", "http");
    for origin in ["https://evil.example", "null", &clear] {
        assert!(rig.page_from(origin).is_err(), "{origin}");
    }
    let mut plain = TcpStream::connect(rig.at).unwrap();
    write!(plain, "GET / HTTP/1.1\r\nHost: {}\r\n\r\n", rig.at).unwrap();
    let mut reported = String::new();
    plain.read_to_string(&mut reported).unwrap();
    assert!(reported.starts_with("HTTP/1.1 426"), "{reported}");
    for wanted in [&rig.origin(), "not secure", "getCoalescedEvents", "rate"] {
        assert!(reported.contains(wanted), "{wanted} {reported}");
    }
    assert!(!reported.contains(&rig.token));
    let tally = rig.end();
    let refused = ["foreign host", "foreign origin", "not under TLS"].map(|reason| tally.refused[reason]);
    assert_eq!(refused, [3, 3, 1]);
}

#[test]
fn the_printed_token_works_once_and_its_key_lasts_until_another_token_is_used() {
    let rig = Rig::start_lan();
    let mut first = rig.page();
    let got = control(&mut first, &rig.token);
    assert_eq!(got["mine"], true);
    let key = got["key"].as_str().unwrap().to_owned();
    assert!(key.len() == 32 && key != rig.token);
    let mut thief = rig.page();
    let reported = control(&mut thief, &rig.token);
    assert!(
        reported["mine"] == false && reported["refused"].as_str().unwrap().contains("works once"),
        "{reported}"
    );
    // A page that is loaded again, or lost its link, comes back by its key.
    drop(first);
    let mut again = rig.page();
    wait_until(|| control(&mut again, &key)["mine"] == true);
    again.say(json!({ "release": true }));
    assert_eq!(again.hears("control")["mine"], false);
    let address = rig.renewer.address().unwrap();
    let token = address.split('#').nth(1).unwrap();
    assert!(address.starts_with(&rig.origin()) && token != rig.token);
    assert_eq!(control(&mut thief, &rig.token)["mine"], false);
    let got = control(&mut thief, token);
    assert!(got["mine"] == true && got["key"] != key.as_str(), "{got}");
    thief.say(json!({ "release": true }));
    thief.hears("control");
    assert_eq!(control(&mut again, &key)["mine"], false);
    let tally = rig.end();
    assert_eq!((tally.refused["token used before"], tally.refused["wrong token"]), (1, 2));
}

#[test]
fn a_page_without_the_token_watches_and_stops_and_one_with_it_writes_under_tls_as_in_the_clear() {
    let rig = Rig::start_lan();
    let mut viewer = rig.page();
    assert!(viewer.hears("scene")["radii"].is_array());
    viewer.writes(5);
    viewer.say(crate::rig::ask(json!({ "arm": true })));
    assert_eq!(viewer.hears("reply")["done"], false);
    let mut page = rig.controller();
    let got = rig.heard_counting(&rig.daemon.services.pen, |count| {
        for _ in 0..20 {
            page.writes(12);
            std::thread::sleep(Duration::from_millis(15));
        }
        wait_until(|| count.load(std::sync::atomic::Ordering::Acquire) >= 240);
    });
    assert_eq!(got.len(), 240);
    viewer.say(json!({ "stop": true }));
    viewer.hears("reply");
    let tally = rig.end();
    assert_eq!((tally.stops, tally.samples, tally.refused["without control"]), (1, 240, 2));
}

#[test]
fn connections_that_begin_no_tls_or_drip_it_end_and_a_page_is_served_afterwards() {
    let rig = Rig::start_lan();
    let mut open: Vec<TcpStream> = (0..32).map(|_| TcpStream::connect(rig.at).unwrap()).collect();
    let mut noise: u32 = 1;
    let begin = Instant::now();
    // The head of a handshake, and then a byte now and then; some of them say nothing at all.
    while begin.elapsed() < Duration::from_secs(5) {
        for (index, stream) in open.iter_mut().enumerate().skip(8) {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let bytes = [[22, 3, 1, 2, 0], [(noise >> 24) as u8; 5]][usize::from(index > 20)];
            // The console ends it meanwhile.
            let _ = stream.write_all(&bytes[..1 + index % 5]);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let mut answer = String::new();
    wait_until(|| {
        answer.clear();
        let (mut line, _below) = rig.line("localhost");
        let asked = write!(line, "GET / HTTP/1.1\r\nHost: {}\r\n\r\n", rig.at);
        // Turned away while all slots are taken.
        let _ = asked.and_then(|()| line.read_to_string(&mut answer));
        answer.starts_with("HTTP/1.1 200")
    });
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer:.200}");
}
