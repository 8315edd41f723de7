//! The submission of a calibration: calibration options, the profile that the result replaces, and the calibration with
//! the target moved.

use uuid::Uuid;

use crate::{
    contract::{
        Code, Fault, Name,
        outcome::JobOutcome,
        profile::Profile,
        ranges::check_calibration,
        request::{CalibrationRequest, StoredStack, Upload},
    },
    http::{ApiError, ApiResult, App, extract::path::name, ingest::fields::Fields, profiles},
};
use pinstack_science::types::{
    Warning, WarningCode,
    calibration_options::{CalibrationOptions, CalibrationSource},
    error::ErrorLocation,
    profile::MAX_SLICES,
    stack_layout::StackLayout,
};

/// A dot target, or stacks, to calibrate from.
pub struct CalibrationSubmission {
    rig: Name,
    lens: Name,
    options: CalibrationOptions,
    /// The profile that the result replaces.
    current: Option<CurrentProfile>,
    /// The calibration with the target moved.
    moved: Option<MovedTarget>,
    /// The revision that it refines.
    from: Option<Box<Profile>>,
    /// The stored stacks whose pictures it uses.
    stacks: Vec<StoredStack>,
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
            let layout = job.request.layout()?;
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
    /// The same with the pictures of stored stacks, the first of which is the zip.
    #[must_use]
    pub fn with_stacks(self, stacks: Vec<StoredStack>) -> Self {
        Self { stacks, ..self }
    }

    /// # Errors
    /// `invalid_request` that names the field; `profile_not_found` for a revision to refine that does not exist.
    pub async fn read(app: &App, fields: &Fields) -> ApiResult<Self> {
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
        let from = match options.from {
            Some(revision) => Some(Box::new(profiles::find(app, &rig, &lens, Some(revision)).await?)),
            None => None,
        };
        let current = app.store.metadata.profile(&rig, &lens, None).await?;
        let current =
            current.map(|p| CurrentProfile { size: (p.input.image_width, p.input.image_height), revision: p.revision });
        Ok(Self { rig, lens, options, current, moved, from, stacks: Vec::new() })
    }

    /// A submission for a profile that does not exist yet, without another calibration of the moved target.
    ///
    /// # Errors
    /// `invalid_request` for options that break a rule.
    pub fn new(rig: Name, lens: Name, options: CalibrationOptions) -> Result<Self, Fault> {
        check_calibration(&options)?;
        Ok(Self { rig, lens, options, current: None, moved: None, from: None, stacks: Vec::new() })
    }

    pub(super) fn profile_key(&self) -> (&Name, &Name) {
        (&self.rig, &self.lens)
    }

    pub(super) fn fingerprint_input(&self) -> serde_json::Value {
        let mut input = serde_json::json!({ "rig": self.rig, "lens": self.lens, "options": self.options });
        if !self.stacks.is_empty() {
            input["stacks"] = self.stacks.iter().map(|stack| stack.id.to_string()).collect();
        }
        input
    }

    /// Whether the pictures are of objects.
    pub fn is_by_stacks(&self) -> bool {
        self.options.source == CalibrationSource::Stacks
    }

    /// Whether the zip may be that of a scan: not if it is that of a stored stack.
    pub(super) fn may_be_scan(&self) -> bool {
        self.is_by_stacks() && self.stacks.is_empty()
    }

    /// Checks the contents of the zip and builds the request that the row of the job keeps.
    ///
    /// # Errors
    /// `slice_count_mismatch` and others, with the number found and the number expected.
    pub fn to_request(&self, upload: Upload, layout: StackLayout) -> Result<(CalibrationRequest, Vec<Warning>), Fault> {
        self.check(&layout)?;
        let mut warnings = Vec::new();
        if !layout.back.is_empty() {
            let detail =
                format!("{} back-light slices are ignored: a calibration uses the front light only", layout.back.len());
            warnings.push(Warning::new(WarningCode::BackLightIgnored, detail));
        }
        let is_reversed = self.stacks.first().is_some_and(|first| first.reversed);
        let layout = if is_reversed { layout.reversed() } else { layout };
        let layout = StackLayout { back: Vec::new(), lights: Vec::new(), ..layout };
        let (options, stacks) = (self.options.clone(), self.stacks.clone());
        Ok((CalibrationRequest { options, upload, layout, stacks }, warnings))
    }

