//! The table of all series.

/// The type of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Increases only; 0 after a restart.
    Counter,
    /// A value at one moment.
    Gauge,
    /// Counts of observations in buckets.
    Histogram,
}

impl Kind {
    /// Name in the text format.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Counter => "counter",
            Self::Gauge => "gauge",
            Self::Histogram => "histogram",
        }
    }
}

/// One series, or one per combination of its labels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Series {
    /// Its name.
    pub name: &'static str,
    /// Its type.
    pub kind: Kind,
    /// The names of its labels.
    pub labels: &'static [&'static str],
    /// One sentence for `# HELP`.
    pub help: &'static str,
}

macro_rules! table {
    ($($constant:ident $kind:ident $name:literal [$($label:literal),*] $help:literal)*) => {
        $(
            #[doc = $help]
            pub const $constant: Series =
                Series { name: $name, kind: Kind::$kind, labels: &[$($label),*], help: $help };
        )*
        /// Every series.
        pub const ALL: &[Series] = &[$($constant),*];
    };
}

table! {
    HTTP_REQUESTS Counter "pinstack_http_requests_total" ["method", "route", "status"]
        "Requests answered"
    HTTP_REQUEST_SECONDS Histogram "pinstack_http_request_seconds" ["method", "route"]
        "Time from the head of a request to the headers of its response, without the time in pinstack_http_wait_seconds"
    HTTP_WAIT_SECONDS Histogram "pinstack_http_wait_seconds" ["method", "route", "on"]
        "Time in which a request waited for the bytes of its body or, with Prefer: wait, for the end of a job"
    HTTP_PROBLEMS Counter "pinstack_http_problems_total" ["code"]
        "Requests refused or failed, by the code of the problem"
    UPLOAD_BYTES Counter "pinstack_upload_bytes_total" []
        "Bytes of uploads received"

    JOBS Gauge "pinstack_jobs" ["kind", "state"]
        "Jobs in the database"
    OLDEST_QUEUED_SECONDS Gauge "pinstack_oldest_queued_job_seconds" ["kind"]
        "Age of the oldest queued job; 0 when none is queued"
    JOB_WAIT_SECONDS Histogram "pinstack_job_wait_seconds" ["kind"]
        "Time from the acceptance of a job to its first start"
    JOB_SECONDS Histogram "pinstack_job_seconds" ["kind", "ending"]
        "Time that a job was on a worker"
    JOB_STAGE_SECONDS Histogram "pinstack_job_stage_seconds" ["kind", "stage"]
        "Time that a job spent in a stage"
    JOBS_ENDED Counter "pinstack_jobs_ended_total" ["kind", "ending"]
        "Jobs that left their worker"
    JOB_FAILURES Counter "pinstack_job_failures_total" ["kind", "code"]
        "Jobs that failed, by the code of the problem"
    JOB_RETRIES Counter "pinstack_job_retries_total" ["kind"]
        "Jobs that were started again because an earlier attempt did not finish"
    LEASES_LOST Counter "pinstack_leases_lost_total" ["kind"]
        "Jobs whose lease this process lost while it ran them"

    WORKERS Gauge "pinstack_workers" []
        "Workers of this process that are alive"
    WORKERS_BUSY Gauge "pinstack_workers_busy" []
        "Workers of this process that run a job"
    MEMORY_BUDGET_BYTES Gauge "pinstack_memory_budget_bytes" []
        "Memory for all running jobs of this process"
    MEMORY_RESERVED_BYTES Gauge "pinstack_memory_reserved_bytes" []
        "Memory that running jobs have reserved of the budget"

    DISK_SIZE_BYTES Gauge "pinstack_disk_size_bytes" []
        "Size of the file system of the data folder"
    DISK_FREE_BYTES Gauge "pinstack_disk_free_bytes" []
        "Free bytes of the file system of the data folder"
    DISK_RESERVED_BYTES Gauge "pinstack_disk_reserved_bytes" []
        "Bytes that uploads and jobs of this process have reserved and not written yet"
    STORED_BYTES Gauge "pinstack_stored_bytes" ["content"]
        "Bytes of the files that the database names"
    UPLOADS_OPEN Gauge "pinstack_uploads_open" []
        "Resumable uploads that are not complete"
    UPLOAD_AWAITED_BYTES Gauge "pinstack_upload_awaited_bytes" []
        "Bytes that open resumable uploads have not sent yet"
    QUOTA_TOKENS Gauge "pinstack_quota_tokens" ["use"]
        "Tokens with a quota: use below 80 % (normal), below 100 % (high), or full"
    SWEEPS Counter "pinstack_sweeps_total" ["outcome"]
        "Garbage collections"
    SWEPT Counter "pinstack_swept_total" ["content"]
        "Objects that garbage collections removed"

    TRACE_SPANS Counter "pinstack_trace_spans_total" ["outcome"]
        "Spans of traces that were exported, or lost because the queue was full or the collector did not take them"

    TASK_PANICS Counter "pinstack_task_panics_total" ["task"]
        "Panics of tasks that run as long as the process; each was started again"
    LOG_LINES_LOST Counter "pinstack_log_lines_lost_total" []
        "Lines of the log that could not be written"

    BUILD_INFO Gauge "pinstack_build_info" ["version"]
        "1, with the version as a label"
    UPTIME_SECONDS Gauge "pinstack_uptime_seconds" []
        "Time since the service started, by a monotonic clock"
    PROCESS_CPU_SECONDS Counter "process_cpu_seconds_total" []
        "User and system CPU time"
    PROCESS_RESIDENT_BYTES Gauge "process_resident_memory_bytes" []
        "Resident memory"
    PROCESS_VIRTUAL_BYTES Gauge "process_virtual_memory_bytes" []
        "Virtual memory"
    PROCESS_OPEN_FDS Gauge "process_open_fds" []
        "Open file descriptors"
    PROCESS_MAX_FDS Gauge "process_max_fds" []
        "Limit of open file descriptors"
    PROCESS_THREADS Gauge "process_threads" []
        "Threads of the operating system"
    PROCESS_START_SECONDS Gauge "process_start_time_seconds" []
        "Start of the process, seconds since 1970"
}

