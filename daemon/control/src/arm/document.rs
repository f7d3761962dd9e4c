//! The part of a robot description that this project uses, cut out of its XML and written anew for the parser
//! of URDF.
//!
//! Contract: what is not used (materials, transmissions, blocks of simulators and controllers, elements with
//! prefixes, comments) is left out unread: it only has to be balanced. What is left is plain, bounded and
//! shallow, and every link and joint knows its line. One reader of XML decides what is an element and what a
//! comment; it is a loop.

use quick_xml::escape::escape;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;

use super::chain_error::ChainError;

/// Longest description \[bytes\]: a hundred times that of a UR.
pub const LONGEST_BYTES: usize = 4 << 20;
/// Elements inside each other at most; URDF has six, with what simulators add a dozen.
const DEEPEST: usize = 64;
/// Elements that are used at most: fifty times those of a UR.
const MOST_ELEMENTS: usize = 20_000;
/// Longest attribute that is used \[bytes\]: an error may show it.
const LONGEST_ATTRIBUTE: usize = 1000;
/// Characters of the reader's own message at most: it may quote the file.
pub(super) const LONGEST_REASON: usize = 400;

/// An element that is used, with the attributes and children of it that are.
struct Element {
    name: &'static str,
    attributes: &'static [&'static str],
    /// Written where the element has none.
    given: &'static [(&'static str, &'static str)],
    children: &'static [&'static Element],
}

const fn element(
    name: &'static str,
    attributes: &'static [&'static str],
    children: &'static [&'static Element],
) -> Element {
    Element { name, attributes, given: &[], children }
}

static ORIGIN: Element = element("origin", &["xyz", "rpy", "quat_xyzw"], &[]);
static PARENT: Element = element("parent", &["link"], &[]);
static CHILD: Element = element("child", &["link"], &[]);
static AXIS: Element = element("axis", &["xyz"], &[]);
static DYNAMICS: Element = element("dynamics", &["damping", "friction"], &[]);
static MIMIC: Element = element("mimic", &["joint"], &[]);
/// A limit that is missing is judged with the joint's other numbers.
const NO_LIMIT: &[(&str, &str)] = &[("velocity", "0")];
static LIMIT: Element =
    Element { given: NO_LIMIT, ..element("limit", &["lower", "upper", "velocity", "effort"], &[]) };
static ENDLESS: Element = Element { given: NO_LIMIT, ..element("limit", &["velocity", "effort"], &[]) };
const JOINT: &[&str] = &["name", "type"];
static FIXED: Element = element("joint", JOINT, &[&ORIGIN, &PARENT, &CHILD]);
static CONTINUOUS: Element =
    element("joint", JOINT, &[&ORIGIN, &PARENT, &CHILD, &AXIS, &ENDLESS, &DYNAMICS, &MIMIC]);
static MOVING: Element =
    element("joint", JOINT, &[&ORIGIN, &PARENT, &CHILD, &AXIS, &LIMIT, &DYNAMICS, &MIMIC]);

