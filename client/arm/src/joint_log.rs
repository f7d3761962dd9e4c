//! An arm's joints as a CSV file: t_s (monotonic clock), q1..q6 \[rad\].

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use foretrace_client::JOINTS;
use foretrace_failure::Failure;

/// The joint states as a CSV file.
#[derive(Debug)]
pub(crate) struct JointLog {
    path: PathBuf,
    file: BufWriter<File>,
    failed: Option<std::io::Error>,
}

impl JointLog {
    pub(crate) fn create(path: &Path) -> Result<Self, Failure> {
        let wrong = |error| {
            Failure::bad_input(format_args!("{}: {error}", path.display()), "give a writable --record FILE")
        };
        let mut file = BufWriter::with_capacity(1 << 16, File::create(path).map_err(wrong)?);
        writeln!(file, "t_s,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad").map_err(wrong)?;
        Ok(Self { path: path.to_owned(), file, failed: None })
    }

    /// Joints `q` \[rad\] at `stamp_ns` \[ns\].
    pub(crate) fn add(&mut self, stamp_ns: u64, q: &[f64; JOINTS]) {
        let [a, b, c, d, e, f] = q;
        let (s, ns) = (stamp_ns / 1_000_000_000, stamp_ns % 1_000_000_000);
        let written = writeln!(self.file, "{s}.{ns:09},{a:.9},{b:.9},{c:.9},{d:.9},{e:.9},{f:.9}");
        if let Err(error) = written {
            self.failed.get_or_insert(error);
        }
    }

    pub(crate) fn finish(mut self) -> Result<(), Failure> {
        let flushed = self.file.flush();
        match self.failed.take().map_or(flushed, Err) {
            Ok(()) => Ok(()),
            Err(error) => Err(Failure::failed(
                format_args!("{}: {error}", self.path.display()),
                "make room for the record",
            )),
        }
    }
}
