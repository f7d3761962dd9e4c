//! Which registers the bridge and its program use, and what is written into them.
//!
//! Contract: 12 doubles and 2 integers go in, 7 integers come out, all of them within the 18 from `base`;
//! nothing else of the controller's inputs is ever claimed, so that fieldbus adapters and other clients run
//! beside it.

use foretrace_client::JOINTS;

/// The first registers that belong to RTDE clients alone, fieldbuses aside.
pub const FIRST_BASE: u32 = 24;
/// The last base with which nothing reaches beyond register 41.
pub const LAST_BASE: u32 = 30;

/// Names and numbers of the registers in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegisterMap {
    base: u32,
}

/// What goes in, once a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegisterInputs {
    /// Of this package; never twice the same in a row.
    pub counter: i32,
    /// Number of the permit to move; see [`NO_PERMIT`] and [`END`].
    pub permit: i32,
    /// Joint positions to be reached at the end of the cycle that reads them \[rad\].
    pub q: [f64; JOINTS],
    /// Their velocity \[rad/s\].
    pub qd: [f64; JOINTS],
}

/// No permit to move.
pub const NO_PERMIT: i32 = 0;
/// The program is to end.
pub const END: i32 = -1;

/// What the program answers, once a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ProgramAnswer {
    /// Counter that it read in this cycle.
    pub echo: i32,
    /// What it is doing.
    pub state: i32,
    /// Token of the program that answers.
    pub session: i32,
    /// Cycles in which it found no fresh counter.
    pub late: i32,
    /// Permit obeyed, or used up.
    pub used: i32,
    /// Why it stopped by itself.
    pub why: i32,
    /// Counters that came and went unread.
    pub lost: i32,
}

/// What the program says that it is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProgramState {
    /// Waits for a permit.
    Waiting,
    Following,
    /// Stopped by itself: counters stayed away.
    StoppedLate,
    /// Stopped by itself: a target too far away, or no number.
    StoppedJump,
    /// Nothing that our program writes.
    Unknown,
}

impl ProgramAnswer {
    /// What the program is doing.
    #[must_use]
    pub const fn program(&self) -> ProgramState {
        match (self.state, self.why) {
            (1, _) => ProgramState::Waiting,
            (2, _) => ProgramState::Following,
            (3, 1) => ProgramState::StoppedLate,
            (3, 2) => ProgramState::StoppedJump,
            _ => ProgramState::Unknown,
        }
    }

    /// Of what the output integers say, in the order of [`RegisterMap::answer_names`].
    #[must_use]
    pub const fn from_words([echo, state, session, late, used, why, lost]: [i32; 7]) -> Self {
        Self { echo, state, session, late, used, why, lost }
    }
}

impl RegisterMap {
    /// The registers from `base`; `None` where they would leave 24 to 41.
    #[must_use]
    pub fn at(base: u32) -> Option<Self> {
        (FIRST_BASE..=LAST_BASE).contains(&base).then_some(Self { base })
    }

    /// Input integer with the counter.
    #[must_use]
    pub const fn counter(&self) -> u32 {
        self.base
    }

    /// Input integer with the permit.
    #[must_use]
    pub const fn permit(&self) -> u32 {
        self.base + 1
    }

    /// Input double `i`, 0 to 11: positions, then velocities.
    #[must_use]
    pub const fn double(&self, i: u32) -> u32 {
        self.base + i
    }

    /// Output integer `i`, 0 to 6, in the order of [`ProgramAnswer`]'s fields.
    #[must_use]
    pub const fn output(&self, i: u32) -> u32 {
        self.base + i
    }

    /// RTDE names of the inputs: counter, permit, then 12 doubles.
    #[must_use]
    pub fn input_names(&self) -> Vec<String> {
        let integers = [self.counter(), self.permit()].map(|n| format!("input_int_register_{n}"));
        let doubles = (0..12).map(|i| format!("input_double_register_{}", self.double(i)));
        integers.into_iter().chain(doubles).collect()
    }

