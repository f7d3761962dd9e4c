//! The console from outside, as a browser and as an attacker, before a daemon's side made in the same
//! process.

mod hostile;
mod lan;
mod rig;

use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use foretrace_client::wire::Enable;
use foretrace_client::{Claimant, Foretrace, HolderKind, PenSample, monotonic_now_ns};
use rig::{Rig, ask, wait_until, write};
use serde_json::{Value, json};
use tungstenite::Message as Packet;

#[test]
fn the_page_is_served_to_this_machine_and_to_no_other_name() {
    let rig = Rig::start();
    let page = rig.get("/");
    assert!(page.starts_with("HTTP/1.1 200 OK") && page.contains("<title>foretrace</title>"), "{page:.300}");
    assert!(!page.contains(&rig.token));
    assert!(rig.get("/three.js").len() > 100_000);
    assert!(rig.get("/../../etc/passwd").starts_with("HTTP/1.1 404"));
    let foreign = rig.request("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n");
    assert!(foreign.starts_with("HTTP/1.1 403") && foreign.contains("foreign host"), "{foreign}");
    let posted = rig.request(&format!("POST / HTTP/1.1\r\nHost: {}\r\n\r\n", rig.at));
    assert!(posted.starts_with("HTTP/1.1 405"), "{posted}");
    let old = rig.request(&format!("GET / HTTP/1.0\r\nHost: {}\r\n\r\n", rig.at));
    assert!(old.starts_with("HTTP/1.1 505"), "{old}");
    for origin in ["http://evil.example", "null", "https://localhost"] {
        assert!(rig.page_from(origin).is_err(), "{origin}");
    }
    let tally = rig.end();
    assert_eq!((tally.refused["foreign host"], tally.refused["foreign origin"]), (1, 3));
}

#[test]
fn a_page_that_controls_writes_and_every_sample_arrives_in_order() {
    let rig = Rig::start();
    let mut page = rig.controller();
    assert!(page.hears("scene")["radii"].as_array().unwrap().len() > 3);
    let got = rig.heard_counting(&rig.daemon.services.pen, |count| {
        for _ in 0..10 {
            page.writes(12);
            std::thread::sleep(Duration::from_millis(15));
        }
        wait_until(|| count.load(Ordering::Acquire) >= 120);
    });
    assert_eq!(got.len(), 120);
    assert!(got.windows(2).all(|pair| pair[0].device_stamp_ns < pair[1].device_stamp_ns));
    let expected = |index: usize| 0.001 * (index % 12) as f64;
    assert!(got.iter().enumerate().all(|(index, sample)| (sample.x_m - expected(index)).abs() < 1e-12));
    assert!(got.iter().all(|sample| sample.contact() && sample.pressure == 0.5));
    let holder = rig.instance.holder(foretrace_client::Place::Pen).unwrap();
    assert_eq!(holder.who.kind(), HolderKind::Browser);
    drop(page);
    assert_eq!(rig.end().samples, 120);
}

#[test]
fn without_the_token_nothing_moves_and_all_that_was_tried_is_counted() {
    let rig = Rig::start();
    let mut page = rig.page();
    page.say(json!({ "control": "0123456789abcdef0123456789abcdef" }));
    let reported = page.hears("control");
    assert!(
        reported["mine"] == false && reported["refused"].as_str().unwrap().contains("token is wrong"),
        "{reported}"
    );
    let pens = rig.heard(&rig.daemon.services.pen, || {
        let held = rig.heard(&rig.daemon.services.enable, || {
            page.writes(5);
            page.holds(true);
            for message in [ask(json!({ "arm": true })), write("Hi"), json!({"take_pen": true})] {
                page.say(message);
                let reported = page.hears("reply");
                assert!(
                    reported["done"] == false && reported["words"].as_str().unwrap().contains("only watches"),
                    "{reported}"
                );
            }
            std::thread::sleep(Duration::from_millis(200));
        });
        assert!(held.is_empty());
    });
    assert!(pens.is_empty());
    assert_eq!(rig.instance.holder(foretrace_client::Place::Pen), None);
    let tally = rig.end();
    assert_eq!((tally.refused["wrong token"], tally.refused["without control"]), (1, 5));
    assert_eq!(tally.samples, 0);
}

