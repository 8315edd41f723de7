//! The memory of the machine, or of its container.

use std::fs;

/// Bytes, and whose they are; `None` where the system does not say.
pub(super) fn of_machine() -> Option<(u64, &'static str)> {
    let machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| meminfo(&text));
    // the limit of a container, where cgroups are mounted as containers have them
    let limit = fs::read_to_string("/sys/fs/cgroup/memory.max").ok().and_then(|text| text.trim().parse::<u64>().ok());
    let most = machine.into_iter().chain(limit).min()?;
    Some((most, if limit == Some(most) { "this container" } else { "this machine" }))
}

/// `MemTotal` of `/proc/meminfo`, bytes.
fn meminfo(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_memory_of_the_machine_is_read() {
        assert_eq!(meminfo("MemFree: 3 kB\nMemTotal:       24576 kB\n"), Some(24_576 * 1024));
        assert_eq!(meminfo("nothing"), None);
    }
}
