//! The handles of an arm's process, and keeping them over a change of daemons.

use foretrace_client::{Commands, Foretrace, JointStates, StatusReader};

use crate::attach::{Lookout, News, unattached};
use crate::failure::Failure;
use crate::output::note;

/// Commands in, joint states out; the daemon's status for who asked for it.
pub(super) struct Ports {
    pub(super) commands: Commands,
    pub(super) states: JointStates,
    pub(super) status: Option<StatusReader>,
}

/// Whether a process reads the daemon's status, which takes one of eight places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reads {
    Status,
    CommandsOnly,
}

impl Ports {
    fn open(foretrace: &Foretrace, reads: Reads) -> Result<Self, Failure> {
        Ok(Self {
            status: match reads {
                Reads::Status => Some(foretrace.status().map_err(unattached)?),
                Reads::CommandsOnly => None,
            },
            commands: foretrace.commands(Commands::MAX_BUFFER).map_err(unattached)?,
            states: foretrace.joint_states().map_err(unattached)?,
        })
    }
}

/// The daemon that an arm listens to, whichever it is.
pub(super) struct Daemons {
    foretrace: Foretrace,
    reads: Reads,
    lookout: Lookout,
    /// None while they could not be made.
    pub(super) ports: Option<Ports>,
    /// Daemons so far.
    pub(super) count: u64,
}

impl Daemons {
    pub(super) fn attached(foretrace: Foretrace, reads: Reads) -> Result<Self, Failure> {
        let ports = Ports::open(&foretrace, reads)?;
        Ok(Self { foretrace, reads, lookout: Lookout::new(), ports: Some(ports), count: 1 })
    }

    /// Looks, a few times per second, whether the daemon is gone, back or another.
    pub(super) fn look(&mut self) -> News {
        let news = self.lookout.look(&mut self.foretrace);
        match news {
            News::None => {}
            News::Gone => note!("arm: the daemon is gone; braking, and waiting for it"),
            News::Back => {
                self.count += 1;
                note!("arm: a daemon took over");
            }
            News::Renewed => {
                self.count += 1;
                // The old handles hold places that the new ones need.
                self.ports = None;
                match Ports::open(&self.foretrace, self.reads) {
                    Ok(ports) => self.ports = Some(ports),
                    Err(failure) => {
                        note!("{failure}");
                        self.lookout.again();
                    }
                }
                note!("arm: a new daemon is there");
            }
        }
        news
    }
}
