//! The submission of a dot target: calibration options, and the profile that the result replaces.

use crate::{
    contract::{
        Code, Fault, Name,
        ranges::check_calibration,
        request::{CalibrationRequest, Upload},
    },
    http::{ApiResult, App, extract::path::name, ingest::fields::Fields},
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
        check_calibration(&options)?;
        let current = app.store.metadata.profile(&rig, &lens, None).await?;
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
