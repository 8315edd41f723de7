//! The submission of a dot target: calibration options, the profile that the result replaces, and the calibration with
//! the target moved.

use uuid::Uuid;

use crate::{
    contract::{
        Code, Fault, Name,
        outcome::JobOutcome,
        ranges::check_calibration,
        request::{CalibrationRequest, Upload},
    },
    http::{ApiError, ApiResult, App, extract::path::name, ingest::fields::Fields},
};
use pinstack_science::types::{
    Warning, WarningCode, calibration_options::CalibrationOptions, profile::MAX_SLICES, stack_layout::StackLayout,
};

/// A dot-target stack to calibrate from.
pub struct CalibrationSubmission {
    rig: Name,
    lens: Name,
    options: CalibrationOptions,
    /// The profile that the result replaces.
    current: Option<CurrentProfile>,
    /// The calibration with the target moved.
    moved: Option<MovedTarget>,
}

/// The profile that exists before the calibration.
struct CurrentProfile {
    /// Width and height of its slices, px.
    size: (u32, u32),
    revision: u32,
}

/// What the slices must have in common with those of the calibration with the target moved.
struct MovedTarget {
    size: (u32, u32),
    reference_index: u32,
    dot_pitch_px: f64,
}

impl MovedTarget {
    /// # Errors
    /// `invalid_request` when there is no calibration of the rig with this id that measured the dots.
    async fn read(app: &App, rig: &Name, id: &str) -> ApiResult<Self> {
        let job = match Uuid::parse_str(id) {
            Ok(id) => app.store.metadata.job(id).await?,
            Err(_) => None,
        };
        let measured = job.filter(|job| job.rig == *rig).and_then(|job| {
            let Some(JobOutcome::Calibration(outcome)) = &job.outcome else { return None };
            let layout = job.request.layout();
            Some(Self {
                size: (layout.width, layout.height),
                reference_index: outcome.reference_index,
                dot_pitch_px: outcome.dot_pitch_px?,
            })
        });
        measured.ok_or_else(|| {
            let detail = format!(
                "moved_target is '{id}', and the rig '{rig}' has no succeeded calibration with this id: send the slices of \
                 the moved target as a calibration first, and give its id"
            );
            ApiError::new(Code::InvalidRequest, detail)
        })
    }
}

impl CalibrationSubmission {
    pub(super) async fn read(app: &App, fields: &Fields) -> ApiResult<Self> {
        let named = |what: &str| name(what, fields.get(what).unwrap_or_default().to_owned());
        let (rig, lens) = (named("rig")?, named("lens")?);
        let mut options: CalibrationOptions = fields.options()?;
        let moved = match &options.moved_target {
            Some(id) => Some(MovedTarget::read(app, &rig, id).await?),
            None => None,
        };
        if let Some(moved) = &moved {
            options.moved_target_pitch_px = Some(moved.dot_pitch_px);
        }
        check_calibration(&options)?;
        let current = app.store.metadata.profile(&rig, &lens, None).await?;
        let current =
            current.map(|p| CurrentProfile { size: (p.input.image_width, p.input.image_height), revision: p.revision });
        Ok(Self { rig, lens, options, current, moved })
    }

    pub(super) fn profile_key(&self) -> (&Name, &Name) {
        (&self.rig, &self.lens)
    }

    pub(super) fn fingerprint_input(&self) -> serde_json::Value {
        serde_json::json!({ "rig": self.rig, "lens": self.lens, "options": self.options })
    }

    pub(super) fn to_request(
        &self,
        upload: Upload,
        layout: StackLayout,
    ) -> Result<(CalibrationRequest, Vec<Warning>), Fault> {
        self.check(&layout)?;
        let mut warnings = Vec::new();
        if !layout.back.is_empty() {
            let detail =
                format!("{} back-light slices are ignored: a calibration uses the front light only", layout.back.len());
            warnings.push(Warning::new(WarningCode::BackLightIgnored, detail));
        }
        let layout = StackLayout { back: Vec::new(), ..layout };
        Ok((CalibrationRequest { options: self.options.clone(), upload, layout }, warnings))
    }

    fn check(&self, layout: &StackLayout) -> Result<(), Fault> {
        let count = layout.front.len();
        if !(2..=MAX_SLICES).contains(&count) {
            let detail = format!("the archive has {count} slices; a calibration needs 2 to {MAX_SLICES}");
            return Err(Fault::new(Code::SliceCountMismatch, detail));
        }
        if let Some(CurrentProfile { size, revision }) = self.current
            && size != (layout.width, layout.height)
            && !self.options.allow_new_size
        {
            let (width, height) = size;
            let detail = format!(
                "the slices have {} x {} px, but the profile {}/{} was measured at {width} x {height} px (revision \
                 {revision}), and stacks of that size would no longer fit; restore the setting of the camera, use another \
                 lens name, or send allow_new_size=true if the change is intended",
                layout.width, layout.height, self.rig, self.lens
            );
            return Err(Fault::new(Code::SizeMismatch, detail));
        }
        let reference = self.options.reference_index.unwrap_or(u32::try_from(count / 2).unwrap_or(u32::MAX));
        if let Some(moved) = &self.moved
            && (moved.size, moved.reference_index) != ((layout.width, layout.height), reference)
        {
            let (width, height) = moved.size;
            let detail = format!(
                "moved_target has slices of {width} x {height} px and the reference slice {}, and this calibration {} x {} px \
                 and {reference}: the sizes of the dots can be compared at one position of the sensor only; take both sets \
                 with the same settings and the same number of slices",
                moved.reference_index, layout.width, layout.height
            );
            return Err(Fault::new(Code::InvalidRequest, detail));
        }
        if let Some(reference) = self.options.reference_index
            && reference as usize >= count
        {
            let detail =
                format!("reference_index is {reference}, but the archive has {count} slices, 0 to {}", count - 1);
            return Err(Fault::new(Code::InvalidRequest, detail));
        }
        Ok(())
    }
}
