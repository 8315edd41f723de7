//! The views of a scan, read from its stacks.
//!
//! Several stacks may show one view: a capture was repeated, or the stack was fused again. They are the same view when
//! label, pan and tilt are equal; without any of these, each upload is a view of its own. The stack that counts is the
//! newest that did not fail; so a failed repetition does not hide a good result.

use std::{
    collections::{HashMap, HashSet},
    path::Path,
};

use jiff::Timestamp;
use uuid::Uuid;

use crate::{
    contract::{
        Fault, JobKind, JobState, Name, Progress,
        artifact::StackArtifact,
        outcome::{Artifact, ImageInfo, JobOutcome},
        request::JobRequest,
        scan::MAX_VIEWS,
    },
    http::{ApiResult, App, auth::Caller, scans::same_pictures},
    store::{Job, JobFilter, Page, PageRequest},
};
use pinstack_science::{
    photogrammetry::outliers::ViewMeasurements,
    types::{Warning, metrics::Metrics, text, view::ViewAngles},
};

/// Stacks of a scan that are read; those beyond are older repetitions.
const MAX_STACKS: usize = 2 * MAX_VIEWS as usize;
/// Stacks that are read at a time.
const PAGE: u32 = 100;

/// What identifies a view of a scan. Angles are in 0.001 degrees.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum ViewKey {
    Named {
        label: Option<String>,
        pan: Option<i64>,
        tilt: Option<i64>,
    },
    /// The stack whose upload was sent.
    Unnamed(Uuid),
}

/// What the table keeps of a stack.
#[derive(Debug, Clone)]
pub struct ViewStack {
    /// Its id.
    pub id: Uuid,
    /// Its state.
    pub state: JobState,
    /// Its progress.
    pub progress: Progress,
    /// Why it failed.
    pub error: Option<Fault>,
    /// When it was accepted.
    pub created_at: Timestamp,
    /// Warnings.
    pub warnings: Vec<Warning>,
    /// Label of the view.
    pub label: Option<String>,
    /// Pan, degrees.
    pub pan_deg: Option<f64>,
    /// Tilt, degrees.
    pub tilt_deg: Option<f64>,
    /// File name of the upload.
    pub filename: Option<String>,
    /// Revision of the profile.
    pub profile_revision: u32,
    /// SHA-256 of geometry and gains of that revision.
    pub profile_digest: String,
    /// Width and height of the slices, px.
    pub slice_size: [u32; 2],
    /// The zip was removed.
    pub upload_removed: bool,
    /// What stacks of the same pictures have in common; see [`same_pictures`].
    pub pictures: Vec<String>,
    /// The stack whose upload this one shares: of a rerun, the stack that was sent.
    origin: Uuid,
    /// Results, once it has succeeded.
    pub result: Option<ViewResult>,
}

/// What the table keeps of the results of a stack.
#[derive(Debug, Clone)]
pub struct ViewResult {
    /// Properties of the fused image.
    pub image_info: ImageInfo,
    /// The fused image.
    pub image: Option<Artifact>,
    /// The mask; `None` without a back light.
    pub mask: Option<Artifact>,
    /// Metrics, without those of each slice.
    pub metrics: Metrics,
}

/// A view of a scan.
#[derive(Debug, Clone)]
pub struct View {
    /// Name of its files, without extension: unique within the scan, and the same after a rerun.
    pub stem: String,
    /// The stack that counts.
    pub stack: ViewStack,
    /// Other stacks of the view, newest first.
    pub others: Vec<Uuid>,
}

impl View {
    /// Pan and tilt, if both are known.
    pub fn angles(&self) -> Option<ViewAngles> {
        Some(ViewAngles { pan_deg: self.stack.pan_deg?, tilt_deg: self.stack.tilt_deg? })
    }

    /// What is compared between views.
    pub fn measurements(&self) -> ViewMeasurements {
        let metrics = self.stack.result.as_ref().map(|result| &result.metrics);
        ViewMeasurements {
            angles: self.angles(),
            sharpness: metrics.and_then(|m| m.fusion.tenengrad),
            mask_area: metrics.and_then(|m| m.mask.as_ref()).map(|mask| mask.foreground_fraction),
            residual_px: metrics.and_then(|m| m.alignment.residual_p95_px),
            mean_level: metrics.and_then(|m| m.fusion.mean_level),
        }
    }
}

