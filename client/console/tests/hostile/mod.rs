//! Every kind of message, whole and damaged, from a page without the token, before a daemon's side that takes
//! whatever would move an arm. The same messages from the page that controls show that they would.

use std::io::Write as _;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use foretrace_client::{Place, monotonic_now_ns};
use foretrace_shm::{ControlOp, ControlStatus};
use serde_json::{Value, json};
use tungstenite::Message as Packet;

use crate::rig::{Page, Rig};

/// One of each kind, of now.
fn kinds(token: &str) -> Vec<Value> {
    let now_us = monotonic_now_ns() as f64 * 1e-3;
    let asks = [
        json!({ "arm": true }),
        json!({ "disarm": true }),
        json!({ "home": true }),
        json!({ "trust_auto": true }),
        json!({ "freeze_trust": true }),
        json!({ "trust": 0.5 }),
        json!({ "predictor": "hold" }),
        json!({ "reload": true }),
    ];
    let mut all = vec![
        json!({ "ping": 12.5 }),
        json!({ "control": token }),
        json!({ "pen": [[now_us, 0.01, 0.02, 3, 0.5, 0.1, 0.1], [now_us + 1.0, 0.01, 0.02, 3, 0.5, 0.1, 0.1]] }),
        json!({ "hold": [true, now_us] }),
        json!({ "write": ["Hello", now_us] }),
        json!({ "take_pen": true }),
        json!({ "record": true }),
        json!({ "release": true }),
    ];
    all.extend(asks.into_iter().map(|ask| json!({ "ask": [ask, now_us] })));
    all
}

