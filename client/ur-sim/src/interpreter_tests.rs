//! Claims about interpreter mode: what is answered, what runs, what is forgotten.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::*;
use foretrace_ur::primary::MessageContent;

/// A controller, a client of port 30020, and the texts that programs say.
struct Scene {
    controller: Controller,
    line: TcpStream,
    said: TcpStream,
}

impl Scene {
    fn new(program: &str) -> Self {
        let controller = Controller::start(ControllerOptions {
            ephemeral_ports: true,
            ..ControllerOptions::new(Series::E)
        })
        .unwrap();
        let open = |service| {
            let stream = TcpStream::connect(controller.address(service).unwrap()).unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
            stream
        };
        let (line, said) = (open(Service::Interpreter), open(Service::Primary));
        let mut script = open(Service::Secondary);
        script.write_all(program.as_bytes()).unwrap();
        let scene = Self { controller, line, said };
        scene.until(r#""runtime_state":2"#);
        std::thread::sleep(Duration::from_millis(100));
        scene
    }

    fn until(&self, state: &str) {
        let end = Instant::now() + Duration::from_secs(10);
        while !self.controller.status().contains(state) {
            assert!(Instant::now() < end, "never {state}: {}", self.controller.status());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn answer(&mut self) -> String {
        let (mut line, mut byte) = (Vec::new(), [0]);
        while self.line.read(&mut byte).unwrap() == 1 && byte != *b"\n" {
            line.push(byte[0]);
        }
        String::from_utf8(line).unwrap()
    }

    fn ask(&mut self, line: &str) -> String {
        self.line.write_all(format!("{line}\n").as_bytes()).unwrap();
        self.answer()
    }

    /// Waits until a program has said `text`; all texts until then.
    fn until_said(&mut self, text: &str) -> Vec<String> {
        let (mut bytes, mut buffer, mut said) = (Vec::new(), [0; 4096], Vec::new());
        loop {
            let count = self.said.read(&mut buffer).unwrap();
            assert!(count > 0, "never said {text}");
            bytes.extend_from_slice(&buffer[..count]);
            let mut rest = &bytes[..];
            while let Ok(Some(package)) = foretrace_ur::primary::PrimaryPackage::take(&mut rest) {
                if let foretrace_ur::primary::PrimaryPackage::Message(message) = package
                    && let MessageContent::Text(text) = message.content
                {
                    said.push(text);
                }
            }
            bytes = rest.to_vec();
            if said.iter().any(|said| said == text) {
                return said;
            }
        }
    }
}

const PROGRAM: &str = "def p():\n  known = 3\n  interpreter_mode()\n  textmsg(\"went on \", known)\n  \
    while True:\n    sync()\n  end\nend\n";

#[test]
fn statements_are_answered_run_in_order_and_change_what_the_program_knows() {
    let mut scene = Scene::new(PROGRAM);
    assert_eq!(scene.ask("statelastexecuted"), "state: 0: statelastexecuted");
    assert_eq!(scene.ask("textmsg(\"known \", known)"), "ack: 1: textmsg(\"known \", known)");
    scene.until_said("known 3");
    let function = "def double(x): y = x * 2 return y end";
    assert_eq!(scene.ask(function), format!("ack: 2: {function}"));
    assert_eq!(
        scene.ask("mine = double(known) known = mine + 1"),
        "ack: 3: mine = double(known) known = mine + 1"
    );
    assert_eq!(scene.ask("textmsg(\"mine \", mine)"), "ack: 4: textmsg(\"mine \", mine)");
    scene.until_said("mine 6");
    assert_eq!(scene.ask("statelastexecuted"), "state: 4: statelastexecuted");
    assert_eq!(scene.ask("statelastinterpreted"), "state: 4: statelastinterpreted");
    for wrong in
        ["nowhere()", "x = )", "textmsg(unknown)", "global fresh = 3", "return 3", "interpreter_mode()"]
    {
        let answer = scene.ask(wrong);
        assert!(answer.starts_with("discard: ") && answer.ends_with(&format!(": {wrong}")), "{answer}");
    }
    assert_eq!(scene.ask("end_interpreter()"), "ack: 5: end_interpreter()");
    scene.until_said("went on 7");
    assert_eq!(scene.ask("statelastcleared"), "state: 5: statelastcleared");
}

#[test]
fn what_waits_is_skipped_aborted_and_cleared() {
    let mut scene = Scene::new(PROGRAM);
    assert_eq!(
        scene.ask("movej([3.1, -1.3, 0.6, -2.0, -1.5, 0], a=0.5, v=0.2)").split(':').next(),
        Some("ack")
    );
    for _ in 0..3 {
        assert!(scene.ask("textmsg(\"never\")").starts_with("ack: "));
    }
    // The motion begins with the next cycle.
    while scene.ask("statelastexecuted") != "state: 1: statelastexecuted" {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(scene.ask("stateunexecuted"), "state: 3: stateunexecuted");
    assert!(scene.ask("skipbuffer").starts_with("ack: "));
    assert_eq!(scene.ask("stateunexecuted"), "state: 0: stateunexecuted");
    assert!(scene.ask("thread t(): while True: sync() end end").starts_with("ack: 5: "));
    assert!(scene.ask("run t()").starts_with("ack: 6: "));
    assert!(scene.ask("clear_interpreter()").starts_with("ack: 7: "));
    // Compiled when the motion is over and all is cleared, which the abort brings about.
    scene.line.write_all(b"textmsg(\"after\")\nabort\n").unwrap();
    assert_eq!(scene.answer(), "ack: 7: abort");
    assert_eq!(scene.answer(), "ack: 8: textmsg(\"after\")");
    let said = scene.until_said("after");
    assert!(!said.iter().any(|said| said == "never"), "{said:?}");
    assert_eq!(scene.ask("statelastcleared"), "state: 7: statelastcleared");
    // What was defined before is gone.
    assert!(scene.ask("run t()").starts_with("discard: "));
}

#[test]
fn without_a_program_statements_are_discarded_and_a_stop_discards_what_waits() {
    let mut scene = Scene::new("def p():\n  while True:\n    sync()\n  end\nend\n");
    scene.line.write_all(b"textmsg(1)\n").unwrap();
    std::thread::sleep(Duration::from_millis(50));
    scene.controller.obey("stop-program");
    assert_eq!(scene.answer(), "discard: Program is not running: textmsg(1)");
    assert_eq!(scene.ask("textmsg(2)"), "discard: Program is not running: textmsg(2)");
}

#[test]
fn cb3_has_no_such_port_and_no_such_functions() {
    let options = ControllerOptions { ephemeral_ports: true, ..ControllerOptions::new(Series::Cb3) };
    let controller = Controller::start(options).unwrap();
    assert_eq!(controller.address(Service::Interpreter), None);
    let mut world = world::World::new(options);
    world.take_script("def p():\n  interpreter_mode()\nend\n");
    let said = format!("{:?}", world.messages);
    assert!(said.contains("there is no function interpreter_mode"), "{said}");
}
