//! UNIPEN 1.0 text to [`Recording`]: includes, ink components, `.DT` gaps and `.SEGMENT` lines.
//!
//! Only non-empty `.PEN_DOWN`/`.PEN_UP` blocks are components and are counted; a block that holds just `0 0`
//! counts. Columns other than X, Y and T are skipped; the time base is T in milliseconds, else
//! `.POINTS_PER_SECOND`. Of segments of several types the finest count: characters, else words, else lines;
//! ink of none of them is left out, which a remark counts.
//!
//! A file with `.SEGMENT DIGIT` is of UCI's pendigits set, which leaves its header file out: columns X Y, 100
//! Hz (assumed: its description says "100 milliseconds", which some 40 points per digit rule out), unit
//! unknown, and `.COMMENT label writer serial` below each segment. Writers are numbered again in each of its
//! files, so the file's extension goes before the number. Absent: several types of segments at once, writing
//! of UNIPEN. Source: Guyon et al., "UNIPEN project of on-line data exchange and recognizer benchmarks", ICPR
//! 1994.

mod text;
mod segment;

use crate::data::{Character, Component, FileError, Quantity, Recording, Remark, settle};
use foretrace_config::files::shortened_path;
use segment::{InkSegment, Levels, delimit, finest, is_character, parse_segment};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use text::{At, Statement, read_statements, resolve_include};

const INCLUDES_MAX: usize = 1000;
const INCLUDE_DEPTH_MAX: usize = 16;
const COORDINATE_MAX: f64 = 1e9;
// Real files hold counter overflows of 22 days; they are read, and shortened where a path is made of them.
const GAP_MAX_MS: f64 = 4_294_967_295.0;
// Milliseconds since 1970 are of the order of 1e12.
const TIME_MAX_MS: f64 = 1e15;
const SEGMENT_POINTS_MAX: usize = 20_000_000;
/// Overhead of a component, counted in points.
const COMPONENT_COST: usize = 4;
const BYTES_MAX: u64 = 256 << 20;
const PENDIGITS_RATE_HZ: f64 = 100.0;

/// Reads the bytes of a UNIPEN file at `path` and everything it includes.
///
/// `.INCLUDE a/b` is looked up as `include/a/b` beside each folder above the file (nearest first), then
/// beside the file itself.
///
/// # Errors
/// [`FileError`] with file, line and reason: unreadable file, missing, escaping or cyclic include,
/// unreadable or illegal number, missing `.COORD` or rate, malformed segment, segment out of range, no
/// characters, no points.
pub(crate) fn parse_unipen(bytes: &[u8], path: &Path) -> Result<Recording, FileError> {
    let mut ink = InkFile::default();
    ink.read_text(&text::text_of(bytes), path, path, &mut Vec::new())?;
    ink.finish(path)
}

/// Everything collected from the file and its includes, in order of appearance.
#[derive(Default)]
struct InkFile {
    /// Extension of the file, if it is of the pendigits set.
    pendigits: Option<String>,
    includes: usize,
    bytes: u64,
    columns: Option<Columns>,
    rate_hz: Option<f64>,
    /// The newest statement of the rate is none.
    no_rate: Option<FileError>,
    /// The first T \[ms\]: others count from it, since times since 1970 leave few digits to those between.
    begin_ms: Option<f64>,
    per_mm: [Option<f64>; 2],
    components: Vec<Component>,
    open: Option<Component>,
    gap_s: Option<f64>,
    segments: Vec<(At, InkSegment)>,
    /// Those of other types that could not be read: how many of each, and the first.
    malformed: BTreeMap<String, u64>,
    first_malformed: Option<FileError>,
    /// Types of segments, from coarse to fine.
    hierarchy: Vec<String>,
    /// Of the newest `.WRITER_ID`.
    writer: String,
}

/// Where x and y stand in a row of numbers.
#[derive(Clone, Copy)]
struct Columns {
    width: usize,
    x: usize,
    y: usize,
    t: Option<usize>,
}

