//! The memory of the machine, or of its container.

use std::{fs, path::Path};

use crate::worker;

/// Bytes, and whose they are; `None` where the system does not say.
pub(super) fn of_machine() -> Option<(u64, &'static str)> {
    let machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| meminfo(&text));
    let cgroups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let limit = cgroup_limit(Path::new("/sys/fs/cgroup"), &cgroups);
    let most = machine.into_iter().chain(limit).min()?;
    Some((most, if limit == Some(most) { "this container" } else { "this machine" }))
}

/// What jobs may take of it: a tenth is for the rest of the service, the system and its files.
pub(super) fn for_jobs() -> Option<(u64, &'static str)> {
    of_machine().map(|(most, whose)| (most / 10 * 9, whose))
}

/// Lowers the budget of workers to what the machine or its container has, so that the system kills no process.
pub(super) fn within(config: worker::Config) -> worker::Config {
    let Some((limit, whose)) = for_jobs() else { return config };
    let (wanted, memory_budget) = (config.memory_budget, config.memory_budget.min(limit));
    if config.workers > 0 && memory_budget < wanted {
        tracing::warn!(wanted, memory_budget, "memory_mb is lowered to nine tenths of the memory of {whose}");
    }
    worker::Config { memory_budget, memory_limit: Some(limit), ..config }
}

/// `MemTotal` of `/proc/meminfo`, bytes.
fn meminfo(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// The smallest limit of the control groups of `/proc/self/cgroup`, bytes. They are mounted at `root`, in version 1 or
/// 2, with the path of the process (a unit of systemd) or, in a container, with its own group as the root.
fn cgroup_limit(root: &Path, cgroups: &str) -> Option<u64> {
    let groups = cgroups.lines().filter_map(|line| {
        let (_, group) = line.split_once(':')?;
        let (controllers, path) = group.split_once(':')?;
        let (folder, file) = match controllers {
            "" => (root.to_owned(), "memory.max"),
            "memory" => (root.join("memory"), "memory.limit_in_bytes"),
            _ => return None,
        };
        Some([folder.join(file), folder.join(path.trim_start_matches('/')).join(file)])
    });
    // "max" is no number
    groups.flatten().filter_map(|file| fs::read_to_string(file).ok()?.trim().parse().ok()).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_memory_of_the_machine_is_read() {
        assert_eq!(meminfo("MemFree: 3 kB\nMemTotal:       24576 kB\n"), Some(24_576 * 1024));
        assert_eq!(meminfo("nothing"), None);
    }

    #[test]
    fn the_limit_of_a_container_or_unit_is_read_in_both_versions_of_control_groups() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |file: &str, text: &str| {
            let file = folder.path().join(file);
            fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
            fs::write(file, text).expect("a file");
        };
        let limit = |cgroups: &str| cgroup_limit(folder.path(), cgroups);
        assert_eq!(limit("0::/\n"), None);
        write("memory.max", "max\n");
        write("system.slice/pinstack.service/memory.max", "2147483648\n");
        assert_eq!(limit("0::/\n"), None);
        assert_eq!(limit("0::/system.slice/pinstack.service\n"), Some(2 << 30));
        // version 1: the path is that of the host
        write("memory/memory.limit_in_bytes", "1073741824\n");
        assert_eq!(limit("11:cpu:/docker/a\n9:memory:/docker/a\n0::/\n"), Some(1 << 30));
    }
}
