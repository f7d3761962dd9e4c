//! Formats in which others publish handwriting: UNIPEN, InkML, UCI's MATLAB files. Cargo feature `formats`.
//!
//! Contract: as [`crate::data`], which recognises them with or without this module and reads foretrace's own
//! formats. What runs beside an arm is built without it.

mod unipen;
mod mat;
mod inkml;

pub(crate) use inkml::parse_inkml;
pub(crate) use mat::parse_mat;
pub(crate) use unipen::parse_unipen;
