//! What of a file was not taken as it stands: counted, and said once for all files of a set.

use std::fmt;

/// One such thing in one file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    /// How often; 0: it has no number.
    pub count: u64,
    /// What was done, in words that follow the number.
    pub what: String,
}

impl Remark {
    /// Nothing where nothing was counted.
    pub(crate) fn counted(count: u64, what: &str) -> Option<Self> {
        (count > 0).then(|| Self { count, what: what.to_owned() })
    }

    pub(crate) fn new(what: impl Into<String>) -> Self {
        Self { count: 0, what: what.into() }
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.count {
            0 => f.write_str(&self.what),
            count => write!(f, "{count} {}", self.what),
        }
    }
}

/// A line per kind of remark, whatever the number of files: with the first file and the count over all.
#[must_use]
pub fn remarks<'a>(files: impl IntoIterator<Item = (&'a str, &'a [Remark])>) -> Vec<String> {
    // In order of appearance: what is said, the first file, further files, the count.
    let mut kinds: Vec<(&str, &str, usize, u64)> = Vec::new();
    for (file, remarks) in files {
        for remark in remarks {
            match kinds.iter_mut().find(|(what, ..)| *what == remark.what) {
                Some((_, first, more, count)) => {
                    *more += usize::from(*first != file);
                    *count += remark.count;
                }
                None => kinds.push((&remark.what, file, 0, remark.count)),
            }
        }
    }
    let line = |(what, first, more, count): (&str, &str, usize, u64)| {
        let others = match more {
            0 => String::new(),
            1 => " and 1 other file".to_owned(),
            more => format!(" and {more} other files"),
        };
        format!("{first}{others}: {}", Remark { count, what: what.to_owned() })
    };
    kinds.into_iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_many_files_have_in_common_is_said_once_with_its_count() {
        let merged = |count| Remark::counted(count, "samples are merged").unwrap();
        let [a, b] = [[merged(2), Remark::new("the column p is not used")], [merged(3), Remark::new("odd")]];
        let lines = remarks([("a.csv", &a[..]), ("b.csv", &b[..]), ("c.csv", &b[..])]);
        assert_eq!(
            lines,
            [
                "a.csv and 2 other files: 8 samples are merged",
                "a.csv: the column p is not used",
                "b.csv and 1 other file: odd"
            ]
        );
        assert_eq!(Remark::counted(0, "samples"), None);
    }
}
