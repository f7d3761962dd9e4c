//! What dead instances left behind, and its removal on request.
//!
//! Contract: nothing that a living process may use is removed, so files of an unknown instance are only
//! named. The middleware can hang on damaged files: every call of it has a timeout.

use std::path::{Path, PathBuf};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use foretrace_client::Instance;
use foretrace_shm::{Cleaned, InstanceError, Leftovers, Prefixed, SHARED_MEMORY, effective_user, prefixed};
use serde::Serialize;

use crate::bounded::{asked, within};
use crate::finding::CheckResult;
use crate::machine::{KernelFiles, Silent};
use foretrace_failure::Failure;

const LEFTOVERS: &str = "leftovers";
/// Milliseconds are usual.
const PATIENCE: Duration = Duration::from_secs(3);

/// What was removed from one instance; keys are stable.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Removed {
    instance: u32,
    root: PathBuf,
    dead_nodes: usize,
    segments: usize,
    bytes: u64,
}

/// What was found in one instance; `None` where the middleware hangs.
type FoundLeftovers = (Instance, Option<Result<Leftovers, InstanceError>>);

/// Which instances to look at: one with a folder of its own is private and stands alone.
#[derive(Debug)]
pub(crate) struct CleanScope {
    instances: Vec<Instance>,
    alone: bool,
}

impl CleanScope {
    /// The instance of the settings, and unless it is private all others of this user.
    pub(crate) fn new(own: &Instance, everybody: &[Instance], private: bool) -> Self {
        let instances = if private { vec![own.clone()] } else { everybody.to_vec() };
        Self { instances, alone: private }
    }
}

/// The instance of the settings first, then all others of this user that can be found.
pub(crate) fn in_sight(own: &Instance) -> Vec<Instance> {
    let mut roots: Vec<PathBuf> = Vec::new();
    // Demos that were killed.
    for entry in std::fs::read_dir("/tmp").into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with("foretrace-demo-") {
            roots.push(entry.path().join("root"));
        }
    }
    let mut all = vec![own.clone()];
    all.extend(Instance::in_sight(&roots).into_iter().filter(|other| other != own));
    all
}

/// A running daemon of any of them: instance and process.
pub(crate) fn daemon(instances: &[Instance]) -> Option<(u32, u32)> {
    instances.iter().find_map(|instance| instance.daemon().map(|mark| (instance.number(), mark.pid)))
}

/// Removes what dead processes left behind, and reports each instance at once: a later one may fail.
pub(crate) fn clean(scope: &CleanScope, mut tell: impl FnMut(&Removed)) -> Result<Vec<Removed>, Failure> {
    let mut removed = Vec::new();
    for instance in &scope.instances {
        let there = instance.clone();
        let cleaned = match within(PATIENCE, move || there.clean()) {
            Some(Ok(cleaned)) => cleaned,
            Some(Err(error)) => {
                let what = format!("instance {} not cleaned: {error}", instance.number());
                return Err(Failure::failed(what, ""));
            }
            None => {
                let what = format!(
                    "cleaning instance {} takes longer than {} s",
                    instance.number(),
                    PATIENCE.as_secs()
                );
                return Err(Failure::failed(what, by_hand(instance)));
            }
        };
        let Cleaned { nodes, segments, bytes, failed } = cleaned;
        if failed > 0 {
            let what = format!(
                "{failed} nodes of dead processes in instance {} could not be cleaned up",
                instance.number()
            );
            return Err(Failure::failed(what, by_hand(instance)));
        }
        if cleaned != Cleaned::default() {
            let root = instance.root().to_path_buf();
            let done = Removed { instance: instance.number(), root, dead_nodes: nodes, segments, bytes };
            tell(&done);
            removed.push(done);
        }
    }
    Ok(removed)
}

impl Removed {
    pub fn words(&self) -> String {
        format!(
            "removed of instance {} ({}): {} nodes of dead processes, {} files in {SHARED_MEMORY}, {} KiB",
            self.instance,
            self.root.display(),
            self.dead_nodes,
            self.segments,
            self.bytes.div_ceil(1024)
        )
    }
}

