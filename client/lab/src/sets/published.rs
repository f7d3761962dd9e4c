//! The published sets that the results are about: where from, on what terms, what to take.

use super::SplitRule;

/// A set that its authors published.
#[derive(Debug)]
pub struct PublishedSet {
    pub name: &'static str,
    pub what: &'static str,
    /// Where the files are that were measured, and whose they are.
    pub source: &'static str,
    pub licence: &'static str,
    /// Lines for a shell, in the folder in which the unpacked archive is.
    pub unpack: &'static [&'static str],
    pub split: SplitRule,
    /// The rule in words.
    pub split_words: &'static str,
    /// Writers of the whole published set.
    pub writers: usize,
    /// What the sums of the files do not cover.
    pub unknown: Option<&'static str>,
}

const UNIPEN: &str =
    "https://doi.org/10.5281/zenodo.1195803 (UNIPEN train_r01_v07, International Unipen Foundation)";
const UNIPEN_LICENCE: &str = "CC BY 4.0 there; a notice of 1999 inside allows research, and forbids to distribute \
                              the data for commercial purposes; cite Guyon et al., ICPR 1994, pp. 29-33";

const SETS: [PublishedSet; 4] = [
    PublishedSet {
        name: "unipen-ced",
        what: "characters on a pen display, by 35 of 43 writers: the fastest pens, many leaps",
        source: UNIPEN,
        licence: UNIPEN_LICENCE,
        unpack: &[
            "mkdir -p unipen-ced/data/2 unipen-ced/include",
            "cp -r train_r01_v07/data/2/ced unipen-ced/data/2/",
            "cp -r train_r01_v07/include/ced unipen-ced/include/",
        ],
        split: SplitRule::ByWriter {
            words: &[Some("train"), Some("test"), Some("train"), Some("test"), None],
        },
        split_words: "writers sorted by id, index modulo 5 is 0 or 2: train; 1 or 3: test; 4: not used",
        writers: 43,
        unknown: Some(
            "the ink in include/ced/data: the copy that was measured has the writers' names blanked there",
        ),
    },
    PublishedSet {
        name: "unipen-tos",
        what: "characters on many coarse tablets, with hover, by 57 writers",
        source: UNIPEN,
        licence: UNIPEN_LICENCE,
        unpack: &[
            "mkdir -p unipen-tos/data/2 unipen-tos/include",
            "cp -r train_r01_v07/data/2/tos unipen-tos/data/2/",
            "cp -r train_r01_v07/include/tos unipen-tos/include/",
        ],
        split: SplitRule::EVEN_AND_ODD,
        split_words: "writers sorted by id, even index: train; odd: test",
        writers: 57,
        unknown: Some(
            "the headers include/tos/*.doc: in 20 of them the copy that was measured has a quote escaped",
        ),
    },
    PublishedSet {
        name: "pendigits-orig",
        what: "digits, pen down only, by 44 writers",
        source: "https://doi.org/10.24432/C5MG6K (UCI data set 81, E. Alpaydin and F. Alimoglu)",
        licence: "CC BY 4.0",
        unpack: &[
            "# unpack the archive, which has no folder, in one of the archive's name",
            "mkdir -p pendigits-orig",
            "cp pen+based+recognition+of+handwritten+digits/pendigits-orig.t[re]* pendigits-orig/",
            "find pendigits-orig -name '*.Z' -exec gunzip {} +    # where they are compressed",
        ],
        split: SplitRule::ByFile,
        split_words: "the set's own: .tra is train, .tes is test",
        writers: 44,
        unknown: None,
    },
    PublishedSet {
        name: "character-trajectories",
        what: "letters without pen lift on a clean tablet of 200 Hz, by one writer",
        source: "https://github.com/ShuningZhao/Character-Trajectories, a copy in two halves of \
                 https://doi.org/10.24432/C58G7V (UCI data set 175, B. H. Williams)",
        licence: "CC BY 4.0 at UCI; cite Williams, Toussaint and Storkey, ICANN 2006",
        unpack: &[
            "mkdir -p character-trajectories",
            "mv Character-Trajectories*/trajectories_*.mat character-trajectories/",
        ],
        split: SplitRule::ByFile,
        split_words: "by file: trajectories_train.mat is train, trajectories_xtest.mat is test",
        writers: 1,
        unknown: Some("UCI's mixoutALL_shifted.mat, which has no parts"),
    },
];

