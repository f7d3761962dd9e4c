//! Errors: what is refused when a program is read, when it is loaded and when it runs, with positions.

use crate::machine::{Recorder, content, error};
use foretrace_ur_sim::script::{Program, ScriptRun};

#[track_caller]
fn refused(text: &str, line: u32, column: u32, message: &str) {
    let error = Program::parse(text).expect_err(text);
    assert_eq!((error.at.line, error.at.column, error.message.as_str()), (line, column, message), "{text}");
}

#[track_caller]
fn fails(text: &str, line: u32, column: u32, message: &str) {
    assert_eq!(error(text), (line, column, message.to_owned()), "{text}");
}

#[test]
fn what_is_no_urscript_is_refused_with_its_place() {
    refused("x = 1 +", 1, 8, "a value wanted, found the end of the program");
    refused("textmsg(\"a\"\nx = 2\n", 1, 8, "this bracket is not closed");
    refused("x = 1)\n", 1, 6, "this bracket closes nothing");
    refused("if True\n  x = 1\nend", 1, 8, "`:` wanted, found the end of the line");
    refused("\nwhile True:\n  sync()\n", 4, 1, "the block that begins in line 2 has no `end`");
    refused("def f():\n  x = 1\nend\nend\n", 4, 1, "`end` without a block that it belongs to, found `end`");
    refused("while True:\n  x = 1\nelse:\nend", 3, 1, "`else` without an `if` before it, found `else`");
    refused("x = 3 4\n", 1, 7, "the end of the line wanted, found `4`");
    refused("x = \"abc\n", 1, 5, "this string is not closed on its line");
    refused("x = 12abc", 1, 5, "12abc is no number");
    refused("x = 1.2.3", 1, 5, "1.2.3 is no number");
    refused("x = ?", 1, 5, "the character '?' means nothing here");
    refused("1 + 2 = 3", 1, 7, "only a variable or an element of one can be assigned to, found `=`");
    refused("global end = 3", 1, 8, "a name wanted, found `end`");
    refused("x = p[1, 2, 3]", 1, 5, "a pose has 6 numbers, not 3");
    refused("break", 1, 1, "`break` outside a loop");
    refused("def f(a, a):\nend", 1, 10, "parameter a stands there twice");
    refused("def f(a=1, b):\nend", 1, 12, "a parameter without a default stands after one with a default");
    refused("f(a=1, 2)", 1, 8, "an argument without a name stands after one with a name");
}

#[test]
fn what_means_nothing_is_refused_with_its_place() {
    refused("x = 1\ny = x + z\n", 2, 9, "the variable z is not defined");
    refused("z[1] = 2", 1, 1, "the variable z is not defined");
    let inside = "def p():\n  def f():\n    local x = 1\n    def g():\n      return x\n    end\n  end\nend";
    refused(inside, 5, 14, "the variable x is not defined");
    refused("def f(a):\n  return a\nend\nf()\n", 4, 1, "f wants an argument for a");
    refused("def f(a):\nend\nf(1, 2)\n", 3, 1, "f takes 1 arguments, not 2");
    refused("def f(a):\nend\nf(b=2)\n", 3, 1, "f has no parameter b");
    refused("def f(a):\nend\nf(1, a=2)\n", 3, 1, "f gets its parameter a twice");
    refused("def f():\nend\ndef f():\nend\n", 3, 1, "f is defined twice");
    refused("thread t():\nend\nt()", 3, 1, "t is a thread: `run t()` starts it");
    refused("x = run t()", 1, 5, "there is no thread t");
    refused("thread t(a):\nend", 1, 1, "a thread has no parameters");
    refused("def p(a):\nend", 1, 1, "a program has no parameters, but this one has a");
    refused("def p():\n  sec s():\n  end\nend", 2, 3, "a secondary program stands alone, in no other");
}

#[test]
fn a_function_that_nobody_has_is_refused_when_the_program_is_loaded() {
    let program = Program::parse(
        r"def p():
  if False:
    fly_away(1)
  end
end
",
    )
    .unwrap();
    let wanted: Vec<_> =
        program.wanted().map(|(name, position)| (name, position.line, position.column)).collect();
    assert_eq!(wanted, [("fly_away", 3, 5)]);
    let error = ScriptRun::new(&program, &Recorder::default()).expect_err("fly_away is not there");
    assert_eq!(error.to_string(), "line 3, column 5: there is no function fly_away");
}

#[test]
fn what_goes_wrong_ends_the_program_with_its_place() {
    fails("x = 0\ny = 1 / x\n", 2, 7, "division by zero");
    fails("x = 1 % 0", 1, 7, "division by zero");
    fails("x = [1, 2]\ny = x[2]\n", 2, 6, "index 2 is outside the 2 elements");
    fails("x = [1, 2]\nx[-1] = 3\n", 2, 1, "index -1 is outside the 2 elements");
    fails("x = 1\ny = x[0]", 2, 6, "an integer has no elements");
    fails("if 1:\nend", 1, 4, "a truth value wanted, not an integer");
    fails("x = True and 1", 1, 10, "a truth value wanted, not an integer");
    fails("x = \"a\" + 1", 1, 9, "a string cannot be calculated with an integer");
    fails("x = [1] + [1, 2]", 1, 9, "a list of 1 and one of 2 do not match");
    fails("x = [[1, 2]] * [[1, 2]]", 1, 14, "a row of 2 and a column of 1 do not match");
    fails("x = [[1, 2], 3] * [1, 2]", 1, 17, "a matrix has rows only");
    fails("x = [[1, 1]] * [[1, 2], [3]]", 1, 14, "rows of one length wanted");
    fails("x = \"a\" < \"b\"", 1, 9, "a string and a string have no order");
    fails("x = p[1, 2, 3, 4, 5, \"6\"]", 1, 5, "a pose has six numbers");
    fails("local x\ntextmsg(x)", 2, 9, "the variable x has no value yet");
    fails("kill \"x\"", 1, 6, "a thread wanted, not a string");
    fails("read(\"x\")", 1, 1, "read: no register");
}

#[test]
fn an_error_in_a_thread_ends_the_program() {
    let text = r"def p():
  thread t():
    sync()
    x = 1 / 0
  end
  run t()
  while True:
    sync()
  end
end";
    fails(text, 4, 11, "division by zero");
}

#[test]
fn columns_count_letters_and_lines_count_from_one() {
    refused("# Größe µ\n  x = \"é\" $\n", 2, 11, "the character '$' means nothing here");
    assert_eq!(content("textmsg(\"Größe µ\")"), ["Größe µ"]);
}
