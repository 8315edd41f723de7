//! How many files and sockets the process may have open.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// A connection and the file that it sends or receives.
const PER_CONNECTION: u64 = 2;
/// What the database, the jobs and the connections without a slot may have open beside.
const BESIDE: u64 = 256;

/// Raises the soft limit to the hard one, and says how many files may be open then; `None`: as many as one likes.
pub fn raise_limit() -> Option<u64> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current == maximum {
        return current;
    }
    match setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }) {
        Ok(()) => maximum,
        Err(error) => {
            tracing::warn!(%error, ?current, ?maximum, "the limit of open files cannot be raised");
            current
        }
    }
}

/// The most connections, up to `wanted`, that fit into a limit of open files. Of a small limit half is kept for the rest.
pub fn fitting(wanted: usize, limit: Option<u64>) -> usize {
    let Some(limit) = limit else { return wanted };
    let beside = BESIDE.min(limit / 2);
    let fit = (limit - beside) / PER_CONNECTION;
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
