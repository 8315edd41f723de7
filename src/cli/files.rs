//! The limit of open files and sockets of the process.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// File descriptors per connection: its socket, and the file that it sends or receives.
const PER_CONNECTION: u64 = 2;
/// File descriptors per running job: the scratch files of a fusion (16 of slices, 16 of focus energies), its zip and
/// its results.
const PER_JOB: u64 = 40;
/// File descriptors for the database and the connections without a slot.
const OTHERS: u64 = 216;

/// Raises the soft limit to the hard limit and returns it; `None`: unlimited.
pub fn raise_limit() -> Option<u64> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current == maximum {
        return current;
    }
    match setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }) {
        Ok(()) => maximum,
        Err(error) => {
            tracing::warn!(%error, ?current, ?maximum, "cannot raise the limit of open files");
            current
        }
    }
}

/// The number of connections, at most `wanted`, that a limit of open files allows beside `jobs` running jobs. At most
/// half of the limit is kept for everything but connections.
pub fn fitting(wanted: usize, jobs: usize, limit: Option<u64>) -> usize {
    let Some(limit) = limit else { return wanted };
    let others = PER_JOB.saturating_mul(jobs as u64).saturating_add(OTHERS).min(limit / 2);
    let fit = (limit - others) / PER_CONNECTION;
    wanted.min(usize::try_from(fit).unwrap_or(usize::MAX)).max(1)
}

#[cfg(test)]
mod tests {
    use super::fitting;

    #[test]
    fn connections_fit_into_the_limit_of_open_files() {
        for (wanted, jobs, limit, fit) in [
            (1024, 1, None, 1024),
            (1024, 1, Some(1 << 20), 1024),
            (1024, 1, Some(2304), 1024),
            (1024, 1, Some(2302), 1023),
            (1024, 1, Some(1024), 384),
            (1024, 5, Some(1024), 304),
            // jobs take at most half
            (1024, 100, Some(1024), 256),
            (1024, usize::MAX, Some(1024), 256),
            (1024, 1, Some(64), 16),
            (10, 1, Some(1024), 10),
            (10, 1, Some(0), 1),
        ] {
            assert_eq!(fitting(wanted, jobs, limit), fit, "{wanted} {jobs} {limit:?}");
        }
    }
}
