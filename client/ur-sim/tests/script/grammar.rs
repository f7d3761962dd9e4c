//! Programs made by chance that keep to the grammar: they are read, and then run into whatever they run into.

use crate::machine::Recorder;
use foretrace_ur_sim::script::{Program, Progress, ScriptRun};
use proptest::prelude::*;
use std::fmt::Write as _;

/// Writes a program; every choice takes a byte, and when they are used up the choice is always the first,
/// which ends.
struct Writer<'a> {
    bytes: std::slice::Iter<'a, u8>,
    text: String,
}

impl Writer<'_> {
    fn choose(&mut self, count: u8) -> u8 {
        self.bytes.next().map_or(0, |byte| byte % count)
    }

    fn name(&mut self) -> &'static str {
        ["a", "b", "c", "x"][usize::from(self.choose(4))]
    }

    fn expression(&mut self, depth: u8) -> String {
        if depth == 0 {
            return "1".to_owned();
        }
        let deeper = depth - 1;
        match self.choose(16) {
            0 => self.choose(5).to_string(),
            1 => ["0.5", "1e308", "-1", "2147483647", "1e-300"][usize::from(self.choose(5))].to_owned(),
            2 => "\"text\"".to_owned(),
            3 => format!("{} < 3", self.expression(deeper)),
            4 | 5 => self.name().to_owned(),
            6 | 7 => {
                let operator = ["+", "-", "*", "/", "%", "==", "!=", "and", "or", "xor", ">="];
                let operator = operator[usize::from(self.choose(11))];
                format!("({} {operator} {})", self.expression(deeper), self.expression(deeper))
            }
            8 => format!("[{}, {}, 3]", self.expression(deeper), self.expression(deeper)),
            9 => format!("p[{}, 0, 0, 0, 0, {}]", self.expression(deeper), self.expression(deeper)),
            10 => format!("{}[{}]", self.name(), self.expression(deeper)),
            11 => format!("f({}, y={})", self.expression(deeper), self.expression(deeper)),
            12 => format!("str_cat({}, {})", self.expression(deeper), self.expression(deeper)),
            13 => format!("make_list({}, {})", self.expression(deeper), self.expression(deeper)),
            14 => format!("pose_trans({}, {})", self.expression(deeper), self.expression(deeper)),
            _ => "run t()".to_owned(),
        }
    }

    fn block(&mut self, depth: u8) {
        for _ in 0..=self.choose(4) {
            self.statement(depth);
        }
    }

    fn statement(&mut self, depth: u8) {
        let choice = if depth == 0 { self.choose(9) } else { self.choose(14) };
        let line = match choice {
            0 => "sync()".to_owned(),
            1..=3 => format!("{} = {}", self.name(), self.expression(3)),
            4 => format!("{}[{}] = {}", self.name(), self.expression(1), self.expression(2)),
            5 => format!("textmsg({}, {})", self.name(), self.expression(2)),
            6 => format!("servoj({}, t={})", self.expression(2), self.expression(1)),
            7 => ["enter_critical", "exit_critical", "kill h", "join h", "h = run t()", "halt", "return a"]
                [usize::from(self.choose(7))]
            .to_owned(),
            8 => format!("movej({})", self.expression(1)),
            9..=11 => {
                let condition = self.expression(2);
                let _ = writeln!(self.text, "if {condition} == 1:");
                self.block(depth - 1);
                let _ = writeln!(self.text, "else:");
                self.block(depth - 1);
                "end".to_owned()
            }
            _ => {
                let condition = self.expression(2);
                let _ = writeln!(self.text, "while {condition} != 1:");
                self.block(depth - 1);
                if self.choose(2) == 1 {
                    self.text += "break\n";
                }
                "end".to_owned()
            }
        };
        let _ = writeln!(self.text, "{line}");
    }
}

fn program(bytes: &[u8]) -> String {
    let mut writer = Writer { bytes: bytes.iter(), text: "def program():\n".to_owned() };
    writer.text += "global a = 1\nb = [1, 2, 3]\nglobal c = p[0, 0, 0, 0, 0, 1]\nx = 2\nglobal h = 0\n";
    for head in ["def f(x, y=2):\n", "thread t():\nlocal a = 0\n"] {
        writer.text += head;
        writer.block(2);
        writer.text += "end\n";
    }
    writer.block(3);
    writer.block(3);
    writer.text += "end\n";
    writer.text
}

proptest! {
    #![proptest_config(crate::fuzz::cases(256))]

    #[test]
    fn grammatical_programs_are_read_and_run(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let text = program(&bytes);
        let program = Program::parse(&text);
        prop_assert!(program.is_ok(), "{:?}\n{text}", program);
        let mut machine = Recorder::default();
        let mut run = ScriptRun::new(&program.unwrap(), &machine).unwrap();
        for _ in 0..20 {
            let progress = run.cycle(&mut machine);
            prop_assert!(run.threads() <= 32);
            if let Progress::Failed(error) = &progress {
                let line = usize::try_from(error.at.line).unwrap();
                prop_assert!((1..=text.lines().count() + 1).contains(&line), "{error}\n{text}");
                prop_assert!(!error.message.contains("lost count"), "{error}\n{text}");
            }
            if progress != Progress::Running {
                prop_assert_eq!(run.cycle(&mut machine), progress);
                break;
            }
        }
        run.stop(&mut machine);
        prop_assert_eq!(run.threads(), 0);
        // Each thread's end is told once.
        let mut ended = machine.ended.clone();
        ended.sort_unstable();
        ended.dedup();
        prop_assert_eq!(ended.len(), machine.ended.len());
        prop_assert!(machine.ended.contains(&0));
    }
}
