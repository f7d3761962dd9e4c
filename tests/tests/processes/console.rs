//! `foretrace console`: what its record button leaves behind.

use std::io::{BufRead as _, BufReader};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use foretrace_tests::{World, json, told};
use serde_json::{Value, json as value};
use tungstenite::{ClientRequestBuilder, Message, WebSocket};

use crate::PROGRAM;

/// Longest wait for what has to come.
const PATIENCE: Duration = Duration::from_secs(60);

/// The page that controls.
struct Page(WebSocket<TcpStream>);

impl Page {
    /// Opens the address that the console printed, `http://HOST/#TOKEN`.
    fn open(address: &str) -> Self {
        let (host, token) = address.strip_prefix("http://").unwrap().split_once("/#").unwrap();
        let stream = TcpStream::connect(host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let request = ClientRequestBuilder::new(format!("ws://{host}/socket").parse().unwrap())
            .with_header("Origin", format!("http://{host}"));
        let mut page = Self(tungstenite::client(request, stream).unwrap().0);
        page.say(&value!({ "control": token }));
        page
    }

    fn say(&mut self, message: &Value) {
        self.0.send(Message::text(message.to_string())).unwrap();
    }

    /// What it is shown of the recording, once `so` holds of it.
    fn shown(&mut self, so: impl Fn(&Value) -> bool) -> Value {
        let begin = Instant::now();
        let mut last = Value::Null;
        while begin.elapsed() < PATIENCE {
            let Message::Text(text) = self.0.read().unwrap() else { continue };
            let said: Value = serde_json::from_str(text.as_str()).unwrap();
            if said["frame"].is_object() {
                last = said["frame"]["here"]["recording"].clone();
                if so(&last) {
                    return last;
                }
            }
        }
        panic!("{last}");
    }
}

#[test]
fn a_recording_of_the_button_ends_at_its_bound_and_the_page_is_told() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let _arm = world.armed_arm(0, &[]);
    let words = ["console", "--port", "0", "--recordings", "tapes", "--max-size", "1M", "--json", "c.json"];
    let mut console = world.start(0, &words);
    let mut stdout = BufReader::new(console.take_stdout().unwrap());
    let mut open = String::new();
    stdout.read_line(&mut open).unwrap();
    let mut page = Page::open(open.trim().strip_prefix("open ").unwrap());
    page.say(&value!({ "record": true }));
    let shown = page.shown(|shown| shown["figures"].is_object() || shown["failed"].is_string());
    assert_eq!((&shown["full"], &shown["on"]), (&1_000_000.into(), &false.into()), "{shown}");
    let bytes = shown["bytes"].as_u64().unwrap();
    assert!((1_000_000..10_000_000).contains(&bytes), "{shown}");
    // Whole, with its own name, and the button may be pressed again.
    let file = world.file(shown["path"].as_str().unwrap()).display().to_string();
    let info = world.run_plain(&["record", "--info", &file, "--json", "-"]);
    assert!(info.status.success(), "{}", told(&info));
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["damage"], Value::Null, "{info}");
    page.say(&value!({ "record": true }));
    page.shown(|shown| shown["on"] == true);
    console.end();
    daemon.end();
    assert!(json(&world.file("c.json"))["pages"].as_u64() >= Some(1));
}
