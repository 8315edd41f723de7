//! What a job made, or why there is nothing.

use crate::{
    contract::{
        Code, JobState,
        outcome::{Artifact, JobOutcome},
    },
    http::problem::{ApiError, ApiResult},
    store::Job,
};

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
            return Err(ApiError::new(Code::NotFinished, format!("it is {state}: the results come when it has ended")));
        }
        JobState::Failed => match &job.error {
            Some(error) => format!("it failed: {}", error.detail),
            None => "it failed".to_owned(),
        },
        JobState::Cancelled => "it was cancelled".to_owned(),
        JobState::Succeeded => "it made no results".to_owned(),
    };
    Err(ApiError::new(Code::NoResult, detail))
}

/// One file of a job.
///
/// # Errors
/// As [`of`], and `no_result` when the job made no such file.
pub fn artifact<'a>(job: &'a Job, name: &str) -> ApiResult<&'a Artifact> {
    of(job)?.artifacts().iter().find(|artifact| artifact.name == name).ok_or_else(|| missing(job, name))
}

/// The job ended well but made no such thing.
pub fn missing(job: &Job, name: &str) -> ApiError {
    let has_back_light = !job.request.layout().back.is_empty();
    let detail = match name {
        "mask" | "backlight" if !has_back_light => format!("there is no {name}: the stack has no back-light slices"),
        "mask" | "backlight" => format!("there is no {name}: the stack was made with mask=none"),
        _ => format!("there is no {name}"),
    };
    ApiError::new(Code::NoResult, detail)
}
