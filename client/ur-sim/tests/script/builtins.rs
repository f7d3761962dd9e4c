//! The functions of the interpreter's own.

use crate::machine::{error, value};

fn numbers(expression: &str) -> Vec<f64> {
    let text = value(expression);
    let inside = text.trim_start_matches(['p', '[']).trim_end_matches(']').to_owned();
    inside.split(", ").map(|number| number.parse().unwrap()).collect()
}

#[track_caller]
fn near(expression: &str, expected: &[f64]) {
    let found = numbers(expression);
    assert_eq!(found.len(), expected.len(), "{expression}");
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{expression}: {found} instead of {expected}");
    }
}

#[test]
fn numbers_have_their_functions() {
    near("sqrt(2) * sqrt(2)", &[2.0]);
    near("pow(2, 10)", &[1024.0]);
    near("atan2(1, 0)", &[std::f64::consts::FRAC_PI_2]);
    near("d2r(180) - acos(-1)", &[0.0]);
    near("r2d(asin(1))", &[90.0]);
    near("sin(0.3) / cos(0.3) - tan(0.3) + atan(0)", &[0.0]);
    near("log(2, 8)", &[3.0]);
    assert_eq!(value("[floor(-1.5), ceil(1.2)]"), "[-2, 2]");
    assert_eq!(value("norm(-3)"), "3");
    assert_eq!(value("norm([3, 4])"), "5.0");
}

#[test]
fn lists_have_their_functions() {
    assert_eq!(value("get_list_length([1, 2, 3])"), "3");
    assert_eq!(value("length(\"four\")"), "4");
    assert_eq!(value("make_list(3, 0)"), "[0, 0, 0]");
    assert_eq!(value("size([[1, 2, 3], [4, 5, 6]])"), "[2, 3]");
    assert_eq!(value("transpose([[1, 2, 3], [4, 5, 6]])"), "[[1, 4], [2, 5], [3, 6]]");
    assert_eq!(value("binary_list_to_integer([True, False, True])"), "5");
    assert_eq!(value("binary_list_to_integer(integer_to_binary_list(-7))"), "-7");
    near("normalize([3, 4])", &[0.6, 0.8]);
}

#[test]
fn strings_have_their_functions() {
    assert_eq!(value("str_cat(\"x = \", [1, 2.0])"), "x = [1, 2.0]");
    assert_eq!(value("to_num(\"12\") + to_num(\"0.5\")"), "12.5");
    assert_eq!(value("str_len(to_str(p[0,0,0,0,0,0]))"), "31");
    assert_eq!(value("str_find(\"abcabc\", \"ca\")"), "2");
    assert_eq!(value("str_find(\"abcabc\", \"b\", 2)"), "4");
    assert_eq!(value("str_find(\"abc\", \"z\")"), "-1");
    assert_eq!(value("str_sub(\"abcdef\", 2, 3)"), "cde");
    assert_eq!(value("str_cat(str_at(\"abc\", 1), str_sub(\"abc\", 2))"), "bc");
    assert_eq!(value("str_empty(\"\")"), "True");
}

#[test]
fn poses_turn_and_move() {
    // A quarter turn about z takes the tool's x to the base's y.
    let quarter = "p[1, 0, 0, 0, 0, d2r(90)]";
    let half = std::f64::consts::FRAC_PI_2;
    near(&format!("pose_trans({quarter}, p[1, 0, 0, 0, 0, 0])"), &[1.0, 1.0, 0.0, 0.0, 0.0, half]);
    near(&format!("pose_add({quarter}, p[1, 0, 0, 0, 0, 0])"), &[2.0, 0.0, 0.0, 0.0, 0.0, half]);
    near(&format!("pose_inv({quarter})"), &[0.0, 1.0, 0.0, 0.0, 0.0, -half]);
    near(
        &format!("interpolate_pose(p[0,0,0,0,0,0], {quarter}, 0.5)"),
        &[0.5, 0.0, 0.0, 0.0, 0.0, half / 2.0],
    );
    near("point_dist(p[1, 2, 3, 0, 0, 1], p[1, 2, 5, 1, 0, 0])", &[2.0]);
}

/// The examples of the script manual's pages on `pose_add` and `pose_trans` (5.x and 10.6), to the digits
/// printed.
#[test]
fn poses_are_what_the_manual_says() {
    let (a, b) = ("p[.2,.5,.1,1.57,0,0]", "p[.2,.5,.6,1.57,0,0]");
    let rounded =
        |expression: String| numbers(&expression).iter().map(|x| (x * 1e4).round() / 1e4).collect::<Vec<_>>();
    assert_eq!(rounded(format!("pose_add({a}, {b})")), [0.4, 1.0, 0.7, 2.0 * 1.57, 0.0, 0.0]);
    assert_eq!(rounded(format!("pose_trans({a}, {b})")), [0.4, -0.0996, 0.6005, 2.0 * 1.57, 0.0, 0.0]);
}

#[test]
fn poses_and_their_inverses_cancel() {
    let (a, b) = ("p[0.3, -0.2, 0.5, 1.2, -0.4, 2.1]", "p[-0.1, 0.4, 0.2, -0.7, 2.5, 0.3]");
    near(&format!("pose_trans({a}, pose_inv({a}))"), &[0.0; 6]);
    near(&format!("pose_add(pose_sub({a}, {b}), {b})"), &numbers(a));
    let there = format!("pose_trans({a}, pose_trans(pose_inv({a}), {b}))");
    near(&there, &numbers(b));
    near("rotvec2rpy(rpy2rotvec([0.1, -0.2, 0.3]))", &[0.1, -0.2, 0.3]);
}

#[test]
fn functions_say_what_they_cannot_take() {
    assert_eq!(error("sqrt(-1)"), (1, 1, "sqrt has no value there".to_owned()));
    assert_eq!(error("x = sin(\"1\")").2, "sin wants a number, not a string");
    assert_eq!(error("str_at(\"abc\", 3)").2, "str_at has no letter 3");
    assert_eq!(error("pose_inv([1, 2])").2, "pose_inv wants a pose, not a list");
    assert_eq!(error("to_num(\"1x\")").2, "to_num wants a string with a number");
    assert_eq!(error("pow(2)").2, "pow takes 2 arguments, not 1");
    assert_eq!(error("pow(2, base=3)").2, "pow wants exponent there, not base");
    assert_eq!(
        error("binary_list_to_integer([1])").2,
        "binary_list_to_integer wants truth values, not an integer"
    );
}
