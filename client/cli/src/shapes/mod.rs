//! `foretrace config shapes`: capsules around the meshes of a robot description, as URDF to paste.
//!
//! Contract: every capsule holds every vertex of its mesh, with the numbers as they are written. All or
//! nothing: one mesh that cannot be read refuses the whole, with every reason. A cylinder is what foretrace
//! reads as a capsule (`arm/bodies.rs`): its ends get half-spheres there, so no spheres are written
//! beside it.

mod capsule;
mod mesh;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

use foretrace_config::files::read_text;
use nalgebra::{Rotation3, Vector3};
use urdf_rs::{Geometry, Link, Pose};

use crate::failure::Failure;
use crate::output::{note, say};
use capsule::Capsule;
use mesh::{Mesh, Search};

/// Propose capsules for links that have only meshes, as a URDF fragment to paste
///
/// foretrace keeps the arm clear of itself and of keep-outs by capsules; meshes have no size for it. This
/// reads the STL and OBJ meshes of the links' collision geometry (of the visual one where a link has none),
/// puts a nearly minimal capsule around each, and reports how much larger it is. Look at the result before
/// you rely on it: a capsule around a bent link is wide.
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
}

/// One mesh and its capsule.
struct Proposal {
    link: String,
    file: String,
    mesh: Mesh,
    capsule: Capsule,
}

pub(crate) fn run(args: &ShapesArgs) -> Result<(), Failure> {
    let wrong = |error: &dyn std::fmt::Display| {
        Failure::bad_input(
            format_args!("{}: {error}", args.urdf.display()),
            "give a robot description in URDF",
        )
    };
    let longest = foretrace_control::arm::LONGEST_BYTES as u64;
    let text = read_text(&args.urdf, longest).map_err(|error| wrong(&error))?;
    let robot = foretrace_control::arm::description(&text).map_err(|error| wrong(&error))?;
    let search = Search::new(&args.urdf, args.packages.clone());
    let (mut proposals, mut refused) = (Vec::new(), Vec::new());
    for link in &robot.links {
        for outcome in around(link, &search) {
            match outcome {
                Ok(proposal) => proposals.push(proposal),
                Err(why) => refused.push(format!("link `{}`: {why}", link.name)),
            }
        }
    }
    if !refused.is_empty() {
        let what = format!("{} meshes cannot be used:\n  {}", refused.len(), refused.join("\n  "));
        return Err(Failure::bad_input(what, "nothing was written"));
    }
    if proposals.is_empty() {
        let what =
            format_args!("{}: no link needs shapes, because none has only meshes", args.urdf.display());
        return Err(Failure::bad_input(what, "see `foretrace config check` for what the arm keeps clear of"));
    }
    let fragment = fragment(&proposals);
    match &args.out {
        None => say!("{}", fragment.trim_end()),
        Some(file) => {
            foretrace_sim::whole::write(file, |out| out.write_all(fragment.as_bytes())).map_err(|error| {
                Failure::failed(
                    format_args!("cannot write {}: {error}", file.display()),
                    "give a writable --out FILE",
                )
            })?;
            say!("{} capsules written to {}", proposals.len(), file.display());
        }
    }
    let most = foretrace_control::clearance::MAX_CAPSULES;
    if proposals.len() > most {
        note!(
            "config shapes: {} capsules are more than the {most} that an arm may have: leave some out",
            proposals.len()
        );
    }
    Ok(())
}

/// Capsules around the meshes of a link that has no other collision geometry.
fn around(link: &Link, search: &Search) -> Vec<Result<Proposal, String>> {
    let collision: Vec<(&Pose, &Geometry)> =
        link.collision.iter().map(|c| (&c.origin, &c.geometry)).collect();
    let visual: Vec<(&Pose, &Geometry)> = link.visual.iter().map(|v| (&v.origin, &v.geometry)).collect();
    let shown = if collision.is_empty() { visual } else { collision };
    if shown.iter().any(|(_, geometry)| !matches!(geometry, Geometry::Mesh { .. })) {
        return Vec::new();
    }
    shown.into_iter().map(|(pose, geometry)| proposal(link, pose, geometry, search)).collect()
}

fn proposal(link: &Link, pose: &Pose, geometry: &Geometry, search: &Search) -> Result<Proposal, String> {
    let Geometry::Mesh { filename, scale } = geometry else { return Err("no mesh".to_owned()) };
    let scale = scale.as_ref().map_or(Vector3::repeat(1.0), |scale| Vector3::from(scale.0));
    let [roll, pitch, yaw] = pose.rpy.0;
    let (turn, place) = (Rotation3::from_euler_angles(roll, pitch, yaw), Vector3::from(pose.xyz.0));
    let mesh = mesh::read(&search.find(filename)?, |vertex| turn * vertex.component_mul(&scale) + place)?;
    let capsule = capsule::around(&mesh.vertices).ok_or("the mesh is empty")?;
    Ok(Proposal { link: link.name.clone(), file: filename.clone(), mesh, capsule })
}

