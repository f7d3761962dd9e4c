//! Stops that pages ask for: one thread for all of them.
//!
//! Contract: a stop is sent before anything is logged. Those that come while one is under way are answered by
//! the next one together, so that a flood of them costs no thread and no memory beyond one entry per page.

use std::time::{Duration, Instant};

use foretrace_client::Instance;

use crate::board::{ConsoleBoard, PageReply};

/// Longest wait for the confirmation of a stop.
const STOP: Duration = Duration::from_secs(2);
/// At most one line about stops in this time.
const LINE_EVERY: Duration = Duration::from_secs(1);

/// Stops the arm of `instance` whenever a page asks, until the console ends.
pub(crate) fn serve(board: &ConsoleBoard, instance: &Instance) {
    carry_out(board, || {
        foretrace_client::stop(instance, STOP)
            .map(drop)
            .map_err(|error| format!("{error}: use the arm's own stop button"))
    });
}

fn carry_out(board: &ConsoleBoard, mut stop: impl FnMut() -> Result<(), String>) {
    let (mut reported, mut more) = (None::<Instant>, 0);
    loop {
        let over = board.is_over();
        let asked = board.stops.next(LINE_EVERY);
        if asked.is_empty() {
            if more > 0 && reported.is_none_or(|at| at.elapsed() >= LINE_EVERY) {
                board.note(&format!("{more} more stops asked for"));
                (reported, more) = (Some(Instant::now()), 0);
            }
            if over {
                return;
            }
            continue;
        }
        let reply = PageReply::from(stop().map(|()| "the arm stops".to_owned()));
        let times: u64 = asked.iter().map(|one| one.times).sum();
        for one in &asked {
            // The page may be gone.
            let _ = one.reply.send(reply.clone());
        }
        board.count(|tally| tally.stops += times);
        if reported.is_some_and(|at| at.elapsed() < LINE_EVERY) {
            more += times;
        } else {
            let pages: Vec<&str> = asked.iter().map(|one| one.address.as_str()).collect();
            let before = if more > 0 { format!("; {more} more before") } else { String::new() };
            board.note(&format!(
                "stop, asked for by the page of {}: {}{before}",
                pages.join(", "),
                reply.words
            ));
            (reported, more) = (Some(Instant::now()), 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keys::Keys;
    use foretrace_serve::guard::Token;
    use std::sync::mpsc::{channel, sync_channel};

    #[test]
    fn a_flood_of_stops_is_coalesced_and_every_page_is_answered_while_nobody_reads_the_log() {
        // A log that nobody drains, with room for one line.
        let (lines, said) = sync_channel(1);
        let board = ConsoleBoard::new(
            Keys::new(Token::random().unwrap(), false),
            lines,
            sync_channel(2).0,
            sync_channel(2).0,
        );
        let answers: Vec<_> = (0..3)
            .map(|page| {
                let (reply, answers) = channel();
                for _ in 0..1000 {
                    board.stops.ask(page, "here", &reply);
                }
                answers
            })
            .collect();
        let late = channel();
        let mut sent = 0;
        carry_out(&board, || {
            sent += 1;
            if sent == 1 {
                // One that comes while another is under way needs a stop of its own.
                board.stops.ask(7, "late", &late.0);
                board.finish();
            }
            Ok(())
        });
        assert_eq!((sent, board.tally().stops), (2, 3001));
        for answers in answers.iter().chain([&late.1]) {
            assert!(answers.recv().unwrap().done);
        }
        assert_eq!(said.iter().take(1).count(), 1);
    }
}
