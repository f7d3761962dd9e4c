//! A page in a browser: a pad to write on, the arm that follows, its state and its controls.
//!
//! Contract: what a browser sends is judged before anything is done with it: host and origin, size, form,
//! token, and each pen sample by the gateway's admission. Without the token a page can watch and stop, and
//! move nothing. One page controls at a time. Connections, memory and every wait are bounded; frames for a
//! page that reads slowly are dropped, never queued. Plain threads, no asynchronous runtime.
//!
//! In the order of a message's way: `certificate` and `wire` are the connection, `foretrace_serve` lets a
//! page in, `keys` judges its token, `message` reads what it says, `session` is one page, `board` is what all
//! pages share, `link` feeds the daemon, with `hand` for pen and button, and `hold` for what a button means;
//! `orders` asks the daemon and `stops` stops the arm, a thread each; `scene` and `frame` are what a page is
//! told. What is in `page/` runs in the browser: it draws, asks, and says how things stand; its `clock.js`
//! maps the browser's clock to the daemon's by pings, so that pen, button and orders come dated on the
//! daemon's.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod certificate;
mod wire;
mod keys;
mod page;
mod message;
mod board;
mod scene;
mod frame;
mod hold;
mod orders;
mod stops;
mod hand;
mod link;
mod session;
mod server;
mod lan;

pub use board::ConsoleTally;
pub use certificate::{Certificate, CertificateError};
pub use lan::LanAddress;
pub use link::{DaemonLink, LinkError, Records, TextWriter, WriterPoint};
pub use server::{Console, ConsoleError, Lan, Renewer};
