//! The settings that programs make: tool, payload, inputs and outputs, modbus. The header of every program
//! that a pendant saves is full of them.
//!
//! Contract: bounded; each is taken with the parameters of the manual and remembered. Those that this
//! simulator has a use for have their effect too.
//!
//! *Source*: script manual, modules "internals", "interfaces" and "ioconfiguration".

use super::machine::{Hands, Result, number, number_or};
use super::setup::{LONGEST_VALUE, MOST_SETTINGS, ModbusSignal};
use crate::script::{MachineCall, Value};

/// Largest component of a payload's inertia \[kg m²\].
const MOST_INERTIA: f64 = 133.0;

/// Of the tool's connector.
const BAUD_RATES: [i32; 8] = [9600, 19200, 38400, 57600, 115_200, 1_000_000, 2_000_000, 5_000_000];
/// Longest name of a signal of modbus \[characters\].
const LONGEST_SIGNAL: usize = 20;

/// Parameters of a setting, and how many must be given.
struct Signature {
    name: &'static str,
    parameters: &'static [&'static str],
    required: usize,
    /// The first argument says what is set; else there is one of its kind.
    of_each: bool,
}

const fn once(name: &'static str, parameters: &'static [&'static str], required: usize) -> Signature {
    Signature { name, parameters, required, of_each: false }
}

const fn each(name: &'static str, parameters: &'static [&'static str], required: usize) -> Signature {
    Signature { name, parameters, required, of_each: true }
}

const SIGNATURES: &[Signature] = &[
    once("set_tcp", &["pose", "tcp_name"], 1),
    once("set_payload", &["m", "cog"], 1),
    once("set_target_payload", &["m", "cog", "inertia", "transition_time"], 2),
    once("set_payload_mass", &["m"], 1),
    once("set_payload_cog", &["CoG"], 1),
    once("set_gravity", &["d"], 1),
    once("set_tool_voltage", &["voltage"], 1),
    once("set_tool_output_mode", &["mode"], 1),
    each("set_tool_digital_output_mode", &["n", "mode"], 2),
    once(
        "set_tool_communication",
        &["enabled", "baud_rate", "parity", "stop_bits", "rx_idle_chars", "tx_idle_chars"],
        6,
    ),
    each("set_analog_inputrange", &["port", "range"], 2),
    each("set_analog_outputdomain", &["port", "domain"], 2),
    each("set_standard_analog_input_domain", &["port", "domain"], 2),
    each("set_tool_analog_input_domain", &["port", "domain"], 2),
    once("set_input_actions_to_default", &[], 0),
    each("set_standard_digital_input_action", &["port", "action"], 2),
    each("set_configurable_digital_input_action", &["port", "action"], 2),
    each("set_tool_digital_input_action", &["port", "action"], 2),
    each("set_gp_boolean_input_action", &["port", "action"], 2),
    once("set_runstate_outputs", &["outputs"], 1),
    each("set_runstate_configurable_digital_output_to_value", &["outputId", "state"], 2),
    each("set_runstate_gp_boolean_output_to_value", &["outputId", "state"], 2),
    each("set_runstate_standard_analog_output_to_value", &["outputId", "state"], 2),
    each("set_runstate_standard_digital_output_to_value", &["outputId", "state"], 2),
    each("set_runstate_tool_digital_output_to_value", &["outputId", "state"], 2),
    each("set_euromap_runstate_dependent_choice", &["port_number", "runstate_choice"], 2),
    once("set_safety_mode_transition_hardness", &["type"], 1),
    once("position_deviation_warning", &["enabled", "threshold"], 1),
    once("reset_revolution_counter", &["qNear"], 0),
    each("pause_on_error_code", &["code", "argument"], 1),
    each(
        "modbus_add_signal",
        &["IP", "slave_number", "signal_address", "signal_type", "signal_name", "sequential_mode"],
        5,
    ),
    each("modbus_delete_signal", &["signal_name"], 1),
    each("modbus_set_digital_input_action", &["signal_name", "action"], 2),
    each("modbus_set_output_register", &["signal_name", "register_value", "is_secondary_program"], 2),
    each("modbus_set_output_signal", &["signal_name", "digital_value", "is_secondary_program"], 2),
    each("modbus_set_runstate_dependent_choice", &["signal_name", "runstate_choice"], 2),
    each("modbus_set_signal_update_frequency", &["signal_name", "update_frequency"], 2),
    each("modbus_send_custom_command", &["IP", "slave_number", "function_code", "data"], 4),
];

fn text<'a>(value: Option<&'a Value>, name: &str) -> Result<&'a str> {
    value.and_then(Value::as_text).ok_or_else(|| format!("wants a string for {name}"))
}