impl InkFile {
    /// Takes the text of `path`, a file that `root` includes, or `root` itself.
    fn read_text(
        &mut self,
        text: &str,
        root: &Path,
        path: &Path,
        stack: &mut Vec<PathBuf>,
    ) -> Result<(), FileError> {
        self.bytes += text.len() as u64;
        if self.bytes > BYTES_MAX {
            let why = format!("the file has {} bytes; at most {BYTES_MAX} are read", self.bytes);
            return Err(FileError::whole(path, why));
        }
        stack.push(path.canonicalize().unwrap_or_else(|_| path.to_path_buf()));
        let statements = read_statements(text);
        if stack.len() == 1 && statements.iter().any(|s| s.keyword == ".SEGMENT" && s.first() == "DIGIT") {
            let extension = path.extension().map(|e| e.to_string_lossy().into_owned());
            self.pendigits = Some(extension.unwrap_or_default());
            self.columns = Some(Columns { width: 2, x: 0, y: 1, t: None });
        }
        for statement in statements {
            let at = At::new(path, statement.line);
            if statement.keyword == ".INCLUDE" {
                self.include(root, &statement, at, stack)?;
            } else {
                self.take(&statement, at)?;
            }
        }
        stack.pop();
        Ok(())
    }

    fn include(
        &mut self,
        root: &Path,
        statement: &Statement<'_>,
        at: At,
        stack: &mut Vec<PathBuf>,
    ) -> Result<(), FileError> {
        let wanted = statement.first();
        self.includes += 1;
        if self.includes > INCLUDES_MAX || stack.len() >= INCLUDE_DEPTH_MAX {
            return Err(at.fails(&format!(
                "more than {INCLUDES_MAX} includes, or nested deeper than {INCLUDE_DEPTH_MAX}"
            )));
        }
        let Some(file) = resolve_include(root, wanted).map_err(|why| at.fails(&why))? else {
            if self.pendigits.is_some() {
                return Ok(());
            }
            return Err(at.fails(&format!(
                "included file {:?} was not found below any include/ folder beside or above this file; keep the \
                 set's data/ and include/ folders together",
                shortened_path(wanted, 60)
            )));
        };
        if stack.contains(&file.canonicalize().unwrap_or_else(|_| file.clone())) {
            let wanted = shortened_path(wanted, 60);
            return Err(at.fails(&format!("include {wanted:?} is cyclic: that file is being read already")));
        }
        self.read_text(&text::text_of(&text::read_included(&file)?), root, &file, stack)
    }

    fn take(&mut self, statement: &Statement<'_>, at: At) -> Result<(), FileError> {
        match statement.keyword {
            ".COORD" => self.columns = Some(columns(statement).map_err(|why| at.fails(&why))?),
            // Where T tells the time no rate is needed.
            ".POINTS_PER_SECOND" => {
                let stated = positive(statement, &at);
                (self.rate_hz, self.no_rate) = (stated.as_ref().ok().copied(), stated.err());
            }
            ".X_POINTS_PER_MM" => self.per_mm[0] = Some(positive(statement, &at)?),
            ".Y_POINTS_PER_MM" => self.per_mm[1] = Some(positive(statement, &at)?),
            ".X_POINTS_PER_INCH" => self.per_mm[0] = Some(positive(statement, &at)? / 25.4),
            ".Y_POINTS_PER_INCH" => self.per_mm[1] = Some(positive(statement, &at)? / 25.4),
            ".PEN_DOWN" => self.pen(true, statement, &at)?,
            ".PEN_UP" => self.pen(false, statement, &at)?,
            ".DT" => self.gap(statement, &at)?,
            ".SEGMENT" => {
                let open = self.open.as_ref().is_some_and(|c| !c.points.is_empty());
                let begins = self.components.len() + usize::from(open);
                match parse_segment(statement, begins) {
                    Ok(mut segment) => {
                        segment.writer.clone_from(&self.writer);
                        self.segments.push((at, segment));
                    }
                    // Words and pages are seldom of use, and written in every way.
                    Err(why) if is_character(statement.first()) => return Err(at.fails(&why)),
                    Err(why) => {
                        *self.malformed.entry(text::shortened(statement.first())).or_default() += 1;
                        self.first_malformed.get_or_insert_with(|| at.fails(&why));
                    }
                }
            }
            ".HIERARCHY" => {
                self.hierarchy = statement.tokens().map(|(_, t)| t.to_ascii_uppercase()).collect();
            }
            ".WRITER_ID" => self.writer = text::shortened(statement.first()),
            ".COMMENT" => self.comment(statement),
            _ => {}
        }
        Ok(())
    }

