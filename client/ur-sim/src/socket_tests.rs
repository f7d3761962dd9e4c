//! Claims about sockets of programs: peers that send more than is read, and what is left of a program.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use super::options::{ControllerOptions, Series};
use super::world::{Runtime, World};

fn world() -> World {
    World::new(ControllerOptions::new(Series::E))
}

fn texts(world: &mut World) -> String {
    format!("{:?}", world.messages.drain(..).collect::<Vec<_>>())
}

/// Cycles in real time until `over` or `most` are.
fn live(world: &mut World, most: u32, over: impl Fn(&World) -> bool) {
    for _ in 0..most {
        world.cycle();
        if over(world) {
            return;
        }
        std::thread::sleep(Duration::from_micros(500));
    }
}

/// Peers, each of which sends `bytes` and keeps its line.
fn peers(count: usize, bytes: Vec<u8>) -> (u16, std::thread::JoinHandle<Vec<TcpStream>>) {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    let thread = std::thread::spawn(move || {
        let mut streams: Vec<TcpStream> = Vec::new();
        for _ in 0..count {
            let (mut stream, _) = listener.accept().unwrap();
            stream.write_all(&bytes).unwrap();
            streams.push(stream);
        }
        streams
    });
    (port, thread)
}

/// What a program of `body` says that has opened a socket to a peer that sends `bytes`.
fn told(bytes: impl Into<Vec<u8>>, body: &str) -> String {
    let (port, peers) = peers(1, bytes.into());
    let mut world = world();
    world.take_script(&format!("def r():\n  socket_open(\"127.0.0.1\", {port})\n  {body}\nend\n"));
    live(&mut world, 20_000, |world| world.runtime() == Runtime::Stopped);
    let streams = peers.join().unwrap();
    drop(streams);
    assert_eq!(world.runtime(), Runtime::Stopped);
    texts(&mut world)
}

#[test]
fn threads_that_wait_behind_a_long_inbox_do_not_look_through_it_in_every_cycle() {
    let threads = 10;
    for call in [
        "socket_read_string(NAME, prefix=\">>\", timeout=0)",
        "socket_read_string(NAME, prefix=\">>\", suffix=\"<\", timeout=0)",
        "socket_read_ascii_float(3, NAME, timeout=0)",
    ] {
        let (port, peers) = peers(threads, vec![b'>'; 1].into_iter().chain(vec![b'x'; 64_000]).collect());
        let mut text = String::from("def waits():\n  global opened = 0\n");
        for at in 0..threads {
            let call = call.replace("NAME", &format!("\"s{at}\""));
            text += &format!(
                "  thread t{at}():\n    socket_open(\"127.0.0.1\", {port}, \"s{at}\")\n    \
                 opened = opened + 1\n    {call}\n  end\n  run t{at}()\n"
            );
        }
        text += "  while True:\n    sync()\n    write_output_integer_register(0, opened)\n  end\nend\n";
        let mut world = world();
        world.take_script(&text);
        live(&mut world, 20_000, |world| world.registers.integers[0] == threads as i32);
        let streams = peers.join().unwrap();
        live(&mut world, 400, |_| false);
        let load = world.held();
        assert_eq!((world.runtime(), load.threads), (Runtime::Playing, threads + 1), "{call}");
        assert!(load.instructions < 500, "{call}: {load:?}");
        drop(streams);
    }
}

#[test]
fn what_comes_counts_as_what_it_takes() {
    let (port, peers) = peers(1, vec![b'x'; 60_000]);
    let mut world = world();
    world.take_script(&format!(
        "def r():\n  socket_open(\"127.0.0.1\", {port})\n  sleep(0.4)\n  \
         socket_read_string(prefix=\"y\", timeout=0)\nend\n"
    ));
    let mut most = 0;
    for _ in 0..600 {
        world.cycle();
        most = most.max(world.held().instructions);
        std::thread::sleep(Duration::from_micros(500));
    }
    drop(peers.join().unwrap());
    assert!(most > 60_000 / 16, "{most}");
}

