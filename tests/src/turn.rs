//! Turns of the tests on the machine. It has two places: a test takes one, a test that measures or computes
//! takes both.

use std::fs::{File, TryLockError};
use std::os::unix::fs::MetadataExt as _;
use std::time::Duration;

const PLACES: usize = 2;

/// Ends with the value: the locks go with their files, also when the test is killed.
pub struct Turn {
    _places: Vec<File>,
}

impl Turn {
    /// Waits for one place; one other test may run meanwhile.
    ///
    /// # Panics
    /// No lock file can be made in the temporary directory.
    #[must_use]
    #[allow(dead_code, reason = "the daemon's own tests always want to be alone")]
    pub fn beside_another() -> Self {
        loop {
            for place in 0..PLACES {
                let file = lock_file(place);
                match file.try_lock() {
                    Ok(()) => return Self { _places: vec![file] },
                    Err(TryLockError::WouldBlock) => {}
                    Err(TryLockError::Error(error)) => panic!("a file lock: {error}"),
                }
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits for every place.
    ///
    /// # Panics
    /// As above.
    #[must_use]
    pub fn alone() -> Self {
        let places = (0..PLACES).map(lock_file);
        Self { _places: places.inspect(|file| file.lock().expect("a file lock")).collect() }
    }
}

fn lock_file(place: usize) -> File {
    let user = std::fs::metadata("/proc/self").expect("a user of its own").uid();
    let path = std::env::temp_dir().join(format!("foretrace-tests-{user}-{place}.lock"));
    File::create(path).expect("a lock file in the temporary directory")
}