    fn check(&self, layout: &StackLayout) -> Result<(), Fault> {
        self.check_from(layout)?;
        if let Some(light) = layout.lights.first()
            && !self.is_by_stacks()
        {
            let detail = format!(
                "the zip has a folder {} beside front/; a calibration has the slices of the target in front/, and those of \
                 a moved target in moved/: remove the folder",
                light.name
            );
            return Err(Fault::new(Code::InvalidArchive, detail).in_file(&light.name, None));
        }
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
        if let Some(reference) = self.options.reference_index
            && reference as usize >= count
        {
            let detail =
                format!("reference_index is {reference}, but the archive has {count} slices, 0 to {}", count - 1);
            return Err(Fault::new(Code::InvalidRequest, detail));
        }
        self.check_moved(layout)
    }

    /// Checks that the slices are those of the revision that is refined.
    fn check_from(&self, layout: &StackLayout) -> Result<(), Fault> {
        let Some(profile) = &self.from else { return Ok(()) };
        let Profile { revision, input, .. } = &**profile;
        let found = (layout.front.len(), layout.width, layout.height, layout.orientation);
        let orientation = input.orientation.unwrap_or(layout.orientation);
        let expected = (input.homographies.len(), input.image_width, input.image_height, orientation);
        if found == expected {
            return Ok(());
        }
        let told = |(count, width, height, tag): (usize, u32, u32, u8)| {
            format!("{count} slices of {width} x {height} px with the orientation tag {tag}")
        };
        let detail = format!(
            "the stack has {}, but revision {revision} of the profile {}/{} is for {}: its homographies can be refined by \
             such stacks only; send one, name another revision, or omit from",
            told(found),
            self.rig,
            self.lens,
            told(expected)
        );
        let code = if found.0 == expected.0 { Code::SizeMismatch } else { Code::SliceCountMismatch };
        Err(Fault::new(code, detail))
    }

    /// Checks the moved target, which is a folder of the zip or another calibration.
    fn check_moved(&self, layout: &StackLayout) -> Result<(), Fault> {
        let CalibrationOptions { target_advance_mm: advance, moved_target_pitch_px: pitch, .. } = &self.options;
        let (count, found) = (layout.front.len(), layout.moved.len());
        let reference = self.options.reference_index.map_or(count / 2, |index| index as usize);
        let one = format!("one picture with the rail where it was for the reference slice (index {reference})");
        let refused = |name: &str, detail: String| {
            let place = ErrorLocation { detail, pointer: Some(name.to_owned()), ..ErrorLocation::default() };
            Fault::refuse(vec![place])
        };
        match (layout.moved.first(), advance) {
            (Some(file), _) if pitch.is_some() => refused(
                "moved_target",
                format!(
                    "moved_target is given, and the zip has a folder of the moved target too ({file}): omit one of them"
                ),
            ),
            (Some(file), None) => refused(
                "target_advance_mm",
                format!(
                    "target_advance_mm is missing, but the zip has a folder of the moved target ({file}): give by how many \
                     mm the target was nearer to the lens there, or remove the folder"
                ),
            ),
            (None, Some(_)) if pitch.is_none() => refused(
                "target_advance_mm",
                format!(
                    "target_advance_mm is given, but there is no moved target: add {one} to the zip, in a folder moved/, or \
                     give the id of a calibration of the moved target as moved_target"
                ),
            ),
            (Some(file), Some(_)) if found != 1 && found != count => {
                let detail = format!(
                    "the folder of the moved target ({file}) has {found} pictures, and the calibration {count} slices: the \
                     folder needs {one}, or {count} pictures"
                );
                Err(Fault::new(Code::SliceCountMismatch, detail))
            }
            _ => Ok(()),
        }?;
        let Some(MovedTarget { size: (width, height), reference_index, .. }) = self.moved else { return Ok(()) };
        if ((width, height), reference_index as usize) != ((layout.width, layout.height), reference) {
            let detail = format!(
                "moved_target has slices of {width} x {height} px and the reference slice {reference_index}, and this \
                 calibration {} x {} px and {reference}: the sizes of the dots can be compared at one position of the sensor \
                 only; take both sets with the same settings and the same number of slices",
                layout.width, layout.height
            );
            return Err(Fault::new(Code::InvalidRequest, detail));
        }
        Ok(())
    }
}
