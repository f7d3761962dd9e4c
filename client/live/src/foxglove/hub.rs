//! What all viewers share: their queues, the newest parameters, counts.
//!
//! Contract: locks are held for copies only. The queue of a viewer holds a bounded number of messages, the
//! newest ones; what finds no room is counted. Nobody who pushes waits.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foretrace_client::wire::TrustReason;
use foretrace_client::{Mode, Status};
use serde_json::{Value, json};

/// Messages that wait for one viewer at most: half a second of all topics at 500 Hz.
const QUEUE: usize = 1024;

/// A message of a topic.
#[derive(Debug, Clone)]
pub(crate) struct TopicMessage {
    /// Index in [`super::protocol::CHANNELS`].
    pub(crate) channel: usize,
    /// Since 1970 \[ns\].
    pub(crate) time_ns: u64,
    pub(crate) bytes: Arc<[u8]>,
}

/// What a server did.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct ViewerTally {
    /// Viewers that came in.
    pub viewers: u64,
    /// Connections and messages that were refused, and viewers that were let go, by reason.
    pub refused: BTreeMap<&'static str, u64>,
    /// Messages of topics that were sent.
    pub sent: u64,
    /// Messages of topics that found no room in the queue of a viewer, the oldest ones.
    pub dropped: u64,
    /// Stops that viewers asked for.
    pub stops: u64,
}

/// Values that viewers see, in order of their names.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ViewerParameters(Vec<(&'static str, Value)>);

impl ViewerParameters {
    /// Those of a status; numbers are rounded, so that small changes are none.
    pub(crate) fn of(status: &Status) -> Self {
        let rounded = |value: f64| json!((value * 1e3).round() * 1e-3);
        let mode = Mode::try_from(status.mode).map_or("unknown", Mode::label);
        let reason = TrustReason::try_from(status.trust_reason).map_or("unknown", TrustReason::label);
        Self(vec![
            ("mode", mode.into()),
            ("predictor", status.predictor.as_str().unwrap_or("").into()),
            ("trust", rounded(status.trust)),
            ("trust_reason", reason.into()),
            ("trust_target", rounded(status.trust_target)),
        ])
    }

    /// Those with a name of `names`; all of them if there are none.
    pub(crate) fn named(&self, names: &[String]) -> Vec<(&'static str, Value)> {
        let wanted = |name: &str| names.is_empty() || names.iter().any(|wanted| wanted == name);
        self.0.iter().filter(|(name, _)| wanted(name)).cloned().collect()
    }

    /// Those that differ from `before`.
    pub(crate) fn changed_since(&self, before: &Self) -> Self {
        Self(self.0.iter().filter(|value| !before.0.contains(value)).cloned().collect())
    }
}

/// The queue of one viewer.
#[derive(Debug, Default)]
pub(crate) struct ViewerQueue {
    /// Bit `n`: channel `n` is subscribed to.
    pub(crate) wanted: AtomicU32,
    waiting: Mutex<QueuedMessages>,
}

#[derive(Debug, Default)]
struct QueuedMessages {
    data: VecDeque<TopicMessage>,
    words: VecDeque<String>,
}

impl ViewerQueue {
    /// Returns how many messages had to go for this one.
    fn push(&self, data: TopicMessage) -> u64 {
        let mut waiting = lock(&self.waiting);
        waiting.data.push_back(data);
        u64::from(waiting.data.len() > QUEUE && waiting.data.pop_front().is_some())
    }

    /// Words for all viewers; few.
    fn say(&self, words: &str) {
        let mut waiting = lock(&self.waiting);
        waiting.words.push_back(words.to_owned());
        if waiting.words.len() > QUEUE {
            waiting.words.pop_front();
        }
    }

    /// Puts messages back before those that have come since; returns how many had to go.
    pub(crate) fn put_back(&self, mut data: VecDeque<TopicMessage>) -> u64 {
        let mut waiting = lock(&self.waiting);
        data.append(&mut waiting.data);
        let most = data.len().saturating_sub(QUEUE);
        drop(data.drain(..most));
        waiting.data = data;
        most as u64
    }

    /// Takes all that waits.
    pub(crate) fn take(&self) -> (VecDeque<String>, VecDeque<TopicMessage>) {
        let mut waiting = lock(&self.waiting);
        (std::mem::take(&mut waiting.words), std::mem::take(&mut waiting.data))
    }
}

#[derive(Debug, Default)]
pub(crate) struct Hub {
    queues: Mutex<Vec<Arc<ViewerQueue>>>,
    tally: Mutex<ViewerTally>,
    parameters: Mutex<(u64, Arc<ViewerParameters>)>,
    /// The newest message of a topic that whoever comes later needs too.
    kept: Mutex<Option<TopicMessage>>,
    /// Now, since 1970 \[ns\]; at least ten times a second.
    pub(crate) now_ns: AtomicU64,
    over: AtomicBool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    /// A viewer comes in.
    pub(crate) fn enter(&self) -> Arc<ViewerQueue> {
        let queue = Arc::new(ViewerQueue::default());
        lock(&self.queues).push(queue.clone());
        queue
    }

    pub(crate) fn leave(&self, queue: &Arc<ViewerQueue>) {
        lock(&self.queues).retain(|known| !Arc::ptr_eq(known, queue));
    }

