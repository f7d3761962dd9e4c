//! `foretrace foxglove`: viewers of all three subprotocols see the daemon's tick records, stop the arm and,
//! with the token, arm it and set its parameters; one that never reads slows nobody.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::ChildStdout;
use std::time::{Duration, Instant};

use foretrace_client::TickRecord;
use foretrace_client::wire::FaultReason;
use foretrace_record::read::{Content, RecordingEntry, RecordingReader};
use foretrace_record::topics::{FRAME_TRANSFORM, LOG, TICK};
use foretrace_tests::{Process, World, json, told, until};
use serde_json::Value;
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Message, WebSocket};

use crate::PROGRAM;

const PROTOCOLS: [&str; 3] = ["foxglove.websocket.v1", "foxglove.sdk.v1", "foxglove.sdk.v1.1"];
/// Longest wait for a message that has to come.
const PATIENCE: Duration = Duration::from_secs(20);

/// The server, its address, and the token that it printed.
fn server(world: &World) -> (Process, BufReader<ChildStdout>, String, String) {
    let words = ["foxglove", "--listen", "127.0.0.1:0", "--json", "foxglove.json"];
    let mut server = world.start(0, &words);
    let mut stdout = BufReader::new(server.take_stdout().unwrap());
    let (mut open, mut token) = (String::new(), String::new());
    stdout.read_line(&mut open).unwrap();
    stdout.read_line(&mut token).unwrap();
    let address = open.split("ws://").nth(1).unwrap().split(' ').next().unwrap().to_owned();
    let token = token.trim().split("token=").nth(1).unwrap().to_owned();
    (server, stdout, address, token)
}

struct Viewer(WebSocket<TcpStream>);

impl Viewer {
    fn open(address: &str, path: &str, protocol: &str) -> Result<Self, String> {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut request = format!("ws://{address}{path}").into_client_request().unwrap();
        request.headers_mut().insert("sec-websocket-protocol", protocol.parse().unwrap());
        match tungstenite::client(request, stream) {
            Ok((socket, response)) => {
                assert_eq!(response.headers()["sec-websocket-protocol"], protocol);
                Ok(Self(socket))
            }
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(response))) => {
                Err(String::from_utf8_lossy(response.body().as_deref().unwrap_or_default()).into_owned())
            }
            Err(error) => Err(error.to_string()),
        }
    }

    fn say(&mut self, text: &str) {
        self.0.send(Message::text(text)).unwrap();
    }

    /// The next message that `fits` makes something of.
    fn wait<T>(&mut self, what: &str, mut fits: impl FnMut(&Message) -> Option<T>) -> T {
        let begin = Instant::now();
        while begin.elapsed() < PATIENCE {
            let message = self.0.read().unwrap_or_else(|error| panic!("waiting for {what}: {error}"));
            if let Some(found) = fits(&message) {
                return found;
            }
        }
        panic!("{what} did not come");
    }

    fn wait_text(&mut self, op: &str) -> Value {
        self.wait(op, |message| {
            let Message::Text(text) = message else { return None };
            let text: Value = serde_json::from_str(text.as_str()).unwrap();
            (text["op"] == op).then_some(text)
        })
    }

    /// Calls a service: what it says, or why it failed.
    fn call(&mut self, service: u32, payload: &str) -> Result<Value, String> {
        let mut bytes = vec![2];
        for number in [service, 77, 4] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(b"json");
        bytes.extend_from_slice(payload.as_bytes());
        self.0.send(Message::binary(bytes)).unwrap();
        self.wait("an answer", |message| match message {
            Message::Binary(bytes) if bytes[0] == 3 => {
                assert_eq!(bytes[1..9], [service as u8, 0, 0, 0, 77, 0, 0, 0]);
                Some(Ok(serde_json::from_slice(&bytes[17..]).unwrap()))
            }
            Message::Text(text) if text.contains("serviceCallFailure") => {
                let text: Value = serde_json::from_str(text.as_str()).unwrap();
                Some(Err(text["message"].as_str().unwrap().to_owned()))
            }
            _ => None,
        })
    }
}

