//! Real-time priority for commands that keep the cycle of a controller.

use std::time::Duration;

use foretrace_config::Settings;
use foretraced::rt::os::set_fifo;

use crate::os;
use crate::output::note;

/// So far below the loop, whose commands they take.
const BELOW_THE_LOOP: u32 = 10;
/// Longest that a thread with priority may compute without a pause: then the kernel ends its process
/// (SIGXCPU), because on its CPU nothing but the loop runs until then. Its cycles take less than 10 ms.
const SPINS: Duration = Duration::from_millis(200);

/// SCHED_FIFO priority of an arm's process.
pub(crate) fn below_the_loop(settings: &Settings) -> u32 {
    settings.control_loop.priority.saturating_sub(BELOW_THE_LOOP).max(1)
}

/// Puts this thread under SCHED_FIFO at `priority`, and every thread that it starts from now on; one that
/// spins ends the process. Returns what is missing, in words, having told it; nothing stops without.
pub(crate) fn ask(who: &str, priority: u32) -> Option<String> {
    let missing = match os::limit_spin(SPINS) {
        Ok(()) => set_fifo(priority).err()?.text,
        Err(error) => format!("no priority: RLIMIT_RTTIME cannot be set ({error})"),
    };
    note!("{who}: {missing}");
    Some(missing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_said_and_nothing_stops() {
        let text = std::thread::spawn(|| ask("test", 1000)).join().unwrap().unwrap();
        assert!(text.contains("from 1 to 99"), "{text}");
    }
}
