//! Claims about programs of drivers and pendants: sockets that they open, motions that ask for too much.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::time::Duration;

use super::options::{ControllerOptions, Series};
use super::world::{Runtime, World};

fn world(series: Series) -> World {
    World::new(ControllerOptions::new(series))
}

fn texts(world: &mut World) -> String {
    format!("{:?}", world.messages.drain(..).collect::<Vec<_>>())
}

/// Cycles in real time, as sockets want it, until the program is over or `most` are.
fn live(world: &mut World, most: u32) {
    for _ in 0..most {
        world.cycle();
        if world.runtime() == Runtime::Stopped {
            return;
        }
        std::thread::sleep(Duration::from_micros(1000));
    }
}

/// Runs `cycles`; the arm rests afterwards inside its limits, within 0.3 rad and 0.5 s of the protective stop
/// that comes, and can be freed.
#[track_caller]
fn stops_and_is_freed(series: Series, text: &str) {
    let mut world = world(series);
    world.take_script(text);
    let stop = (0..20 * series.rate_hz()).find(|_| {
        world.cycle();
        world.robot.safety.protective().is_some()
    });
    assert!(stop.is_some(), "{text}: no stop, {}", texts(&mut world));
    let at = world.robot.actual().q;
    (0..series.rate_hz() / 2).for_each(|_| world.cycle());
    let rests = world.robot.actual();
    for ((q, qd), was) in rests.q.iter().zip(rests.qd).zip(at) {
        assert!((q - was).abs() < 0.3 && qd.abs() < 1e-6, "{text}: {rests:?} from {at:?}");
        assert!(q.abs() <= super::kinematics::POSITION_LIMIT_RAD, "{text}: {rests:?}");
    }
    (0..5 * series.rate_hz()).for_each(|_| world.cycle());
    let cycle = world.robot.cycle;
    world.robot.safety.unlock(cycle).unwrap();
    (0..series.rate_hz()).for_each(|_| world.cycle());
    assert!(world.robot.ready(), "{text}: {:?}", world.robot.safety);
    let here = world.robot.actual().q;
    for (q, rest) in here.iter().zip(rests.q) {
        assert!((q - rest).abs() < 1e-6, "{text}: {here:?} {rests:?}");
    }
}

#[test]
fn whatever_a_program_asks_for_the_arm_rests_within_its_limits_after_the_stop() {
    for series in [Series::Cb3, Series::E] {
        for text in [
            "movej([3.1416,-1.3,1.8,-2.07,-1.57,3.0],t=0.1)\n",
            "movej([0.1,-2.3,0.3,-0.07,1.57,-3.0],t=0.2)\n",
            // A joint beyond its range, by a target, a stream and a speed.
            "movej([3.1416,-1.3,1.8,-2.07,-1.57,7.0],a=30,v=3)\n",
            "def s():\n  q = get_actual_joint_positions()\n  while True:\n    q[5] = q[5] + 2 * get_steptime()\n    \
             servoj(q, t=0.002, lookahead_time=0.03, gain=2000)\n  end\nend\n",
            "speedj([0, 0, 0, 0, 0, 3.3], 40, 20)\n",
            "speedj([3.3, 0, 0, 0, 0, -3.3], 0.5, 30)\n",
            // Far too fast a line.
            "def l():\n  a = get_actual_tcp_pose()\n  a[2] = a[2] + 0.2\n  movel(a, t=0.02)\nend\n",
            "servoj([0,0,0,0,0,0])\n",
            "def n():\n  servoj([0,0,0,0,0,pow(10, 400)])\nend\n",
        ] {
            stops_and_is_freed(series, text);
        }
    }
}

#[test]
fn a_line_that_leaves_the_reach_is_an_error_and_a_stop() {
    for series in [Series::Cb3, Series::E] {
        // From one side of the base to the other, through the place that no wrist reaches.
        let text = "def l():\n  textmsg(\"begin\")\n  a = get_actual_tcp_pose()\n  a[0] = -a[0]\n  a[1] = -a[1]\n  \
            movel(a, a=1, v=0.5)\n  textmsg(\"never\")\nend\n";
        let mut world = world(series);
        world.take_script(text);
        (0..20 * series.rate_hz()).for_each(|_| world.cycle());
        let said = texts(&mut world);
        assert_eq!(world.runtime(), Runtime::Stopped, "{said}");
        assert!(said.contains("begin") && !said.contains("never"), "{said}");
        let stopped = said.contains("leaves the reach") || world.robot.safety.protective().is_some();
        assert!(stopped, "{said}");
        assert!(world.robot.actual().qd.iter().all(|qd| qd.abs() < 1e-6));
        world = self::world(series);
        world.take_script("def l():\n  servoj(p[2, 0, 0, 0, 3, 0])\nend\n");
        (0..50).for_each(|_| world.cycle());
        let said = texts(&mut world);
        assert!(
            said.contains("finds no joints for this pose") && world.runtime() == Runtime::Stopped,
            "{said}"
        );
    }
}

