//! What the language does: values, operators, functions, scopes, conditions and loops.

use crate::machine::{said, value};

#[test]
fn operators_bind_as_in_arithmetic() {
    assert_eq!(value("1 + 2 * 3 - 4"), "3");
    assert_eq!(value("(1 + 2) * -3"), "-9");
    assert_eq!(value("-2 * -2"), "4");
    assert_eq!(value("7 % 4 + 0.5"), "3.5");
    assert_eq!(value("not False and False"), "False");
    assert_eq!(value("not (False and False)"), "True");
    assert_eq!(value("1 + 1 == 2 and 2 * 3 > 5 or False"), "True");
    assert_eq!(value("True xor True"), "False");
    assert_eq!(value("1 == 1.0"), "True");
    assert_eq!(value("\"a\" == \"a\" and \"a\" != 1"), "True");
}

#[test]
fn integers_stay_integers_but_their_quotient_is_a_float() {
    assert_eq!(value("7 / 2"), "3.5");
    assert_eq!(value("6 / 2"), "3.0");
    assert_eq!(value("7 % 2"), "1");
    assert_eq!(value("-7 % 4"), "-3");
    assert_eq!(value("2 * 3"), "6");
    assert_eq!(value("2147483647 + 1"), "2147483648.0");
    assert_eq!(value("65536 * 65536"), "4294967296.0");
    assert_eq!(value("1e-5"), "1e-5");
}

#[test]
fn lists_calculate_element_by_element() {
    assert_eq!(value("[1, 2.5] + [1, 1]"), "[2, 3.5]");
    assert_eq!(value("2 * [1, 2] - [0, 1]"), "[2, 3]");
    assert_eq!(value("[2, 4] / 2"), "[1.0, 2.0]");
    assert_eq!(value("-[1, 2.0]"), "[-1, -2.0]");
    assert_eq!(value("[[1, 2], [3, 4]] * 10"), "[[10, 20], [30, 40]]");
    assert_eq!(value("[1, 2] == [1.0, 2.0]"), "True");
    assert_eq!(value("[1, 2] == [1, 2, 3]"), "False");
}

#[test]
fn elements_are_read_and_written_and_copies_stay_what_they_are() {
    let program = "a = [1, 2, 3]\nb = a\na[1] = 20\ntextmsg(a, b)\ntextmsg(a[2])\n\
                   p1 = p[0.1, 0.2, 0.3, 0, 0, 0]\np1[2] = 4\ntextmsg(p1, p1[0])\n\
                   m = [[1, 2], [3, 4]]\nm[1, 0] = 30\ntextmsg(m[1, 0] + m[0][1])\ntextmsg(m)\n";
    assert_eq!(
        said(program),
        ["[1, 20, 3][1, 2, 3]", "3", "p[0.1, 0.2, 4.0, 0.0, 0.0, 0.0]0.1", "32", "[[1, 2], [30, 4]]"]
    );
}

#[test]
fn a_variable_may_be_called_p() {
    assert_eq!(
        said("p = [1, 2]\np[0] = 5\ntextmsg(p[0] + p[1])\nm = p[p[0],0,0,0,0,0]\ntextmsg(m)"),
        ["7", "p[5.0, 0.0, 0.0, 0.0, 0.0, 0.0]"]
    );
}

#[test]
fn and_and_or_leave_out_what_no_longer_matters() {
    let program = "def f(x):\n  textmsg(\"asked\")\n  return x\nend\n\
                   if False and f(True):\n  textmsg(\"wrong\")\nend\n\
                   if True or f(False):\n  textmsg(\"right\")\nend\n";
    assert_eq!(said(program), ["right"]);
}

#[test]
fn conditions_take_the_first_arm_that_holds() {
    let program = |x: i32| {
        format!(
            "def f(x):\n  if x < 0:\n    return \"below\"\n  elif x == 0:\n    return \"zero\"\n  elif x == 1:\n    \
             return \"one\"\n  else:\n    return \"above\"\n  end\nend\ntextmsg(f({x}))"
        )
    };
    assert_eq!([-1, 0, 1, 2].map(|x| said(&program(x)).concat()), ["below", "zero", "one", "above"]);
}

