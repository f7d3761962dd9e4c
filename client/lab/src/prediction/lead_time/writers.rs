//! [`WriterBootstrap`]: how far a figure would move with other writers.
//!
//! A percentile bootstrap (Efron 1979, doi:10.1214/aos/1176344552) over writers, not over targets: those of
//! one hand are alike. Each replicate draws as many writers as have targets, with replacement; all models and
//! look-ahead times share the draws. These follow from a fixed seed and the name of the set, and are drawn
//! again each time: kept, they would take kilobytes for every writer that a file names.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::super::score::Mean;
use super::super::{CharacterSequence, Set};
use super::LEADS_MS;
use super::tally::SequenceSums;
use super::targets::Targets;

/// Replicates of a bootstrap.
pub const REPLICATES: usize = 2000;
/// Share of the replicates that an interval holds.
const INTERVAL_SHARE: f64 = 0.95;
const SEED: u64 = 2003;

/// Squared errors of one model by look-ahead time.
type Squares = [Mean; LEADS_MS.len()];

/// The writers of a set, and what each replicate draws of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WriterBootstrap {
    /// Of each sequence, the number of its writer, from 0; none for one without targets.
    writer_of: Vec<Option<usize>>,
    writers: usize,
    /// Of the generator that draws.
    seed: u64,
}

impl WriterBootstrap {
    /// The writers of the targets; where a set does not name them, a file is one.
    #[must_use]
    pub fn of(set: &Set, targets: &Targets) -> Self {
        fn name(s: &CharacterSequence) -> (&str, &str) {
            if s.writer.is_empty() { (&s.file, "") } else { ("", &s.writer) }
        }
        let mut judged = vec![false; set.scored.len()];
        for instant in &targets.instants {
            judged.iter_mut().skip(instant.sequence).take(1).for_each(|judged| *judged = true);
        }
        let with_targets = || set.scored.iter().zip(&judged).map(|(s, judged)| judged.then(|| name(s)));
        let mut known: Vec<_> = with_targets().flatten().collect();
        known.sort_unstable();
        known.dedup();
        let writer_of = with_targets().map(|name| known.binary_search(&name?).ok()).collect();
        let seed = SEED ^ u64::from(crc32fast::hash(set.name.as_bytes()));
        Self { writer_of, writers: known.len(), seed }
    }

    /// How many writers there are.
    #[must_use]
    pub fn writers(&self) -> usize {
        self.writers
    }

    /// RMS errors by look-ahead time of every replicate, from the sums of each sequence; `None` with one
    /// writer, or without targets. NaN where a replicate has no targets.
    pub(super) fn rms(&self, sequences: &[SequenceSums]) -> Option<Vec<[f64; LEADS_MS.len()]>> {
        if self.writers < 2 || sequences.is_empty() {
            return None;
        }
        let mut of_writers = vec![Squares::default(); self.writers];
        for (sequence, sums) in sequences {
            let writer = (*self.writer_of.get(*sequence)?)?;
            for (mean, sums) in of_writers.get_mut(writer)?.iter_mut().zip(sums) {
                mean.merge(&sums.square);
            }
        }
        let replicate = |times: &[u32]| -> [f64; LEADS_MS.len()] {
            let mut pooled = Squares::default();
            for (of_writer, times) in of_writers.iter().zip(times).filter(|(_, times)| **times > 0) {
                for (mean, of_writer) in pooled.iter_mut().zip(of_writer) {
                    mean.sum += f64::from(*times) * of_writer.sum;
                    mean.count += u64::from(*times) * of_writer.count;
                }
            }
            pooled.map(|mean| mean.get().map_or(f64::NAN, f64::sqrt))
        };
        Some(self.drawn(replicate))
    }

    /// What `of` makes of each replicate: how often it has each writer.
    fn drawn<T>(&self, of: impl Fn(&[u32]) -> T) -> Vec<T> {
        let mut rng = Pcg64::seed_from_u64(self.seed);
        let mut times = vec![0_u32; self.writers];
        let mut replicate = || {
            times.fill(0);
            for _ in 0..self.writers {
                let writer = rng.random_range(0..self.writers);
                times.iter_mut().skip(writer).take(1).for_each(|times| *times += 1);
            }
            of(&times)
        };
        (0..REPLICATES).map(|_| replicate()).collect()
    }
}

/// The middle 95 % of the replicates; `None` where one is not finite.
pub(super) fn interval(replicates: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    let mut sorted: Vec<f64> = replicates.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let cut = (0.5 * (1.0 - INTERVAL_SHARE) * sorted.len() as f64) as usize;
    let low = *sorted.get(cut)?;
    let high = *sorted.get(sorted.len().checked_sub(1 + cut)?)?;
    sorted.iter().all(|value| value.is_finite()).then_some([low, high])
}

