//! MCAP files written anew as other programs would have written them: other chunks, other compression, no
//! chunks, no summary. The messages stay.

use std::collections::BTreeMap;
use std::io::Write as _;

use lz4_flex::frame::FrameEncoder;
use mcap::records::op;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

/// How the records are put into a file.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    /// Bytes of the records of a chunk, at least; `None`: no chunks.
    pub(crate) chunk: Option<usize>,
    /// Of the chunks, in turn.
    pub(crate) compression: &'static [&'static str],
    /// Checksums of chunks, or of the data.
    pub(crate) sums: bool,
    /// An attachment, a record that nobody knows and an empty chunk stand in between.
    pub(crate) extras: bool,
    /// Schemas and channels stand in every chunk again.
    pub(crate) repeated: bool,
}

impl Default for Layout {
    fn default() -> Self {
        Self { chunk: Some(1 << 16), compression: &["zstd"], sums: true, extras: false, repeated: false }
    }
}

fn record(kind: u8, body: &[u8]) -> Vec<u8> {
    [&[kind][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// Every kind of layout, by a name.
#[must_use]
pub(crate) fn layouts() -> BTreeMap<&'static str, Layout> {
    let of = Layout::default;
    BTreeMap::from([
        ("zstd", of()),
        ("lz4", Layout { compression: &["lz4"], ..of() }),
        ("plain", Layout { compression: &[""], ..of() }),
        ("mixed", Layout { compression: &["zstd", "", "lz4"], chunk: Some(5000), ..of() }),
        ("no-chunks", Layout { chunk: None, ..of() }),
        ("one-chunk", Layout { chunk: Some(usize::MAX), ..of() }),
        ("tiny-chunks", Layout { chunk: Some(1), compression: &["lz4"], ..of() }),
        ("no-sums", Layout { sums: false, compression: &["zstd", "lz4"], ..of() }),
        ("extras", Layout { extras: true, ..of() }),
        ("extras-no-chunks", Layout { extras: true, chunk: None, ..of() }),
        ("repeated", Layout { repeated: true, chunk: Some(9000), ..of() }),
    ])
}

/// A chunk around `records`.
#[must_use]
pub(crate) fn chunk(compression: &str, records: &[u8], sums: bool) -> Vec<u8> {
    let packed = match compression {
        "zstd" => compress_to_vec(records, CompressionLevel::Fastest),
        "lz4" => {
            let mut to = FrameEncoder::new(Vec::new());
            to.write_all(records).unwrap();
            to.finish().unwrap()
        }
        _ => records.to_vec(),
    };
    let sum = if sums { crc32fast::hash(records) } else { 0 };
    let mut body = vec![0; 16];
    body.extend((records.len() as u64).to_le_bytes());
    body.extend(sum.to_le_bytes());
    body.extend((compression.len() as u32).to_le_bytes());
    body.extend(compression.as_bytes());
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    record(op::CHUNK, &body)
}

/// The records of `file` before the end of its data, those of its chunks, which are not compressed, among
/// them.
fn records(file: &[u8]) -> Vec<(u8, &[u8])> {
    let (mut found, mut rest) = (Vec::new(), &file[mcap::MAGIC.len()..]);
    while let [kind, length @ ..] = rest {
        let (length, after) = length.split_first_chunk().unwrap();
        let (body, after) = after.split_at(u64::from_le_bytes(*length) as usize);
        match *kind {
            op::DATA_END => break,
            // Its records are those that follow.
            op::CHUNK => {
                rest = &rest[9 + 40..];
                continue;
            }
            kind => found.push((kind, body)),
        }
        rest = after;
    }
    found
}

/// `file`, whose chunks are not compressed, written anew.
#[must_use]
pub(crate) fn rewritten(file: &[u8], layout: &Layout) -> Vec<u8> {
    let mut to = mcap::MAGIC.to_vec();
    to.extend(record(op::HEADER, &[0; 8]));
    let (mut open, mut number, mut known) = (Vec::new(), 0, Vec::new());
    let mut close = |to: &mut Vec<u8>, open: &mut Vec<u8>| {
        to.extend(chunk(layout.compression[number % layout.compression.len()], open, layout.sums));
        if layout.extras {
            to.extend(record(0x87, b"of an extension"));
            to.extend(chunk(layout.compression[0], b"", layout.sums));
        }
        number += 1;
        open.clear();
    };
    if layout.extras {
        // Two times, name, type, length, data, sum.
        let attachment = [&[0; 16][..], &[0; 8], &5_u64.to_le_bytes(), b"hello", &[0; 4]].concat();
        to.extend(record(op::ATTACHMENT, &attachment));
    }
    for (kind, body) in records(file) {
        let is_data = matches!(kind, op::SCHEMA | op::CHANNEL | op::MESSAGE);
        if !is_data && kind != op::METADATA {
            continue;
        }
        match layout.chunk {
            Some(bytes) if is_data => {
                if layout.repeated && kind == op::MESSAGE && open.is_empty() {
                    open.extend(&known);
                } else if kind != op::MESSAGE {
                    known.extend(record(kind, body));
                }
                open.extend(record(kind, body));
                if open.len() >= bytes {
                    close(&mut to, &mut open);
                }
            }
            _ => to.extend(record(kind, body)),
        }
    }
    if !open.is_empty() {
        close(&mut to, &mut open);
    }
    let sum = if layout.sums { crc32fast::hash(&to) } else { 0 };
    to.extend(record(op::DATA_END, &sum.to_le_bytes()));
    to.extend(record(op::FOOTER, &[0; 20]));
    to.extend(mcap::MAGIC);
    to
}
