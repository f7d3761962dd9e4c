//! What a thread has opened, by number.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};

use foretrace_client::wire::TickRecord;
use foretrace_client::{
    Commands, DeadMan, Foretrace, GatewayFeed, JointStates, PenFeed, PenSteps, Previews, StatusReader,
    Telemetry,
};

use crate::code::{CallFailure, ErrorCode};

/// Things that one thread has opened at most.
const MOST: usize = 1000;
/// Tick records that wait for a caller with too little room: eight seconds at 500 Hz.
const BACKLOG: usize = 4096;

/// Tick records, with those that the caller had no room for.
#[derive(Debug)]
pub(crate) struct TickBacklog {
    telemetry: Telemetry,
    waiting: VecDeque<TickRecord>,
    overflowed: u64,
}

impl TickBacklog {
    pub(crate) fn new(telemetry: Telemetry) -> Self {
        Self { telemetry, waiting: VecDeque::new(), overflowed: 0 }
    }

    /// Takes what has come; the oldest go where too many wait.
    pub(crate) fn collect(&mut self) {
        let Self { telemetry, waiting, overflowed } = self;
        telemetry.drain(|record| {
            if waiting.len() == BACKLOG {
                waiting.pop_front();
                *overflowed = overflowed.saturating_add(1);
            }
            waiting.push_back(*record);
        });
    }

    pub(crate) fn next(&mut self) -> Option<TickRecord> {
        self.waiting.pop_front()
    }

    /// TickBacklog that never reached the caller.
    pub(crate) fn lost(&self) -> u64 {
        self.telemetry.lost().saturating_add(self.overflowed)
    }
}

macro_rules! kinds {
    ($($kind:ident($inside:ty) $name:literal,)+) => {
        #[derive(Debug)]
        pub(crate) enum Handle {
            $($kind(Box<$inside>),)+
        }

        $(impl Opened for $inside {
            const NAME: &'static str = $name;

            fn wrap(self) -> Handle {
                Handle::$kind(Box::new(self))
            }

            fn of(handle: &mut Handle) -> Option<&mut Self> {
                match handle {
                    Handle::$kind(inside) => Some(inside),
                    _ => None,
                }
            }

            fn out_of(handle: Handle) -> Option<Self> {
                match handle {
                    Handle::$kind(inside) => Some(*inside),
                    _ => None,
                }
            }
        })+
    };
}

/// What a handle stands for.
pub(crate) trait Opened: Sized {
    /// As an error names it.
    const NAME: &'static str;
    fn wrap(self) -> Handle;
    fn of(handle: &mut Handle) -> Option<&mut Self>;
    fn out_of(handle: Handle) -> Option<Self>;
}

kinds! {
    Attachment(Foretrace) "an attachment",
    Pen(PenFeed) "a pen",
    Gateway(GatewayFeed) "a gateway",
    Commands(Commands) "commands",
    JointStates(JointStates) "joint states",
    Telemetry(TickBacklog) "telemetry",
    Status(StatusReader) "a status",
    DeadMan(DeadMan) "a dead-man switch",
    PenSteps(PenSteps) "steps of the pen",
    Previews(Previews) "previews",
}

/// 0 is never one.
static NEXT: AtomicU64 = AtomicU64::new(1);

thread_local! {
    static OPEN: RefCell<BTreeMap<u64, Handle>> = const { RefCell::new(BTreeMap::new()) };
}

fn table<T>(
    use_table: impl FnOnce(&mut BTreeMap<u64, Handle>) -> Result<T, CallFailure>,
) -> Result<T, CallFailure> {
    let in_use =
        || CallFailure::new(ErrorCode::BadHandle, "called from inside another call, or as the thread ends");
    OPEN.try_with(|open| use_table(&mut *open.try_borrow_mut().map_err(|_| in_use())?))
        .map_err(|_| in_use())?
}

fn unknown(handle: u64) -> CallFailure {
    let text = match handle {
        0 => "handle 0: nothing was opened, or opening it failed".to_owned(),
        _ => {
            format!("handle {handle} is not open in this thread: it was closed, or another thread opened it")
        }
    };
    CallFailure::new(ErrorCode::BadHandle, text)
}

fn other_kind<T: Opened>(handle: u64) -> CallFailure {
    CallFailure::new(ErrorCode::BadHandle, format!("handle {handle} is not {}", T::NAME))
}

/// Keeps something for this thread.
pub(crate) fn keep(opened: impl Opened) -> Result<u64, CallFailure> {
    table(|open| {
        if open.len() >= MOST {
            let text = format!("this thread has opened {MOST} things: close some");
            return Err(CallFailure::new(ErrorCode::BadArgument, text));
        }
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        open.insert(number, opened.wrap());
        Ok(number)
    })
}

/// Uses what a handle stands for.
pub(crate) fn with<T: Opened, R>(
    handle: u64,
    use_it: impl FnOnce(&mut T) -> Result<R, CallFailure>,
) -> Result<R, CallFailure> {
    table(|open| {
        let found = open.get_mut(&handle).ok_or_else(|| unknown(handle))?;
        use_it(T::of(found).ok_or_else(|| other_kind::<T>(handle))?)
    })
}

/// Takes what a handle stands for out of the table.
pub(crate) fn take<T: Opened>(handle: u64) -> Result<T, CallFailure> {
    table(|open| {
        let found = open.get_mut(&handle).ok_or_else(|| unknown(handle))?;
        if T::of(found).is_none() {
            return Err(other_kind::<T>(handle));
        }
        open.remove(&handle).and_then(T::out_of).ok_or_else(|| unknown(handle))
    })
}

/// Closes whatever it is.
pub(crate) fn close(handle: u64) -> Result<(), CallFailure> {
    let closed = table(|open| open.remove(&handle).ok_or_else(|| unknown(handle)))?;
    // Outside of the table: a dead-man switch that ends takes its time.
    drop(closed);
    Ok(())
}
