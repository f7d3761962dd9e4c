//! `Foretrace`: the attachment of this process to an instance, and its renewal when the daemon restarts.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use foretrace_shm::{DaemonMark, Instance, ServiceError, Services, Session};

/// How often a waiting caller looks for the daemon.
const POLL: Duration = Duration::from_millis(20);

/// An attachment to a running daemon. Makes the handles; may be shared between threads.
#[derive(Debug)]
pub struct Foretrace {
    // In the order in which they must be dropped.
    pub(crate) services: Services,
    session: Session,
    daemon: DaemonMark,
    pub(crate) leaving: Arc<Leaving>,
}

/// Dropped last of an attachment and all its handles: if the daemon has ended, the last peer removes what is
/// left.
#[derive(Debug)]
pub(crate) struct Leaving(Instance);

/// A clean-up that takes longer has hit damaged files; the next daemon removes them.
const TIDYING: Duration = Duration::from_secs(1);

impl Drop for Leaving {
    fn drop(&mut self) {
        let instance = self.0.clone();
        if instance.daemon().is_some() {
            return;
        }
        let (done, tidied) = mpsc::channel();
        let tidying = move || {
            // The receiver may be gone.
            let _ = done.send(instance.tidy_up());
        };
        if std::thread::Builder::new().name("foretrace-tidies".to_owned()).spawn(tidying).is_ok() {
            let _ = tidied.recv_timeout(TIDYING);
        }
    }
}

/// What [`Foretrace::reattach_if_needed`] found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attachment {
    /// The same daemon still runs.
    Unchanged,
    /// Another daemon took over the services: the handles work on.
    TakenOver,
    /// The services were recreated: drop all handles and make new ones.
    Renewed,
}

/// Attaching takes milliseconds; one that takes longer has hit damaged files.
const ATTACHING: Duration = Duration::from_secs(5);
/// A segment is empty for some microseconds after it was made; one that is for longer stays so.
const GROWING: Duration = Duration::from_secs(1);
/// Threads that attach at this moment; those that hang stay among them until their files are removed.
static HANGING: AtomicUsize = AtomicUsize::new(0);
/// No more are started beside so many.
const MOST_HANGING: usize = 16;

/// Waits until no segment of the instance is empty.
fn grown(instance: &Instance) -> Result<(), ServiceError> {
    let deadline = Instant::now() + GROWING;
    loop {
        let files = instance.empty_segments()?;
        if files.is_empty() {
            return Ok(());
        }
        if Instant::now() >= deadline {
            return Err(ServiceError::Empty { files });
        }
        std::thread::sleep(POLL);
    }
}

impl Foretrace {
    /// Attach to instance `number` of this user, whose daemon must be up.
    ///
    /// # Errors
    ///
    /// `NoDaemon` and the others of [`ServiceError`].
    pub fn attach(number: u32) -> Result<Self, ServiceError> {
        Self::attach_within(&Instance::new(number)?, Duration::ZERO)
    }

    /// Attach to `instance`, waiting up to `wait` for its daemon to come up.
    ///
    /// # Errors
    ///
    /// As [`Foretrace::attach`]; only `NoDaemon` is waited for. Damaged files are reported within seconds.
    pub fn attach_within(instance: &Instance, wait: Duration) -> Result<Self, ServiceError> {
        let deadline = Instant::now() + wait;
        loop {
            match Self::try_attach(instance) {
                Err(ServiceError::NoDaemon { .. }) if Instant::now() < deadline => std::thread::sleep(POLL),
                result => return result,
            }
        }
    }

    /// The instance that this is attached to.
    pub fn instance(&self) -> &Instance {
        self.session.instance()
    }

    /// The daemon that was up when this was attached or last renewed.
    pub fn daemon(&self) -> DaemonMark {
        self.daemon
    }

    /// Whether a daemon is up at this moment. Two system calls.
    pub fn daemon_is_up(&self) -> bool {
        self.instance().daemon().is_some()
    }

    /// Look whether the daemon is still the one attached to, and attach to the new one if not. Cheap while
    /// nothing changed: call it once per second, or when no messages come.
    ///
    /// # Errors
    ///
    /// `NoDaemon` while none is up (the attachment stays as it is: call again later), and the others of
    /// [`ServiceError`].
    pub fn reattach_if_needed(&mut self) -> Result<Attachment, ServiceError> {
        if self.instance().daemon() == Some(self.daemon) {
            return Ok(Attachment::Unchanged);
        }
        let renewed = Self::try_attach(self.instance())?;
        self.daemon = renewed.daemon;
        // A daemon that finds living peers takes their services over; otherwise the old ports receive
        // nothing.
        if renewed.services.are_same_as(&self.services) {
            return Ok(Attachment::TakenOver);
        }
        *self = renewed;
        Ok(Attachment::Renewed)
    }

    /// Attaches in a thread that is abandoned after [`ATTACHING`].
    fn try_attach(instance: &Instance) -> Result<Self, ServiceError> {
        let hangs = |waited| ServiceError::Hangs { waited, root: instance.root().to_path_buf() };
        Session::daemon_of(instance)?;
        if HANGING.load(Ordering::Relaxed) >= MOST_HANGING {
            return Err(hangs(Duration::ZERO));
        }
        let (done, attached) = mpsc::channel();
        let there = instance.clone();
        let attaching = move || {
            HANGING.fetch_add(1, Ordering::Relaxed);
            let result = grown(&there).and_then(|()| Self::attach_here(&there));
            HANGING.fetch_sub(1, Ordering::Relaxed);
            // The receiver may be gone; then this leaves again.
            let _ = done.send(result);
        };
        std::thread::Builder::new().name("foretrace-attach".to_owned()).spawn(attaching).map_err(
            |error| ServiceError::Middleware {
                service: "foretrace",
                detail: format!("starting a thread: {error}"),
            },
        )?;
        match attached.recv_timeout(ATTACHING) {
            Ok(result) => result,
            Err(RecvTimeoutError::Timeout) => Err(hangs(ATTACHING)),
            Err(RecvTimeoutError::Disconnected) => Err(ServiceError::Middleware {
                service: "foretrace",
                detail: "attaching ended by a fault".to_owned(),
            }),
        }
    }

    fn attach_here(instance: &Instance) -> Result<Self, ServiceError> {
        let session = Session::open(instance, "foretrace-client")?;
        let services = Services::open(&session)?;
        let daemon = instance.daemon().ok_or_else(|| ServiceError::no_daemon(instance))?;
        Ok(Self { services, session, daemon, leaving: Arc::new(Leaving(instance.clone())) })
    }
}
