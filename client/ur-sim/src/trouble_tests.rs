//! Claims about troubles of the network, as a client feels them.

use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::*;
use foretrace_ur::rtde::{RtdeClient, RtdeValue};

const PATIENCE: Duration = Duration::from_secs(10);

fn start() -> (Controller, RtdeClient) {
    let controller =
        Controller::start(ControllerOptions { ephemeral_ports: true, ..ControllerOptions::new(Series::E) })
            .unwrap();
    let mut client = RtdeClient::connect(controller.address(Service::Rtde).unwrap(), PATIENCE).unwrap();
    client.set_up_outputs(&["timestamp", "input_int_register_30"], 500.0).unwrap();
    client.start().unwrap();
    (controller, client)
}

fn receive(client: &mut RtdeClient) -> Vec<RtdeValue> {
    client.receive(PATIENCE).unwrap().expect("no package").values
}

/// The controller's own clock \[s\].
fn clock(controller: &Controller) -> f64 {
    let status: serde_json::Value = serde_json::from_str(&controller.status()).unwrap();
    status["timestamp_s"].as_f64().unwrap()
}

#[test]
fn a_cut_network_holds_both_ways_and_keeps_the_connection() {
    let (controller, mut client) = start();
    let inputs = client.set_up_inputs(&["input_int_register_30"]).unwrap();
    receive(&mut client);
    assert_eq!(controller.obey("cut 0.6"), "ok");
    let cut = Instant::now();
    // What was on its way still comes.
    while client.receive(Duration::from_millis(100)).unwrap().is_some() {
        assert!(cut.elapsed() < PATIENCE, "never cut");
    }
    client.send(&inputs, &[RtdeValue::Int32(5)]).unwrap();
    let back = loop {
        let values = receive(&mut client);
        if values[1] == RtdeValue::Int32(5) {
            break cut.elapsed();
        }
        assert!(cut.elapsed() < PATIENCE, "never back");
    };
    assert!(back >= Duration::from_millis(600), "{back:?}");
}

#[test]
fn delayed_packages_come_in_order_and_that_much_later() {
    let (controller, mut client) = start();
    assert_eq!(controller.obey("delay 100"), "ok");
    assert_eq!(controller.obey("jitter 20"), "ok");
    let began = Instant::now();
    let mut last = 0.0;
    while began.elapsed() < Duration::from_millis(500) {
        let before = clock(&controller);
        let stamp = receive(&mut client)[0].double().unwrap();
        assert!(stamp > last, "{last} {stamp}");
        last = stamp;
        // The first ones left before the delay.
        if began.elapsed() > Duration::from_millis(300) {
            assert!(clock(&controller) - stamp >= 0.098, "{before} {stamp}");
        }
    }
}

#[test]
fn an_arm_that_breaks_is_reported_by_its_controller_when_targets_go_on() {
    let (controller, mut client) = start();
    let mut script = std::net::TcpStream::connect(controller.address(Service::Primary).unwrap()).unwrap();
    let text = "def m():\n  q = get_target_joint_positions()\n  while True:\n    q[0] = q[0] + 0.002\n    \
                servoj(q, t=0.002, lookahead_time=0.03, gain=300)\n  end\nend\n";
    std::io::Write::write_all(&mut script, text.as_bytes()).unwrap();
    client.set_up_outputs(&["actual_qd", "safety_mode"], 500.0).unwrap();
    client.start().unwrap();
    let began = Instant::now();
    while receive(&mut client)[0].vector6d().unwrap()[0] < 0.99 {
        assert!(began.elapsed() < PATIENCE, "never moved");
    }
    assert_eq!(controller.obey("arm stuck"), "ok");
    while receive(&mut client)[1] != RtdeValue::Int32(3) {
        assert!(began.elapsed() < 2 * PATIENCE, "never stopped");
    }
    assert!(controller.status().contains("C153A0"));
}

fn open(controller: &Controller, service: Service) -> BufReader<TcpStream> {
    let stream = TcpStream::connect(controller.address(service).unwrap()).unwrap();
    stream.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    BufReader::new(stream)
}

/// The next line, if one comes soon.
fn line(stream: &mut BufReader<TcpStream>) -> Option<String> {
    let mut line = String::new();
    match stream.read_line(&mut line) {
        Ok(_) => Some(line.trim().to_owned()),
        Err(error) => {
            assert!(matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut), "{error}");
            None
        }
    }
}

