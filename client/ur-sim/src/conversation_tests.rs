//! Claims about a whole controller over its sockets: conversations, hostile bytes, clients that do not read.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::*;
use foretrace_ur::rtde::{RtdeClient, RtdeError, RtdeValue};

const PATIENCE: Duration = Duration::from_secs(10);

fn start(series: Series) -> Controller {
    Controller::start(ControllerOptions { ephemeral_ports: true, ..ControllerOptions::new(series) }).unwrap()
}

fn at(controller: &Controller, service: Service) -> SocketAddr {
    controller.address(service).unwrap()
}

fn open(controller: &Controller, service: Service) -> TcpStream {
    let stream = TcpStream::connect(at(controller, service)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.set_write_timeout(Some(PATIENCE)).unwrap();
    stream.set_nodelay(true).unwrap();
    stream
}

/// One RTDE package: type and payload.
fn package(stream: &mut TcpStream) -> (u8, Vec<u8>) {
    let mut header = [0; 3];
    stream.read_exact(&mut header).unwrap();
    let mut payload = vec![0; usize::from(u16::from_be_bytes([header[0], header[1]])) - 3];
    stream.read_exact(&mut payload).unwrap();
    (header[2], payload)
}

/// The next package of this type.
fn wait_for(stream: &mut TcpStream, kind: u8) -> Vec<u8> {
    loop {
        let (is, payload) = package(stream);
        if is == kind {
            return payload;
        }
    }
}

fn send(stream: &mut TcpStream, kind: u8, payload: &[u8]) {
    let size = u16::try_from(payload.len() + 3).unwrap();
    stream.write_all(&[&size.to_be_bytes()[..], &[kind], payload].concat()).unwrap();
}

fn line(stream: &mut TcpStream) -> String {
    let mut line = Vec::new();
    let mut byte = [0];
    while stream.read(&mut byte).unwrap() == 1 && byte != *b"\n" {
        line.push(byte[0]);
    }
    String::from_utf8(line).unwrap()
}

fn receive(client: &mut RtdeClient) -> Vec<RtdeValue> {
    client.receive(PATIENCE).unwrap().expect("no package").values
}

#[test]
fn a_control_client_sets_up_uploads_and_talks_through_registers() {
    let controller = start(Series::E);
    let mut rtde = open(&controller, Service::Rtde);
    rtde.write_all(&[0, 5, 86, 0, 2]).unwrap();
    assert_eq!(package(&mut rtde), (b'V', vec![1]));
    rtde.write_all(&[0, 3, 118]).unwrap();
    let version = wait_for(&mut rtde, b'v');
    assert_eq!((version.len(), version[3]), (16, 5));
    let outputs = b"robot_status_bits,safety_status_bits,runtime_state,output_int_register_0,";
    send(&mut rtde, b'O', &[&500f64.to_be_bytes()[..], outputs].concat());
    assert_eq!(wait_for(&mut rtde, b'O'), [&[1], &b"UINT32,UINT32,UINT32,INT32"[..]].concat());
    // 23 recipes over the same registers on one connection, with trailing commas; counted from 1.
    for recipe in 1..=23u8 {
        send(&mut rtde, b'I', b"input_int_register_0,input_double_register_0,");
        assert_eq!(wait_for(&mut rtde, b'I'), [&[recipe], &b"INT32,DOUBLE"[..]].concat());
    }
    send(&mut rtde, b'S', &[]);
    assert_eq!(wait_for(&mut rtde, b'S'), [1]);
    let first = wait_for(&mut rtde, b'U');
    assert_eq!((first.len(), first[0]), (17, 1));

    let mut script = open(&controller, Service::RealTime);
    script
        .write_all(
            b"def rtde_control():\n  write_output_integer_register(0, 1)\n  cmd = 0\n  \
              while cmd != 255:\n    \
              cmd = read_input_integer_register(0)\n    if cmd == 7:\n      \
              write_output_integer_register(0, 2)\n    end\n    sync()\n  end\nend\n",
        )
        .unwrap();
    let mut out = rtde.try_clone().unwrap();
    let mut until = |runtime: u32, register: i32| {
        for _ in 0..5000 {
            let data = wait_for(&mut rtde, b'U');
            let number = |at: usize| u32::from_be_bytes(data[at..at + 4].try_into().unwrap());
            if number(9) == runtime && number(13).cast_signed() == register {
                return;
            }
        }
        panic!("never {runtime} {register}");
    };
    until(2, 1);
    let mut command = |recipe: u8, command: i32| {
        send(&mut out, b'U', &[&[recipe], &command.to_be_bytes()[..], &0.5f64.to_be_bytes()].concat());
    };
    command(2, 7);
    until(2, 2);
    command(23, 255);
    until(1, 2);
}

#[test]
fn an_input_is_in_use_until_its_connection_ends() {
    let controller = start(Series::Cb3);
    let rtde = at(&controller, Service::Rtde);
    let mut first = RtdeClient::connect(rtde, PATIENCE).unwrap();
    let mut second = RtdeClient::connect(rtde, PATIENCE).unwrap();
    first.set_up_inputs(&["input_int_register_24", "input_int_register_25"]).unwrap();
    let denied = second.set_up_inputs(&["input_int_register_26", "input_int_register_25"]);
    assert!(matches!(denied, Err(RtdeError::InUse(name)) if name == "input_int_register_25"));
    // What was refused claims nothing.
    first.set_up_inputs(&["input_int_register_26"]).unwrap();
    drop(first);
    let freed = Instant::now();
    while second.set_up_inputs(&["input_int_register_25"]).is_err() {
        assert!(freed.elapsed() < PATIENCE, "never freed");
    }
    let missing = second.set_up_outputs(&["timestamp", "ft_raw_wrench"], 125.0);
    assert!(matches!(missing, Err(RtdeError::NotFound(name)) if name == "ft_raw_wrench"));
    assert!(matches!(second.start(), Err(RtdeError::Refused(_))));
    assert!(matches!(second.set_up_outputs(&["timestamp"], 126.0), Err(RtdeError::Refused(_))));
}

#[test]
fn timestamps_are_whole_cycles_and_a_client_that_does_not_read_stalls_nobody() {
    for series in [Series::Cb3, Series::E] {
        let controller = start(series);
        let rate = f64::from(series.rate_hz());
        let mut deaf: Vec<RtdeClient> = Vec::new();
        for _ in 0..3 {
            let mut client = RtdeClient::connect(at(&controller, Service::Rtde), PATIENCE).unwrap();
            let all =
                ["timestamp", "actual_q", "target_q", "actual_qd", "actual_TCP_pose", "actual_TCP_speed"];
            client.set_up_outputs(&all, rate).unwrap();
            client.start().unwrap();
            deaf.push(client);
        }
        // These are sent 0.5 MB a second and never read either.
        let _deaf_real_time = open(&controller, Service::RealTime);
        let _deaf_primary = open(&controller, Service::Primary);
        let mut client = RtdeClient::connect(at(&controller, Service::Rtde), PATIENCE).unwrap();
        client.set_up_outputs(&["timestamp"], rate).unwrap();
        client.start().unwrap();
        let mut last = receive(&mut client)[0].double().unwrap();
        let (first, began) = (last, Instant::now());
        while began.elapsed() < Duration::from_millis(1500) {
            let now = receive(&mut client)[0].double().unwrap();
            let cycles = (now - last) * rate;
            assert!(cycles > 0.5 && (cycles - cycles.round()).abs() < 1e-6, "{last} {now}");
            last = now;
        }
        let ratio = (last - first) / began.elapsed().as_secs_f64();
        // A busy machine may let the clock stand; it never goes faster.
        assert!((0.2..1.2).contains(&ratio), "{ratio}");
    }
}

#[test]
fn version_1_gives_packages_without_a_recipe_at_the_control_rate() {
    let controller = start(Series::Cb3);
    let mut rtde = open(&controller, Service::Rtde);
    send(&mut rtde, b'O', b"timestamp,robot_mode");
    assert_eq!(wait_for(&mut rtde, b'O'), b"DOUBLE,INT32");
    send(&mut rtde, b'S', &[]);
    let mut time = || {
        let data = wait_for(&mut rtde, b'U');
        assert_eq!((data.len(), &data[8..]), (12, &[0, 0, 0, 7][..]));
        f64::from_be_bytes(data[..8].try_into().unwrap())
    };
    let cycles = (time() - time()) / 0.008;
    assert!((cycles - cycles.round()).abs() < 1e-6);
}

#[test]
fn dashboard_primary_and_real_time_speak_first() {
    let controller = start(Series::E);
    let mut dashboard = open(&controller, Service::Dashboard);
    assert_eq!(line(&mut dashboard), "Connected: Universal Robots Dashboard Server");
    dashboard.write_all(b"robotmode\nPolyscopeVersion\n").unwrap();
    assert_eq!(line(&mut dashboard), "Robotmode: RUNNING");
    assert!(line(&mut dashboard).starts_with("URSoftware 5.11.1."));
    for service in
        [Service::Primary, Service::Secondary, Service::PrimaryReadOnly, Service::SecondaryReadOnly]
    {
        let mut client =
            foretrace_ur::primary::PrimaryClient::connect(at(&controller, service), PATIENCE).unwrap();
        let first = client.receive(PATIENCE).unwrap().unwrap();
        assert!(format!("{first:?}").contains("Version"), "{first:?}");
        let second = client.receive(PATIENCE).unwrap().unwrap();
        assert!(matches!(second, foretrace_ur::primary::PrimaryPackage::State(_)), "{second:?}");
    }
    let mut real_time = open(&controller, Service::RealTimeReadOnly);
    let mut size = [0; 4];
    real_time.read_exact(&mut size).unwrap();
    assert_eq!(i32::from_be_bytes(size), 1220);
}

#[test]
fn a_script_that_asks_for_the_unknown_is_reported_line_and_column() {
    let controller = start(Series::Cb3);
    let mut client =
        foretrace_ur::primary::PrimaryClient::connect(at(&controller, Service::Primary), PATIENCE).unwrap();
    let mut script = open(&controller, Service::Secondary);
    let mut told = |text: &str| {
        script.write_all(text.as_bytes()).unwrap();
        loop {
            if let Some(foretrace_ur::primary::PrimaryPackage::Message(message)) =
                client.receive(PATIENCE).unwrap()
                && let foretrace_ur::primary::MessageContent::RuntimeException { line, column, text } =
                    message.content
            {
                return (line, column, text);
            }
        }
    };
    let (line, column, text) = told("def a():\n  sync()\n  dance(1)\nend\n");
    assert_eq!((line, column), (3, 3));
    assert!(text.contains("dance"), "{text}");
    let (line, _, text) = told("def b():\n  force_mode(1)\nend\n");
    assert!(line == 2 && text.contains("force_mode is not simulated"), "{text}");
    let (line, ..) = told("def c():\n  servoj([1,2,3])\nend\n");
    assert_eq!(line, 2);
}

#[test]
fn a_reboot_and_a_switched_off_service_are_felt_and_pass() {
    let controller = start(Series::E);
    let rtde = at(&controller, Service::Rtde);
    let mut client = RtdeClient::connect(rtde, PATIENCE).unwrap();
    assert_eq!(controller.obey("reboot 0.3"), "ok");
    assert!(client.controller_version().is_err());
    let away = Instant::now();
    let mut again = loop {
        if let Ok(client) = RtdeClient::connect(rtde, PATIENCE) {
            break client;
        }
        assert!(away.elapsed() < PATIENCE, "never back");
    };
    again.set_up_outputs(&["robot_mode"], 500.0).unwrap();
    again.start().unwrap();
    assert_eq!(receive(&mut again), [RtdeValue::Int32(3)]);
    assert_eq!(controller.obey("service rtde off"), "ok");
    while again.receive(PATIENCE).is_ok() {
        assert!(away.elapsed() < 2 * PATIENCE, "never closed");
    }
    assert_eq!(controller.obey("service rtde on"), "ok");
    while RtdeClient::connect(rtde, PATIENCE).is_err() {
        assert!(away.elapsed() < 3 * PATIENCE, "never open again");
    }
}

#[test]
fn hostile_bytes_hurt_nobody_else() {
    let controller = start(Series::E);
    let mut client = RtdeClient::connect(at(&controller, Service::Rtde), PATIENCE).unwrap();
    client.set_up_outputs(&["timestamp", "robot_mode"], 500.0).unwrap();
    client.start().unwrap();
    let mut random = 0x1234_5678_9abc_def1u64;
    let mut draw = move || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as u32
    };
    let kinds = b"VvMUOISPx";
    for round in 0..150u32 {
        let service = Service::ALL[round as usize % Service::ALL.len()];
        let mut stream = open(&controller, service);
        let mut bytes: Vec<u8> = Vec::new();
        for _ in 0..draw() % 20 {
            let length = draw() % 300;
            let payload: Vec<u8> = (0..length).map(|_| (draw() & 0xff) as u8).collect();
            if draw() % 3 > 0 {
                // A whole package of some type, with another size now and then.
                let off = if draw() % 10 == 0 { draw() % 9 } else { 3 };
                let size = u16::try_from(length + off).unwrap();
                bytes.extend_from_slice(&size.to_be_bytes());
                bytes.push(kinds[draw() as usize % kinds.len()]);
            }
            bytes.extend_from_slice(&payload);
            if draw() % 4 == 0 {
                bytes.push(b'\n');
            }
        }
        // It may be left amid the bytes.
        let _ = stream.write_all(&bytes);
    }
    let began = Instant::now();
    while controller.open_connections() > 1 {
        assert!(began.elapsed() < PATIENCE, "connections stay");
        std::thread::sleep(Duration::from_millis(10));
    }
    let before = receive(&mut client)[0].double().unwrap();
    let after = receive(&mut client);
    assert!(after[0].double().unwrap() > before && after[1] == RtdeValue::Int32(7), "{after:?}");
}

