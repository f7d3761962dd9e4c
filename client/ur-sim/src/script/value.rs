//! The values of a script. Copies are cheap: lists and strings are shared until one is changed.

use super::limits;
use super::machine::ThreadId;
use std::fmt;
use std::sync::Arc;

/// A value. Integers have 32 bits, as a controller's; what does not fit becomes a float.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// What a function without `return` gives.
    None,
    /// `True` or `False`.
    Bool(bool),
    Integer(i32),
    Float(f64),
    /// A string: bytes, as a controller counts them; what it is sent may be in any code.
    Text(Arc<[u8]>),
    /// A list or a matrix.
    List(List),
    /// Position \[m\] and rotation vector \[rad\].
    Pose([f64; 6]),
    /// What `run` gives.
    Thread(ThreadId),
}

/// A list, or a matrix as a list of rows.
#[derive(Debug, Clone, PartialEq)]
pub struct List {
    items: Arc<Vec<Value>>,
    /// Elements, those of lists inside included.
    weight: usize,
    depth: u8,
}

impl List {
    /// A list of these elements.
    ///
    /// # Errors
    /// Too many elements, or lists too deep inside lists.
    pub fn new(items: Vec<Value>) -> Result<Self, String> {
        let weight = items.iter().map(Value::weight).fold(0, usize::saturating_add);
        let inside = |item: &Value| if let Value::List(list) = item { list.depth } else { 0 };
        let depth = items.iter().map(inside).max().unwrap_or(0).saturating_add(1);
        if weight > limits::LIST_ELEMENTS {
            return Err(format!("a list has at most {} elements", limits::LIST_ELEMENTS));
        }
        if depth > limits::LIST_DEPTH {
            return Err(format!("lists stand in lists at most {} deep", limits::LIST_DEPTH));
        }
        Ok(Self { items: Arc::new(items), weight, depth })
    }

    #[must_use]
    pub fn items(&self) -> &[Value] {
        &self.items
    }

    /// The same list with another element at `at`, which must be inside.
    pub(super) fn with(self, at: usize, value: Value) -> Result<Self, String> {
        let mut items = self.items;
        if let Some(item) = Arc::make_mut(&mut items).get_mut(at) {
            *item = value;
        }
        Self::new(Arc::unwrap_or_clone(items))
    }
}

impl Value {
    #[must_use]
    pub fn text(text: &str) -> Self {
        Self::bytes(text.as_bytes())
    }

    /// A string of these bytes.
    #[must_use]
    pub fn bytes(bytes: &[u8]) -> Self {
        Self::Text(Arc::from(bytes))
    }

    /// A list of floats.
    #[must_use]
    pub fn floats(numbers: &[f64]) -> Self {
        let items: Vec<Self> = numbers.iter().take(limits::LIST_ELEMENTS).map(|&x| Self::Float(x)).collect();
        let weight = items.len();
        Self::List(List { items: Arc::new(items), weight, depth: 1 })
    }

    /// An integer if it fits 32 bits, else a float.
    #[expect(
        clippy::cast_precision_loss,
        reason = "what is lost is below the precision of a script's numbers"
    )]
    #[must_use]
    pub fn integer(number: i64) -> Self {
        i32::try_from(number).map_or(Self::Float(number as f64), Self::Integer)
    }

    /// What it counts against the bound of a run's memory, in elements.
    pub(super) fn weight(&self) -> usize {
        match self {
            Self::Text(text) => 1 + text.len() / size_of::<Self>(),
            Self::List(list) => 1 + list.weight,
            Self::Pose(_) => 2,
            _ => 1,
        }
    }

    /// What kind of value it is, for messages.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::None => "nothing",
            Self::Bool(_) => "a truth value",
            Self::Integer(_) => "an integer",
            Self::Float(_) => "a float",
            Self::Text(_) => "a string",
            Self::List(_) => "a list",
            Self::Pose(_) => "a pose",
            Self::Thread(_) => "a thread",
        }
    }

    /// The number, if it is one.
    #[must_use]
    pub fn as_number(&self) -> Option<f64> {
        match self {
            Self::Integer(number) => Some(f64::from(*number)),
            Self::Float(number) => Some(*number),
            _ => None,
        }
    }

    /// The integer; a float that is one counts too, because registers and indices are often computed.
    #[expect(clippy::cast_possible_truncation, reason = "it has no fraction and is inside the range of i32")]
    #[must_use]
    pub fn as_integer(&self) -> Option<i32> {
        match self {
            Self::Integer(number) => Some(*number),
            Self::Float(x) if x.fract() == 0.0 && x.abs() <= f64::from(i32::MAX) => Some(*x as i32),
            _ => None,
        }
    }

    /// The truth value, if it is one.
    #[must_use]
    pub fn as_bool(&self) -> Option<bool> {
        if let Self::Bool(truth) = self { Some(*truth) } else { None }
    }

    /// The string, if it is one and its bytes are UTF-8.
    #[must_use]
    pub fn as_text(&self) -> Option<&str> {
        self.as_bytes().and_then(|bytes| std::str::from_utf8(bytes).ok())
    }

    /// The bytes of the string, if it is one.
    #[must_use]
    pub fn as_bytes(&self) -> Option<&[u8]> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }

    /// The `N` numbers of a list or pose that has just as many.
    #[must_use]
    pub fn as_numbers<const N: usize>(&self) -> Option<[f64; N]> {
        let numbers: Vec<f64> = match self {
            Self::List(list) if list.items.len() == N => {
                list.items.iter().map(Self::as_number).collect::<Option<_>>()?
            }
            Self::Pose(pose) => pose.to_vec(),
            _ => return None,
        };
        numbers.try_into().ok()
    }
}

/// As `textmsg` and messages write it, at most about 100 kB.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let row = |f: &mut fmt::Formatter<'_>, items: &mut dyn Iterator<Item = &dyn fmt::Display>| {
            for (at, item) in items.enumerate() {
                if at > 0 {
                    f.write_str(", ")?;
                }
                item.fmt(f)?;
            }
            f.write_str("]")
        };
        match self {
            Self::None => f.write_str("None"),
            Self::Bool(true) => f.write_str("True"),
            Self::Bool(false) => f.write_str("False"),
            Self::Integer(number) => write!(f, "{number}"),
            Self::Float(number) => write!(f, "{number:?}"),
            Self::Text(text) => f.write_str(&String::from_utf8_lossy(text)),
            Self::Thread(thread) => write!(f, "thread {}", thread.number()),
            Self::List(list) => {
                f.write_str("[")?;
                row(f, &mut list.items.iter().map(|item| item as &dyn fmt::Display))
            }
            Self::Pose(pose) => {
                f.write_str("p[")?;
                row(f, &mut pose.map(Self::Float).iter().map(|item| item as &dyn fmt::Display))
            }
        }
    }
}
