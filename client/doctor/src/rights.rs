//! Rights of this user, as the kernel lists them for this process: priority and locked memory.

use foretraced::rt::os::{self, Missing, Right};

use crate::finding::{CheckResult, Need};
use crate::machine::{KernelFiles, Silent, garbage};

const PRIORITY: &str = "rt-priority";
const MEMORY: &str = "memory-lock";
const LIMITS: &str = "proc/self/limits";
const STATUS: &str = "proc/self/status";

/// Numbers of capabilities. Source: linux/capability.h.
const CAP_IPC_LOCK: u32 = 14;
const CAP_SYS_NICE: u32 = 23;

/// Bound of what the daemon maps, all of which counts [bytes]: 223 MiB were measured without peers, most of
/// it address space that the allocator sets aside per thread.
const DAEMON_MAPS_BYTES: u64 = 512 << 20;

/// SCHED_FIFO: RLIMIT_RTPRIO or CAP_SYS_NICE.
pub(crate) fn priority(machine: &KernelFiles, need: &Need) -> CheckResult {
    let capable = capable(machine, CAP_SYS_NICE);
    if capable == Ok(true) {
        return CheckResult::ok(PRIORITY, format!("any (CAP_SYS_NICE); the settings want {}", need.priority));
    }
    let limit = match limit(machine, "Max realtime priority") {
        Ok(limit) => limit,
        Err(silent) => return CheckResult::unseen(PRIORITY, LIMITS, silent),
    };
    let shown = limit.map_or_else(|| "unlimited".to_owned(), |limit| limit.to_string());
    let value = format!("RLIMIT_RTPRIO {shown}, no CAP_SYS_NICE; the settings want {}", need.priority);
    if limit.is_none_or(|limit| limit >= u64::from(need.priority)) {
        return CheckResult::ok(PRIORITY, value);
    }
    CheckResult::bad(PRIORITY, value, format!("{}; {IN_A_CONTAINER}", os::fifo_remedy(need.priority)))
}

const IN_A_CONTAINER: &str =
    "in a container: `docker run --cap-add=SYS_NICE --ulimit rtprio=99 --ulimit memlock=-1`";

/// Memory that stays: RLIMIT_MEMLOCK or CAP_IPC_LOCK, unless the trial showed otherwise.
pub(crate) fn memory(machine: &KernelFiles, need: &Need, missing: &[Missing]) -> CheckResult {
    let listed = listed(machine, need);
    match missing.iter().find(|missing| missing.right == Right::MemoryLock) {
        Some(refused) if listed.ok => {
            CheckResult::bad(MEMORY, format!("refused, although {}", listed.value), &refused.text)
        }
        _ => listed,
    }
}

fn listed(machine: &KernelFiles, need: &Need) -> CheckResult {
    if !need.lock_memory {
        return CheckResult::warning(
            MEMORY,
            "off in the settings: a tick may wait for a page",
            "set loop.lock_memory = true in the settings file",
        );
    }
    if capable(machine, CAP_IPC_LOCK) == Ok(true) {
        return CheckResult::ok(MEMORY, "unlimited (CAP_IPC_LOCK)");
    }
    match limit(machine, "Max locked memory") {
        Ok(None) => CheckResult::ok(MEMORY, "unlimited"),
        Ok(Some(bytes)) => {
            let value = format!(
                "RLIMIT_MEMLOCK {} KiB, no CAP_IPC_LOCK; the daemon maps up to {} KiB",
                bytes / 1024,
                DAEMON_MAPS_BYTES / 1024
            );
            if bytes >= DAEMON_MAPS_BYTES {
                CheckResult::ok(MEMORY, value)
            } else {
                CheckResult::bad(MEMORY, value, format!("{}; {IN_A_CONTAINER}", os::lock_remedy()))
            }
        }
        Err(silent) => CheckResult::unseen(MEMORY, LIMITS, silent),
    }
}

/// The soft limit of this process called `name`; `None` = unlimited.
fn limit(machine: &KernelFiles, name: &str) -> Result<Option<u64>, Silent> {
    let text = machine.text(LIMITS)?;
    let line = text.lines().find_map(|line| line.strip_prefix(name));
    let soft = line.and_then(|rest| rest.split_whitespace().next());
    match soft {
        Some("unlimited") => Ok(None),
        Some(number) => number.parse().map(Some).map_err(|_| garbage(LIMITS, number)),
        None => Err(Silent::Wrong(format!("/{LIMITS} has no line `{name}`"))),
    }
}

