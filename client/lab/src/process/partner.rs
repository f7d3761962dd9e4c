//! `Partner`: greeting, steps and previews as lines of JSON.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::child::LineChild;
use super::error::{ProcessError, ProcessFault};

/// Name and version of what is spoken.
pub const PROTOCOL: &str = "foretrace-predictor-1";
/// Bytes of a wrong answer that a message shows.
const SHOWN: usize = 80;

/// What a program is told first; it answers `{}`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Greeting {
    protocol: &'static str,
    task: &'static str,
    /// The unit of all lengths.
    unit: &'static str,
    step_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    hand: Option<String>,
}

impl Greeting {
    /// Before the loop, in metres, with steps of `step_s`; `hand` is who writes.
    #[must_use]
    pub const fn closed_loop(step_s: f64, hand: String) -> Self {
        Self { protocol: PROTOCOL, task: "closed-loop", unit: "m", step_s, hand: Some(hand) }
    }

    /// For a table, in the units of a device whose steps take `step_s`.
    #[must_use]
    pub const fn table(step_s: f64) -> Self {
        Self { protocol: PROTOCOL, task: "table", unit: "raw", step_s, hand: None }
    }
}

/// A step of the pen, and how many positions behind it are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StepQuestion {
    pub index: u64,
    pub t_s: f64,
    /// Position at its end.
    pub x: f64,
    pub y: f64,
    /// Displacement; 0 unless the motion continues.
    pub dx: f64,
    pub dy: f64,
    /// Running scale: of displacements over it the RMS is 10 per axis.
    pub scale: f64,
    /// Displacements beyond this are shortened; `None`: there is no bound.
    pub longest: Option<f64>,
    /// `start`, `continues` or `jump`.
    pub motion: &'static str,
    pub contact: bool,
    /// 0: no preview, only the step.
    pub wanted: usize,
}

/// As a program answers.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct PreviewAnswer {
    #[serde(default)]
    positions: Vec<[f64; 2]>,
    #[serde(default)]
    radii: Vec<f64>,
}

#[derive(Serialize)]
struct StepLine<'a> {
    step: &'a StepQuestion,
}

/// Positions, and radii: as many, or none.
pub type AnsweredPositions = (Vec<[f64; 2]>, Vec<f64>);

/// A program that has been greeted.
#[derive(Debug)]
pub struct Partner {
    child: LineChild,
    line: Vec<u8>,
}

impl Partner {
    /// Starts `command`, which may be silent for `patience` before each answer.
    ///
    /// # Errors
    /// It does not start, or does not answer the greeting as it has to.
    pub fn start(command: &str, greeting: &Greeting, patience: Duration) -> Result<Self, ProcessError> {
        let child = LineChild::start(command, patience).map_err(|fault| fault.at("at its start"))?;
        let mut partner = Self { child, line: Vec::new() };
        let place = |fault: ProcessFault| fault.at("in answer to the greeting");
        let answer = partner.ask(greeting).map_err(place)?;
        answer.checked(0).map_err(place)?;
        Ok(partner)
    }

    /// Tells a step; the positions that it answers with, as many as wanted, with their radii where it has
    /// them. `None`: no preview.
    ///
    /// # Errors
    /// Anything but such an answer.
    pub fn tell(&mut self, step: &StepQuestion) -> Result<Option<AnsweredPositions>, ProcessError> {
        let told = self.ask(&StepLine { step }).and_then(|answer| answer.checked(step.wanted));
        told.map_err(|fault| fault.at(format!("at step {}", step.index)))
    }

    fn ask(&mut self, question: &impl Serialize) -> Result<PreviewAnswer, ProcessFault> {
        self.line.clear();
        serde_json::to_writer(&mut self.line, question).map_err(|why| ProcessFault::Io(why.to_string()))?;
        self.line.push(b'\n');
        let answer = self.child.ask(&self.line)?;
        serde_json::from_slice(answer)
            .map_err(|why| ProcessFault::Form { line: shown(answer), why: why.to_string() })
    }
}

