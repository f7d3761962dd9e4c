//! The calls for sockets of programs.
//!
//! Contract: none holds the control loop up; what has not come by its time gives the manual's answer for
//! that. A socket that is closed gives it at once.
//!
//! *Source*: script manual 5.11, module "interfaces", `socket_...`.

use super::machine::{Hands, Result, number, number_or};
use super::sockets::{ProgramSocket, SocketOwner, find};
use crate::script::{Called, List, MachineCall, ThreadId, Value};

/// The name where a program gives none.
const USUAL: &str = "socket_0";
/// How long a reading call waits where a program does not say \[s\].
const USUAL_WAIT_S: f64 = 2.0;
/// Numbers that one call reads at most.
const MOST_NUMBERS: i32 = 30;
/// Longest string that one call reads \[bytes\]; of a longer one it reads the beginning.
const LONGEST_STRING: usize = 1023;
/// Longest numbers in brackets \[bytes\]: thirty, each with more digits than a float has, and blanks.
const LONGEST_NUMBERS: usize = 2048;
/// An instruction is counted for so many bytes that are sent, received, looked through or taken.
const BYTES_PER_INSTRUCTION: usize = 16;

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

/// The bytes that a value is sent as, or that mark something.
fn written(value: &Value) -> Vec<u8> {
    value.as_bytes().map_or_else(|| value.to_string().into_bytes(), <[u8]>::to_vec)
}

fn escaped(text: &[u8]) -> Vec<u8> {
    let mut escaped = Vec::with_capacity(text.len());
    let mut rest = text;
    while let Some((first, others)) = rest.split_first() {
        let meant = match (first, others.first()) {
            (b'\\', Some(b'n')) => Some(b'\n'),
            (b'\\', Some(b'r')) => Some(b'\r'),
            (b'\\', Some(b't')) => Some(b'\t'),
            _ => None,
        };
        escaped.push(meant.unwrap_or(*first));
        rest = others.get(usize::from(meant.is_some())..).unwrap_or_default();
    }
    escaped
}

/// Takes what one call reads out of a socket, if all of it is there. Counts the bytes that it looked at.
type Take<'a> = &'a dyn Fn(&mut ProgramSocket, &mut usize) -> Result<Option<Value>>;

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
                let mut sent = written(sent.ok_or("wants something to send")?);
                if call.name == "socket_send_line" {
                    sent.push(b'\n');
                }
                self.socket_send(&socket_name(name)?, &sent)
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
                self.socket_read(call, &socket, USUAL_WAIT_S, Value::Integer(0), &|socket, looked_at| {
                    let Some(line) = take_line(socket, looked_at) else { return Ok(None) };
                    let line = String::from_utf8_lossy(&line).into_owned();
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
                let mark = value.map(written).unwrap_or_default();
                let mark = if escape { escaped(&mark) } else { mark };
                let blanks = mark.iter().take_while(|byte| **byte == b' ').count();
                mark.get(blanks..).unwrap_or_default().to_vec()
            };
            let (prefix, suffix) = (mark(prefix), mark(suffix));
            let line = call.name == "socket_read_line";
            let take: Take<'_> = &|socket, looked_at| {
                if line {
                    return Ok(take_line(socket, looked_at).map(|line| Value::bytes(&line)));
                }
                Ok(read_string(socket, &prefix, &suffix, looked_at))
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
                self.socket_read(call, &name, timeout, none, &|socket, looked_at| {
                    let Some(inside) = take_bracket(socket, looked_at) else { return Ok(None) };
                    let inside = String::from_utf8_lossy(&inside).into_owned();
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
                self.socket_read(call, &name, timeout, none, &|socket, looked_at| {
                    *looked_at = wanted * size;
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
            let secondary = call.thread >= ThreadId::SECONDARY;
            let owner = if secondary { SocketOwner::Secondary } else { SocketOwner::Program };
            self.sockets.open(owner, name, host, port).map_or_else(|why| Some(Err(why)), |()| None)
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
        let (open, came) = socket.receive();
        let mut looked_at = 0;
        let taken = take(socket, &mut looked_at)?;
        self.spend_on(came.saturating_add(looked_at));
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

/// The place of `end`, not behind `longest` bytes from `from` on. Where there are so many without it: that
/// many, and no end.
fn end_of(
    socket: &ProgramSocket,
    from: usize,
    end: &[u8],
    longest: usize,
    looked_at: &mut usize,
) -> Option<(usize, bool)> {
    let rest = socket.inbox().get(from..).unwrap_or_default();
    let within = rest.get(..longest.saturating_add(end.len())).unwrap_or(rest);
    *looked_at = looked_at.saturating_add(within.len());
    match find(within, end) {
        Some(length) => Some((length, true)),
        None => (within.len() >= longest.saturating_add(end.len())).then_some((longest, false)),
    }
}

/// A line without its end; the beginning of one that is longer than a string may be, so that nobody waits
/// behind it for ever.
fn take_line(socket: &mut ProgramSocket, looked_at: &mut usize) -> Option<Vec<u8>> {
    // A carriage return before the end is no part of the line.
    let (length, ended) = end_of(socket, 0, b"\n", LONGEST_STRING + 1, looked_at)?;
    if !ended || length > LONGEST_STRING && socket.inbox().get(LONGEST_STRING) != Some(&b'\r') {
        return Some(socket.take(LONGEST_STRING));
    }
    let mut line = socket.take(length);
    socket.discard(1);
    line.pop_if(|last| *last == b'\r');
    Some(line)
}

/// Finds `prefix` and forgets what stands before it; also where it is not there and no more can come.
fn go_to(socket: &mut ProgramSocket, prefix: &[u8], looked_at: &mut usize) -> bool {
    if socket.inbox().starts_with(prefix) {
        return true;
    }
    let search = socket.find(prefix);
    *looked_at = looked_at.saturating_add(search.looked_at);
    match search.at {
        Some(at) => socket.discard(at),
        // Its beginning may be the end of what has come.
        None if socket.is_full() => socket.discard(socket.inbox().len() - (prefix.len() - 1)),
        None => {}
    }
    search.at.is_some()
}

/// What stands in the first pair of brackets; nothing where that is longer than numbers are.
fn take_bracket(socket: &mut ProgramSocket, looked_at: &mut usize) -> Option<Vec<u8>> {
    if !go_to(socket, b"(", looked_at) {
        return None;
    }
    let (length, ended) = end_of(socket, 1, b")", LONGEST_NUMBERS, looked_at)?;
    socket.discard(1);
    let inside = socket.take(length);
    socket.discard(usize::from(ended));
    Some(if ended { inside } else { Vec::new() })
}

/// All that has come, or what stands between both marks; what stands before the first is gone then.
fn read_string(
    socket: &mut ProgramSocket,
    prefix: &[u8],
    suffix: &[u8],
    looked_at: &mut usize,
) -> Option<Value> {
    if !go_to(socket, prefix, looked_at) {
        return None;
    }
    let length = if suffix.is_empty() {
        let rest = socket.inbox().len().saturating_sub(prefix.len());
        *looked_at = looked_at.saturating_add(rest.min(LONGEST_STRING));
        (Some(rest.min(LONGEST_STRING)).filter(|length| *length > 0)?, false)
    } else {
        end_of(socket, prefix.len(), suffix, LONGEST_STRING, looked_at)?
    };
    socket.discard(prefix.len());
    let (length, ended) = length;
    let taken = socket.take(length);
    if ended {
        socket.discard(suffix.len());
    }
    Some(Value::bytes(&taken))
}
