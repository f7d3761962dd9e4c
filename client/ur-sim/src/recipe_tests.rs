//! Claims about RTDE recipes: long ones, rates, what came with which version.

use super::options::{ControllerOptions, Series};
use super::rtde_server::RtdeSession;
use super::world::World;
use foretrace_ur::rtde::frames::Frames;

struct Client {
    session: RtdeSession,
    world: World,
}

impl Client {
    fn new(options: ControllerOptions) -> Self {
        let mut client = Self { session: RtdeSession::new(1, &options), world: World::new(options) };
        assert_eq!(client.ask(b'V', &[0, 2]), [(b'V', vec![1])]);
        client
    }

    fn ask(&mut self, kind: u8, payload: &[u8]) -> Vec<(u8, Vec<u8>)> {
        let replies = self.session.answer(kind, payload, &mut self.world);
        replies.iter().map(|bytes| unpacked(bytes)).collect()
    }

    /// The answer to a recipe: its number and the words.
    fn outputs(&mut self, frequency: f64, names: &str) -> (u8, String) {
        let payload = [&frequency.to_be_bytes()[..], names.as_bytes()].concat();
        let (kind, answer) = self.ask(b'O', &payload).pop().unwrap();
        assert_eq!(kind, b'O');
        (answer[0], String::from_utf8(answer[1..].to_vec()).unwrap())
    }
}

fn unpacked(bytes: &[u8]) -> (u8, Vec<u8>) {
    let mut frames = Frames::default();
    frames.feed(bytes);
    let (kind, payload) = frames.next_package().unwrap().unwrap();
    (kind, payload.to_vec())
}

#[test]
fn recipes_beyond_two_kilobytes_of_names_are_served_up_to_what_a_package_holds() {
    for series in [Series::Cb3, Series::E] {
        let mut client = Client::new(ControllerOptions::new(series));
        let names: Vec<String> = (0..48)
            .flat_map(|n| {
                ["input_int", "output_int", "input_double", "output_double"]
                    .map(|kind| format!("{kind}_register_{n}"))
            })
            .chain((64..128).map(|n| format!("output_bit_register_{n}")))
            .collect();
        let list = names.join(",");
        assert!(list.len() > 5000);
        let (id, types) = client.outputs(f64::from(series.rate_hz()), &list);
        assert_eq!((id, types.split(',').count()), (1, names.len()));
        client.ask(b'S', &[]);
        client.world.cycle();
        let (kind, data) = unpacked(&client.session.package(&client.world).unwrap());
        assert_eq!((kind, data.len()), (b'U', 1 + 96 * 4 + 96 * 8 + 64));
        // The same field a thousand times: as large as a package may be, but one value.
        let (id, _) = client.outputs(10.0, &vec!["actual_q"; 1365].join(","));
        assert_eq!(id, 1);
        client.ask(b'S', &[]);
        let package = (0..200).find_map(|_| {
            client.world.cycle();
            client.session.package(&client.world)
        });
        assert_eq!(package.unwrap().len(), 3 + 1 + 1365 * 48);
        // One more does not fit, neither does an answer that is longer than the question.
        for names in
            [vec!["actual_q"; 1366].join(","), vec!["a"; 20_000].join(","), vec!["x"; 7000].join(",")]
        {
            assert_eq!(client.outputs(10.0, &names), (0, String::new()));
        }
        let answer = client.ask(b'I', vec!["a"; 10_000].join(",").as_bytes()).pop().unwrap();
        assert_eq!(answer, (b'I', vec![0]));
    }
}

#[test]
fn a_rate_that_the_series_does_not_do_is_refused_as_a_whole() {
    for (series, rate) in [(Series::Cb3, 125.0), (Series::E, 500.0)] {
        let mut client = Client::new(ControllerOptions::new(series));
        assert_eq!(client.outputs(rate, "timestamp"), (1, "DOUBLE".to_owned()));
        for wrong in [rate + 1.0, 4.0 * rate, 0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(client.outputs(wrong, "timestamp,actual_q"), (0, String::new()), "{series} {wrong}");
            // Nothing of it begins, nor goes on of what there was.
            assert_eq!(client.ask(b'S', &[]).pop().unwrap(), (b'S', vec![0]));
            client.world.cycle();
            assert_eq!(client.session.package(&client.world), None);
        }
        assert_eq!(client.outputs(rate, "timestamp,nothing"), (0, "DOUBLE,NOT_FOUND".to_owned()));
    }
}

