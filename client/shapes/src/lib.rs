//! Capsules around the meshes of a robot description, as URDF to paste.
//!
//! Contract: every triangle of a link's meshes lies in its capsules, whole or in parts, with the numbers as
//! they are written. All or nothing: one mesh that cannot be read refuses the whole, with every reason. A
//! cylinder is what foretrace reads as a capsule (`arm/bodies.rs`): its ends get half-spheres there, so no
//! spheres are written beside it.
//!
//! In the order of their use: `capsule` (one around points), `choices` (which of many), `cover` (several
//! around triangles), `mesh` (STL and OBJ).

#![forbid(unsafe_code)]

mod capsule;
mod choices;
mod cover;
mod mesh;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use foretrace_config::files::read_xml;
use nalgebra::{Rotation3, Vector3};
use urdf_rs::{Geometry, Link, Pose};

pub use capsule::MeshCapsule;
use cover::cover;
use mesh::{Mesh, MeshFolders};

/// Triangles of one link, at most: more tell nothing about its shape, and the search would not end.
const MOST_TRIANGLES: usize = 2_000_000;

/// How capsules are chosen.
#[derive(Debug, Clone, Default)]
pub struct ShapesOptions {
    /// Folders of the packages of `package://` URLs, by their names.
    pub packages: Vec<(String, PathBuf)>,
    /// Most capsules per link, for one link or (`None`) for all; the last one counts, 1 without any.
    pub most: Vec<(Option<String>, usize)>,
    /// How far a mesh may stick out of its capsules \[mm\].
    pub outside_mm: f64,
}

impl ShapesOptions {
    fn most(&self, link: &str) -> usize {
        let asked = |wanted: Option<&str>| {
            self.most.iter().rev().find(|(name, _)| name.as_deref() == wanted).map(|(_, most)| *most)
        };
        asked(Some(link)).or_else(|| asked(None)).unwrap_or(1)
    }
}

/// Capsules of one link, and what they are around.
#[derive(Debug, Clone)]
pub struct Proposal {
    pub link: String,
    /// Its meshes, as the description names them.
    pub files: Vec<String>,
    /// Triangles of all of them.
    pub triangles: usize,
    /// Volume of the meshes \[m^3\]; 0 where they enclose nothing.
    pub volume_m3: f64,
    /// In the link's frame.
    pub capsules: Vec<MeshCapsule>,
}

