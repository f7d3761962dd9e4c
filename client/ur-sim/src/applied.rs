//! What RTDE's inputs do that are no registers: the speed slider, digital and analog outputs.

use super::world::World;
use foretrace_ur::rtde::RtdeValue;

impl World {
    /// Does what the input `name` asks for, if it is not a register: the slider, digital and analog outputs,
    /// where their mask says so.
    pub fn apply_input(&mut self, name: &str) {
        let inputs = &self.inputs;
        let word = |name: &str| inputs.value(name).and_then(RtdeValue::uint8).unwrap_or(0);
        let number = |name: &str| inputs.value(name).and_then(RtdeValue::double).unwrap_or(0.0);
        if name.starts_with("speed_slider") {
            let mask = inputs.value("speed_slider_mask").and_then(RtdeValue::uint32).unwrap_or(0);
            let fraction = number("speed_slider_fraction");
            if mask & 1 == 1 && fraction.is_finite() {
                self.robot.slider = fraction.clamp(0.0, 1.0);
            }
        }
        for (group, shift) in [("standard_digital", 0), ("configurable_digital", 8), ("tool_digital", 16)] {
            if name.starts_with(group) {
                let bits = u64::from(word(&format!("{group}_output"))) << shift;
                let mask = u64::from(word(&format!("{group}_output_mask"))) << shift;
                let outputs = &mut self.robot.digital_outputs;
                *outputs = *outputs & !mask | bits & mask;
            }
        }
        if name.starts_with("standard_analog") {
            let (mask, kind) = (word("standard_analog_output_mask"), word("standard_analog_output_type"));
            for (index, output) in self.robot.analog_outputs.iter_mut().enumerate() {
                let share = number(&format!("standard_analog_output_{index}"));
                if mask >> index & 1 == 1 && share.is_finite() {
                    let share = share.clamp(0.0, 1.0);
                    // 1 is a voltage, 0 a current.
                    *output = if kind >> index & 1 == 1 { 10.0 * share } else { 0.004 + 0.016 * share };
                }
            }
        }
    }
}
