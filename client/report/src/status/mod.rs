//! A daemon's status: text for people, JSON for machines, a page for a screen, and bounds on its figures.
//!
//! In order: `alarm`, then the parts (`holders`, `arm_line`, `bearing`, `way_home`, `chain`, `external`),
//! then all of it: `view` and `screen`.

mod alarm;
mod arm_line;
mod bearing;
mod chain;
mod external;
mod holders;
mod screen;
mod view;
mod way_home;

pub use alarm::{Alarm, parse as alarm};
pub use holders::Holders;
pub use screen::{Screen, Tone, page};
pub use view::{json, text_within};