impl ViewStack {
    fn of(job: Job) -> Option<Self> {
        let JobRequest::Stack(request) = job.request else { return None };
        let mut pictures = vec![request.upload.sha256];
        let result = match job.outcome {
            Some(JobOutcome::Stack(outcome)) => {
                pictures.extend(same_pictures::of_slices(&outcome.metrics.slices));
                let artifact = |of: StackArtifact| of.among(&outcome.artifacts).cloned();
                let (image, mask) = (artifact(StackArtifact::Image), artifact(StackArtifact::Mask));
                let metrics = Metrics { slices: Vec::new(), ..outcome.metrics };
                Some(ViewResult { image_info: outcome.image, image, mask, metrics })
            }
            _ => None,
        };
        Some(Self {
            id: job.id,
            state: job.state,
            progress: job.progress,
            error: job.error,
            created_at: job.created_at,
            warnings: job.warnings,
            label: request.options.label.filter(|label| !label.is_empty()),
            pan_deg: request.options.pan_deg,
            tilt_deg: request.options.tilt_deg,
            filename: request.upload.filename,
            profile_revision: request.profile_revision,
            profile_digest: request.profile_digest,
            slice_size: [request.layout.width, request.layout.height],
            upload_removed: job.upload_removed,
            pictures,
            origin: request.rerun_of.unwrap_or(job.id),
            result,
        })
    }

    fn key(&self) -> ViewKey {
        let rounded = |angle: f64| (angle * 1000.0).round() as i64;
        match (&self.label, self.pan_deg, self.tilt_deg) {
            (None, None, None) => ViewKey::Unnamed(self.origin),
            (label, pan, tilt) => ViewKey::Named {
                label: label.as_deref().map(text::composed),
                pan: pan.map(rounded),
                tilt: tilt.map(rounded),
            },
        }
    }

    fn has_failed(&self) -> bool {
        matches!(self.state, JobState::Failed | JobState::Cancelled)
    }
}

/// The views of a scan, by tilt, pan and name. Stacks that other tokens sent are left out where tokens see only their
/// own.
///
/// # Errors
/// When the store cannot be read.
pub async fn views(app: &App, caller: &Caller, scan: &Name) -> ApiResult<Vec<View>> {
    let mut stacks = Vec::new();
    let filter = of_scan(app, caller, scan, JobKind::Stack);
    each_page(app, filter, |page| stacks.extend(page.items.into_iter().filter_map(ViewStack::of))).await?;
    Ok(by_view(stacks))
}

/// The ids of all stacks or reconstructions of a scan, also of those whose rows cannot be read.
///
/// # Errors
/// When the store cannot be read.
pub async fn jobs_of(app: &App, caller: &Caller, scan: &Name, kind: JobKind) -> ApiResult<Vec<Uuid>> {
    let mut ids = Vec::new();
    each_page(app, of_scan(app, caller, scan, kind), |page| {
        ids.extend(page.items.iter().map(|job| job.id));
        ids.extend(page.skipped.iter().filter_map(|skipped| Uuid::try_parse(&skipped.id).ok()));
    })
    .await?;
    Ok(ids)
}

/// The stacks or reconstructions of a scan that the caller may see.
fn of_scan(app: &App, caller: &Caller, scan: &Name, kind: JobKind) -> JobFilter {
    JobFilter { kind: Some(kind), scan: Some(scan.clone()), owner: caller.sees_only(app), ..JobFilter::default() }
}

async fn each_page(app: &App, filter: JobFilter, mut take: impl FnMut(Page<Job>)) -> ApiResult<()> {
    let mut request = PageRequest { limit: PAGE, cursor: None };
    let mut read = 0;
    while read < MAX_STACKS {
        let mut page = app.store.metadata.jobs(&filter, &request).await?;
        read += page.items.len() + page.skipped.len();
        request.cursor = page.next_cursor.take();
        take(page);
        if request.cursor.is_none() {
            break;
        }
    }
    Ok(())
}

/// Groups stacks, newest first, into views.
fn by_view(stacks: Vec<ViewStack>) -> Vec<View> {
    let origins = first_origins(&stacks);
    let mut places: HashMap<ViewKey, usize> = HashMap::new();
    let mut groups: Vec<Vec<ViewStack>> = Vec::new();
    for mut stack in stacks {
        stack.origin = origins.get(&stack.id).copied().unwrap_or(stack.origin);
        let place = *places.entry(stack.key()).or_insert(groups.len());
        match groups.get_mut(place) {
            Some(group) => group.push(stack),
            None => groups.push(vec![stack]),
        }
    }
    let mut views: Vec<View> = groups.into_iter().filter_map(view).collect();
    name_apart(&mut views);
    let angle = |angle: Option<f64>| angle.unwrap_or(f64::INFINITY);
    views.sort_by(|a, b| {
        let tilt = angle(a.stack.tilt_deg).total_cmp(&angle(b.stack.tilt_deg));
        let pan = angle(a.stack.pan_deg).total_cmp(&angle(b.stack.pan_deg));
        tilt.then(pan).then_with(|| a.stem.cmp(&b.stem))
    });
    views
}

