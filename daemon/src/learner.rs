//! The learner thread: grid steps in, promoted weights out.
//!
//! Contract: never makes the real-time thread wait. What the rings and the channel cannot hold is dropped and
//! counted; of several sets of weights the newest reaches the loop. A panic ends learning, not the daemon:
//! the loop continues with the weights it has, and the board reports it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, TrySendError};

use foretrace_control::learn::{LearnCounters, LearnError, Learner, LearnerSettings, Promotion};
use foretrace_control::predict::OnlineWeights;

use crate::rt::tick::LearnerRings;

/// Sleep between two looks into its ring; a grid step takes longer.
const PAUSE: Duration = Duration::from_millis(4);
/// Steps learned from between two looks at the orders.
const BATCH: usize = 256;

/// Figures of the learner, readable at any time by threads that may wait: the loop does not.
#[derive(Debug, Default)]
pub struct LearnerBoard(Mutex<LearnerView>);

/// A copy of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LearnerView {
    /// Grid steps learned from.
    pub updates: u64,
    /// Sets of weights handed to the loop because they were better.
    pub promotions: u64,
    /// Sets of weights rolled back.
    pub rollbacks: u64,
    /// Candidates discarded and steps refused.
    pub refused: u64,
    /// Sets of weights that a newer one overtook before there was room for them in the ring.
    pub overtaken: u64,
    /// Events lost because the channel was full.
    pub events_lost: u64,
    /// The thread has ended by a fault.
    pub failed: bool,
}

impl LearnerBoard {
    /// A copy of the figures of this moment.
    #[must_use]
    pub fn view(&self) -> LearnerView {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut LearnerView)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn show(&self, LearnCounters { updates, refused, courses, .. }: LearnCounters) {
        self.change(|view| {
            (view.updates, view.promotions, view.rollbacks) =
                (updates, courses.promotions, courses.rollbacks);
            view.refused = refused + courses.poisoned + courses.abandoned;
        });
    }
}

/// An event for the log.
#[derive(Debug, Clone, PartialEq)]
pub enum LearnerEvent {
    /// The live weights changed.
    Promoted(Promotion),
    /// New rules are in force, or were refused.
    Rules(Result<(), LearnError>),
    /// The thread ends by a fault.
    Failed(String),
}

/// What the supervisor may change while it runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnerOrder {
    pub enabled: bool,
    /// Rules from now on; the live weights stay.
    pub settings: LearnerSettings,
}

/// Channels of the thread besides its rings.
#[derive(Debug)]
pub struct LearnerLinks {
    pub board: Arc<LearnerBoard>,
    /// Events for the log.
    pub events: Sender<LearnerEvent>,
    /// Copies of the sets handed over, for recordings.
    pub copies: Sender<Box<OnlineWeights>>,
    /// Orders of the supervisor.
    pub orders: Receiver<LearnerOrder>,
    /// Set when the thread should end.
    pub quit: Arc<AtomicBool>,
}

impl LearnerLinks {
    /// Sends an event, or counts it as lost. Not counted once the receiver is gone.
    fn report(&self, event: LearnerEvent) {
        if let Err(TrySendError::Full(_)) = self.events.try_send(event) {
            self.board.change(|view| view.events_lost += 1);
        }
    }

    /// Sends a copy of a set that the loop will find, or counts it as lost.
    fn copy(&self, weights: &OnlineWeights) {
        if let Err(TrySendError::Full(_)) = self.copies.try_send(Box::new(*weights)) {
            self.board.change(|view| view.events_lost += 1);
        }
    }
}

/// Starts the thread.
///
/// # Errors
/// The system refuses another thread.
pub fn spawn(
    learner: Learner,
    enabled: bool,
    rings: LearnerRings,
    links: LearnerLinks,
) -> std::io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name("foretrace-learn".to_owned()).spawn(move || {
        guarded(&links, || run(learner, enabled, rings, &links));
    })
}

