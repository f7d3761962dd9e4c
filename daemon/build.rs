//! Names the build of the control law: a hash of everything that can change a bit of its commands.
//!
//! These are the sources of the law, of the settings and of the messages' conversion, the lock file, and the
//! compiler with its target and profile. Programs that link the same law get the same name.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// Folders and files that the law is made of, seen from the workspace.
const SOURCES: [&str; 7] = [
    "Cargo.lock",
    "Cargo.toml",
    "daemon/control/Cargo.toml",
    "daemon/control/src",
    "daemon/src/wire",
    "config/src",
    "config/models",
];

/// What cargo says about the compilation.
const FLAGS: [&str; 4] = ["TARGET", "PROFILE", "CARGO_CFG_TARGET_FEATURE", "CARGO_ENCODED_RUSTFLAGS"];

fn main() {
    let workspace = Path::new("..");
    let mut hash = Hash(0xcbf2_9ce4_8422_2325);
    for source in SOURCES {
        println!("cargo::rerun-if-changed=../{source}");
        let mut files = Vec::new();
        collect(&workspace.join(source), &mut files);
        files.sort();
        for file in files {
            hash.add(file.to_string_lossy().as_bytes());
            hash.add(&fs::read(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display())));
        }
    }
    for flag in FLAGS {
        hash.add(env::var(flag).unwrap_or_default().as_bytes());
    }
    let compiler = env::var_os("RUSTC").expect("cargo names the compiler");
    hash.add(&Command::new(compiler).arg("-vV").output().expect("the compiler runs").stdout);
    println!("cargo::rustc-env=FORETRACE_LAW={:016x}", hash.0);
}

/// FNV-1a, with the length of each part, so that nothing moves from one to the next unseen.
struct Hash(u64);

impl Hash {
    fn add(&mut self, bytes: &[u8]) {
        for byte in (bytes.len() as u64).to_le_bytes().iter().chain(bytes) {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

fn collect(place: &Path, files: &mut Vec<PathBuf>) {
    if !place.is_dir() {
        files.push(place.to_path_buf());
        return;
    }
    let entries = fs::read_dir(place).unwrap_or_else(|error| panic!("{}: {error}", place.display()));
    for entry in entries {
        collect(&entry.expect("a folder can be read").path(), files);
    }
}
