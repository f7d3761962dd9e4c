//! Meshes of a robot description: found in the file system, read, and measured.
//!
//! Contract: a file that is missing, too large, or not a mesh gives an error message, never a panic.
//! `package://NAME/...` is looked for where `--package` says, in the folders above the description, and in
//! ROS_PACKAGE_PATH and AMENT_PREFIX_PATH.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use crate::cover::Triangle;

/// Larger files are refused \[bytes\].
const LARGEST: u64 = 256 << 20;

/// Where meshes may be.
#[derive(Debug, Clone)]
pub(crate) struct MeshFolders {
    /// Folder of the description.
    pub(crate) folder: PathBuf,
    /// `--package NAME=DIR`.
    pub(crate) packages: Vec<(String, PathBuf)>,
    /// Folders that hold packages, from the environment.
    pub(crate) shelves: Vec<PathBuf>,
}

impl MeshFolders {
    pub(crate) fn new(urdf: &Path, packages: Vec<(String, PathBuf)>) -> Self {
        let absolute = std::path::absolute(urdf).unwrap_or_else(|_| urdf.to_path_buf());
        let folder = absolute.parent().map_or_else(|| PathBuf::from("/"), Path::to_path_buf);
        let listed = |name: &str| {
            std::env::var_os(name).map_or_else(Vec::new, |list| std::env::split_paths(&list).collect())
        };
        let mut shelves: Vec<PathBuf> = listed("ROS_PACKAGE_PATH");
        shelves.extend(listed("AMENT_PREFIX_PATH").into_iter().map(|prefix: PathBuf| prefix.join("share")));
        Self { folder, packages, shelves }
    }

    /// The file that `name` of the description stands for.
    ///
    /// # Errors
    ///
    /// No such package or file, in words.
    pub(crate) fn find(&self, name: &str) -> Result<PathBuf, String> {
        let path = match name.strip_prefix("package://") {
            Some(rest) => {
                let (package, inside) = rest.split_once('/').unwrap_or((rest, ""));
                self.package(package)?.join(inside)
            }
            None => self.folder.join(name.strip_prefix("file://").unwrap_or(name)),
        };
        if !path.is_file() {
            return Err(format!("{name}: there is no file {}", path.display()));
        }
        Ok(path)
    }

    fn package(&self, package: &str) -> Result<PathBuf, String> {
        if let Some((_, folder)) = self.packages.iter().find(|(name, _)| name == package) {
            return Ok(folder.clone());
        }
        let above = self.folder.ancestors().flat_map(|folder| {
            let itself = folder.file_name().is_some_and(|name| name == package).then(|| folder.to_path_buf());
            itself.into_iter().chain([folder.join(package)])
        });
        let shelved = self.shelves.iter().map(|shelf| shelf.join(package));
        above.chain(shelved).find(|folder| folder.is_dir()).ok_or_else(|| {
            format!(
                "package://{package}: no folder of that name above {}, in ROS_PACKAGE_PATH or \
                 AMENT_PREFIX_PATH; \
                 give --package {package}=DIR",
                self.folder.display()
            )
        })
    }
}

/// The triangles of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mesh {
    pub(crate) triangles: Vec<Triangle>,
    /// Enclosed by the triangles \[m³\]; 0 where they enclose nothing.
    pub(crate) volume: f64,
}