#[test]
fn who_connects_over_a_cut_line_hears_nothing_until_it_is_whole() {
    let (controller, _client) = start();
    assert_eq!(controller.obey("cut 600"), "ok");
    let mut calls = [Service::Dashboard, Service::Primary].map(|service| open(&controller, service));
    for call in &mut calls {
        assert!(call.fill_buf().is_err(), "a greeting came over a cut line");
    }
    let [mut dashboard, _primary] = calls;
    assert_eq!(controller.obey("cut 0"), "ok");
    let cut = Instant::now();
    let greeting = loop {
        if let Some(greeting) = line(&mut dashboard) {
            break greeting;
        }
        assert!(cut.elapsed() < PATIENCE, "never greeted");
    };
    assert!(greeting.starts_with("Connected"), "{greeting}");
}

#[test]
fn calls_that_are_given_up_during_a_cut_take_nobodys_place() {
    let (controller, _client) = start();
    assert_eq!(controller.obey("cut 600"), "ok");
    let before = controller.connections();
    for _ in 0..3 * listen::MOST_CONNECTIONS {
        drop(open(&controller, Service::Dashboard));
        // The port looks for calls in the meantime.
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(controller.connections(), before);
    assert_eq!(controller.obey("cut 0"), "ok");
    let began = Instant::now();
    let mut dashboard = open(&controller, Service::Dashboard);
    while !line(&mut dashboard).is_some_and(|greeting| greeting.starts_with("Connected")) {
        assert!(began.elapsed() < PATIENCE, "no place");
    }
}

#[test]
fn the_fault_port_mends_the_cut_that_it_made() {
    let (controller, _client) = start();
    let mut faults = open(&controller, Service::Faults);
    let mut ask = |order: &str| {
        faults.get_mut().write_all(format!("{order}\n").as_bytes()).unwrap();
        let asked = Instant::now();
        loop {
            if let Some(answer) = line(&mut faults) {
                return answer;
            }
            assert!(asked.elapsed() < PATIENCE, "{order}: no answer");
        }
    };
    assert_eq!(ask("cut 600"), "ok");
    assert_eq!(ask("slider 0.5"), "ok");
    assert_eq!(ask("cut 0"), "ok");
}

#[test]
fn one_client_is_cut_off_while_another_still_sees() {
    let trouble = trouble::Trouble::default();
    let address = |text: &str| text.parse::<std::net::IpAddr>().unwrap();
    let [bridge, mapped, watcher] = ["127.0.0.1", "::ffff:127.0.0.1", "127.0.0.7"].map(address);
    let (long, none) = (Duration::from_secs(600), Duration::ZERO);
    assert!(trouble.cut(long, Some(bridge)));
    assert!(trouble.is_cut(bridge) && trouble.is_cut(mapped) && !trouble.is_cut(watcher));
    assert!(trouble.cut(none, Some(bridge)));
    assert!(!trouble.is_cut(bridge));
    for last in 1..=20 {
        let whose = address(&format!("127.0.0.{last}"));
        assert_eq!(trouble.cut(long, Some(whose)), last <= 16);
    }
    assert!(trouble.cut(none, None));
    assert!(!trouble.is_cut(bridge) && !trouble.is_cut(watcher));

    let (controller, mut client) = start();
    assert_eq!(controller.obey("cut 600 127.0.0.7"), "ok");
    let (first, began) = (receive(&mut client)[0].double().unwrap(), Instant::now());
    while receive(&mut client)[0].double().unwrap() < first + 0.2 {
        assert!(began.elapsed() < PATIENCE, "cut off as well");
    }
    assert_eq!(controller.obey("cut 600 127.0.0.1"), "ok");
    while client.receive(Duration::from_millis(100)).unwrap().is_some() {
        assert!(began.elapsed() < PATIENCE, "not cut off");
    }
}

#[test]
fn the_clock_goes_on_while_a_long_program_is_read() {
    let (controller, mut client) = start();
    let body = "  a = [1, 2, 3] + [4, 5, 6] * sin(cos(1.5) + 2)\n".repeat(20_000);
    let text = format!("def long():\n{body}end\n");
    let began = Instant::now();
    assert!(crate::script::Program::parse(&text).is_ok());
    let takes = began.elapsed();
    let mut script = TcpStream::connect(controller.address(Service::Primary).unwrap()).unwrap();
    let writer = std::thread::spawn(move || script.write_all(text.as_bytes()).map(|()| script));
    let (began, mut last, mut longest) = (Instant::now(), Instant::now(), Duration::ZERO);
    let named = || controller.status().contains("\"program\":\"long\"");
    while !named() {
        receive(&mut client);
        longest = longest.max(last.elapsed());
        last = Instant::now();
        assert!(began.elapsed() < 6 * PATIENCE, "never there");
    }
    drop(writer.join());
    assert!(longest < takes / 2, "no package for {longest:?} while a program was read for {takes:?}");
}
