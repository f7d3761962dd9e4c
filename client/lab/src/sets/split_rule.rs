//! How a set is split: whole writers, by their place in the order of their names.

use std::collections::{BTreeMap, BTreeSet};

/// A rule for the parts of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SplitRule {
    /// Writers sorted by name; their index modulo `words.len()` chooses the word, `None` leaves them out.
    ByWriter { words: &'static [Option<&'static str>] },
    /// The set has parts by the names of its files, and needs no table.
    ByFile,
}

impl SplitRule {
    /// Even index: train; odd: test.
    pub const EVEN_AND_ODD: Self = Self::ByWriter { words: &[Some("train"), Some("test")] };

    /// The text of `split.tsv` for files with their writers; `None` where the set needs none.
    #[must_use]
    pub fn table(&self, files: &BTreeMap<String, String>) -> Option<String> {
        match self {
            Self::ByWriter { words } => Some(by_place(files, words)),
            Self::ByFile => None,
        }
    }
}

/// The text of a `split.tsv` in which a writer's place in the order of names chooses the word.
pub(super) fn by_place(files: &BTreeMap<String, String>, words: &[Option<&str>]) -> String {
    let writers: BTreeSet<&String> = files.values().collect();
    let word: BTreeMap<&String, Option<&str>> =
        writers.into_iter().zip(words.iter().copied().cycle()).collect();
    let word_of = |writer: &String| word.get(writer).copied().flatten();
    // In the order of files, which is that of the hands in the results.
    let rows = files.iter().filter_map(|(file, writer)| {
        let word = word_of(writer)?;
        Some(format!("{word}\t{writer}\t{file}\n"))
    });
    format!("set\twriter\tfile\n{}", rows.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(of: &[(&str, &str)]) -> BTreeMap<String, String> {
        of.iter().map(|(file, writer)| ((*file).to_owned(), (*writer).to_owned())).collect()
    }

    #[test]
    fn all_files_of_a_writer_get_the_word_of_his_place() {
        let of = files(&[("z.dat", "ada"), ("a.dat", "eve"), ("b.dat", "bob"), ("y.dat", "ada")]);
        let table = SplitRule::EVEN_AND_ODD.table(&of).unwrap();
        let rows = [
            "set\twriter\tfile",
            "train\teve\ta.dat",
            "test\tbob\tb.dat",
            "train\tada\ty.dat",
            "train\tada\tz.dat",
        ];
        assert_eq!(table.lines().collect::<Vec<_>>(), rows);
    }

    #[test]
    fn who_has_no_word_is_left_out() {
        let rule = SplitRule::ByWriter { words: &[Some("train"), None] };
        let table = rule.table(&files(&[("1", "a"), ("2", "b"), ("3", "c")])).unwrap();
        assert_eq!(table, "set\twriter\tfile\ntrain\ta\t1\ntrain\tc\t3\n");
        assert_eq!(SplitRule::ByFile.table(&files(&[("1", "a")])), None);
    }
}