/// Reads `file`, every vertex moved by `placed`.
///
/// # Errors
///
/// What is wrong with it, in words.
pub(crate) fn read(file: &Path, placed: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Result<Mesh, String> {
    let wrong = |why: &dyn std::fmt::Display| format!("{}: {why}", file.display());
    let extension =
        file.extension().map(|found| found.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if !matches!(extension.as_str(), "stl" | "obj") {
        return Err(wrong(
            &"only STL and OBJ are read: convert it (for example with MeshLab or `assimp export`)",
        ));
    }
    let bytes = foretrace_config::files::read_regular(file, LARGEST).map_err(|error| wrong(&error))?;
    let scene = if extension == "stl" {
        mesh_loader::stl::from_slice(&bytes)
    } else {
        // Materials have no shape.
        mesh_loader::obj::from_slice(&bytes, None, |_| Ok(Vec::<u8>::new()))
    };
    let scene = scene.map_err(|error| {
        wrong(&format_args!("it cannot be read as {}: {error}", extension.to_uppercase()))
    })?;
    let mut triangles: Vec<Triangle> = Vec::new();
    for part in &scene.meshes {
        let moved: Vec<Vector3<f64>> =
            part.vertices.iter().map(|vertex| placed(Vector3::from(vertex.map(f64::from)))).collect();
        for face in &part.faces {
            let corner = |index: u32| moved.get(index as usize).copied();
            let [Some(a), Some(b), Some(c)] = face.map(corner) else {
                return Err(wrong(&"a triangle has a corner that is not among the vertices"));
            };
            triangles.push([a, b, c]);
        }
    }
    if triangles.is_empty() {
        return Err(wrong(&"it holds no triangles"));
    }
    if !triangles.iter().flatten().all(|vertex| vertex.iter().all(|x| x.abs() < 1e3)) {
        return Err(wrong(
            &"a vertex is not finite, or farther than 1000 m away: is the scale of the description right?",
        ));
    }
    let volume: f64 = triangles.iter().map(|[a, b, c]| a.dot(&b.cross(c)) / 6.0).sum();
    Ok(Mesh { triangles, volume: volume.abs() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cover::Dice;

    /// A cube with edges of 2, one corner at the origin, as triangles that look outwards.
    fn cube() -> Vec<[[f32; 3]; 3]> {
        let at = |i: u8| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| f32::from(bit) * 2.0);
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|face| face.map(at)).collect()
    }

    fn binary() -> Vec<u8> {
        let mut bytes = vec![0; 80];
        bytes.extend((cube().len() as u32).to_le_bytes());
        for face in cube() {
            bytes.extend([0.0_f32; 3].iter().chain(face.iter().flatten()).flat_map(|x| x.to_le_bytes()));
            bytes.extend([0, 0]);
        }
        bytes
    }

    fn ascii() -> Vec<u8> {
        let mut text = "solid cube\n".to_owned();
        for face in cube() {
            text += "facet normal 0 0 0\nouter loop\n";
            for [x, y, z] in face {
                text += &format!("vertex {x} {y} {z}\n");
            }
            text += "endloop\nendfacet\n";
        }
        (text + "endsolid cube\n").into_bytes()
    }

    fn obj() -> Vec<u8> {
        let faces = cube();
        let vertices = faces.iter().flatten().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect::<String>();
        let list = (0..faces.len()).map(|i| format!("f {} {} {}\n", 3 * i + 1, 3 * i + 2, 3 * i + 3));
        format!("mtllib none.mtl\n{vertices}{}", list.collect::<String>()).into_bytes()
    }

    #[test]
    fn binary_and_ascii_stl_and_obj_are_read_alike() {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in [("a.stl", binary()), ("b.STL", ascii()), ("c.obj", obj())] {
            let file = folder.path().join(name);
            std::fs::write(&file, bytes).unwrap();
            let mesh = read(&file, |vertex| vertex * 0.5).unwrap();
            assert_eq!(mesh.triangles.len(), 12, "{name}");
            assert!((mesh.volume - 1.0).abs() < 1e-6, "{name}: {}", mesh.volume);
            let corners: Vec<_> = mesh.triangles.iter().flatten().collect();
            assert!(corners.iter().all(|v| v.iter().all(|x| (0.0..=1.0).contains(x))), "{name}");
        }
    }

    #[test]
    fn what_is_no_mesh_is_a_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let mut cut = binary();
        cut.truncate(200);
        let mut huge = vec![0; 80];
        huge.extend(u32::MAX.to_le_bytes());
        for (name, bytes) in [
            ("a.dae", b"<xml/>".to_vec()),
            ("b.stl", Vec::new()),
            ("c.stl", b"solid\nnonsense".to_vec()),
            ("d.obj", b"f 1 2 3\n".to_vec()),
            ("e.stl", cut),
            ("f.stl", huge),
            ("g.obj", b"v 1e30 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n".to_vec()),
        ] {
            let file = folder.path().join(name);
            std::fs::write(&file, bytes).unwrap();
            let why = read(&file, |vertex| vertex).unwrap_err();
            assert!(why.contains(name) && why.contains(' '), "{why}");
        }
    }

    /// Damage is an error or other triangles, never a panic. FORETRACE_FUZZ_CASES=N: N cases of each format.
    #[test]
    fn damaged_meshes_are_an_error_or_finite_triangles() {
        let cases = std::env::var("FORETRACE_FUZZ_CASES").map_or(300, |text| text.parse().expect("a number"));
        let folder = tempfile::tempdir().unwrap();
        let mut dice = Dice::new();
        for (name, whole) in [("a.stl", binary()), ("b.stl", ascii()), ("c.obj", obj())] {
            let file = folder.path().join(name);
            let mut read_anyway = 0;
            for _ in 0..cases {
                let mut bytes = whole.clone();
                for _ in 0..1 + dice.below(5) {
                    let at = dice.below(bytes.len());
                    match dice.below(5) {
                        0 => bytes[at] = dice.below(256) as u8,
                        1 => bytes[at] = b"0123456789-. \nfev/"[dice.below(18)],
                        2 => drop(bytes.drain(at..(at + 9).min(bytes.len()))),
                        3 => bytes.insert(at, b"-9 /"[dice.below(4)]),
                        _ => bytes.truncate(at.max(1)),
                    }
                    if bytes.is_empty() {
                        bytes.push(0);
                    }
                }
                std::fs::write(&file, &bytes).unwrap();
                match read(&file, |vertex| vertex) {
                    Ok(mesh) => {
                        let mut corners = mesh.triangles.iter().flatten().flatten();
                        assert!(corners.all(|x| x.is_finite()), "{name}");
                        read_anyway += 1;
                    }
                    Err(why) => assert!(why.contains(name), "{why}"),
                }
            }
            assert!(read_anyway > 0 && read_anyway < cases, "{name}: {read_anyway}");
        }
    }

    #[test]
    fn packages_are_found_above_the_description_by_option_and_by_environment() {
        let root = tempfile::tempdir().unwrap();
        let mesh = root.path().join("arm_description/meshes/a.stl");
        std::fs::create_dir_all(mesh.parent().unwrap()).unwrap();
        std::fs::create_dir_all(root.path().join("arm_description/urdf")).unwrap();
        std::fs::write(&mesh, binary()).unwrap();
        let name = "package://arm_description/meshes/a.stl";
        let inside = MeshFolders::new(&root.path().join("arm_description/urdf/arm.urdf"), Vec::new());
        assert_eq!(inside.find(name).unwrap(), mesh);
        assert_eq!(
            inside.find("../meshes/a.stl").unwrap().canonicalize().unwrap(),
            mesh.canonicalize().unwrap()
        );
        assert_eq!(inside.find(&format!("file://{}", mesh.display())).unwrap(), mesh);
        let elsewhere = |packages, shelves| MeshFolders { folder: "/usr".into(), packages, shelves };
        let why = elsewhere(Vec::new(), Vec::new()).find(name).unwrap_err();
        assert!(why.contains("--package arm_description=DIR"), "{why}");
        let named = vec![("arm_description".to_owned(), root.path().join("arm_description"))];
        assert_eq!(elsewhere(named, Vec::new()).find(name).unwrap(), mesh);
        assert_eq!(elsewhere(Vec::new(), vec![root.path().to_path_buf()]).find(name).unwrap(), mesh);
        assert!(inside.find("package://arm_description/none.stl").unwrap_err().contains("no file"));
    }
}