#[test]
fn one_page_controls_at_a_time_and_the_next_one_when_it_is_gone() {
    let rig = Rig::start();
    let first = rig.controller();
    let mut second = rig.page();
    second.say(json!({ "control": rig.token }));
    let reported = second.hears("control");
    assert!(reported["refused"].as_str().unwrap().contains("controls: give the control back"), "{reported}");
    drop(first);
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        second.say(json!({ "control": rig.token }));
        if second.hears("control")["mine"] == true {
            break;
        }
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The dead-man messages while `act` runs, and how many have come so far.
fn dead_man(rig: &Rig, act: impl FnOnce(&AtomicUsize)) -> Vec<u32> {
    let got: Vec<Enable> = rig.heard_counting(&rig.daemon.services.enable, act);
    got.into_iter().map(|message| message.stop).collect()
}

#[test]
fn a_held_button_beats_and_silence_or_a_lost_page_lets_it_go() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let reported = dead_man(&rig, |count| {
        page.holds_until(|| count.load(Ordering::Acquire) >= 10);
        // Says nothing more, as a page that hangs.
        wait_until(|| !rig.frame_says(&mut page, |here| here["held"] == true));
    });
    assert!(reported.iter().filter(|stop| **stop == 0).count() >= 10, "{reported:?}");
    assert_eq!(reported.last(), Some(&1), "{reported:?}");
    let reported = dead_man(&rig, |count| {
        page.holds_until(|| count.load(Ordering::Acquire) >= 5);
        drop(page);
        wait_until(|| rig.instance.holder(foretrace_client::Place::DeadMan).is_none());
    });
    assert_eq!(reported.last(), Some(&1), "{reported:?}");
}

#[test]
fn a_hold_that_was_long_under_way_enables_nothing() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let reported = dead_man(&rig, |_| {
        for _ in 0..10 {
            let then_us = monotonic_now_ns() as f64 * 1e-3 - 200_000.0;
            page.say(json!({ "hold": [true, then_us] }));
        }
        page.say(json!({ "ping": 1.0 }));
        page.hears("pong");
        std::thread::sleep(Duration::from_millis(100));
    });
    assert!(reported.is_empty(), "{reported:?}");
    assert_eq!(rig.end().refused["hold came too late"], 10);
}

#[test]
fn holds_dated_ahead_enable_nothing_and_are_counted() {
    let rig = Rig::start();
    let mut stopped = Value::Null;
    let beats = dead_man(&rig, |_| {
        let mut page = rig.controller();
        for _ in 0..100 {
            let ahead_us = monotonic_now_ns() as f64 * 1e-3 + 5e6;
            page.say(json!({ "hold": [true, ahead_us] }));
            std::thread::sleep(Duration::from_millis(1));
        }
        // A stop has no date.
        page.say(json!({ "stop": true }));
        stopped = page.hears("reply");
    });
    assert!(beats.is_empty(), "{beats:?}");
    assert!(!stopped.is_null());
    assert_eq!(rig.instance.holder(foretrace_client::Place::DeadMan), None);
    assert_eq!(rig.end().refused["hold dated ahead"], 100);
}

#[test]
fn a_button_that_is_let_go_gives_its_place_back() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let taken = || rig.instance.holder(foretrace_client::Place::DeadMan).is_some();
    page.holds_until(taken);
    assert!(taken());
    page.holds(false);
    wait_until(|| !taken());
    assert!(!taken());
}