static BOX: Element = element("box", &["size"], &[]);
static CYLINDER: Element = element("cylinder", &["radius", "length"], &[]);
static CAPSULE: Element = element("capsule", &["radius", "length"], &[]);
static SPHERE: Element = element("sphere", &["radius"], &[]);
static MESH: Element = element("mesh", &["filename", "scale"], &[]);
/// Where no file is opened, that a shape is a mesh is all that counts.
static ANY_MESH: Element = Element { given: &[("filename", "")], ..element("mesh", &[], &[]) };
static GEOMETRY: Element = element("geometry", &[], &[&BOX, &CYLINDER, &CAPSULE, &SPHERE, &ANY_MESH]);
static FILES: Element = element("geometry", &[], &[&BOX, &CYLINDER, &CAPSULE, &SPHERE, &MESH]);
static MASS: Element = element("mass", &["value"], &[]);
static INERTIA: Element = element("inertia", &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"], &[]);
static INERTIAL: Element = element("inertial", &[], &[&ORIGIN, &MASS, &INERTIA]);
static COLLISION: Element = element("collision", &[], &[&ORIGIN, &GEOMETRY]);
static COLLISION_FILES: Element = element("collision", &[], &[&ORIGIN, &FILES]);
static VISUAL_FILES: Element = element("visual", &[], &[&ORIGIN, &FILES]);
static LINK: Element = element("link", &["name"], &[&INERTIAL, &COLLISION]);
static LINK_FILES: Element = element("link", &["name"], &[&COLLISION_FILES, &VISUAL_FILES]);
/// Its name is not used.
static ROBOT: Element = element("robot", &["version"], &[]);

/// What is wrong with a part of a description.
#[derive(Debug, Clone)]
pub(super) struct PieceFault {
    pub(super) line: usize,
    pub(super) reason: String,
}

impl PieceFault {
    /// For a message that names line `line` already.
    pub(super) fn told_from(&self, line: usize) -> String {
        let reason = &self.reason;
        if self.line == line { reason.clone() } else { format!("line {}: {reason}", self.line) }
    }
}

/// A link or joint, written anew.
#[derive(Debug, Default)]
pub(super) struct Piece {
    /// Empty where it has none that can be used; then there is a fault.
    pub(super) name: String,
    pub(super) line: usize,
    /// The first attribute that cannot be used.
    pub(super) fault: Option<PieceFault>,
    /// The same in its inertials.
    pub(super) inertial_fault: Option<PieceFault>,
    visual_fault: Option<PieceFault>,
    /// Its start tag and its children, without its end tag and without inertials.
    pub(super) text: String,
    /// Of a link; each is an element of its own.
    pub(super) inertials: Vec<String>,
    visuals: String,
    /// Of a joint: type, parent and child, as far as there are any.
    pub(super) kind: String,
    pub(super) parent: Option<String>,
    pub(super) child: Option<String>,
    /// How many of either there are.
    ends: [usize; 2],
}

/// The links and joints of a description, in the order of the file.
#[derive(Debug, Default)]
pub(super) struct Document {
    /// The start tag of the root.
    pub(super) head: String,
    /// Where the root begins, from 1.
    pub(super) line: usize,
    pub(super) links: Vec<Piece>,
    pub(super) joints: Vec<Piece>,
}

/// Reads a description; with `files` also the visuals of links without collision geometry, and the names of
/// mesh files.
///
/// # Errors
/// Beyond a bound, not XML, another root than `<robot>`, or a xacro file.
pub(super) fn document(text: &str, files: bool) -> Result<Document, ChainError> {
    if text.len() > LONGEST_BYTES {
        return Err(ChainError::Bound { what: "bytes", line: None, found: text.len(), most: LONGEST_BYTES });
    }
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut reader = Reader::from_str(text);
    // In text that is not used; in attributes it is refused where they are used.
    reader.config_mut().allow_dangling_amp = true;
    let mut lines = Lines { text, at: 0, line: 1 };
    let mut cut = Cut { files, ..Cut::default() };
    loop {
        let at = reader.buffer_position() as usize;
        let event = match reader.read_event() {
            Ok(event) => event,
            Err(error) => {
                return Err(malformed(lines.at(reader.error_position() as usize), error.to_string()));
            }
        };
        match event {
            Event::Start(tag) => cut.start(&tag, lines.at(at))?,
            Event::Empty(tag) => {
                cut.start(&tag, lines.at(at))?;
                cut.end();
            }
            Event::End(_) => cut.end(),
            Event::Text(words) if cut.depth == 0 && !words.iter().all(u8::is_ascii_whitespace) => {
                let reason = if words.trim_ascii_start().starts_with(b"version https://git-lfs") {
                    "it is a pointer of Git LFS, not the file itself: get that with `git lfs pull`"
                } else {
                    "there is text where <robot> should begin"
                };
                return Err(malformed(lines.at(at), reason.to_owned()));
            }
            Event::Eof => {
                let reason = match cut.depth {
                    0 => "there is no element <robot>".to_owned(),
                    depth => format!("the text ends with {depth} elements open"),
                };
                return Err(malformed(lines.at(at), reason));
            }
            _ => {}
        }
        // After the root nothing is read.
        if cut.done {
            return Ok(cut.document);
        }
    }
}

pub(super) fn malformed(line: usize, reason: String) -> ChainError {
    ChainError::Malformed { line, reason: reason.chars().take(LONGEST_REASON).collect() }
}

/// Lines of positions in a text, each from the one before.
struct Lines<'a> {
    text: &'a str,
    at: usize,
    line: usize,
}

