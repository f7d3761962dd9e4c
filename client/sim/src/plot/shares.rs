//! How much of a limit was used, one bar per joint and limit.

use super::sheet::{AxisFrame, Hung, LEFT, Picture, RIGHT, Sheet, WIDTH};

const PANEL: f64 = 150.0;

/// One limit of every joint.
#[derive(Debug, Clone, Copy)]
pub struct Shares<'a> {
    pub label: &'a str,
    /// Largest value over the limit, base first; 1: at the limit.
    pub of_limit: &'a [f64],
}

/// Draws the bars in per cent with the limit at 100. `None` without a finite value.
#[must_use]
pub fn shares(title: &str, about: &str, groups: &[Shares<'_>]) -> Option<Picture> {
    let joints = groups.iter().map(|group| group.of_limit.len()).max().filter(|joints| *joints > 0)?;
    let all = || groups.iter().flat_map(|group| group.of_limit).filter(|share| share.is_finite());
    let highest = all().fold(1.0_f64, |most, share| most.max(*share));
    all().next()?;
    let mut sheet = Sheet::default();
    let entries: Vec<_> = groups.iter().enumerate().map(|(index, group)| (bar(index), group.label)).collect();
    let top = sheet.legend(&entries) + 22.0;
    let frame = AxisFrame {
        at: (LEFT, top),
        size: (WIDTH - LEFT - RIGHT, PANEL),
        x: (0.0, joints as f64),
        y: (0.0, 100.0 * highest * 1.14),
    };
    let bottom = top + PANEL;
    frame.grid_y(&mut sheet, [0.0, 25.0, 50.0, 75.0, 100.0].map(|value| (value, format!("{value:.0}"))));
    let wide = 0.34;
    for joint in 0..joints {
        for (index, group) in groups.iter().enumerate() {
            let Some(share) = group.of_limit.get(joint).filter(|share| share.is_finite()) else { continue };
            let centre = joint as f64 + 0.5 + (index as f64 - (groups.len() as f64 - 1.0) / 2.0) * wide;
            let (left, right) = (frame.px(centre - 0.45 * wide), frame.px(centre + 0.45 * wide));
            let y = frame.py(100.0 * share);
            sheet.rect(bar(index), (left, y), (right - left, bottom - y));
            let words = format!("{:.0}", 100.0 * share);
            sheet.text(((left + right) / 2.0, y - 4.0), "", Hung::Middle, &words);
        }
        let name = format!("joint {joint}");
        sheet.text((frame.px(joint as f64 + 0.5), bottom + 17.0), "", Hung::Middle, &name);
    }
    frame.outline(&mut sheet);
    let limit = frame.py(100.0);
    sheet.line("bound", &[(LEFT, limit), (WIDTH - RIGHT, limit)]);
    sheet.text((LEFT + 4.0, top - 7.0), "strong", Hung::Left, "per cent of the limit");
    Some(sheet.done(title, about, bottom + 30.0))
}

const fn bar(index: usize) -> &'static str {
    if index.is_multiple_of(2) { "arm-bar" } else { "calm-bar" }
}
