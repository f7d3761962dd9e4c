//! State of the law as bytes: what a tick leaves for the next, written out and read back bit for bit.
//!
//! Contract: [`State::save`] writes into memory that the caller has, allocates nothing and never fails: what
//! does not fit is only counted. [`State::load`] fills in a value that was built from the same settings; it
//! trusts no length, mark or index. What follows from settings alone is not part of the state. A field that
//! is neither carried nor named as fixed does not compile.

mod values;

/// Why bytes are not a state of this law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    /// They end too early.
    #[error("the state ends after {have} bytes, in the middle of a value: it is incomplete, record anew")]
    Short {
        /// Bytes that there are.
        have: usize,
    },
    /// They go on after the last value.
    #[error("{left} bytes follow the state: it belongs to other settings or to another version")]
    Long {
        /// Bytes after the last value.
        left: usize,
    },
    /// A number that stands for a choice is unknown.
    #[error("byte {at} of the state has the mark {got}, {most} is the largest that there is")]
    Mark {
        /// Byte of the state.
        at: usize,
        /// The mark that was found.
        got: u64,
        /// Largest mark that there is.
        most: u64,
    },
    /// A list has another length than the settings give it.
    #[error(
        "at byte {at} of the state a list has {got} entries, the settings give it {wanted}: use the settings \
         of the recording"
    )]
    Length {
        /// Byte of the state.
        at: usize,
        /// Entries that the list has.
        got: u64,
        /// Length of the law's own list, or the most that it may have.
        wanted: u64,
    },
    /// The law cannot be written out.
    #[error(
        "the solver keeps its memory to itself, so that the state of this law cannot be carried over: use the \
         exact solver"
    )]
    Foreign,
}

/// Where a state is written to.
#[derive(Debug)]
pub struct Writer<'a> {
    bytes: &'a mut [u8],
    at: usize,
    foreign: bool,
}

impl<'a> Writer<'a> {
    /// Writes to the front of `bytes`.
    #[must_use]
    pub fn new(bytes: &'a mut [u8]) -> Self {
        Self { bytes, at: 0, foreign: false }
    }

    /// Appends `bytes`, if they fit.
    pub fn put(&mut self, bytes: &[u8]) {
        let end = self.at.saturating_add(bytes.len());
        if let Some(slot) = self.bytes.get_mut(self.at..end) {
            slot.copy_from_slice(bytes);
        }
        self.at = end;
    }

    /// Bytes that the state has, whether they fitted or not.
    #[must_use]
    pub const fn wanted(&self) -> usize {
        self.at
    }

    /// The bytes written; `None` if there was too little room, or something cannot be written out.
    #[must_use]
    pub fn finish(self) -> Option<usize> {
        (self.at <= self.bytes.len() && !self.foreign).then_some(self.at)
    }

    /// Something cannot be written out.
    pub(crate) const fn give_up(&mut self) {
        self.foreign = true;
    }
}

/// Where a state is read from.
#[derive(Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Reads from the front of `bytes`.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// Takes `N` bytes.
    ///
    /// # Errors
    ///
    /// There are too few.
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], StateError> {
        let short = StateError::Short { have: self.bytes.len() };
        let bytes = self.bytes.get(self.at..).and_then(<[u8]>::first_chunk).ok_or(short)?;
        self.at += N;
        Ok(*bytes)
    }

    /// A mark of at most `most`.
    ///
    /// # Errors
    ///
    /// Too few bytes, or a larger mark.
    pub fn mark(&mut self, most: u8) -> Result<u8, StateError> {
        let at = self.at;
        let [got] = self.take()?;
        if got > most {
            return Err(StateError::Mark { at, got: got.into(), most: most.into() });
        }
        Ok(got)
    }

    /// A length; `fits` says which are legal, `wanted` what to say about others.
    fn length(&mut self, wanted: usize, fits: impl Fn(usize) -> bool) -> Result<usize, StateError> {
        let at = self.at;
        let got = u64::from_le_bytes(self.take()?);
        let error = StateError::Length { at, got, wanted: wanted as u64 };
        usize::try_from(got).ok().filter(|length| fits(*length)).ok_or(error)
    }

    /// Nothing may be left.
    ///
    /// # Errors
    ///
    /// Bytes are left.
    pub fn end(&self) -> Result<(), StateError> {
        match self.bytes.len().saturating_sub(self.at) {
            0 => Ok(()),
            left => Err(StateError::Long { left }),
        }
    }
}

