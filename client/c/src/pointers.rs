//! Pointers of the caller: read and written once, by value.
//!
//! Contract: null is an error, messages may stand anywhere, and the size that the caller's compiler gave a
//! message is compared with ours. Whether a pointer that is not null leads to so many bytes only the caller
//! knows.

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::ptr::NonNull;

use foretrace_client::wire::Wire;

use crate::code::{CallFailure, ErrorCode};

/// Longest text that is taken \[bytes\].
const LONGEST_TEXT: usize = 4096;

fn null(what: &str) -> CallFailure {
    CallFailure::new(ErrorCode::Null, format!("{what} is a null pointer"))
}

fn sized<T>(what: &str, size: usize) -> Result<(), CallFailure> {
    let ours = size_of::<T>();
    if size == ours {
        return Ok(());
    }
    let text = format!(
        "{what} has {size} bytes for the caller and {ours} here: give sizeof of its type, and use header and \
         library of one version"
    );
    Err(CallFailure::new(ErrorCode::OtherLayout, text))
}

/// A message of the caller.
///
/// # Safety
/// Where it is not null, `pointer` leads to `size` readable bytes.
pub(crate) unsafe fn read<T: Wire>(what: &str, pointer: *const T, size: usize) -> Result<T, CallFailure> {
    if pointer.is_null() {
        return Err(null(what));
    }
    sized::<T>(what, size)?;
    // SAFETY: the caller's; wire types hold numbers only, so any bytes are a value.
    Ok(unsafe { pointer.read_unaligned() })
}

/// Room of the caller for a message, which is looked at before anything is done for it.
pub(crate) struct MessageRoom<T>(NonNull<T>);

impl<T: Wire> MessageRoom<T> {
    pub(crate) fn put(self, message: T) {
        // SAFETY: the caller of `room` has said that it is there.
        unsafe { self.0.write_unaligned(message) };
    }
}

/// Room for a message.
///
/// # Safety
/// Where it is not null, `pointer` leads to `size` writable bytes for as long as the call lasts.
pub(crate) unsafe fn room<T: Wire>(
    what: &str,
    pointer: *mut T,
    size: usize,
) -> Result<MessageRoom<T>, CallFailure> {
    let room = NonNull::new(pointer).ok_or_else(|| null(what))?;
    sized::<T>(what, size)?;
    Ok(MessageRoom(room))
}

/// Room of the caller for a number; `None` where it gave a null pointer.
pub type Out<'a, T> = Option<&'a mut MaybeUninit<T>>;

/// A number for the caller.
pub(crate) fn give<T>(what: &str, out: &mut Out<'_, T>, value: T) -> Result<(), CallFailure> {
    out.as_mut().ok_or_else(|| null(what))?.write(value);
    Ok(())
}

/// The same, where the caller need not want it.
pub(crate) fn offer<T>(out: &mut Out<'_, T>, value: T) {
    if let Some(out) = out {
        out.write(value);
    }
}

/// A text of the caller; `None` where it is null.
///
/// # Safety
/// Where it is not null, `pointer` leads to bytes that end with a zero.
pub(crate) unsafe fn text(what: &str, pointer: *const c_char) -> Result<Option<String>, CallFailure> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's.
    let bytes = unsafe { CStr::from_ptr(pointer) };
    match bytes.to_str() {
        Ok(text) if text.len() <= LONGEST_TEXT => Ok(Some(text.to_owned())),
        Ok(text) => {
            let why = format!("{what} has {} bytes, at most {LONGEST_TEXT} are taken", text.len());
            Err(CallFailure::new(ErrorCode::BadArgument, why))
        }
        Err(_) => Err(CallFailure::new(ErrorCode::BadArgument, format!("{what} is not UTF-8"))),
    }
}

/// Writes text for the caller, cut to its room and always ended by a zero.
///
/// # Safety
/// Where it is not null, `pointer` leads to `room` writable bytes.
pub(crate) unsafe fn put_text(pointer: *mut c_char, room: usize, text: &str) {
    let Some(most) = room.checked_sub(1).filter(|_| !pointer.is_null()) else { return };
    let cut = (0..=most.min(text.len())).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
    let mut bytes = text.as_bytes().get(..cut).unwrap_or_default().to_vec();
    bytes.push(0);
    // SAFETY: the caller's; bytes.len() <= room.
    unsafe { pointer.cast::<u8>().copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) };
}
