//! Every tick of a trial as a line of CSV.

use std::fmt::Write as _;

use crate::experiments::Watched;

/// The lines so far, a heading first.
pub struct TickTable(String);

impl Default for TickTable {
    fn default() -> Self {
        Self(HEADING.to_owned())
    }
}

impl TickTable {
    /// A line: numbers with all their digits, so that bits come back.
    pub fn add(&mut self, hand: usize, sequence: usize, tick: &Watched<'_>) {
        let table = &mut self.0;
        let Watched { output, measured, .. } = tick;
        let command = output.command.as_ref();
        let (q, qd) = command.map_or(([f64::NAN; 6], [f64::NAN; 6]), |command| (command.q, command.qd));
        let enabled = command.is_some_and(|command| command.enabled);
        let measured_s = tick.t_s - tick.until.seconds_since(measured.stamp);
        // Into a string nothing fails.
        let _ = write!(
            table,
            "{hand},{sequence},{},{measured_s},{},{},{},{:?},{:?},{},{}",
            tick.t_s,
            output.pen_position[0],
            output.pen_position[1],
            u8::from(output.pen_contact),
            output.mode,
            output.stop_reason,
            u8::from(enabled),
            output.trust.alpha.alpha(),
        );
        let numbers = output.tool.iter().chain(&tick.tool).chain(&q).chain(&qd);
        for number in numbers.chain(&measured.q).chain(&measured.effort) {
            let _ = write!(table, ",{number}");
        }
        table.push('\n');
    }

    pub fn text(&self) -> &str {
        &self.0
    }
}

const HEADING: &str = "hand,sequence,t_s,measured_s,pen_x_m,pen_y_m,contact,mode,stop,enabled,alpha,\
    command_x_m,command_y_m,command_z_m,tool_x_m,tool_y_m,tool_z_m,\
    q1,q2,q3,q4,q5,q6,qd1,qd2,qd3,qd4,qd5,qd6,\
    measured_q1,measured_q2,measured_q3,measured_q4,measured_q5,measured_q6,\
    effort1,effort2,effort3,effort4,effort5,effort6\n";
