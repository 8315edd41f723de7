//! The submission of a dot target: calibration options, and the profile that the result replaces.

use crate::{
    contract::{
        Code, Fault, Name,
        request::{CalibrationRequest, Upload},
    },
    http::{
        extract::path::name,
        ingest::fields::Fields,
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

/// A dot-target stack to calibrate from.
pub struct CalibrationSubmission {
    rig: Name,
    lens: Name,
    options: CalibrationOptions,
    /// The profile that the result replaces.
    current: Option<CurrentProfile>,
}

/// The profile that exists before the calibration.
struct CurrentProfile {
    /// Width and height of its slices, px.
    size: (u32, u32),
    revision: u32,
}

impl CalibrationSubmission {
    pub(super) async fn read(app: &App, fields: &Fields) -> ApiResult<Self> {
        let named = |what: &str| name(what, fields.get(what).unwrap_or_default().to_owned());
        let (rig, lens) = (named("rig")?, named("lens")?);
        let options: CalibrationOptions = fields.options()?;
        check_options(&options)?;
        let current = app.rows.profile(&rig, &lens, None).await?;
        let current =
            current.map(|p| CurrentProfile { size: (p.input.image_width, p.input.image_height), revision: p.revision });
        Ok(Self { rig, lens, options, current })
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
            warnings.push(Warning::new("back_light_ignored", detail));
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

/// Checks the rules that the types alone do not express.
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
    let positions = options.rail_positions_mm.as_deref().unwrap_or_default();
    if positions.iter().any(|z| !RAIL_MM.contains(z)) || (!positions.is_empty() && options.rail_step_mm.is_some()) {
        let detail =
            "rail_positions_mm must be numbers from -1000000 to 1000000 and cannot be combined with rail_step_mm";
        return Err(ApiError::new(Code::InvalidRequest, detail));
    }
    if options.note.as_ref().is_some_and(|note| note.chars().count() > 4000) {
        return Err(ApiError::new(Code::InvalidRequest, "note is longer than 4,000 characters; shorten it"));
    }
    Ok(())
}
