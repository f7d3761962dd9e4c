//! A run of the lab cut into shards for many machines, and its result put together again.
//!
//! Contract: the hands of a run (a writer in a file) are sorted, and shard I of N takes those whose index
//! modulo N is I - 1. A shard loads everything and writes what it found of its own hands, with every bit of
//! every number; the merge computes the result with the code of the run that was not cut, so that it is the
//! same bit for bit. Times are those of the machines. Learners of the closed loop start with every hand.
//! Those of tables and lead times carry over from hand to hand: there a shard also observes what others
//! score, which is what it costs more. Absent: starting shards, and moving their files.

mod closed;
mod exact;
mod file;
mod leads;
mod scored;
mod tables;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

pub use closed::{
    ClosedLoopPart, ClosedLoopRun, MergedLoop, closed_loop_part, digest, files_digest, own_hands,
};
pub use exact::{Digest, Exact};
pub use file::{LONGEST, MergeError, ShardFile, command_of};
pub use leads::{LeadPart, LeadRun, MergedLeads, lead_part};
pub use scored::{SetRun, brought, networks, owned};
pub use tables::{MergedTable, TablePart, TableRun, table_part};

/// Most shards of a run.
pub const MOST_SHARDS: usize = 100_000;

/// Most models of a run that is put together: each is looked for among all.
const MOST_MODELS: usize = 10_000;

fn few(models: &[String]) -> Result<(), String> {
    let count = models.len();
    if count > MOST_MODELS {
        return Err(format!("{count} models, {MOST_MODELS} are the most that are put together"));
    }
    Ok(())
}

/// One part of a run: `index` of `count`, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    pub index: usize,
    pub count: usize,
}

impl Shard {
    /// A run that is not cut.
    pub const WHOLE: Self = Self { index: 1, count: 1 };

    /// For each of `hands`, whether this shard scores it. Equal keys are one hand.
    #[must_use]
    pub fn owned<K: Ord>(self, hands: &[K]) -> Vec<bool> {
        let mut sorted: Vec<&K> = hands.iter().collect();
        sorted.sort();
        sorted.dedup();
        let owns = |hand: &K| {
            sorted.binary_search(&hand).is_ok_and(|place| place % self.count.max(1) + 1 == self.index)
        };
        hands.iter().map(owns).collect()
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text
            .split_once('/')
            .and_then(|(index, count)| Some(Self { index: index.parse().ok()?, count: count.parse().ok()? }));
        numbers
            .filter(|shard| (1..=shard.count).contains(&shard.index) && shard.count <= MOST_SHARDS)
            .ok_or_else(|| format!("I/N with I from 1 to N and N to {MOST_SHARDS}, for example 2/17"))
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_hand_belongs_to_exactly_one_shard_whatever_the_order() {
        let hands = ["c", "a", "d", "b", "a", "e"];
        for count in [1, 2, 3, 17] {
            let parts: Vec<_> = (1..=count).map(|index| Shard { index, count }.owned(&hands)).collect();
            for hand in 0..hands.len() {
                assert_eq!(parts.iter().filter(|part| part[hand]).count(), 1, "{count}: {hand}");
            }
            assert!(parts.iter().all(|part| part[1] == part[4]), "one hand, two shards");
        }
        assert_eq!(Shard { index: 2, count: 3 }.owned(&hands), [false, false, false, true, false, true]);
    }

    #[test]
    fn a_shard_that_is_none_is_refused() {
        assert_eq!("2/17".parse(), Ok(Shard { index: 2, count: 17 }));
        for wrong in [
            "0/3",
            "4/3",
            "3",
            "1/0",
            "-1/3",
            "1/3/5",
            "1/1000000",
            "a/b",
            "",
            "1.0/2",
            "1/99999999999999999999",
        ] {
            assert!(wrong.parse::<Shard>().unwrap_err().contains("from 1 to N"), "{wrong}");
        }
    }
}