#[cfg(test)]
mod tests {
    use super::super::tally::LeadSums;
    use super::*;

    fn sequence(file: &str, writer: &str) -> CharacterSequence {
        CharacterSequence {
            file: file.to_owned(),
            writer: writer.to_owned(),
            segment: 0,
            label: String::new(),
            v: vec![[1.0, 0.0]; 30],
            jump: vec![false; 30],
            rate_hz: 100.0,
            rate_assumed: false,
            units_per_m: None,
        }
    }

    fn set(name: &str, scored: Vec<CharacterSequence>) -> Set {
        let (split, rest) = ("test".to_owned(), Vec::new);
        let (refused, damaged, remarks) = (rest(), rest(), rest());
        Set {
            name: name.to_owned(),
            split,
            scored,
            train: Vec::new(),
            cold: false,
            refused,
            damaged,
            remarks,
        }
    }

    fn sums(square: f64, count: u64) -> [LeadSums; LEADS_MS.len()] {
        [LeadSums { square: Mean { sum: square, count }, ..LeadSums::default() }; LEADS_MS.len()]
    }

    fn bootstrap(set: &Set) -> WriterBootstrap {
        WriterBootstrap::of(set, &Targets::of(&set.scored))
    }

    #[test]
    fn a_writer_of_several_files_is_one_and_an_unnamed_one_is_a_file() {
        let scored = [("a", "Ada"), ("b", "Ada"), ("b", "Bo"), ("c", ""), ("c", ""), ("d", "")];
        let mut set = set("pens", scored.map(|(file, writer)| sequence(file, writer)).to_vec());
        // One who wrote nothing to foresee is drawn by nobody.
        set.scored.push(CharacterSequence { v: Vec::new(), jump: Vec::new(), ..sequence("e", "Cy") });
        let bootstrap = bootstrap(&set);
        assert_eq!(bootstrap.writers(), 4);
        let of = &bootstrap.writer_of;
        assert!(of.iter().take(6).all(Option::is_some) && of[6].is_none(), "{of:?}");
        assert!(of[0] == of[1] && of[3] == of[4] && of[1] != of[2] && of[4] != of[5], "{of:?}");
    }

    #[test]
    fn one_writer_has_no_interval() {
        let set = set("pens", vec![sequence("a", "Ada"), sequence("b", "Ada")]);
        assert_eq!(bootstrap(&set).rms(&[(0, sums(4.0, 1)), (1, sums(9.0, 1))]), None);
    }

    #[test]
    fn replicates_are_of_whole_writers_and_their_spread_is_that_of_the_mean() {
        let count = 40_u32;
        let scored: Vec<_> = (0..count).map(|i| sequence("a", &i.to_string())).collect();
        let draws = |name: &str| bootstrap(&set(name, scored.clone())).drawn(<[u32]>::to_vec);
        let bootstrap = bootstrap(&set("pens", scored.clone()));
        assert!(draws("pens").iter().all(|times| times.iter().sum::<u32>() == 40));
        // Squared errors 1 and 3 in equal shares: the mean is 2, its deviation 1 / √40.
        let each: Vec<_> = (0..count).map(|i| (i as usize, sums(f64::from(10 + 20 * (i % 2)), 10))).collect();
        let rms = bootstrap.rms(&each).unwrap();
        assert_eq!(rms.len(), REPLICATES);
        let [low, high] = interval(rms.iter().map(|leads| leads[7] * leads[7])).unwrap();
        let wide = 1.96 / 40_f64.sqrt();
        assert!((low - (2.0 - wide)).abs() < 0.06 && (high - (2.0 + wide)).abs() < 0.06, "{low} {high}");
        // Writers who all err alike leave no doubt; the same set has the same draws, another one others.
        let alike: Vec<_> = each.iter().map(|(i, _)| (*i, sums(20.0, 10))).collect();
        let rms = bootstrap.rms(&alike).unwrap();
        assert!(rms.iter().flatten().all(|rms| (rms - 2_f64.sqrt()).abs() < 1e-12));
        assert_eq!(draws("pens"), bootstrap.drawn(<[u32]>::to_vec));
        assert_ne!(draws("others"), draws("pens"));
    }

    #[test]
    fn an_interval_is_the_middle_of_the_replicates() {
        let replicates = (0..2000).map(|i| f64::from(i * 1009 % 2000));
        assert_eq!(interval(replicates), Some([50.0, 1949.0]));
        assert_eq!((interval([]), interval([1.0, f64::NAN])), (None, None));
    }
}
