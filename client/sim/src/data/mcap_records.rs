//! The records of an MCAP file, one after the other, those of chunks as if they stood alone.
//!
//! Contract: any file that begins as MCAP gives its records up to the first damage, with what is wrong,
//! where, and how much is left out: with and without chunks, with and without a summary, cut short,
//! compressed with zstd, lz4, neither or some of all. Memory is bounded by the largest chunk and record.
//! Source: MCAP specification 0.

use std::io::{self, Read, Seek};
use std::ops::Range;

use mcap::records::op;

use super::foreign::not_mcap;
use super::mcap_chunk::{ChunkHead, Unpacked};

/// Bytes of a record outside of chunks at most; attachments and what nobody knows are passed over.
const LARGEST_RECORD: u64 = 64 << 20;
/// Bytes of a record's kind and length.
const HEAD: usize = 1 + size_of::<u64>();
/// Bytes by which a file of another kind is known.
pub(super) const SNIFFED: usize = 4096;

const NO_END: &str = "the file has no end";
const TORN_RECORD: &str = "the file ends in the middle of a record";
const TORN_CHUNK: &str = "the file ends in the middle of a chunk";

/// How a file ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum McapEnd {
    /// As its writer ended it.
    Whole,
    /// Too early, or damaged: after so many bytes of the file, for this reason; so many bytes behind them
    /// were not read.
    Cut { after: u64, why: String, left_out: u64 },
}

impl McapEnd {
    /// What is wrong and where, in words; `None`: nothing.
    #[must_use]
    pub fn damage(&self) -> Option<String> {
        match self {
            Self::Whole => None,
            Self::Cut { after, why, left_out: 0 } => Some(format!("after {after} bytes: {why}")),
            Self::Cut { after, why, left_out } => {
                Some(format!("after {after} bytes: {why}; the {left_out} bytes from there on are left out"))
            }
        }
    }
}

/// The chunk that is open; empty: none is.
#[derive(Debug, Default)]
struct OpenChunk {
    records: Vec<u8>,
    /// Where the last record begins, and the next one.
    last: usize,
    next: usize,
    /// Where the records begin in the file, if they are not compressed.
    plain_at: Option<u64>,
    /// The file ends in the middle of it.
    torn: bool,
}

/// The records of an MCAP file, as they are asked for.
pub struct McapRecords<R> {
    from: R,
    /// Bytes of all of `from`.
    length: u64,
    at: u64,
    /// Where the last record outside of chunks begins, chunks included.
    begin: u64,
    body: Vec<u8>,
    chunk: OpenChunk,
    /// Of all bytes so far; `None`: not all were seen, or chunks have their own.
    sum: Option<crc32fast::Hasher>,
    attachments: u64,
    end: Option<McapEnd>,
}

impl<R> std::fmt::Debug for McapRecords<R> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("McapRecords").field("at", &self.at).field("end", &self.end).finish_non_exhaustive()
    }
}

impl<R: Read + Seek> McapRecords<R> {
    /// Begins with a file of `length` bytes; the sentence says what it is instead of MCAP, and what to do.
    ///
    /// # Errors
    ///
    /// The disk fails.
    pub fn begin(mut from: R, length: u64) -> io::Result<Result<Self, String>> {
        let mut head = Vec::new();
        from.by_ref().take(SNIFFED as u64).read_to_end(&mut head)?;
        if let Some(why) = not_mcap(&head, length) {
            return Ok(Err(why));
        }
        let at = mcap::MAGIC.len() as u64;
        from.seek(io::SeekFrom::Start(at))?;
        let mut sum = crc32fast::Hasher::new();
        sum.update(mcap::MAGIC);
        let (body, chunk) = (Vec::new(), OpenChunk::default());
        Ok(Ok(Self { from, length, at, begin: at, body, chunk, sum: Some(sum), attachments: 0, end: None }))
    }