impl Lines<'_> {
    fn at(&mut self, position: usize) -> usize {
        if position < self.at {
            (self.at, self.line) = (0, 1);
        }
        let bytes = self.text.as_bytes();
        let passed = bytes.get(self.at..position).unwrap_or_default();
        // A line ends with LF, CR LF, or CR alone.
        let next = bytes.get(self.at + 1..).unwrap_or_default().iter().map(Some).chain([None]);
        let ends = |(byte, next): &(&u8, Option<&u8>)| match byte {
            b'\n' => true,
            b'\r' => *next != Some(&b'\n'),
            _ => false,
        };
        self.line += passed.iter().zip(next).filter(ends).count();
        self.at = position;
        self.line
    }
}

/// What has been cut out so far.
#[derive(Default)]
struct Cut {
    files: bool,
    document: Document,
    /// Used elements that are open, each with the length of the text before it.
    open: Vec<(&'static Element, usize)>,
    piece: Piece,
    /// Elements that are open, of any kind.
    depth: usize,
    /// Elements that are open inside one that is not used, and that one.
    skipped: usize,
    used: usize,
    done: bool,
    /// Prefixes that are bound inside an element, by its depth, and whether they are of xacro.
    prefixes: Vec<(usize, String, bool)>,
}

/// More prefixes of xacro inside each other than a file of any other kind has.
const MOST_PREFIXES: usize = 64;

impl Cut {
    fn start(&mut self, tag: &BytesStart<'_>, line: usize) -> Result<(), ChainError> {
        let name = String::from_utf8_lossy(tag.name().as_ref()).into_owned();
        self.depth += 1;
        bound("elements inside each other", self.depth, DEEPEST, line)?;
        if self.is_of_xacro(&name, tag) {
            return Err(ChainError::Xacro { what: format!("<{name:.60}>"), line });
        }
        let used = if self.skipped > 0 { None } else { self.used(&name, tag, line)? };
        let Some(used) = used else {
            self.skipped += 1;
            return Ok(());
        };
        self.used += 1;
        bound("elements", self.used, MOST_ELEMENTS, line)?;
        let UsedAttributes { found: attributes, fault } = attributes(tag, used, line)?;
        let value = |name: &str| attributes.iter().find(|(key, _)| *key == name).map(|(_, value)| value);
        let mut written = format!("<{}", used.name);
        for (key, value) in attributes
            .iter()
            .map(|(key, value)| (*key, value.as_str()))
            .chain(used.given.iter().copied().filter(|(key, _)| value(key).is_none()))
        {
            written += &format!(" {key}=\"{}\"", escape(value));
        }
        written += ">";
        let before = self.piece.text.len();
        match self.open.len() {
            0 => {
                if let Some(PieceFault { line, reason }) = fault {
                    return Err(malformed(line, reason));
                }
                (self.document.head, self.document.line) = (written, line);
            }
            1 => {
                let name = value("name").cloned().unwrap_or_default();
                let kind = value("type").cloned().unwrap_or_default();
                let nameless = || PieceFault { line, reason: format!("a <{}> has no name", used.name) };
                let fault = fault.or_else(|| name.is_empty().then(nameless));
                self.piece = Piece { name, line, kind, fault, text: written, ..Piece::default() };
            }
            _ => {
                let link = value("link").cloned().filter(|link| !link.is_empty());
                let Piece { ends: [parents, children], parent, child, .. } = &mut self.piece;
                let end = match used.name {
                    "parent" => Some((parents, parent)),
                    "child" => Some((children, child)),
                    _ => None,
                };
                if let Some((count, end)) = end {
                    *count += 1;
                    // Of two nobody knows which one counts.
                    *end = link.filter(|_| *count == 1);
                    if *count > 1 {
                        self.blame(used, PieceFault { line, reason: format!("a second <{}>", used.name) });
                    }
                }
                self.piece.text += &written;
                if let Some(fault) = fault {
                    self.blame(used, fault);
                }
            }
        }
        self.open.push((used, before));
        Ok(())
    }

