//! What crosses shared memory, between real ports.

mod crash;
mod hostile;
mod layout;
mod refusal;
mod services;
