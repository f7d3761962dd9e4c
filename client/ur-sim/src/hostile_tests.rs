//! Claims about bytes and texts of nobody, given straight to what answers them.

use std::fs;

use proptest::prelude::*;

use super::dashboard_server::{self, DashboardReply};
use super::faults;
use super::machine::MOST_MESSAGES;
use super::options::{ControllerOptions, Series};
use super::rtde_server::RtdeSession;
use super::trouble::Trouble;
use super::world::World;
use crate::script::Uploads;
use foretrace_ur::rtde::frames::Frames;
use foretrace_ur::rtde::wire::{ProtocolVersion, RtdeReply};

/// What a program may use up in a cycle, and what its last call may be beyond that.
const MOST_INSTRUCTIONS: u32 = 20_000 + 20_000;
/// Of this process: far above what the tests need, far below what something unbounded would take.
const MOST_KIB: u64 = 1 << 20;

/// The most memory that this process had.
fn peak_kib() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap();
    line.split_ascii_whitespace().nth(1).unwrap().parse().unwrap()
}

/// A package type with a payload that means something, or does not.
fn package() -> impl Strategy<Value = (u8, Vec<u8>)> {
    let names = prop::sample::select(vec![
        "timestamp,actual_q,",
        "input_int_register_24,input_int_register_24",
        "input_double_register_47,speed_slider_mask,speed_slider_fraction",
        "output_bit_register_127,robot_mode,,",
        "nothing",
    ]);
    prop_oneof![
        (any::<u8>(), prop::collection::vec(any::<u8>(), 0..100)),
        (prop::sample::select(&b"VvMSPU"[..]), prop::collection::vec(0u8..4, 0..40)),
        (prop::sample::select(&b"OI"[..]), any::<f64>(), names.clone())
            .prop_map(|(kind, hz, names)| (kind, [&hz.to_be_bytes()[..], names.as_bytes()].concat())),
        names.prop_map(|names| (b'I', names.as_bytes().to_vec())),
        Just((b'V', vec![0, 2])),
        Just((b'S', vec![])),
    ]
}

proptest! {
    #![proptest_config(crate::fuzz::cases(300))]

    #[test]
    fn any_conversation_is_answered_in_whole_packages(packages in prop::collection::vec(package(), 0..40)) {
        let mut world = World::new(ControllerOptions::new(Series::E));
        let mut session = RtdeSession::new(1, &ControllerOptions::new(Series::E));
        let mut version = ProtocolVersion::V1;
        for (kind, payload) in packages {
            let replies = session.answer(kind, &payload, &mut world);
            prop_assert!(replies.len() <= 2);
            for bytes in replies {
                let mut frames = Frames::default();
                frames.feed(&bytes);
                let (kind, payload) = frames.next_package().unwrap().unwrap();
                prop_assert!(RtdeReply::decode(kind, payload, version).is_ok());
                prop_assert_eq!(bytes.len(), payload.len() + 3);
            }
            if kind == b'V' && payload.len() == 2 && payload[0] == 0 {
                version = ProtocolVersion::from_number(payload[1].into()).unwrap_or(version);
            }
            world.cycle();
            let _ = session.package(&world);
        }
        prop_assert!(world.robot.actual().q.iter().all(|q| q.is_finite()));
    }

    #[test]
    fn any_line_is_answered_by_one_line(
        line in "\\PC{0,60}",
        word in "(load|popup|slider|tcp|arm|cut|service|reboot)",
    ) {
        let mut world = World::new(ControllerOptions::new(Series::Cb3));
        for line in [line.clone(), format!("{word} {line}")] {
            let answer = match dashboard_server::answer(&mut world, &line) {
                DashboardReply::Line(text) | DashboardReply::Last(text) | DashboardReply::Off(text) => text,
            };
            prop_assert!(!answer.contains('\n'));
            prop_assert!(!faults::obey(&mut world, &Trouble::default(), &line).contains('\n'));
            world.cycle();
        }
    }

    #[test]
    fn any_script_leaves_a_controller_that_goes_on(
        pieces in prop::collection::vec(prop::sample::select(vec![
            "def p():\n", "end\n", "  while True:\n", "  sync()\n", "servoj([", "1e308,", "0,0,0,0,0", "])\n",
            "movej(", "get_actual_joint_positions()", ")\n", "speedj([9,9,9,9,9,9], 1e9, 0.1)\n",
            "stopj(0.0001)\n", "# ", "\"", "write_output_integer_register(0, 1e300)\n",
            "set_tcp(p[0,0,0,9,9,9])\n",
            "thread t():\n", "run t()\n", "sleep(1e300)\n", "read_input_float_register(-1)\n",
            "rtde_set_watchdog(\"x\", 0)\n", "\u{0}", "é",
            "rtde_set_watchdog(\"input_int_register_24\", 0.1)\n", "textmsg(a)\n", "a = make_list(4096, 1)\n",
            "a = a + a\n", "a = \"\"\n", "a = str_cat(a, a)\n", "get_inverse_kin(p[9,0,0,0,0,0])\n",
        ]), 0..30),
    ) {
        let mut world = World::new(ControllerOptions::new(Series::Cb3));
        let mut text = Uploads::default();
        let mut programs = text.take(pieces.concat().as_bytes()).unwrap();
        programs.extend(text.finish());
        programs.push(String::new());
        for program in programs {
            world.take_script(&program);
            for _ in 0..5 {
                world.cycle();
                // A cycle that took more would be late, and a controller that kept more would grow.
                let held = world.held();
                prop_assert!(held.instructions <= MOST_INSTRUCTIONS, "{held:?}");
                prop_assert!(held.threads <= 32 && held.waits <= held.threads, "{held:?}");
                prop_assert!(held.messages <= MOST_MESSAGES && held.watchdogs <= 64, "{held:?}");
            }
        }
        let joints = world.robot.actual();
        prop_assert!(joints.q.iter().chain(&joints.qd).all(|number| number.is_finite()));
        prop_assert!(peak_kib() < MOST_KIB, "{} KiB", peak_kib());
    }
}
