//! Takes the zip of a whole scan apart: one zip per view, then one stack per view.
//!
//! 1. The names in the zip are grouped into views.
//! 2. Each view is written to a zip of its own, in a spool file. Members are copied without compressing them again.
//! 3. Every zip is checked. If one is refused, no stack is made, and the answer names every view that is refused.
//! 4. All stacks are made in one transaction ([`super::many`]).

use std::{fs::File, path::PathBuf, sync::Arc};

use super::{
    many::{CheckedJob, ManyOrigin, check, require_queue_places, submit_all},
    quota::QuotaClaim,
    reservation::disk_full,
    spool::SpooledZip,
    submission::scan::ScanSubmission,
};
use crate::{
    contract::{Code, Fault, Name},
    http::{
        ApiError, ApiResult, App, background,
        views::{
            job::url,
            scan_archive::{ArchivedView, ScanArchiveView},
        },
    },
    store::{SpoolFile, digest::sha256_of},
};
use pinstack_science::{
    archive::{
        ArchiveLimits,
        scan::{ScanArchive, open_scan},
    },
    types::error::ErrorLocation,
};

/// Views whose errors are listed.
const MAX_ERRORS: usize = 50;

/// The zip of a scan, grouped into views.
pub struct Grouped(Arc<ScanArchive>);

/// Groups the names in a zip into views.
///
/// # Errors
/// What is wrong with the zip or its names.
pub async fn group(app: &App, submission: &ScanSubmission, zip: PathBuf) -> ApiResult<Grouped> {
    let limits = scan_limits(&app.policy.archive);
    let rules = submission.rules;
    Ok(Grouped(Arc::new(app.inspect(move || open_scan(&zip, &limits, &rules)).await??)))
}

/// The limits of one stack apply to each view; a scan has many views.
fn scan_limits(stack: &ArchiveLimits) -> ArchiveLimits {
    ArchiveLimits { max_member_bytes: stack.max_member_bytes, image: stack.image, ..ArchiveLimits::scan() }
}

impl Grouped {
    /// The grouping as the API shows it, without stacks.
    pub fn view(&self, scan: &Name, slice_count: usize) -> ScanArchiveView {
        ScanArchiveView::of(scan, &self.0, slice_count)
    }

    /// Number of views.
    pub fn views(&self) -> usize {
        self.0.views().len()
    }

    /// Makes the stacks. `idempotency`: key and fingerprint of the request.
    ///
    /// # Errors
    /// The fault of each view that is refused, under the code of the first; `insufficient_storage`; `queue_full`;
    /// `archive_too_large` for a request with more views than may ever be queued.
    pub async fn submit(
        &self,
        app: &App,
        submission: &ScanSubmission,
        idempotency: Option<(String, String)>,
        origin: ManyOrigin,
    ) -> ApiResult<ScanArchiveView> {
        let mut view = self.view(&submission.scan.name, submission.slice_count());
        let checked = self.check_views(app, submission, idempotency, &origin).await?;
        let jobs = submit_all(app, checked, origin).await?;
        for (view, job) in view.views.iter_mut().zip(&jobs) {
            view.stack = Some(url(job));
        }
        Ok(view)
    }

    async fn check_views(
        &self,
        app: &App,
        submission: &ScanSubmission,
        idempotency: Option<(String, String)>,
        origin: &ManyOrigin,
    ) -> ApiResult<Vec<CheckedJob>> {
        let impossible = match origin {
            ManyOrigin::Request(_) => Code::ArchiveTooLarge,
            // its bytes are kept: it becomes jobs as soon as the limit is raised
            ManyOrigin::ResumableUpload(_) => Code::QueueFull,
        };
        require_queue_places(app, self.views(), impossible, "send the views in several zips").await?;
        let bytes = self.0.views().iter().map(|view| view.bytes).sum();
        let reserved = app.disk.reserve(bytes).await?;
        let mut reserved = reserved.granted().map_err(|state| disk_full(bytes, 0, &state))?;
        let (mut checked, mut refused) = (Vec::new(), Vec::new());
        for (at, view) in self.0.views().iter().enumerate() {
            let of_view = submission.view(view);
            let zip = self.write_view(app, at).await?;
            reserved.written(zip.bytes);
            let idempotency = idempotency.as_ref().map(|(key, print)| (key_of_view(key, at), print.clone()));
            let outcome = match of_view {
                Ok(of_view) => check(app, &of_view, zip, idempotency).await,
                Err(error) => Err(error),
            };
            match outcome {
                Ok(job) => checked.push(job),
                Err(error) => refused.push((view.folder.as_str(), error.fault().clone())),
            }
            if refused.len() > MAX_ERRORS {
                break;
            }
        }
        if refused.is_empty() { Ok(checked) } else { Err(refusal(&refused, self.views())) }
    }

    /// Writes a view to a zip of its own.
    async fn write_view(&self, app: &App, at: usize) -> ApiResult<SpooledZip> {
        let path = app.store.workspace.new_path("view").map_err(ApiError::internal)?;
        let archive = Arc::clone(&self.0);
        let filename = archive.views().get(at).map(ArchivedView::file_name);
        let written = background::blocking(move || {
            let broken = |error: std::io::Error| crate::store::StoreError::of_io(error, "cannot write a view".into());
            crate::store::failpoint::step("scan.view").map_err(broken)?;
            let file = File::options().create_new(true).read(true).write(true).open(&path).map_err(broken)?;
            archive.write_view(at, &file).map_err(Fault::from)?;
            let (bytes, sha256) = sha256_of(File::open(&path).map_err(broken)?).map_err(broken)?;
            Ok::<_, ApiError>((SpoolFile::temporary(path), bytes, sha256))
        });
        let (file, bytes, sha256) = written.await??;
        Ok(SpooledZip { file, bytes, sha256, filename, quota: QuotaClaim::default() })
    }
}

/// The key of a view: that of the request for the first, with a suffix that no client can send for the others.
pub fn key_of_view(key: &str, at: usize) -> String {
    if at == 0 { key.to_owned() } else { format!("{key}\u{1f}{at}") }
}

/// One fault for all views that are refused.
fn refusal(refused: &[(&str, Fault)], views: usize) -> ApiError {
    let Some((folder, first)) = refused.first() else { return ApiError::internal("no view was refused") };
    let more = if refused.len() > MAX_ERRORS { "more than " } else { "" };
    let count = refused.len().min(MAX_ERRORS);
    let mut fault = Fault::new(
        first.code,
        format!(
            "{more}{count} of {views} views cannot be fused, so none was accepted; the first is '{folder}': {}",
            first.detail
        ),
    );
    for (folder, view) in refused.iter().take(MAX_ERRORS) {
        let detail = format!("{folder}: {}", view.detail);
        fault.locations.push(ErrorLocation { detail, file: Some((*folder).to_owned()), ..ErrorLocation::default() });
    }
    fault.into()
}
