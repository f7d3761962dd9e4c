//! The two handles of an arm's process, and keeping them over a change of daemons.

use foretrace_client::{Commands, Foretrace, JointStates};

use crate::attach::{Lookout, News, unattached};
use crate::failure::Failure;
use crate::output::note;

/// Commands in, joint states out.
pub(super) struct Ports {
    pub(super) commands: Commands,
    pub(super) states: JointStates,
}

impl Ports {
    fn open(foretrace: &Foretrace) -> Result<Self, Failure> {
        Ok(Self {
            commands: foretrace.commands(Commands::MAX_BUFFER).map_err(unattached)?,
            states: foretrace.joint_states().map_err(unattached)?,
        })
    }
}

/// The daemon that an arm listens to, whichever it is.
pub(super) struct Daemons {
    foretrace: Foretrace,
    lookout: Lookout,
    /// None while they could not be made.
    pub(super) ports: Option<Ports>,
    /// Daemons so far.
    pub(super) count: u64,
}

impl Daemons {
    pub(super) fn attached(foretrace: Foretrace) -> Result<Self, Failure> {
        let ports = Ports::open(&foretrace)?;
        Ok(Self { foretrace, lookout: Lookout::new(), ports: Some(ports), count: 1 })
    }

    /// Looks, a few times per second, whether the daemon is gone, back or another.
    pub(super) fn look(&mut self) {
        match self.lookout.look(&mut self.foretrace) {
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
                match Ports::open(&self.foretrace) {
                    Ok(ports) => self.ports = Some(ports),
                    Err(failure) => {
                        note!("{failure}");
                        self.lookout.again();
                    }
                }
                note!("arm: a new daemon is there");
            }
        }
    }
}