    /// Kind and body of the next record; `None` at the end.
    ///
    /// # Errors
    ///
    /// The disk fails. A damaged file is not an error: it ends.
    pub fn next_record(&mut self) -> io::Result<Option<(u8, &[u8])>> {
        while self.end.is_none() {
            if let Some((kind, body)) = self.next_in_chunk() {
                return Ok(Some((kind, self.chunk.records.get(body).unwrap_or_default())));
            }
            if self.end.is_none()
                && let Some(kind) = self.next_in_file()?
            {
                return Ok(Some((kind, &self.body)));
            }
        }
        Ok(None)
    }

    /// How the file ended, once it has.
    #[must_use]
    pub const fn end(&self) -> Option<&McapEnd> {
        self.end.as_ref()
    }

    /// Attachments that were passed over so far.
    #[must_use]
    pub const fn attachments(&self) -> u64 {
        self.attachments
    }

    /// Ends here: the record that came last cannot be used.
    pub fn refuse(&mut self, why: String) {
        let (after, why) = match self.chunk.plain_at {
            _ if self.chunk.records.is_empty() => (self.begin, why),
            Some(records) => (records + self.chunk.last as u64, why),
            None => {
                let (into, of) = (self.chunk.last, self.chunk.records.len());
                (self.begin, format!("{why}, {into} of {of} bytes into the records of a compressed chunk"))
            }
        };
        self.end = Some(McapEnd::Cut { after, why, left_out: self.length.saturating_sub(after) });
    }

    /// The file ends too early: nothing that is there is left out.
    fn ends_early(&mut self, why: &str) {
        let after = self.at.min(self.length.max(self.begin));
        self.end = Some(McapEnd::Cut { after, why: why.to_owned(), left_out: 0 });
    }

    /// Kind and place of the next record of the open chunk that is used; `None` at its end, or where it is
    /// damaged.
    fn next_in_chunk(&mut self) -> Option<(u8, Range<usize>)> {
        while self.chunk.next < self.chunk.records.len() {
            self.chunk.last = self.chunk.next;
            let Some((kind, length)) = self.chunk.records.get(self.chunk.next..).and_then(split) else {
                if !self.chunk.torn {
                    self.refuse("a record is longer than its chunk".to_owned());
                    return None;
                }
                break;
            };
            if kind == 0 {
                self.refuse(format!("a record of kind 0 with {length} bytes"));
                return None;
            }
            let begin = self.chunk.next + HEAD;
            self.chunk.next = begin + length;
            if is_used(kind) {
                return Some((kind, begin..self.chunk.next));
            }
        }
        if self.chunk.torn {
            self.ends_early(TORN_CHUNK);
        }
        self.chunk.records.clear();
        self.chunk.next = 0;
        None
    }