/// What is left behind now.
pub(crate) fn judge(machine: &KernelFiles, scope: &CleanScope) -> CheckResult {
    // All at once: several that hang take no longer than one.
    let look = |instance: &Instance| {
        let there = instance.clone();
        (instance.clone(), asked(move || there.leftovers()))
    };
    let asked: Vec<_> = scope.instances.iter().map(look).collect();
    let deadline = Instant::now() + PATIENCE;
    let answer = |(instance, answer): (Instance, Option<Receiver<_>>)| {
        let left = deadline.saturating_duration_since(Instant::now());
        (instance, answer.and_then(|answer| answer.recv_timeout(left).ok()))
    };
    let found: Vec<FoundLeftovers> = asked.into_iter().map(answer).collect();
    let strangers = match scope.alone {
        true => Vec::new(),
        false => strangers(machine, Path::new(SHARED_MEMORY), &scope.instances, effective_user()),
    };
    judged(&found, &strangers)
}

fn judged(found: &[FoundLeftovers], strangers: &[Prefixed]) -> CheckResult {
    let (mut values, mut fixes, mut worst) = (Vec::new(), Vec::new(), None);
    for (index, (instance, found)) in found.iter().enumerate() {
        match found {
            Some(Ok(left)) if left.is_empty() => {}
            Some(Ok(left)) => {
                let segments = if left.in_use() {
                    String::new()
                } else {
                    amount(left.memory.segments, left.memory.bytes)
                };
                let dead = left.dead.len() + left.damaged;
                values.push(format!(
                    "instance {}: {dead} nodes of dead processes{segments}",
                    instance.number()
                ));
                fixes.push("`foretrace doctor --clean` with the same options".to_owned());
            }
            Some(Err(error)) => {
                values.push(format!("instance {}: {error}", instance.number()));
                fixes.push(format!("see to {}", instance.root().display()));
                // The daemon of these settings would hang in the same way.
                worst = worst.or((index == 0).then_some(()));
            }
            None => {
                values.push(format!(
                    "instance {}: looking takes longer than {} s",
                    instance.number(),
                    PATIENCE.as_secs()
                ));
                fixes.push(by_hand(instance));
                worst = worst.or((index == 0).then_some(()));
            }
        }
    }
    for group in strangers {
        values.push(format!(
            "{}*: no process to be seen{}",
            group.prefix,
            amount(group.segments, group.bytes)
        ));
        fixes.push(format!("`rm {SHARED_MEMORY}/{}*` if no container uses it either", group.prefix));
    }
    fixes.dedup();
    match (values.is_empty(), worst) {
        (true, _) => CheckResult::ok(LEFTOVERS, format!("none ({} instances in sight)", found.len())),
        (false, None) => CheckResult::warning(LEFTOVERS, values.join("; "), fixes.join("; ")),
        (false, Some(())) => CheckResult::bad(LEFTOVERS, values.join("; "), fixes.join("; ")),
    }
}

fn amount(segments: usize, bytes: u64) -> String {
    format!(", {segments} files in {SHARED_MEMORY}, {} KiB", bytes.div_ceil(1024))
}

fn by_hand(instance: &Instance) -> String {
    format!(
        "end all programs of this instance, then `rm -r {SHARED_MEMORY}/{}* {}/iox2`",
        instance.prefix(),
        instance.root().display()
    )
}

/// Files of this user in `folder` that belong to none of the instances and are mapped by no process. Where a
/// process cannot be looked into, nothing counts as unused.
fn strangers(machine: &KernelFiles, folder: &Path, instances: &[Instance], user: u32) -> Vec<Prefixed> {
    let mut groups = prefixed(folder).unwrap_or_default();
    groups
        .retain(|group| group.owner == user && !instances.iter().any(|known| known.prefix() == group.prefix));
    if groups.is_empty() {
        return groups;
    }
    for process in machine.names("proc").iter().filter(|name| name.bytes().all(|byte| byte.is_ascii_digit()))
    {
        match machine.text(&format!("proc/{process}/maps")) {
            Ok(maps) => groups.retain(|group| !maps.contains(&format!("/{}", group.prefix))),
            // Ended meanwhile.
            Err(Silent::Missing) => {}
            // A process of another user, which has no access to this user's instances; an unknown owner
            // counts as a user.
            Err(Silent::Wrong(_)) if owner_differs(machine, process, user) => {}
            Err(Silent::Wrong(_)) => return Vec::new(),
        }
    }
    groups
}

