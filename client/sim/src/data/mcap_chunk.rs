//! The contents of a chunk of an MCAP file, whatever it is compressed with.
//!
//! Contract: sizes that a chunk claims are bounded and not believed: memory grows as the bytes come, and no
//! further than the claim. Decoders are pure Rust. A chunk whose end is missing gives what comes before.
//! Source: MCAP specification, "Chunk", "Compression formats"; RFC 8878 (zstd); LZ4 frame format 1.6.

use std::io::{self, Cursor, Read};

use lz4_flex::frame::FrameDecoder as Lz4Decoder;
use ruzstd::decoding::{BlockDecodingStrategy, StreamingDecoder};

use super::shortened;

/// Bytes of a chunk's records at most, and of the window of its compression, as the program `zstd` has it.
pub(super) const LARGEST_CHUNK: u64 = 128 << 20;
/// By how many bytes what cannot be compressed may grow.
const SLACK: u64 = 1 << 20;
/// What is read; bytes of the name of any compression at most.
const KNOWN: [&str; 3] = ["", "zstd", "lz4"];
const LONGEST_NAME: usize = 64;
/// Frames that carry nothing, in both formats: their marks, and the bytes of mark and length.
const SKIPPED_FRAMES: std::ops::RangeInclusive<u32> = 0x184D_2A50..=0x184D_2A5F;
/// Bytes of a chunk that are neither records nor the name of their compression.
const FIXED: usize = 40;
const MARK: usize = size_of::<u32>();

/// What stands in front of a chunk's records.
#[derive(Debug)]
pub(super) struct ChunkHead {
    /// Bytes of the records when they are not compressed, as the file claims.
    size: u64,
    /// CRC-32 of these; 0: none.
    sum: u32,
    compression: String,
    /// Bytes of the records as they stand in the file, as the file claims.
    packed: u64,
}

/// What a chunk holds, and what of it.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Unpacked {
    Whole,
    /// The file ends in the middle of it.
    Torn,
    /// It cannot be used, for this reason.
    Unusable(String),
}

impl ChunkHead {
    /// Takes it from the front of a chunk of `length` bytes; `Ok(None)`: the file ends here. The reason says
    /// why it cannot be used.
    ///
    /// # Errors
    ///
    /// The disk fails.
    pub(super) fn read(from: &mut impl Read, length: u64) -> io::Result<Option<Result<Self, String>>> {
        let short = || Ok(Some(Err("a chunk without a beginning".to_owned())));
        if length < FIXED as u64 {
            return short();
        }
        // Two times, the size, the sum, the length of the name.
        let mut fixed = [0; 32];
        if !filled(from, &mut fixed)? {
            return Ok(None);
        }
        let number = |at: usize| fixed.get(at..).and_then(|rest| rest.first_chunk::<4>());
        let number = |at: usize| number(at).map_or(0, |bytes| u32::from_le_bytes(*bytes));
        let size = u64::from(number(16)) | u64::from(number(20)) << 32;
        let (sum, named) = (number(24), number(28) as usize);
        if named as u64 > length - FIXED as u64 {
            return short();
        }
        if named > LONGEST_NAME {
            return Ok(Some(Err(format!("a chunk whose compression has a name of {named} bytes"))));
        }
        let (mut name, mut packed) = (vec![0; named], [0; 8]);
        if !filled(from, &mut name)? || !filled(from, &mut packed)? {
            return Ok(None);
        }
        // Other names are refused, so that its length is that in the file.
        let compression = String::from_utf8_lossy(&name).into_owned();
        let packed = u64::from_le_bytes(packed);
        if packed != length - FIXED as u64 - named as u64 {
            return Ok(Some(Err("a chunk of another length than it says".to_owned())));
        }
        let known = KNOWN.contains(&compression.as_str());
        if !known {
            return Ok(Some(Err(format!(
                "a chunk is compressed with {compression:?}, which is not read here (zstd, lz4 and none are); \
                 write the file anew with one of these, by the program that made it"
            ))));
        }
        let claimed = if compression.is_empty() { packed } else { size.max(packed.saturating_sub(SLACK)) };
        if claimed > LARGEST_CHUNK {
            return Ok(Some(Err(format!(
                "a chunk claims {claimed} bytes of records, and {LARGEST_CHUNK} are the most that are read; \
                 write the file anew with smaller chunks"
            ))));
        }
        Ok(Some(Ok(Self { size, sum, compression, packed })))
    }

    /// Bytes of the chunk before its records.
    pub(super) const fn bytes(&self) -> usize {
        FIXED + self.compression.len()
    }

    /// Whether the records stand in the file as they are.
    pub(super) const fn is_plain(&self) -> bool {
        self.compression.is_empty()
    }