/// Fields of a protobuf message by number: whole numbers, doubles and parts as bytes.
fn fields(mut bytes: &[u8]) -> BTreeMap<u64, Vec<u8>> {
    fn varint(bytes: &mut &[u8]) -> u64 {
        let (mut value, mut shift) = (0, 0);
        loop {
            let (first, rest) = bytes.split_first().unwrap();
            (*bytes, value) = (rest, value | (u64::from(first & 0x7f) << shift));
            if first & 0x80 == 0 {
                return value;
            }
            shift += 7;
        }
    }
    let mut found = BTreeMap::new();
    while !bytes.is_empty() {
        let key = varint(&mut bytes);
        let content = match key & 7 {
            0 => varint(&mut bytes).to_le_bytes().to_vec(),
            1 => {
                let (content, rest) = bytes.split_at(8);
                bytes = rest;
                content.to_vec()
            }
            5 => {
                let (content, rest) = bytes.split_at(4);
                bytes = rest;
                content.to_vec()
            }
            2 => {
                let length = varint(&mut bytes) as usize;
                let (content, rest) = bytes.split_at(length);
                bytes = rest;
                content.to_vec()
            }
            other => panic!("wire type {other}"),
        };
        found.insert(key >> 3, content);
    }
    found
}

/// The content of a field by its name.
fn field(
    shape: &foretrace_record::proto::ProtoShape,
    message: &BTreeMap<u64, Vec<u8>>,
    name: &str,
) -> Vec<u8> {
    let number = 1 + shape.fields.iter().position(|(known, _)| *known == name).unwrap() as u64;
    message[&number].clone()
}

fn doubles(bytes: &[u8]) -> Vec<f64> {
    bytes.chunks(8).map(|eight| f64::from_le_bytes(eight.try_into().unwrap())).collect()
}

fn number(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes.try_into().unwrap())
}

/// Where the line of a `SceneUpdate` ends, if the message has one.
fn end_of_preview(message: &Message) -> Option<[f64; 2]> {
    // Entities of an update, lines of an entity, points of a line.
    const NUMBERS: [u64; 3] = [2, 11, 5];
    let Message::Binary(bytes) = message else { return None };
    let bytes = bytes.strip_prefix(&[1, 3, 0, 0, 0])?;
    let inside = |bytes: Vec<u8>, number: &u64| fields(&bytes).remove(number);
    let point = fields(&NUMBERS.iter().try_fold(bytes[8..].to_vec(), inside)?);
    Some([1, 2].map(|axis| doubles(&point[&axis])[0]))
}

/// The tick records of a recording, by number.
fn recorded(world: &World, name: &str) -> BTreeMap<u64, TickRecord> {
    let mut reader = RecordingReader::open(&world.file(name)).unwrap();
    let mut records = BTreeMap::new();
    while let Some(entry) = reader.next_entry().unwrap() {
        let RecordingEntry::Message(message) = entry else { continue };
        if let Content::Tick(record) = reader.content(&message).unwrap() {
            records.insert(record.tick, *record);
        }
    }
    records
}