    /// `.COMMENT label writer serial` of pendigits; other comments are ignored.
    fn comment(&mut self, statement: &Statement<'_>) {
        let (Some(extension), Some((_, segment))) = (&self.pendigits, self.segments.last_mut()) else {
            return;
        };
        let words: Vec<&str> = statement.tokens().map(|(_, t)| t).take(4).collect();
        if let [label, writer, _serial] = words[..]
            && label == segment.label
        {
            let dash = if extension.is_empty() { "" } else { "-" };
            segment.writer = text::shortened(&format!("{extension}{dash}{writer}"));
        }
    }

    /// Starts a new component; an empty one leaves no trace.
    fn pen(&mut self, contact: bool, statement: &Statement<'_>, at: &At) -> Result<(), FileError> {
        self.close();
        self.open = Some(Component { contact, ..Component::default() });
        self.points(statement.lines(), at)
    }

    /// Adds a gap; numbers on the lines below it are points of a new component with the pen as before.
    fn gap(&mut self, statement: &Statement<'_>, at: &At) -> Result<(), FileError> {
        let (line, value) = statement.tokens().next().unwrap_or((statement.line, ""));
        let ms = number(".DT", value, (0.0, GAP_MAX_MS), line, at)?;
        let contact = self.open.as_ref().map(|c| c.contact);
        self.close();
        self.gap_s = Some(self.gap_s.unwrap_or(0.0) + ms * 1e-3);
        if let Some(contact) = contact {
            self.open = Some(Component { contact, ..Component::default() });
        }
        self.points(statement.lines().skip_while(|&(l, _)| l <= line), at)
    }

    fn points<'t>(
        &mut self,
        lines: impl Iterator<Item = (usize, &'t str)>,
        at: &At,
    ) -> Result<(), FileError> {
        for (line, text) in lines {
            let mut row = text.split_whitespace().peekable();
            while row.peek().is_some() {
                let at = at.line(line);
                let columns = self
                    .columns
                    .ok_or_else(|| at.fails("points before .COORD: the order of the columns is unknown"))?;
                let mut point = [0.0; 2];
                let mut stamp_s = None;
                for column in 0..columns.width {
                    let Some(token) = row.next() else {
                        return Err(at.fails(&format!(
                            "a point has {} numbers (.COORD), the line ends after {column}",
                            columns.width
                        )));
                    };
                    for (value, index) in point.iter_mut().zip([columns.x, columns.y]) {
                        if index == column {
                            *value =
                                number("coordinate", token, (-COORDINATE_MAX, COORDINATE_MAX), line, &at)?;
                        }
                    }
                    if columns.t == Some(column) {
                        let ms = number("T", token, (-TIME_MAX_MS, TIME_MAX_MS), line, &at)?;
                        stamp_s = Some((ms - *self.begin_ms.get_or_insert(ms)) * 1e-3);
                    }
                }
                let open =
                    self.open.as_mut().ok_or_else(|| at.fails("points before any .PEN_DOWN or .PEN_UP"))?;
                open.points.push(point);
                open.stamps_s.extend(stamp_s);
            }
        }
        Ok(())
    }

    fn close(&mut self) {
        if let Some(mut component) = self.open.take().filter(|c| !c.points.is_empty()) {
            component.dt_before_s = self.gap_s.take();
            self.components.push(component);
        }
    }