/// Stages of jobs as `progress.stage` names them, and as the label `stage` does.
const STAGES: [(&str, &str); 13] = [
    ("reading", "reading"),
    ("aligning", "aligning"),
    ("fusing", "fusing"),
    ("correcting halos", "halo_correction"),
    ("masking", "masking"),
    ("detecting", "detecting"),
    ("writing", "writing"),
    ("extracting features", "extracting_features"),
    ("matching", "matching"),
    ("mapping", "mapping"),
    ("measuring", "measuring"),
    ("waiting", "waiting"),
    ("waiting for disk space", "waiting_for_disk"),
];

/// The label of an unknown stage. A test fails when a job has one.
pub const OTHER_STAGE: &str = "other";

/// The label of a stage of `progress.stage`.
pub fn stage_label(stage: &str) -> &'static str {
    STAGES.iter().find(|(name, _)| *name == stage).map_or(OTHER_STAGE, |(_, label)| label)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_follow_the_conventions_of_prometheus() {
        for (i, Series { name, kind, labels, help }) in ALL.iter().enumerate() {
            assert!(name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_'), "{name}");
            assert!(name.starts_with("pinstack_") || name.starts_with("process_"), "{name}");
            assert_eq!(name.ends_with("_total"), *kind == Kind::Counter, "{name}");
            assert!(!["_count", "_sum", "_bucket"].iter().any(|suffix| name.ends_with(suffix)), "{name}");
            if *kind == Kind::Histogram {
                assert!(name.ends_with("_seconds"), "{name}: the buckets are seconds");
            }
            assert!(labels.iter().all(|label| !["le", "quantile", "job", "instance"].contains(label)), "{name}");
            assert!(!help.is_empty() && !help.ends_with('.'), "{name}");
            assert!(ALL[..i].iter().all(|before| before.name != *name), "{name} is there twice");
        }
    }

    #[test]
    fn a_stage_has_a_label_of_the_table() {
        assert_eq!(stage_label("waiting for disk space"), "waiting_for_disk");
        assert_eq!(stage_label("dancing"), OTHER_STAGE);
    }
}
