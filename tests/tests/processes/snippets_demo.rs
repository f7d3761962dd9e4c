//! Settings files that the documents print whole: judged and rehearsed as they tell a reader to.

use foretrace_tests::{World, told};

use crate::PROGRAM;
use crate::snippets::blocks_of;

#[test]
fn every_whole_settings_file_of_the_documents_is_judged_right_and_runs_a_short_demo() {
    let whole = blocks_of("toml").into_iter().filter(|(_, text)| text.contains("preset = "));
    let mut count = 0;
    for (path, text) in whole {
        let world = World::new(PROGRAM);
        let file = world.write("table.toml", &text);
        let checked = world.run_plain(&["config", "check", &file]);
        assert!(checked.status.success(), "{}: {}\n{text}", path.display(), told(&checked));
        let of_an_arm = text.contains("\n[robot]");
        if of_an_arm {
            count += 1;
            let free = "safety.enable_required=false";
            let demo =
                ["demo", "--config", &file, "--set", free, "--seconds", "2", "--no-rights", "--out", "r"];
            let ran = world.run(0, &demo);
            assert!(ran.status.success(), "{}: {}\n{text}", path.display(), told(&ran));
        }
    }
    assert!(count >= 2, "{count} files describe an arm");
}
