//! What crosses shared memory, between real ports.

mod crash;
mod hostile;
mod layout;
mod layout_external;
mod refusal;
mod services;