#[test]
fn a_reader_gets_past_what_is_longer_than_an_inbox() {
    let mut bytes = vec![b'x'; 70_000];
    bytes.extend_from_slice(b"\n>ok<");
    let said = told(bytes.clone(), "textmsg(\"got \", socket_read_string(prefix=\">\", suffix=\"<\"))");
    assert!(said.contains("got ok"), "{said}");
    // Not amid a prefix whose beginning is the end of what fits.
    for before in 65_530..65_540 {
        let mut bytes = vec![b'x'; before];
        bytes.extend_from_slice(b"begin:ok;");
        let said = told(bytes, "textmsg(\"got \", socket_read_string(prefix=\"begin:\", suffix=\";\"))");
        assert!(said.contains("got ok"), "{before}: {said}");
    }
    let lines = "n = 0\n  line = socket_read_line()\n  while line != \"\":\n    n = n + str_len(line)\n    \
         last = line\n    line = socket_read_line(timeout=0.1)\n  end\n  \
         textmsg(\"read \", n)\n  textmsg(\"last \", last)";
    bytes.push(b'\n');
    let said = told(bytes, lines);
    assert!(said.contains("read 70004") && said.contains("last >ok<"), "{said}");
    let mut bytes = vec![b'('];
    bytes.resize(70_000, b'1');
    bytes.extend_from_slice(b"(1.5, 2)");
    let floats = "f = socket_read_ascii_float(2)\n  while f[0] == 0:\n    \
         f = socket_read_ascii_float(2)\n  end\n  textmsg(\"floats \", f)";
    let said = told(bytes, floats);
    assert!(said.contains("floats [2, 1.5, 2.0]"), "{said}");
}

#[test]
fn a_line_as_long_as_a_string_may_be_is_whole_and_a_longer_one_is_cut() {
    for (length, end, first, second) in [
        (1023, "\n", 1023, 3),
        (1023, "\r\n", 1023, 3),
        (1024, "\n", 1023, 1),
        (1024, "\r\n", 1023, 1),
        (5, "\r\n", 5, 3),
    ] {
        let text = format!("{}{end}abc\n", "x".repeat(length));
        let body = "textmsg(\"first \", str_len(socket_read_line()))\n  \
             textmsg(\"second \", str_len(socket_read_line()))";
        let said = told(text, body);
        let wanted = [format!("first {first}\""), format!("second {second}\"")];
        assert!(wanted.iter().all(|wanted| said.contains(wanted)), "{length} {end:?}: {said}");
    }
}

#[test]
fn what_stands_before_a_prefix_is_gone_and_what_a_read_did_not_take_is_not() {
    let said = told(
        "junk>one<rest>two",
        "textmsg(\"late \", socket_read_string(prefix=\"!\", timeout=0.1))\n  \
         textmsg(\"one \", socket_read_string(prefix=\">\", suffix=\"<\"))\n  \
         textmsg(\"all \", socket_read_string())",
    );
    assert!(
        said.contains("late \"") && said.contains("one one\"") && said.contains("all rest>two"),
        "{said}"
    );
}

#[test]
fn bytes_of_a_peer_are_neither_changed_nor_counted_as_letters() {
    let (port, driver) = {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let driver = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
            stream.write_all(&[0xff, 0x00, 0xc3, b'a', 0xa9, b'\n']).unwrap();
            let mut back = [0; 5];
            stream.read_exact(&mut back).unwrap();
            back
        });
        (port, driver)
    };
    let mut world = world();
    world.take_script(&format!(
        "def r():\n  socket_open(\"127.0.0.1\", {port})\n  line = socket_read_line()\n  \
         textmsg(\"length \", str_len(line))\n  textmsg(\"at \", str_find(line, \"a\"))\n  \
         socket_send_string(line)\nend\n"
    ));
    live(&mut world, 20_000, |world| world.runtime() == Runtime::Stopped);
    assert_eq!(driver.join().unwrap(), [0xff, 0x00, 0xc3, b'a', 0xa9]);
    let said = texts(&mut world);
    assert!(said.contains("length 5") && said.contains("at 3"), "{said}");
}

#[test]
fn a_program_has_all_its_sockets_whatever_secondary_programs_have_left() {
    // Nobody takes the connections: the system does.
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    let mut world = world();
    for at in 0..40 {
        // It is over before it is connected.
        world.take_script(&format!("sec s():\n  socket_open(\"127.0.0.1\", {port}, \"left {at}\")\nend\n"));
        live(&mut world, 20, |_| false);
    }
    world.take_script(&format!(
        "def m():\n  textmsg(\"open \", socket_open(\"127.0.0.1\", {port}, \"own\"))\nend\n"
    ));
    live(&mut world, 4000, |world| world.runtime() == Runtime::Stopped);
    let said = texts(&mut world);
    assert!(said.contains("open True"), "{said}");
}
