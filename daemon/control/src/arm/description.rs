//! A robot description as the parser of URDF reads it, with the line of every link and joint.
//!
//! Contract: a link or joint that the parser refuses refuses the description only where it is used. Until
//! then it stands there by its name alone, with what is wrong with it.

use quick_xml::escape::escape;
use urdf_rs::{Inertial, Joint, Link, Robot};

use super::chain_error::{ChainError, Part};
use super::document::{Document, LONGEST_REASON, Piece, document, malformed};

/// Types of joints that URDF knows.
const KINDS: [&str; 7] = ["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical"];

/// What is wrong with a link or joint, by its place in the description.
type Faults = Vec<(usize, String)>;

/// Links and joints, and what is wrong with those that are not used so far.
#[derive(Debug)]
pub(super) struct Description {
    pub(super) robot: Robot,
    link_lines: Vec<usize>,
    joint_lines: Vec<usize>,
    link_faults: Faults,
    joint_faults: Faults,
    inertial_faults: Faults,
}

impl Description {
    /// Reads a description; with `files` also its visuals, and the names of mesh files.
    ///
    /// # Errors
    /// Beyond a bound, not XML, no URDF, a xacro file, no links, or a joint without both ends.
    pub(super) fn read(text: &str, files: bool) -> Result<Self, ChainError> {
        let document = document(text, files)?;
        if document.links.is_empty() {
            return Err(ChainError::Empty);
        }
        for joint in &document.joints {
            let ends = [("parent", &joint.parent), ("child", &joint.child)];
            if let Some((end, _)) = ends.iter().find(|(_, link)| link.is_none()) {
                let reason = format!("joint `{:.60}` has no <{end} link=...>", joint.name);
                return Err(malformed(joint.line, reason));
            }
        }
        let lines = |pieces: &[Piece]| pieces.iter().map(|piece| piece.line).collect();
        let mut found = Self {
            robot: parsed(&document, "")?,
            link_lines: lines(&document.links),
            joint_lines: lines(&document.joints),
            link_faults: Faults::new(),
            joint_faults: Faults::new(),
            inertial_faults: Faults::new(),
        };
        found.robot = match parsed(&document, &whole(&document)) {
            Ok(robot) if document.links.iter().all(|link| link.inertials.len() < 2) => robot,
            _ => found.piece_by_piece(&document)?,
        };
        Ok(found)
    }

    /// What can be read of each link and joint by itself; the rest is noted.
    fn piece_by_piece(&mut self, document: &Document) -> Result<Robot, ChainError> {
        let refusal = |text: &str| parsed(document, text).err().map(reason);
        let mut text = String::new();
        for (index, link) in document.links.iter().enumerate() {
            let bare = format!("{}</link>", link.text);
            if let Some(why) = refusal(&bare) {
                self.link_faults.push((index, why));
                text += &format!("<link name=\"{}\"></link>", escape(&link.name));
                continue;
            }
            let weighed = format!("{}{}</link>", link.text, link.inertials.concat());
            let why = match link.inertials.len() {
                0 | 1 => refusal(&weighed),
                count => Some(format!("it stands there {count} times")),
            };
            text += if why.is_some() { &bare } else { &weighed };
            self.inertial_faults.extend(why.map(|why| (index, why)));
        }
        for (index, joint) in document.joints.iter().enumerate() {
            let read = format!("{}</joint>", joint.text);
            match refusal(&read) {
                None => text += &read,
                Some(why) => {
                    self.joint_faults.push((index, why));
                    text += &bones(joint);
                }
            }
        }
        parsed(document, &text)
    }

