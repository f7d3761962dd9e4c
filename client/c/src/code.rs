//! Error codes, and the text of the newest error of each thread.

use std::cell::RefCell;
use std::ffi::{CStr, CString};
use std::panic::{AssertUnwindSafe, catch_unwind};

use foretrace_client::{
    DeadManError, FeedError, GatewayError, JointStateError, PreviewSendError, RequestError, ServiceError,
    StopError,
};

macro_rules! codes {
    ($($(#[$meta:meta])* $code:ident = $number:literal,)+) => {
        /// What a function returns where it fails; 0 is success.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(i32)]
        pub enum ErrorCode {
            $($(#[$meta])* $code = $number,)+
        }

        impl ErrorCode {
            /// All of them, in order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$code),+];
        }
    };
}

codes! {
    /// A pointer that must not be null is.
    Null = 1,
    /// A size, number or text is not one that the function takes.
    BadArgument = 2,
    /// Closed, never opened, of another kind, or opened by another thread.
    BadHandle = 3,
    /// Header and library have other messages.
    OtherLayout = 4,
    /// No daemon runs under this instance.
    NoDaemon = 5,
    /// Daemon and library have other messages.
    OtherVersion = 6,
    /// Another program has the pen, the switch or the slot.
    Taken = 7,
    /// The message is invalid and was not sent.
    Invalid = 8,
    /// It was not delivered, or nothing was heard in time.
    NotSent = 9,
    /// The daemon or the gateway refused.
    Refused = 10,
    /// Somebody else asked for the pen or the switch, and has it.
    HandedOver = 11,
    /// The message is of before the machine's last start.
    OtherBoot = 12,
    /// Files or memory of the instance cannot be used.
    Instance = 13,
    /// A fault inside the library: please report it.
    Internal = 14,
}

/// Why a function fails.
#[derive(Debug)]
pub(crate) struct CallFailure {
    code: ErrorCode,
    text: String,
}

impl CallFailure {
    pub(crate) fn new(code: ErrorCode, text: impl Into<String>) -> Self {
        Self { code, text: text.into() }
    }
}

thread_local! {
    static NEWEST: RefCell<CString> = RefCell::default();
}

/// Runs the inside of a function of the border.
pub(crate) fn run(inside: impl FnOnce() -> Result<(), CallFailure>) -> i32 {
    let failure = match catch_unwind(AssertUnwindSafe(inside)) {
        Ok(Ok(())) => return 0,
        Ok(Err(failure)) => failure,
        Err(_) => CallFailure::new(ErrorCode::Internal, "a fault inside libforetrace: please report it"),
    };
    let text: Vec<u8> = failure.text.bytes().filter(|byte| *byte != 0).collect();
    // At the end of a thread there is nobody left to read it.
    let _ = NEWEST.try_with(|newest| {
        if let Ok(mut newest) = newest.try_borrow_mut() {
            *newest = CString::new(text).unwrap_or_default();
        }
    });
    failure.code as i32
}

/// The text of the newest error of this thread; valid until the next one.
pub(crate) fn newest() -> *const std::ffi::c_char {
    NEWEST.try_with(|newest| newest.borrow().as_ptr()).unwrap_or(CStr::as_ptr(c""))
}

impl From<ServiceError> for CallFailure {
    fn from(error: ServiceError) -> Self {
        let code = match &error {
            ServiceError::NoDaemon { .. } => ErrorCode::NoDaemon,
            ServiceError::WrongLayout { .. } | ServiceError::DifferentQos { .. } => ErrorCode::OtherVersion,
            ServiceError::NoSlot { .. } | ServiceError::NoOperatorSlot { .. } | ServiceError::Place(_) => {
                ErrorCode::Taken
            }
            ServiceError::BufferSize { .. } => ErrorCode::BadArgument,
            _ => ErrorCode::Instance,
        };
        Self::new(code, error.to_string())
    }
}

impl From<FeedError> for CallFailure {
    fn from(error: FeedError) -> Self {
        let code = match error {
            FeedError::Invalid(_) => ErrorCode::Invalid,
            FeedError::NotSent(_) => ErrorCode::NotSent,
            FeedError::HandedOver => ErrorCode::HandedOver,
        };
        Self::new(code, error.to_string())
    }
}

impl From<PreviewSendError> for CallFailure {
    fn from(error: PreviewSendError) -> Self {
        let code = match error {
            PreviewSendError::Positions { .. }
            | PreviewSendError::Radii { .. }
            | PreviewSendError::NotFinite { .. }
            | PreviewSendError::Invalid(_) => ErrorCode::Invalid,
            PreviewSendError::NotSent(_) => ErrorCode::NotSent,
            PreviewSendError::HandedOver => ErrorCode::HandedOver,
        };
        Self::new(code, error.to_string())
    }
}

impl From<DeadManError> for CallFailure {
    fn from(error: DeadManError) -> Self {
        let code = match error {
            DeadManError::NotSent(_) => ErrorCode::NotSent,
            DeadManError::HandedOver => ErrorCode::HandedOver,
        };
        Self::new(code, error.to_string())
    }
}

impl From<JointStateError> for CallFailure {
    fn from(error: JointStateError) -> Self {
        let code = match error {
            JointStateError::Invalid(_) => ErrorCode::Invalid,
            JointStateError::NotSent(_) => ErrorCode::NotSent,
        };
        Self::new(code, error.to_string())
    }
}

impl From<GatewayError> for CallFailure {
    fn from(error: GatewayError) -> Self {
        let code = match &error {
            GatewayError::Unreachable { .. } | GatewayError::Gone(_) => ErrorCode::NotSent,
            GatewayError::Refused(_) => ErrorCode::Refused,
            GatewayError::Invalid(_) => ErrorCode::Invalid,
        };
        Self::new(code, error.to_string())
    }
}

impl From<RequestError> for CallFailure {
    fn from(error: RequestError) -> Self {
        let code = match &error {
            RequestError::Invalid(_) => ErrorCode::Invalid,
            RequestError::NoAnswer(_) => ErrorCode::NotSent,
            RequestError::NotConnected(_) => ErrorCode::Taken,
            RequestError::Refused { .. } => ErrorCode::Refused,
        };
        Self::new(code, error.to_string())
    }
}

impl From<StopError> for CallFailure {
    fn from(error: StopError) -> Self {
        let code = match &error {
            StopError::NoDaemon { .. } => ErrorCode::NoDaemon,
            StopError::Instance(_) => ErrorCode::Instance,
            _ => ErrorCode::NotSent,
        };
        Self::new(code, error.to_string())
    }
}