#[test]
fn the_tools_offset_is_told_since_its_version() {
    for (series, minor, bugfix, has) in [
        (Series::Cb3, 15, 8, true),
        (Series::Cb3, 12, 0, true),
        (Series::Cb3, 11, 9, false),
        (Series::E, 11, 1, true),
        (Series::E, 5, 1, true),
        (Series::E, 5, 0, false),
    ] {
        let mut options = ControllerOptions::new(series);
        (options.version.minor, options.version.bugfix) = (minor, bugfix);
        let mut client = Client::new(options);
        let (id, types) = client.outputs(100.0, "timestamp,actual_q,tcp_offset");
        let word = if has { "VECTOR6D" } else { "NOT_FOUND" };
        assert_eq!(
            (id, types),
            (u8::from(has), format!("DOUBLE,VECTOR6D,{word}")),
            "{series} {minor}.{bugfix}"
        );
    }
}

/// The guide: the rate is that of the cycle over the whole part of the quotient.
#[test]
fn packages_come_every_so_many_whole_cycles() {
    for (series, frequency, every) in [
        (Series::Cb3, 125.0, 1),
        (Series::Cb3, 100.0, 1),
        (Series::Cb3, 63.0, 1),
        (Series::Cb3, 62.5, 2),
        (Series::Cb3, 33.3, 3),
        (Series::Cb3, 1.0, 125),
        (Series::E, 500.0, 1),
        (Series::E, 400.0, 1),
        (Series::E, 125.0, 4),
        (Series::E, 30.0, 16),
        (Series::E, 1.0, 500),
    ] {
        let mut client = Client::new(ControllerOptions::new(series));
        assert_eq!(client.outputs(frequency, "timestamp").0, 1);
        client.ask(b'S', &[]);
        let due: Vec<u64> = (0..1200)
            .filter_map(|_| {
                client.world.cycle();
                client.session.package(&client.world).map(|_| client.world.robot.cycle)
            })
            .collect();
        assert!(due.len() >= 2, "{series:?} {frequency}");
        assert!(due.windows(2).all(|two| two[1] - two[0] == every), "{series:?} {frequency}: {due:?}");
    }
}

#[test]
fn rates_below_one_are_refused_like_those_above_the_cycles() {
    for series in [Series::Cb3, Series::E] {
        for frequency in [0.99, 0.0, -1.0, f64::NAN, f64::INFINITY, f64::from(series.rate_hz()) + 0.1] {
            let mut client = Client::new(ControllerOptions::new(series));
            assert_eq!(client.outputs(frequency, "timestamp"), (0, String::new()), "{frequency}");
        }
    }
}

#[test]
fn the_tools_output_modes_are_those_that_a_program_sets() {
    let mut client = Client::new(ControllerOptions::new(Series::E));
    let names = "tool_digital_output0_mode,tool_digital_output1_mode,payload_inertia";
    assert_eq!(client.outputs(500.0, names), (1, "UINT8,UINT8,VECTOR6D".to_owned()));
    client.ask(b'S', &[]);
    client.world.take_script(
        "def m():\n  set_tool_digital_output_mode(0, 2)\n  set_tool_digital_output_mode(1, 3)\n  \
         set_target_payload(1, [0, 0, 0.1], [0.5, 1, 2, 0, 0, 0])\nend\n",
    );
    (0..3).for_each(|_| client.world.cycle());
    let (_, data) = unpacked(&client.session.package(&client.world).unwrap());
    let inertia: Vec<u8> = [0.5, 1.0, 2.0, 0.0, 0.0, 0.0].into_iter().flat_map(f64::to_be_bytes).collect();
    assert_eq!(data, [&[1, 2, 3][..], &inertia].concat());
}
