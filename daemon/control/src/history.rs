//! The newest values of a sequence, each under its number.
//!
//! Contract: fixed size, total. Numbers count on; what is older than the newest `N` is dropped.

use crate::state::{State, state};

/// A ring of the newest `N` values.
#[derive(Debug, Clone)]
pub(crate) struct History<T, const N: usize> {
    ring: [T; N],
    /// First number since the last restart, and one past the newest.
    begin: u64,
    end: u64,
}

state! { [T: State, const N: usize] History<T, N> { ring, begin, end } }

impl<T: Copy, const N: usize> History<T, N> {
    /// Without values; `blank` fills the memory.
    pub(crate) const fn new(blank: T) -> Self {
        Self { ring: [blank; N], begin: 0, end: 0 }
    }

    /// Drops everything; the next value gets `number`.
    pub(crate) const fn restart(&mut self, number: u64) {
        (self.begin, self.end) = (number, number);
    }

    /// The next value gets `number`; those between it and the newest are unknown and must be of no interest.
    pub(crate) const fn go_on_at(&mut self, number: u64) {
        self.end = number;
    }

    /// Adds the next value.
    pub(crate) fn push(&mut self, value: T) {
        if let Some(slot) = self.ring.get_mut(self.end as usize % N) {
            *slot = value;
        }
        self.end = self.end.wrapping_add(1);
    }

    /// The first number that is still kept.
    pub(crate) fn begin(&self) -> u64 {
        self.begin.max(self.end.saturating_sub(N as u64))
    }

    /// One past the number of the newest value.
    pub(crate) const fn end(&self) -> u64 {
        self.end
    }

    /// Nothing was dropped since the last restart.
    pub(crate) const fn is_whole(&self) -> bool {
        self.end.saturating_sub(self.begin) <= N as u64
    }

    /// The value with `number`, if it is kept.
    pub(crate) fn get(&self, number: u64) -> Option<&T> {
        if (self.begin()..self.end).contains(&number) { self.ring.get(number as usize % N) } else { None }
    }

    /// The value `age` values before the newest, if it is kept.
    pub(crate) fn back(&self, age: u64) -> Option<&T> {
        self.get(self.end.checked_sub(age)?.checked_sub(1)?)
    }

    pub(crate) fn newest_mut(&mut self) -> Option<&mut T> {
        let newest = self.end.checked_sub(1).filter(|newest| *newest >= self.begin)?;
        self.ring.get_mut(newest as usize % N)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_are_kept_under_their_numbers() {
        let mut history = History::<u32, 4>::new(0);
        assert_eq!((history.back(0), history.get(0)), (None, None));
        assert_eq!(history.newest_mut(), None);
        history.restart(100);
        for value in 0..6 {
            assert_eq!(history.is_whole(), history.end() <= 104);
            history.push(value);
        }
        assert_eq!((history.begin(), history.end(), history.is_whole()), (102, 106, false));
        assert_eq!([101, 102, 105, 106].map(|k| history.get(k).copied()), [None, Some(2), Some(5), None]);
        assert_eq!([0, 3, 4].map(|age| history.back(age).copied()), [Some(5), Some(2), None]);
        if let Some(newest) = history.newest_mut() {
            *newest = 9;
        }
        assert_eq!(history.back(0), Some(&9));
        history.restart(7);
        assert_eq!((history.back(0), history.get(105)), (None, None));
        assert_eq!(history.newest_mut(), None);
    }

    #[test]
    fn a_sequence_that_goes_on_later_keeps_what_is_near_enough() {
        let mut history = History::<u32, 4>::new(0);
        history.restart(10);
        history.push(1);
        history.go_on_at(12);
        history.push(2);
        assert_eq!((history.get(10), history.get(12), history.end()), (Some(&1), Some(&2), 13));
    }

    #[test]
    fn a_state_that_makes_no_sense_is_no_panic() {
        for (begin, end) in [(5, 2), (u64::MAX, 0), (0, u64::MAX), (u64::MAX, u64::MAX)] {
            let mut history = History::<u32, 4> { ring: [0; 4], begin, end };
            let _ = (history.back(0), history.get(begin), history.get(end), history.is_whole());
            let _ = history.newest_mut();
            history.push(1);
        }
    }
}
