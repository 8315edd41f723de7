//! Calibration profiles: one endpoint per file.

pub mod camera;
pub mod delete;
pub mod drift;
pub mod export;
pub mod file;
pub mod get;
pub mod import;
pub mod list;
pub mod near;
pub mod numbers;
pub mod put;
pub mod revisions;
pub mod rig_parameters;
pub mod write;

use super::{
    ApiError, ApiResult, App,
    extract::{Numbered, ProfileKey},
};
use crate::contract::{Code, Name, profile::Profile};

/// Most profiles that are searched for similar names.
const MAX_SEARCHED: u32 = 10_000;

/// A revision of a profile; without `revision` the current one.
///
/// # Errors
/// `profile_not_found`, with similar names.
pub async fn find(app: &App, rig: &Name, lens: &Name, revision: Option<u32>) -> ApiResult<Profile> {
    match app.store.metadata.profile(rig, lens, revision).await? {
        Some(profile) => Ok(profile),
        None => Err(not_found(app, rig, lens, revision).await),
    }
}

/// The error for a profile or revision that does not exist. It suggests profiles with similar names.
pub async fn not_found(app: &App, rig: &Name, lens: &Name, revision: Option<u32>) -> ApiError {
    let detail = match revision {
        None => {
            // without them the error is still complete
            let keys = app.store.metadata.profile_keys(MAX_SEARCHED).await.unwrap_or_default();
            let near = near::sentence(&near::near(rig, lens, &keys));
            format!(
                "there is no profile for rig '{rig}' and lens '{lens}'{near}; calibrate it, or PUT /v1/profiles/{rig}/{lens} \
                 first"
            )
        }
        Some(revision) => format!(
            "the profile of rig '{rig}' and lens '{lens}' has no revision {revision}; GET /v1/profiles/{rig}/{lens}/revisions lists them"
        ),
    };
    ApiError::new(Code::ProfileNotFound, detail)
}

impl Numbered for ProfileKey {
    const KIND: &'static str = "profile";
    const NUMBER: &'static str = "revision";

    fn subject(&self) -> String {
        format!("the profile of rig '{}' and lens '{}'", self.rig, self.lens)
    }

    fn url(&self) -> String {
        link!("/v1/profiles/{}/{}", self.rig, self.lens)
    }

    async fn current(&self, app: &App) -> ApiResult<Option<u32>> {
        Ok(app.store.metadata.profile(&self.rig, &self.lens, None).await?.map(|profile| profile.revision))
    }
}
