//! What programs have set: settings of the pendant, signals of modbus, domains of analog ports.
//!
//! Contract: bounded.

use std::collections::BTreeMap;

/// Settings that are remembered at most: a program gives its modbus signals any names.
pub(super) const MOST_SETTINGS: usize = 512;
/// Longest value that is remembered, as text \[characters\].
pub(super) const LONGEST_VALUE: usize = 200;

/// A signal of modbus. Nobody is at its other end: it has the value that a program gave it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct ModbusSignal {
    /// Inputs and outputs of one bit; else registers.
    pub(super) bit: bool,
    pub(super) value: i32,
}

/// What programs have set.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramSetup {
    settings: BTreeMap<String, String>,
    pub(super) modbus: BTreeMap<String, ModbusSignal>,
    /// Output voltage of the tool \[V\].
    pub tool_voltage: i32,
    /// 0: digital outputs; 1: both supply power.
    pub tool_output_mode: u8,
    /// Of each digital output of the tool: 1 sinking, 2 sourcing, 3 push-pull.
    pub tool_digital_output_modes: [u8; 2],
    /// A bit each of the standard analog inputs, then of the outputs: 1 is a voltage, 0 a current.
    pub analog_domains: u32,
}

impl Default for ProgramSetup {
    fn default() -> Self {
        Self {
            settings: BTreeMap::new(),
            modbus: BTreeMap::new(),
            tool_voltage: 0,
            tool_output_mode: 0,
            tool_digital_output_modes: [1; 2],
            analog_domains: 0,
        }
    }
}

impl ProgramSetup {
    /// All that is remembered: the call, for settings of a port or signal with its number or name, and the
    /// other arguments as text.
    #[must_use]
    pub const fn settings(&self) -> &BTreeMap<String, String> {
        &self.settings
    }

    /// The standard analog output `port` is a voltage.
    #[must_use]
    pub const fn output_is_voltage(&self, port: usize) -> bool {
        self.analog_domains >> (2 + port) & 1 == 1
    }

    /// Remembers a value.
    ///
    /// # Errors
    ///
    /// Too many are remembered.
    pub(super) fn remember(&mut self, key: String, value: &str) -> Result<(), String> {
        if self.settings.len() >= MOST_SETTINGS && !self.settings.contains_key(&key) {
            return Err(format!("is one of more than {MOST_SETTINGS} settings"));
        }
        self.settings.insert(key, value.chars().take(LONGEST_VALUE).collect());
        Ok(())
    }
}
