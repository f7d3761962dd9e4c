//! Every interleaving of two threads at a ring, and every value that a load may then return.

use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::thread;

use crate::handover::handover;
use crate::rtrb::RingBuffer;

/// Runs `meeting` in every interleaving, and returns their number.
fn every_order(meeting: impl Fn() + Send + Sync + 'static) {
    let orders = std::sync::Arc::new(std::sync::atomic::AtomicU64::new(0));
    let seen = orders.clone();
    loom::model(move || {
        seen.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        meeting();
    });
    let orders = orders.load(std::sync::atomic::Ordering::Relaxed);
    println!("{orders} orders of events");
    assert!(orders > 10, "nothing was tried");
}

/// Places of the rings under test.
const PLACES: usize = 2;

/// The memory of a ring's places as loom sees it: reading or writing one without an order between the threads
/// fails the test.
#[derive(Default)]
struct Places([UnsafeCell<u64>; PLACES]);

// SAFETY: the tests check exactly this; loom fails them at the first unordered access.
unsafe impl Sync for Places {}

impl Places {
    /// Writes the `k`-th item (from 0) into the place that the ring gives it.
    fn write(&self, k: usize, value: u64) {
        // SAFETY: loom has checked that no other thread is at this place when the pointer is handed out.
        self.0[k % PLACES].with_mut(|place| unsafe { *place = value });
    }

    fn read(&self, k: usize) -> u64 {
        // SAFETY: as in `write`.
        self.0[k % PLACES].with(|place| unsafe { *place })
    }
}

/// What travels: the item's number; its contents stand in the places.
#[derive(Debug)]
struct Item {
    k: usize,
    value: u64,
}

#[test]
fn a_ring_passes_every_item_on_once_whole_and_in_order() {
    every_order(|| {
        let (mut producer, mut consumer) = RingBuffer::new(PLACES);
        let places = Arc::new(Places::default());
        let theirs = places.clone();
        let thread = thread::spawn(move || {
            let mut pushed = 0;
            for value in 10..13 {
                // A full ring drops the newest.
                if producer.slots() > 0 {
                    theirs.write(pushed, value);
                    assert!(producer.push(Item { k: pushed, value }).is_ok());
                    pushed += 1;
                }
            }
            pushed
        });
        let mut popped = 0;
        let mut last = 0;
        let mut take = |item: &Item| {
            assert_eq!((item.k, item.value), (popped, places.read(item.k)));
            assert!(item.value > last);
            (popped, last) = (popped + 1, item.value);
        };
        for _ in 0..2 {
            // Read before the place is given back.
            if let Ok(item) = consumer.peek() {
                take(item);
                consumer.pop().unwrap();
            }
        }
        let pushed = thread.join().unwrap();
        while let Ok(item) = consumer.peek() {
            take(item);
            consumer.pop().unwrap();
        }
        assert_eq!(popped, pushed);
        assert!(pushed >= PLACES);
    });
}

#[test]
fn the_newest_set_is_found_whole_and_every_other_one_is_counted() {
    const SETS: u64 = 4;
    every_order(|| {
        let (mut outbox, mut mailbox) = handover(PLACES);
        let places = Arc::new(Places::default());
        let theirs = places.clone();
        let thread = thread::spawn(move || {
            let (mut overtaken, mut k) = (0, 0);
            for value in 1..=SETS {
                overtaken += u64::from(outbox.announce());
                k += usize::from(outbox.put(|| {
                    theirs.write(k, value);
                    Item { k, value }
                }));
            }
            (outbox, overtaken, k)
        });
        let (mut used, mut newest, mut overtaken) = (0, 0, 0);
        let mut tick = || {
            let Some(waiting) = mailbox.look() else { return };
            let set = waiting.newest().unwrap();
            assert!(set.value > newest, "an older set after a newer one");
            assert_eq!(places.read(set.k), set.value, "torn, or written while it was read");
            (used, newest) = (used + 1, set.value);
            overtaken += waiting.give_back();
        };
        tick();
        tick();
        let (mut outbox, unput, k) = thread.join().unwrap();
        tick();
        // What found no room is put as soon as there is some.
        outbox.put(|| {
            places.write(k, SETS);
            Item { k, value: SETS }
        });
        tick();
        assert_eq!(newest, SETS, "the newest set was lost");
        assert_eq!(used + overtaken + unput, SETS, "a set is neither used nor counted");
    });
}

#[test]
fn ends_may_go_away_in_any_order_and_what_is_left_is_freed_once() {
    every_order(|| {
        // loom counts its own `Arc`s, and fails where one is never freed or freed twice.
        let (mut producer, mut consumer) = RingBuffer::new(PLACES);
        let thread = thread::spawn(move || {
            let _ = producer.push(Arc::new(1));
            let _ = producer.push(Arc::new(2));
        });
        drop(consumer.pop());
        drop(consumer);
        thread.join().unwrap();
    });
}