#[test]
fn a_browser_displaces_no_hardware_enabling_device_and_begins_nothing_by_itself_when_that_ends() {
    let rig = Rig::start();
    let foretrace = Foretrace::attach_within(&rig.instance, Duration::ZERO).unwrap();
    let pedal = Claimant::new(HolderKind::Button, "foot pedal");
    let mut dead_man = foretrace.dead_man_as(&pedal).unwrap();
    let mut page = rig.controller();
    for _ in 0..20 {
        page.holds(true);
        dead_man.beat().unwrap();
        std::thread::sleep(Duration::from_millis(40));
    }
    assert!(dead_man.handed_to().is_none());
    assert!((0..100).any(|_| {
        rig.frame_says(&mut page, |here| {
            here["hold_note"].as_str().is_some_and(|note| note.contains("held by the button foot pedal"))
        })
    }));
    drop(dead_man);
    let beats = rig.heard(&rig.daemon.services.enable, || {
        for _ in 0..40 {
            page.holds(true);
            std::thread::sleep(Duration::from_millis(20));
        }
    });
    assert!(beats.is_empty(), "{}", beats.len());
    page.holds(false);
    wait_until(|| !rig.frame_says(&mut page, |here| here["held"] == true));
    let taken = || rig.instance.holder(foretrace_client::Place::DeadMan).is_some();
    page.holds_until(taken);
    assert!(taken());
}

#[test]
fn orders_that_nobody_answers_are_refused_and_told_and_do_not_pile_up_until_a_daemon_answers() {
    let rig = Rig::start();
    let mut page = rig.controller();
    // This daemon's side answers no request: the first one waits, and few may wait behind it.
    for _ in 0..6 {
        page.say(ask(json!({ "arm": true })));
    }
    let first = page.hears("reply");
    assert!(first["words"].as_str().unwrap().contains("not carried out"), "{first}");
    rig.page().say(json!({ "stop": true }));
    let replies: Vec<Value> = (0..5).map(|_| page.hears("reply")).collect();
    assert!(replies.iter().all(|reply| reply["done"] == false), "{replies:?}");
    let asked = replies.iter().filter(|one| !one["words"].as_str().unwrap().contains("not carried out"));
    assert!(asked.count() <= 1, "{replies:?}");
    wait_until(|| rig.frame_says(&mut page, |_| true));
    let tally = rig.end();
    assert_eq!(tally.stops, 1);
    assert!(tally.refused.values().sum::<u64>() >= 5, "{tally:?}");
}

#[test]
fn the_pen_of_a_tablet_is_taken_over_only_when_a_person_asks_for_it() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let instance = rig.instance.clone();
    let over = Arc::new(AtomicBool::new(false));
    let ends = over.clone();
    let (has_it, it_has) = std::sync::mpsc::channel();
    let tablet = std::thread::spawn(move || {
        let foretrace = Foretrace::attach_within(&instance, Duration::ZERO).unwrap();
        let mut feed = foretrace.pen_feed_as(&Claimant::new(HolderKind::Tablet, "event7")).unwrap();
        has_it.send(()).unwrap();
        while feed.handed_to().is_none() && !ends.load(Ordering::Acquire) {
            std::thread::sleep(Duration::from_millis(5));
        }
        feed.handed_to().map(|to| to.who.kind())
    });
    it_has.recv().unwrap();
    page.writes(3);
    std::thread::sleep(Duration::from_millis(300));
    assert!(!tablet.is_finished());
    page.say(json!({ "take_pen": true }));
    let reported = page.hears("reply");
    over.store(true, Ordering::Release);
    assert!(reported["done"] == true, "{reported}");
    assert_eq!(tablet.join().unwrap(), Some(HolderKind::Browser));
}

#[test]
fn the_built_in_writer_writes_by_itself_and_samples_meanwhile_are_counted() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let got: Vec<PenSample> = rig.heard_counting(&rig.daemon.services.pen, |count| {
        page.say(write("Hi"));
        assert_eq!(page.hears("reply")["done"], true);
        wait_until(|| count.load(Ordering::Acquire) >= 1);
        page.writes(3);
        wait_until(|| count.load(Ordering::Acquire) >= 40);
    });
    assert_eq!(got.len(), 40);
    assert_eq!(rig.end().samples_refused["the writer writes"], 3);
}

