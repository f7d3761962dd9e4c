//! Programs as connections bring them.

use foretrace_ur_sim::script::{Program, TooLong, Uploads};
use proptest::prelude::*;

const SENT: &str = "def first():
\tthread t():
\t\twhile True: # not an end
\t\t\tsync()
\t\tend
\tend
\trun t()
\tif True: end
\tif \"end\" == \"end\": # end
\tend
\tending = 1
end

stopj(2)
# a comment
sec second():
  set_digital_out(0, True)
end
set_digital_out(1, False)\r
";

fn expected() -> Vec<&'static str> {
    let (first, rest) = SENT.split_at(SENT.find("\n\n").unwrap() + 1);
    assert!(rest.contains("sec second"));
    vec![
        first,
        "stopj(2)\n",
        "sec second():\n  set_digital_out(0, True)\nend\n",
        "set_digital_out(1, False)\r\n",
    ]
}

#[test]
fn programs_and_bare_lines_come_apart() {
    let programs = Uploads::default().take(SENT.as_bytes()).unwrap();
    assert_eq!(programs, expected());
    for program in programs {
        assert!(Program::parse(&program).is_ok(), "{program}");
    }
}

#[test]
fn what_is_not_complete_waits_for_its_end() {
    let mut uploads = Uploads::default();
    assert_eq!(uploads.take(b"def a():\n  sync()\n").unwrap(), Vec::<String>::new());
    assert_eq!(uploads.take(b"end").unwrap(), Vec::<String>::new());
    assert_eq!(uploads.take(b"\n").unwrap(), ["def a():\n  sync()\nend\n"]);
    assert_eq!(uploads.take(b"stopj(2)").unwrap(), Vec::<String>::new());
    assert_eq!(uploads.finish().as_deref(), Some("stopj(2)"));
    assert_eq!(uploads.finish(), None);
    assert_eq!(uploads.take(b"def a():\n").unwrap(), Vec::<String>::new());
    assert_eq!(uploads.finish().as_deref(), Some("def a():\n"));
    assert_eq!(uploads.take(b"end\n").unwrap(), ["end\n"]);
}

#[test]
fn a_program_without_end_does_not_fill_the_memory() {
    let mut uploads = Uploads::default();
    let chunk = b"def a():\n".repeat(1000);
    let refused = (0..1000).position(|_| uploads.take(&chunk) == Err(TooLong));
    assert_eq!(refused, Some((1 << 20) / chunk.len()));
    assert_eq!(uploads.take(b"stopj(2)\n").unwrap(), ["stopj(2)\n"]);
    assert_eq!(uploads.take(&vec![b'x'; (1 << 20) + 1]), Err(TooLong));
}

proptest! {
    #![proptest_config(crate::fuzz::cases(200))]

    #[test]
    fn how_the_bytes_are_cut_does_not_matter(cuts in prop::collection::vec(0..SENT.len(), 0..8)) {
        let mut cuts = cuts;
        cuts.sort_unstable();
        cuts.push(SENT.len());
        let (mut uploads, mut from, mut programs) = (Uploads::default(), 0, Vec::new());
        for cut in cuts {
            programs.extend(uploads.take(&SENT.as_bytes()[from..cut]).unwrap());
            from = cut;
        }
        prop_assert_eq!(programs, expected());
    }

    #[test]
    fn random_bytes_are_taken(bytes in prop::collection::vec(any::<u8>(), 0..500)) {
        let mut uploads = Uploads::default();
        let mut length: usize = uploads.take(&bytes).unwrap().iter().map(String::len).sum();
        length += uploads.finish().map_or(0, |rest| rest.len());
        // What is no UTF-8 becomes a character of three bytes.
        prop_assert!(length <= 3 * bytes.len());
    }
}
