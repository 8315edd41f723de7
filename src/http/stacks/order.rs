//! What the upload of a stack must fit.

use uuid::Uuid;

use crate::{
    contract::{
        Code, Fault, JobKind, Name,
        input::SliceOrder,
        options::{Crop, MaskMode, StackOptions},
        profile::Profile,
        request::{JobRequest, StackRequest, Upload},
    },
    http::{
        extract::path::name,
        intake::order::{Fields, Order},
        problem::{ApiError, ApiResult},
        profiles::not_found,
        state::App,
    },
    jobs::disk::disk_need_by_profile,
};
use pinstack_science::segmentation::MaskParams;
use pinstack_science::{
    archive,
    types::{Warning, stack_layout::StackLayout},
};

/// A stack to be fused with one revision of a profile.
pub struct StackOrder {
    profile: Profile,
    options: StackOptions,
    /// The stack whose zip is used again.
    rerun_of: Option<Uuid>,
}

impl StackOrder {
    /// A stack with these options and this revision of its profile.
    ///
    /// # Errors
    /// `invalid_request` for options that break a rule, or a crop that leaves the profile's canvas.
    pub fn new(profile: Profile, options: StackOptions, rerun_of: Option<Uuid>) -> ApiResult<Self> {
        options.check()?;
        check_crop(&options, &profile)?;
        Ok(Self { profile, options, rerun_of })
    }
}

impl Order for StackOrder {
    const KIND: JobKind = JobKind::Stack;

    fn is_addressed(fields: &Fields) -> bool {
        fields.get("rig").is_some() && fields.get("lens").is_some()
    }

    async fn read(app: &App, fields: &Fields) -> ApiResult<Self> {
        let named = |what: &str| match fields.get(what) {
            Some(text) => name(what, text.to_owned()),
            None => Err(ApiError::new(
                Code::InvalidRequest,
                format!("the {what} is missing: POST /v1/stacks?rig=...&lens=..., or a part '{what}' of the form"),
            )),
        };
        let (rig, lens) = (named("rig")?, named("lens")?);
        let options: StackOptions = fields.options()?;
        // before the profile is looked for: what is wrong in the request itself is told first
        options.check()?;
        let profile = app.rows.profile(&rig, &lens, options.profile_revision).await?;
        let Some(profile) = profile else { return Err(not_found(app, &rig, &lens, options.profile_revision).await) };
        Self::new(profile, options, None)
    }

    fn key(&self) -> (&Name, &Name) {
        (&self.profile.rig, &self.profile.lens)
    }

    fn disk_need(&self) -> u64 {
        disk_need_by_profile(&self.profile.input)
    }

    fn asked(&self) -> serde_json::Value {
        let mut asked =
            serde_json::json!({ "rig": self.profile.rig, "lens": self.profile.lens, "options": self.options });
        if let Some(id) = self.rerun_of {
            asked["rerun_of"] = serde_json::json!(id);
        }
        asked
    }

    fn check(&self, layout: &StackLayout) -> Result<Vec<Warning>, Fault> {
        let Profile { rig, lens, revision, slice_count, input, .. } = &self.profile;
        let profile = format!("the profile of rig '{rig}' and lens '{lens}' (revision {revision})");
        if layout.front.len() != *slice_count as usize {
            let found = layout.front.len();
            let skipped = archive::skipped(&layout.front).map_or(String::new(), |skipped| format!(": {skipped}"));
            let detail = format!("the archive has {found} front-light slices, {profile} has {slice_count}{skipped}");
            return Err(Fault::new(Code::SliceCountMismatch, detail));
        }
        if !layout.back.is_empty() && layout.back.len() != layout.front.len() {
            let (front, back) = (layout.front.len(), layout.back.len());
            let detail = format!("the archive has {front} front-light slices and {back} back-light slices");
            return Err(Fault::new(Code::SliceCountMismatch, detail));
        }
        if (layout.width, layout.height) != (input.image_width, input.image_height) {
            let (width, height) = (layout.width, layout.height);
            let (right_width, right_height) = (input.image_width, input.image_height);
            let turned = match layout.orientation {
                1 => String::new(),
                tag => format!(
                    " after their orientation tag ({tag}) was applied; switch off the automatic rotation of the camera, or \
                     remove the tag (exiftool -Orientation= *.jpg)"
                ),
            };
            let detail = format!(
                "the slices have {width} x {height} px{turned}; {profile} is for {right_width} x {right_height} px"
            );
            return Err(Fault::new(Code::SizeMismatch, detail));
        }
        if let Some(bits) = self.options.input_bits.bits().filter(|_| layout.bit_depth == 8) {
            let detail = format!(
                "input_bits={bits}, but the slices have 8 bits per sample; it is for 16-bit files alone, leave it out"
            );
            return Err(Fault::new(Code::InvalidRequest, detail));
        }
        if self.options.mask == MaskMode::Required && layout.back.is_empty() {
            let detail = "mask=required, but the archive has no back-light slices; put them into a folder 'back'";
            return Err(Fault::new(Code::MaskFailed, detail));
        }
        Ok(Vec::new())
    }

    fn request(&self, upload: Upload, layout: StackLayout) -> JobRequest {
        let layout = match self.options.order {
            SliceOrder::Name => layout,
            SliceOrder::Reverse => layout.reversed(),
        };
        let mut options = self.options.clone();
        if options.mask != MaskMode::None && !layout.back.is_empty() {
            // what is used is shown, and stays what it is when the defaults change
            let MaskParams { min_blob_px: blob, min_hole_px: hole, .. } =
                options.mask_params(layout.width as usize, layout.height as usize);
            (options.mask_min_blob_px, options.mask_min_hole_px) = (Some(blob), Some(hole));
        }
        JobRequest::Stack(StackRequest {
            options,
            profile_revision: self.profile.revision,
            profile_digest: self.profile.digest.clone(),
            profile_optics_digest: Some(self.profile.optics_digest.clone()),
            upload,
            layout,
            rerun_of: self.rerun_of,
        })
    }
}

fn check_crop(options: &StackOptions, profile: &Profile) -> ApiResult<()> {
    let Crop::Rect { x, y, width, height } = options.crop else { return Ok(()) };
    let (right, bottom) = (profile.input.image_width, profile.input.image_height);
    let fits = |start: u32, length: u32, end: u32| u64::from(start) + u64::from(length) <= u64::from(end);
    if fits(x, width, right) && fits(y, height, bottom) {
        return Ok(());
    }
    let detail = format!("crop is {x},{y},{width},{height}; it leaves the reference slice of {right} x {bottom} px");
    Err(ApiError::new(Code::InvalidRequest, detail))
}
