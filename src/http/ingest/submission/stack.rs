//! The submission of a focus stack: options, and the profile revision that it is fused with.

use uuid::Uuid;

use crate::{
    contract::{
        Code, Fault, Name,
        input::SliceOrder,
        options::{Crop, MaskMode, StackOptions},
        profile::Profile,
        request::{StackRequest, Upload},
    },
    http::{ApiError, ApiResult, App, auth::Caller, extract::path::name, ingest::fields::Fields, profiles, scans},
    jobs::{disk::disk_need_by_profile, mask_params},
};
use pinstack_science::{
    archive,
    segmentation::MaskParams,
    types::{Warning, WarningCode, stack_layout::StackLayout},
};

/// A stack to fuse with one revision of a profile.
pub struct StackSubmission {
    profile: Profile,
    options: StackOptions,
    /// The stack whose zip is used again.
    rerun_of: Option<Uuid>,
    /// What sentences call the profile.
    called: String,
}

impl StackSubmission {
    /// A submission with these options and this revision of the profile.
    ///
    /// # Errors
    /// `invalid_request` for options that break a rule, or a crop that leaves the canvas of the profile.
    pub fn new(profile: Profile, options: StackOptions, rerun_of: Option<Uuid>) -> ApiResult<Self> {
        options.check()?;
        check_crop(&options, &profile)?;
        let Profile { rig, lens, revision, .. } = &profile;
        let called = format!("the profile of rig '{rig}' and lens '{lens}' (revision {revision})");
        Ok(Self { profile, options, rerun_of, called })
    }

    /// The same with a profile that sentences call `called`: it is of no rig and lens.
    #[must_use]
    pub fn with_profile_called(self, called: &str) -> Self {
        Self { called: called.to_owned(), ..self }
    }

    pub(super) async fn read(app: &App, caller: &Caller, fields: &Fields) -> ApiResult<Self> {
        let named = |what: &str| match fields.get(what) {
            Some(text) => name(what, text.to_owned()),
            None => Err(ApiError::new(
                Code::InvalidRequest,
                format!("the {what} is missing: POST /v1/stacks?rig=...&lens=..., or a part '{what}' of the form"),
            )),
        };
        let (rig, lens) = (named("rig")?, named("lens")?);
        let options: StackOptions = fields.options()?;
        // before the profile is looked up: errors of the request itself are reported first
        options.check()?;
        let profile = profiles::find(app, &rig, &lens, options.profile_revision).await?;
        if let Some(scan) = &options.scan {
            scans::require_joinable(app, caller, scan, &rig, &lens).await?;
        }
        Self::new(profile, options, None)
    }

    pub(super) fn profile_key(&self) -> (&Name, &Name) {
        (&self.profile.rig, &self.profile.lens)
    }

    /// Bytes that the job may write beyond its upload.
    pub fn disk_need(&self) -> u64 {
        disk_need_by_profile(&self.profile.input)
    }

    pub(super) fn fingerprint_input(&self) -> serde_json::Value {
        let mut input =
            serde_json::json!({ "rig": self.profile.rig, "lens": self.profile.lens, "options": self.options });
        if let Some(id) = self.rerun_of {
            input["rerun_of"] = serde_json::json!(id);
        }
        input
    }

    /// Checks the contents of the zip and builds the request that the row of the job keeps.
    ///
    /// # Errors
    /// `size_mismatch`, `slice_count_mismatch` and others, with the number found and the number expected.
    pub fn to_request(&self, upload: Upload, layout: StackLayout) -> Result<StackRequest, Fault> {
        self.check(&layout)?;
        let layout = match self.options.order {
            SliceOrder::Name => layout,
            SliceOrder::Reverse => layout.reversed(),
        };
        let mut options = self.options.clone();
        if options.mask != MaskMode::None && !layout.back.is_empty() {
            // the sizes in use are recorded, so that they stay the same when the defaults change
            let MaskParams { min_blob_px: blob, min_hole_px: hole, .. } =
                mask_params(&options, layout.width as usize, layout.height as usize);
            (options.mask_min_blob_px, options.mask_min_hole_px) = (Some(blob), Some(hole));
        }
        Ok(StackRequest {
            options,
            profile_revision: self.profile.revision,
            profile_digest: self.profile.digest.clone(),
            profile_optics_digest: Some(self.profile.optics_digest.clone()),
            upload,
            layout,
            rerun_of: self.rerun_of,
        })
    }