/// Runs `work`; a panic is reported and ends this thread only.
fn guarded(links: &LearnerLinks, work: impl FnOnce()) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(work)) {
        links.board.change(|view| view.failed = true);
        links.report(LearnerEvent::Failed(panic_text(panic.as_ref())));
    }
}

/// The message of a panic.
pub(crate) fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "unknown cause".to_owned())
}

fn run(mut learner: Learner, mut enabled: bool, mut rings: LearnerRings, links: &LearnerLinks) {
    while !links.quit.load(Ordering::Acquire) {
        while let Ok(order) = links.orders.try_recv() {
            enabled = order.enabled;
            if order.settings != *learner.settings() {
                let renewed = Learner::from_weights(order.settings, learner.models(), *learner.weights());
                let outcome = renewed.map(|renewed| learner = renewed);
                links.report(LearnerEvent::Rules(outcome));
            }
        }
        let mut learned = 0;
        while learned < BATCH
            && let Ok(step) = rings.learn.pop()
        {
            learned += 1;
            if !enabled {
                continue;
            }
            let lesson = learner.learn(&step);
            for promotion in lesson.promotions() {
                links.report(LearnerEvent::Promoted(*promotion));
            }
            if lesson.hand_over && rings.weights.announce() {
                links.board.change(|view| view.overtaken += 1);
            }
        }
        links.board.show(learner.counters());
        // The newest set is always the learner's own.
        if rings.weights.put(|| *learner.weights()) {
            links.copy(learner.weights());
        }
        if learned < BATCH {
            std::thread::sleep(PAUSE);
        }
    }
}

#[cfg(test)]
mod tests {
    use crossbeam::channel;

    use foretrace_control::pen::Motion;
    use foretrace_control::predict::{LearnStep, PenStep};
    use foretrace_control::predict::{ModelSettings, Models, Networks};

    use super::*;
    use crate::rt::handover::{Mailbox, handover};

    const STEP_NS: u64 = 10_000_000;

    fn models() -> Models {
        Models::new(ModelSettings::preset(STEP_NS), Networks::default()).unwrap()
    }

    struct Bench {
        board: Arc<LearnerBoard>,
        events: Receiver<LearnerEvent>,
        orders: Sender<LearnerOrder>,
        quit: Arc<AtomicBool>,
    }

    fn links() -> (LearnerLinks, Bench) {
        let (events_in, events) = channel::bounded(64);
        let (orders, orders_out) = channel::bounded(4);
        let (board, quit) = (Arc::new(LearnerBoard::default()), Arc::new(AtomicBool::new(false)));
        // Nobody records.
        let (copies, _) = channel::bounded(1);
        let links = LearnerLinks {
            board: board.clone(),
            events: events_in,
            copies,
            orders: orders_out,
            quit: quit.clone(),
        };
        (links, Bench { board, events, orders, quit })
    }

    /// A circle at 1.5 turns a second, about 10 units per step.
    fn circle(index: u64) -> LearnStep {
        let angle = index as f64 * 0.094;
        let x = [10.0 * angle.cos(), 10.0 * angle.sin()];
        let (motion, pen) = (Motion::Continues, PenStep { x, ..PenStep::default() });
        LearnStep { index, motion, pen, ..LearnStep::default() }
    }

    fn take(mailbox: &mut Mailbox<OnlineWeights>) -> Option<OnlineWeights> {
        let waiting = mailbox.look()?;
        let newest = waiting.newest().copied();
        waiting.give_back();
        newest
    }