    /// Reads the records that follow in `from` into `records`, and all of the chunk off `from`.
    ///
    /// # Errors
    ///
    /// The disk fails.
    pub(super) fn unpack(&self, from: &mut impl Read, records: &mut Vec<u8>) -> io::Result<Unpacked> {
        records.clear();
        let mut packed = from.take(self.packed);
        let decoded = match self.compression.as_str() {
            "zstd" => frames(&mut packed, |source| zstd_frame(source, self.size, records)),
            "lz4" => frames(&mut packed, |source| lz4_frame(source, self.size, records)),
            _ => packed.read_to_end(records).map(drop).map_err(|error| error.to_string()),
        };
        io::copy(&mut packed, &mut io::sink())?;
        // Its sum is that of all of it.
        if packed.limit() > 0 {
            return Ok(Unpacked::Torn);
        }
        if let Err(why) = decoded {
            return Ok(Unpacked::Unusable(why));
        }
        let came = records.len() as u64;
        if !self.is_plain() && came != self.size {
            let why = format!("a chunk holds {came} bytes of records, not {} as it says", self.size);
            return Ok(Unpacked::Unusable(why));
        }
        if self.sum != 0 && crc32fast::hash(records) != self.sum {
            return Ok(Unpacked::Unusable("the checksum of a chunk is wrong".to_owned()));
        }
        Ok(Unpacked::Whole)
    }
}

