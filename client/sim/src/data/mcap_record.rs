//! Records of MCAP files, with every length that they claim checked before the parser believes it.
//!
//! Contract: the only place that hands bytes to `mcap::parse_record`, which reserves memory for a text of any
//! claimed length. Any bytes give a record or a sentence; memory is bounded by the record's own bytes.
//! *Source*: the MCAP specification, "Records".

use mcap::records::{Record, op};

/// Entries of a map at most: a recorder writes some tens.
const ENTRIES_MAX: usize = 4096;

/// A part of a record's body.
enum BodyPart {
    Fixed(usize),
    /// A text behind its length.
    Text(&'static str),
    /// Bytes behind their length.
    Bytes(&'static str),
    /// The same, with a length of eight bytes.
    LongBytes(&'static str),
    /// Pairs of texts behind the length of all.
    Map(&'static str),
    /// Entries of so many bytes behind the length of all.
    List(&'static str, usize),
}

/// Name and parts of a kind of record; further bytes may follow. `None`: the parser does not look into it.
fn parts(kind: u8) -> Option<(&'static str, &'static [BodyPart])> {
    use BodyPart::{Bytes, Fixed, List, LongBytes, Map, Text};
    Some(match kind {
        op::HEADER => ("header", &[Text("profile"), Text("library")]),
        op::FOOTER => ("footer", &[Fixed(20)]),
        op::SCHEMA => ("schema", &[Fixed(2), Text("name"), Text("encoding"), Bytes("data")]),
        op::CHANNEL => ("channel", &[Fixed(4), Text("topic"), Text("encoding"), Map("metadata")]),
        op::MESSAGE => ("message", &[Fixed(22)]),
        op::CHUNK => ("chunk", &[Fixed(28), Text("compression"), LongBytes("records")]),
        op::MESSAGE_INDEX => ("message index", &[Fixed(2), List("entries", 16)]),
        op::CHUNK_INDEX => {
            ("chunk index", &[Fixed(32), List("offsets", 10), Fixed(8), Text("compression"), Fixed(16)])
        }
        op::ATTACHMENT => {
            ("attachment", &[Fixed(16), Text("name"), Text("media type"), LongBytes("data"), Fixed(4)])
        }
        op::ATTACHMENT_INDEX => ("attachment index", &[Fixed(40), Text("name"), Text("media type")]),
        op::STATISTICS => ("statistics record", &[Fixed(42), List("counts", 10)]),
        op::METADATA => ("metadata record", &[Text("name"), Map("entries")]),
        op::METADATA_INDEX => ("metadata index", &[Fixed(16), Text("name")]),
        op::SUMMARY_OFFSET => ("summary offset", &[Fixed(17)]),
        op::DATA_END => ("end of data", &[Fixed(4)]),
        _ => return None,
    })
}

/// The record of this kind and body.
///
/// # Errors
/// What is wrong with it, in a sentence: a length beyond its end, too many entries, a text that is not UTF-8.
pub fn parse_mcap_record(kind: u8, body: &[u8]) -> Result<Record<'_>, String> {
    check(kind, body)?;
    mcap::parse_record(kind, body).map_err(|error| error.to_string())
}

fn check(kind: u8, body: &[u8]) -> Result<(), String> {
    let Some((record, parts)) = parts(kind) else { return Ok(()) };
    let mut rest = body;
    for part in parts {
        let overlong = |(what, claimed, left): WrongLength| {
            format!("a {record} whose {what} would have {claimed} bytes, and {left} are left")
        };
        match *part {
            BodyPart::Fixed(bytes) => {
                let short = || format!("a {record} of {} bytes, which is too short", body.len());
                rest = rest.get(bytes..).ok_or_else(short)?;
            }
            BodyPart::Text(what) | BodyPart::Bytes(what) => {
                sized::<4>(&mut rest, what).map_err(overlong)?;
            }
            BodyPart::LongBytes(what) => {
                sized::<8>(&mut rest, what).map_err(overlong)?;
            }
            BodyPart::List(what, entry) => {
                let list = sized::<4>(&mut rest, what).map_err(overlong)?;
                if !list.len().is_multiple_of(entry) {
                    return Err(format!(
                        "a {record} whose {what} have {} bytes, not {entry} each",
                        list.len()
                    ));
                }
            }
            BodyPart::Map(what) => {
                let (mut map, mut entries) = (sized::<4>(&mut rest, what).map_err(overlong)?, 0);
                while !map.is_empty() {
                    for what in ["key", "value"] {
                        sized::<4>(&mut map, what).map_err(overlong)?;
                    }
                    entries += 1;
                    if entries > ENTRIES_MAX {
                        return Err(format!("a {record} of more than {ENTRIES_MAX} {what}"));
                    }
                }
            }
        }
    }
    Ok(())
}

/// What is too long, how many bytes it claims, how many there are.
type WrongLength = (&'static str, u64, usize);

/// Takes a part behind its length, of `N` bytes, off the front of `rest`.
fn sized<'a, const N: usize>(rest: &mut &'a [u8], what: &'static str) -> Result<&'a [u8], WrongLength> {
    let (length, after) = rest.split_first_chunk::<N>().ok_or((what, N as u64, rest.len()))?;
    let length = length.iter().rev().fold(0_u64, |number, byte| number << 8 | u64::from(*byte));
    let split = usize::try_from(length).ok().and_then(|length| after.split_at_checked(length));
    let (part, after) = split.ok_or((what, length, after.len()))?;
    *rest = after;
    Ok(part)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body of every kind: all fixed bytes zero, texts and lists with content.
    fn whole(parts: &[BodyPart]) -> Vec<u8> {
        let mut body = Vec::new();
        for part in parts {
            match *part {
                BodyPart::Fixed(bytes) => body.extend(vec![0; bytes]),
                BodyPart::Text(_) | BodyPart::Bytes(_) => body.extend([3, 0, 0, 0, b'a', b'b', b'c']),
                BodyPart::LongBytes(_) => body.extend([2, 0, 0, 0, 0, 0, 0, 0, 8, 9]),
                BodyPart::Map(_) => body.extend([10, 0, 0, 0, 1, 0, 0, 0, b'k', 1, 0, 0, 0, b'v']),
                BodyPart::List(_, entry) => {
                    body.extend((2 * entry as u32).to_le_bytes());
                    body.extend((0..2 * entry).map(|byte| (byte / entry) as u8));
                }
            }
        }
        body
    }

    #[test]
    fn every_kind_is_walked_as_the_parser_walks_it_and_every_cut_is_a_sentence() {
        let mut kinds = 0;
        for kind in 0..=u8::MAX {
            let Some((_, parts)) = parts(kind) else {
                assert!(matches!(parse_mcap_record(kind, b"x"), Ok(Record::Unknown { .. })));
                continue;
            };
            kinds += 1;
            let body = whole(parts);
            let parsed = parse_mcap_record(kind, &body);
            assert!(parsed.as_ref().is_ok_and(|record| record.opcode() == kind), "{kind}: {parsed:?}");
            // Where this walk ends, the parser ends: it takes nothing from behind.
            for cut in 0..body.len() {
                assert!(check(kind, &body[..cut]).is_err(), "{kind} cut at {cut}");
            }
        }
        assert_eq!(kinds, 15);
    }

    #[test]
    fn a_length_beyond_the_record_is_refused_before_memory_is_asked_for() {
        for kind in 0..=u8::MAX {
            let Some((record, parts)) = parts(kind) else { continue };
            let body = whole(parts);
            for at in 0..body.len() {
                let mut forged = body.clone();
                let end = (at + 4).min(forged.len());
                forged[at..end].fill(0xef);
                // Whatever is made of it, no more memory than its own bytes.
                if let Err(message) = parse_mcap_record(kind, &forged) {
                    assert!(message.len() < 300, "{record}: {message}");
                }
            }
        }
        // The 33 bytes of a file that asked for four gigabytes.
        let mut channel = vec![0; 4];
        channel.extend(0xefff_ffff_u32.to_le_bytes());
        channel.extend(*b"abc");
        let message = parse_mcap_record(op::CHANNEL, &channel).unwrap_err();
        assert_eq!(message, "a channel whose topic would have 4026531839 bytes, and 3 are left");
        let many: Vec<u8> = (0..5000_u32)
            .flat_map(|key| [&4_u32.to_le_bytes()[..], &key.to_le_bytes(), &0_u32.to_le_bytes()].concat())
            .collect();
        let body = [&0_u32.to_le_bytes()[..], &(many.len() as u32).to_le_bytes(), &many].concat();
        assert!(parse_mcap_record(op::METADATA, &body).unwrap_err().contains("more than 4096 entries"));
        // The parser itself would subtract with overflow.
        assert!(parse_mcap_record(op::ATTACHMENT, &[0; 35]).is_err());
    }
}