fn fragment(proposals: &[Proposal]) -> String {
    let mut out = String::from(
        "<!-- Capsules around meshes, by `foretrace config shapes`. Put each <collision> into its link, in \
         place of the mesh.\n     \
         A cylinder stands for a capsule: foretrace puts half-spheres at its ends, which other programs do \
         not. -->\n",
    );
    let mut open: Option<&str> = None;
    // Writing to a string does not fail.
    for Proposal { link, file, mesh, capsule } in proposals {
        if open != Some(link) {
            out.push_str(if open.is_some() { "</link>\n" } else { "" });
            let _ = writeln!(out, "<link name=\"{}\">", escaped(link));
            open = Some(link);
        }
        let _ = writeln!(out, "  <!-- {}: {} -->", commented(file), size(mesh, capsule));
        let Capsule { centre: [x, y, z], rpy: [roll, pitch, yaw], length, radius } = capsule;
        let geometry = if *length > 0.0 {
            format!("<cylinder radius=\"{radius:.7}\" length=\"{length:.7}\"/>")
        } else {
            format!("<sphere radius=\"{radius:.7}\"/>")
        };
        let _ = writeln!(
            out,
            "  <collision>\n    <origin xyz=\"{x:.7} {y:.7} {z:.7}\" rpy=\"{roll:.7} {pitch:.7} \
             {yaw:.7}\"/>\n    \
             <geometry>{geometry}</geometry>\n  </collision>"
        );
    }
    out.push_str("</link>\n");
    out
}

/// How much larger the capsule is.
fn size(mesh: &Mesh, capsule: &Capsule) -> String {
    let litres = 1e3 * capsule.volume();
    let count = mesh.vertices.len();
    match mesh.volume.filter(|volume| *volume <= capsule.volume()) {
        Some(volume) => format!(
            "{count} vertices, all inside; capsule {litres:.3} l, mesh {:.3} l, {:.0} % more",
            1e3 * volume,
            100.0 * (capsule.volume() / volume - 1.0)
        ),
        None => format!(
            "{count} vertices, all inside; capsule {litres:.3} l (the mesh is not closed: its own volume is \
             not known)"
        ),
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Two dashes would end a comment.
fn commented(text: &str) -> String {
    text.replace("--", "- -")
}

fn package(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && !folder.is_empty() => {
            Ok((name.to_owned(), folder.into()))
        }
        _ => Err("NAME=DIR, for example ur_description=/opt/ros/humble/share/ur_description".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_holds_every_vertex_when_it_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut obj = String::new();
        for i in 0..300 {
            let (a, z) = (f64::from(i) * 0.7, f64::from(i % 60) * 0.005);
            let _ = writeln!(obj, "v {} {} {}", 0.04 * a.cos() + 0.3 * z, 0.05 * a.sin(), z);
        }
        for i in 1..=298 {
            let _ = writeln!(obj, "f {i} {} {}", i + 1, i + 2);
        }
        std::fs::write(folder.path().join("a.obj"), obj).unwrap();
        let urdf = folder.path().join("arm.urdf");
        std::fs::write(
            &urdf,
            r#"<robot name="a"><link name="l&lt;"><collision><origin xyz="0.1 0 0.2" rpy="0.4 -0.2 1"/>
               <geometry><mesh filename="a.obj" scale="1 2 1"/></geometry></collision></link></robot>"#,
        )
        .unwrap();
        let out = folder.path().join("out.xml");
        run(&ShapesArgs { urdf: urdf.clone(), out: Some(out.clone()), packages: Vec::new() }).unwrap();
        let fragment = std::fs::read_to_string(&out).unwrap();
        let robot = urdf_rs::read_from_string(&format!("<robot name=\"r\">{fragment}</robot>")).unwrap();
        let written = &robot.links[0];
        assert_eq!(written.name, "l<");
        let Geometry::Cylinder { radius, length } = written.collision[0].geometry else {
            panic!("{fragment}")
        };
        let origin = &written.collision[0].origin;
        let read = Capsule { centre: origin.xyz.0, rpy: origin.rpy.0, length, radius };
        let search = Search::new(&urdf, Vec::new());
        let source = foretrace_control::arm::description(&std::fs::read_to_string(&urdf).unwrap()).unwrap();
        let proposal = around(&source.links[0], &search).remove(0).unwrap();
        for vertex in &proposal.mesh.vertices {
            assert!(read.distance(vertex) <= radius + 1e-9, "{vertex}");
        }
    }

    #[test]
    fn one_mesh_that_cannot_be_had_refuses_the_whole_and_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let urdf = folder.path().join("arm.urdf");
        std::fs::write(
            &urdf,
            r#"<robot name="a"><link name="upper"><collision><geometry>
               <mesh filename="package://no_such_description/a.stl"/></geometry></collision></link></robot>"#,
        )
        .unwrap();
        let out = folder.path().join("out.xml");
        let refused = run(&ShapesArgs { urdf, out: Some(out.clone()), packages: Vec::new() }).unwrap_err();
        let words = refused.to_string();
        assert!(words.contains("`upper`") && words.contains("--package no_such_description=DIR"), "{words}");
        assert!(!out.exists());
    }
}
