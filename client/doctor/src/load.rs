//! What others took while the rehearsal ran: CPU time stolen by the hypervisor, interrupts of devices.
//!
//! Contract: counters are read before and after; what cannot be read, or runs backwards, is reported and not
//! guessed.

use std::collections::BTreeMap;

use crate::finding::{CheckResult, Need};
use crate::machine::{KernelFiles, Silent, garbage};

const STEAL: &str = "hypervisor-steal";
const IRQS: &str = "irq-affinity";
const STAT: &str = "proc/stat";
const INTERRUPTS: &str = "proc/interrupts";

/// Per device interrupt: its name, counts per CPU.
type Interrupts = BTreeMap<u32, (String, BTreeMap<u32, u64>)>;

/// Counters of one moment.
#[derive(Debug)]
pub(crate) struct Snapshot {
    /// Per CPU: all time, stolen time, in units of USER_HZ.
    times: Result<BTreeMap<u32, (u64, u64)>, Silent>,
    interrupts: Result<Interrupts, Silent>,
}

impl Snapshot {
    pub(crate) fn take(machine: &KernelFiles) -> Self {
        Self {
            times: machine.text(STAT).and_then(|text| times(&text)),
            interrupts: machine.text(INTERRUPTS).and_then(|text| interrupts(&text)),
        }
    }
}

/// Lines `cpuN user nice system idle iowait irq softirq steal guest guest_nice`. Source: proc_stat(5).
fn times(text: &str) -> Result<BTreeMap<u32, (u64, u64)>, Silent> {
    let mut found = BTreeMap::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let cpu = words.next().and_then(|name| name.strip_prefix("cpu")?.parse().ok());
        let Some(cpu) = cpu else { continue };
        let counts: Option<Vec<u64>> = words.map(|word| word.parse().ok()).collect();
        // Guest time is part of user time: only the first eight make up the whole.
        let Some(counts) = counts.filter(|counts| counts.len() >= 8) else { return Err(garbage(STAT, line)) };
        let all = counts.iter().take(8).fold(0, |sum: u64, count| sum.saturating_add(*count));
        found.insert(cpu, (all, counts[7]));
    }
    if found.is_empty() { Err(garbage(STAT, text)) } else { Ok(found) }
}

/// Numbered lines of /proc/interrupts: those are the devices'. The header names the CPUs of the columns.
fn interrupts(text: &str) -> Result<Interrupts, Silent> {
    let mut lines = text.lines();
    let header = lines.next().unwrap_or_default();
    let cpus: Option<Vec<u32>> =
        header.split_whitespace().map(|word| word.strip_prefix("CPU")?.parse().ok()).collect();
    let Some(cpus) = cpus.filter(|cpus| !cpus.is_empty()) else { return Err(garbage(INTERRUPTS, header)) };
    let mut found = BTreeMap::new();
    for line in lines {
        let Some((number, rest)) = line.trim_start().split_once(':') else { continue };
        let Ok(number) = number.parse() else { continue };
        let words: Vec<&str> = rest.split_whitespace().collect();
        let counts: Option<Vec<u64>> = words.iter().take(cpus.len()).map(|word| word.parse().ok()).collect();
        let Some(counts) = counts.filter(|counts| counts.len() == cpus.len()) else {
            return Err(garbage(INTERRUPTS, line));
        };
        let name = words.last().filter(|_| words.len() > cpus.len()).map_or("unnamed", |name| name);
        found.insert(number, (name.to_owned(), cpus.iter().copied().zip(counts).collect()));
    }
    Ok(found)
}

