//! `foretrace config shapes`: capsules around the meshes of a robot description, as URDF to paste.
//!
//! Contract: every triangle of a link's meshes lies in its capsules, whole or in parts, with the numbers as
//! they are written. All or nothing: one mesh that cannot be read refuses the whole, with every reason. A
//! cylinder is what foretrace reads as a capsule (`arm/bodies.rs`): its ends get half-spheres there, so no
//! spheres are written beside it.

mod capsule;
mod choices;
mod cover;
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
use cover::cover;
use mesh::{Mesh, Search};

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
    #[arg(long, value_name = "MM", default_value = "0", value_parser = outside)]
    outside_mm: f64,
}

impl ShapesArgs {
    /// Most capsules of `link`: what was asked last for it, else for all.
    fn most(&self, link: &str) -> usize {
        let asked = |wanted: Option<&str>| {
            self.most.iter().rev().find(|(name, _)| name.as_deref() == wanted).map(|(_, most)| *most)
        };
        asked(Some(link)).or_else(|| asked(None)).unwrap_or(1)
    }
}

/// Triangles of one link, at most: more tell nothing about its shape, and the search would not end.
const MOST_TRIANGLES: usize = 2_000_000;

/// Capsules of one link, and what they are around.
struct Proposal {
    link: String,
    files: Vec<String>,
    triangles: usize,
    /// Of its meshes [m³]; 0 where they enclose nothing.
    volume: f64,
    capsules: Vec<Capsule>,
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
    let known = |name: &String| robot.links.iter().any(|link| link.name == *name);
    if let Some(name) = args.most.iter().filter_map(|(name, _)| name.as_ref()).find(|name| !known(name)) {
        let what = format_args!("--capsules {name}=N: {} has no link of that name", args.urdf.display());
        return Err(Failure::bad_input(what, "name a link of the description, or give --capsules N for all"));
    }
    let search = Search::new(&args.urdf, args.packages.clone());
    let (mut proposals, mut refused) = (Vec::new(), Vec::new());
    for link in &robot.links {
        match around(link, &search, args.most(&link.name), args.outside_mm * 1e-3) {
            Ok(proposal) => proposals.extend(proposal),
            Err(why) => refused.extend(why.into_iter().map(|why| format!("link `{}`: {why}", link.name))),
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
    let fragment = fragment(&proposals, args.outside_mm);
    let count: usize = proposals.iter().map(|proposal| proposal.capsules.len()).sum();
    match &args.out {
        None => say!("{}", fragment.trim_end()),
        Some(file) => {
            foretrace_sim::whole::write(file, |out| out.write_all(fragment.as_bytes())).map_err(|error| {
                Failure::failed(
                    format_args!("cannot write {}: {error}", file.display()),
                    "give a writable --out FILE",
                )
            })?;
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

/// At most `most` capsules around the meshes of a link that has no other collision geometry; none for a link
/// that needs none. Errors: every mesh that cannot be used, in words.
fn around(link: &Link, search: &Search, most: usize, outside: f64) -> Result<Option<Proposal>, Vec<String>> {
    let collision: Vec<(&Pose, &Geometry)> =
        link.collision.iter().map(|c| (&c.origin, &c.geometry)).collect();
    let visual: Vec<(&Pose, &Geometry)> = link.visual.iter().map(|v| (&v.origin, &v.geometry)).collect();
    let shown = if collision.is_empty() { visual } else { collision };
    if shown.is_empty() || shown.iter().any(|(_, geometry)| !matches!(geometry, Geometry::Mesh { .. })) {
        return Ok(None);
    }
    let (mut files, mut triangles, mut volume, mut refused) = (Vec::new(), Vec::new(), 0.0, Vec::new());
    for (pose, geometry) in shown {
        match mesh(pose, geometry, search) {
            Ok((file, mesh)) => {
                files.push(file);
                triangles.extend(mesh.triangles);
                volume += mesh.volume;
            }
            Err(why) => refused.push(why),
        }
        if triangles.len() > MOST_TRIANGLES {
            refused.push(format!(
                "its meshes have more than {MOST_TRIANGLES} triangles: simplify them (for example with MeshLab)"
            ));
            break;
        }
    }
    if !refused.is_empty() {
        return Err(refused);
    }
    let capsules = cover(&triangles, most, outside);
    Ok(Some(Proposal { link: link.name.clone(), files, triangles: triangles.len(), volume, capsules }))
}

fn mesh(pose: &Pose, geometry: &Geometry, search: &Search) -> Result<(String, Mesh), String> {
    let Geometry::Mesh { filename, scale } = geometry else { return Err("no mesh".to_owned()) };
    let scale = scale.as_ref().map_or(Vector3::repeat(1.0), |scale| Vector3::from(scale.0));
    let [roll, pitch, yaw] = pose.rpy.0;
    let (turn, place) = (Rotation3::from_euler_angles(roll, pitch, yaw), Vector3::from(pose.xyz.0));
    let mesh = mesh::read(&search.find(filename)?, |vertex| turn * vertex.component_mul(&scale) + place)?;
    Ok((filename.clone(), mesh))
}

fn fragment(proposals: &[Proposal], outside_mm: f64) -> String {
    let mut out = format!(
        "<!-- Capsules around meshes, by `foretrace config shapes`. Put each <collision> into its link, in \
         place of the mesh.\n     \
         No point of a mesh is more than {outside_mm} mm outside.\n     \
         A cylinder stands for a capsule: foretrace puts half-spheres at its ends, which other programs do \
         not. -->\n",
    );
    // Writing to a string does not fail.
    for proposal in proposals {
        let _ = writeln!(out, "<link name=\"{}\">", escaped(&proposal.link));
        let _ = writeln!(out, "  <!-- {}: {} -->", commented(&proposal.files.join(", ")), size(proposal));
        for Capsule { centre: [x, y, z], rpy: [roll, pitch, yaw], length, radius } in &proposal.capsules {
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
    }
    out
}

/// How much larger the capsules are.
fn size(proposal: &Proposal) -> String {
    let litres = 1e3 * cover::volume(&proposal.capsules);
    let mesh = 1e3 * proposal.volume;
    let all = format!("{} triangles; capsules {litres:.3} l", proposal.triangles);
    if (1e-9..=litres).contains(&mesh) {
        format!("{all}, mesh {mesh:.3} l, {:.0} % more", 100.0 * (litres / mesh - 1.0))
    } else {
        format!("{all} (the mesh is not closed: its own volume is not known)")
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Two dashes would end a comment.
fn commented(text: &str) -> String {
    text.replace("--", "- -")
}

fn outside(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(mm) if (0.0..=5.0).contains(&mm) => Ok(mm),
        _ => Err("a number from 0 to 5, in millimetres".to_owned()),
    }
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

#[cfg(test)]
mod tests {
    use super::capsule::Axis;
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
        let most = vec![(None, 2), (Some("l<".to_owned()), 3)];
        let args = ShapesArgs {
            urdf: urdf.clone(),
            out: Some(out.clone()),
            packages: Vec::new(),
            most,
            outside_mm: 0.0,
        };
        run(&args).unwrap();
        let fragment = std::fs::read_to_string(&out).unwrap();
        let robot = urdf_rs::read_from_string(&format!("<robot name=\"r\">{fragment}</robot>")).unwrap();
        let written = &robot.links[0];
        assert_eq!(written.name, "l<");
        let capsules: Vec<Axis> = written
            .collision
            .iter()
            .map(|collision| {
                let (radius, length) = match collision.geometry {
                    Geometry::Cylinder { radius, length } => (radius, length),
                    Geometry::Sphere { radius } => (radius, 0.0),
                    _ => panic!("{fragment}"),
                };
                let (centre, rpy) = (collision.origin.xyz.0, collision.origin.rpy.0);
                Axis::of(&Capsule { centre, rpy, length, radius })
            })
            .collect();
        assert!((2..=3).contains(&capsules.len()), "{fragment}");
        let search = Search::new(&urdf, Vec::new());
        let source = foretrace_control::arm::description(&std::fs::read_to_string(&urdf).unwrap()).unwrap();
        let shape = &source.links[0].collision[0];
        let (_, mesh) = mesh(&shape.origin, &shape.geometry, &search).unwrap();
        for triangle in &mesh.triangles {
            assert!(cover::held(&capsules, triangle, 1e-9), "{triangle:?}");
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
        let refused = run(&ShapesArgs {
            urdf,
            out: Some(out.clone()),
            packages: Vec::new(),
            most: Vec::new(),
            outside_mm: 0.0,
        })
        .unwrap_err();
        let words = refused.to_string();
        assert!(words.contains("`upper`") && words.contains("--package no_such_description=DIR"), "{words}");
        assert!(!out.exists());
    }
}
