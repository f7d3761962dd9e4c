//! `foretrace config shapes`: capsules around the meshes of a robot description, as URDF to paste.

use std::path::PathBuf;

use foretrace_shapes::{ShapesError, ShapesOptions, fragment, propose};

use crate::failure::Failure;
use crate::output::{note, say, write_file};
use crate::values;

/// Propose capsules for links that have only meshes, as a URDF fragment to paste
///
/// foretrace keeps the arm clear of itself and of keep-outs by capsules; meshes have no size for it. This
/// reads the STL and OBJ meshes of the links' collision geometry (of the visual one where a link has none),
/// puts nearly minimal capsules around all meshes of a link together, and reports how much larger they are.
/// Look at the result before you rely on it: one capsule around a bent link is wide, two fit better.
#[derive(Debug, clap::Args)]
pub(crate) struct ShapesArgs {
    /// Robot description (URDF)
    urdf: PathBuf,

    /// Write the fragment to FILE instead of stdout
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Folder of a package of package:// URLs; may be given several times
    #[arg(long = "package", value_name = "NAME=DIR", value_parser = package)]
    packages: Vec<(String, PathBuf)>,

    /// Most capsules per link, or LINK=N for one link; may be given several times. Fewer are written where
    /// more do not fit better by 0.2 mm [default: 1]
    #[arg(long = "capsules", value_name = "N|LINK=N", value_parser = most)]
    most: Vec<(Option<String>, usize)>,

    /// How far a mesh may stick out of its capsules, for a closer fit: 0 to 5 mm
    #[arg(long, value_name = "MM", default_value = "0", value_parser = values::number(0.0..=5.0, "a number from 0 to 5, in millimetres"))]
    outside_mm: f64,
}

pub(crate) fn run(args: &ShapesArgs) -> Result<(), Failure> {
    let ShapesArgs { urdf, out, packages, most, outside_mm } = args;
    let options = ShapesOptions { packages: packages.clone(), most: most.clone(), outside_mm: *outside_mm };
    let proposals = propose(urdf, &options).map_err(|error| {
        let remedy = match error {
            ShapesError::Description { .. } => "give a robot description in URDF",
            ShapesError::UnknownLink { .. } => "name a link of the description, or give --capsules N for all",
            ShapesError::Meshes(_) => "nothing was written",
            ShapesError::NotNeeded { .. } => "see `foretrace config check` for what the arm keeps clear of",
        };
        Failure::bad_input(error, remedy)
    })?;
    let fragment = fragment(&proposals, options.outside_mm);
    let count: usize = proposals.iter().map(|proposal| proposal.capsules.len()).sum();
    match out {
        None => say!("{}", fragment.trim_end()),
        Some(file) => {
            write_file(file, &fragment, "--out")?;
            say!("{count} capsules written to {}", file.display());
        }
    }
    let most = foretrace_control::clearance::MAX_CAPSULES;
    if count > most {
        note!(
            "config shapes: {count} capsules are more than the {most} that an arm may have: leave some out"
        );
    }
    Ok(())
}

/// More than an arm may have are of no use.
fn most(text: &str) -> Result<(Option<String>, usize), String> {
    let (link, number) = match text.rsplit_once('=') {
        Some((link, number)) => (Some(link.to_owned()), number),
        None => (None, text),
    };
    let most = foretrace_control::clearance::MAX_CAPSULES;
    match number.parse() {
        Ok(count) if (1..=most).contains(&count) => Ok((link, count)),
        _ => Err(format!("a number from 1 to {most}, or LINK=N for one link, for example forearm_link=2")),
    }
}

fn package(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && !folder.is_empty() => {
            Ok((name.to_owned(), folder.into()))
        }
        _ => Err("NAME=DIR, for example ur_description=/opt/ros/humble/share/ur_description".to_owned()),
    }
}
