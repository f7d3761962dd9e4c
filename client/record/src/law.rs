//! The law of any horizon, behind one interface, and how it runs with what a forged file holds.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

use foretrace_control::follower::{
    Budget, Follower, FollowerError, FollowerSettings, NoClock, StepInput, StepOutput,
};
use foretrace_control::state::{self, StateError};
use foretrace_shm::JOINTS;

thread_local! {
    /// This thread's panics are answered by an error.
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work`; `None` if it panicked, which prints nothing: for what a forged recording can do to a law.
pub(crate) fn quietly<T>(work: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !QUIET.get() {
                before(info);
            }
        }));
    });
    let outer = QUIET.replace(true);
    let done = catch_unwind(AssertUnwindSafe(work)).ok();
    QUIET.set(outer);
    done
}

pub(crate) trait Law {
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
