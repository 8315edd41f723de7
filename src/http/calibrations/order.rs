//! What the upload of a dot-target stack must fit.

use crate::{
    contract::{
        Code, Fault, JobKind, Name,
        request::{CalibrationRequest, JobRequest, Upload},
    },
    http::{
        extract::path::name,
        intake::order::{Fields, Order},
        problem::{ApiError, ApiResult},
        state::App,
    },
};
use pinstack_science::types::{
    Warning,
    calibration_options::CalibrationOptions,
    profile::{MAX_SLICES, RAIL_MM},
    stack_layout::StackLayout,
};

/// A dot-target stack to be measured.
pub struct CalibrationOrder {
    rig: Name,
    lens: Name,
    options: CalibrationOptions,
    /// Width, height and revision of the profile that is there already.
    before: Option<(u32, u32, u32)>,
}

impl Order for CalibrationOrder {
    const KIND: JobKind = JobKind::Calibration;

    fn is_addressed(_fields: &Fields) -> bool {
        // the URL names rig and lens
        true
    }

    async fn read(app: &App, fields: &Fields) -> ApiResult<Self> {
        let named = |what: &str| name(what, fields.get(what).unwrap_or_default().to_owned());
        let (rig, lens) = (named("rig")?, named("lens")?);
        let options: CalibrationOptions = fields.options()?;
        check_options(&options)?;
        let current = app.rows.profile(&rig, &lens, None).await?;
        let before = current.map(|p| (p.input.image_width, p.input.image_height, p.revision));
        Ok(Self { rig, lens, options, before })
    }

    fn key(&self) -> (&Name, &Name) {
        (&self.rig, &self.lens)
    }

    fn disk_need(&self) -> u64 {
        // nobody knows yet how many slices there are, and what is written of each is small
        0
    }

    fn asked(&self) -> serde_json::Value {
        serde_json::json!({ "rig": self.rig, "lens": self.lens, "options": self.options })
    }

    fn check(&self, layout: &StackLayout) -> Result<Vec<Warning>, Fault> {
        let count = layout.front.len();
        if !(2..=MAX_SLICES).contains(&count) {
            let detail = format!("the archive has {count} slices; a calibration needs 2 to {MAX_SLICES}");
            return Err(Fault::new(Code::SliceCountMismatch, detail));
        }
        if let Some((width, height, revision)) = self.before
            && (width, height) != (layout.width, layout.height)
            && !self.options.allow_new_size
        {
            let detail = format!(
                "the slices are {} x {} px, but the profile {}/{} was measured at {width} x {height} px (revision \
                 {revision}), and stacks of that size would no longer fit: set the camera back, use another lens name, \
                 or say allow_new_size if the change is meant",
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
        if layout.back.is_empty() {
            return Ok(Vec::new());
        }
        let detail =
            format!("{} back-light slices are passed over: a calibration uses the front light", layout.back.len());
        Ok(vec![Warning::new("back_light_ignored", detail)])
    }

    fn request(&self, upload: Upload, layout: StackLayout) -> JobRequest {
        let layout = StackLayout { back: Vec::new(), ..layout };
        JobRequest::Calibration(CalibrationRequest { options: self.options.clone(), upload, layout })
    }
}

/// Checks the rules that types alone do not hold.
///
/// # Errors
/// `invalid_request` that names the option.
pub fn check_options(options: &CalibrationOptions) -> ApiResult<()> {
    let rules = [
        ("target_pitch_mm", options.target_pitch_mm, 1e-4..=1000.0),
        ("pixel_pitch_mm", options.pixel_pitch_mm, 1e-5..=1.0),
        ("focal_mm", options.focal_mm, 0.1..=10_000.0),
        ("rail_step_mm", options.rail_step_mm.map(f64::abs), 1e-6..=1000.0),
    ];
    for (name, value, range) in rules {
        if let Some(value) = value
            && !range.contains(&value)
        {
            let detail = format!("{name} is {value}; it must be {} to {}", range.start(), range.end());
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
    }
    let told = options.rail_positions_mm.as_deref().unwrap_or_default();
    if told.iter().any(|z| !RAIL_MM.contains(z)) || (!told.is_empty() && options.rail_step_mm.is_some()) {
        let detail = "rail_positions_mm must be numbers from -1000000 to 1000000, and not given beside rail_step_mm";
        return Err(ApiError::new(Code::InvalidRequest, detail));
    }
    if options.note.as_ref().is_some_and(|note| note.chars().count() > 4000) {
        return Err(ApiError::new(Code::InvalidRequest, "the note is longer than 4,000 characters"));
    }
    Ok(())
}
