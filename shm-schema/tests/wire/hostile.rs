//! Random bytes as messages: nothing panics, and whatever passes validation is within its range.
//!
//! FORETRACE_FUZZ_CASES=N runs N cases of each.

use foretrace_shm::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// Any bit pattern of `T`; some of its words replaced by numbers that often break code.
fn any_bits<T: Wire>() -> impl Strategy<Value = T> {
    let word = prop_oneof![
        2 => any::<u64>(),
        6 => (-12.0f64..12.0).prop_map(f64::to_bits),
        12 => 0u64..10,
        1 => Just(f64::NAN.to_bits()),
        1 => Just(f64::INFINITY.to_bits()),
        1 => Just((-0.0f64).to_bits()),
        1 => Just(f64::MIN_POSITIVE.to_bits() / 2),
        1 => Just(u64::MAX),
    ];
    prop::collection::vec(word, size_of::<T>().div_ceil(8)).prop_map(|words| {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        T::get(&mut bytes.as_slice()).expect("enough bytes")
    })
}

fn bounds() -> ProptestConfig {
    let cases =
        std::env::var("FORETRACE_FUZZ_CASES").map_or(512, |text| text.parse().expect("a whole number"));
    // The same cases in every run: a failure can be repeated.
    let rng_seed = RngSeed::Fixed(1);
    ProptestConfig { cases, rng_seed, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(bounds())]

    #[test]
    fn bytes_survive_the_codec(record in any_bits::<TickRecord>()) {
        let mut bytes = Vec::new();
        record.put(&mut bytes);
        prop_assert_eq!(bytes.len(), size_of::<TickRecord>());
        let mut again = Vec::new();
        TickRecord::get(&mut bytes.as_slice()).unwrap().put(&mut again);
        prop_assert_eq!(&bytes, &again);
        prop_assert!(TickRecord::get(&mut &bytes[1..]).is_none());
    }

    #[test]
    fn accepted_pen_samples_are_in_range(sample in any_bits::<PenSample>()) {
        if sample.validate().is_ok() {
            prop_assert!(sample.x_m.abs() <= PEN_POSITION_LIMIT_M
                && sample.y_m.abs() <= PEN_POSITION_LIMIT_M);
            prop_assert!(sample.pressure <= 1.0 && sample.tilt_x_rad.abs() <= 3.15);
            prop_assert_eq!(sample.flags & !pen_flags::ALL, 0);
        }
    }

    #[test]
    fn accepted_commands_and_states_are_finite(
        command in any_bits::<JointCommand>(),
        state in any_bits::<JointState>(),
    ) {
        if command.validate().is_ok() {
            prop_assert!(command.q.iter().chain(&command.qd).all(|x| x.is_finite()));
            prop_assert!(Mode::try_from(command.mode).is_ok());
        }
        if state.validate().is_ok() {
            prop_assert!(state.q.iter().chain(&state.qd).chain(&state.effort).all(|x| x.is_finite()));
            prop_assert!(SafetyMode::try_from(state.safety_mode).is_ok());
        }
    }

    #[test]
    fn hostile_requests_and_answers_never_panic(
        request in any_bits::<ControlRequest>(),
        response in any_bits::<ControlResponse>(),
        status in any_bits::<Status>(),
    ) {
        if request.validate().is_ok() {
            let op = ControlOp::try_from(request.op).unwrap();
            prop_assert!(op != ControlOp::SetTrust || (0.0..=1.0).contains(&request.value));
            prop_assert!(op != ControlOp::SwitchPredictor || request.predictor.as_str().is_some());
        }
        let shown = request.predictor.to_string();
        prop_assert!(!shown.is_empty() && shown.bytes().all(|byte| byte.is_ascii_graphic()));
        let _ = (response.validate(), response.to_string(), response.is_success(), status.validate());
    }

    #[test]
    fn one_field_out_of_a_good_sample_is_found(bad in prop_oneof![Just(f64::NAN), 10.1f64..1e300,
        -1e300f64..-10.1]) {
        let sample = PenSample { y_m: bad, ..Default::default() };
        prop_assert_eq!(sample.validate().unwrap_err().field, "y_m");
    }

    #[test]
    fn a_header_check_survives_any_stream(headers in prop::collection::vec(any_bits::<Header>(), 1..50),
        now: u64) {
        let boot = headers[0].boot_id;
        let mut check = HeaderCheck::new(boot, HeaderBounds { future_ns: 1000, age_ns: u64::MAX });
        for header in &headers {
            let before = check.last();
            if check.admit(header, now).is_ok() {
                prop_assert_eq!(header.boot_id, boot);
                prop_assert!(header.stamp_ns.saturating_sub(now) <= 1000);
                prop_assert!(before.is_none_or(|last| header.stamp_ns >= last.stamp_ns));
            } else {
                prop_assert_eq!(check.last(), before);
            }
        }
    }
}
