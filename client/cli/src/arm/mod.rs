//! `foretrace arm`: arms to plug into the loop.

pub(crate) use foretrace_lab::arm as model;
pub(crate) mod intake;
