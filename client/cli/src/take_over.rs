//! `--take-over`, and the message when somebody took over.

use std::time::Duration;

use foretrace_client::{Claimant, DeadMan, Foretrace, Holder, PenFeed, Place, ServiceError};

use crate::failure::Failure;

/// How long a holder has to give way. It looks ten times per second.
const PATIENCE: Duration = Duration::from_secs(2);

/// `--take-over`, common to every command that holds the pen or the dead-man switch.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub(crate) struct TakeOver {
    /// Ask the program that holds the place to give way, instead of being refused
    #[arg(long)]
    take_over: bool,
}

impl TakeOver {
    /// The pen, in the name of `who`.
    pub(crate) fn pen(self, foretrace: &Foretrace, who: &Claimant) -> Result<PenFeed, ServiceError> {
        if self.take_over { foretrace.take_pen_feed(who, PATIENCE) } else { foretrace.pen_feed_as(who) }
    }

    /// The dead-man switch, in the name of `who`.
    pub(crate) fn dead_man(self, foretrace: &Foretrace, who: &Claimant) -> Result<DeadMan, ServiceError> {
        if self.take_over { foretrace.take_dead_man(who, PATIENCE) } else { foretrace.dead_man_as(who) }
    }
}

/// Why a program ends that gave way.
pub(crate) fn handed_over(place: Place, to: Option<&Holder>) -> Failure {
    let to = to.map_or_else(|| "a program that asked for it".to_owned(), ToString::to_string);
    Failure::failed(
        format_args!("{place} was handed to {to}"),
        "start this again with --take-over to get it back",
    )
}
