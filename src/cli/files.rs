//! The limit of open files and sockets of the process.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// File descriptors per connection: its socket, and the file that it sends or receives.
const PER_CONNECTION: u64 = 2;
/// File descriptors for the database, the jobs and the connections without a slot.
const OTHERS: u64 = 256;

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

/// The number of connections, at most `wanted`, that a limit of open files allows. At most half of the limit is kept
/// for everything else.
pub fn fitting(wanted: usize, limit: Option<u64>) -> usize {
    let Some(limit) = limit else { return wanted };
    let others = OTHERS.min(limit / 2);
    let fit = (limit - others) / PER_CONNECTION;
    wanted.min(usize::try_from(fit).unwrap_or(usize::MAX)).max(1)
}

#[cfg(test)]
mod tests {
    use super::fitting;

    #[test]
    fn connections_fit_into_the_limit_of_open_files() {
        for (wanted, limit, fit) in [
            (1024, None, 1024),
            (1024, Some(1 << 20), 1024),
            (1024, Some(2304), 1024),
            (1024, Some(2302), 1023),
            (1024, Some(1024), 384),
            (1024, Some(64), 16),
            (10, Some(1024), 10),
            (10, Some(0), 1),
        ] {
            assert_eq!(fitting(wanted, limit), fit, "{wanted} {limit:?}");
        }
    }
}
