//! Totals of the daemon since its start, part of every `TickRecord` and `Status`: everything dropped or
//! refused is counted here.

use iceoryx2::prelude::ZeroCopySend;

use super::check::Rejections;
use super::layout::wire;

wire! {
    /// Totals since the daemon started.
    "foretrace.CountersV2"
    pub struct Counters {
        /// Ticks run.
        pub ticks: u64,
        /// Ticks that ended after their deadline.
        pub overruns: u64,
        /// Whole periods dropped.
        pub skipped_ticks: u64,
        /// Ticks run with a shed budget.
        pub shed_ticks: u64,
        /// Commands published.
        pub commands_sent: u64,
        /// Commands that could not be published.
        pub commands_failed: u64,
        /// Pen samples accepted.
        pub pen_received: u64,
        /// Pen samples missing in the sender's sequence.
        pub pen_dropped: u64,
        /// Pen samples whose device stamp went backwards or repeated.
        pub pen_out_of_order: u64,
        /// Pen samples accepted, but set aside as jump or outlier.
        pub pen_outliers: u64,
        /// Gaps in the pen's device stamps.
        pub pen_gaps: u64,
        /// Ticks that left pen samples for the next one, because a tick takes a bounded number.
        pub pen_deferred_ticks: u64,
        /// Pen samples refused, by reason.
        pub pen_rejected: Rejections,
        /// Joint states accepted.
        pub joint_state_received: u64,
        /// Joint states missing in the sender's sequence.
        pub joint_state_dropped: u64,
        /// Ticks whose newest joint state was stale.
        pub joint_state_stale: u64,
        /// Joint states refused, by reason.
        pub joint_state_rejected: Rejections,
        /// Dead-man messages refused, all reasons.
        pub enable_rejected: u64,
        /// Dead-man messages missing in the sender's sequence.
        pub enable_dropped: u64,
        /// Errors of the middleware while receiving.
        pub receive_failures: u64,
        /// Tick records lost because the ring to the ipc thread was full.
        pub telemetry_ring_dropped: u64,
        /// Tick records that could not be published.
        pub telemetry_failed: u64,
        /// Grid steps lost because the learner's ring was full.
        pub learner_ring_dropped: u64,
        /// Sets of weights refused by the loop.
        pub weights_refused: u64,
        /// Sets of weights that a newer set overtook before the loop took them up.
        pub weights_overtaken: u64,
        /// Events of the learner lost because its channel was full.
        pub learner_events_lost: u64,
        /// Requests answered.
        pub requests: u64,
        /// Requests answered with a refusal.
        pub requests_refused: u64,
        /// Heap allocations on the real-time thread after warm-up, except in ticks with a connection change.
        pub allocations: u64,
        /// Heap allocations in ticks in which a port connected or disconnected.
        pub connection_allocations: u64,
        /// Ticks in which a port connected or disconnected.
        pub connection_ticks: u64,
        /// Minor page faults of the real-time thread.
        pub page_faults_minor: u64,
        /// Major page faults of the real-time thread.
        pub page_faults_major: u64,
    }
}