    /// Kind of the next record outside of chunks, which is in `body`; `None`: a chunk was opened, something
    /// was passed over, or the file ended.
    fn next_in_file(&mut self) -> io::Result<Option<u8>> {
        self.begin = self.at;
        let mut head = [0; HEAD];
        let came = self.fill(&mut head)?;
        if came < HEAD {
            self.ends_early(if came == 0 { NO_END } else { TORN_RECORD });
            return Ok(None);
        }
        let [kind, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        if kind == op::CHUNK {
            self.open_chunk(length)?;
            return Ok(None);
        }
        if kind == 0 || (is_used(kind) && length > LARGEST_RECORD) {
            self.refuse(format!(
                "a record of kind {kind} with {length} bytes, and {LARGEST_RECORD} are the most"
            ));
            return Ok(None);
        }
        self.attachments += u64::from(kind == op::ATTACHMENT);
        if !is_used(kind) && (self.sum.is_none() || length > LARGEST_RECORD) {
            self.pass_over(length)?;
            return Ok(None);
        }
        // Grows as the bytes come, whatever the length says.
        self.body.clear();
        let came = self.from.by_ref().take(length).read_to_end(&mut self.body)? as u64;
        self.at += came;
        if came < length {
            self.ends_early(TORN_RECORD);
            return Ok(None);
        }
        match kind {
            op::DATA_END => self.check_data(),
            op::FOOTER => {
                let mut end = [0; mcap::MAGIC.len()];
                if self.fill(&mut end)? == end.len() && end == *mcap::MAGIC {
                    self.end = Some(McapEnd::Whole);
                } else {
                    self.ends_early(NO_END);
                }
            }
            kind => {
                if let Some(sum) = &mut self.sum {
                    sum.update(&head);
                    sum.update(&self.body);
                }
                return Ok(Some(kind).filter(|kind| is_used(*kind)));
            }
        }
        Ok(None)
    }

    /// Opens a chunk of `length` bytes, of which the end may be missing.
    fn open_chunk(&mut self, length: u64) -> io::Result<()> {
        // Chunks have sums of their own.
        self.sum = None;
        let head = match ChunkHead::read(&mut self.from, length)? {
            None => {
                self.ends_early(TORN_CHUNK);
                return Ok(());
            }
            Some(Err(why)) => {
                self.refuse(why);
                return Ok(());
            }
            Some(Ok(head)) => head,
        };
        let records = self.at + head.bytes() as u64;
        self.at += length;
        let unpacked = head.unpack(&mut self.from, &mut self.chunk.records)?;
        (self.chunk.last, self.chunk.next) = (0, 0);
        self.chunk.plain_at = head.is_plain().then_some(records);
        self.chunk.torn = unpacked == Unpacked::Torn;
        match unpacked {
            Unpacked::Unusable(why) => {
                self.chunk.records.clear();
                self.refuse(why);
            }
            Unpacked::Torn if self.chunk.records.is_empty() => self.ends_early(TORN_CHUNK),
            Unpacked::Torn | Unpacked::Whole => {}
        }
        Ok(())
    }

    /// Compares the sum of all data with that in the record of their end, which is in `body`.
    fn check_data(&mut self) {
        let wanted = self.body.first_chunk().map_or(0, |sum| u32::from_le_bytes(*sum));
        let found = self.sum.take().map(crc32fast::Hasher::finalize);
        if wanted != 0 && found.is_some_and(|found| found != wanted) {
            let why = "the checksum of all before is wrong: some of it is damaged, nobody can tell where";
            self.end = Some(McapEnd::Cut { after: self.begin, why: why.to_owned(), left_out: 0 });
        }
    }

    /// Passes over `length` bytes, whatever they hold.
    fn pass_over(&mut self, length: u64) -> io::Result<()> {
        self.sum = None;
        let end = self.at.checked_add(length).filter(|end| *end <= self.length);
        let (Some(end), Ok(relative)) = (end, i64::try_from(length)) else {
            self.ends_early(TORN_RECORD);
            return Ok(());
        };
        self.from.seek_relative(relative)?;
        self.at = end;
        Ok(())
    }

    /// Fills `bytes` as far as the file goes; returns how many came.
    fn fill(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut came = 0;
        while let Some(room) = bytes.get_mut(came..).filter(|room| !room.is_empty()) {
            match self.from.read(room) {
                Ok(0) => break,
                Ok(count) => came += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        self.at += came as u64;
        Ok(came)
    }
}

/// Records that say something here; the rest repeats it, or is of others.
const fn is_used(kind: u8) -> bool {
    matches!(kind, op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA | op::DATA_END | op::FOOTER)
}

/// Kind of the record at the front of `bytes`, and bytes of its body; `None` if it is not all there.
fn split(bytes: &[u8]) -> Option<(u8, usize)> {
    let [kind, length @ ..] = *bytes.first_chunk::<HEAD>()?;
    let length = usize::try_from(u64::from_le_bytes(length)).ok()?;
    bytes.get(HEAD..HEAD.checked_add(length)?).map(|body| (kind, body.len()))
}