/// Whether this process has an effective capability.
fn capable(machine: &KernelFiles, bit: u32) -> Result<bool, Silent> {
    let text = machine.text(STATUS)?;
    let Some(mask) = text.lines().find_map(|line| line.strip_prefix("CapEff:")) else {
        return Err(Silent::Wrong(format!("/{STATUS} has no line `CapEff`")));
    };
    let mask = mask.trim();
    let bits = u64::from_str_radix(mask, 16).map_err(|_| garbage(STATUS, mask))?;
    Ok(bits >> bit & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Level;
    use crate::machine::made_up::MadeUp;

    fn made(priority: &str, memory: &str, capabilities: &str) -> MadeUp {
        let limits = format!(
            "Limit                     Soft Limit           Hard Limit           Units     \n\
             Max locked memory         {memory}              8388608              bytes     \n\
             Max realtime priority     {priority}                    99                    \n"
        );
        let status = format!("Name:\tx\nCapPrm:\tffff\nCapEff:\t{capabilities}\n");
        MadeUp::new(&[(LIMITS, limits.as_bytes()), (STATUS, status.as_bytes())])
    }

    fn judged(priority_limit: &str, memory_limit: &str, capabilities: &str) -> (CheckResult, CheckResult) {
        let made = made(priority_limit, memory_limit, capabilities);
        let machine = made.machine();
        (priority(&machine, &Need::USUAL), memory(&machine, &Need::USUAL, &[]))
    }

    #[test]
    fn limits_or_capabilities_grant_what_the_settings_want() {
        for (limit, bytes, mask) in [
            ("90", "unlimited", "0000000000000000"),
            ("80", "2147483648", "0"),
            ("0", "8388608", "000001fffeffffff"),
        ] {
            let (priority, memory) = judged(limit, bytes, mask);
            assert!(priority.ok && memory.ok, "{priority:?} {memory:?}");
        }
        // CAP_SYS_NICE alone does not lock memory.
        let (priority, memory) = judged("0", "8388608", "800000");
        assert!(priority.ok && memory.level == Level::Bad);
    }

    #[test]
    fn limits_that_are_too_low_name_file_and_line() {
        let (priority, memory) = judged("79", "8388608", "0");
        assert_eq!((priority.level, memory.level), (Level::Bad, Level::Bad));
        for part in ["rtprio 90", "/etc/security/limits.conf", "LimitRTPRIO=90", "--cap-add=SYS_NICE"] {
            assert!(priority.fix.contains(part), "{priority:?}");
        }
        assert!(memory.fix.contains("memlock unlimited") && memory.value.contains("8192 KiB"), "{memory:?}");
        let eager = Need { priority: 98, ..Need::USUAL };
        assert!(super::priority(&made("97", "0", "0").machine(), &eager).fix.contains("rtprio 98"));
    }

    #[test]
    fn a_lock_that_is_refused_all_the_same_is_bad() {
        let refused = [Missing { right: Right::MemoryLock, text: "do this".to_owned() }];
        let found = memory(&made("0", "unlimited", "0").machine(), &Need::USUAL, &refused);
        assert!(found.level == Level::Bad && found.fix == "do this", "{found:?}");
    }

    #[test]
    fn unlocked_memory_by_choice_is_a_warning() {
        let need = Need { lock_memory: false, ..Need::USUAL };
        let found = memory(&made("0", "0", "0").machine(), &need, &[]);
        assert!(found.level == Level::Warning && found.fix.contains("loop.lock_memory"), "{found:?}");
    }

    #[test]
    fn limits_that_cannot_be_read_are_a_warning() {
        for (limit, bytes, mask) in
            [("some", "many", "zz"), ("-1", "-1", ""), ("\u{fffd}", "1e9", "\u{fffd}")]
        {
            let (priority, memory) = judged(limit, bytes, mask);
            for found in [priority, memory] {
                assert!(found.level == Level::Warning && found.value.contains("not understood"), "{found:?}");
            }
        }
        for files in [&[][..], &[(LIMITS, &b"\xff\xfe"[..]), (STATUS, b"")]] {
            let made = MadeUp::new(files);
            let machine = made.machine();
            for found in [priority(&machine, &Need::USUAL), memory(&machine, &Need::USUAL, &[])] {
                assert!(found.level == Level::Warning && !found.fix.is_empty(), "{found:?}");
            }
        }
    }
}