#[test]
fn the_page_that_controls_records_and_every_page_sees_it() {
    let rig = Rig::start();
    let (mut page, mut viewer) = (rig.controller(), rig.page());
    viewer.say(json!({ "record": true }));
    assert_eq!(viewer.hears("reply")["done"], false);
    let mut asks = |on: bool| {
        page.say(json!({ "record": on }));
        page.hears("reply")
    };
    assert_eq!(asks(false)["done"], false);
    assert_eq!(asks(true), json!({ "done": true, "words": "recording into here" }));
    assert_eq!(asks(true)["done"], false);
    wait_until(|| rig.frame_says(&mut viewer, |here| here["recording"]["on"] == true));
    assert_eq!(asks(false)["done"], true);
    wait_until(|| rig.frame_says(&mut viewer, |here| here["recording"]["on"] == false));
    assert!(rig.frame_says(&mut viewer, |here| here["recording"]["on"] == false));
    assert_eq!(rig.end().refused["without control"], 1);
}

#[test]
fn a_stop_ends_the_writer() {
    let rig = Rig::start();
    let mut page = rig.controller();
    let mut ended_ns = 0;
    let got: Vec<PenSample> = rig.heard_counting(&rig.daemon.services.pen, |count| {
        page.say(write("long"));
        assert_eq!(page.hears("reply")["done"], true);
        wait_until(|| count.load(Ordering::Acquire) >= 1);
        page.say(json!({ "stop": true }));
        wait_until(|| !rig.frame_says(&mut page, |here| here["writing"] == true));
        ended_ns = monotonic_now_ns();
        // Time for what a writer that goes on would send: a sample is due every few milliseconds.
        std::thread::sleep(Duration::from_millis(300));
    });
    let last_ns = got.last().map_or(u64::MAX, |sample| sample.device_stamp_ns);
    assert!(last_ns <= ended_ns, "it went on for {} ms", last_ns.saturating_sub(ended_ns) / 1_000_000);
    // The text has 4000 points: it was the stop that ended it.
    assert!(got.len() < 4000, "{}", got.len());
}

#[test]
fn a_message_of_a_megabyte_and_a_flood_end_the_page_that_sent_them() {
    let rig = Rig::start();
    let mut page = rig.page();
    // The console ends the connection while the rest is still being sent.
    let _ = page.0.send(Packet::text("x".repeat(1 << 20)));
    assert!(page.is_let_go());
    let mut flood = rig.page();
    for _ in 0..20_000 {
        if flood.0.send(Packet::text("{\"ping\":1}")).is_err() {
            break;
        }
    }
    assert!(flood.is_let_go());
    let mut pings = rig.page();
    for _ in 0..20_000 {
        if pings.0.send(Packet::Ping(vec![0_u8; 4].into())).is_err() {
            break;
        }
    }
    assert!(pings.is_let_go());
    let mut odd = rig.page();
    odd.0.send(Packet::binary(vec![0_u8; 16])).unwrap();
    odd.say(json!({ "ping": 1.0 }));
    assert_eq!(odd.hears("pong")[0], 1.0);
    let tally = rig.end();
    assert_eq!(
        (
            tally.refused["message too long"],
            tally.refused["too many messages"],
            tally.refused["binary message"]
        ),
        (1, 2, 1)
    );
}

#[test]
fn a_thousand_connections_are_bounded_and_a_page_is_served_afterwards() {
    let rig = Rig::start();
    let mut open = Vec::new();
    for _ in 0..1000 {
        // The system may refuse some by itself.
        open.extend(TcpStream::connect_timeout(&rig.at, Duration::from_secs(5)));
    }
    assert!(open.len() > 900, "{}", open.len());
    drop(open);
    let deadline = Instant::now() + Duration::from_secs(20);
    while !rig.get("/").starts_with("HTTP/1.1 200") {
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(rig.end().refused["too many connections"] > 500);
}

#[test]
fn a_page_that_never_reads_costs_only_itself() {
    let rig = Rig::start();
    let deaf = rig.page();
    let mut page = rig.controller();
    let begin = Instant::now();
    let mut slowest = Duration::ZERO;
    while begin.elapsed() < Duration::from_secs(2) {
        let sent = Instant::now();
        page.say(json!({ "ping": 1.0 }));
        page.hears("pong");
        slowest = slowest.max(sent.elapsed());
        std::thread::sleep(Duration::from_millis(5));
    }
    // A page that waited for the deaf one would wait for seconds.
    assert!(slowest < Duration::from_secs(1), "{slowest:?}");
    drop(deaf);
    rig.end();
}
