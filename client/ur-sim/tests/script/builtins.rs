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
    assert_eq!(value("str_cat(\"x = \", [1, 2.0])"), "x = [1, 2]");
    assert_eq!(value("to_num(\"12\") + to_num(\"0.5\")"), "12.5");
    assert_eq!(value("str_len(to_str(p[0,0,0,0,0,0]))"), "19");
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
    assert_eq!(error("str_at(\"abc\", 3)").2, "str_at has no byte 3");
    assert_eq!(error("pose_inv([1, 2])").2, "pose_inv wants a pose, not a list");
    assert_eq!(error("to_num(\"1x\")").2, "to_num wants a string with a number");
    assert_eq!(error("pow(2)").2, "pow takes 2 arguments, not 1");
    assert_eq!(error("pow(2, base=3)").2, "pow wants exponent there, not base");
    assert_eq!(
        error("binary_list_to_integer([1])").2,
        "binary_list_to_integer wants truth values, not an integer"
    );
}

/// The manual: six decimals, and no zeros at the end.
#[test]
fn numbers_in_strings_are_written_as_the_manual_says() {
    for (written, expected) in [
        ("to_str(p[1.0, 2.5, 3, 4, 5, 6])", "p[1, 2.5, 3, 4, 5, 6]"),
        ("to_str(1.0)", "1"),
        ("to_str(100.0)", "100"),
        ("to_str(-0.5)", "-0.5"),
        ("to_str(1 / 3)", "0.333333"),
        ("to_str(2 / 3)", "0.666667"),
        ("to_str(1e-7)", "0"),
        ("to_str(1.5e10)", "15000000000"),
        ("to_str(7)", "7"),
        ("to_str(True)", "True"),
        ("to_str([1.50, 2, False])", "[1.5, 2, False]"),
        ("to_str([[1.0, 2.0], [3.25, 4.0]])", "[[1, 2], [3.25, 4]]"),
        ("to_str(to_num(\"-inf\"))", "-inf"),
        ("to_str(to_num(\"nan\"))", "nan"),
        ("str_cat(\"v = \", 0.10)", "v = 0.1"),
        ("str_cat(1.0, [2.0, p[0,0,0,0,0,0.5]])", "1[2, p[0, 0, 0, 0, 0, 0.5]]"),
    ] {
        assert_eq!(value(written), expected, "{written}");
    }
    let doubled = |more: &str| {
        format!("s = \"0123456789abcdef\"\nwhile str_len(s) < 512:\n  s = str_cat(s, s)\nend\n{more}")
    };
    let most = "textmsg(str_len(str_cat(s, str_sub(s, 0, 511))))";
    assert_eq!(crate::machine::content(&doubled(most)), ["1023"]);
    assert!(error(&doubled("str_cat(s, s)")).2.contains("longer than 1023 bytes"));
    assert!(error("to_str(make_list(600, 1))").2.contains("longer than 1023 bytes"));
    assert_eq!(error("to_str(None)").2, "to_str cannot write nothing");
    assert_eq!(error("str_cat(\"a\", [None])").2, "str_cat cannot write nothing");
}

#[test]
fn strings_become_numbers_as_the_manual_says() {
    for (written, expected) in [
        ("0X3A", "58"),
        ("0xb5", "181"),
        ("-0x10", "-16"),
        ("+7", "7"),
        ("  -5", "-5"),
        (".36", "0.36"),
        ("-2.0", "-2.0"),
        ("5.", "5.0"),
        ("2.5E-5", "2.5e-5"),
        ("10e3", "10000.0"),
        ("-2147483648", "-2147483648"),
        ("INF", "inf"),
        ("-infinity", "-inf"),
        ("+Infinity", "inf"),
        ("NaN", "NaN"),
    ] {
        assert_eq!(value(&format!("to_num(\"{written}\")")), expected, "{written}");
    }
    for none in ["", "-", "0x", "0x1.5", "0xg", "--5", "+-5", "1e", "1 2", "1,5", "in", "nano", "0x-5"] {
        assert_eq!(error(&format!("to_num(\"{none}\")")).2, "to_num wants a string with a number", "{none}");
    }
    for large in ["2147483648", "0xffffffff", "99999999999999999999", "1e999", "-1.0e400"] {
        let message = error(&format!("to_num(\"{large}\")")).2;
        assert_eq!(message, "to_num wants a number that its type can hold", "{large}");
    }
}

#[test]
fn strings_are_counted_in_bytes() {
    // An e with an accent is two bytes, a degree sign too.
    for (asked, expected) in [
        ("str_len(\"h\u{e9}llo\")", "6"),
        ("length(\"h\u{e9}llo\")", "6"),
        ("str_find(\"h\u{e9}llo\", \"llo\")", "3"),
        ("str_find(\"5\u{b0}5\u{b0}\", \"5\", 1)", "3"),
        ("str_sub(\"h\u{e9}llo\", 3)", "llo"),
        ("str_sub(\"h\u{e9}llo\", 1, 2)", "\u{e9}"),
        ("str_len(str_at(\"h\u{e9}llo\", 1))", "1"),
        ("str_cat(str_at(\"\u{e9}\", 0), str_at(\"\u{e9}\", 1)) == \"\u{e9}\"", "True"),
        ("str_sub(\"abc\", 3)", ""),
        ("str_sub(\"abc\", 1, 100)", "bc"),
        ("str_find(\"abc\", \"\")", "0"),
    ] {
        assert_eq!(value(asked), expected, "{asked}");
    }
    assert_eq!(error("str_sub(\"abc\", 4)").2, "str_sub wants an index up to 3");
    assert_eq!(error("str_sub(\"abc\", 0, -1)").2, "str_sub wants no negative position");
}
