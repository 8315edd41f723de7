//! Runs jobs of the service on this machine, without its store: the request is checked, the machine is asked whether it
//! has the memory and the disk space, and the job runs.

use std::{io, path::Path, sync::Arc, time::Instant};

use anyhow::{Result, bail};
use jiff::Timestamp;

use crate::{
    cli::memory,
    contract::{
        Code, Fault, JobError, Name,
        profile::Profile,
        request::{JobRequest, Upload},
    },
    http::pages::words::bytes,
    jobs::{JobContext, JobRunner, ScienceRunner},
    store::{Job, is_full},
};
use pinstack_science::{archive::ArchiveLimits, types::ReadAt};

/// The name of the rig and of the lens of a profile that has none.
const UNNAMED: &str = "local";

/// A runner with as many threads as fit into the memory.
///
/// # Errors
/// When the memory of the machine, or the disk at `scratch`, is too small for the job.
pub(in crate::cli) fn fitting(request: &JobRequest, scratch: &Path) -> Result<ScienceRunner> {
    let limit = memory::for_jobs();
    let memory = limit.map(|(most, _)| most);
    let runner = ScienceRunner { archive_limits: ArchiveLimits::default(), memory, ..ScienceRunner::default() };
    if let Some((most, whose)) = limit {
        let need = runner.memory_need(request);
        if let Some(layout) = request.layout().filter(|_| need > most) {
            bail!(
                "slices of {} x {} px need {} of memory, and {whose} has {} for it: use a machine with more memory, or \
                 smaller pictures",
                layout.width,
                layout.height,
                bytes(need),
                bytes(most)
            );
        }
    }
    let need = runner.disk_need(request);
    if let Ok(stat) = rustix::fs::statvfs(scratch) {
        let free = stat.f_bavail.saturating_mul(stat.f_frsize);
        if free < need {
            let at = scratch.parent().unwrap_or(scratch).display();
            bail!(
                "up to {} of disk space are needed, and {} are free at {at}: free some, or choose another folder with -o",
                bytes(need),
                bytes(free)
            );
        }
    }
    Ok(runner)
}

/// What a job gets. `scratch` is an empty folder of its own.
pub(in crate::cli) fn context(
    request: JobRequest,
    profile: Option<Profile>,
    archive: Arc<dyn ReadAt>,
    scratch: &Path,
) -> Result<JobContext> {
    let (rig, lens) = match &profile {
        Some(profile) => (profile.rig.clone(), profile.lens.clone()),
        None => (unnamed()?, unnamed()?),
    };
    let job = Job::unqueued(rig, lens, request, Timestamp::now());
    let (others, scratch, started) = (Vec::new(), scratch.to_owned(), Instant::now());
    Ok(JobContext { job, profile, archive, others, scratch, started })
}

/// The name of a rig or lens that has none.
///
/// # Errors
/// Never.
pub(in crate::cli) fn unnamed() -> Result<Name> {
    Ok(Name::new(UNNAMED)?)
}

/// What a request says about a zip that no store has.
pub(in crate::cli) fn no_upload(archive: &dyn ReadAt) -> Upload {
    let bytes = archive.length().unwrap_or_default();
    Upload { key: String::new(), bytes, sha256: String::new(), filename: None }
}

/// The error of a scratch file.
pub(in crate::cli) fn unwritten(error: io::Error) -> JobError {
    let code = if is_full(&error) { Code::InsufficientStorage } else { Code::Unavailable };
    Fault::new(
        code,
        format!("cannot write a scratch file ({error}); free some disk space, or choose another folder with -o"),
    )
    .into()
}