/// The stack that was sent, for each stack: the beginning of its chain of reruns, as far as it was not deleted.
fn first_origins(stacks: &[ViewStack]) -> HashMap<Uuid, Uuid> {
    let mut origins: HashMap<Uuid, Uuid> = HashMap::with_capacity(stacks.len());
    // the oldest first: the origin of a stack is older than the stack
    for stack in stacks.iter().rev() {
        let first = origins.get(&stack.origin).copied().unwrap_or(stack.origin);
        origins.insert(stack.id, first);
    }
    origins
}

/// The view of its stacks, newest first.
fn view(mut stacks: Vec<ViewStack>) -> Option<View> {
    let counts = stacks.iter().position(|stack| !stack.has_failed()).unwrap_or(0);
    if stacks.is_empty() {
        return None;
    }
    let stack = stacks.remove(counts);
    Some(View { stem: stem(&stack), others: stacks.iter().map(|stack| stack.id).collect(), stack })
}

/// `{label}`, or `{pan}_{tilt}` as far as known, or what the upload was called with the end of its id.
fn stem(stack: &ViewStack) -> String {
    match (&stack.label, angles(stack)) {
        (Some(label), _) => tidy(label),
        (None, Some(angles)) => angles,
        (None, None) => {
            let upload = stack.filename.as_deref().and_then(|name| Path::new(name).file_stem()?.to_str());
            let id = stack.origin.simple().to_string();
            let end = id.get(24..).unwrap_or_default();
            format!("{}_{end}", upload.map(tidy).filter(|name| !name.is_empty()).unwrap_or_else(|| "view".into()))
        }
    }
}

/// The angles that are known. A name with both would tell a reconstruction that the other was commanded, too.
fn angles(stack: &ViewStack) -> Option<String> {
    let (pan, tilt) = (stack.pan_deg, stack.tilt_deg);
    let stem = ViewAngles { pan_deg: pan.unwrap_or(0.0), tilt_deg: tilt.unwrap_or(0.0) }.file_stem();
    let (of_pan, of_tilt) = stem.split_once('_')?;
    match (pan, tilt) {
        (None, None) => None,
        (Some(_), None) => Some(of_pan.to_owned()),
        (None, Some(_)) => Some(of_tilt.to_owned()),
        (Some(_), Some(_)) => Some(stem),
    }
}

/// Makes the stems unique, also on file systems that ignore case: views whose label occurs more than once get their
/// angles as well, and what is equal even then a number.
fn name_apart(views: &mut [View]) {
    let count = |views: &[View]| {
        let mut counts: HashMap<String, usize> = HashMap::new();
        views.iter().for_each(|view| *counts.entry(view.stem.to_lowercase()).or_default() += 1);
        counts
    };
    let counts = count(views);
    for view in views.iter_mut().filter(|view| counts.get(&view.stem.to_lowercase()).is_some_and(|n| *n > 1)) {
        if let (Some(_), Some(angles)) = (&view.stack.label, angles(&view.stack)) {
            view.stem = format!("{}_{angles}", view.stem);
        }
    }
    let counts = count(views);
    let mut taken: HashSet<String> = counts.keys().cloned().collect();
    let mut numbers: HashMap<String, usize> = HashMap::new();
    for view in views.iter_mut().rev() {
        let stem = view.stem.to_lowercase();
        if counts.get(&stem).is_some_and(|n| *n > 1) {
            let number = numbers.entry(stem.clone()).or_default();
            *number += 1;
            // another view may have this name already
            while !taken.insert(format!("{stem}_{number}")) {
                *number += 1;
            }
            view.stem = format!("{}_{number}", view.stem);
        }
    }
}

/// Longest stem made from a label, in characters.
const MAX_STEM: usize = 100;

/// Replaces the characters that file systems, shells or reconstruction programs do not accept. Programs end the name of
/// an image at its first dot, so there is none. Both normal forms of a text give one name.
fn tidy(text: &str) -> String {
    let replaced: String = text::composed(text)
        .chars()
        .take(MAX_STEM)
        .map(|c| if c.is_ascii_alphanumeric() || "_-+".contains(c) { c } else { '_' })
        .collect();
    match replaced.trim_matches('_') {
        "" => "view".to_owned(),
        tidy => text::not_a_device(tidy),
    }
}

#[cfg(test)]
mod tests;