/// Set, file and SHA-256 of the copies that the results were measured with.
const SUMS: &str = include_str!("published.tsv");

impl PublishedSet {
    #[must_use]
    pub const fn all() -> &'static [Self] {
        &SETS
    }

    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        SETS.iter().find(|set| set.name == name)
    }

    /// Files with a known sum: path below the set's folder, SHA-256.
    pub fn sums(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let rows = SUMS.lines().skip(1).filter_map(|line| {
            let (set, rest) = line.split_once('\t')?;
            Some((set, rest.split_once('\t')?))
        });
        rows.filter(|(set, _)| *set == self.name).map(|(_, row)| row)
    }

    /// Whether a known file is a recording by itself, not ink that one includes.
    pub(super) fn is_recording(file: &str) -> bool {
        !file.starts_with("include/")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_of_the_sums_is_a_set_a_path_below_it_and_a_sum() {
        let mut count = 0;
        for set in PublishedSet::all() {
            for (file, sum) in set.sums() {
                count += 1;
                assert!(!file.starts_with('/') && !file.contains(".."), "{file}");
                assert!(sum.len() == 64 && sum.bytes().all(|b| b.is_ascii_hexdigit()), "{file}: {sum}");
            }
            assert!(set.sums().count() > 0, "{}", set.name);
        }
        assert_eq!(count, SUMS.lines().count() - 1);
    }

    /// The lines find the files where the named source has them: an archive or a clone beside which they run.
    #[test]
    fn the_lines_that_unpack_find_the_files_of_the_source_that_is_named() {
        let set = PublishedSet::named("character-trajectories").unwrap();
        assert!(set.source.starts_with("https://github.com/ShuningZhao/Character-Trajectories"));
        for archive in ["Character-Trajectories", "Character-Trajectories-master"] {
            unpacks(set, |file| format!("{archive}/{file}"));
        }
        for name in ["unipen-ced", "unipen-tos"] {
            unpacks(PublishedSet::named(name).unwrap(), |file| format!("train_r01_v07/{file}"));
        }
        let archive = "pen+based+recognition+of+handwritten+digits";
        let set = PublishedSet::named("pendigits-orig").unwrap();
        unpacks(set, |file| format!("{archive}/{file}"));
        // Compressed by gzip here, whose program takes what compress wrote, too.
        unpacks(set, |file| format!("{archive}/{file}.Z"));
    }

    /// Runs the lines of `set` beside an archive that has each file at `place`, compressed if so called.
    fn unpacks(set: &PublishedSet, place: impl Fn(&str) -> String) {
        let beside = tempfile::tempdir().unwrap();
        let shell = |line: &str| {
            let mut shell = std::process::Command::new("sh");
            let ended = shell.args(["-euc", line]).current_dir(beside.path()).status().unwrap();
            assert!(ended.success(), "{line}");
        };
        // Of this folder's files no sum is known.
        std::fs::create_dir_all(beside.path().join("train_r01_v07/include/ced")).unwrap();
        for (file, _) in set.sums() {
            let there = beside.path().join(place(file));
            std::fs::create_dir_all(there.parent().unwrap()).unwrap();
            std::fs::write(&there, file).unwrap();
            if place(file).ends_with(".Z") {
                shell(&format!("gzip -c '{0}' >packed && mv packed '{0}'", place(file)));
            }
        }
        shell(&set.unpack.join("\n"));
        assert!(set.sums().count() >= 2);
        for (file, _) in set.sums() {
            let unpacked = std::fs::read_to_string(beside.path().join(set.name).join(file));
            assert_eq!(unpacked.ok().as_deref(), Some(file), "{}", set.name);
        }
    }
}
