//! Transport of messages: joining an instance, its services with their quality of service, and the ports at
//! both ends.

pub(crate) mod session;
pub(crate) mod topic;
pub(crate) mod control_topic;
pub(crate) mod ports;
pub(crate) mod control_ports;
