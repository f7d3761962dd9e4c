//! Input variables of RTDE: their values, when they were set last, and which connection owns them.

use foretrace_ur::rtde::fields::{FieldVersion, INPUTS, Register, input};
use foretrace_ur::rtde::value::{FieldType, RtdeValue};

/// Registers of each kind.
pub const REGISTERS: usize = 48;
/// Single bits, 64 to 127.
const BITS: usize = 64;

/// A connection, by a number that is never used again.
pub type Owner = u64;

/// Why an input is not possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Denied {
    NotFound,
    InUse,
}

#[derive(Debug, Clone, Copy)]
struct Variable {
    value: RtdeValue,
    set_at: Option<u64>,
    owner: Option<Owner>,
}

#[derive(Debug)]
pub struct InputVariables {
    version: FieldVersion,
    variables: Vec<Variable>,
}

/// The slot of a name among the variables.
fn slot(name: &str) -> Option<usize> {
    if let Some(row) = INPUTS.iter().position(|(known, ..)| *known == name) {
        return Some(row);
    }
    let Register { input: true, kind, number } = Register::from_name(name)? else { return None };
    let before = match kind {
        FieldType::Int32 => 0,
        FieldType::Double => REGISTERS,
        _ => 2 * REGISTERS - 64,
    };
    Some(INPUTS.len() + before + number)
}

impl InputVariables {
    /// All 0, nobody's.
    #[must_use]
    pub fn new(version: FieldVersion) -> Self {
        let registers =
            [(FieldType::Int32, REGISTERS), (FieldType::Double, REGISTERS), (FieldType::Bool, BITS)];
        let registers = registers.iter().flat_map(|(kind, count)| std::iter::repeat_n(*kind, *count));
        let variables = INPUTS
            .iter()
            .map(|(_, kind, _)| *kind)
            .chain(registers)
            .filter_map(|kind| kind.take(&mut &[0; 48][..]))
            .map(|value| Variable { value, set_at: None, owner: None })
            .collect();
        Self { version, variables }
    }

    /// Whether `owner` may have the input of this name: its slot and type.
    ///
    /// # Errors
    ///
    /// [`Denied`].
    pub fn free(&self, name: &str, owner: Owner) -> Result<(usize, FieldType), Denied> {
        let kind = input(name, self.version).ok_or(Denied::NotFound)?;
        let slot = slot(name).ok_or(Denied::NotFound)?;
        let variable = self.variables.get(slot).ok_or(Denied::NotFound)?;
        match variable.owner {
            Some(other) if other != owner => Err(Denied::InUse),
            _ => Ok((slot, kind)),
        }
    }

    /// Gives the variables at `slots` to `owner`.
    pub fn claim(&mut self, slots: &[usize], owner: Owner) {
        for slot in slots {
            if let Some(variable) = self.variables.get_mut(*slot) {
                variable.owner = Some(owner);
            }
        }
    }

    /// Frees whatever `owner` has. Values stay.
    pub fn release(&mut self, owner: Owner) {
        for variable in &mut self.variables {
            if variable.owner == Some(owner) {
                variable.owner = None;
            }
        }
    }

    /// Sets a variable in control cycle `cycle`.
    pub fn set(&mut self, slot: usize, value: RtdeValue, cycle: u64) {
        if let Some(variable) = self.variables.get_mut(slot) {
            variable.value = value;
            variable.set_at = Some(cycle);
        }
    }

    /// The value of this name; `None` where there is no such input.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<RtdeValue> {
        self.variables.get(slot(name)?).map(|variable| variable.value)
    }

    /// In which cycle it was set last.
    #[must_use]
    pub fn set_at(&self, name: &str) -> Option<u64> {
        self.variables.get(slot(name)?)?.set_at
    }

    fn register(&self, before: usize, number: usize, count: usize) -> Option<RtdeValue> {
        if number >= count {
            return None;
        }
        self.variables.get(INPUTS.len() + before + number).map(|variable| variable.value)
    }

    #[must_use]
    pub fn integer(&self, number: usize) -> Option<i32> {
        self.register(0, number, REGISTERS)?.int32()
    }

    #[must_use]
    pub fn double(&self, number: usize) -> Option<f64> {
        self.register(REGISTERS, number, REGISTERS)?.double()
    }

    /// A bit: 0 to 63 of the two words, 64 to 127 single ones.
    #[must_use]
    pub fn bit(&self, number: usize) -> Option<bool> {
        if let Some(single) = number.checked_sub(64) {
            return self.register(2 * REGISTERS, single, BITS)?.bool();
        }
        let name = if number < 32 { "input_bit_registers0_to_31" } else { "input_bit_registers32_to_63" };
        Some(self.value(name)?.uint32()? >> (number % 32) & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_input_has_a_place_of_its_own_and_of_its_type() {
        let inputs = InputVariables::new((5, 11, 0));
        let mut names: Vec<String> = INPUTS.iter().map(|(name, ..)| (*name).to_owned()).collect();
        for number in 0..REGISTERS {
            names.push(format!("input_int_register_{number}"));
            names.push(format!("input_double_register_{number}"));
        }
        names.extend((64..128).map(|number| format!("input_bit_register_{number}")));
        let mut slots = Vec::new();
        for name in &names {
            let (slot, kind) = inputs.free(name, 1).unwrap();
            assert_eq!(inputs.value(name), kind.take(&mut &[0; 48][..]), "{name}");
            slots.push(slot);
        }
        slots.sort_unstable();
        assert_eq!(slots, (0..names.len()).collect::<Vec<_>>());
        assert_eq!(inputs.variables.len(), names.len());
    }

    #[test]
    fn an_input_belongs_to_one_connection_until_that_ends() {
        let mut inputs = InputVariables::new((3, 15, 0));
        let (slot, _) = inputs.free("input_int_register_24", 1).unwrap();
        inputs.claim(&[slot], 1);
        assert_eq!(inputs.free("input_int_register_24", 2), Err(Denied::InUse));
        assert!(inputs.free("input_int_register_24", 1).is_ok());
        inputs.set(slot, RtdeValue::Int32(5), 17);
        inputs.release(1);
        assert!(inputs.free("input_int_register_24", 2).is_ok());
        assert_eq!((inputs.integer(24), inputs.set_at("input_int_register_24")), (Some(5), Some(17)));
        assert_eq!(inputs.free("actual_q", 2), Err(Denied::NotFound));
        assert_eq!((inputs.integer(48), inputs.double(48), inputs.bit(128)), (None, None, None));
    }
}