impl PreviewAnswer {
    /// What is legal where so many positions are wanted.
    fn checked(self, wanted: usize) -> Result<Option<AnsweredPositions>, ProcessFault> {
        let Self { positions, radii } = self;
        let count = positions.len();
        if ![0, wanted].contains(&count) {
            return Err(ProcessFault::Positions { count, wanted });
        }
        if ![0, count].contains(&radii.len()) {
            return Err(ProcessFault::Radii { radii: radii.len(), positions: count });
        }
        let wrong = |what, (index, value): (usize, &f64)| ProcessFault::Number { what, index, value: *value };
        let mut of_position =
            positions.iter().enumerate().flat_map(|(i, both)| both.iter().map(move |x| (i, x)));
        if let Some(found) = of_position.find(|(_, value)| !value.is_finite()) {
            return Err(wrong("position", found));
        }
        if let Some(found) =
            radii.iter().enumerate().find(|(_, radius)| !(0.0..f64::INFINITY).contains(*radius))
        {
            return Err(wrong("radius", found));
        }
        Ok((count > 0).then_some((positions, radii)))
    }
}

/// The beginning of a line, for a message.
fn shown(line: &[u8]) -> String {
    let text = String::from_utf8_lossy(line.get(..SHOWN).unwrap_or(line));
    let cut = if line.len() > SHOWN { "…" } else { "" };
    format!("{}{cut}", text.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    const STEP: StepQuestion = StepQuestion {
        index: 17,
        t_s: 0.17,
        x: 1.0,
        y: 2.0,
        dx: 0.5,
        dy: -0.5,
        scale: 0.25,
        longest: None,
        motion: "continues",
        contact: true,
        wanted: 2,
    };

    fn start(command: &str) -> Result<Partner, ProcessError> {
        Partner::start(command, &Greeting::table(0.01), Duration::from_millis(400))
    }

    /// Greets, then answers every line with what `answer` prints.
    fn answering(answer: &str) -> Partner {
        start(&format!("read -r greeting; echo '{{}}'; while read -r line; do {answer}; done")).unwrap()
    }

    #[test]
    fn lines_are_what_the_document_says_and_answers_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let heard = folder.path().join("heard");
        let command = format!(
            "while read -r line; do printf '%s\\n' \"$line\" >>{}; case $line in *wanted*) \
             echo '{{\"positions\": [[1, 2.5], [-1e-3, 4]], \"radii\": [0, 1]}}';; *) echo '{{}}';; esac; done",
            heard.display()
        );
        let mut partner = start(&command).unwrap();
        let told = partner.tell(&STEP).unwrap();
        assert_eq!(told, Some((vec![[1.0, 2.5], [-1e-3, 4.0]], vec![0.0, 1.0])));
        drop(partner);
        let lines = [
            r#"{"protocol":"foretrace-predictor-1","task":"table","unit":"raw","step_s":0.01}"#,
            concat!(
                r#"{"step":{"index":17,"t_s":0.17,"x":1.0,"y":2.0,"dx":0.5,"dy":-0.5,"scale":0.25,"#,
                r#""longest":null,"motion":"continues","contact":true,"wanted":2}}"#
            ),
        ];
        assert_eq!(std::fs::read_to_string(heard).unwrap(), lines.join("\n") + "\n");
        let greeting = serde_json::to_string(&Greeting::closed_loop(0.01, "w0.dat, Ada".to_owned())).unwrap();
        let told = r#"{"protocol":"foretrace-predictor-1","task":"closed-loop","unit":"m","step_s":0.01,"hand":"w0.dat, Ada"}"#;
        assert_eq!(greeting, told);
    }

    #[test]
    fn an_empty_answer_is_no_preview() {
        assert_eq!(answering("echo '{}'").tell(&STEP).unwrap(), None);
    }

    #[test]
    fn wrong_answers_are_refused_with_what_where_the_bound_and_what_to_do() {
        let cases = [
            ("echo '{\"positions\": [[1, 2]]}'", "1 positions, wanted are 2; give as many"),
            ("echo '{\"positions\": [[1, 2], [3, 4], [5, 6]]}'", "3 positions, wanted are 2"),
            ("echo '{\"positions\": [[1, 2], [3, NaN]]}'", "is no answer of foretrace-predictor-1"),
            ("echo '{\"positions\": [[1, 2], [3, 1e999]]}'", "out of range"),
            ("echo '{\"positions\": [[1, 2], [3]]}'", "an array of length 2"),
            ("echo '{\"positions\": [[1, 2], [3, 4]], \"radii\": [1]}'", "1 radii for 2 positions"),
            ("echo '{\"positions\": [[1, 2], [3, 4]], \"radii\": [1, -1]}'", "radius 1 is -1"),
            ("echo '{\"position\": [[1, 2], [3, 4]]}'", "unknown field `position`"),
            ("echo thinking", "\"thinking\" is no answer"),
            ("echo", "\"\" is no answer"),
            ("echo '{}'; echo '{}'", "more than one line for a line"),
            ("head -c 1100000 /dev/zero", "more than 1048576 bytes"),
            ("sleep 60", "no answer within 0.4 s"),
            ("while :; do printf ' '; sleep 0.1; done", "no answer within 0.4 s"),
            ("exit 3", "it ended (exit status: 3); its own output says why"),
            ("kill -9 $$", "it ended (signal: 9"),
            ("exec >&-; exec <&-; sleep 60", "it closed its output"),
        ];
        for (answer, words) in cases {
            let began = Instant::now();
            let mut partner = answering(answer);
            // A second line may come a little later.
            let error = match partner.tell(&STEP) {
                Ok(_) => {
                    std::thread::sleep(Duration::from_millis(200));
                    partner.tell(&STEP).unwrap_err()
                }
                Err(error) => error,
            };
            drop(partner);
            let text = error.to_string();
            assert!(text.starts_with("at step 17: ") && text.contains(words), "{answer}: {text}");
            assert!(text.contains("; ") && text.len() < 400, "{text}");
            assert!(began.elapsed() < Duration::from_secs(10), "{answer}: {:?}", began.elapsed());
        }
    }

    #[test]
    fn who_does_not_greet_is_refused_at_once() {
        let refused = |command: &str| start(command).unwrap_err().to_string();
        let text = refused("nobody-has-this-command 2>/dev/null");
        assert!(text.starts_with("in answer to the greeting: it ended (exit status: 127)"), "{text}");
        let text = refused("read -r line; echo '{\"positions\": [[0, 0]]}'; cat");
        assert!(text.contains("1 positions, wanted are 0"), "{text}");
        assert!(refused("read -r line; echo hello; cat").contains("\"hello\" is no answer"));
    }

    #[test]
    fn the_program_and_all_it_started_end_with_their_handle() {
        let folder = tempfile::tempdir().unwrap();
        let numbers = folder.path().join("numbers");
        let alive = |pid: &str| {
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            // A zombie waits for somebody else's look at it.
            stat.rsplit(')')
                .next()
                .is_some_and(|rest| !rest.trim_start().starts_with(['Z', 'X']) && !rest.is_empty())
        };
        // One that ends with its input, and one that ignores it; both leave another behind.
        for (rest, grace_s) in [("while read -r line; do echo '{}'; done; exit 0", 0.5), ("sleep 600", 3.0)] {
            let command =
                format!("sleep 600 & echo $$ $! >{}; read -r line; echo '{{}}'; {rest}", numbers.display());
            let partner = start(&command).unwrap();
            let pids = std::fs::read_to_string(&numbers).unwrap();
            assert!(pids.split_whitespace().all(alive) && pids.split_whitespace().count() == 2, "{pids}");
            let began = Instant::now();
            drop(partner);
            assert!(began.elapsed().as_secs_f64() < grace_s, "{:?}", began.elapsed());
            std::thread::sleep(Duration::from_millis(50));
            assert!(!pids.split_whitespace().any(alive), "{pids}");
        }
    }
}
