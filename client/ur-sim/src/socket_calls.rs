//! The calls for sockets of programs.
//!
//! Contract: none holds the control loop up; what has not come by its time gives the manual's answer for
//! that. A socket that is closed gives it at once.
//!
//! *Source*: script manual 5.11, module "interfaces", `socket_...`.

use super::machine::{Hands, Result, number, number_or};
use super::sockets::ProgramSocket;
use crate::script::{Called, List, MachineCall, Value};

/// The name where a program gives none.
const USUAL: &str = "socket_0";
/// How long a reading call waits where a program does not say \[s\].
const USUAL_WAIT_S: f64 = 2.0;
/// Numbers that one call reads at most.
const MOST_NUMBERS: i32 = 30;
/// Longest string that one call reads \[bytes\].
const LONGEST_STRING: usize = 1024;
/// Instructions that reading and looking through what came takes, for each so many bytes of it.
const BYTES_PER_INSTRUCTION: usize = 64;

fn socket_name(value: Option<&Value>) -> Result<String> {
    match value {
        None => Ok(USUAL.to_owned()),
        // PolyScope's programs name sockets by numbers, too.
        Some(name @ (Value::Text(_) | Value::Integer(_))) => Ok(name.to_string()),
        Some(other) => Err(format!("wants a string for socket_name, not {}", other.kind())),
    }
}

fn count(value: Option<&Value>) -> Result<usize> {
    let number = value.and_then(Value::as_integer).filter(|number| (1..=MOST_NUMBERS).contains(number));
    number
        .and_then(|number| usize::try_from(number).ok())
        .ok_or_else(|| format!("wants a number from 1 to {MOST_NUMBERS} of values to read"))
}

/// How many were read, then each, and `missing` for those that were not.
fn numbers(read: Vec<Value>, wanted: usize, missing: &Value) -> Result<Value> {
    let mut list = vec![Value::integer(i64::try_from(read.len()).unwrap_or(0))];
    list.extend(read);
    list.resize(wanted + 1, missing.clone());
    List::new(list).map(Value::List)
}

/// Where `wanted` begins in `bytes`.
fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    bytes.windows(wanted.len().max(1)).position(|window| window == wanted)
}

fn escaped(text: &str) -> String {
    text.replace("\\n", "\n").replace("\\r", "\r").replace("\\t", "\t")
}

fn text(bytes: &[u8]) -> Value {
    Value::text(&String::from_utf8_lossy(bytes))
}

/// Takes what one call reads out of a socket, if all of it is there.
type Take<'a> = &'a dyn Fn(&mut ProgramSocket) -> Result<Option<Value>>;