    /// Whether anybody wants channel `channel`.
    pub(crate) fn wants(&self, channel: usize) -> bool {
        lock(&self.queues).iter().any(|queue| queue.wanted.load(Ordering::Relaxed) & (1 << channel) != 0)
    }

    /// Puts a message into the queue of every viewer that wants it.
    pub(crate) fn publish(&self, data: &TopicMessage) {
        let wants =
            |queue: &&Arc<ViewerQueue>| queue.wanted.load(Ordering::Relaxed) & (1 << data.channel) != 0;
        let dropped =
            lock(&self.queues).iter().filter(wants).map(|queue| queue.push(data.clone())).sum::<u64>();
        if dropped > 0 {
            self.count(|tally| tally.dropped += dropped);
        }
    }

    /// The same, and for every viewer that subscribes later.
    pub(crate) fn keep(&self, data: TopicMessage) {
        let mut kept = lock(&self.kept);
        self.publish(&data);
        *kept = Some(data);
    }

    /// The message that was kept, if it is of this channel. Whoever first wants the channel and then asks
    /// misses none: what is not kept yet is published from now on.
    pub(crate) fn kept(&self, channel: usize) -> Option<TopicMessage> {
        lock(&self.kept).clone().filter(|data| data.channel == channel)
    }

    /// Says a text to every viewer.
    pub(crate) fn say(&self, words: &str) {
        lock(&self.queues).iter().for_each(|queue| queue.say(words));
    }

    pub(crate) fn show(&self, parameters: ViewerParameters) {
        let mut shown = lock(&self.parameters);
        *shown = (shown.0 + 1, Arc::new(parameters));
    }

    /// How often parameters were shown, and the newest ones.
    pub(crate) fn parameters(&self) -> (u64, Arc<ViewerParameters>) {
        lock(&self.parameters).clone()
    }

    pub(crate) fn count(&self, change: impl FnOnce(&mut ViewerTally)) {
        change(&mut lock(&self.tally));
    }

    pub(crate) fn refuse(&self, reason: &'static str) {
        self.count(|tally| *tally.refused.entry(reason).or_default() += 1);
    }

    pub(crate) fn tally(&self) -> ViewerTally {
        lock(&self.tally).clone()
    }

    pub(crate) fn finish(&self) {
        self.over.store(true, Ordering::Release);
    }

    pub(crate) fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_viewer_that_does_not_take_keeps_the_newest_and_costs_no_other_one_anything() {
        let hub = Hub::default();
        let (slow, fast) = (hub.enter(), hub.enter());
        slow.wanted.store(1, Ordering::Relaxed);
        fast.wanted.store(1, Ordering::Relaxed);
        assert!(hub.wants(0) && !hub.wants(1));
        let mut taken = Vec::new();
        for time_ns in 1..=3 * QUEUE as u64 {
            hub.publish(&TopicMessage { channel: 0, time_ns, bytes: Arc::new([]) });
            hub.publish(&TopicMessage { channel: 1, time_ns, bytes: Arc::new([]) });
            taken.extend(fast.take().1.into_iter().map(|data| data.time_ns));
        }
        assert_eq!(taken, (1..=3 * QUEUE as u64).collect::<Vec<_>>());
        let kept: Vec<u64> = slow.take().1.into_iter().map(|data| data.time_ns).collect();
        assert_eq!(kept, (2 * QUEUE as u64 + 1..=3 * QUEUE as u64).collect::<Vec<_>>());
        assert_eq!(hub.tally().dropped, 2 * QUEUE as u64);
        // What it could not take stands before what has come since.
        let data = |time_ns| TopicMessage { channel: 0, time_ns, bytes: Arc::new([]) };
        hub.publish(&data(3));
        assert_eq!(slow.put_back([data(1), data(2)].into()), 0);
        assert_eq!(slow.take().1.iter().map(|data| data.time_ns).collect::<Vec<_>>(), [1, 2, 3]);
        hub.publish(&data(3));
        assert_eq!(slow.put_back((0..QUEUE as u64).map(data).collect()), 1);
        assert_eq!(slow.take().1.front().map(|data| data.time_ns), Some(1), "the oldest goes");
        hub.leave(&slow);
        assert!(!hub.wants(1) && hub.wants(0));
    }

    #[test]
    fn whoever_subscribes_while_a_message_is_kept_does_not_miss_it() {
        for _ in 0..2000 {
            let hub = Arc::new(Hub::default());
            let queue = hub.enter();
            let keeper = hub.clone();
            let keeping = std::thread::spawn(move || {
                keeper.keep(TopicMessage { channel: 3, time_ns: 1, bytes: Arc::new([]) });
            });
            queue.wanted.store(1 << 3, Ordering::Relaxed);
            let kept = hub.kept(3);
            keeping.join().unwrap();
            assert!(kept.is_some() || queue.take().1.len() == 1);
        }
    }

    #[test]
    fn only_parameters_that_changed_are_reported_again() {
        let mut status = Status { trust: 0.5, mode: Mode::Following.into(), ..Status::default() };
        let before = ViewerParameters::of(&status);
        status.trust = 0.5001;
        assert_eq!(ViewerParameters::of(&status), before);
        status.trust = 0.51;
        let changed = ViewerParameters::of(&status).changed_since(&before);
        assert_eq!(changed.named(&[]), [("trust", json!(0.51))]);
        assert_eq!(before.named(&["mode".to_owned()]), [("mode", json!("following"))]);
        assert!(before.named(&["nothing".to_owned()]).is_empty());
    }
}