/// A number of `range`, and no fraction.
fn whole(value: Option<&Value>, name: &str, range: std::ops::RangeInclusive<i32>) -> Result<i32> {
    let number = value.and_then(Value::as_integer).filter(|number| range.contains(number));
    number.ok_or_else(|| format!("wants a number from {} to {} for {name}", range.start(), range.end()))
}

/// The last port of the kind that a setting's name tells.
fn last_port(name: &str) -> i32 {
    if name.contains("_gp_boolean_") {
        127
    } else if name.contains("_tool_") || name.contains("_analog_") {
        1
    } else {
        7
    }
}

fn centre(value: Option<&Value>) -> Result<[f64; 3]> {
    let centre = value.and_then(Value::as_numbers::<3>).ok_or("wants three numbers for cog")?;
    let near = centre.iter().all(|number| number.abs() < 1e3);
    if near { Ok(centre) } else { Err("wants a centre of gravity within metres".to_owned()) }
}

/// The bounds are the manual's.
fn inertia(value: Option<&Value>) -> Result<[f64; 6]> {
    let inertia = value.and_then(Value::as_numbers::<6>).ok_or("wants six numbers for inertia")?;
    if !inertia.iter().all(|number| number.abs() <= MOST_INERTIA) {
        return Err(format!("wants an inertia within {MOST_INERTIA} kg m²"));
    }
    if inertia.iter().take(3).any(|number| *number < 0.0) {
        return Err("wants no negative Ixx, Iyy, Izz".to_owned());
    }
    Ok(inertia)
}