/// Time that the host gave to others, on the CPUs of the loop.
pub(crate) fn steal(machine: &KernelFiles, need: &Need, before: &Snapshot, after: &Snapshot) -> CheckResult {
    let (before, after) = match (&before.times, &after.times) {
        (Ok(before), Ok(after)) => (before, after),
        (Err(silent), _) | (_, Err(silent)) => return CheckResult::unseen(STEAL, STAT, silent.clone()),
    };
    let mut worst: Option<(f64, u32)> = None;
    for cpu in machine.cpus_of_loop(need.cpu) {
        let (Some(then), Some(now)) = (before.get(&cpu), after.get(&cpu)) else { continue };
        // Idle time is known to step back by a unit; the rest of the sum then still grows.
        let all = now.0.saturating_sub(then.0).max(1);
        let share = now.1.saturating_sub(then.1) as f64 / all as f64;
        if worst.is_none_or(|(most, _)| share > most) {
            worst = Some((share.min(1.0), cpu));
        }
    }
    let Some((share, cpu)) = worst else {
        return CheckResult::unseen(
            STEAL,
            STAT,
            Silent::Wrong(format!("/{STAT} has no line for the CPUs of the loop")),
        );
    };
    let host = if machine.is_virtual() { "virtual machine" } else { "no hypervisor to be seen" };
    if share <= 0.0 {
        return CheckResult::ok(STEAL, format!("none during the run ({host})"));
    }
    let value = format!("{:.2} % of CPU {cpu} during the run ({host})", 100.0 * share);
    let fix = "run on the hardware itself, or give the virtual machine CPUs of its own (on the host, for \
               example `virsh \
               vcpupin DOMAIN 0 2` and `isolcpus=2`)";
    if share > 0.01 { CheckResult::bad(STEAL, value, fix) } else { CheckResult::warning(STEAL, value, fix) }
}

