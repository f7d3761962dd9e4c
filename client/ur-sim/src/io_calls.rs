//! The calls for registers, digital and analog inputs and outputs, flags and ports.

use super::inputs::REGISTERS;
use super::machine::{Hands, INSTRUCTIONS_PER_SEARCH, Result, number};
use crate::script::{Arguments, Value};

/// Addresses of `read_port_bit` and its like.
const PORTS: usize = 1024;

/// A register's or output's number, below `count`.
fn index(value: Option<&Value>, count: usize) -> Result<usize> {
    let number = value.and_then(Value::as_integer).and_then(|number| usize::try_from(number).ok());
    number.filter(|number| *number < count).ok_or_else(|| format!("wants a number from 0 to {}", count - 1))
}

impl Hands<'_> {
    pub(super) fn registers(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        let [at, value] = arguments.bind(["address", "value"])?;
        let count = if name.contains("boolean") { 128 } else { REGISTERS };
        let n = index(at, count)?;
        let none = || "has no such register".to_owned();
        Ok(match name {
            "read_input_integer_register" => Value::Integer(self.inputs.integer(n).ok_or_else(none)?),
            "read_input_float_register" => Value::Float(self.inputs.double(n).ok_or_else(none)?),
            "read_input_boolean_register" => {
                self.spent = self.spent.saturating_add(INSTRUCTIONS_PER_SEARCH);
                Value::Bool(self.inputs.bit(n).ok_or_else(none)?)
            }
            "read_output_integer_register" => {
                Value::Integer(*self.registers.integers.get(n).ok_or_else(none)?)
            }
            "read_output_float_register" => Value::Float(*self.registers.doubles.get(n).ok_or_else(none)?),
            "read_output_boolean_register" => Value::Bool(self.registers.bits >> n & 1 == 1),
            "write_output_integer_register" => {
                let value = value.and_then(Value::as_number).ok_or("wants an integer")?;
                // A float is cut to an integer; saturates.
                *self.registers.integers.get_mut(n).ok_or_else(none)? = value as i32;
                Value::None
            }
            "write_output_float_register" => {
                let value = number(value, "value")?;
                *self.registers.doubles.get_mut(n).ok_or_else(none)? = value;
                Value::None
            }
            _ => {
                let on = value.and_then(Value::as_bool).ok_or("wants a truth value")?;
                self.registers.bits = self.registers.bits & !(1 << n) | u128::from(on) << n;
                Value::None
            }
        })
    }

    pub(super) fn digital(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        let [at, value] = arguments.bind(["n", "b"])?;
        let (first, count) = if name.contains("configurable") {
            (8, 8)
        } else if name.contains("tool") {
            (16, 2)
        } else if name.contains("standard") {
            (0, 8)
        } else {
            // Counts standard, configurable (of old 8 and 9 the tool) through.
            (0, 18)
        };
        let bit = first + index(at, count)?;
        if name.starts_with("set") {
            let on = value.and_then(Value::as_bool).ok_or("wants a truth value")?;
            self.robot.digital_outputs = self.robot.digital_outputs & !(1 << bit) | u64::from(on) << bit;
            return Ok(Value::None);
        }
        let bits = if name.ends_with("_in") { self.robot.digital_inputs } else { self.robot.digital_outputs };
        Ok(Value::Bool(bits >> bit & 1 == 1))
    }

    pub(super) fn analog(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        let [n, f] = arguments.bind(["n", "f"])?;
        let port = index(n, 2)?;
        let voltage = self.robot.setup.output_is_voltage(port);
        if name.ends_with("_in") {
            // Nothing is wired to them.
            return Ok(Value::Float(0.0));
        }
        let Some(output) = self.robot.analog_outputs.get_mut(port) else { return Ok(Value::None) };
        if name.starts_with("get") {
            return Ok(Value::Float(if voltage { *output / 10.0 } else { (*output - 0.004) / 0.016 }));
        }
        let share = number(f, "f")?.clamp(0.0, 1.0);
        // 0 to 10 V, or 4 to 20 mA as at the factory.
        *output = if voltage { 10.0 * share } else { 0.004 + 0.016 * share };
        Ok(Value::None)
    }

    pub(super) fn flags(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        let [n, value] = arguments.bind(["n", "b"])?;
        let bit = index(n, 32)?;
        if name == "get_flag" {
            return Ok(Value::Bool(self.registers.flags >> bit & 1 == 1));
        }
        let on = value.and_then(Value::as_bool).ok_or("wants a truth value")?;
        self.registers.flags = self.registers.flags & !(1 << bit) | u32::from(on) << bit;
        Ok(Value::None)
    }

    /// The registers that modbus clients of the controller would see; here only programs do.
    pub(super) fn ports(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        let [address, value] = arguments.bind(["address", "value"])?;
        let bits = name.ends_with("_bit");
        let address = index(address, PORTS)?;
        let ports = if bits { &mut self.registers.port_bits } else { &mut self.registers.port_registers };
        if name.starts_with("read") {
            let value = ports.get(&address).copied().unwrap_or(0);
            return Ok(if bits { Value::Bool(value != 0) } else { Value::Integer(value) });
        }
        let value = if bits {
            i32::from(value.and_then(Value::as_bool).ok_or("wants a truth value")?)
        } else {
            let number = value.and_then(Value::as_integer).filter(|number| (-32768..=65536).contains(number));
            // It is read back as a signed word.
            i32::from(number.ok_or("wants a number from -32768 to 65536")? as i16)
        };
        ports.insert(address, value);
        Ok(Value::None)
    }
}
