//! Claims about the client, against peers that answer with prepared bytes.

use std::net::TcpListener;
use std::thread::JoinHandle;

use super::*;
use crate::rtde::RtdeMessage;
use crate::rtde::frames::LARGEST;
use crate::rtde::value::FieldType;

const PATIENCE: Duration = Duration::from_secs(5);

/// A peer that reads one package, answers with the next of `answers`, and so on, then closes.
fn peer(answers: Vec<Vec<u8>>) -> (SocketAddr, JoinHandle<Vec<Vec<u8>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let thread = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut requests = Vec::new();
        for answer in answers {
            let mut header = [0; 3];
            stream.read_exact(&mut header).unwrap();
            let mut rest = vec![0; usize::from(u16::from_be_bytes([header[0], header[1]])) - 3];
            stream.read_exact(&mut rest).unwrap();
            requests.push([&header[..], &rest].concat());
            stream.write_all(&answer).unwrap();
        }
        requests
    });
    (address, thread)
}

fn reply(reply: &RtdeReply) -> Vec<u8> {
    reply.encode(ProtocolVersion::V2).unwrap()
}

#[test]
fn the_whole_conversation_and_the_newest_package_of_several() {
    let data = |value: f64| {
        reply(&RtdeReply::Data {
            recipe: Some(1),
            fields: [value.to_be_bytes(), (-value).to_be_bytes()].concat(),
        })
    };
    let warning = RtdeMessage { level: 2, text: "slow".to_owned(), source: "test".to_owned() };
    let version = ControllerVersion { major: 3, minor: 15, bugfix: 8, build: 1 };
    let (address, thread) = peer(vec![
        reply(&RtdeReply::Protocol(true)),
        [reply(&RtdeReply::Message(warning)), reply(&RtdeReply::ControllerVersion(version))].concat(),
        reply(&RtdeReply::Outputs {
            recipe: Some(1),
            answers: vec![FieldAnswer::Type(FieldType::Double); 2],
        }),
        reply(&RtdeReply::Inputs { recipe: 1, answers: vec![FieldAnswer::Type(FieldType::Int32)] }),
        [reply(&RtdeReply::Start(true)), data(1.0), data(2.0), data(3.0)].concat(),
        Vec::new(),
    ]);
    let mut client = RtdeClient::connect(address, PATIENCE).unwrap();
    assert_eq!(client.protocol(), ProtocolVersion::V2);
    assert_eq!(client.controller_version().unwrap(), version);
    client.set_up_outputs(&["timestamp", "speed_scaling"], 125.0).unwrap();
    let inputs = client.set_up_inputs(&["input_int_register_24"]).unwrap();
    client.start().unwrap();
    let package = client.receive(PATIENCE).unwrap().unwrap();
    assert_eq!(
        package,
        OutputPackage { values: vec![RtdeValue::Double(3.0), RtdeValue::Double(-3.0)], passed: 2 }
    );
    client.send(&inputs, &[RtdeValue::Int32(5)]).unwrap();
    assert!(matches!(
        client.send(&inputs, &[RtdeValue::Uint32(5)]),
        Err(RtdeError::Misfit(Misfit::Type { .. }))
    ));
    assert!(matches!(client.receive(PATIENCE), Err(RtdeError::Closed | RtdeError::Broken(_))));
    let requests = thread.join().unwrap();
    assert_eq!(requests[5], [0, 8, b'U', 1, 0, 0, 0, 5]);
}

#[test]
fn fields_that_cannot_be_had_are_named() {
    let types = |answers| reply(&RtdeReply::Inputs { recipe: 0, answers });
    let double = FieldAnswer::Type(FieldType::Double);
    let (address, thread) = peer(vec![
        reply(&RtdeReply::Protocol(true)),
        types(vec![double, FieldAnswer::InUse]),
        types(vec![FieldAnswer::NotFound, double]),
        types(vec![double]),
    ]);
    let mut client = RtdeClient::connect(address, PATIENCE).unwrap();
    let mut ask = || client.set_up_inputs(&["one", "two"]).unwrap_err().to_string();
    assert!(ask().contains("\"two\" is in use"));
    assert!(ask().contains("no field \"one\""));
    assert!(ask().contains("refused"));
    thread.join().unwrap();
}

