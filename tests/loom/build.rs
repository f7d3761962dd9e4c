//! Builds the shipped code under loom: the ring's source as cargo fetched it, and the daemon's hand-over.
//!
//! Only paths in the text are changed: those of the atomics, and those of the ring and its parts.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

fn main() {
    println!("cargo::rustc-check-cfg=cfg(loom)");
    println!("cargo::rerun-if-changed=build.rs");
    // Another ring may be shipped.
    println!("cargo::rerun-if-changed=../../Cargo.lock");
    if env::var_os("CARGO_CFG_LOOM").is_none() {
        return;
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let ring = ring_source();
    let mut text = body(&ring.join("lib.rs"));
    for part in ["cache_padded", "arc_ring_buffer", "chunks"] {
        let declared = format!("mod {part};");
        assert!(
            text.contains(&declared),
            "the ring has no part `{part}` any more: adapt tests/loom/build.rs"
        );
        text = text
            .replace(&declared, &format!("mod {part} {{\n{}\n}}", body(&ring.join(format!("{part}.rs")))));
    }
    assert!(
        text.contains("core::sync::atomic"),
        "the ring's atomics come from elsewhere: adapt tests/loom/build.rs"
    );
    let text = text.replace("core::sync::atomic", "loom::sync::atomic").replace("crate::", "crate::rtrb::");
    write(&out.join("rtrb.rs"), &text.replace("extern crate alloc;", ""));

    let handover = Path::new("../../daemon/src/rt/handover.rs");
    write(&out.join("handover.rs"), &body(handover).replace("use rtrb::", "use crate::rtrb::"));
}

/// A source file without inner attributes, because it is put into a module.
fn body(path: &Path) -> String {
    println!("cargo::rerun-if-changed={}", path.display());
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut attribute = false;
    let kept = text.lines().filter(|line| {
        let head = attribute || line.starts_with("//!") || line.starts_with("#![");
        attribute = (attribute || line.starts_with("#![")) && !line.ends_with(")]");
        !head
    });
    kept.map(|line| format!("{line}\n")).collect()
}

/// Where cargo keeps the source of the ring that the workspace's lock file names.
fn ring_source() -> PathBuf {
    let cargo = env::var_os("CARGO").expect("cargo names itself");
    let target = env::var("TARGET").expect("cargo sets TARGET");
    // Without the filter, packages for other systems would be missing, which were never fetched.
    let words = ["metadata", "--format-version", "1", "--locked", "--offline", "--filter-platform", &target];
    let output = Command::new(cargo).args(words).output();
    let metadata =
        String::from_utf8(output.expect("cargo metadata runs").stdout).expect("cargo writes UTF-8");
    let manifests = metadata.split("\"manifest_path\":\"").skip(1).filter_map(|rest| rest.split('"').next());
    let folders = manifests.filter_map(|manifest| Path::new(manifest).parent());
    let mut rings = folders.filter(|folder| {
        let name = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name == "rtrb" || name.starts_with("rtrb-")
    });
    let ring = rings.next().expect("the workspace depends on rtrb").join("src");
    assert!(rings.next().is_none(), "two versions of rtrb: which one is shipped?");
    ring
}

fn write(path: &Path, text: &str) {
    fs::write(path, text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}
