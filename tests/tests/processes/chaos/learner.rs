//! Corrupt input for the learner: invalid samples never reach it, and nothing learnt from nonsense reaches
//! the loop.

use foretrace_client::monotonic_now_ns;
use foretrace_tests::{World, until};

use super::scene::{PLAY, Scene, say, say_times};
use crate::PROGRAM;

#[test]
fn learner_fed_poison() {
    let mut scene = Scene::armed_in(World::new(PROGRAM));
    // A regular hand first: the learner does learn here.
    let honest = scene.forge("honest", "3");
    let of = |told: &serde_json::Value, when: &str, key: &str| {
        told[when]["learner"][key].as_u64().unwrap_or_else(|| panic!("{key} in {told}"))
    };
    let learnt = of(&honest, "after", "updates") - of(&honest, "before", "updates");
    assert!(learnt > 100, "{honest}");

    let poison = scene.forge("poison", "3");
    for key in ["updates", "version", "promotions"] {
        assert_eq!(of(&poison, "before", key), of(&poison, "after", key), "{key} in {poison}");
    }
    assert_eq!(of(&poison, "after", "weights_refused"), 0, "{poison}");
    let bad = poison["sent"]["bad"].as_u64().expect("a count");
    say("learner's poison", &format!("{learnt} steps learnt from an honest pen, 0 from {bad} bad samples"));

    // The learner learns from legal nonsense; the effect must not last.
    let mad = scene.forge("mad", "4");
    assert_eq!(of(&mad, "after", "weights_refused"), 0, "{mad}");
    let since = monotonic_now_ns();
    scene.player = Some(scene.world.start(0, &PLAY));
    say_times("learner's poison", vec![scene.follows_again(since)]);
    let rms =
        until("the prediction is measured again", || scene.world.status(0)["predictor"]["rms_m"].as_f64());
    assert!(rms.is_finite() && rms < 0.1, "{rms}");
    scene.end();
}