impl Hands<'_> {
    /// Takes a setting.
    pub(super) fn set_up(&mut self, call: &MachineCall<'_>) -> Result<Value> {
        let known = SIGNATURES.iter().find(|known| known.name == call.name);
        let Signature { parameters, required, of_each, .. } = known.ok_or("is no setting")?;
        let mut given: [Option<&Value>; 8] = [None; 8];
        let count = call.arguments.positional.len() + call.arguments.named.len();
        if count > parameters.len() {
            return Err(format!("takes at most {} arguments, not {count}", parameters.len()));
        }
        let mut padded = [""; 8];
        padded.iter_mut().zip(*parameters).for_each(|(padded, name)| *padded = name);
        given.iter_mut().zip(call.arguments.bind(padded)?).for_each(|(given, bound)| *given = bound);
        if let Some((name, _)) =
            parameters.iter().zip(&given).take(*required).find(|(_, given)| given.is_none())
        {
            return Err(format!("wants an argument for {name}"));
        }
        self.take_effect(call.name, &given)?;
        let mut values = given.iter().take(parameters.len()).flatten().map(ToString::to_string);
        let key = match values.next().filter(|_| *of_each) {
            Some(which) if call.name == "modbus_add_signal" => {
                format!(
                    "{} {}",
                    call.name,
                    given.get(4).copied().flatten().map_or(which, ToString::to_string)
                )
            }
            Some(which) => format!("{} {which}", call.name),
            None => call.name.to_owned(),
        };
        let of_each = *of_each && call.name != "modbus_add_signal";
        let values = given.iter().take(parameters.len()).flatten().skip(usize::from(of_each));
        let value = values.map(ToString::to_string).collect::<Vec<_>>().join(", ");
        let key = key.chars().take(LONGEST_VALUE).collect();
        self.robot.setup.remember(key, &value)?;
        Ok(Value::None)
    }

    fn take_effect(&mut self, name: &str, given: &[Option<&Value>; 8]) -> Result<()> {
        let [first, second, third, fourth, fifth, ..] = *given;
        match name {
            "set_tcp" => {
                let pose = first.and_then(Value::as_numbers::<6>).ok_or("wants a pose")?;
                if pose.iter().any(|number| !(number.abs() < 1e3)) {
                    return Err("wants a pose within metres".to_owned());
                }
                self.robot.tcp_offset = pose;
            }
            "set_payload" | "set_target_payload" | "set_payload_mass" => {
                let mass = number(first, "m")?;
                if !(0.0..=100.0).contains(&mass) {
                    return Err("wants a mass from 0 to 100 kg".to_owned());
                }
                let centre = match second {
                    Some(cog) => centre(Some(cog))?,
                    None if name == "set_payload" => {
                        let [x, y, z, ..] = self.robot.tcp_offset;
                        [x, y, z]
                    }
                    None => self.robot.payload.1,
                };
                // The older calls take the inertia back.
                let inertia = third.map_or(Ok([0.0; 6]), |third| inertia(Some(third)))?;
                if number_or(fourth, "transition_time", 0.0)? < 0.0 {
                    return Err("wants no negative transition_time".to_owned());
                }
                self.robot.payload = (mass, centre);
                self.robot.payload_inertia = inertia;
            }
            "set_payload_cog" => self.robot.payload.1 = centre(first)?,
            "set_gravity" => {
                first.and_then(Value::as_numbers::<3>).ok_or("wants three numbers for d")?;
            }
            "set_tool_voltage" => match whole(first, "voltage", 0..=24)? {
                volts @ (0 | 12 | 24) => self.robot.setup.tool_voltage = volts,
                volts => return Err(format!("wants 0, 12 or 24 V, not {volts}")),
            },
            "set_tool_output_mode" => {
                self.robot.setup.tool_output_mode = u8::try_from(whole(first, "mode", 0..=1)?).unwrap_or(0);
            }
            "set_tool_digital_output_mode" => {
                let output = usize::try_from(whole(first, "n", 0..=1)?).unwrap_or(0);
                let mode = u8::try_from(whole(second, "mode", 1..=3)?).unwrap_or(1);
                if let Some(place) = self.robot.setup.tool_digital_output_modes.get_mut(output) {
                    *place = mode;
                }
            }
            "set_standard_analog_input_domain" | "set_analog_outputdomain" => {
                let shift = if name == "set_analog_outputdomain" { 2 } else { 0 };
                let bit = whole(first, "port", 0..=1)? + shift;
                let on = whole(second, "domain", 0..=1)? == 1;
                let domains = &mut self.robot.setup.analog_domains;
                *domains = *domains & !(1 << bit) | u32::from(on) << bit;
            }
            "set_tool_analog_input_domain" => {
                whole(first, "port", 0..=1)?;
                whole(second, "domain", 0..=1)?;
            }
            "set_runstate_standard_digital_output_to_value"
            | "set_runstate_configurable_digital_output_to_value"
            | "set_runstate_tool_digital_output_to_value"
            | "set_runstate_standard_analog_output_to_value"
            | "set_runstate_gp_boolean_output_to_value" => {
                whole(first, "outputId", 0..=last_port(name))?;
                whole(second, "state", 0..=7)?;
            }
            "set_standard_digital_input_action"
            | "set_configurable_digital_input_action"
            | "set_tool_digital_input_action"
            | "set_gp_boolean_input_action" => {
                whole(first, "port", 0..=last_port(name))?;
                match text(second, "action")? {
                    "default" | "freedrive" => {}
                    other => return Err(format!("knows default and freedrive, not {other:?}")),
                }
            }
            "set_safety_mode_transition_hardness" => {
                whole(first, "type", 0..=1)?;
            }
            "set_tool_communication" => {
                first.and_then(Value::as_bool).ok_or("wants a truth value for enabled")?;
                if !second.and_then(Value::as_integer).is_some_and(|rate| BAUD_RATES.contains(&rate)) {
                    return Err(format!("wants one of {BAUD_RATES:?} for baud_rate"));
                }
                whole(third, "parity", 0..=2)?;
                whole(fourth, "stop_bits", 1..=2)?;
                let [.., sixth, _, _] = *given;
                for (value, name, least) in [(fifth, "rx_idle_chars", 1.0), (sixth, "tx_idle_chars", 0.0)] {
                    if !(least..=40.0).contains(&number(value, name)?) {
                        return Err(format!("wants a number from {least} to 40 for {name}"));
                    }
                }
            }
            "modbus_add_signal" => {
                text(first, "IP")?;
                whole(second, "slave_number", 0..=255)?;
                whole(third, "signal_address", 0..=65535)?;
                if text(fifth, "signal_name")?.chars().count() > LONGEST_SIGNAL {
                    return Err(format!("wants a signal_name of at most {LONGEST_SIGNAL} characters"));
                }
                let kind = whole(fourth, "signal_type", 0..=3)?;
                let signal = text(fifth, "signal_name")?.to_owned();
                let signals = &mut self.robot.setup.modbus;
                if signals.len() >= MOST_SETTINGS && !signals.contains_key(&signal) {
                    return Err(format!("has more than {MOST_SETTINGS} signals"));
                }
                signals.insert(signal, ModbusSignal { bit: kind < 2, value: 0 });
            }
            "modbus_delete_signal" => {
                self.robot.setup.modbus.remove(text(first, "signal_name")?);
            }
            "modbus_set_output_register" | "modbus_set_output_signal" => {
                let as_bit = second.and_then(Value::as_bool).map(i32::from);
                let value = as_bit.or_else(|| second.and_then(Value::as_integer));
                let value = value.ok_or("wants a value for the signal")?;
                self.modbus_signal(first)?.value = value;
            }
            "modbus_send_custom_command" => {
                third.and_then(Value::as_integer).ok_or("wants a number for function_code")?;
            }
            _ => {}
        }
        Ok(())
    }

    fn modbus_signal(&mut self, name: Option<&Value>) -> Result<&mut ModbusSignal> {
        let name = text(name, "signal_name")?;
        let signal = self.robot.setup.modbus.get_mut(name);
        signal.ok_or_else(|| format!("knows no signal {name:?}: modbus_add_signal makes one"))
    }

    pub(super) fn modbus_status(&mut self, call: &MachineCall<'_>) -> Result<Value> {
        let [name, _] = call.arguments.bind(["signal_name", "is_secondary_program"])?;
        let ModbusSignal { bit, value } = *self.modbus_signal(name)?;
        Ok(if bit { Value::Bool(value != 0) } else { Value::Integer(value) })
    }
}

