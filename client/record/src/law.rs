//! The law of any horizon, behind one interface.

use foretrace_control::follower::{
    Budget, Follower, FollowerError, FollowerSettings, NoClock, StepInput, StepOutput,
};
use foretrace_control::state::{self, StateError};
use foretrace_shm::JOINTS;

/// A law.
pub(crate) trait Law {
    /// One tick.
    fn tick(&mut self, input: &StepInput<'_, JOINTS>, budget: Budget) -> StepOutput<JOINTS>;

    /// Continues from the state in `bytes`.
    ///
    /// # Errors
    ///
    /// They are no state of this law.
    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateError>;
}

impl<const N: usize> Law for Follower<N, JOINTS> {
    fn tick(&mut self, input: &StepInput<'_, JOINTS>, budget: Budget) -> StepOutput<JOINTS> {
        self.step(input, budget, &mut NoClock)
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateError> {
        state::read(self, bytes)
    }
}

/// The law of `settings` with this horizon: 10, 20, else 30.
///
/// # Errors
///
/// As [`Follower::new`].
pub(crate) fn law(settings: FollowerSettings<JOINTS>, horizon: u32) -> Result<Box<dyn Law>, FollowerError> {
    Ok(match horizon {
        10 => Box::new(Follower::<10, JOINTS>::new(settings)?),
        20 => Box::new(Follower::<20, JOINTS>::new(settings)?),
        _ => Box::new(Follower::<30, JOINTS>::new(settings)?),
    })
}
