//! `foretrace arm`: arms to plug into the loop.

pub(crate) mod model;
pub(crate) mod intake;
