//! The processors: frequency scaling, idle states, and whether a core is isolated for the loop.

use crate::finding::{CheckResult, Need};
use crate::kernel::if_there;
use crate::machine::{KernelFiles, Silent, listed};

const GOVERNOR: &str = "cpu-governor";
const IDLE: &str = "idle-states";
const ISOLATION: &str = "isolated-cpus";

/// Frequency scaling. Source: admin-guide/pm/cpufreq.
pub(crate) fn governor(machine: &KernelFiles, need: &Need) -> CheckResult {
    let (mut fast, mut slow) = (Vec::new(), Vec::new());
    for cpu in machine.cpus_of_loop(need.cpu) {
        let path = format!("sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor");
        match if_there(machine.text(&path)) {
            Ok(None) => {}
            Ok(Some(name)) if name == "performance" => fast.push(cpu),
            Ok(Some(name))
                if !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_') =>
            {
                slow.push((cpu, name));
            }
            Ok(Some(name)) => {
                return CheckResult::unseen(GOVERNOR, &path, crate::machine::garbage(&path, &name));
            }
            Err(silent) => return CheckResult::unseen(GOVERNOR, &path, silent),
        }
    }
    let Some((cpu, name)) = slow.first() else {
        return match fast.is_empty() {
            true => CheckResult::ok(GOVERNOR, "no frequency scaling to be seen"),
            false => CheckResult::ok(GOVERNOR, format!("performance on CPU {}", listed(&fast))),
        };
    };
    let more = if slow.len() > 1 { format!(" and {} more", slow.len() - 1) } else { String::new() };
    CheckResult::warning(
        GOVERNOR,
        format!("{name} on CPU {cpu}{more}: a tick may begin at a low clock rate"),
        "`sudo cpupower frequency-set -g performance`, or `echo performance | sudo tee \
         /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor`",
    )
}

/// The deepest idle state that is not disabled, by what it costs to leave it. Source: admin-guide/pm/cpuidle.
pub(crate) fn idle(machine: &KernelFiles, need: &Need) -> CheckResult {
    let mut deepest: Option<(u64, String)> = None;
    let mut seen = false;
    for cpu in machine.cpus_of_loop(need.cpu) {
        let folder = format!("sys/devices/system/cpu/cpu{cpu}/cpuidle");
        for state in machine.names(&folder).into_iter().filter(|name| name.starts_with("state")) {
            seen = true;
            let latency = format!("{folder}/{state}/latency");
            let disabled = if_there(machine.value::<u32>(&format!("{folder}/{state}/disable")));
            if matches!(disabled, Ok(Some(flag)) if flag != 0) {
                continue;
            }
            match machine.value::<u64>(&latency) {
                Ok(us) if deepest.as_ref().is_none_or(|(most, _)| us > *most) => {
                    let name = machine.text(&format!("{folder}/{state}/name")).unwrap_or(state);
                    deepest = Some((us, name));
                }
                Ok(_) => {}
                Err(silent) => return CheckResult::unseen(IDLE, &latency, silent),
            }
        }
    }
    let Some((us, name)) = deepest else {
        let what =
            if seen { "all disabled" } else { "none to be seen: the idle CPU waits, or its host decides" };
        return CheckResult::ok(IDLE, what);
    };
    let value = format!("deepest {name}, {us} µs to leave it; the period is {} µs", need.period_us);
    // A tenth of the period is lost at each wake-up; the spin before a release hides what is shorter than
    // itself.
    if us * 10 >= need.period_us {
        CheckResult::bad(IDLE, value, idle_fix(need))
    } else if us > need.spin_us.max(50) {
        CheckResult::warning(IDLE, value, idle_fix(need))
    } else {
        CheckResult::ok(IDLE, value)
    }
}

fn idle_fix(need: &Need) -> String {
    format!(
        "`sudo cpupower idle-set -D {}`; for good: boot with `intel_idle.max_cstate=1 \
         processor.max_cstate=1`",
        need.spin_us.max(50)
    )
}

/// Isolated cores, and whether the loop is on one.
pub(crate) fn isolation(machine: &KernelFiles, need: &Need) -> CheckResult {
    let online = match machine.online() {
        Ok(online) if !online.is_empty() => online,
        Ok(_) => {
            return CheckResult::unseen(
                ISOLATION,
                "sys/devices/system/cpu/online",
                Silent::Wrong("no CPU is online".into()),
            );
        }
        Err(silent) => return CheckResult::unseen(ISOLATION, "sys/devices/system/cpu/online", silent),
    };
    if let Some(cpu) = need.cpu.filter(|cpu| !online.contains(cpu)) {
        return CheckResult::bad(
            ISOLATION,
            format!("loop.cpu = {cpu} does not run; these do: {}", listed(&online)),
            format!("set loop.cpu to one of {} in the settings file, or leave it out", listed(&online)),
        );
    }
    let path = "sys/devices/system/cpu/isolated";
    let isolated = match if_there(machine.cpus(path)) {
        Ok(isolated) => isolated.unwrap_or_default(),
        Err(silent) => return CheckResult::unseen(ISOLATION, path, silent),
    };
    let free: Vec<u32> = isolated.iter().copied().filter(|cpu| online.contains(cpu)).collect();
    match (need.cpu, free.as_slice(), online.as_slice()) {
        (Some(cpu), free, _) if free.contains(&cpu) => CheckResult::ok(
            ISOLATION,
            format!("the loop has CPU {cpu} to itself (isolated: {})", listed(free)),
        ),
        (pinned, [.., last], _) => CheckResult::warning(
            ISOLATION,
            format!("CPU {} isolated, but the loop {}", listed(&free), pinned_to(pinned)),
            format!("set loop.cpu = {last} in the settings file (or --set loop.cpu={last})"),
        ),
        (pinned, [], [.., last]) if online.len() > 2 => CheckResult::warning(
            ISOLATION,
            format!("none of {}; the loop {}", online.len(), pinned_to(pinned)),
            format!(
                "boot with `isolcpus={last} nohz_full={last} rcu_nocbs={last}` (GRUB_CMDLINE_LINUX in \
                 /etc/default/grub, \
                 `sudo update-grub`), then set loop.cpu = {last}"
            ),
        ),
        (pinned, [], _) => CheckResult::ok(
            ISOLATION,
            format!(
                "none; with {} CPUs there is none to spare, the loop {}",
                online.len(),
                pinned_to(pinned)
            ),
        ),
    }
}