/// Something that a tick leaves for the next.
pub trait State {
    /// Appends it to `to`.
    fn save(&self, to: &mut Writer<'_>);

    /// Takes it from `from`.
    ///
    /// # Errors
    ///
    /// The bytes are no state of a law with these settings; part of `self` may have changed.
    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError>;
}

/// A state that can be made from nothing, to be filled in.
pub trait Blank: State {
    /// Any value; it is overwritten.
    fn blank() -> Self;
}

/// Writes `state` into `bytes`; returns how many it took, `None` if it has no room there or cannot be
/// written.
#[must_use]
pub fn write(state: &(impl State + ?Sized), bytes: &mut [u8]) -> Option<usize> {
    let mut to = Writer::new(bytes);
    state.save(&mut to);
    to.finish()
}

/// `state` as bytes; `None` if it cannot be written. Allocates.
#[must_use]
pub fn bytes_of(state: &(impl State + ?Sized)) -> Option<Vec<u8>> {
    let mut measured = Writer::new(&mut []);
    state.save(&mut measured);
    let mut bytes = vec![0; measured.wanted()];
    write(state, &mut bytes)?;
    Some(bytes)
}

/// Fills `state` in from all of `bytes`.
///
/// # Errors
///
/// The bytes are no state of a law with these settings; `state` is unusable then.
pub fn read(state: &mut (impl State + ?Sized), bytes: &[u8]) -> Result<(), StateError> {
    let mut from = Reader::new(bytes);
    state.load(&mut from)?;
    from.end()
}

/// Writes a part that the settings may leave out.
pub(crate) fn save_part<T: State>(part: Option<&T>, to: &mut Writer<'_>) {
    part.is_some().save(to);
    if let Some(part) = part {
        part.save(to);
    }
}

/// Reads a part that must be there exactly if the settings ask for it.
///
/// # Errors
///
/// As [`State::load`].
pub(crate) fn load_part<T: State>(part: Option<&mut T>, from: &mut Reader<'_>) -> Result<(), StateError> {
    let own = usize::from(part.is_some());
    let at = from.at;
    let got = from.mark(1)?;
    match part {
        _ if usize::from(got) != own => Err(StateError::Length { at, got: got.into(), wanted: own as u64 }),
        Some(part) => part.load(from),
        None => Ok(()),
    }
}

/// `state! { [generics] Type { carried, … } present { parts, … } fixed { from settings, … } }`; after
/// `whole`, everything is carried and a blank one can be made.
macro_rules! state {
    (whole [$($generics:tt)*] $type:ty { $($field:ident),* $(,)? }) => {
        $crate::state::state! { [$($generics)*] $type { $($field),* } }

        impl<$($generics)*> $crate::state::Blank for $type {
            fn blank() -> Self {
                Self { $($field: $crate::state::Blank::blank()),* }
            }
        }
    };
    ([$($generics:tt)*] $type:ty { $($field:ident),* $(,)? } $(present { $($part:ident),* $(,)? })?
        $(fixed { $($fixed:ident),* $(,)? })?) => {
        impl<$($generics)*> $crate::state::State for $type {
            fn save(&self, to: &mut $crate::state::Writer<'_>) {
                let Self { $($field,)* $($($part,)*)? $($($fixed: _,)*)? } = self;
                $($crate::state::State::save($field, to);)*
                $($($crate::state::save_part($part.as_ref(), to);)*)?
                let _ = to;
            }

            fn load(
                &mut self,
                from: &mut $crate::state::Reader<'_>,
            ) -> Result<(), $crate::state::StateError> {
                let Self { $($field,)* $($($part,)*)? $($($fixed: _,)*)? } = self;
                $($crate::state::State::load($field, from)?;)*
                $($($crate::state::load_part($part.as_mut(), from)?;)*)?
                let _ = from;
                Ok(())
            }
        }
    };
}
pub(crate) use state;

/// `wraps! { Type, … }`: a tuple of one field.
macro_rules! wraps {
    ($($type:ty),+) => {$(
        impl $crate::state::State for $type {
            fn save(&self, to: &mut $crate::state::Writer<'_>) {
                $crate::state::State::save(&self.0, to);
            }

            fn load(
                &mut self,
                from: &mut $crate::state::Reader<'_>,
            ) -> Result<(), $crate::state::StateError> {
                $crate::state::State::load(&mut self.0, from)
            }
        }

        impl $crate::state::Blank for $type {
            fn blank() -> Self {
                Self($crate::state::Blank::blank())
            }
        }
    )+};
}
pub(crate) use wraps;

/// `choices! { Type { Variant, … } }`: an enumeration without data, by the variants' indices in the list.
macro_rules! choices {
    ($type:ty { $first:ident $(, $other:ident)* $(,)? }) => {
        impl $crate::state::State for $type {
            fn save(&self, to: &mut $crate::state::Writer<'_>) {
                let mark = match self {
                    Self::$first => Self::$first as u8,
                    $(Self::$other => Self::$other as u8,)*
                };
                to.put(&[mark]);
            }

            fn load(
                &mut self,
                from: &mut $crate::state::Reader<'_>,
            ) -> Result<(), $crate::state::StateError> {
                let most = [Self::$first as u8 $(, Self::$other as u8)*].into_iter().max().unwrap_or(0);
                let mark = from.mark(most)?;
                *self = Self::$first;
                $(if mark == Self::$other as u8 {
                    *self = Self::$other;
                })*
                Ok(())
            }
        }

        impl $crate::state::Blank for $type {
            fn blank() -> Self {
                Self::$first
            }
        }
    };
}
pub(crate) use choices;
