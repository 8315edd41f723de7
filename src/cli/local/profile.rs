//! The profile that folders are fused with: a file, one of a store, or one that is made from the pictures.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, anyhow};
use clap::Args;
use jiff::Timestamp;
use rustix::{fs::Mode, process::umask};

use super::{
    calibration::{Calibrated, calibrate},
    input::View,
    progress::Bar,
    run::unnamed,
};
use crate::{
    cli::store::Place,
    contract::{Name, profile::Profile},
    http::{
        App, Policy,
        profiles::{self, numbers, write},
    },
};
use pinstack_science::types::{
    calibration_options::{CalibrationOptions, CalibrationSource},
    profile::HomographyModel,
};

/// Where the profile is.
#[derive(Debug, Args)]
pub(in crate::cli) struct ProfileFlags {
    /// Profile as JSON, as `pinstack calibrate` and GET /v1/profiles/{rig}/{lens} write it [default: one is made from
    /// the pictures of all folders together]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rig", "lens"])]
    profile: Option<PathBuf>,
    /// Rig of a profile in the data folder of a server, which may run meanwhile
    #[arg(long, value_name = "RIG", requires = "lens")]
    rig: Option<String>,
    /// Lens of that profile
    #[arg(long, value_name = "LENS", requires = "rig")]
    lens: Option<String>,
    #[command(flatten)]
    place: Place,
}

/// The profile of a run.
pub(in crate::cli) struct UsedProfile {
    /// The profile.
    pub profile: Profile,
    /// What sentences call it.
    pub called: String,
    /// The calibration, if it was made from the pictures.
    pub calibrated: Option<Calibrated>,
}

impl ProfileFlags {
    /// Whether the profile is to be made from the pictures.
    pub(in crate::cli) fn is_unknown(&self) -> bool {
        self.profile.is_none() && self.rig.is_none()
    }

    /// Reads the profile, or makes it from the pictures of `views`. `scratch` is an empty folder.
    ///
    /// # Errors
    /// When the profile cannot be read, is not in the store, or cannot be measured.
    pub(in crate::cli) fn find(
        self,
        revision: Option<u32>,
        views: &[View],
        bar: &Bar,
        scratch: &Path,
        runtime: &tokio::runtime::Runtime,
    ) -> Result<UsedProfile> {
        if let (Some(rig), Some(lens)) = (self.rig, self.lens) {
            let profile = runtime.block_on(stored(self.place, Name::new(rig)?, Name::new(lens)?, revision))?;
            let Profile { rig, lens, revision, .. } = &profile;
            let called = format!("the profile of rig '{rig}' and lens '{lens}' (revision {revision})");
            return Ok(UsedProfile { profile, called, calibrated: None });
        }
        if let Some(path) = &self.profile {
            let called = format!("the profile {}", path.display());
            return Ok(UsedProfile { profile: read(path)?, called, calibrated: None });
        }
        let options = CalibrationOptions { source: CalibrationSource::Stacks, ..CalibrationOptions::default() };
        let calibrated = calibrate(views, options, None, bar, scratch)?;
        let profile = calibrated.draft.clone().revision(unnamed()?, unnamed()?, 1, Timestamp::now());
        Ok(UsedProfile {
            profile,
            called: "the profile made from the pictures".to_owned(),
            calibrated: Some(calibrated),
        })
    }
}

/// The profile in a file.
///
/// # Errors
/// When the file cannot be read, or is no profile.
pub(in crate::cli) fn read(path: &Path) -> Result<Profile> {
    let bytes = fs::read(path).with_context(|| format!("cannot read the profile {}", path.display()))?;
    let nowhere = axum::http::Uri::from_static("/");
    let read = numbers::read(numbers::Kind::Unsaid, bytes, &nowhere);
    let (input, warnings) = read.map_err(|error| anyhow!("{}: {}", path.display(), error.fault().detail))?;
    let draft = write::draft(input, HomographyModel::Given, warnings);
    Ok(draft.revision(unnamed()?, unnamed()?, 1, Timestamp::now()))
}

/// A profile in the store of a server.
async fn stored(place: Place, rig: Name, lens: Name, revision: Option<u32>) -> Result<Profile> {
    // files of a store are private, and results are not
    let before = umask(Mode::from_raw_mode(0o077));
    let opened = place.open().await;
    umask(before);
    let (_, store) = opened?;
    let app = App::new(store.clone(), Policy::default());
    let found = profiles::find(&app, &rig, &lens, revision).await;
    store.metadata.close().await;
    found.map_err(|error| anyhow!("{}", error.fault().detail))
}
