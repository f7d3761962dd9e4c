//! `libforetrace`: the client library for programs in C and C++ (`include/foretrace/foretrace.h`).
//!
//! Contract: no panic crosses the border, and no pointer but the caller's own is followed: handles are
//! numbers, looked up in a table of the calling thread, so that one that was closed, or belongs to another
//! thread, is an error. Messages are copied, with their size compared.
//!
//! In order: `code` (of errors), `pointers` (of the caller), `handles`, `exports` (the functions), `predict`
//! (those of predictors).

mod code;
mod pointers;
mod handles;
pub mod exports;
pub mod predict;

pub use code::ErrorCode;
pub use pointers::Out;
