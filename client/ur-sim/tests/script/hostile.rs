//! Scripts that nobody would write: whatever comes, there is an answer, and it comes soon.

use crate::machine::Recorder;
use foretrace_ur_sim::script::{Program, Progress, ScriptRun};
use proptest::prelude::*;

/// Reads a text and, if it is a program, runs it for some cycles.
fn survive(text: &str) {
    if let Ok(program) = Program::parse(text) {
        let mut machine = Recorder::default();
        if let Ok(mut run) = ScriptRun::new(&program, &machine) {
            for _ in 0..5 {
                if run.cycle(&mut machine) != Progress::Running {
                    break;
                }
            }
            assert!(run.threads() <= 32);
            run.stop(&mut machine);
            assert_eq!(run.threads(), 0);
        }
    }
}

/// Words of the language, so that more than the first line is read.
const WORDS: [&str; 58] = [
    "def f():\n",
    "def f(a, b=1):\n",
    "thread t():\n",
    "sec s():\n",
    "end\n",
    "if ",
    "elif ",
    "else:\n",
    "while ",
    ":\n",
    "break\n",
    "continue\n",
    "return ",
    "global ",
    "local ",
    "run t()",
    "kill ",
    "join ",
    "halt\n",
    "pass\n",
    " and ",
    " or ",
    " xor ",
    "not ",
    "True",
    "False",
    "enter_critical\n",
    "exit_critical\n",
    "a",
    "b",
    "f",
    "h = ",
    "a = ",
    "=",
    "==",
    "<",
    "+",
    "-",
    "*",
    "/",
    "%",
    "(",
    ")",
    "[",
    "]",
    "p[",
    ",",
    "0",
    "1",
    "2147483647",
    "1e308",
    "\"s\"",
    "\n",
    "sync()\n",
    "f()",
    "make_list(4096, a)",
    "a[0] = ",
    "textmsg(a)\n",
];

/// A program that has most of the language in it, for mutants.
const WHOLE: &str = "def program():
  global a = [1, 2.5, \"x\"]
  local m = [[1, 0], [0, 1]]
  def f(x, y=2):
    if x > y and not (x == 3):
      return x % y
    elif x < 0 or y >= 1e3:
      return -x / y
    else:
      return pose_trans(p[x, 0, 0, 0, 0, 1], p[0, y, 0, 0, 0, 0])
    end
  end
  thread t():
    n = 0
    while True:
      enter_critical
      a[0] = n
      exit_critical
      n = n + 1
      servoj(f(n, y=3), t=0.002)
      if n > 100:
        break
      end
    end
  end
  h = run t()
  i = 0
  while i < 50:
    i = i + 1
    m[0, 1] = to_str(str_cat(a, i))
    if read(i) == 99:
      continue
    end
    sync()
  end
  join h
  kill h
  halt
end
";

#[test]
fn the_whole_program_is_one() {
    assert_eq!(Recorder::default().run(WHOLE, 200), Progress::Finished);
}

#[test]
fn every_beginning_of_a_program_is_answered() {
    for end in 0..=WHOLE.len() {
        survive(&WHOLE[..end]);
    }
}

/// A position in the program, how much goes there, and the word that comes instead.
fn change() -> impl Strategy<Value = (usize, usize, &'static str)> {
    (0..WHOLE.len(), 0_usize..12, prop::sample::select(&WORDS[..]))
}

proptest! {
    #![proptest_config(crate::fuzz::cases(256))]

    #[test]
    fn random_texts_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        survive(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn random_words_are_answered(words in prop::collection::vec(prop::sample::select(&WORDS[..]), 0..80)) {
        survive(&words.concat());
    }

    #[test]
    fn mutants_of_a_program_are_answered(changes in prop::collection::vec(change(), 1..5)) {
        let mut text = WHOLE.to_owned();
        for (at, length, word) in changes {
            let start = at.min(text.len());
            let end = (start + length).min(text.len());
            text.replace_range(start..end, word);
        }
        survive(&text);
    }

    /// Whole lines keep their position in the grammar, so these mutants run further.
    #[test]
    fn shuffled_lines_are_answered(moves in prop::collection::vec((0_usize..40, 0_usize..40), 1..6)) {
        let mut lines: Vec<&str> = WHOLE.lines().collect();
        for (from, to) in moves {
            let line = lines.remove(from % lines.len());
            lines.insert(to % (lines.len() + 1), line);
        }
        survive(&lines.join("\n"));
    }
}