#[cfg(test)]
mod tests {
    use crate::options::{ControllerOptions, Series};
    use crate::setup::MOST_SETTINGS;
    use crate::world::{Runtime, World};

    fn run(series: Series, text: &str) -> (World, String) {
        let mut world = World::new(ControllerOptions::new(series));
        world.take_script(text);
        (0..500).for_each(|_| world.cycle());
        let said = format!("{:?}", world.messages.drain(..).collect::<Vec<_>>());
        (world, said)
    }

    const HEADER: &str = "def saved():\n  set_standard_analog_input_domain(0, 1)\n  \
        set_standard_analog_input_domain(1, 1)\n  set_tool_analog_input_domain(0, 1)\n  \
        set_analog_outputdomain(0, 0)\n  set_analog_outputdomain(1, 1)\n  set_tool_voltage(12)\n  \
        set_input_actions_to_default()\n  set_runstate_outputs([])\n  \
        set_runstate_standard_digital_output_to_value(3, 1)\n  set_payload(1.5, [0, 0, 0.1])\n  \
        set_gravity([0.0, 0.0, 9.82])\n  set_tcp(p[0,0,0.1,0,0,0])\n  \
        set_safety_mode_transition_hardness(1)\n  position_deviation_warning(True, 0.5)\n  \
        modbus_add_signal(\"192.168.0.9\", 255, 3, 3, \"speed\", False)\n  \
        modbus_set_runstate_dependent_choice(\"speed\", 0)\n  \
        modbus_set_signal_update_frequency(\"speed\", 10)\n  modbus_set_output_register(\"speed\", 17, False)\n  \
        step_count_31 = 0.0\n  thread Step_Counter_31():\n    while (True):\n      \
        step_count_31 = step_count_31 + 1.0\n      sync()\n    end\n  end\n  run Step_Counter_31()\n  \
        $ 1 \"Robot Program\"\n  sleep(0.1)\n  set_standard_analog_out(1, 0.5)\n  \
        textmsg(\"signal \", modbus_get_signal_status(\"speed\", False))\n  textmsg(\"steps \", step_count_31 > 3)\nend\n";

