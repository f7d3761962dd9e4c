//! Real-time priority for commands that keep the cycle of a controller.

use foretraced::rt::os;

use crate::output::note;

/// Puts this thread under SCHED_FIFO at `priority`, and every thread that it starts from now on. Returns what
/// is missing, in words, having told it; nothing stops without.
pub(crate) fn ask(who: &str, priority: u32) -> Option<String> {
    let missing = os::set_fifo(priority).err()?;
    note!("{who}: {missing}");
    Some(missing.text)
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