impl Hands<'_> {
    pub(super) fn socket(&mut self, call: &MachineCall<'_>) -> Result<Called> {
        let arguments = call.arguments;
        match call.name {
            "socket_open" => {
                let [address, port, name] = arguments.bind(["address", "port", "socket_name"])?;
                let address = address.and_then(Value::as_text).ok_or("wants a string for address")?;
                let port = port.and_then(Value::as_integer).and_then(|port| u16::try_from(port).ok());
                let port = port.ok_or("wants a number from 0 to 65535 for port")?;
                self.socket_open(call, &socket_name(name)?, address, port)
            }
            "socket_close" => {
                let [name] = arguments.bind(["socket_name"])?;
                self.sockets.close(&socket_name(name)?);
                Ok(Called::Value(Value::None))
            }
            "socket_send_string" | "socket_send_line" => {
                let [sent, name] = arguments.bind(["str", "socket_name"])?;
                let mut sent = sent.ok_or("wants something to send")?.to_string();
                if call.name == "socket_send_line" {
                    sent.push('\n');
                }
                self.socket_send(&socket_name(name)?, sent.as_bytes())
            }
            "socket_send_int" => {
                let [value, name] = arguments.bind(["value", "socket_name"])?;
                let value = value.and_then(Value::as_integer).ok_or("wants an integer to send")?;
                self.socket_send(&socket_name(name)?, &value.to_be_bytes())
            }
            "socket_send_byte" => {
                let [value, name] = arguments.bind(["value", "socket_name"])?;
                let value = value.and_then(Value::as_integer).and_then(|value| u8::try_from(value).ok());
                self.socket_send(&socket_name(name)?, &[value.ok_or("wants a number from 0 to 255")?])
            }
            "socket_set_var" => {
                let [name, value, socket] = arguments.bind(["name", "value", "socket_name"])?;
                let name = name.and_then(Value::as_text).ok_or("wants a string for name")?;
                let value = number(value, "value")? as i32;
                self.socket_send(&socket_name(socket)?, format!("SET {name} {value}\n").as_bytes())?;
                Ok(Called::Value(Value::None))
            }
            "socket_get_var" => {
                let [name, socket] = arguments.bind(["name", "socket_name"])?;
                let (name, socket) =
                    (name.and_then(Value::as_text).ok_or("wants a string for name")?, socket_name(socket)?);
                if call.first {
                    self.socket_send(&socket, format!("GET {name}\n").as_bytes())?;
                }
                self.socket_read(call, &socket, USUAL_WAIT_S, Value::Integer(0), &|socket| {
                    let Some(end) = find(socket.inbox(), b"\n") else { return Ok(None) };
                    let line = String::from_utf8_lossy(&socket.take(end + 1)).into_owned();
                    let value = line.trim().strip_prefix(name).and_then(|rest| rest.trim().parse().ok());
                    Ok(Some(Value::Integer(value.unwrap_or(0))))
                })
            }
            _ => self.socket_reads(call),
        }
    }

    fn socket_reads(&mut self, call: &MachineCall<'_>) -> Result<Called> {
        let arguments = call.arguments;
        if matches!(call.name, "socket_read_string" | "socket_read_line") {
            let names = ["socket_name", "prefix", "suffix", "interpret_escape", "timeout"];
            let [name, prefix, suffix, escape, timeout] = if call.name == "socket_read_line" {
                let [name, timeout] = arguments.bind(["socket_name", "timeout"])?;
                [name, None, None, None, timeout]
            } else {
                arguments.bind(names)?
            };
            let timeout = number_or(timeout, "timeout", USUAL_WAIT_S)?;
            // The manual's own default for it is a string.
            let escape = escape.is_some_and(|escape| escape.as_bool() == Some(true));
            let mark = |value: Option<&Value>| {
                let mark = value.map(ToString::to_string).unwrap_or_default();
                if escape { escaped(&mark) } else { mark }.trim_start_matches(' ').to_owned()
            };
            let (prefix, suffix) = (mark(prefix), mark(suffix));
            let line = call.name == "socket_read_line";
            let take: Take<'_> = &|socket| {
                if line {
                    let Some(end) = find(socket.inbox(), b"\n") else { return Ok(None) };
                    let taken = socket.take(end + 1);
                    let line = taken.strip_suffix(b"\n").unwrap_or(&taken);
                    return Ok(Some(text(line.strip_suffix(b"\r").unwrap_or(line))));
                }
                Ok(read_string(socket, prefix.as_bytes(), suffix.as_bytes()))
            };
            return self.socket_read(call, &socket_name(name)?, timeout, Value::text(""), take);
        }
        let [wanted, name, timeout] = arguments.bind(["number", "socket_name", "timeout"])?;
        let (wanted, name) = (count(wanted)?, socket_name(name)?);
        let timeout = number_or(timeout, "timeout", USUAL_WAIT_S)?;
        let missing = Value::Integer(-1);
        match call.name {
            "socket_read_ascii_float" => {
                let missing = Value::Float(f64::NAN);
                let none = numbers(Vec::new(), wanted, &missing)?;
                self.socket_read(call, &name, timeout, none, &|socket| {
                    let Some(end) = find(socket.inbox(), b")") else { return Ok(None) };
                    let taken = String::from_utf8_lossy(&socket.take(end + 1)).into_owned();
                    let inside = taken.trim_end_matches(')').split_once('(').map_or("", |(_, inside)| inside);
                    let read: Option<Vec<Value>> = inside
                        .split(',')
                        .take(wanted)
                        .map(|number| number.trim().parse().ok().map(Value::Float))
                        .collect();
                    numbers(read.unwrap_or_default(), wanted, &missing).map(Some)
                })
            }
            bytes => {
                let size = if bytes == "socket_read_byte_list" { 1 } else { 4 };
                let none = numbers(Vec::new(), wanted, &missing)?;
                self.socket_read(call, &name, timeout, none, &|socket| {
                    if socket.inbox().len() < wanted * size {
                        return Ok(None);
                    }
                    let taken = socket.take(wanted * size);
                    let read = taken.chunks(size).map(|bytes| match bytes {
                        [a, b, c, d] => Value::Integer(i32::from_be_bytes([*a, *b, *c, *d])),
                        bytes => Value::Integer(bytes.first().copied().unwrap_or(0).into()),
                    });
                    numbers(read.collect(), wanted, &missing).map(Some)
                })
            }
        }
    }

    fn socket_open(&mut self, call: &MachineCall<'_>, name: &str, host: &str, port: u16) -> Result<Called> {
        let opened = if call.first {
            self.sockets.open(name, host, port).map_or_else(|why| Some(Err(why)), |()| None)
        } else {
            self.sockets.opened(name)
        };
        Ok(match opened {
            None => Called::Wait,
            Some(Ok(())) => Called::Value(Value::Bool(true)),
            Some(Err(why)) => {
                self.say(format!("socket_open {name:?}: {why}"));
                Called::Value(Value::Bool(false))
            }
        })
    }

    fn socket_send(&mut self, name: &str, bytes: &[u8]) -> Result<Called> {
        self.spend_on(bytes.len());
        let sent = self.sockets.get(name).is_some_and(|socket| socket.send(bytes));
        Ok(Called::Value(Value::Bool(sent)))
    }

    /// Waits at most `timeout` \[s\], as long as it takes where that is not above 0, for what `take` takes;
    /// `none` is the answer when it does not come.
    fn socket_read(
        &mut self,
        call: &MachineCall<'_>,
        name: &str,
        timeout: f64,
        none: Value,
        take: Take<'_>,
    ) -> Result<Called> {
        let now = self.robot.cycle;
        if call.first {
            let until = if timeout > 0.0 { now.saturating_add(self.cycles(timeout)) } else { u64::MAX };
            self.waits.insert(call.thread, until);
        }
        let over = self.waits.get(&call.thread).is_none_or(|until| now >= *until);
        let Some(socket) = self.sockets.get(name) else {
            self.waits.remove(&call.thread);
            return Ok(Called::Value(none));
        };
        let open = socket.receive();
        let looked_through = socket.inbox().len();
        let taken = take(socket)?;
        self.spend_on(looked_through);
        if taken.is_none() && open && !over {
            return Ok(Called::Wait);
        }
        self.waits.remove(&call.thread);
        Ok(Called::Value(taken.unwrap_or(none)))
    }

    fn spend_on(&mut self, bytes: usize) {
        let instructions = u32::try_from(bytes / BYTES_PER_INSTRUCTION).unwrap_or(u32::MAX);
        self.spent = self.spent.saturating_add(instructions.saturating_add(1));
    }
}

/// All that has come, or what stands between both marks; what stands before the first is gone then.
fn read_string(socket: &mut ProgramSocket, prefix: &[u8], suffix: &[u8]) -> Option<Value> {
    let from = if prefix.is_empty() { 0 } else { find(socket.inbox(), prefix)? + prefix.len() };
    let rest = socket.inbox().get(from..).unwrap_or_default();
    let length = if suffix.is_empty() {
        Some(rest.len()).filter(|length| *length > 0)?
    } else {
        match find(rest, suffix) {
            Some(length) => length,
            // What is longer than a string may be is cut, so that it does not wait for ever.
            None if rest.len() >= LONGEST_STRING => LONGEST_STRING,
            None => return None,
        }
    };
    let cut = length.min(LONGEST_STRING);
    let ended = !suffix.is_empty() && rest.get(length..).is_some_and(|rest| rest.starts_with(suffix));
    let taken = socket.take(from + cut);
    if ended && cut == length {
        socket.take(suffix.len());
    }
    Some(text(taken.get(from..).unwrap_or_default()))
}
