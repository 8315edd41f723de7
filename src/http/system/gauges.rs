//! Gauges measured at each scrape: database, disk, process.

use std::time::Instant;

use jiff::Timestamp;

use crate::{
    contract::{JobKind, JobState},
    http::state::App,
    store::{
        StoreResult, Totals,
        totals::{JobTotals, QuotaUse},
    },
    telemetry::{Exposition, series::*},
};

/// Fraction of a quota from which its use counts as high.
const HIGH: f64 = 0.8;

/// All gauges in the text format. Costs four queries that read only indexes, and one look at the file system and the
/// process.
///
/// # Errors
/// When the database cannot be read. A disk that cannot be measured is omitted.
pub(super) async fn measure(app: &App, started: Instant) -> StoreResult<String> {
    let mut text = Exposition::default();
    let totals = app.store.metadata.totals().await?;
    jobs(&mut text, &totals.jobs);
    stored(&mut text, &totals);
    text.value(&UPLOAD_AWAITED_BYTES, app.store.metadata.reserved_bytes().await? as f64);
    quotas(&mut text, &totals.quotas);
    if let Ok(disk) = app.disk.state().await {
        text.value(&DISK_SIZE_BYTES, disk.total as f64);
        text.value(&DISK_FREE_BYTES, disk.free as f64);
        text.value(&DISK_RESERVED_BYTES, disk.reserved as f64);
    }
    text.values(&BUILD_INFO, [([env!("CARGO_PKG_VERSION")], 1.0)]);
    text.value(&UPTIME_SECONDS, started.elapsed().as_secs_f64());
    process(&mut text);
    Ok(text.into_text())
}

fn jobs(text: &mut Exposition, totals: &[JobTotals]) {
    let of = |kind, state| totals.iter().find(|jobs| (jobs.kind, jobs.state) == (kind, state));
    let all = JobKind::ALL.into_iter().flat_map(|kind| JobState::ALL.map(|state| (kind, state)));
    let counts = all.map(|(kind, state)| {
        let count = of(kind, state).map_or(0, |jobs| jobs.count);
        ([kind.as_str(), state.as_str()], count as f64)
    });
    text.values(&JOBS, counts);
    let now = Timestamp::now();
    let ages = JobKind::ALL.map(|kind| {
        let oldest = of(kind, JobState::Queued).map(|jobs| jobs.oldest);
        // no negative age after the clock was set back
        let age = oldest.map_or(0.0, |oldest| now.duration_since(oldest).as_secs_f64().max(0.0));
        ([kind.as_str()], age)
    });
    text.values(&OLDEST_QUEUED_SECONDS, ages);
}

fn stored(text: &mut Exposition, totals: &Totals) {
    let uploads: u64 = totals.jobs.iter().map(|jobs| jobs.upload_bytes).sum();
    let results: u64 = totals.jobs.iter().map(|jobs| jobs.result_bytes).sum();
    let contents = [("job_upload", uploads), ("result", results), ("open_upload", totals.open_upload_bytes)];
    text.values(&STORED_BYTES, contents.map(|(content, bytes)| ([content], bytes as f64)));
    text.value(&UPLOADS_OPEN, totals.open_uploads as f64);
}

/// Counts tokens by the use of their quota. Token names are not labels: their number is unbounded, and readers of the
/// metrics need not know them.
fn quotas(text: &mut Exposition, quotas: &[QuotaUse]) {
    let (mut normal, mut high, mut full) = (0, 0, 0);
    for QuotaUse { quota, used } in quotas {
        let count = match *used as f64 {
            used if used >= *quota as f64 => &mut full,
            used if used >= HIGH * *quota as f64 => &mut high,
            _ => &mut normal,
        };
        *count += 1;
    }
    let counts = [("normal", normal), ("high", high), ("full", full)];
    text.values(&QUOTA_TOKENS, counts.map(|(usage, count)| ([usage], f64::from(count))));
}

fn process(text: &mut Exposition) {
    let found = metrics_process::collector::collect();
    let whole = |value: Option<u64>| value.map(|value| value as f64);
    for (series, value) in [
        (&PROCESS_CPU_SECONDS, found.cpu_seconds_total),
        (&PROCESS_RESIDENT_BYTES, whole(found.resident_memory_bytes)),
        (&PROCESS_VIRTUAL_BYTES, whole(found.virtual_memory_bytes)),
        (&PROCESS_OPEN_FDS, whole(found.open_fds)),
        (&PROCESS_MAX_FDS, whole(found.max_fds)),
        (&PROCESS_THREADS, whole(found.threads)),
        (&PROCESS_START_SECONDS, whole(found.start_time_seconds)),
    ] {
        if let Some(value) = value {
            text.value(series, value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_counted_by_how_much_of_their_quota_is_used() {
        let mut text = Exposition::default();
        let uses = [(100, 0), (100, 79), (100, 80), (100, 99), (100, 100), (0, 0)];
        quotas(&mut text, &uses.map(|(quota, used)| QuotaUse { quota, used }));
        let text = text.into_text();
        for (usage, count) in [("normal", 2), ("high", 2), ("full", 2)] {
            assert!(text.contains(&format!("pinstack_quota_tokens{{use=\"{usage}\"}} {count}\n")), "{text}");
        }
    }
}