/// Why there are no capsules.
#[derive(thiserror::Error)]
pub enum ShapesError {
    /// Not a robot description.
    #[error("{}: {why}", urdf.display())]
    Description {
        urdf: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// `most` names a link that is not there.
    #[error("--capsules {link}=N: {} has no link of that name", urdf.display())]
    UnknownLink { urdf: PathBuf, link: String },
    /// Meshes cannot be used, each with the reason.
    #[error("{} meshes cannot be used:\n  {}", .0.len(), .0.join("\n  "))]
    Meshes(Vec<String>),
    /// No link has only meshes.
    #[error("{}: no link needs shapes, because none has only meshes", urdf.display())]
    NotNeeded { urdf: PathBuf },
}

impl std::fmt::Debug for ShapesError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

/// Capsules for every link of `urdf` that has only meshes: of its collision geometry, else of its visual one.
///
/// # Errors
///
/// See [`ShapesError`].
pub fn propose(urdf: &Path, options: &ShapesOptions) -> Result<Vec<Proposal>, ShapesError> {
    let wrong = |error: &dyn std::fmt::Display| ShapesError::Description {
        urdf: urdf.to_path_buf(),
        why: error.to_string(),
    };
    let longest = foretrace_control::arm::LONGEST_BYTES as u64;
    let text = read_xml(urdf, longest).map_err(|error| wrong(&error))?;
    let robot = foretrace_control::arm::description(&text).map_err(|error| wrong(&error))?;
    let known = |name: &String| robot.links.iter().any(|link| link.name == *name);
    if let Some(name) = options.most.iter().filter_map(|(name, _)| name.as_ref()).find(|name| !known(name)) {
        return Err(ShapesError::UnknownLink { urdf: urdf.to_path_buf(), link: name.clone() });
    }
    let search = MeshFolders::new(urdf, options.packages.clone());
    let (mut proposals, mut refused) = (Vec::new(), Vec::new());
    for link in &robot.links {
        match around(link, &search, options.most(&link.name), options.outside_mm * 1e-3) {
            Ok(proposal) => proposals.extend(proposal),
            Err(why) => refused.extend(why.into_iter().map(|why| format!("link `{}`: {why}", link.name))),
        }
    }
    if !refused.is_empty() {
        return Err(ShapesError::Meshes(refused));
    }
    if proposals.is_empty() {
        return Err(ShapesError::NotNeeded { urdf: urdf.to_path_buf() });
    }
    Ok(proposals)
}

/// At most `most` capsules around the meshes of a link that has no other collision geometry; none for a link
/// that needs none. Errors: every mesh that cannot be used, in words.
fn around(
    link: &Link,
    search: &MeshFolders,
    most: usize,
    outside: f64,
) -> Result<Option<Proposal>, Vec<String>> {
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
    Ok(Some(Proposal {
        link: link.name.clone(),
        files,
        triangles: triangles.len(),
        volume_m3: volume,
        capsules,
    }))
}

fn mesh(pose: &Pose, geometry: &Geometry, search: &MeshFolders) -> Result<(String, Mesh), String> {
    let Geometry::Mesh { filename, scale } = geometry else { return Err("no mesh".to_owned()) };
    let scale = scale.as_ref().map_or(Vector3::repeat(1.0), |scale| Vector3::from(scale.0));
    let [roll, pitch, yaw] = pose.rpy.0;
    let (turn, place) = (Rotation3::from_euler_angles(roll, pitch, yaw), Vector3::from(pose.xyz.0));
    let mesh = mesh::read(&search.find(filename)?, |vertex| turn * vertex.component_mul(&scale) + place)?;
    Ok((filename.clone(), mesh))
}

/// The proposals as URDF to paste.
#[must_use]
pub fn fragment(proposals: &[Proposal], outside_mm: f64) -> String {
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
        for MeshCapsule { centre: [x, y, z], rpy: [roll, pitch, yaw], length, radius } in &proposal.capsules {
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
    let mesh = 1e3 * proposal.volume_m3;
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

#[cfg(test)]
mod tests {
    use super::capsule::CapsuleAxis;
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
        let most = vec![(None, 2), (Some("l<".to_owned()), 3)];
        let proposals = propose(&urdf, &ShapesOptions { most, ..ShapesOptions::default() }).unwrap();
        let fragment = fragment(&proposals, 0.0);
        let robot = urdf_rs::read_from_string(&format!("<robot name=\"r\">{fragment}</robot>")).unwrap();
        let written = &robot.links[0];
        assert_eq!(written.name, "l<");
        let capsules: Vec<CapsuleAxis> = written
            .collision
            .iter()
            .map(|collision| {
                let (radius, length) = match collision.geometry {
                    Geometry::Cylinder { radius, length } => (radius, length),
                    Geometry::Sphere { radius } => (radius, 0.0),
                    _ => panic!("{fragment}"),
                };
                let (centre, rpy) = (collision.origin.xyz.0, collision.origin.rpy.0);
                CapsuleAxis::of(&MeshCapsule { centre, rpy, length, radius })
            })
            .collect();
        assert!((2..=3).contains(&capsules.len()), "{fragment}");
        let search = MeshFolders::new(&urdf, Vec::new());
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
        let refused = propose(&urdf, &ShapesOptions::default()).err().unwrap();
        let message = refused.to_string();
        assert!(
            message.contains("`upper`") && message.contains("--package no_such_description=DIR"),
            "{message}"
        );
    }
}
