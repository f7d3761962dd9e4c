//! The functions of the interpreter are those of the manual, in order.

use super::*;

/// The own functions with their parameters, those that may be left out in brackets.
fn signatures() -> Vec<String> {
    let signature = |own: &Own| {
        let parameters = own.parameters.iter().enumerate();
        let written: Vec<String> = parameters
            .map(|(at, name)| if at < own.required { (*name).to_owned() } else { format!("[{name}]") })
            .collect();
        format!("{}({})", own.name, written.join(", "))
    };
    OWN.iter().map(signature).collect()
}

/// Whoever adds, changes or takes away a function changes this list.
#[test]
fn these_functions_and_no_others_are_there() {
    let expected = [
        "acos(f)",
        "asin(f)",
        "atan(f)",
        "atan2(x, y)",
        "binary_list_to_integer(l)",
        "ceil(f)",
        "cos(f)",
        "d2r(d)",
        "floor(f)",
        "get_list_length(v)",
        "integer_to_binary_list(x)",
        "interpolate_pose(p_from, p_to, alpha)",
        "inv(m)",
        "length(v)",
        "log(b, f)",
        "make_list(length, initial_value, [capacity])",
        "norm(a)",
        "normalize(v)",
        "point_dist(p_from, p_to)",
        "pose_add(p_1, p_2)",
        "pose_dist(p_from, p_to)",
        "pose_inv(p_from)",
        "pose_sub(p_to, p_from)",
        "pose_trans(p_from, p_from_to)",
        "pow(base, exponent)",
        "r2d(r)",
        "rotvec2rpy(rotation_vector)",
        "rpy2rotvec(rpy_vector)",
        "sin(f)",
        "size(v)",
        "sqrt(f)",
        "str_at(src, index)",
        "str_cat(op1, op2)",
        "str_empty(str)",
        "str_find(src, target, [start_from])",
        "str_len(str)",
        "str_sub(src, index, [len])",
        "tan(f)",
        "to_num(str)",
        "to_str(val)",
        "transpose(m)",
        "wrench_trans(T_from_to, w_from)",
    ];
    assert_eq!(signatures(), expected);
    // `find` looks by halves.
    let mut sorted = signatures();
    sorted.sort_by(|a, b| a.split('(').next().cmp(&b.split('(').next()));
    assert_eq!(signatures(), sorted);
}