    #[test]
    fn the_header_of_a_saved_program_is_taken_and_remembered() {
        for series in [Series::Cb3, Series::E] {
            let (world, said) = run(series, HEADER);
            assert_eq!(world.runtime(), Runtime::Stopped);
            assert!(said.contains("signal 17") && said.contains("steps True"), "{said}");
            assert!(!said.contains("RuntimeException"), "{said}");
            let setup = &world.robot.setup;
            let is = |key: &str| setup.settings().get(key).map(String::as_str);
            assert_eq!(is("set_runstate_standard_digital_output_to_value 3"), Some("1"));
            assert_eq!(is("set_gravity"), Some("[0.0, 0.0, 9.82]"));
            assert_eq!(is("modbus_set_signal_update_frequency speed"), Some("10"));
            assert_eq!(is("set_input_actions_to_default"), Some(""));
            assert_eq!((setup.tool_voltage, setup.analog_domains), (12, 0b1011));
            assert_eq!((world.robot.payload, world.robot.tcp_offset[2]), ((1.5, [0.0, 0.0, 0.1]), 0.1));
            // Half of ten volts.
            assert!((world.robot.analog_outputs[1] - 5.0).abs() < 1e-12);
        }
    }

    #[test]
    fn what_came_with_e_series_is_unknown_to_cb3() {
        let header = "def e():\n  set_tool_communication(False, 115200, 0, 1, 1.5, 3.5)\n  \
            set_tool_output_mode(1)\n  set_tool_digital_output_mode(0, 1)\n  textmsg(\"loaded\")\nend\n";
        let (world, said) = run(Series::E, header);
        assert!(said.contains("loaded") && world.robot.setup.tool_output_mode == 1, "{said}");
        let (_, said) = run(Series::Cb3, header);
        assert!(said.contains("there is no function set_tool_communication"), "{said}");
    }

    #[test]
    fn wrong_arguments_are_refused_and_a_missing_function_says_so_when_it_is_called() {
        for (text, why) in [
            ("set_tool_voltage(13)", "wants 0, 12 or 24 V"),
            ("set_tool_voltage()", "wants an argument for voltage"),
            ("set_gravity([1, 2])", "wants three numbers"),
            ("set_analog_outputdomain(2, 0)", "from 0 to 1 for port"),
            ("set_standard_analog_input_domain(0, 1, 2)", "takes at most 2 arguments, not 3"),
            ("set_input_actions_to_default(1)", "takes at most 0 arguments"),
            ("modbus_set_output_register(\"none\", 3, False)", "knows no signal"),
            (
                "textmsg(\"before\")\n  track_conveyor_linear(p[0,0,0,0,0,0], 1)",
                "track_conveyor_linear is not simulated",
            ),
        ] {
            let (_, said) = run(Series::E, &format!("def w():\n  {text}\nend\n"));
            assert!(said.contains(why), "{text}: {said}");
            assert_eq!(said.contains("before"), text.contains("before"));
        }
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let text = "def b():\n  i = 0\n  while True:\n    modbus_add_signal(\"h\", 1, 1, 3, to_str(i))\n    \
            i = i + 1\n    sync()\n  end\nend\n";
        let (mut world, _) = run(Series::E, text);
        (0..200).for_each(|_| world.cycle());
        assert!(world.robot.setup.settings().len() <= MOST_SETTINGS);
        assert_eq!(world.runtime(), Runtime::Stopped);
    }
}
