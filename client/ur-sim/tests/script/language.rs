//! What the language does: values, operators, functions, scopes, conditions and loops.

use crate::machine::{content, value};

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

/// The examples of the script manual's page on matrix and array expressions.
#[test]
fn matrices_and_lists_are_multiplied_as_the_manual_says() {
    assert_eq!(
        value("[[1,2],[3,4],[5,6]] * [[10,20,30],[40,50,60]]"),
        "[[90, 120, 150], [190, 260, 330], [290, 400, 510]]"
    );
    assert_eq!(value("[[1,2],[3,4],[5,6]] * [10,20]"), "[50, 110, 170]");
    assert_eq!(value("[1,2,3] * [10,20,30]"), "[10, 40, 90]");
    assert_eq!(value("[10,20,30] / [1,2,3]"), "[10.0, 10.0, 10.0]");
    assert_eq!(value("[10,20,30] % [1,2,4]"), "[0, 0, 2]");
    assert_eq!(value("5 * [[1,2],[3,4],[5,6]]"), "[[5, 10], [15, 20], [25, 30]]");
    assert_eq!(value("10 / [10,20,40]"), "[1.0, 0.5, 0.25]");
}

#[test]
fn elements_are_read_and_written_and_copies_stay_what_they_are() {
    let program = r"a = [1, 2, 3]
b = a
a[1] = 20
textmsg(a, b)
textmsg(a[2])
p1 = p[0.1, 0.2, 0.3, 0, 0, 0]
p1[2] = 4
textmsg(p1, p1[0])
m = [[1, 2], [3, 4]]
m[1, 0] = 30
textmsg(m[1, 0] + m[0][1])
textmsg(m)
";
    assert_eq!(
        content(program),
        ["[1, 20, 3][1, 2, 3]", "3", "p[0.1, 0.2, 4.0, 0.0, 0.0, 0.0]0.1", "32", "[[1, 2], [30, 4]]"]
    );
}

#[test]
fn a_variable_may_be_called_p() {
    assert_eq!(
        content("p = [1, 2]\np[0] = 5\ntextmsg(p[0] + p[1])\nm = p[p[0],0,0,0,0,0]\ntextmsg(m)"),
        ["7", "p[5.0, 0.0, 0.0, 0.0, 0.0, 0.0]"]
    );
}

#[test]
fn and_and_or_leave_out_what_no_longer_matters() {
    let program = r#"def f(x):
  textmsg("asked")
  return x
end
if False and f(True):
  textmsg("wrong")
end
if True or f(False):
  textmsg("right")
end
"#;
    assert_eq!(content(program), ["right"]);
}

#[test]
fn conditions_take_the_first_arm_that_holds() {
    let program = |x: i32| {
        format!(
            r#"def f(x):
  if x < 0:
    return "below"
  elif x == 0:
    return "zero"
  elif x == 1:
    return "one"
  else:
    return "above"
  end
end
textmsg(f({x}))"#
        )
    };
    assert_eq!([-1, 0, 1, 2].map(|x| content(&program(x)).concat()), ["below", "zero", "one", "above"]);
}

#[test]
fn loops_break_and_continue_the_innermost_one() {
    let program = r#"i = 0
while True:
  i = i + 1
  if i == 2:
    continue
  end
  j = 0
  while True:
    j = j + 1
    if j > i:
      break
    end
  end
  textmsg(i, j)
  if i >= 3:
    break
  end
end
textmsg("end")"#;
    assert_eq!(content(program), ["12", "34", "end"]);
}

#[test]
fn functions_take_arguments_by_place_by_name_and_by_default() {
    let program = r"def f(a, b=10, c=a + b):
  return [a, b, c]
end
textmsg(f(1))
textmsg(f(1, 2))
textmsg(f(1, c=3))
textmsg(f(c=3, a=1))";
    assert_eq!(content(program), ["[1, 10, 11]", "[1, 2, 3]", "[1, 10, 3]", "[1, 10, 3]"]);
}

#[test]
fn functions_call_themselves_and_each_other_wherever_they_stand() {
    let program = r"def program():
  def even(n):
    if n == 0:
      return True
    end
    return odd(n - 1)
  end
  def odd(n):
    if n == 0:
      return False
    end
    return even(n - 1)
  end
  def fact(n):
    if n < 2:
      return 1
    end
    return n * fact(n - 1)
  end
  textmsg(even(10), odd(10))
  textmsg(fact(10))
end
";
    assert_eq!(content(program), ["TrueFalse", "3628800"]);
}

#[test]
fn a_function_without_return_gives_none() {
    assert_eq!(content("def f():\n  x = 1\nend\ntextmsg(f())"), ["None"]);
}