#[test]
fn more_connections_than_a_service_has_are_left_and_others_come_when_they_go() {
    let controller = start(Series::Cb3);
    let many: Vec<TcpStream> =
        (0..listen::MOST_CONNECTIONS).map(|_| open(&controller, Service::Dashboard)).collect();
    let mut greeted = many;
    for stream in &mut greeted {
        assert!(line(stream).starts_with("Connected"));
    }
    assert_eq!(line(&mut open(&controller, Service::Dashboard)), "");
    greeted.clear();
    let began = Instant::now();
    while !line(&mut open(&controller, Service::Dashboard)).starts_with("Connected") {
        assert!(began.elapsed() < PATIENCE, "never free");
    }
}

#[test]
fn a_watchdog_stops_the_program_whose_client_is_gone() {
    let controller = start(Series::E);
    let rtde = at(&controller, Service::Rtde);
    let mut client = RtdeClient::connect(rtde, PATIENCE).unwrap();
    let inputs = client.set_up_inputs(&["input_int_register_24"]).unwrap();
    client.send(&inputs, &[RtdeValue::Int32(1)]).unwrap();
    let mut script = open(&controller, Service::Primary);
    let text = "def w():\n  rtde_set_watchdog(\"input_int_register_24\", 10, \"stop\")\n  while True:\n    \
                speedj([0.2,0,0,0,0,0], 1, 0.002)\n  end\nend\n";
    script.write_all(text.as_bytes()).unwrap();
    let mut observer = RtdeClient::connect(rtde, PATIENCE).unwrap();
    observer.set_up_outputs(&["runtime_state", "actual_qd", "actual_q"], 500.0).unwrap();
    observer.start().unwrap();
    let fast = |values: &[RtdeValue]| values[1].vector6d().unwrap()[0];
    let began = Instant::now();
    while fast(&receive(&mut observer)) < 0.19 {
        client.send(&inputs, &[RtdeValue::Int32(1)]).unwrap();
        assert!(began.elapsed() < PATIENCE, "never moved");
    }
    drop(client);
    loop {
        let values = receive(&mut observer);
        if values[0] == RtdeValue::Uint32(1) && fast(&values).abs() < 1e-4 {
            break;
        }
        assert!(began.elapsed() < 2 * PATIENCE, "never stopped");
    }
}

#[test]
fn a_controller_that_is_shut_down_closes_its_ports_until_it_is_started_again() {
    let controller = start(Series::Cb3);
    let mut client = RtdeClient::connect(at(&controller, Service::Rtde), PATIENCE).unwrap();
    let mut dashboard = open(&controller, Service::Dashboard);
    line(&mut dashboard);
    dashboard.write_all(b"shutdown\n").unwrap();
    assert_eq!(line(&mut dashboard), "Shutting down");
    assert!(client.controller_version().is_err());
    let since = Instant::now();
    let services = [Service::Rtde, Service::Dashboard, Service::Primary, Service::RealTime];
    for service in services {
        while TcpStream::connect(at(&controller, service)).is_ok() {
            assert!(since.elapsed() < PATIENCE, "never closed");
        }
    }
    assert_eq!(controller.obey("reboot 0.1"), "ok");
    for service in services {
        while TcpStream::connect(at(&controller, service)).is_err() {
            assert!(since.elapsed() < 2 * PATIENCE, "never open again");
        }
    }
}