/// Fills `bytes`, unless `from` ends before.
fn filled(from: &mut impl Read, bytes: &mut [u8]) -> io::Result<bool> {
    match from.read_exact(bytes) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

/// Calls `decode` for one frame after the other until `packed` ends; frames that carry nothing are passed
/// over.
fn frames<R: Read>(
    packed: &mut R,
    mut decode: impl FnMut(&mut dyn Read) -> Result<(), String>,
) -> Result<(), String> {
    loop {
        let mut mark = Vec::with_capacity(MARK);
        packed.take(MARK as u64).read_to_end(&mut mark).map_err(|error| error.to_string())?;
        let Some(number) = mark.first_chunk().map(|mark| u32::from_le_bytes(*mark)) else {
            return if mark.is_empty() {
                Ok(())
            } else {
                Err("a chunk ends in the middle of a frame".to_owned())
            };
        };
        if SKIPPED_FRAMES.contains(&number) {
            let mut length = [0; MARK];
            packed.read_exact(&mut length).map_err(|error| error.to_string())?;
            let nothing = &mut packed.take(u64::from(u32::from_le_bytes(length)));
            io::copy(nothing, &mut io::sink()).map_err(|error| error.to_string())?;
        } else {
            decode(&mut Cursor::new(mark).chain(&mut *packed))?;
        }
    }
}

/// Appends what `decoder` gives to `records`, which get `size` bytes at most.
fn bounded(decoder: &mut impl Read, size: u64, records: &mut Vec<u8>) -> Result<(), String> {
    let room = size.saturating_sub(records.len() as u64);
    let came = decoder.take(room + 1).read_to_end(records);
    if records.len() as u64 > size {
        records.truncate(usize::try_from(size).unwrap_or(0));
        return Err(format!("a chunk holds more than the {size} bytes of records that it says"));
    }
    came.map(drop).map_err(|error| error.to_string())
}

fn zstd_frame(source: &mut dyn Read, size: u64, records: &mut Vec<u8>) -> Result<(), String> {
    let wrong = |why: &dyn std::fmt::Display| {
        format!("a chunk is no sound zstd: {}", shortened(&why.to_string(), 200))
    };
    let mut frame = StreamingDecoder::new_with_max_window_size(&mut *source, LARGEST_CHUNK)
        .map_err(|error| wrong(&error))?;
    let came = bounded(&mut frame, size, records).map_err(|why| wrong(&why));
    let mut decoder = frame.into_frame_decoder();
    if came.is_err() && (records.len() as u64) < size {
        // What is decoded waits for the end of its window. An empty last block, and a sum, end the frame.
        let end: [u8; 7] = [1, 0, 0, 0, 0, 0, 0];
        if decoder.decode_blocks(end.as_slice(), BlockDecodingStrategy::All).is_ok() {
            let _ = bounded(&mut decoder, size, records);
        }
        return came;
    }
    came?;
    match (decoder.get_checksum_from_data(), decoder.get_calculated_checksum()) {
        (Some(wanted), Some(found)) if wanted != found => Err(wrong(&"the checksum of its frame is wrong")),
        _ => Ok(()),
    }
}

fn lz4_frame(source: &mut dyn Read, size: u64, records: &mut Vec<u8>) -> Result<(), String> {
    let came = bounded(&mut Lz4Decoder::new(source), size, records);
    came.map_err(|why| format!("a chunk is no sound LZ4: {}", shortened(&why, 200)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lz4_flex::frame::{BlockMode, BlockSize, FrameEncoder, FrameInfo};
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};
    use std::io::Write as _;

    /// What the fixtures hold.
    fn text() -> Vec<u8> {
        (0..60).map(|k| format!("tick {k} at {} mm; ", k * 37 % 101)).collect::<String>().into_bytes()
    }

    /// [`text`] as the C libraries pack it: zstd at level 19 with a sum, lz4 with sum, size and linked
    /// blocks.
    const ZSTD: &str = "\
        28b52ffd642903ad0500824c1c11c0171b4e89767f6d905272cb4cd6fe590240601800fde2fd8ce59aba11a9c57b5829ff \
        af23cde75371c8d6971c5be87c7f2efbb857267a6b6ca732d2fae6c9ad654fc951a9a6d8b442fbc5579a9da5aa43661562 \
        c72c233dfdac4c68ba32229992d13a0010180620c02100021403710476a811f0f9fd33c05b0e108871f5b8b3feae3514b9 \
        8194abfe9e3603af760ff8d591e1aa1d0396a5feae296aaf760fee76b6424a8d281acde7f9fc649a2b0d9555fdeec86e";
    const LZ4: &str = "\
        04224d186c402904000000000000b1d2010000f1017469636b20302061742030206d6d3b20100010311000263337110010 \
        32110026373411001033110017313300103411001734330010351100173833001036110017323300103711001735330010 \
        3811001739330010391100173333001131aa00173634001231ac00069a001131ac001834350001ad001837350001ae0018 \
        31360001af001835360001b0001838360001b1001832360001b2001836360001b300173936001132b300173336001132b3 \
        00173736001132b40016368f001132b3001834350001b3001838350001b3001831360001b3001835360001b30018393600 \
        01b3001832360001b300173636001133b30027313037001133b400173337001133b4001837370001b5001639c6001133b4 \
        001834350001b4001838350001b4001831360001b4001835360001b4001839360001b400173236001134b4001736360011 \
        34b30016328f001134b2001833350001b2001837350001b3001831360001b3001834360001b3001838360001b300183236 \
        0001b3001835360001b300173936001135b300173336001135b300173636001135b4001635c5001135b3001834350001b3 \
        001837350001b3001831360001b3001835360001b3001838360001b3001832360001b300703632206d6d3b20000000007a \
        d2e996";

    fn bytes(hex: &str) -> Vec<u8> {
        let digits = hex.bytes().filter_map(|digit| char::from(digit).to_digit(16));
        let digits: Vec<u8> = digits.map(|digit| digit as u8).collect();
        digits.chunks(2).map(|pair| pair[0] << 4 | pair[1]).collect()
    }

    /// A chunk's body around `packed`.
    fn chunk(compression: &str, size: u64, sum: u32, packed: &[u8]) -> Vec<u8> {
        let mut body = vec![0; 16];
        body.extend(size.to_le_bytes());
        body.extend(sum.to_le_bytes());
        body.extend((compression.len() as u32).to_le_bytes());
        body.extend(compression.as_bytes());
        body.extend((packed.len() as u64).to_le_bytes());
        body.extend(packed);
        body
    }

    /// What is made of the first `there` bytes of a chunk, and its records.
    fn read(body: &[u8], there: usize) -> (Result<Unpacked, String>, Vec<u8>) {
        let mut records = b"left over".to_vec();
        let followed = [&body[..there], b"next"].concat();
        let whole = there == body.len();
        let mut from = if whole { followed.as_slice() } else { &body[..there] };
        let unpacked = match ChunkHead::read(&mut from, body.len() as u64).unwrap() {
            None => return (Ok(Unpacked::Torn), Vec::new()),
            Some(Err(why)) => return (Err(why), Vec::new()),
            Some(Ok(head)) => head.unpack(&mut from, &mut records).unwrap(),
        };
        assert_eq!(from, if whole { b"next".as_slice() } else { b"" }, "not all of the chunk is taken");
        (Ok(unpacked), records)
    }

    #[test]
    fn what_the_libraries_in_c_packed_is_unpacked_and_every_wrong_bit_is_told() {
        let (text, sum) = (text(), crc32fast::hash(&text()));
        for (compression, packed) in [("zstd", bytes(ZSTD)), ("lz4", bytes(LZ4)), ("", text.clone())] {
            let size = text.len() as u64;
            let body = chunk(compression, size, sum, &packed);
            assert_eq!(read(&body, body.len()), (Ok(Unpacked::Whole), text.clone()), "{compression}");
            if !compression.is_empty() {
                // Several frames, some of them without content.
                let nothing = [&0x184D_2A53_u32.to_le_bytes()[..], &3_u32.to_le_bytes(), b"abc"].concat();
                let twice = [&packed[..], &nothing, &packed, &nothing].concat();
                let body = chunk(compression, 2 * size, 0, &twice);
                assert_eq!(read(&body, body.len()), (Ok(Unpacked::Whole), text.repeat(2)), "{compression}");
                // Without a sum of the chunk, those of the compression count.
                let mut wrong = packed.clone();
                let last = wrong.len() - 1;
                wrong[last] ^= 1;
                let body = chunk(compression, size, 0, &wrong);
                assert!(matches!(read(&body, body.len()).0, Ok(Unpacked::Unusable(_))), "{compression}");
            }
            for at in 0..packed.len() {
                let mut wrong = packed.clone();
                wrong[at] ^= 0x10;
                let body = chunk(compression, size, sum, &wrong);
                let (unpacked, records) = read(&body, body.len());
                // Some bits of a head change nothing.
                assert!(unpacked != Ok(Unpacked::Whole) || records == text, "{compression}: byte {at}");
                assert!(unpacked != Ok(Unpacked::Torn), "{compression}: byte {at}");
            }
        }
    }

    #[test]
    fn a_torn_chunk_gives_what_comes_before_the_tear() {
        for compression in ["zstd", "lz4", ""] {
            let text = text().repeat(400);
            let packed = match compression {
                "zstd" => compress_to_vec(&text[..], CompressionLevel::Fastest),
                "lz4" => {
                    let info = FrameInfo::new().block_size(BlockSize::Max64KB).block_mode(BlockMode::Linked);
                    let mut to = FrameEncoder::with_frame_info(info, Vec::new());
                    to.write_all(&text).unwrap();
                    to.finish().unwrap()
                }
                _ => text.clone(),
            };
            let body = chunk(compression, text.len() as u64, crc32fast::hash(&text), &packed);
            assert_eq!(read(&body, body.len()), (Ok(Unpacked::Whole), text.clone()));
            let mut most = 0;
            for there in (0..body.len()).step_by(body.len() / 50) {
                let (unpacked, records) = read(&body, there);
                assert_eq!(unpacked, Ok(Unpacked::Torn), "{compression} at {there}");
                assert!(text.starts_with(&records), "{compression} at {there}");
                most = most.max(records.len());
            }
            assert!(most > text.len() / 2, "{compression}: {most} of {} bytes", text.len());
        }
    }

    #[test]
    fn sizes_that_a_chunk_claims_are_bounded_and_not_believed() {
        let (text, packed) = (text(), bytes(ZSTD));
        let size = text.len() as u64;
        let told = |body: Vec<u8>| match read(&body, body.len()) {
            (Err(why) | Ok(Unpacked::Unusable(why)), records) => (why, records.len() as u64),
            other => panic!("{other:?}"),
        };
        for (claimed, words) in [
            (size - 1, "more than the 1064 bytes"),
            (0, "more than the 0 bytes"),
            (size + 1, "holds 1065 bytes of records, not 1066"),
            (LARGEST_CHUNK, "holds 1065 bytes of records, not 134217728"),
        ] {
            let (why, held) = told(chunk("zstd", claimed, 0, &packed));
            assert!(why.contains(words) && held <= size, "{why}, {held} bytes");
        }
        for claimed in [LARGEST_CHUNK + 1, u64::MAX] {
            let (why, _) = told(chunk("zstd", claimed, 0, &packed));
            assert!(why.contains("134217728 are the most") && why.contains("smaller chunks"), "{why}");
        }
        // A gigabyte of one letter, in blocks of a few bytes, each of 128 KB.
        let mut bomb = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x58];
        for _ in 0..8192 {
            let head: u32 = (1 << 17) << 3 | 1 << 1;
            bomb.extend(&head.to_le_bytes()[..3]);
            bomb.push(b'x');
        }
        let (why, held) = told(chunk("zstd", 1 << 20, 0, &bomb));
        assert!(why.contains("more than the 1048576 bytes") && held <= 1 << 20, "{why}");
        for (compression, words) in [
            ("br", "\"br\", which is not read here (zstd, lz4 and none are)"),
            (&"x".repeat(65), "a name of 65 bytes"),
        ] {
            let (why, _) = told(chunk(compression, size, 0, &packed));
            assert!(why.contains(words), "{why}");
        }
        for (compression, sum, packed, words) in [
            ("lz4", 0, &packed, "no sound LZ4"),
            ("zstd", 0, &text, "no sound zstd"),
            ("", 1, &text, "checksum"),
        ] {
            let (why, _) = told(chunk(compression, size, sum, packed));
            assert!(why.contains(words), "{why}");
        }
        for compression in ["", "zstd", "lz4"] {
            let body = chunk(compression, 0, 0, &[]);
            assert_eq!(read(&body, body.len()), (Ok(Unpacked::Whole), Vec::new()), "{compression}");
        }
    }
}
