//! Publishing and receiving allocate nothing once the ports are connected, as the real-time thread needs it.
//!
//! A separate binary, because the counting allocator is global. Counts are per thread, so other threads do
//! not interfere.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use foretrace_shm::*;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // Fails only while the thread is torn down.
    let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
}

// SAFETY: every call is handed to the system allocator unchanged; counting touches no heap.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: `pointer` came from `System.alloc` with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: `pointer` came from `System.alloc` with this layout.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations_during(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.with(Cell::get);
    work();
    ALLOCATIONS.with(Cell::get) - before
}

#[test]
fn the_loop_allocates_only_when_a_port_connects() {
    let folder = tempfile::tempdir_in("/tmp").unwrap();
    let instance = Instance::at(0, folder.path().join("i")).unwrap();
    let lock = instance.lock().unwrap();
    {
        let session = Session::create(&instance, "daemon", &lock).unwrap();
        let services = Services::create(&session).unwrap();
        let mut pen_out = services.pen.publisher().unwrap();
        let mut pen_in = services.pen.subscriber(64, HeaderBounds::DEFAULT).unwrap();
        let mut commands_out = services.joint_cmd.publisher().unwrap();
        let mut commands_in = services.joint_cmd.subscriber(1, HeaderBounds::DEFAULT).unwrap();
        let mut records_out = services.telemetry.publisher().unwrap();
        let mut records_in = services.telemetry.subscriber(256, HeaderBounds::DEFAULT).unwrap();

        let mut seen = 0;
        let mut tick = || {
            for _ in 0..3 {
                pen_out.publish(monotonic_now_ns(), PenSample::default()).unwrap();
            }
            pen_out.publish(monotonic_now_ns(), PenSample { x_m: f64::NAN, ..Default::default() }).unwrap();
            let now = monotonic_now_ns();
            pen_in.drain(|sample| seen += u64::from(!sample.contact()));
            commands_out.publish(now, JointCommand::default()).unwrap();
            records_out.publish(now, TickRecord::default()).unwrap();
            assert!(commands_in.latest().is_some());
            assert!(commands_in.latest().is_none());
            records_in.drain(|record| assert_eq!(record.tick, 0));
        };
        assert!(allocations_during(&mut tick) > 0, "connecting allocates; if not, the counter is broken");
        let in_the_loop = allocations_during(|| (0..1000).for_each(|_| tick()));
        assert_eq!(in_the_loop, 0);
        assert_eq!((seen, pen_in.rejections().total()), (3003, 1001));

        // Overflow: no subscriber reads, the oldest messages are overwritten; still nothing allocates.
        let mut idle = services.joint_cmd.subscriber(1, HeaderBounds::DEFAULT).unwrap();
        commands_out.publish(monotonic_now_ns(), JointCommand::default()).unwrap();
        assert!(idle.latest().is_some());
        let unread = allocations_during(|| {
            for _ in 0..1000 {
                commands_out.publish(monotonic_now_ns(), JointCommand::default()).unwrap();
            }
        });
        assert_eq!(unread, 0);
    }
    assert!(matches!(instance.purge(&lock), Ok(Purge::Removed(_))));
}