fn pinned_to(pinned: Option<u32>) -> String {
    pinned.map_or_else(|| "is not pinned".to_owned(), |cpu| format!("is pinned to CPU {cpu}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Level;
    use crate::machine::made_up::MadeUp;

    const ONLINE: (&str, &[u8]) = ("sys/devices/system/cpu/online", b"0-3\n");

    fn pinned(cpu: u32) -> Need {
        Need { cpu: Some(cpu), ..Need::USUAL }
    }

    #[test]
    fn the_governor_counts_where_the_loop_may_run() {
        let made = MadeUp::new(&[ONLINE]);
        assert!(governor(&made.machine(), &Need::USUAL).ok);
        for cpu in 0..4 {
            made.put(&format!("sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor"), b"performance\n");
        }
        assert_eq!(governor(&made.machine(), &Need::USUAL).value, "performance on CPU 0-3");
        made.put("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", b"powersave\n");
        let found = governor(&made.machine(), &Need::USUAL);
        assert!(found.level == Level::Warning && found.fix.contains("cpupower frequency-set -g performance"));
        assert!(governor(&made.machine(), &pinned(3)).ok);
        for garbage in [&b""[..], b"\xff\xfe", b"a b"] {
            made.put("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", garbage);
            let found = governor(&made.machine(), &Need::USUAL);
            assert!(found.level == Level::Warning && found.value.contains("not understood"), "{found:?}");
        }
    }

    #[test]
    fn idle_states_are_judged_by_the_deepest_that_is_on_against_the_period() {
        let made = MadeUp::new(&[("sys/devices/system/cpu/online", b"0")]);
        assert!(idle(&made.machine(), &Need::USUAL).ok);
        let state = |k: u32, name: &str, us: &[u8], disable: &[u8]| {
            let folder = format!("sys/devices/system/cpu/cpu0/cpuidle/state{k}");
            made.put(&format!("{folder}/name"), name.as_bytes());
            made.put(&format!("{folder}/latency"), us);
            made.put(&format!("{folder}/disable"), disable);
        };
        state(0, "POLL", b"0\n", b"0\n");
        state(1, "C1", b"2\n", b"0\n");
        assert!(idle(&made.machine(), &Need::USUAL).ok);
        state(2, "C6", b"133\n", b"0\n");
        let found = idle(&made.machine(), &Need::USUAL);
        assert!(found.level == Level::Warning && found.value.contains("C6, 133 µs"), "{found:?}");
        // The same sleep is too deep for a faster loop.
        let fast = Need { rate_hz: 1000, period_us: 1000, ..Need::USUAL };
        assert_eq!(idle(&made.machine(), &fast).level, Level::Bad);
        state(2, "C6", b"133\n", b"1\n");
        assert!(idle(&made.machine(), &fast).ok);
        for garbage in [&b""[..], b"deep", b"\xff", b"-1"] {
            state(1, "C1", garbage, b"0");
            let found = idle(&made.machine(), &Need::USUAL);
            assert!(found.level == Level::Warning && found.value.contains("not understood"), "{found:?}");
        }
    }

    #[test]
    fn an_isolated_core_counts_when_the_loop_is_on_it() {
        let judged = |online: &[u8], isolated: &[u8], need: &Need| {
            let files = [(ONLINE.0, online), ("sys/devices/system/cpu/isolated", isolated)];
            isolation(&MadeUp::new(&files).machine(), need)
        };
        assert!(judged(b"0-3", b"3\n", &pinned(3)).ok);
        for need in [Need::USUAL, pinned(1)] {
            let found = judged(b"0-3", b"2-3\n", &need);
            assert!(found.level == Level::Warning && found.fix.contains("loop.cpu = 3"), "{found:?}");
        }
        let found = judged(b"0-3", b"\n", &Need::USUAL);
        assert!(found.level == Level::Warning && found.fix.contains("isolcpus=3"), "{found:?}");
        assert!(judged(b"0-1", b"\n", &Need::USUAL).ok);
        let found = judged(b"0-1", b"\n", &pinned(7));
        assert!(found.level == Level::Bad && found.fix.contains("0-1"), "{found:?}");
        // Isolated, but switched off.
        assert!(judged(b"0-1", b"2-3", &Need::USUAL).ok);
        for (online, isolated) in [(&b"x"[..], &b""[..]), (b"", b""), (b"0-3", b"\xff\xff"), (b"0-3", b"9-1")]
        {
            let found = judged(online, isolated, &Need::USUAL);
            assert!(found.level == Level::Warning && !found.fix.is_empty(), "{found:?}");
        }
        assert_eq!(isolation(&MadeUp::new(&[]).machine(), &Need::USUAL).level, Level::Warning);
        assert!(
            isolation(&MadeUp::new(&[("sys/devices/system/cpu/online", b"0-1")]).machine(), &Need::USUAL).ok
        );
    }
}
