//! Claims about RTDE packages: bytes as the guide and clients write them, and bytes of nobody.

use super::*;
use crate::rtde::frames::{Frames, HEADER, LARGEST, RtdeWireError};
use proptest::prelude::*;

const V2: ProtocolVersion = ProtocolVersion::V2;

fn only(bytes: &[u8]) -> (u8, Vec<u8>) {
    let mut frames = Frames::default();
    frames.feed(bytes);
    let (kind, payload) = frames.next_package().unwrap().unwrap();
    (kind, payload.to_vec())
}

#[test]
fn protocol_request_has_the_bytes_of_the_guide() {
    assert_eq!(RtdeRequest::Protocol(2).encode(ProtocolVersion::V1).unwrap(), [0, 5, 86, 0, 2]);
    assert_eq!(RtdeReply::Protocol(true).encode(ProtocolVersion::V1).unwrap(), [0, 4, 86, 1]);
    let (kind, payload) = only(&[0, 5, 86, 0, 2]);
    assert_eq!(RtdeRequest::decode(kind, &payload, ProtocolVersion::V1), Ok(RtdeRequest::Protocol(2)));
}

#[test]
fn outputs_are_asked_for_with_a_frequency_from_version_2_on() {
    let names = vec!["timestamp".to_owned(), "actual_q".to_owned()];
    let bytes = RtdeRequest::Outputs { frequency: Some(125.0), names: names.clone() }.encode(V2).unwrap();
    let mut expected = vec![0, 29, b'O'];
    expected.extend_from_slice(&125f64.to_be_bytes());
    expected.extend_from_slice(b"timestamp,actual_q");
    assert_eq!(bytes, expected);
    let (kind, payload) = only(&bytes);
    assert_eq!(
        RtdeRequest::decode(kind, &payload, V2),
        Ok(RtdeRequest::Outputs { frequency: Some(125.0), names: names.clone() })
    );
    let (kind, payload) = only(&[&[0, 21, b'O'], &b"timestamp,actual_q"[..]].concat());
    assert_eq!(
        RtdeRequest::decode(kind, &payload, ProtocolVersion::V1),
        Ok(RtdeRequest::Outputs { frequency: None, names })
    );
}

#[test]
fn a_trailing_comma_names_nothing() {
    let names = |text: &[u8]| match RtdeRequest::decode(b'I', text, V2) {
        Ok(RtdeRequest::Inputs { names }) => names.len(),
        other => panic!("{other:?}"),
    };
    assert_eq!([names(b"a,b,c,"), names(b"a,b,c"), names(b"a"), names(b",")], [3, 3, 1, 0]);
    // An empty name amid the list stays, and will not be found.
    assert_eq!(names(b"a,,c"), 3);
}

#[test]
fn replies_come_back_in_both_versions() {
    let version = ControllerVersion { major: 5, minor: 11, bugfix: 1, build: 108_318 };
    let answers = vec![FieldAnswer::Type(FieldType::Vector6d), FieldAnswer::NotFound, FieldAnswer::InUse];
    for protocol in [ProtocolVersion::V1, V2] {
        let recipe = (protocol == V2).then_some(7);
        let source = if protocol == V2 { "RTDE".to_owned() } else { String::new() };
        for reply in [
            RtdeReply::Protocol(false),
            RtdeReply::ControllerVersion(version),
            RtdeReply::Message(RtdeMessage { level: 2, text: "careful".to_owned(), source }),
            RtdeReply::Outputs { recipe, answers: answers.clone() },
            RtdeReply::Inputs { recipe: 3, answers: answers.clone() },
            RtdeReply::Start(true),
            RtdeReply::Pause(true),
            RtdeReply::Data { recipe, fields: vec![1, 2, 3] },
        ] {
            let (kind, payload) = only(&reply.encode(protocol).unwrap());
            assert_eq!(RtdeReply::decode(kind, &payload, protocol), Ok(reply));
        }
    }
}

#[test]
fn a_message_in_version_2_has_two_lengths_and_its_level_last() {
    let message = RtdeMessage { level: 3, text: "ab".to_owned(), source: "c".to_owned() };
    let bytes = RtdeReply::Message(message).encode(V2).unwrap();
    assert_eq!(bytes, [0, 9, b'M', 2, b'a', b'b', 1, b'c', 3]);
    let long = RtdeMessage { level: 3, text: "é".repeat(200), source: String::new() };
    let (kind, payload) = only(&RtdeRequest::Message(long).encode(V2).unwrap());
    let Ok(RtdeRequest::Message(short)) = RtdeRequest::decode(kind, &payload, V2) else {
        panic!("no message")
    };
    assert_eq!(short.text, "é".repeat(127));
}

#[test]
fn packages_are_cut_out_of_any_pieces() {
    let packages = [
        RtdeRequest::Start.encode(V2).unwrap(),
        RtdeRequest::Data { recipe: 4, fields: vec![0; 300] }.encode(V2).unwrap(),
    ];
    let stream = packages.concat().repeat(3);
    for piece in [1, 2, 5, 299, stream.len()] {
        let mut frames = Frames::default();
        let mut sizes = Vec::new();
        for bytes in stream.chunks(piece) {
            frames.feed(bytes);
            while let Some((_, payload)) = frames.next_package().unwrap() {
                sizes.push(payload.len());
            }
            assert!(frames.waiting() < 304);
        }
        assert_eq!(sizes, [0, 301, 0, 301, 0, 301], "in pieces of {piece}");
    }
}

#[test]
fn a_size_below_the_header_is_refused() {
    let mut frames = Frames::default();
    frames.feed(&[0, 2, b'S', 0, 3, b'S']);
    assert_eq!(frames.next_package(), Err(RtdeWireError::Size(2)));
}

#[test]
fn what_does_not_fit_the_size_field_is_refused() {
    let fields = vec![0; LARGEST - HEADER];
    assert_eq!(RtdeRequest::Data { recipe: 1, fields }.encode(V2), Err(RtdeWireError::TooLong(LARGEST + 1)));
    assert!(RtdeReply::Data { recipe: Some(1), fields: vec![0; LARGEST - HEADER - 1] }.encode(V2).is_ok());
}

proptest! {
    #![proptest_config(crate::fuzz::cases(2000))]

    #[test]
    fn any_payload_is_read_or_refused(
        kind in prop_oneof![any::<u8>(), prop::sample::select(&b"VvMUOISP"[..])],
        payload in prop::collection::vec(any::<u8>(), 0..200), second in any::<bool>())
    {
        let version = if second { V2 } else { ProtocolVersion::V1 };
        if let Ok(request) = RtdeRequest::decode(kind, &payload, version) {
            prop_assert!(request.encode(version).is_ok());
        }
        if let Ok(reply) = RtdeReply::decode(kind, &payload, version) {
            prop_assert!(reply.encode(version).is_ok());
        }
    }

    #[test]
    fn any_stream_ends(bytes in prop::collection::vec(any::<u8>(), 0..2000), piece in 1usize..100) {
        let mut frames = Frames::default();
        'stream: for piece in bytes.chunks(piece) {
            frames.feed(piece);
            loop {
                match frames.next_package() {
                    Ok(Some(_)) => {}
                    Ok(None) => break,
                    Err(_) => break 'stream,
                }
            }
            prop_assert!(frames.waiting() < LARGEST);
        }
    }
}
