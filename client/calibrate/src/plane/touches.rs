//! Touches of pen and tool as a CSV: `pen_x_m,pen_y_m` and six joints, one mark per line; the last is the
//! proof.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Vector2;

use foretrace_failure::Failure;

const HEADER: &str = "pen_x_m,pen_y_m,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad";
/// Largest file that is read \[bytes\], and most marks.
const FILE_BYTES: u64 = 1 << 16;
const MOST: usize = 100;
/// Beyond this no pen and no joint is [m, rad].
const LIMIT: f64 = 10.0;

/// A mark as it was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchMark {
    /// The pen \[m\].
    pub pen: Vector2<f64>,
    /// The measured joints with the tip on the mark \[rad\].
    pub q: [f64; 6],
}

/// Reads a file of marks.
pub fn read(path: &Path) -> Result<Vec<TouchMark>, Failure> {
    let wrong = |what: String| {
        Failure::bad_input(
            format_args!("{}: {what}", path.display()),
            format_args!("write the header {HEADER} and one mark per line"),
        )
    };
    let text =
        foretrace_config::files::read_text(path, FILE_BYTES).map_err(|error| wrong(error.to_string()))?;
    parse(&text).map_err(wrong)
}

fn parse(text: &str) -> Result<Vec<TouchMark>, String> {
    let mut lines =
        text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    match lines.next() {
        Some((_, header)) if header.trim() == HEADER => {}
        Some((index, _)) => return Err(format!("line {}: another header", index + 1)),
        None => return Err("is empty".to_owned()),
    }
    let mut marks = Vec::new();
    for (index, line) in lines {
        let at = |what: String| format!("line {}: {what}", index + 1);
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |cell: &str| {
            cell.parse::<f64>().ok().filter(|value| value.abs() <= LIMIT).ok_or_else(|| {
                at(format!("{:?} is no number within ±{LIMIT}", cell.chars().take(30).collect::<String>()))
            })
        };
        let numbers: Vec<f64> = cells.iter().map(|cell| number(cell)).collect::<Result<_, _>>()?;
        let &[x, y, a, b, c, d, e, f] = numbers.as_slice() else {
            return Err(at(format!("{} numbers instead of 8", numbers.len())));
        };
        if marks.len() == MOST {
            return Err(at(format!("more than {MOST} marks")));
        }
        marks.push(TouchMark { pen: Vector2::new(x, y), q: [a, b, c, d, e, f] });
    }
    Ok(marks)
}

/// The same marks as text.
pub fn text(marks: &[TouchMark]) -> String {
    let mut text = format!("{HEADER}\n");
    for TouchMark { pen, q } in marks {
        let joints: Vec<String> = q.iter().map(|q| format!("{q:.9}")).collect();
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{:.7},{:.7},{}", pen.x, pen.y, joints.join(","));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_survive_the_way_through_the_file() {
        let marks = [
            TouchMark { pen: Vector2::new(0.01, -0.02), q: [0.1, -0.2, 0.3, -0.4, 0.5, -6.0] },
            TouchMark { pen: Vector2::new(-0.05, 0.07), q: [1.0; 6] },
        ];
        assert_eq!(parse(&text(&marks)), Ok(marks.to_vec()));
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let line = |line: &str| parse(&format!("# marks\n{HEADER}\n{line}\n")).unwrap_err();
        assert_eq!(parse(""), Err("is empty".to_owned()));
        assert!(parse("x,y\n").unwrap_err().contains("line 1: another header"));
        assert!(line("1,2,3").contains("line 3: 3 numbers instead of 8"));
        for wrong in ["nan", "inf", "1e300", "\u{1b}[2J", ""] {
            assert!(line(&format!("0,0,{wrong},0,0,0,0,0")).contains("is no number within"), "{wrong}");
        }
    }
}
