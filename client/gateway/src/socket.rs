//! The gateway's socket in the file system: made, given its mode and group, taken away at the end.
//!
//! Contract: replaces nothing that exists, except a dead socket of the own user. Between `bind` and `chmod`
//! the socket has the umask's mode; that admits nobody, because every client is checked by the user ID from
//! the kernel.

use std::fs;
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, chown};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use foretrace_failure::Failure;

/// A socket that clients can connect to. Dropping it removes its file.
#[derive(Debug)]
pub struct GatewaySocket {
    listener: UnixListener,
    path: PathBuf,
    identity: (u64, u64),
}

fn wrong(path: &Path, what: impl std::fmt::Display, remedy: &'static str) -> Failure {
    Failure::bad_input(format_args!("--socket {}: {what}", path.display()), remedy)
}

impl GatewaySocket {
    /// Opens a socket at `path` with permission bits `mode`, and `group` where one is named.
    ///
    /// # Errors
    ///
    /// The folder is missing or open to others, the path is taken, or the system refuses.
    pub fn open(path: &Path, mode: u32, group: Option<u32>) -> Result<Self, Failure> {
        let user = foretrace_shm::effective_user();
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let found = fs::metadata(folder).map_err(|error| {
            wrong(path, format_args!("{}: {error}", folder.display()), "make the folder first")
        })?;
        let (bits, sticky) = (found.mode(), found.mode() & 0o1000 != 0);
        if !found.is_dir() {
            return Err(wrong(
                path,
                format_args!("{} is no folder", folder.display()),
                "name a path in a folder",
            ));
        }
        if bits & 0o022 != 0 && !sticky {
            let what = format_args!("{} is writable by others (mode {:03o})", folder.display(), bits & 0o777)
                .to_string();
            return Err(wrong(
                path,
                what,
                "another user could put a socket in its place: chmod go-w the folder",
            ));
        }
        clear(path, user)?;
        let refused = |error: io::Error| wrong(path, error, "choose another path for the socket");
        let listener = UnixListener::bind(path).map_err(refused)?;
        let found = fs::symlink_metadata(path).map_err(refused)?;
        let socket = Self { listener, path: path.to_path_buf(), identity: (found.dev(), found.ino()) };
        if let Some(group) = group {
            chown(path, None, Some(group)).map_err(|error| {
                wrong(
                    path,
                    format_args!("group {group}: {error}"),
                    "name a group that this user is a member of",
                )
            })?;
        }
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).map_err(refused)?;
        socket.listener.set_nonblocking(true).map_err(refused)?;
        Ok(socket)
    }

    /// The next pending connection, if there is one.
    pub fn accept(&self) -> io::Result<Option<UnixStream>> {
        match self.listener.accept() {
            Ok((stream, _)) => Ok(Some(stream)),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::Interrupted | ErrorKind::ConnectionAborted
                ) =>
            {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }
}

impl Drop for GatewaySocket {
    fn drop(&mut self) {
        // Somebody may have put another one in its place.
        let ours = |found: &fs::Metadata| (found.dev(), found.ino()) == self.identity;
        if fs::symlink_metadata(&self.path).as_ref().is_ok_and(ours) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Makes room: removes a socket of `user` without a listener.
fn clear(path: &Path, user: u32) -> Result<(), Failure> {
    let found = match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(wrong(path, error, "choose another path for the socket")),
        Ok(found) => found,
    };
    if !found.file_type().is_socket() {
        return Err(wrong(path, "exists and is no socket", "remove it, or choose another path"));
    }
    if found.uid() != user {
        let what = format!("is a socket of user {}, this is user {user}", found.uid());
        return Err(wrong(path, what, "choose another path"));
    }
    match UnixStream::connect(path) {
        Ok(_) => {
            Err(wrong(path, "another gateway listens there", "end that gateway, or choose another path"))
        }
        Err(error) if error.kind() == ErrorKind::ConnectionRefused => fs::remove_file(path)
            .map_err(|error| wrong(path, error, "remove the dead socket, or choose another path")),
        Err(error) => Err(wrong(path, error, "remove it, or choose another path")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn what(result: Result<GatewaySocket, Failure>) -> String {
        result.unwrap_err().what
    }

    #[test]
    fn the_socket_has_its_mode_and_goes_with_its_gateway() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen");
        let socket = GatewaySocket::open(&path, 0o660, None).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o7777, 0o660);
        assert!(what(GatewaySocket::open(&path, 0o660, None)).contains("another gateway listens"));
        drop(socket);
        assert!(!path.exists());
    }

    #[test]
    fn a_dead_socket_is_replaced_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen");
        drop(UnixListener::bind(&path).unwrap());
        assert!(path.exists());
        drop(GatewaySocket::open(&path, 0o600, None).unwrap());
        fs::write(&path, "precious").unwrap();
        assert!(what(GatewaySocket::open(&path, 0o600, None)).contains("no socket"));
        assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
        fs::remove_file(&path).unwrap();
        std::os::unix::fs::symlink("/etc/passwd", &path).unwrap();
        assert!(what(GatewaySocket::open(&path, 0o600, None)).contains("no socket"));
        let long = folder.path().join("x".repeat(200));
        assert!(what(GatewaySocket::open(&long, 0o600, None)).contains("--socket"));
    }

    #[test]
    fn a_folder_that_others_may_write_or_that_is_none_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let open = folder.path().join("open");
        fs::create_dir(&open).unwrap();
        fs::set_permissions(&open, fs::Permissions::from_mode(0o777)).unwrap();
        assert!(what(GatewaySocket::open(&open.join("pen"), 0o600, None)).contains("mode 777"));
        // As /tmp: only the owner of a file may replace it.
        fs::set_permissions(&open, fs::Permissions::from_mode(0o1777)).unwrap();
        drop(GatewaySocket::open(&open.join("pen"), 0o600, None).unwrap());
        assert!(
            what(GatewaySocket::open(&folder.path().join("no/pen"), 0o600, None)).contains("No such file")
        );
    }

    #[test]
    fn a_socket_put_in_its_place_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen");
        let socket = GatewaySocket::open(&path, 0o600, None).unwrap();
        fs::remove_file(&path).unwrap();
        let _other = UnixListener::bind(&path).unwrap();
        drop(socket);
        assert!(path.exists());
    }
}
