//! Ticks for the tests of this thread's parts.

use std::sync::OnceLock;

use foretrace_control::follower::{Budget, Follower, JointCommand, NoClock, StepInput, StepOutput};
use foretrace_control::units::Stamp;

use crate::ports::PortTally;
use crate::rt::cyclic::Wake;
use crate::rt::external::ExternalTally;
use crate::rt::facts::{LoopTally, StageTimes, TickFacts};
use crate::wire::{Given, JOINTS};

/// An uneventful tick that sends a command.
pub(crate) fn commanding(tick: u64) -> TickFacts {
    let mut facts = facts(tick);
    let (stamp, q) = (facts.deadline, [0.0; JOINTS]);
    let valid_until = stamp.plus_ns(10_000_000);
    facts.output.command = Some(JointCommand { stamp, valid_until, q, qd: q, enabled: true });
    facts
}

/// An uneventful tick of an idle loop.
pub(crate) fn facts(tick: u64) -> TickFacts {
    // The output of an idle loop does not depend on the time.
    static IDLE: OnceLock<StepOutput<JOINTS>> = OnceLock::new();
    let output = *IDLE.get_or_init(|| {
        let settings = crate::testing::config().follower_settings();
        let mut follower = Follower::<10, JOINTS>::new(settings).unwrap();
        follower.step(&StepInput::nothing(Stamp(0)), Budget::default(), &mut NoClock)
    });
    let now = Stamp(tick * 2_000_000);
    let wake = Wake { index: tick, due: now, release: now, started: now, skipped: 0 };
    TickFacts {
        tick,
        wake,
        finished: now,
        deadline: now.plus_ns(2_000_000),
        times: StageTimes::default(),
        given: Given::of(&StepInput::nothing(now), Budget::default()),
        measured: None,
        published: now,
        echo: None,
        not_sent: false,
        weights_since: None,
        port_allocations: 0,
        law_allocations: 0,
        output,
        tally: LoopTally { ticks: tick, ..LoopTally::default() },
        ports: PortTally::default(),
        previews: ExternalTally::default(),
    }
}
