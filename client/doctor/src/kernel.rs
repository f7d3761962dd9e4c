//! The kernel: pre-emption, throttling of real-time threads, clock source.

use crate::finding::{CheckResult, Need};
use crate::machine::{KernelFiles, Silent};

const PREEMPTION: &str = "kernel-preemption";
const THROTTLING: &str = "rt-throttling";
const CLOCK: &str = "clock-source";

/// How soon a thread of higher priority gets the CPU while the kernel works for another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Preemption {
    /// PREEMPT_RT: nearly at once.
    RealTime,
    /// At the end of the spinlock or interrupt at hand.
    Full,
    /// As with full pre-emption for real-time threads.
    Lazy,
    /// At marked places.
    Voluntary,
    /// On return to the program.
    None,
    /// Chosen at boot, and not to be seen from here.
    Hidden,
}

/// Pre-emption of the kernel itself. Source: kernel/Kconfig.preempt, `preempt=` in
/// admin-guide/kernel-parameters.
pub(crate) fn preemption(machine: &KernelFiles) -> CheckResult {
    let path = "proc/sys/kernel/version";
    let version = match machine.text(path) {
        Ok(version) if version.contains('#') => version,
        Ok(version) => {
            return CheckResult::unseen(PREEMPTION, path, crate::machine::garbage(path, &version));
        }
        Err(silent) => return CheckResult::unseen(PREEMPTION, path, silent),
    };
    let boot =
        "add `preempt=full` to GRUB_CMDLINE_LINUX in /etc/default/grub, then `sudo update-grub` and reboot";
    let best = "install a PREEMPT_RT kernel for the best guarantee (Debian: `sudo apt install \
                linux-image-rt-amd64`; \
                Ubuntu: `sudo pro enable realtime-kernel`) and reboot";
    match model(machine, &version) {
        Preemption::RealTime => CheckResult::ok(PREEMPTION, "PREEMPT_RT"),
        Preemption::Full => CheckResult::warning(PREEMPTION, "full, not PREEMPT_RT", best),
        Preemption::Lazy => {
            CheckResult::warning(PREEMPTION, "lazy (full for real-time threads), not PREEMPT_RT", best)
        }
        Preemption::Voluntary => {
            CheckResult::bad(PREEMPTION, "voluntary: a system call can hold a tick up", boot)
        }
        Preemption::None => CheckResult::bad(
            PREEMPTION,
            "none: any system call can hold a tick up",
            format!("{boot}; or {best}"),
        ),
        Preemption::Hidden => CheckResult::warning(
            PREEMPTION,
            "chosen at boot (PREEMPT_DYNAMIC), cannot be seen from here",
            format!(
                "`sudo cat /sys/kernel/debug/sched/preempt` should show (full) or (lazy); if not, {boot}"
            ),
        ),
    }
}

fn model(machine: &KernelFiles, version: &str) -> Preemption {
    let flags: Vec<&str> = version.split_whitespace().collect();
    if flags.contains(&"PREEMPT_RT") || machine.value::<u32>("sys/kernel/realtime") == Ok(1) {
        return Preemption::RealTime;
    }
    if flags.contains(&"PREEMPT_DYNAMIC") {
        // The running model, the boot parameter, the build option: the first that can be read.
        return running(machine)
            .or_else(|| asked(machine))
            .or_else(|| built(machine))
            .unwrap_or(Preemption::Hidden);
    }
    if flags.contains(&"PREEMPT") {
        return if built(machine) == Some(Preemption::Lazy) { Preemption::Lazy } else { Preemption::Full };
    }
    if built(machine) == Some(Preemption::Voluntary) { Preemption::Voluntary } else { Preemption::None }
}

fn named(name: &str) -> Option<Preemption> {
    match name {
        "full" => Some(Preemption::Full),
        "lazy" => Some(Preemption::Lazy),
        "voluntary" => Some(Preemption::Voluntary),
        "none" => Some(Preemption::None),
        _ => None,
    }
}

/// The one in brackets.
fn running(machine: &KernelFiles) -> Option<Preemption> {
    let text = machine.text("sys/kernel/debug/sched/preempt").ok()?;
    text.split_whitespace().find_map(|word| named(word.strip_prefix('(')?.strip_suffix(')')?))
}

fn asked(machine: &KernelFiles) -> Option<Preemption> {
    let line = machine.text("proc/cmdline").ok()?;
    line.split_whitespace().filter_map(|word| named(word.strip_prefix("preempt=")?)).next_back()
}

fn built(machine: &KernelFiles) -> Option<Preemption> {
    let release = machine.text("proc/sys/kernel/osrelease").ok().filter(|release| !release.contains('/'))?;
    let config = machine.text(&format!("boot/config-{release}")).ok()?;
    let has = |key: &str| config.lines().any(|line| line.strip_prefix(key) == Some("=y"));
    [
        ("CONFIG_PREEMPT", Preemption::Full),
        ("CONFIG_PREEMPT_LAZY", Preemption::Lazy),
        ("CONFIG_PREEMPT_VOLUNTARY", Preemption::Voluntary),
        ("CONFIG_PREEMPT_NONE", Preemption::None),
    ]
    .into_iter()
    .find_map(|(key, model)| has(key).then_some(model))
}