fn owner_differs(machine: &KernelFiles, process: &str, user: u32) -> bool {
    let status = machine.text(&format!("proc/{process}/status")).unwrap_or_default();
    let uids = status.lines().find_map(|line| line.strip_prefix("Uid:"));
    let effective = uids.and_then(|uids| uids.split_whitespace().nth(1)?.parse::<u32>().ok());
    effective.is_some_and(|owner| owner != user)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Level;
    use crate::machine::made_up::MadeUp;

    fn instance(number: u32) -> Instance {
        Instance::at(number, format!("/tmp/no-such-folder-{number}")).unwrap()
    }

    #[test]
    fn the_dead_are_a_warning_and_the_living_none() {
        let alive = Leftovers { alive: vec![1], ..Leftovers::default() };
        let dead = Leftovers { dead: vec![7, 8], ..Leftovers::default() };
        let own = |found| [(instance(0), found)];
        assert!(judged(&own(Some(Ok(alive))), &[]).ok);
        let found = judged(&own(Some(Ok(dead))), &[]);
        assert!(
            found.level == Level::Warning
                && found.value.contains("2 nodes of dead")
                && found.fix.contains("--clean"),
            "{found:?}"
        );
    }

    #[test]
    fn an_own_instance_that_hangs_or_is_refused_makes_the_machine_unfit_another_does_not() {
        let refused = || Some(Err(InstanceError::NotADirectory { root: "/tmp/x".into() }));
        for found in [None, refused()] {
            let judged = judged(&[(instance(0), found)], &[]);
            assert!(judged.level == Level::Bad && !judged.fix.is_empty(), "{judged:?}");
        }
        for found in [None, refused()] {
            let fine = Some(Ok(Leftovers::default()));
            let judged = judged(&[(instance(0), fine), (instance(1), found)], &[]);
            assert!(judged.level == Level::Warning && judged.value.contains("instance 1"), "{judged:?}");
        }
    }

    #[test]
    fn files_of_nobody_are_named_and_those_in_use_are_not() {
        let shm = tempfile::tempdir().unwrap();
        let (known, lost, used) = (instance(1), instance(2), instance(3));
        for instance in [&known, &lost, &used] {
            std::fs::write(shm.path().join(format!("{}x.data", instance.prefix())), [0; 100]).unwrap();
        }
        let maps = format!("7f00-7f01 rw-s 0 00:1 5 /dev/shm/{}x.data\n", used.prefix());
        let made = MadeUp::new(&[
            ("proc/12/maps", maps.as_bytes()),
            ("proc/13/maps", b"\xff\xfe"),
            ("proc/x/maps", b""),
        ]);
        let me = effective_user();
        let names = |made: &MadeUp, user: u32| -> Vec<String> {
            let groups = strangers(&made.machine(), shm.path(), std::slice::from_ref(&known), user);
            groups.into_iter().map(|group| group.prefix).collect()
        };
        assert_eq!(names(&made, me), [lost.prefix()]);
        assert!(names(&made, me + 1).is_empty());
        let found = judged(&[], &strangers(&made.machine(), shm.path(), std::slice::from_ref(&known), me));
        assert!(
            found.level == Level::Warning && found.fix.contains(&format!("rm /dev/shm/{}*", lost.prefix()))
        );
        // A folder in place of the maps cannot be read: that process may use the files.
        made.put("proc/14/maps/x", b"");
        assert!(names(&made, me).is_empty());
        made.put("proc/14/status", format!("Uid:\t1\t{}\t1\t1\n", me + 5).as_bytes());
        assert_eq!(names(&made, me), [lost.prefix()]);
        made.put("proc/14/status", b"Uid:\tgarbage\n");
        assert!(names(&made, me).is_empty());
    }
}
