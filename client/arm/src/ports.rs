//! The handles of an arm's process, and keeping them over a change of daemons.

use foretrace_client::{Commands, DaemonChange, Foretrace, JointStates, Lasting, ServiceError, StatusReader};

use foretrace_report::Tell;

/// Commands in, joint states out; the daemon's status for who asked for it.
pub(crate) struct ArmPorts {
    pub(crate) commands: Commands,
    pub(crate) states: JointStates,
    pub(crate) status: Option<StatusReader>,
}

/// Whether a process reads the daemon's status, which takes one of eight slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reads {
    Status,
    CommandsOnly,
}

impl ArmPorts {
    fn open(foretrace: &Foretrace, reads: Reads) -> Result<Self, ServiceError> {
        Ok(Self {
            status: match reads {
                Reads::Status => Some(foretrace.status()?),
                Reads::CommandsOnly => None,
            },
            commands: foretrace.commands(Commands::MAX_BUFFER)?,
            states: foretrace.joint_states()?,
        })
    }
}

/// The daemon that an arm listens to, whichever it is.
pub(crate) struct Daemons {
    lasting: Lasting<ArmPorts>,
    reads: Reads,
    /// Daemons so far.
    pub(crate) count: u64,
}

impl Daemons {
    pub(crate) fn attached(foretrace: Foretrace, reads: Reads) -> Result<Self, ServiceError> {
        let ports = ArmPorts::open(&foretrace, reads)?;
        Ok(Self { lasting: Lasting::new(foretrace, ports), reads, count: 1 })
    }

    /// None while they could not be made.
    pub(crate) fn ports(&mut self) -> Option<&mut ArmPorts> {
        self.lasting.handle.as_mut()
    }

    pub(crate) fn commands(&self) -> Option<&Commands> {
        self.lasting.handle.as_ref().map(|ports| &ports.commands)
    }

    /// Looks, a few times per second, whether the daemon is gone, back or another.
    pub(crate) fn look(&mut self, tell: Tell<'_>) -> DaemonChange {
        let (change, error) = self.lasting.look(|foretrace| ArmPorts::open(foretrace, self.reads));
        if let Some(error) = error {
            tell(&format!("foretrace: {error}"));
        }
        if let Some(words) = change.words("braking, and waiting for it") {
            tell(&format!("arm: {words}"));
        }
        self.count += u64::from(matches!(change, DaemonChange::Back | DaemonChange::Renewed));
        change
    }
}
