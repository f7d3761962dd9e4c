//! A robot description as the parser of URDF reads it, with the line of every link and joint.
//!
//! Contract: a link or joint that cannot be read refuses the description only where it is used. Until then it
//! stands there by its name and ends alone, with what is wrong with it. A link whose name cannot be read is
//! left out: no joint can name it.

use quick_xml::escape::escape;
use urdf_rs::{Inertial, Joint, Link, Robot};

use super::chain_error::{ChainError, Part};
use super::document::{Document, LONGEST_REASON, Piece, PieceFault, document, malformed};

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
    /// Links without a name that can be used.
    nameless: Vec<PieceFault>,
}

impl Description {
    /// Reads a description; with `files` also its visuals, and the names of mesh files.
    ///
    /// # Errors
    /// Beyond a bound, not XML, no URDF, a xacro file, or no links.
    pub(super) fn read(text: &str, files: bool) -> Result<Self, ChainError> {
        let mut document = document(text, files)?;
        let nameless = |link: &Piece| if link.name.is_empty() { link.fault.clone() } else { None };
        let nameless: Vec<PieceFault> = document.links.iter().filter_map(nameless).collect();
        document.links.retain(|link| !link.name.is_empty());
        if document.links.is_empty() {
            return Err(nameless
                .first()
                .map_or(ChainError::Empty, |fault| malformed(fault.line, fault.reason.clone())));
        }
        for joint in &mut document.joints {
            for (end, link) in [("parent", &joint.parent), ("child", &joint.child)] {
                if link.is_none() && joint.fault.is_none() {
                    let reason = format!("it has no <{end} link=...>");
                    joint.fault = Some(PieceFault { line: joint.line, reason });
                }
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
            nameless,
        };
        let whole = |piece: &Piece| {
            piece.fault.is_none() && piece.inertial_fault.is_none() && piece.inertials.len() < 2
        };
        let all = document.links.iter().chain(&document.joints).all(whole);
        found.robot = match parsed(&document, &together(&document)) {
            Ok(robot) if all => robot,
            _ => found.piece_by_piece(&document)?,
        };
        Ok(found)
    }

    /// What can be read of each link and joint by itself; the rest is noted.
    fn piece_by_piece(&mut self, document: &Document) -> Result<Robot, ChainError> {
        let refusal = |piece: &Piece, text: &str| match &piece.fault {
            Some(fault) => Some(fault.told_from(piece.line)),
            None => parsed(document, text).err().map(reason),
        };
        let mut text = String::new();
        for (index, link) in document.links.iter().enumerate() {
            let bare = format!("{}</link>", link.text);
            if let Some(why) = refusal(link, &bare) {
                self.link_faults.push((index, why));
                text += &format!("<link name=\"{}\"></link>", escape(&link.name));
                continue;
            }
            let weighed = format!("{}{}</link>", link.text, link.inertials.concat());
            let why = match (&link.inertial_fault, link.inertials.len()) {
                (Some(fault), _) => Some(fault.told_from(link.line)),
                (None, 0) => None,
                (None, 1) => refusal(link, &weighed),
                (None, count) => Some(format!("it stands there {count} times")),
            };
            text += if why.is_some() { &bare } else { &weighed };
            self.inertial_faults.extend(why.map(|why| (index, why)));
        }
        for (index, joint) in document.joints.iter().enumerate() {
            let read = format!("{}</joint>", joint.text);
            match refusal(joint, &read) {
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
            return Err(ChainError::Twice { kind: "link", part, again: line(&self.link_lines, again) });
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

    /// The links at both ends of a joint are there.
    ///
    /// # Errors
    /// One is not, or its name cannot be read.
    pub(super) fn ends(&self, joint: &Joint) -> Result<(), ChainError> {
        let there = |name: &str| self.robot.links.iter().any(|link| link.name == name);
        let Some(link) = [&joint.parent.link, &joint.child.link].into_iter().find(|link| !there(link)) else {
            return Ok(());
        };
        // An end that is not known is a fault of the joint.
        if link.is_empty() {
            self.usable(joint)?;
        }
        let hint = self.nameless.first().map_or_else(String::new, |fault| {
            format!("; the link in line {} cannot be taken for it ({})", fault.line, fault.reason)
        });
        Err(ChainError::NoLink { joint: self.joint_part(joint), link: link.clone(), hint })
    }

    /// None of the `others` has the name of `joint`.
    ///
    /// # Errors
    /// One has.
    pub(super) fn alone<'a>(
        &self,
        joint: &Joint,
        mut others: impl Iterator<Item = &'a String>,
    ) -> Result<(), ChainError> {
        if !others.any(|other| *other == joint.name) {
            return Ok(());
        }
        let first = self.robot.joints.iter().find(|other| other.name == joint.name).unwrap_or(joint);
        let [part, again] = [first, joint].map(|joint| self.joint_part(joint));
        Err(ChainError::Twice { kind: "joint", part, again: again.line })
    }

    /// Whether a link of this name has, or may have, a shape or a mass.
    pub(super) fn counts(&self, name: &str) -> bool {
        self.robot.links.iter().enumerate().filter(|(_, link)| link.name == name).any(|(index, link)| {
            let unread = [&self.link_faults, &self.inertial_faults].map(|faults| fault(faults, index));
            !link.collision.is_empty()
                || link.inertial.mass.value != 0.0
                || unread.iter().any(Option::is_some)
        })
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
fn together(document: &Document) -> String {
    let mut text = String::new();
    for link in &document.links {
        text += &format!("{}{}</link>", link.text, link.inertials.concat());
    }
    for joint in &document.joints {
        text += &format!("{}</joint>", joint.text);
    }
    text
}

/// A joint with nothing but its name, type and ends; one of an unknown type may be a fixed one.
fn bones(joint: &Piece) -> String {
    let kind = if KINDS.contains(&joint.kind.as_str()) { joint.kind.as_str() } else { "fixed" };
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
        .map_err(|error| malformed(document.line, error.to_string()))
}

fn reason(error: ChainError) -> String {
    match error {
        ChainError::Malformed { reason, .. } => reason,
        other => other.to_string().chars().take(LONGEST_REASON).collect(),
    }
}

#[cfg(test)]
mod tests;