    /// Notes what is wrong with the element `used`, which begins, where it counts.
    fn blame(&mut self, used: &Element, fault: PieceFault) {
        let inside = |name: &str| used.name == name || self.open.iter().any(|(open, _)| open.name == name);
        let place = if inside("inertial") {
            &mut self.piece.inertial_fault
        } else if inside("visual") {
            &mut self.piece.visual_fault
        } else {
            &mut self.piece.fault
        };
        place.get_or_insert(fault);
    }

    /// Whether the element `name` is one of xacro: by the usual prefix, or by one that is bound to xacro's
    /// namespace.
    fn is_of_xacro(&mut self, name: &str, tag: &BytesStart<'_>) -> bool {
        let bound = |prefixes: &[(usize, String, bool)], wanted: &str| {
            prefixes.iter().rev().find(|(_, prefix, _)| prefix == wanted).is_some_and(|(_, _, xacro)| *xacro)
        };
        for attribute in tag.attributes().with_checks(false).filter_map(Result::ok) {
            let key = String::from_utf8_lossy(attribute.key.as_ref());
            // What the root binds without a prefix is itself.
            let prefix = match key.strip_prefix("xmlns") {
                Some("") if self.depth > 1 => "",
                Some(rest) if rest.len() > 1 && rest.starts_with(':') => &rest[1..],
                _ => continue,
            };
            let xacro = String::from_utf8_lossy(&attribute.value).trim_end_matches('/').ends_with("/xacro");
            if xacro || bound(&self.prefixes, prefix) {
                if self.prefixes.len() == MOST_PREFIXES {
                    return true;
                }
                self.prefixes.push((self.depth, prefix.to_owned(), xacro));
            }
        }
        let prefix = name.split_once(':').map_or("", |(prefix, _)| prefix);
        prefix == "xacro" || bound(&self.prefixes, prefix)
    }

    /// What the element `name` is, where it is used.
    fn used(
        &self,
        name: &str,
        tag: &BytesStart<'_>,
        line: usize,
    ) -> Result<Option<&'static Element>, ChainError> {
        let Some((around, _)) = self.open.last() else {
            return if name == "robot" {
                Ok(Some(&ROBOT))
            } else {
                Err(malformed(line, format!("its root is <{name:.60}>; the root of a URDF is <robot>")))
            };
        };
        Ok(match (around.name, name) {
            ("robot", "link") => Some(if self.files { &LINK_FILES } else { &LINK }),
            ("robot", "joint") => {
                let kind = attributes(tag, &FIXED, line)?.found.into_iter().find(|(key, _)| *key == "type");
                Some(match kind.as_ref().map(|(_, kind)| kind.as_str()) {
                    Some("fixed") => &FIXED,
                    Some("continuous") => &CONTINUOUS,
                    _ => &MOVING,
                })
            }
            _ => around.children.iter().find(|child| child.name == name).copied(),
        })
    }

