//! Claims about troubles of the network, as a client feels them.

use std::time::{Duration, Instant};

use super::*;
use crate::rtde::{Client, Value};

const PATIENCE: Duration = Duration::from_secs(10);

fn start() -> (Controller, Client) {
    let controller = Controller::start(Options { ephemeral_ports: true, ..Options::new(Series::E) }).unwrap();
    let mut client = Client::connect(controller.address(Service::Rtde).unwrap(), PATIENCE).unwrap();
    client.set_up_outputs(&["timestamp", "input_int_register_30"], 500.0).unwrap();
    client.start().unwrap();
    (controller, client)
}

fn receive(client: &mut Client) -> Vec<Value> {
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
    client.send(&inputs, &[Value::Int32(5)]).unwrap();
    let back = loop {
        let values = receive(&mut client);
        if values[1] == Value::Int32(5) {
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
fn an_arm_that_breaks_is_told_by_its_controller_when_targets_go_on() {
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
    while receive(&mut client)[1] != Value::Int32(3) {
        assert!(began.elapsed() < 2 * PATIENCE, "never stopped");
    }
    assert!(controller.status().contains("C153A0"));
}