#[test]
fn a_refused_last_line_leaves_the_program_before_it_alone() {
    for last in ["prog()\n", "prog(\n", "x = 1 / 0 +\n", "fly_away(3)\n"] {
        let mut world = world(Series::Cb3);
        let text =
            format!("def prog():\n  textmsg(\"begin\")\n  sleep(1.5)\n  textmsg(\"end\")\nend\n{last}");
        let programs = crate::script::Uploads::default().take(text.as_bytes()).unwrap();
        assert_eq!(programs.len(), 2);
        for program in programs {
            world.arrive(crate::arrival::Arrival::read(&program)).unwrap();
        }
        (0..250).for_each(|_| world.cycle());
        let said = texts(&mut world);
        assert!(said.contains("begin") && said.contains("\"end\""), "{last}: {said}");
        assert_eq!(said.matches("RuntimeException").count(), 1, "{last}: {said}");
    }
}

/// A driver's side: takes a connection and talks to it.
fn server(talk: impl FnOnce(std::net::TcpStream) + Send + 'static) -> (u16, std::thread::JoinHandle<()>) {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    let thread = std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        talk(stream);
    });
    (port, thread)
}

/// Our own program with the calls of the maker's external control: it calls its driver back, and a thread
/// servos to what the driver sends.
#[test]
fn a_driver_that_is_called_back_moves_the_arm() {
    let (port, driver) = server(|mut stream| {
        let mut hello = [0; 4];
        stream.read_exact(&mut hello).unwrap();
        assert_eq!(i32::from_be_bytes(hello), 42);
        for step in 1..=100 {
            let mut message = Vec::new();
            // Time-out, six joints in micro-radians off the beginning, mode.
            for number in [20, 1000 * step, 0, 0, 0, 0, 0, 1] {
                message.extend_from_slice(&i32::to_be_bytes(number));
            }
            stream.write_all(&message).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
        // The servo comes to rest at the last target.
        std::thread::sleep(Duration::from_millis(500));
        let last: Vec<u8> = [0, 0, 0, 0, 0, 0, 0, -2].into_iter().flat_map(i32::to_be_bytes).collect();
        stream.write_all(&last).unwrap();
        let mut bye = [0; 5];
        stream.read_exact(&mut bye).unwrap();
        assert_eq!(&bye, b"done\n");
    });
    let mut world = world(Series::E);
    let from = world.robot.actual().q[0];
    world.take_script(&format!(
        "def external():\n  global target = get_joint_positions()\n  global begin = get_joint_positions()\n  \
         global running = True\n  thread servo():\n    while running:\n      enter_critical\n      \
         q = target\n      exit_critical\n      \
         servoj(q, t=get_steptime(), lookahead_time=0.03, gain=2000)\n    end\n    stopj(4)\n  end\n  \
         if not socket_open(\"127.0.0.1\", {port}, \"reverse_socket\"):\n    \
         popup(\"no driver\", title=\"External\", blocking=False, error=True)\n    halt\n  end\n  \
         socket_send_int(42, \"reverse_socket\")\n  thread_move = run servo()\n  mode = 0\n  \
         while mode != -2:\n    \
         params = socket_read_binary_integer(8, \"reverse_socket\", 5)\n    if params[0] > 0:\n      \
         mode = params[8]\n      if mode == 1:\n        enter_critical\n        i = 0\n        \
         while i < 6:\n          target[i] = begin[i] + params[i + 2] / 1000000\n          \
         i = i + 1\n        end\n        exit_critical\n      \
         end\n    else:\n      mode = -2\n    end\n  end\n  running = False\n  join thread_move\n  \
         socket_send_line(\"done\", \"reverse_socket\")\n  socket_close(\"reverse_socket\")\nend\n"
    ));
    live(&mut world, 30_000);
    driver.join().unwrap();
    let said = texts(&mut world);
    assert_eq!(world.runtime(), Runtime::Stopped, "{said}");
    assert!(!said.contains("RuntimeException"), "{said}");
    assert!((world.robot.actual().q[0] - from - 0.1).abs() < 0.01, "{:?}", world.robot.actual());
}

#[test]
fn every_reading_call_reads_what_the_manual_says() {
    let (port, driver) = server(|mut stream| {
        stream.write_all(b"( 1.414 , 3.14159, 1.616, 0.0 )").unwrap();
        stream.write_all(&[1, 2, 255, 0, 0, 0, 7, 0xff, 0xff, 0xff, 0xfe]).unwrap();
        stream.write_all(b"a line\r\n>hello<>world<").unwrap();
        let mut got = [0; 10];
        stream.read_exact(&mut got).unwrap();
        assert_eq!(&got, b"GET POS_X\n");
        stream.write_all(b"POS_X 2200\n").unwrap();
        let mut got = [0; 17];
        stream.read_exact(&mut got).unwrap();
        assert_eq!(&got, b"SET POS_Y -5\nab\x03\x00");
        // Keeps the line open for what times out.
        std::thread::sleep(Duration::from_millis(400));
    });
    let mut world = world(Series::E);
    world.take_script(&format!(
        "def r():\n  textmsg(\"open \", socket_open(\"localhost\", {port}))\n  \
         textmsg(\"floats \", socket_read_ascii_float(4))\n  textmsg(\"bytes \", socket_read_byte_list(3))\n  \
         textmsg(\"ints \", socket_read_binary_integer(2))\n  textmsg(\"line \", socket_read_line())\n  \
         textmsg(\"first \", socket_read_string(prefix=\">\", suffix=\"<\"))\n  \
         textmsg(\"second \", socket_read_string(prefix=\">\", suffix=\"<\"))\n  \
         textmsg(\"var \", socket_get_var(\"POS_X\"))\n  socket_set_var(\"POS_Y\", -5)\n  \
         socket_send_string(\"ab\")\n  socket_send_byte(3)\n  socket_send_byte(0)\n  \
         textmsg(\"late \", socket_read_binary_integer(2, timeout=0.05))\n  \
         if socket_read_string(timeout=0.05):\n    textmsg(\"never\")\n  end\n  \
         textmsg(\"none \", socket_read_byte_list(1, \"nowhere\"))\n  \
         textmsg(\"closed \", socket_send_line(\"x\", \"nowhere\"))\nend\n"
    ));
    live(&mut world, 30_000);
    let said = texts(&mut world);
    driver.join().unwrap();
    for text in [
        "open True",
        "floats [4, 1.414, 3.14159, 1.616, 0.0]",
        "bytes [3, 1, 2, 255]",
        "ints [2, 7, -2]",
        "line a line",
        "first hello",
        "second world",
        "var 2200",
        "late [0, -1, -1]",
        "none [0, -1]",
        "closed False",
    ] {
        assert!(said.contains(&format!("{text}\"")), "{text}: {said}");
    }
    assert!(!said.contains("never") && !said.contains("RuntimeException"), "{said}");
}

#[test]
fn other_hosts_are_connected_to_with_leave_only_and_what_does_not_read_is_bounded() {
    let mut world = world(Series::E);
    world.take_script(
        "def o():\n  textmsg(\"far \", socket_open(\"192.0.2.1\", 80))\n  \
         textmsg(\"name \", socket_open(\"example.invalid\", 80))\nend\n",
    );
    live(&mut world, 2000);
    let said = texts(&mut world);
    assert!(said.contains("far False") && said.contains("name False"), "{said}");
    assert!(said.contains("--program-sockets any"), "{said}");
    let (port, driver) = server(|stream| {
        std::thread::sleep(Duration::from_millis(800));
        drop(stream);
    });
    world.take_script(&format!(
        "def f():\n  socket_open(\"127.0.0.1\", {port}, \"s\")\n  a = \"{}\"\n  n = 0\n  \
         while socket_send_string(a, \"s\") and n < 100000:\n    n = n + 1\n    sync()\n  end\n  \
         textmsg(\"full \", n < 100000)\nend\n",
        "0123456789abcdef".repeat(500)
    ));
    live(&mut world, 20_000);
    assert!(texts(&mut world).contains("full True"));
    driver.join().unwrap();
}