/// The examples of the script manual's page on scoping rules, in its order.
#[test]
fn variables_have_the_scopes_that_the_manual_gives_them() {
    let local = r#"def program():
  global a = 0
  def f():
    local a = 1
    textmsg(a)
  end
  f()
  textmsg(a)
end
"#;
    assert_eq!(content(local), ["1", "0"]);
    let free = "def program():\n  global a = 0\n  def f():\n    a = 1\n  end\n  f()\n  textmsg(a)\nend";
    assert_eq!(content(free), ["1"]);
    let nested = r#"def program():
  global a = 0
  def f():
    local a = 1
    def g():
      a = 2
    end
    g()
    textmsg(a)
  end
  f()
  textmsg(a)
end
"#;
    assert_eq!(content(nested), ["1", "2"]);
    for first in ["a = 0", "local a = 0", "if True:\n    a = 0\n  end"] {
        let text =
            format!("def program():\n  {first}\n  def f():\n    a = 1\n  end\n  f()\n  textmsg(a)\nend");
        assert_eq!(content(&text), ["1"], "{first}");
    }
}

#[test]
fn a_global_may_be_made_in_a_function_and_a_parameter_masks_one() {
    let program = r#"def program():
  def f():
    global made = 3
    own = 4
  end
  def g(made):
    made = 100
  end
  f()
  g(3)
  textmsg(made)
end
"#;
    assert_eq!(content(program), ["3"]);
}

#[test]
fn locals_of_a_call_are_its_own() {
    let program = r"def f(n):
  local mine = n
  if n > 0:
    f(n - 1)
  end
  textmsg(mine)
end
f(2)";
    assert_eq!(content(program), ["0", "1", "2"]);
}

#[test]
fn text_is_laid_out_freely() {
    let program = "  # a comment\n\n$ 1 \"Robot Program\"\n\ttextmsg(\"a # b\", # not the end\n\t\t1,\n   \
                   2)\r\n\
                   x = 1 +\n  2\nif (x == 3 or\n    False):\n textmsg('x')\nend";
    assert_eq!(content(program), ["a # b12", "x"]);
}

/// Newlines separate less than they seem to: `ur_rtde` sends such a program.
#[test]
fn a_value_may_stand_below_its_variable_and_a_statement_beside_another() {
    let program = r#"def program():
  global a = # a comment
1  global b = # another
2  c = a + b  textmsg(c)
  if c == 3: textmsg("three") end
end
"#;
    assert_eq!(content(program), ["3", "three"]);
}

#[test]
fn halt_ends_the_program_wherever_it_stands() {
    assert_eq!(
        content(
            r"def f():
  halt
end
textmsg(1)
f()
textmsg(2)"
        ),
        ["1"]
    );
}

#[test]
fn named_arguments_reach_the_machine_with_their_names() {
    let program = "servoj([0, 0, 0, 0, 0, 0], t=0.002, lookahead_time=0.1, gain=300)";
    assert_eq!(content(program), ["servoj [0, 0, 0, 0, 0, 0] t=0.002 lookahead_time=0.1 gain=300"]);
}

#[test]
fn the_defaults_of_motions_have_values() {
    assert_eq!(value("[a_joint_default, v_tool_default]"), "[1.4, 0.25]");
}

#[test]
fn none_is_a_value_and_what_a_function_without_a_value_gives() {
    let program = r"def nothing():
  return None
end
def bare():
  return
end
def given(x=None):
  if x == None:
    return 1
  end
  return x
end
x = None
textmsg(x, nothing() == None, bare() == x, given(), given(5))
textmsg([1, None], None != 0)
x = 3
textmsg(x == None)
";
    assert_eq!(
        content(&program.replace("textmsg(x, ", "textmsg(")),
        ["TrueTrue15", "[1, None]True", "False"]
    );
    assert_eq!(value("None"), "None");
    let (line, _, message) = crate::machine::error("None = 3");
    assert!(line == 1 && message.contains("can be assigned"), "{message}");
    let (_, _, message) = crate::machine::error("if None:\n  sync()\nend");
    assert!(message.contains("a truth value wanted"), "{message}");
}

#[test]
fn pause_is_a_statement_that_may_be_written_like_a_call() {
    assert_eq!(content("pause\ntextmsg(\"on\")"), ["on"]);
    assert_eq!(content("if True:\n  pause()\nend\ntextmsg(\"on\")"), ["on"]);
    let (_, _, message) = crate::machine::error("x = pause");
    assert!(message.contains("a value wanted"), "{message}");
}