    fn end(&mut self) {
        self.depth = self.depth.saturating_sub(1);
        self.prefixes.retain(|(depth, ..)| *depth <= self.depth);
        if self.skipped > 0 {
            self.skipped -= 1;
            return;
        }
        let Some((ended, from)) = self.open.pop() else { return };
        match (self.open.len(), ended.name) {
            (0, _) => self.done = true,
            (1, "link") => {
                let mut link = std::mem::take(&mut self.piece);
                if !link.text.contains("<collision>") {
                    link.text += &link.visuals;
                    link.fault = link.fault.or(link.visual_fault.take());
                }
                self.document.links.push(link);
            }
            (1, _) => self.document.joints.push(std::mem::take(&mut self.piece)),
            (_, name) => {
                self.piece.text += &format!("</{name}>");
                match name {
                    "inertial" => self.piece.inertials.push(self.piece.text.split_off(from)),
                    "visual" => {
                        let visual = self.piece.text.split_off(from);
                        // One without geometry shows nothing.
                        if visual.contains("<geometry>") {
                            self.piece.visuals += &visual;
                        }
                    }
                    _ => {}
                }
            }
        }
    }
}

fn bound(what: &'static str, found: usize, most: usize, line: usize) -> Result<(), ChainError> {
    if found > most { Err(ChainError::Bound { what, line: Some(line), found, most }) } else { Ok(()) }
}

/// The used attributes of a tag, unescaped, in the order of the file, and what is wrong with the first that
/// cannot be used: that one, and any of its name, is not among them.
struct UsedAttributes {
    found: Vec<(&'static str, String)>,
    fault: Option<PieceFault>,
}

fn attributes(
    tag: &BytesStart<'_>,
    used: &'static Element,
    line: usize,
) -> Result<UsedAttributes, ChainError> {
    let mut all = UsedAttributes { found: Vec::new(), fault: None };
    let mut spoilt: Vec<&'static str> = Vec::new();
    // The reader's own check for duplicates is quadratic; those that count are found below.
    for attribute in tag.attributes().with_checks(false) {
        let mut blame = |key: &'static str, reason: &dyn std::fmt::Display| {
            let space = if key.is_empty() { "" } else { " " };
            let reason = format!("<{}{space}{key}>: {reason}", used.name);
            let reason = reason.chars().take(LONGEST_REASON).collect();
            all.fault.get_or_insert(PieceFault { line, reason });
            spoilt.push(key);
        };
        let attribute = match attribute {
            Ok(attribute) => attribute,
            Err(error) => {
                blame("", &error);
                break;
            }
        };
        let Some(key) = used.attributes.iter().find(|key| key.as_bytes() == attribute.key.as_ref()) else {
            continue;
        };
        let length = attribute.value.len();
        if length > LONGEST_ATTRIBUTE {
            blame(key, &format_args!("{length} bytes in one attribute, {LONGEST_ATTRIBUTE} are the most"));
            continue;
        }
        let value = match attribute.unescape_value() {
            Ok(value) => value,
            Err(error) => {
                blame(key, &error);
                continue;
            }
        };
        if let Some(character) = value.chars().find(|character| !is_of_xml(*character)) {
            blame(key, &format_args!("U+{:04X} is a character that XML forbids", u32::from(character)));
            continue;
        }
        if value.contains("${") || value.contains("$(") {
            return Err(ChainError::Xacro { what: format!("{key}={value:.60?}"), line });
        }
        if all.found.iter().any(|(other, _)| other == key) {
            blame(key, &"it stands there twice");
            continue;
        }
        all.found.push((key, value.into_owned()));
    }
    all.found.retain(|(key, _)| !spoilt.contains(key));
    Ok(all)
}

/// *Source*: XML 1.0, fifth edition, production 2 (Char).
const fn is_of_xml(character: char) -> bool {
    matches!(character, '\t' | '\n' | '\r' | ' '..='\u{d7ff}' | '\u{e000}'..='\u{fffd}' | '\u{10000}'..)
}

#[cfg(test)]
mod tests;