    /// RTDE names of the outputs, in the order of [`ProgramAnswer::from_words`].
    #[must_use]
    pub fn answer_names(&self) -> [String; 7] {
        [0, 1, 2, 3, 4, 5, 6].map(|i| format!("output_int_register_{}", self.output(i)))
    }
}

/// Numbers that follow one another and never are 0, nor negative, nor twice the same in a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Numbers(i32);

impl Numbers {
    /// Begins behind `seed`, whatever that is.
    #[must_use]
    pub const fn from_seed(seed: u64) -> Self {
        // 30 bits: positive, and far from the wrap.
        Self((seed & 0x3fff_ffff) as i32)
    }

    pub fn next_number(&mut self) -> i32 {
        self.0 = self.0.checked_add(1).filter(|next| *next > 0).unwrap_or(1);
        self.0
    }

    #[must_use]
    pub const fn newest(&self) -> i32 {
        self.0
    }
}

/// Tokens of programs, one per upload: positive, never 0, and as good as never one that stood there before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tokens(u64);

impl Tokens {
    /// Begins at `seed`, which should be drawn at random.
    #[must_use]
    pub const fn from_seed(seed: u64) -> Self {
        Self(seed)
    }

    /// The next one, by SplitMix64 (Steele et al. 2014).
    pub fn next_token(&mut self) -> i32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        // 31 bits: positive. 0 is what a register says that nobody wrote.
        i32::try_from((mixed ^ (mixed >> 31)) >> 33).map_or(1, |token| token.max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_positive_and_differ_from_upload_to_upload_and_from_bridge_to_bridge() {
        let drawn = |seed| {
            let mut tokens = Tokens::from_seed(seed);
            (0..1000).map(move |_| tokens.next_token())
        };
        let all: std::collections::HashSet<i32> = drawn(1).chain(drawn(2)).collect();
        assert_eq!(all.len(), 2000);
        assert!(all.iter().all(|token| *token > 0));
    }

    #[test]
    fn every_legal_base_stays_within_registers_24_to_41() {
        for base in 24..=30 {
            let registers = RegisterMap::at(base).unwrap();
            for name in registers.input_names().iter().chain(&registers.answer_names()) {
                let number: u32 = name.rsplit('_').next().unwrap().parse().unwrap();
                assert!((24..=41).contains(&number), "{name}");
            }
        }
        assert!(RegisterMap::at(23).is_none() && RegisterMap::at(31).is_none());
    }

    #[test]
    fn inputs_are_registers_only_and_none_twice() {
        let mut names = RegisterMap::at(24).unwrap().input_names();
        assert_eq!(names.len(), 14);
        assert!(names.iter().all(|name| name.starts_with("input_") && name.contains("_register_")));
        names.sort();
        names.dedup();
        assert_eq!(names.len(), 14);
    }

    #[test]
    fn numbers_go_on_after_the_largest_without_zero() {
        let mut numbers = Numbers(i32::MAX - 1);
        assert_eq!((numbers.next_number(), numbers.next_number(), numbers.next_number()), (i32::MAX, 1, 2));
        for seed in [0, u64::MAX, 0x4000_0000] {
            assert!(Numbers::from_seed(seed).next_number() > 0);
        }
    }

    #[test]
    fn words_that_the_program_never_writes_are_no_state() {
        let state = |state, why| ProgramAnswer { state, why, ..ProgramAnswer::default() }.program();
        assert_eq!(state(3, 1), ProgramState::StoppedLate);
        assert_eq!(state(3, 2), ProgramState::StoppedJump);
        for (s, why) in [(0, 0), (3, 0), (3, 3), (4, 0), (-1, 1), (i32::MIN, i32::MAX)] {
            assert_eq!(state(s, why), ProgramState::Unknown);
        }
    }
}
