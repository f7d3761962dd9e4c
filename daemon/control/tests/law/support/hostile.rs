//! What hostile predictors of another process send; the lab's tests have the same behind a simulated arm.

use foretrace_control::predict::{ExternalPreview, MAX_PREVIEW};
use rand::RngExt;
use rand_pcg::Pcg64;

/// From the number of a step and the truth after it to what is sent.
pub(crate) type Spoil = fn(u64, &mut Pcg64, ExternalPreview) -> Option<ExternalPreview>;

/// What a hostile process sends instead of the truth.
pub(crate) const FAMILIES: [(&str, Spoil); 22] = [
    ("random", |_, rng, honest| Some(spoiled(honest, |_, at| at.map(|x| x + rng.random_range(-0.05..0.05))))),
    ("random within the bound", |_, rng, honest| {
        let [mut walk, ..] = honest.positions;
        Some(spoiled(honest, |_, _| {
            walk = walk.map(|x| x + rng.random_range(-0.001..0.001));
            walk
        }))
    }),
    ("not a number", |n, _, honest| {
        Some(spoiled(
            honest,
            |i, at| if i == (n % honest.count as u64) as usize { [f64::NAN, at[1]] } else { at },
        ))
    }),
    ("far away", |_, _, honest| Some(spoiled(honest, |_, at| at.map(|x| x + 1e300)))),
    ("mirrored", |_, _, honest| Some(stretched(honest, -1.0))),
    ("three times as far", |_, _, honest| Some(stretched(honest, 3.0))),
    ("frozen", |_, _, honest| Some(stretched(honest, 0.0))),
    ("another step's", |_, _, honest| Some(ExternalPreview { base_index: honest.base_index + 7, ..honest })),
    ("old", |_, _, honest| {
        Some(ExternalPreview { base_index: honest.base_index.saturating_sub(40), ..honest })
    }),
    ("mirrored, one step late", |_, _, honest| {
        Some(ExternalPreview { base_index: honest.base_index.saturating_sub(1), ..stretched(honest, -1.0) })
    }),
    ("mirrored, two steps late", |_, _, honest| {
        Some(ExternalPreview { base_index: honest.base_index.saturating_sub(2), ..stretched(honest, -1.0) })
    }),
    ("the same number again", |n, _, honest| {
        Some(ExternalPreview {
            base_index: honest.base_index.saturating_sub(n % 2),
            ..stretched(honest, -1.0)
        })
    }),
    ("too short", |_, _, honest| Some(ExternalPreview { count: 3, ..honest })),
    ("said to be longer than it is", |_, _, honest| {
        Some(ExternalPreview { count: usize::MAX, radii_count: usize::MAX, ..honest })
    }),
    ("certain of nonsense", |_, _, honest| {
        let nonsense = stretched(honest, -1.0);
        Some(ExternalPreview { radii_count: honest.count, radii: [1e-9; MAX_PREVIEW], ..nonsense })
    }),
    ("a lie in eight", |n, _, honest| Some(if n % 8 == 0 { stretched(honest, -1.0) } else { honest })),
    ("a lie in four", |n, _, honest| Some(if n % 4 == 0 { stretched(honest, 3.0) } else { honest })),
    ("right to the tenth lead only", |_, _, honest| {
        let [.., tenth, _] = honest.positions[..11] else { return None };
        Some(spoiled(honest, |i, at| {
            if i < 10 { at } else { std::array::from_fn(|axis| 2.0 * tenth[axis] - at[axis]) }
        }))
    }),
    ("wrong to the tenth lead, right beyond", |_, _, honest| {
        let [first, ..] = honest.positions;
        Some(spoiled(honest, |i, at| {
            if i < 10 { std::array::from_fn(|axis| 2.0 * first[axis] - at[axis]) } else { at }
        }))
    }),
    ("shaken to the tenth lead, right beyond", |_, rng, honest| {
        Some(spoiled(honest, |i, at| {
            at.map(|x| if i < 10 { x + 0.0005 * (i + 1) as f64 * rng.random_range(-1.0..1.0) } else { x })
        }))
    }),
    ("half as wrong again as knowing nothing, at the near leads", |_, _, honest| {
        let [first, ..] = honest.positions;
        Some(spoiled(honest, |i, at| {
            if i < 10 { std::array::from_fn(|axis| at[axis] - 1.5 * (at[axis] - first[axis])) } else { at }
        }))
    }),
    ("there for three seconds, then not, again and again", |n, _, honest| (n % 600 < 300).then_some(honest)),
];

/// Always refused: beside these the arm moves as beside nobody, bit for bit.
pub(crate) const REFUSED: [&str; 6] =
    ["random", "not a number", "far away", "another step's", "old", "too short"];

/// True for two seconds of steps of 10 ms, then `way` times the way for a fifth, again and again.
pub(crate) fn betrayed(n: u64, honest: ExternalPreview, way: f64) -> ExternalPreview {
    if n % 220 >= 200 { stretched(honest, way) } else { honest }
}

fn spoiled(
    mut preview: ExternalPreview,
    mut spoil: impl FnMut(usize, [f64; 2]) -> [f64; 2],
) -> ExternalPreview {
    let count = preview.count;
    preview.positions.iter_mut().take(count).enumerate().for_each(|(i, at)| *at = spoil(i, *at));
    preview
}

/// From its first position on.
pub(crate) fn stretched(preview: ExternalPreview, way: f64) -> ExternalPreview {
    let [first, ..] = preview.positions;
    spoiled(preview, |_, at| std::array::from_fn(|axis| first[axis] + way * (at[axis] - first[axis])))
}
