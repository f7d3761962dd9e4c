//! `--unit`: units that the columns of a CSV do not name.

use foretrace_sim::data::CsvUnits;

#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub(crate) struct UnitArgs {
    /// Unit of the columns of CSV files whose names have none: of length, of time, or both, as in mm,ms
    #[arg(long = "unit", value_name = "UNIT", value_parser = unit)]
    pub(crate) unit: Option<String>,
}

impl UnitArgs {
    pub(crate) fn units(&self) -> CsvUnits {
        self.unit.as_deref().and_then(|text| text.parse().ok()).unwrap_or_default()
    }
}

fn unit(text: &str) -> Result<String, String> {
    text.parse::<CsvUnits>().map(|_| text.to_owned())
}