    /// A warning for turned slices, if the profile does not know the orientation of those it was measured in.
    pub fn unknown_orientation(&self, layout: &StackLayout) -> Option<Warning> {
        let is_turned = layout.orientation != 1 && self.profile.input.orientation.is_none();
        let detail = format!(
            "the slices are turned by their orientation tag ({}), and the profile does not say in which orientation it was \
             measured; if contours are double, switch off the automatic rotation of the camera, or remove the tag; a new \
             calibration records the orientation",
            layout.orientation
        );
        is_turned.then(|| Warning::new(WarningCode::OrientationUnknown, detail))
    }

    fn check(&self, layout: &StackLayout) -> Result<(), Fault> {
        let Profile { slice_count, input, .. } = &self.profile;
        let profile = &self.called;
        if let Some(moved) = layout.moved.first() {
            let detail = format!(
                "{moved} is in a folder for the moved target of a calibration; put the slices of a stack into front/ and \
                 back/"
            );
            return Err(Fault::new(Code::InvalidArchive, detail).in_file(moved.as_str(), None));
        }
        if layout.front.len() != *slice_count as usize {
            let found = layout.front.len();
            let copies = archive::copies(&layout.front);
            let why = archive::copied(&layout.front).or_else(|| archive::skipped(&layout.front));
            let why = why.map_or(String::new(), |why| format!(": {why}"));
            let detail = format!(
                "the archive has {found} front-light slices, {profile} has {slice_count}{why}; send all slices of the \
                 stack once, or calibrate again with this number of slices"
            );
            return Err(copies.iter().fold(Fault::new(Code::SliceCountMismatch, detail), |fault, copy| {
                let slice = layout.front.iter().position(|name| name == copy).and_then(|at| u32::try_from(at).ok());
                fault.in_file(*copy, slice)
            }));
        }
        if !layout.back.is_empty() && layout.back.len() != layout.front.len() {
            let (front, back) = (layout.front.len(), layout.back.len());
            let detail = format!(
                "the archive has {front} front-light slices and {back} back-light slices; send one back-light slice \
                 for each front-light slice"
            );
            return Err(Fault::new(Code::SliceCountMismatch, detail));
        }
        if (layout.width, layout.height) != (input.image_width, input.image_height) {
            let (width, height) = (layout.width, layout.height);
            let (expected_width, expected_height) = (input.image_width, input.image_height);
            let (turned, advice) = match layout.orientation {
                1 => (String::new(), "; set the camera to this size, or calibrate again"),
                tag => (
                    format!(
                        " after their orientation tag ({tag}) was applied; switch off the automatic rotation of the \
                         camera, or remove the tag (exiftool -Orientation= *.jpg)"
                    ),
                    "",
                ),
            };
            let detail = format!(
                "the slices have {width} x {height} px{turned}; {profile} is for {expected_width} x {expected_height} px{advice}"
            );
            return Err(Fault::new(Code::SizeMismatch, detail));
        }
        if let Some(expected) = input.orientation.filter(|expected| *expected != layout.orientation) {
            let detail = format!(
                "the slices have the orientation tag {} (1 is none), but {profile} was measured in slices of orientation \
                 {expected}: its homographies belong to the sensor and do not fit turned pictures; switch off the \
                 automatic rotation of the camera, and set the tag of all slices to {expected} (exiftool -n \
                 -Orientation={expected} *.jpg), or calibrate again",
                layout.orientation
            );
            return Err(Fault::new(Code::SizeMismatch, detail));
        }
        if let Some(bits) = self.options.input_bits.bits().filter(|_| layout.bit_depth == 8) {
            let detail = format!(
                "input_bits={bits}, but the slices have 8 bits per sample; the option applies to 16-bit files only: \
                 omit it"
            );
            return Err(Fault::new(Code::InvalidRequest, detail));
        }
        if self.options.mask == MaskMode::Required && layout.back.is_empty() {
            let detail = "mask=required, but the archive has no back-light slices; put them into a folder 'back', or send \
                          mask=auto";
            return Err(Fault::new(Code::MaskFailed, detail));
        }
        Ok(())
    }
}

fn check_crop(options: &StackOptions, profile: &Profile) -> ApiResult<()> {
    let Crop::Rect { x, y, width, height } = options.crop else { return Ok(()) };
    let (right, bottom) = (profile.input.image_width, profile.input.image_height);
    let fits = |start: u32, length: u32, end: u32| u64::from(start) + u64::from(length) <= u64::from(end);
    if fits(x, width, right) && fits(y, height, bottom) {
        return Ok(());
    }
    let detail = format!(
        "crop is {x},{y},{width},{height} and extends beyond the reference slice of {right} x {bottom} px; choose a \
         rectangle inside it"
    );
    Err(ApiError::new(Code::InvalidRequest, detail))
}