    /// The link `name`, if there is one.
    ///
    /// # Errors
    /// It cannot be read, or there are two.
    pub(super) fn link(&self, name: &str) -> Result<Option<&Link>, ChainError> {
        let mut named = self.robot.links.iter().enumerate().filter(|(_, link)| link.name == name);
        let Some((index, link)) = named.next() else { return Ok(None) };
        let part = Part { name: name.to_owned(), line: line(&self.link_lines, index) };
        if let Some((again, _)) = named.next() {
            return Err(ChainError::Twice { link: part, again: line(&self.link_lines, again) });
        }
        match fault(&self.link_faults, index) {
            Some(reason) => Err(ChainError::Unreadable { kind: "link", part, reason }),
            None => Ok(Some(link)),
        }
    }

    /// A joint of this description, before anything but its ends is used.
    ///
    /// # Errors
    /// It cannot be read.
    pub(super) fn usable(&self, joint: &Joint) -> Result<(), ChainError> {
        match fault(&self.joint_faults, self.index(joint)) {
            Some(reason) => {
                Err(ChainError::Unreadable { kind: "joint", part: self.joint_part(joint), reason })
            }
            None => Ok(()),
        }
    }

    /// The inertial of a link, or why it cannot be read.
    pub(super) fn inertial(&self, link: &Link) -> Result<Inertial, String> {
        let index = self.robot.links.iter().position(|other| std::ptr::eq(other, link));
        match index.and_then(|index| fault(&self.inertial_faults, index)) {
            Some(reason) => Err(reason),
            None => Ok(link.inertial.clone()),
        }
    }

    /// The first link that cannot be read.
    pub(super) fn first_fault(&self) -> Result<(), ChainError> {
        let Some((index, reason)) = self.link_faults.first() else { return Ok(()) };
        let name = self.robot.links.get(*index).map_or_else(String::new, |link| link.name.clone());
        let part = Part { name, line: line(&self.link_lines, *index) };
        Err(ChainError::Unreadable { kind: "link", part, reason: reason.clone() })
    }

    pub(super) fn joint_part(&self, joint: &Joint) -> Part {
        Part { name: joint.name.clone(), line: line(&self.joint_lines, self.index(joint)) }
    }

    pub(super) fn link_part(&self, name: &str) -> Part {
        let index = self.robot.links.iter().position(|link| link.name == name);
        Part { name: name.to_owned(), line: index.map_or(0, |index| line(&self.link_lines, index)) }
    }

    fn index(&self, joint: &Joint) -> usize {
        self.robot.joints.iter().position(|other| std::ptr::eq(other, joint)).unwrap_or(usize::MAX)
    }
}

fn line(lines: &[usize], index: usize) -> usize {
    lines.get(index).copied().unwrap_or_default()
}

fn fault(faults: &Faults, index: usize) -> Option<String> {
    faults.iter().find(|(at, _)| *at == index).map(|(_, why)| why.clone())
}

/// All that is used, as one text.
fn whole(document: &Document) -> String {
    let mut text = String::new();
    for link in &document.links {
        text += &format!("{}{}</link>", link.text, link.inertials.concat());
    }
    for joint in &document.joints {
        text += &format!("{}</joint>", joint.text);
    }
    text
}

/// A joint with nothing but its name, type and ends.
fn bones(joint: &Piece) -> String {
    let kind = if KINDS.contains(&joint.kind.as_str()) { joint.kind.as_str() } else { "floating" };
    let [parent, child] = [&joint.parent, &joint.child].map(|link| link.as_deref().unwrap_or_default());
    format!(
        "<joint name=\"{}\" type=\"{kind}\"><parent link=\"{}\"/><child link=\"{}\"/></joint>",
        escape(&joint.name),
        escape(parent),
        escape(child)
    )
}

/// The pieces `text` of a document, by the parser of URDF.
fn parsed(document: &Document, text: &str) -> Result<Robot, ChainError> {
    urdf_rs::read_from_string(&format!("{}{text}</robot>", document.head))
        .map_err(|error| malformed(1, error.to_string()))
}

fn reason(error: ChainError) -> String {
    match error {
        ChainError::Malformed { reason, .. } => reason,
        other => other.to_string().chars().take(LONGEST_REASON).collect(),
    }
}

#[cfg(test)]
mod tests;
