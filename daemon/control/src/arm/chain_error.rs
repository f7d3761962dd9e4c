//! Why a robot description cannot be used, with the joint or link at fault and its line in the file.

use std::fmt;

use thiserror::Error;

/// Characters of a name in a message.
pub(super) const LONGEST_NAME: usize = 60;

/// A joint or link of a description, and where it begins there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Name of the joint or link in the description.
    pub name: String,
    /// Line of its tag in the text, from 1.
    pub line: usize,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.name.is_empty() {
            return write!(f, "without a name that can be used (line {})", self.line);
        }
        write!(f, "`{:.LONGEST_NAME$}` (line {})", self.name, self.line)
    }
}

/// Why a robot description cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ChainError {
    /// Not XML, or not URDF.
    #[error("the robot description cannot be read as URDF, line {line}: {reason}")]
    Malformed {
        /// Where reading ended, from 1.
        line: usize,
        /// What is wrong there.
        reason: String,
    },
    /// Larger than anything that describes an arm.
    #[error(
        "the robot description has {found} {what}{}, {most} are the most that are read: name that of one arm",
        line.map_or_else(String::new, |line| format!(" (line {line})"))
    )]
    Bound {
        /// What is counted, as in the message.
        what: &'static str,
        /// Where counting stopped, from 1; `None` for the file as a whole.
        line: Option<usize>,
        /// How many there are; where it stopped counting, at least.
        found: usize,
        /// How many there may be.
        most: usize,
    },
    /// A macro file that has to be expanded first.
    #[error(
        "it is a xacro file ({what}, line {line}): expand it first with `xacro FILE > robot.urdf`, and name \
         robot.urdf"
    )]
    Xacro {
        /// The element or substitution of xacro.
        what: String,
        /// Where it stands, from 1.
        line: usize,
    },
    /// No link at all.
    #[error("the description has no links: it is no description of a robot")]
    Empty,
    /// A joint or link of the chain that the parser of URDF refuses.
    #[error("{kind} {part} cannot be read as URDF: {reason}")]
    Unreadable {
        /// In the message: "joint" or "link".
        kind: &'static str,
        /// Joint or link at fault.
        part: Part,
        /// Message of the parser.
        reason: String,
    },
    /// A joint leads to a link that the description has not.
    #[error(
        "joint {joint} names link `{link:.LONGEST_NAME$}`, which is not there{hint}: correct the name, in which \
         capitals and spaces count, or remove the joint"
    )]
    NoLink {
        /// Joint at fault, with its line.
        joint: Part,
        /// Name of its parent or child.
        link: String,
        /// Which links could not be taken, for the message.
        hint: String,
    },
    /// Two links, or two joints, of the chain have the same name.
    #[error("{kind} {part} stands there again in line {again}: give each {kind} a name of its own")]
    Twice {
        /// In the message: "joint" or "link".
        kind: &'static str,
        /// The first of them.
        part: Part,
        /// Line of the second.
        again: usize,
    },
    /// The named base or tip does not exist.
    #[error("link `{link}` does not exist; the links are: {known}")]
    UnknownLink {
        /// Name of the link that was asked for.
        link: String,
        /// Names of all links, for the message.
        known: String,
    },
    /// No base was named and the description has no single root.
    #[error("the description has {count} root links ({links}); name the base link")]
    Root {
        /// How many links have no parent.
        count: usize,
        /// Names of these links, for the message.
        links: String,
    },
    /// No tip was named and the chain branches.
    #[error("the chain branches at link {link} into joints {joints}; name the tip link")]
    Branch {
        /// Link at which the chain branches.
        link: Part,
        /// The joints that leave there.
        joints: String,
    },
    /// A link is the child of two joints, or its own ancestor.
    #[error(
        "link {link} is the child of more than one joint, or of itself; a serial chain needs exactly one \
         parent"
    )]
    Loop {
        /// Link that is its own ancestor.
        link: Part,
    },
    /// The tip is not below the base.
    #[error("link `{tip}` is not below link `{base}`, or a link that is fixed to it{from}")]
    Disconnected {
        /// Name of the link where the chain begins.
        base: String,
        /// Name of the link where the chain ends.
        tip: String,
        /// Where the way up from the tip ends, for the message.
        from: String,
    },
    /// A joint type other than revolute, continuous and fixed.
    #[error("joint {joint} is {kind}; only revolute, continuous and fixed joints can be followed")]
    Kind {
        /// Joint at fault, with its line.
        joint: Part,
        /// Its type in URDF.
        kind: &'static str,
    },
    /// A joint that mimics another one is not independent.
    #[error("joint {joint} mimics `{other}`; a chain needs independent joints")]
    Mimic {
        /// Joint at fault, with its line.
        joint: Part,
        /// Name of the other joint.
        other: String,
    },
    /// The wrong number of moving joints.
    #[error("{found} moving joints between `{base}` and `{tip}`, but {expected} are needed")]
    Count {
        /// Moving joints that the description has.
        found: usize,
        /// Moving joints that the arm has.
        expected: usize,
        /// Name of the link where the chain begins.
        base: String,
        /// Name of the link where the chain ends.
        tip: String,
    },
    /// The axis is shorter than 1e-6 or NaN.
    #[error("joint {joint}: axis [{x}, {y}, {z}] has no direction")]
    Axis {
        /// Joint at fault, with its line.
        joint: Part,
        /// Component of the axis, as in the description.
        x: f64,
        /// Component of the axis, as in the description.
        y: f64,
        /// Component of the axis, as in the description.
        z: f64,
    },
    /// An origin is non-finite.
    #[error("joint {joint}: origin xyz or rpy is not a finite number")]
    Origin {
        /// Joint at fault, with its line.
        joint: Part,
    },
    /// A shape of the collision geometry has an invalid size or origin.
    #[error(
        "link {link}: a shape of its collision geometry has a size that is not positive, or a number that \
         is not finite"
    )]
    Shape {
        /// Link at fault, with its line.
        link: Part,
    },
    /// Friction below 0 or NaN.
    #[error(
        "joint {joint}: <dynamics {what}=\"{value}\"> cannot be used; give a number of 0 or more, or leave \
         it out"
    )]
    Friction {
        /// Joint at fault, with its line.
        joint: Part,
        /// Name of the number, as in the message.
        what: &'static str,
        /// The value that the description has.
        value: f64,
    },
    /// The limit element is missing, empty or NaN.
    #[error(
        "joint {joint}: {what} {value} {unit} cannot be used; give <limit lower upper velocity effort>, \
         finite and lower < upper"
    )]
    Limit {
        /// Joint at fault, with its line.
        joint: Part,
        /// Name of the number, as in the message.
        what: &'static str,
        /// As read (0 when absent).
        value: f64,
        /// Unit of the value, as in the message.
        unit: &'static str,
    },
}
