//! The outcome of a job, or why there is none.

use crate::{
    contract::{
        Code, JobKind, JobState,
        artifact::{StackArtifact, light_of},
        outcome::{Artifact, CalibrationOutcome, JobOutcome, StackOutcome},
    },
    http::{ApiError, ApiResult, job_resource::not_found},
    store::Job,
};
use pinstack_science::types::stack_layout::StackLayout;

/// The outcome of a job.
///
/// # Errors
/// `not_finished` before the end, `no_result` when it failed or was cancelled.
pub fn of(job: &Job) -> ApiResult<&JobOutcome> {
    if let Some(outcome) = &job.outcome {
        return Ok(outcome);
    }
    let detail = match job.state {
        JobState::Queued | JobState::Running => {
            let state = job.state.as_str();
            return Err(ApiError::new(
                Code::NotFinished,
                format!("the job is {state}; its results are available when it has succeeded"),
            ));
        }
        JobState::Failed => match &job.error {
            Some(error) => format!("the job failed: {}", error.detail),
            None => "the job failed".to_owned(),
        },
        JobState::Cancelled => "the job was cancelled".to_owned(),
        JobState::Succeeded => "the job made no results".to_owned(),
    };
    Err(ApiError::new(Code::NoResult, detail))
}

/// The outcome of a stack.
///
/// # Errors
/// As [`of`].
pub fn of_stack(job: &Job) -> ApiResult<&StackOutcome> {
    match of(job)? {
        JobOutcome::Stack(outcome) => Ok(outcome),
        JobOutcome::Calibration(_) | JobOutcome::Reconstruction(_) => Err(not_found(job.id, JobKind::Stack)),
    }
}

/// The outcome of a calibration.
///
/// # Errors
/// As [`of`].
pub fn of_calibration(job: &Job) -> ApiResult<&CalibrationOutcome> {
    match of(job)? {
        JobOutcome::Calibration(outcome) => Ok(outcome),
        JobOutcome::Stack(_) | JobOutcome::Reconstruction(_) => Err(not_found(job.id, JobKind::Calibration)),
    }
}

/// One file of a job.
///
/// # Errors
/// As [`of`], and `no_result` when the job made no such file.
pub fn artifact<'a>(job: &'a Job, name: &str) -> ApiResult<&'a Artifact> {
    of(job)?.artifacts().iter().find(|artifact| artifact.name == name).ok_or_else(|| missing(job, name))
}

/// The error for an artifact that a succeeded job did not make.
pub fn missing(job: &Job, name: &str) -> ApiError {
    let Some(layout) = job.request.layout() else {
        let detail =
            format!("the reconstruction has no {name}, because too few views were registered; its findings say why");
        return ApiError::new(Code::NoResult, detail);
    };
    if StackArtifact::of_name(name).is_some_and(StackArtifact::needs_height) {
        let detail = format!("there is no {name}: the stack was fused with height=none; rerun it with height=auto");
        return ApiError::new(Code::NoResult, detail);
    }
    if let Some(light) = light_of(name) {
        return ApiError::new(Code::NoResult, no_light(light, layout));
    }
    let needs_back_light = StackArtifact::of_name(name).is_some_and(StackArtifact::needs_back_light);
    let has_back_light = !layout.back.is_empty();
    let detail = match (needs_back_light, has_back_light) {
        (true, false) => format!("there is no {name}: the stack has no back-light slices"),
        (true, true) => format!("there is no {name}: the stack was fused with mask=none"),
        (false, _) => format!("the job made no {name}"),
    };
    ApiError::new(Code::NoResult, detail)
}

/// The sentence for a further light that a stack does not have.
fn no_light(name: &str, layout: &StackLayout) -> String {
    let name: String = name.chars().take(80).collect();
    let others: Vec<&str> = layout.lights.iter().map(|light| light.name.as_str()).collect();
    match others.is_empty() {
        true => format!(
            "there is no light '{name}': the stack has no further lights; put their slices into folders beside front/, each \
             with the name of its light"
        ),
        false => format!("there is no light '{name}': the further lights of the stack are {}", others.join(", ")),
    }
}
