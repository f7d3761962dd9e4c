//! The functions that need no robot, and what calls may look like.

mod lists;
mod math;
mod pose;
mod text;

use super::value::Value;

/// A function of the interpreter's own.
pub(super) struct Own {
    name: &'static str,
    /// In order; the first `required` must be given.
    parameters: &'static [&'static str],
    required: usize,
    run: fn(&[Value]) -> Result<Value, String>,
}

const fn own(
    name: &'static str,
    parameters: &'static [&'static str],
    run: fn(&[Value]) -> Result<Value, String>,
) -> Own {
    Own { name, parameters, required: parameters.len(), run }
}

/// In the order of the alphabet, which `find` relies on.
const OWN: [Own; 42] = [
    own("acos", &["f"], |given| math::one(given, f64::acos)),
    own("asin", &["f"], |given| math::one(given, f64::asin)),
    own("atan", &["f"], |given| math::one(given, f64::atan)),
    // The manual's x stands over its y.
    own("atan2", &["x", "y"], |given| math::two(given, f64::atan2)),
    own("binary_list_to_integer", &["l"], lists::binary_list_to_integer),
    own("ceil", &["f"], |given| math::whole(given, f64::ceil)),
    own("cos", &["f"], |given| math::one(given, f64::cos)),
    own("d2r", &["d"], |given| math::one(given, f64::to_radians)),
    own("floor", &["f"], |given| math::whole(given, f64::floor)),
    own("get_list_length", &["v"], lists::length),
    own("integer_to_binary_list", &["x"], lists::integer_to_binary_list),
    own("interpolate_pose", &["p_from", "p_to", "alpha"], pose::interpolate_pose),
    own("inv", &["m"], lists::inv),
    own("length", &["v"], lists::length),
    own("log", &["b", "f"], |given| math::two(given, |base, of| of.log(base))),
    Own {
        name: "make_list",
        parameters: &["length", "initial_value", "capacity"],
        required: 2,
        run: lists::make_list,
    },
    own("norm", &["a"], lists::norm),
    own("normalize", &["v"], lists::normalize),
    own("point_dist", &["p_from", "p_to"], pose::point_dist),
    own("pose_add", &["p_1", "p_2"], pose::pose_add),
    own("pose_dist", &["p_from", "p_to"], pose::pose_dist),
    own("pose_inv", &["p_from"], pose::pose_inv),
    own("pose_sub", &["p_to", "p_from"], pose::pose_sub),
    own("pose_trans", &["p_from", "p_from_to"], pose::pose_trans),
    own("pow", &["base", "exponent"], |given| math::two(given, f64::powf)),
    own("r2d", &["r"], |given| math::one(given, f64::to_degrees)),
    own("rotvec2rpy", &["rotation_vector"], pose::rotvec2rpy),
    own("rpy2rotvec", &["rpy_vector"], pose::rpy2rotvec),
    own("sin", &["f"], |given| math::one(given, f64::sin)),
    own("size", &["v"], lists::size),
    own("sqrt", &["f"], |given| math::one(given, f64::sqrt)),
    own("str_at", &["src", "index"], text::str_at),
    own("str_cat", &["op1", "op2"], text::str_cat),
    own("str_empty", &["str"], text::str_empty),
    Own { name: "str_find", parameters: &["src", "target", "start_from"], required: 2, run: text::str_find },
    own("str_len", &["str"], text::str_len),
    Own { name: "str_sub", parameters: &["src", "index", "len"], required: 2, run: text::str_sub },
    own("tan", &["f"], |given| math::one(given, f64::tan)),
    own("to_num", &["str"], text::to_num),
    own("to_str", &["val"], text::to_str),
    own("transpose", &["m"], lists::transpose),
    own("wrench_trans", &["T_from_to", "w_from"], pose::wrench_trans),
];

/// The number of the function of that name.
pub(super) fn find(name: &str) -> Option<usize> {
    OWN.binary_search_by(|own| own.name.cmp(name)).ok()
}

/// Whether the function may be called so: named arguments stand in the order of the parameters.
pub(super) fn check(number: usize, positional: usize, names: &[String]) -> Result<(), String> {
    let Some(own) = OWN.get(number) else { return Err("is not there".to_owned()) };
    let given = positional.saturating_add(names.len());
    if given < own.required || given > own.parameters.len() {
        let wanted = if own.required == own.parameters.len() {
            own.required.to_string()
        } else {
            format!("{} to {}", own.required, own.parameters.len())
        };
        return Err(format!("takes {wanted} arguments, not {given}"));
    }
    match names.iter().zip(own.parameters.iter().skip(positional)).find(|(name, wanted)| name != wanted) {
        Some((name, wanted)) => Err(format!("wants {wanted} there, not {name}")),
        None => Ok(()),
    }
}

/// Calls a function; the error does not name it.
pub(super) fn call(number: usize, arguments: &[Value]) -> Result<Value, String> {
    OWN.get(number).map_or(Err("is not there".to_owned()), |own| (own.run)(arguments))
}

pub(super) fn name(number: usize) -> &'static str {
    OWN.get(number).map_or("", |own| own.name)
}

/// The names that have a value without being assigned one: the defaults of the manual's motion module.
pub(super) fn constant(name: &str) -> Option<Value> {
    Some(Value::Float(match name {
        "a_joint_default" => 1.4,
        "a_tool_default" => 1.2,
        "v_joint_default" => 1.05,
        "v_tool_default" => 0.25,
        _ => return None,
    }))
}

/// The number at `at`.
fn number(arguments: &[Value], at: usize) -> Result<f64, String> {
    let value = arguments.get(at).unwrap_or(&Value::None);
    value.as_number().ok_or_else(|| format!("wants a number, not {}", value.kind()))
}

/// The integer at `at`.
fn integer(arguments: &[Value], at: usize) -> Result<i32, String> {
    let value = arguments.get(at).unwrap_or(&Value::None);
    value.as_integer().ok_or_else(|| format!("wants an integer, not {}", value.kind()))
}

/// The value at `at`.
fn value(arguments: &[Value], at: usize) -> &Value {
    arguments.get(at).unwrap_or(&Value::None)
}

#[cfg(test)]
mod tests;
