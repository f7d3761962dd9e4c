//! `--robot HOST`: which Universal Robots controller, for every command that talks to one.

use foretrace_ur::bridge::address::Addresses;

use crate::failure::Failure;

#[derive(Debug, Clone, clap::Args)]
pub(crate) struct HostArgs {
    /// Name or IP address of the controller, as the pendant shows it under Network
    #[arg(long, value_name = "HOST")]
    pub(crate) robot: String,
}

impl HostArgs {
    /// Where its ports are.
    pub(crate) fn addresses(&self) -> Result<Addresses, Failure> {
        addresses(&self.robot)
    }
}

/// Where the ports of `host` are.
pub(crate) fn addresses(host: &str) -> Result<Addresses, Failure> {
    Addresses::of(host).map_err(|error| Failure::usage(error, ""))
}