/// The share of each period that real-time threads may take together. Source: scheduler/sched-rt-group in the
/// kernel's documentation.
pub(crate) fn throttling(machine: &KernelFiles, need: &Need) -> CheckResult {
    let (runtime_path, period_path) =
        ("proc/sys/kernel/sched_rt_runtime_us", "proc/sys/kernel/sched_rt_period_us");
    let runtime: i64 = match machine.value(runtime_path) {
        Ok(runtime) => runtime,
        Err(silent) => return CheckResult::unseen(THROTTLING, runtime_path, silent),
    };
    if runtime < 0 {
        return CheckResult::ok(THROTTLING, "off");
    }
    let period: i64 = match machine.value(period_path) {
        Ok(period) if period > 0 => period,
        Ok(period) => {
            let silent = crate::machine::garbage(period_path, &period.to_string());
            return CheckResult::unseen(THROTTLING, period_path, silent);
        }
        Err(silent) => return CheckResult::unseen(THROTTLING, period_path, silent),
    };
    let share = runtime as f64 / period as f64;
    // The loop spins, then works for at most about half a period before it sheds.
    let wanted = 0.5 + need.spin_us as f64 / need.period_us.max(1) as f64;
    let value = format!(
        "real-time threads get {:.0} % of every {:.1} s, the loop at most {:.0} %",
        100.0 * share,
        period as f64 / 1e6,
        100.0 * wanted
    );
    let fix = "`sudo sysctl -w kernel.sched_rt_runtime_us=950000 kernel.sched_rt_period_us=1000000`; for \
               good: both \
               lines in /etc/sysctl.d/90-foretrace.conf";
    if share < wanted {
        CheckResult::bad(THROTTLING, value, fix)
    } else if share < 0.9 {
        CheckResult::warning(THROTTLING, value, fix)
    } else {
        CheckResult::ok(THROTTLING, value)
    }
}

/// The hardware behind CLOCK_MONOTONIC: slow ones cost a microsecond or a system call at each of a tick's
/// dozen readings.
pub(crate) fn clock(machine: &KernelFiles) -> CheckResult {
    let folder = "sys/devices/system/clocksource/clocksource0";
    let path = format!("{folder}/current_clocksource");
    let current = match machine.text(&path) {
        Ok(current) if is_word(&current) => current,
        Ok(current) => return CheckResult::unseen(CLOCK, &path, crate::machine::garbage(&path, &current)),
        Err(silent) => return CheckResult::unseen(CLOCK, &path, silent),
    };
    match current.as_str() {
        "tsc" | "kvm-clock" | "arch_sys_counter" | "hyperv_clocksource_tsc_page" => {
            CheckResult::ok(CLOCK, current)
        }
        _ => {
            let available = machine.text(&format!("{folder}/available_clocksource")).unwrap_or_default();
            let fast = ["tsc", "kvm-clock"]
                .into_iter()
                .find(|name| available.split_whitespace().any(|a| a == *name));
            let fix = match fast {
                Some(fast) => {
                    format!("`echo {fast} | sudo tee /{path}`; for good: boot with `clocksource={fast}`")
                }
                None => {
                    "boot with `tsc=reliable` if the processor's counter is invariant (`grep nonstop_tsc \
                         /proc/cpuinfo`); in a virtual machine, let the host pass it through"
                        .to_owned()
                }
            };
            match current.as_str() {
                "jiffies" | "refined-jiffies" => {
                    CheckResult::bad(CLOCK, format!("{current}: counts whole ticks of the kernel only"), fix)
                }
                "hpet" | "acpi_pm" => CheckResult::warning(CLOCK, format!("{current}: slow to read"), fix),
                _ => CheckResult::warning(CLOCK, format!("{current}: may be slow to read"), fix),
            }
        }
    }
}

fn is_word(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_".contains(&byte))
}