/// Device interrupts where the loop runs.
pub(crate) fn irqs(
    machine: &KernelFiles,
    need: &Need,
    before: &Snapshot,
    after: &Snapshot,
    seconds: f64,
) -> CheckResult {
    let (before, after) = match (&before.interrupts, &after.interrupts) {
        (Ok(before), Ok(after)) => (before, after),
        (Err(silent), _) | (_, Err(silent)) => return CheckResult::unseen(IRQS, INTERRUPTS, silent.clone()),
    };
    let mut here = Vec::new();
    let mut per_cpu: BTreeMap<u32, u64> = BTreeMap::new();
    for (number, (name, counts)) in after {
        for (cpu, count) in counts {
            let then = before.get(number).and_then(|(_, counts)| counts.get(cpu)).copied().unwrap_or(0);
            let came = count.saturating_sub(then);
            *per_cpu.entry(*cpu).or_default() += came;
            if came > 0 && Some(*cpu) == need.cpu {
                here.push((*number, name.clone(), came));
            }
        }
    }
    let rate = |count: u64| count as f64 / seconds.max(1e-3);
    let Some(cpu) = need.cpu else {
        let total: u64 = per_cpu.values().sum();
        return CheckResult::ok(
            IRQS,
            format!("the loop is not pinned; {:.0} device interrupts/s on all CPUs", rate(total)),
        );
    };
    if here.is_empty() {
        return CheckResult::ok(IRQS, format!("no device interrupt on CPU {cpu} during the run"));
    }
    here.sort_by_key(|(number, _, came)| (std::cmp::Reverse(*came), *number));
    let total: u64 = here.iter().map(|(_, _, came)| came).sum();
    let shown: Vec<String> =
        here.iter().take(3).map(|(number, name, _)| format!("{number} {name}")).collect();
    let elsewhere = machine.online().unwrap_or_default().into_iter().find(|other| *other != cpu).unwrap_or(0);
    let moves: Vec<String> = here
        .iter()
        .take(3)
        .map(|(number, ..)| format!("`echo {elsewhere} | sudo tee /proc/irq/{number}/smp_affinity_list`"))
        .collect();
    CheckResult::warning(
        IRQS,
        format!("{:.0} device interrupts/s on CPU {cpu}: {}", rate(total), shown.join(", ")),
        format!(
            "{}; for good: IRQBALANCE_BANNED_CPULIST={cpu} in /etc/default/irqbalance, boot with \
             `irqaffinity=` of the \
             other CPUs",
            moves.join(" ")
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Level;
    use crate::machine::made_up::MadeUp;

    const PINNED: Need = Need { cpu: Some(1), ..Need::USUAL };

    fn made(stat: &[u8], interrupts: &[u8]) -> MadeUp {
        MadeUp::new(&[(STAT, stat), (INTERRUPTS, interrupts), ("sys/devices/system/cpu/online", b"0-1\n")])
    }

    fn stat(steal: u64, idle: u64) -> Vec<u8> {
        format!(
            "cpu  9 9 9 9 9 9 9 9 0 0\ncpu0 1 1 1 {idle} 1 0 0 0 0 0\ncpu1 10 0 0 {idle} 0 0 0 {steal} 5 \
                 5\nintr 5\n"
        )
        .into()
    }

    fn both(before: &MadeUp, after: &MadeUp, need: &Need) -> (CheckResult, CheckResult) {
        let machine = after.machine();
        let (then, now) = (Snapshot::take(&before.machine()), Snapshot::take(&machine));
        (steal(&machine, need, &then, &now), irqs(&machine, need, &then, &now, 2.0))
    }

    #[test]
    fn stolen_time_is_a_share_of_the_run_and_of_the_worst_cpu() {
        let judged = |stolen: u64, idle: u64| {
            both(&made(&stat(100, 1000), b""), &made(&stat(100 + stolen, 1000 + idle), b""), &Need::USUAL).0
        };
        assert!(judged(0, 500).ok);
        let some = judged(1, 499);
        assert!(some.level == Level::Warning && some.value.contains("0.20 % of CPU 1"), "{some:?}");
        let much = judged(50, 450);
        assert!(much.level == Level::Bad && much.fix.contains("vcpupin"), "{much:?}");
        // Counters that run backwards are not a share beyond one.
        let back = both(&made(&stat(100, 1000), b""), &made(&stat(90, 10), b""), &Need::USUAL).0;
        assert!(back.ok, "{back:?}");
    }

    const TABLE: &str = "           CPU0       CPU1       \n 24:   5   7   IO-APIC   5-edge      ACPI:Ged\n \
                         36:   1  100   PCI-MSIX  1-edge      nvme0q1\nLOC:  9  9   Local timer \
                         interrupts\nERR:   0\n";

    #[test]
    fn interrupts_on_the_core_of_the_loop_are_named_with_the_way_to_move_them() {
        let later = TABLE.replace("  100 ", "  700 ").replace("24:   5 ", "24:  65 ");
        let (before, after) = (made(&stat(0, 0), TABLE.as_bytes()), made(&stat(0, 9), later.as_bytes()));
        let found = both(&before, &after, &PINNED).1;
        assert!(
            found.level == Level::Warning && found.value.contains("300 device interrupts/s on CPU 1"),
            "{found:?}"
        );
        assert!(found.value.contains("36 nvme0q1") && !found.value.contains("24"), "{found:?}");
        assert!(found.fix.contains("echo 0 | sudo tee /proc/irq/36/smp_affinity_list"), "{found:?}");
        assert!(both(&before, &before, &PINNED).1.ok);
        let free = both(&before, &after, &Need::USUAL).1;
        assert!(free.ok && free.value.contains("330 device interrupts/s"), "{free:?}");
    }

    #[test]
    fn counters_that_cannot_be_read_are_a_warning() {
        for (stat_text, table) in [
            (&b""[..], &b""[..]),
            (b"\xff\xfe\0", b"\xff\xfe\0"),
            (b"cpu0 1 2 3", b"nothing here"),
            (b"cpu0 1 2 3 4 5 6 7 many", b" CPU0 CPU1\n 24: x y z"),
            (b"intr 5", b" CPU0 CPU1\n 24: 1"),
        ] {
            let made = made(stat_text, table);
            let (steal, irqs) = both(&made, &made, &PINNED);
            for found in [steal, irqs] {
                assert!(found.level == Level::Warning && !found.fix.is_empty(), "{found:?}");
            }
        }
        let nothing = MadeUp::new(&[]);
        let (steal, irqs) = both(&nothing, &nothing, &Need::USUAL);
        assert!(steal.level == Level::Warning && irqs.level == Level::Warning);
        // The loop's CPU has no line.
        let made = made(b"cpu0 1 1 1 1 1 1 1 1\n", TABLE.as_bytes());
        assert_eq!(both(&made, &made, &PINNED).0.level, Level::Warning);
    }
}