    fn finish(mut self, path: &Path) -> Result<Recording, FileError> {
        self.close();
        let whole = At::new(path, 0);
        if self.components.is_empty() {
            return Err(whole.fails("no points: neither the file nor its includes have ink"));
        }
        let (chosen, mut remarks) = self.chosen(&whole)?;
        let units_per_m = match self.per_mm {
            [Some(x), Some(y)] => Some([x * 1e3, y * 1e3]),
            _ => None,
        };
        let mut budget = SEGMENT_POINTS_MAX;
        let mut segments = Vec::with_capacity(chosen.len());
        let mut taken = vec![false; self.components.len()];
        for (segment_index, (at, segment)) in chosen.into_iter().enumerate() {
            let components = segment.cut(&self.components, &mut budget).map_err(|why| at.fails(&why))?;
            segment.mark(&mut taken);
            // A file may name its writer below the segments too.
            let writer = if segment.writer.is_empty() { self.writer.clone() } else { segment.writer };
            segments.push(Character { label: segment.label, writer, segment_index, components });
        }
        let left = self.components.iter().zip(&taken).filter(|(c, taken)| !**taken && is_ink(c)).count();
        remarks.extend(Remark::counted(
            left as u64,
            "strokes belong to no .SEGMENT of those that are read, and are left out",
        ));
        let usual_hz = self.pendigits.as_ref().map(|_| PENDIGITS_RATE_HZ);
        let settled = settle(&mut segments, self.rate_hz.or(usual_hz)).map_err(|why| whole.fails(&why))?;
        let rate_assumed = self.rate_hz.is_none() && settled.is_none();
        let (stamped_hz, of_stamps) =
            settled.map_or((None, Vec::new()), |(c, remarks)| (Some(c.rate_hz), remarks));
        remarks.extend(of_stamps);
        if let Some(no_rate) = self.no_rate {
            if stamped_hz.is_none() {
                return Err(no_rate);
            }
            remarks.push(Remark::new(".POINTS_PER_SECOND is no rate and is not used: T counts"));
        }
        let rate_hz = stamped_hz.or(self.rate_hz).or(usual_hz).ok_or_else(|| {
            whole.fails(
                "no .POINTS_PER_SECOND, and no T in .COORD that rises: the time between points is unknown",
            )
        })?;
        Ok(Recording {
            source: path.to_path_buf(),
            rate_hz,
            rate_assumed,
            damage: None,
            units_per_m,
            quantity: Quantity::Position,
            segments,
            remarks,
        })
    }

    /// The segments that are read, each with its ink, and what of others was left out.
    fn chosen(&mut self, whole: &At) -> Result<ChosenSegments, FileError> {
        if self.segments.is_empty() {
            return Err(self.first_malformed.take().unwrap_or_else(|| {
                whole.fails("no .SEGMENT line, so nothing says where a character starts and ends")
            }));
        }
        let levels = Levels::new(&self.hierarchy);
        let (mut chosen, finest) = finest(std::mem::take(&mut self.segments), &levels);
        // Of coarser ones nothing would have been read.
        let lost = self.malformed.iter().filter(|(kind, _)| levels.of(&kind.to_ascii_uppercase()) <= finest);
        let lost = lost.map(|(_, count)| count).sum();
        let remarks = Remark::counted(lost, ".SEGMENT lines cannot be read, and are left out");
        let remarks = remarks.into_iter().collect();
        let inked: Vec<bool> = self.components.iter().map(is_ink).collect();
        delimit(&mut chosen, &inked);
        chosen.retain(|(_, segment)| segment.has_ink());
        if chosen.is_empty() {
            return Err(
                whole.fails("no ink in any .SEGMENT: each has neither a delimiter nor components beside it")
            );
        }
        Ok((chosen, remarks))
    }
}

/// With their lines, and what of others was left out.
type ChosenSegments = (Vec<(At, InkSegment)>, Vec<Remark>);

fn is_ink(component: &Component) -> bool {
    component.contact && !component.is_dummy()
}

fn columns(statement: &Statement<'_>) -> Result<Columns, String> {
    let names: Vec<&str> = statement.tokens().map(|(_, t)| t).collect();
    let find = |name: &str| names.iter().position(|n| n.eq_ignore_ascii_case(name));
    match (find("X"), find("Y")) {
        (Some(x), Some(y)) => Ok(Columns { width: names.len(), x, y, t: find("T") }),
        _ => Err(format!(".COORD must name X and Y, found {:?}", text::shortened(&names.join(" ")))),
    }
}

fn positive(statement: &Statement<'_>, at: &At) -> Result<f64, FileError> {
    let (line, token) = statement.tokens().next().unwrap_or((statement.line, ""));
    number("value", token, (1e-3, 1e6), line, at)
}

fn number(what: &str, token: &str, legal: (f64, f64), line: usize, at: &At) -> Result<f64, FileError> {
    let (low, high) = legal;
    let value: f64 = token
        .parse()
        .map_err(|_| at.line(line).fails(&format!("{:?} is not a number", text::shortened(token))))?;
    if (low..=high).contains(&value) {
        Ok(value)
    } else {
        Err(at.line(line).fails(&format!("{what} {value} is outside [{low}, {high}]")))
    }
}
