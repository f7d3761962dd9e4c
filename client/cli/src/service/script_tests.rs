//! The Debian package's script before its removal, run with a systemctl that writes down what it is told.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Command, Output};

const PRERM: &str = include_str!("../../package/scripts/prerm");

/// What the script ended with, and the calls that changed something; `systemctl` tells that units are in the
/// folder `units`, and ends with `code` where it is to disable.
fn removed(argument: &str, units: &str, code: u8, told: u8) -> (Output, String) {
    let folder = tempfile::tempdir().unwrap();
    let systemd = folder.path().join("systemd");
    fs::create_dir(&systemd).unwrap();
    let [script, systemctl, calls] = ["prerm", "systemctl", "calls"].map(|name| folder.path().join(name));
    assert!(PRERM.contains("-d /run/systemd/system"));
    fs::write(&script, PRERM.replace("/run/systemd/system", systemd.to_str().unwrap())).unwrap();
    let fake = format!(
        "#!/bin/sh\nif [ \"$1\" = show ]; then\n  for unit; do :; done\n  echo {units}/$unit\n  exit {told}\nfi\n\
         echo \"$*\" >>{}\nexit {code}\n",
        calls.display()
    );
    fs::write(&systemctl, fake).unwrap();
    fs::set_permissions(&systemctl, fs::Permissions::from_mode(0o755)).unwrap();
    let mut path = folder.path().as_os_str().to_owned();
    path.push(":/usr/bin:/bin");
    let output = Command::new("/bin/sh").arg(&script).arg(argument).env("PATH", path).output().unwrap();
    (output, fs::read_to_string(calls).unwrap_or_default())
}

#[test]
fn the_package_goes_only_after_its_daemon_has_stopped() {
    for units in ["/usr/lib/systemd/system", "/lib/systemd/system"] {
        let (output, calls) = removed("remove", units, 0, 0);
        assert!(output.status.success(), "{output:?}");
        assert_eq!(calls, "disable --now foretrace-gateway.service\ndisable --now foretraced.service\n");
        // An update leaves the daemon alone.
        let (output, calls) = removed("upgrade", units, 0, 0);
        assert!(output.status.success() && calls.is_empty(), "{calls}");
        let (output, _) = removed("remove", units, 1, 0);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && said.contains("was not stopped: the package stays"), "{said}");
    }
    let (output, calls) = removed("remove", "/usr/lib/systemd/system", 0, 1);
    assert!(!output.status.success() && calls.is_empty(), "{output:?}");
}

#[test]
fn a_unit_of_the_administrator_is_not_the_package_s_to_disable() {
    let (output, calls) = removed("remove", "/etc/systemd/system", 1, 0);
    assert!(output.status.success() && calls.is_empty(), "{calls}");
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("/etc/systemd/system/foretraced.service is not the package's"), "{said}");
}
