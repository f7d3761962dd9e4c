//! Questions that damaged shared memory can make hang: asked in a thread that is abandoned after a time.

use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

/// The answer of `ask`, unless it takes too long.
pub fn within<T: Send + 'static>(patience: Duration, ask: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    asked(ask)?.recv_timeout(patience).ok()
}

/// Where the answer of `ask` will come. One that hangs keeps its thread, which ends with the process.
pub(crate) fn asked<T: Send + 'static>(ask: impl FnOnce() -> T + Send + 'static) -> Option<Receiver<T>> {
    let (answer, answered) = mpsc::channel();
    let asking = move || {
        // The receiver may be gone.
        let _ = answer.send(ask());
    };
    let spawned = std::thread::Builder::new().name("foretrace-bounded".to_owned()).spawn(asking);
    spawned.ok().map(|_| answered)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_question_that_takes_too_long_is_given_up() {
        assert_eq!(within(Duration::from_secs(60), || 5), Some(5));
        let (hold, held) = mpsc::channel::<()>();
        assert_eq!(within(Duration::from_millis(10), move || held.recv().is_ok()), None);
        drop(hold);
    }
}
