//! Which part of a set: a word of its split table, or everything.

use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

/// Which part of a set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Split {
    /// Every file, whatever word stands beside it.
    All,
    /// The files with exactly this word.
    Named(String),
}

impl Split {
    /// The part to fit and tune on: `train`.
    #[must_use]
    pub fn train() -> Self {
        Self::Named("train".to_owned())
    }

    /// The part held out: `test`.
    #[must_use]
    pub fn test() -> Self {
        Self::Named("test".to_owned())
    }

    /// Whether files marked with `word` belong to it; `None` is a file without a mark.
    #[must_use]
    pub fn takes(&self, word: Option<&str>) -> bool {
        match self {
            Self::All => true,
            Self::Named(wanted) => word == Some(wanted),
        }
    }
}

/// `all` is everything; any other word is a name.
impl FromStr for Split {
    type Err = Infallible;

    fn from_str(word: &str) -> Result<Self, Infallible> {
        Ok(if word == "all" { Self::All } else { Self::Named(word.to_owned()) })
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Named(word) => f.write_str(word),
        }
    }
}
