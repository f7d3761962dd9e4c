//! Threads: how they share a cycle, and how they end.

use crate::machine::{Recorder, content};
use foretrace_ur_sim::script::{Program, Progress, ScriptRun, ThreadId, Value};

/// One thread servos, the other watches a register: the loop that streaming clients are made of.
#[test]
fn a_servo_thread_and_a_watching_one_share_every_cycle() {
    let text = "def program():
  global target = [0, 0, 0, 0, 0, 0]
  global go = True
  thread servo():
    while go:
      servoj(target, t=0.002)
    end
    textmsg(\"servo ends\")
  end
  mover = run servo()
  while go:
    command = read(0)
    if command == 99:
      go = False
    else:
      target[0] = command
    end
    sync()
  end
  join mover
  textmsg(\"done\")
end
";
    let mut machine = Recorder::default();
    let program = Program::parse(text).unwrap();
    let mut run = ScriptRun::new(&program, &machine).unwrap();
    for cycle in 1..=5 {
        machine.cycle = cycle;
        machine
            .registers
            .insert(0, Value::Integer(if cycle == 5 { 99 } else { i32::try_from(cycle).unwrap() }));
        let progress = run.cycle(&mut machine);
        assert!(progress == Progress::Running, "{progress:?} in cycle {cycle}");
    }
    // The command read in a cycle is the target of the same cycle.
    let servo: Vec<_> =
        machine.calls.iter().filter(|call| call.1 == 1).map(|call| (call.0, call.2.clone())).collect();
    let expected = |cycle: u32| (cycle, format!("servoj [{cycle}, 0, 0, 0, 0, 0] t=0.002"));
    let mut wanted: Vec<_> = (1..5).map(expected).collect();
    wanted.push((5, "servo ends".to_owned()));
    assert_eq!(servo, wanted);
    machine.cycle = 6;
    assert_eq!(run.cycle(&mut machine), Progress::Finished);
    assert_eq!(machine.content().last(), Some(&"done"));
    assert_eq!(machine.ended, [1, 0]);
}

#[test]
fn a_waiting_call_is_asked_again_until_it_is_done() {
    let mut machine = Recorder::default();
    assert_eq!(machine.run("movej(3)\ntextmsg(\"there\")", 10), Progress::Finished);
    assert_eq!(machine.calls, [(4, 0, "movej 3".to_owned()), (4, 0, "there".to_owned())]);
}

#[test]
fn a_cycle_is_used_up_by_sync_and_by_nothing_less() {
    let mut machine = Recorder::default();
    let text = r"i = 0
while i < 3:
  textmsg(i)
  textmsg(i)
  sync()
  i = i + 1
end";
    assert_eq!(machine.run(text, 10), Progress::Finished);
    let cycles: Vec<u32> =
        machine.calls.iter().filter(|call| !call.2.starts_with("sync")).map(|call| call.0).collect();
    assert_eq!(cycles, [1, 1, 2, 2, 3, 3]);
    assert_eq!(machine.cycle, 4);
}

#[test]
fn a_killed_thread_does_nothing_more() {
    let text = r#"def program():
  thread t():
    while True:
      textmsg("t")
      movej(2)
    end
  end
  h = run t()
  sync()
  sync()
  kill h
  textmsg("killed")
  sync()
  sync()
  kill h
  join h
  textmsg(h != 0)
end
"#;
    let mut machine = Recorder::default();
    assert_eq!(machine.run(text, 20), Progress::Finished);
    assert_eq!(machine.content(), ["sync", "t", "sync", "killed", "sync", "sync", "True"]);
    assert_eq!(machine.ended, [1, 0]);
}

#[test]
fn a_thread_may_kill_itself() {
    let text = r#"def program():
  global h = 0
  thread t():
    sync()
    kill h
    textmsg("wrong")
  end
  h = run t()
  join h
  textmsg("gone")
end
"#;
    assert_eq!(content(text), ["sync", "gone"]);
}

#[test]
fn join_waits_for_the_end_and_goes_on_in_the_same_cycle() {
    let text = r#"def program():
  thread t():
    movej(2)
    textmsg("t ends")
  end
  h = run t()
  join h
  textmsg("joined")
  join 0
  kill 0
end
"#;
    let mut machine = Recorder::default();
    assert_eq!(machine.run(text, 20), Progress::Finished);
    let told: Vec<_> = machine.calls.iter().map(|call| (call.0, call.2.as_str())).collect();
    assert_eq!(told, [(3, "movej 2"), (3, "t ends"), (3, "joined")]);
}

#[test]
fn the_end_of_the_program_ends_its_threads() {
    let text = r"def program():
  thread t():
    while True:
      sync()
    end
  end
  run t()
  run t()
  sync()
end
";
    let mut machine = Recorder::default();
    assert_eq!(machine.run(text, 20), Progress::Finished);
    machine.ended.sort_unstable();
    assert_eq!(machine.ended, [0, 1, 2]);
}

#[test]
fn halt_in_a_thread_ends_the_program() {
    let text = r"def program():
  thread t():
    sync()
    halt
  end
  run t()
  while True:
    sync()
  end
end";
    let mut machine = Recorder::default();
    assert_eq!(machine.run(text, 20), Progress::Finished);
    assert_eq!(machine.cycle, 2);
}

#[test]
fn threads_have_variables_of_their_own_and_see_those_of_the_program() {
    let text = r#"def program():
  base = 10
  thread t():
    local mine = base
    own = 2 * base
    base = base + 1
    sync()
    textmsg(mine, own)
  end
  a = run t()
  b = run t()
  base = 20
  join a
  join b
end
"#;
    let told: Vec<String> = content(text).into_iter().filter(|told| told != "sync").collect();
    // Both started after the program had gone on to its first `join`.
    assert_eq!(told, ["2040", "2142"]);
}

#[test]
fn a_killed_thread_s_children_are_killed_with_it() {
    let text = r#"def program():
  thread parent():
    thread child():
      thread grandchild():
        while True:
          sync()
        end
      end
      run grandchild()
      movej(9)
    end
    run child()
    run child()
    movej(9)
  end
  thread other():
    movej(1)
    textmsg("other")
  end
  o = run other()
  h = run parent()
  sync()
  kill h
  join o
end
"#;
    let mut machine = Recorder::default();
    assert_eq!(machine.run(text, 20), Progress::Finished);
    assert_eq!(machine.content().last(), Some(&"other"));
    // The parent, its children and their children, long before the program's end.
    let mut killed = machine.ended[..5].to_vec();
    killed.sort_unstable();
    assert_eq!(killed, [2, 3, 4, 5, 6]);
    assert_eq!(machine.ended[5..], [1, 0]);
}

#[test]
fn a_critical_section_is_not_interrupted_by_the_end_of_a_thread_s_time() {
    // 3000 rounds are more instructions than a cycle has; the other thread must not see `n` between.
    let section = |enter: &str, exit: &str| {
        format!(
            r#"def program():
  global n = 0
  thread t():
    while True:
      textmsg(n)
      sync()
    end
  end
  run t()
  {enter}
  while n < 3000:
    n = n + 1
  end
  {exit}
  sync()
  textmsg("end")
end
"#
        )
    };
    let told = content(&section("enter_critical", "exit_critical"));
    assert!(told.iter().all(|told| ["3000", "sync", "end"].contains(&told.as_str())), "{told:?}");
    let told = content(&section("pass", "pass"));
    assert!(told.iter().any(|told| !["3000", "sync", "end"].contains(&told.as_str())), "{told:?}");
}

#[test]
fn a_critical_section_that_waits_lets_others_run_meanwhile() {
    let text = r#"def program():
  thread t():
    enter_critical
    movej(5)
    exit_critical
  end
  h = run t()
  sync()
  enter_critical
  textmsg("in")
  exit_critical
  join h
end
"#;
    let mut machine = Recorder::default();
    assert_eq!(machine.run(text, 20), Progress::Finished);
    assert_eq!(machine.content(), ["sync", "in", "movej 5"]);
}

#[test]
fn a_secondary_program_is_done_within_a_cycle_or_fails() {
    let mut machine = Recorder::default();
    assert!(Program::parse("sec s():\n  write(1, 5)\nend").unwrap().is_secondary());
    assert!(!Program::parse("def s():\n  write(1, 5)\nend").unwrap().is_secondary());
    assert_eq!(machine.run("sec s():\n  write(1, 5)\nend", 2), Progress::Finished);
    // Its end is not that of the program's own thread.
    assert_eq!(machine.ended, [ThreadId::SECONDARY.number()]);
    assert_eq!(machine.registers[&1], Value::Integer(5));
    let (line, _, message) = crate::machine::error("sec s():\n  write(1, 5)\n  sync()\n  write(1, 6)\nend");
    assert_eq!((line, message.as_str()), (3, "a secondary program must be done within a cycle"));
}

#[test]
fn a_run_may_go_to_another_operating_system_thread() {
    fn goes<T: Send>(_: &T) {}
    let program = Program::parse("sync()").unwrap();
    goes(&program);
    goes(&ScriptRun::new(&program, &Recorder::default()).unwrap());
}

#[test]
fn stopping_from_outside_tells_the_machine_and_stays() {
    let mut machine = Recorder::default();
    let program = Program::parse(
        r"def p():
  thread t():
    movej(9)
  end
  run t()
  movej(9)
end",
    )
    .unwrap();
    let mut run = ScriptRun::new(&program, &machine).unwrap();
    assert_eq!(run.cycle(&mut machine), Progress::Running);
    assert_eq!((run.threads(), run.line()), (2, 6));
    run.stop(&mut machine);
    assert_eq!(machine.ended, [0, 1]);
    assert_eq!((run.cycle(&mut machine), run.line(), run.threads()), (Progress::Finished, 0, 0));
}