/// xorshift64*: the same bytes in every run.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, below: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % below
    }

    /// Damages a message in a few places.
    fn damage(&mut self, text: &str) -> String {
        let mut bytes = text.as_bytes().to_vec();
        for _ in 0..=self.roll(3) {
            let at = self.roll(bytes.len().max(1));
            match self.roll(5) {
                _ if bytes.is_empty() => {}
                0 => bytes[at] = self.roll(256) as u8,
                1 => drop(bytes.remove(at)),
                2 => bytes.insert(at, b"0123456789.-e[]{},:\" true"[self.roll(25)]),
                3 => bytes.truncate(at),
                _ => {
                    let again = bytes[at..].to_vec();
                    bytes.extend(again);
                }
            }
        }
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

/// Runs `act` while a daemon's side answers requests; returns those that came, but stops.
fn asked(rig: &Rig, act: impl FnOnce(&AtomicUsize)) -> Vec<u32> {
    let over = AtomicBool::new(false);
    let count = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        let serving = scope.spawn(|| {
            let mut server = rig.daemon.services.control.server(7).unwrap();
            let mut ops = Vec::new();
            while !over.load(Ordering::Acquire) {
                while let Some(call) = server.take() {
                    if call.request.op != u32::from(ControlOp::Stop) {
                        ops.push(call.request.op);
                    }
                    count.store(ops.len(), Ordering::Release);
                    call.answer(ControlStatus::Ok, 0.0, 0, "done");
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            ops
        });
        act(&count);
        over.store(true, Ordering::Release);
        serving.join().unwrap()
    })
}

/// Says it; a page that was let go is opened again.
fn say(rig: &Rig, page: &mut Page, text: &str) {
    while page.0.send(Packet::text(text)).is_err() {
        *page = rig.page();
    }
    // Whatever came is read, so that the socket's buffers stay free.
    page.1.clear();
    while let Ok(Packet::Text(_)) = page.0.read() {}
}

#[test]
fn nothing_that_a_page_without_the_token_says_moves_anything_whatever_it_says() {
    let cases: usize = std::env::var("FORETRACE_FUZZ_CASES").map_or(2000, |text| text.parse().unwrap());
    let rig = Rig::start();
    let wrong = "0123456789abcdef0123456789abcdef";
    let (mut dice, mut said, mut alive, mut records) = (Dice(0x0000_c045_01e1), 0_u64, false, true);
    let mut held = Vec::new();
    let mut pens = Vec::new();
    let ops = asked(&rig, |_| {
        pens = rig.heard(&rig.daemon.services.pen, || {
            held = rig.heard(&rig.daemon.services.enable, || {
                let mut page = rig.page();
                page.short();
                for case in 0..cases {
                    let kinds = kinds(wrong);
                    let whole = kinds[case % kinds.len()].to_string();
                    let text = if case < 2 * kinds.len() { whole } else { dice.damage(&whole) };
                    say(&rig, &mut page, &text);
                    said += 1;
                }
                let mut page = rig.page();
                page.say(json!({ "ping": 1.0 }));
                alive = page.hears("pong")[0] == 1.0;
                records = rig.frame_says(&mut page, |here| here["recording"]["on"] == true);
            });
        });
    });
    assert!(!records, "a recording was begun");
    assert!(
        alive && ops.is_empty() && pens.is_empty() && held.is_empty(),
        "{ops:?} {} {}",
        pens.len(),
        held.len()
    );
    for place in [Place::Pen, Place::DeadMan] {
        assert_eq!(rig.instance.holder(place), None);
    }
    let tally = rig.end();
    let refused: u64 = tally.refused.values().sum();
    // What is left are pings, releases and whole messages that damage made of these.
    assert!(refused > said / 2 && tally.refused["message not understood"] > said / 10, "{tally:?}");
    assert!(tally.refused["without control"] >= 26 && tally.refused["wrong token"] >= 2, "{tally:?}");
    assert_eq!((tally.samples, tally.samples_refused.len()), (0, 0), "{tally:?}");
}

#[test]
fn an_order_that_was_long_under_way_or_from_before_a_stop_is_not_carried_out_and_that_is_told() {
    let rig = Rig::start();
    let ops = asked(&rig, |_| {
        let (mut page, mut viewer) = (rig.controller(), rig.page());
        let mut told = |order: &str, what: Value, at_us: f64| {
            page.say(json!({ order: [what, at_us] }));
            page.hears("reply")["words"].as_str().unwrap().to_owned()
        };
        let now_us = || monotonic_now_ns() as f64 * 1e-3;
        let late = told("ask", json!({ "arm": true }), now_us() - 1.5e6);
        assert!(late.contains("waited for too long"), "{late}");
        let clicked_us = now_us();
        viewer.say(json!({ "stop": true }));
        viewer.hears("reply");
        // What a slow network holds back, by less than makes it too old.
        for (order, what) in [("ask", json!({ "home": true })), ("write", json!("Hello"))] {
            let told = told(order, what, clicked_us);
            assert!(told.contains("from before a stop") || told.contains("waited for too long"), "{told}");
        }
        assert_eq!(told("ask", json!({ "disarm": true }), now_us()), "done");
        // Dated ahead it would outrank a stop that comes meanwhile.
        for (order, what) in
            [("ask", json!({ "arm": true })), ("ask", json!({ "trust": 0.5 })), ("write", json!("Hello"))]
        {
            let ahead = told(order, what, now_us() + 5e6);
            assert!(ahead.contains("order dated ahead"), "{ahead}");
        }
        // What lets the arm go counts whatever its date, and a clock that is a little ahead is taken for now.
        assert_eq!(told("ask", json!({ "disarm": true }), now_us() + 1e9), "done");
        assert_eq!(told("ask", json!({ "freeze_trust": true }), now_us() + 5e4), "done");
    });
    let [disarm, freeze] = [ControlOp::Disarm, ControlOp::FreezeTrust].map(u32::from);
    assert_eq!(ops, [disarm, disarm, freeze]);
    assert_eq!(rig.instance.holder(Place::Pen), None);
    assert_eq!(rig.end().refused["order dated ahead"], 3);
}

#[test]
fn a_message_of_empty_pieces_without_end_ends_the_page_that_sends_it() {
    [Rig::start(), Rig::start_lan()].into_iter().for_each(ends_empty_pieces);
}

fn ends_empty_pieces(rig: Rig) {
    let mut page = rig.page();
    let line = page.0.get_mut();
    // A text that goes on, and pieces of it that go on, all of them empty; masked, as RFC 6455, 5.2 wants.
    line.write_all(&[0x01, 0x80, 0, 0, 0, 0]).unwrap();
    let pieces = [0x00, 0x80, 0, 0, 0, 0].repeat(8192);
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(20) && line.write_all(&pieces).is_ok() {}
    assert!(begin.elapsed() < Duration::from_secs(20), "it is still served");
    assert_eq!(rig.end().refused.get("too many bytes"), Some(&1));
}

#[test]
fn the_same_messages_of_the_page_that_controls_reach_the_daemon() {
    let rig = Rig::start();
    let mut beats = Vec::new();
    let mut pens = Vec::new();
    let ops = asked(&rig, |count| {
        pens = rig.heard(&rig.daemon.services.pen, || {
            beats = rig.heard(&rig.daemon.services.enable, || {
                let mut page = rig.controller();
                for kind in 0..kinds(&rig.token).len() {
                    // Each of its own moment: what is old is not carried out.
                    let message = kinds(&rig.token).swap_remove(kind);
                    let before = count.load(Ordering::Acquire);
                    let is_ask = message.get("ask").is_some();
                    if message.get("release").is_some() {
                        continue;
                    }
                    page.say(message);
                    if is_ask {
                        crate::rig::wait_until(|| count.load(Ordering::Acquire) > before);
                    }
                }
                // As a page does while its button is held: one message alone may come too late.
                for _ in 0..10 {
                    page.say(json!({ "hold": [true, monotonic_now_ns() as f64 * 1e-3] }));
                    std::thread::sleep(Duration::from_millis(30));
                }
            });
        });
    });
    assert_eq!(ops.len(), 8, "{ops:?}");
    assert!(pens.len() >= 2 && !beats.is_empty(), "{} {}", pens.len(), beats.len());
}
