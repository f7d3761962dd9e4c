//! Nothing that a script does takes more time or memory than it may.

use crate::machine::{Recorder, error};
use foretrace_ur_sim::script::{Program, Progress};

#[track_caller]
fn refused(text: &str, part: &str) {
    let error = Program::parse(text).expect_err(part);
    assert!(error.message.contains(part), "{error}");
}

#[track_caller]
fn fails(text: &str, part: &str) {
    let (_, _, message) = error(text);
    assert!(message.contains(part), "{message}");
}

#[test]
fn a_loop_that_never_waits_is_an_error_but_a_long_calculation_is_not() {
    let text = "i = 0\nwhile i < 20000:\n  i = i + 1\nend\ntextmsg(i)";
    let mut machine = Recorder::default();
    assert_eq!(machine.run(text, 90), Progress::Finished);
    assert_eq!(machine.content(), ["20000"]);
    assert!(machine.cycle > 5, "it took {} cycles", machine.cycle);
    assert_eq!(error("while True:\nend").2, "an infinite loop: it neither moves nor calls sync or sleep");
}

#[test]
fn other_threads_go_on_beside_one_that_never_waits() {
    let text = r#"def p():
  thread t():
    while True:
    end
  end
  run t()
  n = 0
  while n < 50:
    n = n + 1
    sync()
  end
  textmsg("done")
end"#;
    let mut machine = Recorder::default();
    assert_eq!(machine.run(text, 60), Progress::Finished);
    assert_eq!(machine.cycle, 51);
}

#[test]
fn texts_and_their_depth_are_bounded() {
    refused(&" ".repeat((1 << 20) + 1), "longer than");
    refused(&format!("x = {}1{}", "(".repeat(10_000), ")".repeat(10_000)), "deeper than");
    refused(&format!("x = {}1", "-".repeat(10_000)), "deeper than");
    refused(&format!("x = {}True", "not ".repeat(10_000)), "deeper than");
    refused(&format!("x = 1{}", " + 1".repeat(10_000)), "deeper than");
    refused(&format!("x = [1]\ny = x{}", "[0]".repeat(10_000)), "deeper than");
    refused(&"if True:\n".repeat(10_000), "deeper than");
    refused(&"def f():\n".repeat(10_000), "deeper than");
    refused(&format!("x = [{}]", "1,".repeat(2000)), "more than 1024 elements");
    refused(&format!("f({})", "1,".repeat(100)), "more than 64 arguments");
    refused(&(0..3000).map(|n| format!("x{n} = 1\n")).collect::<String>(), "more than 2048 variables");
    refused(
        &(0..5000).map(|n| format!("def f{n}():\nend\n")).collect::<String>(),
        "more than 4096 functions",
    );
}

#[test]
fn depths_that_programs_have_are_allowed() {
    let nested = format!("{}sync()\n{}", "if True:\n".repeat(40), "end\n".repeat(40));
    assert!(Program::parse(&nested).is_ok());
    assert!(Program::parse(&format!("x = {}1{}", "(".repeat(90), ")".repeat(90))).is_ok());
    assert!(Program::parse(&format!("x = 1{}", " + 1".repeat(90))).is_ok());
    let arms: String = (0..500).map(|n| format!("elif x == {n}:\n  x = 1\n")).collect();
    assert!(Program::parse(&format!("x = 0\nif x == 1:\n  x = 2\n{arms}end\n")).is_ok());
}

#[test]
fn calls_and_threads_are_bounded() {
    fails("def f(n):\n  return f(n + 1)\nend\nf(0)", "calls are deeper than 100");
    fails(
        r"def p():
  thread t():
    sync()
  end
  while True:
    run t()
  end
end",
        "more than 32 threads",
    );
    // One after the other there may be many.
    let text = r"def p():
  thread t():
    sync()
  end
  n = 0
  while n < 200:
    h = run t()
    join h
    n = n + 1
  end
end";
    assert_eq!(Recorder::default().run(text, 300), Progress::Finished);
}

#[test]
fn values_are_bounded() {
    fails("s = \"0123456789\"\nwhile True:\n  s = str_cat(s, s)\nend", "longer than 1023 bytes");
    fails("l = make_list(4096, 0)\nl = [l, l]", "at most 4096 elements");
    fails("l = make_list(5000, 0)", "0 to 4096 elements");
    fails("l = make_list(-1, 0)", "0 to 4096 elements");
    fails("l = [1]\nwhile True:\n  l = [l]\nend", "at most 4 deep");
    fails("l = [1]\nl[0] = [[[[1]]]]", "at most 4 deep");
    let tall = "m = transpose([make_list(2000, 1)])\nw = transpose(m)\n";
    fails(&format!("{tall}x = m * w"), "a matrix has at most 4096 elements");
    // Many variables, each as large as it may be: 50 calls, 12 variables, 4096 elements.
    let body: String = (0..12).map(|n| format!("  local v{n} = make_list(4096, {n})\n")).collect();
    fails(&format!("def f(n):\n{body}  return f(n + 1)\nend\nf(0)"), "too large");
    let body: String = (0..200).map(|n| format!("  local v{n} = 0\n")).collect();
    fails(&format!("def f(n):\n{body}  return f(n + 1)\nend\nf(0)"), "variables in all calls");
    // Elements of calls that wait for others.
    let row = "1,".repeat(1000);
    let stacked = format!("def f(n):\n  return [{row} f(n + 1)]\nend\nf(0)");
    fails(&stacked, "values in open expressions");
}

#[test]
fn numbers_end_where_floats_end() {
    let (_, _, message) = error("x = 1e308 * 10\ntextmsg(x)\ny = x - x\nz = sqrt(y)");
    assert_eq!(message, "sqrt has no value there");
    let mut machine = Recorder::default();
    assert_eq!(
        machine.run("textmsg(1e308 * 10)\ntextmsg(99999999999)\ntextmsg(-(-2147483647 - 1))", 1),
        Progress::Finished
    );
    assert_eq!(machine.content(), ["inf", "99999999999.0", "2147483648.0"]);
}

/// What is made within a cycle is paid for, so that large values make fewer instructions, not longer cycles.
#[test]
fn large_values_cost_instructions() {
    let rounds = |length: u32| {
        let text = format!(
            r"l = make_list({length}, 1)
k = l
global n = 0
while True:
  k = l + l
  n = n + 1
  write(0, n)
end"
        );
        let mut machine = Recorder::default();
        assert_eq!(machine.run(&text, 10), Progress::Running);
        machine.registers[&0].as_integer().unwrap()
    };
    let (small, large) = (rounds(1), rounds(4096));
    assert!(large * 50 < small, "{large} rounds of 4096 elements, {small} of one");
}

#[test]
fn a_product_of_matrices_is_bounded_as_it_cannot_be_interrupted() {
    let square = |n: u32| format!("a = make_list({n}, make_list({n}, 1.5))\nb = a * a\ntextmsg(b[0, 0])");
    let mut machine = Recorder::default();
    assert_eq!(machine.run(&square(32), 20), Progress::Finished);
    assert_eq!(machine.content(), ["72.0"]);
    fails(&square(33), "a product of matrices takes at most 32768 multiplications");
}