    fn until(mut claim: impl FnMut() -> bool) {
        for _ in 0..2000 {
            if claim() {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("did not happen within 10 s");
    }

    #[test]
    fn better_weights_reach_the_mailbox_and_the_board() {
        let (mut steps, learn) = rtrb::RingBuffer::new(512);
        let (weights, mut mailbox) = handover(4);
        let (links, bench) = links();
        let learner = Learner::new(LearnerSettings::preset(STEP_NS, 0), &models()).unwrap();
        let thread = spawn(learner, true, LearnerRings { learn, weights }, links).unwrap();
        let mut index = 0;
        while bench.board.view().promotions == 0 {
            while steps.push(circle(index)).is_ok() {
                index += 1;
            }
            assert!(index < 1_000_000, "nothing was promoted");
            std::thread::sleep(Duration::from_millis(1));
        }
        until(|| mailbox.look().is_some());
        // Sets with new bands only are among them.
        let mut promoted = false;
        until(|| {
            while let Some(received) = take(&mut mailbox) {
                assert!(received.version > 0 && received.validate().is_ok());
                promoted |= received.dybm.version > 0;
            }
            while steps.push(circle(index)).is_ok() {
                index += 1;
            }
            promoted
        });
        assert!(matches!(bench.events.try_recv(), Ok(LearnerEvent::Promoted(_))));
        assert!(bench.board.view().updates > 0);
        bench.quit.store(true, Ordering::Release);
        thread.join().unwrap();
    }

    #[test]
    fn a_learner_that_is_switched_off_learns_nothing() {
        let (mut steps, learn) = rtrb::RingBuffer::new(512);
        let (weights, mut mailbox) = handover(4);
        let (links, bench) = links();
        let settings = LearnerSettings::preset(STEP_NS, 0);
        let learner = Learner::new(settings, &models()).unwrap();
        let thread = spawn(learner, false, LearnerRings { learn, weights }, links).unwrap();
        for index in 0..500 {
            steps.push(circle(index)).unwrap();
        }
        until(|| steps.slots() == 512);
        assert_eq!(bench.board.view().updates, 0);
        assert!(mailbox.look().is_none());
        bench.orders.send(LearnerOrder { enabled: true, settings }).unwrap();
        let mut index = 500;
        until(|| bench.orders.is_empty());
        while bench.board.view().updates == 0 {
            while steps.push(circle(index)).is_ok() {
                index += 1;
            }
            assert!(index < 1_000_000, "nothing was learned");
            std::thread::sleep(Duration::from_millis(1));
        }
        bench.quit.store(true, Ordering::Release);
        thread.join().unwrap();
    }

    #[test]
    fn what_nobody_takes_is_counted_and_the_newest_set_waits() {
        let (mut steps, learn) = rtrb::RingBuffer::new(512);
        let (weights, mut mailbox) = handover(1);
        let (mut links, bench) = links();
        let (full, _kept) = channel::bounded(1);
        full.send(LearnerEvent::Rules(Ok(()))).unwrap();
        links.events = full;
        let learner = Learner::new(LearnerSettings::preset(STEP_NS, 0), &models()).unwrap();
        let thread = spawn(learner, true, LearnerRings { learn, weights }, links).unwrap();
        let mut index = 0;
        while bench.board.view().events_lost == 0 || bench.board.view().overtaken == 0 {
            while steps.push(circle(index)).is_ok() {
                index += 1;
            }
            assert!(index < 1_000_000, "nothing was lost");
            std::thread::sleep(Duration::from_millis(1));
        }
        until(|| mailbox.look().is_some());
        let old = take(&mut mailbox).unwrap();
        // The set that waited is the newest, not the one after.
        until(|| mailbox.look().is_some());
        assert!(take(&mut mailbox).unwrap().version > old.version);
        bench.quit.store(true, Ordering::Release);
        thread.join().unwrap();
    }

    #[test]
    fn a_panic_in_the_learner_is_seen_and_ends_nothing_else() {
        let (links, bench) = links();
        std::thread::spawn(move || guarded(&links, || panic!("weights on fire"))).join().unwrap();
        assert!(bench.board.view().failed);
        assert_eq!(bench.events.try_recv(), Ok(LearnerEvent::Failed("weights on fire".to_owned())));
    }
}