#[test]
fn viewers_of_all_subprotocols_see_what_the_daemon_sent_beside_one_that_never_reads() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let _arm = world.armed_arm(0, &[]);
    let (server, _stdout, address, _) = server(&world);
    let recorder = world.start(0, &["record", "run.mcap"]);
    until("the recorder records", || world.file("run.mcap.part").exists().then_some(()));
    let mut shown = Vec::new();

    let mut never = Viewer::open(&address, "/", PROTOCOLS[1]).unwrap();
    never.say(r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":1},{"id":2,"channelId":2}]}"#);
    for protocol in PROTOCOLS {
        let mut viewer = Viewer::open(&address, "/", protocol).unwrap();
        let info = viewer.wait_text("serverInfo");
        assert!(info["capabilities"].as_array().unwrap().contains(&"services".into()), "{info}");
        let channels = viewer.wait_text("advertise");
        let channel = |topic: &str| {
            let all = channels["channels"].as_array().unwrap();
            all.iter().find(|channel| channel["topic"] == topic).unwrap()["id"].clone()
        };
        let subscriptions: Vec<Value> = [(5, "/tick"), (9, "/tf"), (11, "/scene")]
            .map(|(id, topic)| serde_json::json!({ "id": id, "channelId": channel(topic) }))
            .into();
        viewer.say(&serde_json::json!({ "op": "subscribe", "subscriptions": subscriptions }).to_string());
        let (mut seen, mut pens, mut links, mut scenes) = (Vec::new(), 0, 0, 0);
        while seen.len() < 300 || pens == 0 || links == 0 || scenes == 0 {
            let (subscription, bytes) = viewer.wait("a message of a topic", |message| match message {
                Message::Binary(bytes) if bytes[0] == 1 => {
                    Some((u32::from_le_bytes(bytes[1..5].try_into().unwrap()), bytes[13..].to_vec()))
                }
                _ => None,
            });
            let message = fields(&bytes);
            if subscription == 9 {
                let child = field(&FRAME_TRANSFORM, &message, "child_frame_id");
                pens += u32::from(child == b"pen");
                links += u32::from(child == b"arm_6");
                continue;
            }
            // Whoever comes later gets it too, and once.
            if subscription == 11 {
                let has = |name: &[u8]| bytes.windows(name.len()).any(|part| part == name);
                assert!(has(b"arm 6") && has(b"paper"), "{bytes:?}");
                scenes += 1;
                continue;
            }
            assert_eq!(subscription, 5);
            seen.push(number(&field(&TICK, &message, "tick")));
            shown.push(message);
        }
        assert!(seen.is_sorted_by(|a, b| a < b), "{protocol}: each once, in order");
        assert_eq!(scenes, 1, "{protocol}");
        viewer.say(r#"{"op":"unsubscribe","subscriptionIds":[5,9,11]}"#);
        let _ = viewer.0.close(None);
    }

    let mut viewer = Viewer::open(&address, "/", PROTOCOLS[1]).unwrap();
    viewer.say(r#"{"op":"subscribe","subscriptions":[{"id":3,"channelId":5}]}"#);
    let hand = world.start(0, &["play", "glyphs:Kx"]);
    let ends: Vec<[f64; 2]> = (0..20).map(|_| viewer.wait("a previewed path", end_of_preview)).collect();
    hand.end();

    let refused = Viewer::open(&address, "/", "foxglove.sdk.v2").err().unwrap();
    assert!(refused.contains("this server speaks foxglove.sdk.v1"), "{refused}");
    let refused = Viewer::open(&address, "/?token=0", PROTOCOLS[0]).err().unwrap();
    assert!(refused.contains("token"), "{refused}");
    let mut plain = TcpStream::connect(&address).unwrap();
    plain.write_all(format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes()).unwrap();
    let mut told = String::new();
    plain.read_to_string(&mut told).unwrap();
    assert!(told.starts_with("HTTP/1.1 426") && told.contains("Foxglove"), "{told}");

    server.end();
    recorder.end();
    daemon.end();
    let sent = recorded(&world, "run.mcap");
    let mut compared = 0;
    for message in shown {
        // A recorder on a busy machine may have lost one.
        let Some(record) = sent.get(&number(&field(&TICK, &message, "tick"))) else { continue };
        assert_eq!(doubles(&field(&TICK, &message, "q_rad")), record.q);
        assert_eq!(doubles(&field(&TICK, &message, "tool_m")), record.tool_m);
        assert_eq!(doubles(&field(&TICK, &message, "trust")), [record.trust]);
        assert_eq!(number(&field(&TICK, &message, "release_ns")), record.release_ns);
        compared += 1;
    }
    assert!(compared > 600, "{compared} of 900 were recorded");
    let known: Vec<[f64; 2]> =
        sent.values().filter_map(|record| record.path().last()).map(|end| end.map(f64::from)).collect();
    let told = ends.iter().filter(|end| known.contains(end)).count();
    assert!(told > 15, "{told} of 20 previewed paths end as one that was recorded: {ends:?}");
    let tally = json(&world.file("foxglove.json"));
    assert_eq!(tally["viewers"], 5, "{tally}");
    assert_eq!(tally["refused"]["another subprotocol"], 1, "{tally}");
    assert!(tally["sent"].as_u64() > Some(900), "{tally}");
    drop(never);
}

#[test]
fn anybody_stops_the_arm_and_only_the_token_arms_it_and_sets_parameters() {
    let world = World::new(PROGRAM);
    // Nothing but the guest stops the arm: a busy machine may hold up loop and arm for half a second.
    let patient = ["--set=safety.joint_state_timeout_ms=500", "--set=safety.latch_after_ms=500"];
    let daemon = world.daemon_with(0, &patient);
    let (server, _stdout, address, token) = server(&world);
    let mut guest = Viewer::open(&address, "/", PROTOCOLS[0]).unwrap();
    guest.wait_text("advertiseServices");
    let mut watcher = Viewer::open(&address, "/", PROTOCOLS[1]).unwrap();
    watcher.say(r#"{"op":"subscribe","subscriptions":[{"id":4,"channelId":3}]}"#);
    // The newest parameters come after it is subscribed.
    watcher.say(r#"{"op":"getParameters","parameterNames":[]}"#);
    watcher.wait_text("parameterValues");
    // Armed while the log is watched, so that no stop is missed.
    let _arm = world.armed_arm(0, &[]);
    let answer = guest.call(1, "{}").unwrap();
    assert!(answer["words"].as_str().unwrap().contains("the arm stops"), "{answer}");
    // On a busy machine a tick may be late, which is a line of its own.
    watcher.wait("the stop as a line of the log", |message| {
        let Message::Binary(bytes) = message else { return None };
        let line = (bytes[..5] == [1, 4, 0, 0, 0]).then(|| fields(&bytes[13..]))?;
        let words = String::from_utf8(field(&LOG, &line, "message")).unwrap();
        let requested = format!("stopped: {}", FaultReason::Requested);
        assert!(!words.starts_with("stopped: ") || words.starts_with(&requested), "{words}");
        words.starts_with(&requested).then_some(())
    });
    world.wait_for_mode(0, "stopped");
    for payload in ["{}", r#"{"token":"0123"}"#] {
        let refused = guest.call(2, payload).unwrap_err();
        assert!(refused.contains("token"), "{refused}");
    }
    assert_eq!(world.status(0)["mode"], "stopped");
    let set = r#"{"op":"setParameters","parameters":[{"name":"trust","value":0.25}],"id":"x"}"#;
    guest.say(set);
    let told = guest.wait_text("status");
    assert!(told["message"].as_str().unwrap().contains("token"), "{told}");
    assert_eq!(guest.wait_text("parameterValues")["id"], "x");

    let mut master = Viewer::open(&address, &format!("/?token={token}"), PROTOCOLS[1]).unwrap();
    let payload = format!(r#"{{"token":"{token}"}}"#);
    // The daemon may not be ready to arm at once.
    until("the arm is armed", || guest.call(2, &payload).ok().map(drop));
    // Without a pen trust stays 0, whatever was set; the daemon's answer tells.
    master.say(set);
    let answer = master.wait("an answer of the daemon", |message| {
        let text: Value = serde_json::from_str(message.to_text().ok()?).ok()?;
        (text["op"] == "status" || text["id"] == "x").then_some(text)
    });
    assert_eq!(answer["parameters"][0]["name"], "trust", "{answer}");
    master.say(r#"{"op":"setParameters","parameters":[{"name":"trust","value":2}]}"#);
    let refused = master.wait_text("status");
    assert!(refused["message"].as_str().unwrap().contains("from 0 to 1"), "{refused}");
    master.say(r#"{"op":"subscribeParameterUpdates","parameterNames":["predictor"]}"#);
    let value = |values: &Value, name: &str| {
        let all = values["parameters"].as_array().unwrap();
        all.iter().find(|one| one["name"] == name).map(|one| one["value"].clone())
    };
    master.say(r#"{"op":"setParameters","parameters":[{"name":"predictor","value":"hold"}],"id":"p"}"#);
    until("the predictor that was set", || {
        (value(&master.wait_text("parameterValues"), "predictor")? == "hold").then_some(())
    });
    assert_eq!(world.status(0)["predictor"]["name"], "hold");
    master.say(r#"{"op":"setParameters","parameters":[{"name":"predictor","value":"no-such"}]}"#);
    assert_eq!(master.wait_text("status")["level"], 2);

    server.end();
    daemon.end();
    let tally = json(&world.file("foxglove.json"));
    assert_eq!((&tally["stops"], &tally["refused"]["without the token"]), (&1.into(), &3.into()), "{tally}");
}

#[test]
fn without_a_place_for_the_settings_ticks_are_shown_and_the_arm_as_soon_as_there_is_one() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let _arm = world.armed_arm(0, &[]);
    let recorders = ["a.mcap", "b.mcap"].map(|name| {
        let recorder = world.start(0, &["record", name]);
        until("it records", || world.file(&format!("{name}.part")).exists().then_some(()));
        recorder
    });
    let (server, _stdout, address, _) = server(&world);
    let mut viewer = Viewer::open(&address, "/", PROTOCOLS[0]).unwrap();
    viewer.say(r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":1},{"id":4,"channelId":4}]}"#);
    let mut subscription = |wanted: u32| {
        viewer.wait("a message of a topic", |message| match message {
            Message::Binary(bytes) if bytes[0] == 1 => {
                let subscription = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                assert!(subscription == 1 || wanted == 4, "a scene without settings");
                (subscription == wanted).then_some(())
            }
            _ => None,
        });
    };
    (0..300).for_each(|_| subscription(1));
    for recorder in recorders {
        recorder.end();
    }
    subscription(4);
    let told = told(&server.end());
    assert!(told.contains("start `foretrace relay`"), "{told}");
    daemon.end();
}