#[test]
fn version_1_is_taken_where_2_is_refused() {
    let first = |reply: &RtdeReply| reply.encode(ProtocolVersion::V1).unwrap();
    let (address, thread) = peer(vec![
        first(&RtdeReply::Protocol(false)),
        first(&RtdeReply::Protocol(true)),
        first(&RtdeReply::Outputs { recipe: None, answers: vec![FieldAnswer::Type(FieldType::Double)] }),
        [
            first(&RtdeReply::Start(true)),
            first(&RtdeReply::Data { recipe: None, fields: 0.5f64.to_be_bytes().to_vec() }),
        ]
        .concat(),
    ]);
    let mut client = RtdeClient::connect(address, PATIENCE).unwrap();
    assert_eq!(client.protocol(), ProtocolVersion::V1);
    client.set_up_outputs(&["timestamp"], 125.0).unwrap();
    client.start().unwrap();
    assert_eq!(client.receive(PATIENCE).unwrap().unwrap().values, [RtdeValue::Double(0.5)]);
    // Without a frequency: version 1 has none.
    assert_eq!(thread.join().unwrap()[2], [&[0, 12, b'O'], &b"timestamp"[..]].concat());
}

#[test]
fn strangers_and_silence_are_told_apart() {
    let (address, thread) = peer(vec![b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec()]);
    let error = RtdeClient::connect(address, Duration::from_millis(300)).unwrap_err();
    assert!(matches!(error, RtdeError::Silent(_) | RtdeError::Closed | RtdeError::Wire(_)), "{error}");
    thread.join().unwrap();

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let silent = RtdeClient::connect(listener.local_addr().unwrap(), Duration::from_millis(50)).unwrap_err();
    assert!(matches!(silent, RtdeError::Silent(_)), "{silent}");
    let closed = listener.local_addr().unwrap();
    drop(listener);
    assert!(matches!(RtdeClient::connect(closed, PATIENCE).unwrap_err(), RtdeError::Connect(_)));
}

/// A server that sends `begin`, then `again` every few milliseconds for as long as somebody listens.
fn trickling(begin: Vec<u8>, again: Vec<u8>) -> (SocketAddr, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let thread = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut sent = stream.write_all(&begin);
        while sent.is_ok() {
            std::thread::sleep(Duration::from_millis(2));
            sent = stream.write_all(&again);
        }
    });
    (address, thread)
}

#[test]
fn lying_lengths_trickles_and_floods_end_in_time_and_within_one_package() {
    let patience = Duration::from_millis(300);
    let reported = RtdeMessage { level: 3, text: "x".repeat(255), source: "y".repeat(255) };
    let message = RtdeReply::Message(reported).encode(ProtocolVersion::V1).unwrap();
    for (begin, again) in [
        // The longest package there is, of which a byte comes now and then.
        (vec![0xff, 0xff, b'V'], vec![0]),
        // Sizes below the header.
        (vec![0, 0, b'V'], vec![0]),
        (vec![0, 2, b'V'], vec![0, 2, b'V']),
        // Messages without end, one by one and many at a time.
        (message.clone(), message.clone()),
        (Vec::new(), message.repeat(100)),
        // Whole packages that answer nothing.
        (Vec::new(), vec![0, 3, b'U', 0, 3, b'S']),
    ] {
        let (address, thread) = trickling(begin.clone(), again);
        let asked = Instant::now();
        let error = RtdeClient::connect(address, patience).unwrap_err();
        assert!(matches!(error, RtdeError::Silent(_) | RtdeError::Wire(_)), "{begin:?}: {error}");
        // Each of the two versions is waited for.
        assert!(asked.elapsed() < 2 * patience + Duration::from_secs(10), "{begin:?}");
        thread.join().unwrap();
    }
    // The same where a whole conversation came before: what is kept never exceeds a package.
    let hello = reply(&RtdeReply::Protocol(true));
    let (address, thread) = trickling([&hello[..], &[0xff, 0xff, b'U']].concat(), vec![0; 1000]);
    let mut client = RtdeClient::connect(address, Duration::from_secs(5)).unwrap();
    for _ in 0..100 {
        match client.receive(Duration::from_millis(5)) {
            Ok(None) => assert!(client.frames.waiting() < LARGEST, "{}", client.frames.waiting()),
            // The zeros behind the package are packages of size zero.
            Err(RtdeError::Wire(_)) => break,
            other => panic!("{other:?}"),
        }
    }
    drop(client);
    thread.join().unwrap();
}