#[test]
fn loops_break_and_continue_the_innermost_one() {
    let program = "i = 0\nwhile True:\n  i = i + 1\n  if i == 2:\n    continue\n  end\n  j = 0\n  while True:\n    \
                   j = j + 1\n    if j > i:\n      break\n    end\n  end\n  textmsg(i, j)\n  if i >= 3:\n    break\n  \
                   end\nend\ntextmsg(\"end\")";
    assert_eq!(said(program), ["12", "34", "end"]);
}

#[test]
fn functions_take_arguments_by_place_by_name_and_by_default() {
    let program = "def f(a, b=10, c=a + b):\n  return [a, b, c]\nend\n\
                   textmsg(f(1))\ntextmsg(f(1, 2))\ntextmsg(f(1, c=3))\ntextmsg(f(c=3, a=1))";
    assert_eq!(said(program), ["[1, 10, 11]", "[1, 2, 3]", "[1, 10, 3]", "[1, 10, 3]"]);
}

#[test]
fn functions_call_themselves_and_each_other_wherever_they_stand() {
    let program = "def program():\n  def even(n):\n    if n == 0:\n      return True\n    end\n    return odd(n - 1)\n  \
                   end\n  def odd(n):\n    if n == 0:\n      return False\n    end\n    return even(n - 1)\n  end\n  \
                   def fact(n):\n    if n < 2:\n      return 1\n    end\n    return n * fact(n - 1)\n  end\n  \
                   textmsg(even(10), odd(10))\n  textmsg(fact(10))\nend\n";
    assert_eq!(said(program), ["TrueFalse", "3628800"]);
}

#[test]
fn a_function_without_return_gives_none() {
    assert_eq!(said("def f():\n  x = 1\nend\ntextmsg(f())"), ["None"]);
}

#[test]
fn a_free_variable_is_the_global_and_a_local_one_masks_it() {
    let program = "def program():\n  global a = 0\n  def f():\n    a = 1\n  end\n  def g():\n    local a = 2\n    \
                   textmsg(a)\n  end\n  def h():\n    global made = 3\n  end\n  f()\n  textmsg(a)\n  g()\n  textmsg(a)\n  \
                   h()\n  textmsg(made)\nend\n";
    assert_eq!(said(program), ["1", "2", "1", "3"]);
}

#[test]
fn a_free_variable_of_the_program_is_seen_and_set_by_the_functions_inside() {
    let program = "def program():\n  a = 1\n  def f():\n    a = a + 1\n    b = 5\n  end\n  b = 7\n  f()\n  \
                   textmsg(a, b)\n  def g(a):\n    a = 100\n  end\n  g(3)\n  textmsg(a)\nend\n";
    assert_eq!(said(program), ["25", "2"]);
}

#[test]
fn locals_of_a_call_are_its_own() {
    let program = "def f(n):\n  local mine = n\n  if n > 0:\n    f(n - 1)\n  end\n  textmsg(mine)\nend\nf(2)";
    assert_eq!(said(program), ["0", "1", "2"]);
}

#[test]
fn text_is_laid_out_freely() {
    let program = "  # a comment\n\n$ 1 \"Robot Program\"\n\ttextmsg(\"a # b\", # not the end\n\t\t1,\n   2)\r\n\
                   x = 1 +\n  2\nif (x == 3 or\n    False):\n textmsg('x')\nend";
    assert_eq!(said(program), ["a # b12", "x"]);
}

#[test]
fn halt_ends_the_program_wherever_it_stands() {
    assert_eq!(said("def f():\n  halt\nend\ntextmsg(1)\nf()\ntextmsg(2)"), ["1"]);
}

#[test]
fn named_arguments_reach_the_machine_with_their_names() {
    let program = "servoj([0, 0, 0, 0, 0, 0], t=0.002, lookahead_time=0.1, gain=300)";
    assert_eq!(said(program), ["servoj [0, 0, 0, 0, 0, 0] t=0.002 lookahead_time=0.1 gain=300"]);
}

#[test]
fn the_defaults_of_motions_have_values() {
    assert_eq!(value("[a_joint_default, v_tool_default]"), "[1.4, 0.25]");
}