/// The content of a file that may legitimately be absent.
pub(crate) fn if_there<T>(read: Result<T, Silent>) -> Result<Option<T>, Silent> {
    match read {
        Ok(value) => Ok(Some(value)),
        Err(Silent::Missing) => Ok(None),
        Err(wrong) => Err(wrong),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Level;
    use crate::machine::made_up::MadeUp;

    const VERSION: &str = "proc/sys/kernel/version";

    fn preempts(files: &[(&str, &[u8])]) -> CheckResult {
        preemption(&MadeUp::new(files).machine())
    }

    #[test]
    fn the_model_is_read_from_the_version_and_from_what_was_chosen_at_boot() {
        let level = |files: &[(&str, &[u8])]| preempts(files).level;
        assert_eq!(level(&[(VERSION, b"#1 SMP PREEMPT_RT Debian 6.12")]), Level::Ok);
        assert_eq!(level(&[(VERSION, b"#1 SMP PREEMPT x"), ("sys/kernel/realtime", b"1\n")]), Level::Ok);
        assert_eq!(level(&[(VERSION, b"#1 SMP PREEMPT x"), ("sys/kernel/realtime", b"0\n")]), Level::Warning);
        assert_eq!(level(&[(VERSION, b"#1 SMP Debian 6.1")]), Level::Bad);
        let dynamic: (&str, &[u8]) = (VERSION, b"#1 SMP PREEMPT_DYNAMIC x");
        assert!(preempts(&[dynamic]).value.contains("cannot be seen"));
        let debug = "sys/kernel/debug/sched/preempt";
        assert_eq!(level(&[dynamic, (debug, b"none voluntary (full) lazy\n")]), Level::Warning);
        assert_eq!(
            level(&[dynamic, (debug, b"none (voluntary) full\n"), ("proc/cmdline", b"preempt=full")]),
            Level::Bad
        );
        assert_eq!(level(&[dynamic, ("proc/cmdline", b"quiet preempt=none")]), Level::Bad);
        assert!(
            preempts(&[dynamic, ("proc/cmdline", b"preempt=voluntary preempt=lazy")]).value.contains("lazy")
        );
        let release: (&str, &[u8]) = ("proc/sys/kernel/osrelease", b"6.1.0-9\n");
        let config = "boot/config-6.1.0-9";
        assert_eq!(level(&[dynamic, release, (config, b"CONFIG_PREEMPT_VOLUNTARY=y\n")]), Level::Bad);
        assert_eq!(
            level(&[dynamic, release, (config, b"# CONFIG_PREEMPT_NONE is not set\nCONFIG_PREEMPT=y\n")]),
            Level::Warning
        );
    }

    #[test]
    fn a_kernel_that_does_not_say_is_a_warning_with_a_fix() {
        for files in [&[][..], &[(VERSION, &[0xff_u8, 0][..])], &[(VERSION, &b""[..])]] {
            let found = preempts(files);
            assert_eq!((found.level, found.ok), (Level::Warning, false), "{found:?}");
            assert!(found.fix.contains(VERSION), "{found:?}");
        }
        // A release that leads elsewhere is not followed.
        let found =
            preempts(&[(VERSION, b"#1 SMP PREEMPT_DYNAMIC"), ("proc/sys/kernel/osrelease", b"../../x")]);
        assert!(found.value.contains("cannot be seen"), "{found:?}");
    }

    #[test]
    fn throttling_is_judged_against_what_the_loop_takes() {
        let judged = |runtime: &[u8], period: &[u8]| {
            let files = [
                ("proc/sys/kernel/sched_rt_runtime_us", runtime),
                ("proc/sys/kernel/sched_rt_period_us", period),
            ];
            throttling(&MadeUp::new(&files).machine(), &Need::USUAL)
        };
        assert_eq!(judged(b"-1\n", b"1000000\n").level, Level::Ok);
        assert_eq!(judged(b"950000\n", b"1000000\n").level, Level::Ok);
        assert_eq!(judged(b"800000\n", b"1000000\n").level, Level::Warning);
        for runtime in [&b"0"[..], b"500000"] {
            let found = judged(runtime, b"1000000");
            assert_eq!(found.level, Level::Bad);
            assert!(found.fix.contains("sysctl -w kernel.sched_rt_runtime_us"), "{found:?}");
        }
        for (runtime, period) in
            [(&b"lots"[..], &b"1000000"[..]), (b"", b"1"), (b"950000", b"0"), (b"950000", b"\xff")]
        {
            let found = judged(runtime, period);
            assert_eq!(found.level, Level::Warning, "{found:?}");
            assert!(!found.fix.is_empty() && found.value.contains("sched_rt_"), "{found:?}");
        }
        let nothing = throttling(&MadeUp::new(&[]).machine(), &Need::USUAL);
        assert!(nothing.level == Level::Warning && nothing.value.contains("there is no"), "{nothing:?}");
    }

    #[test]
    fn a_slow_clock_is_named_with_the_faster_one_that_is_there() {
        let judged = |current: &[u8], available: &[u8]| {
            let folder = "sys/devices/system/clocksource/clocksource0";
            let made = MadeUp::new(&[]);
            made.put(&format!("{folder}/current_clocksource"), current);
            made.put(&format!("{folder}/available_clocksource"), available);
            clock(&made.machine())
        };
        assert_eq!(judged(b"tsc\n", b"tsc hpet").level, Level::Ok);
        assert_eq!(judged(b"kvm-clock\n", b"").level, Level::Ok);
        let slow = judged(b"hpet\n", b"hpet tsc acpi_pm");
        assert!(slow.level == Level::Warning && slow.fix.contains("echo tsc | sudo tee /sys"), "{slow:?}");
        assert!(judged(b"acpi_pm\n", b"acpi_pm").fix.contains("tsc=reliable"));
        assert_eq!(judged(b"jiffies\n", b"jiffies").level, Level::Bad);
        for garbage in [&b""[..], b"\xff\xff", b"a b c", b"tsc; rm -rf"] {
            let found = judged(garbage, b"tsc");
            assert!(found.level == Level::Warning && found.value.contains("not understood"), "{found:?}");
        }
        assert_eq!(clock(&MadeUp::new(&[]).machine()).level, Level::Warning);
    }
}
