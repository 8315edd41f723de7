//! Reconstructions: what is asked for, what the row of the job keeps of the views, and what comes out.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::{Code, Fault, Name, upload::Upload};
use pinstack_science::types::{error::ErrorLocation, intrinsics::Intrinsics, view::ViewAngles};

/// Names of the files of a reconstruction, which are also the ends of their URLs.
pub mod files {
    /// The points, PLY.
    pub const POINTS: &str = "points";
    /// The cameras, JSON.
    pub const CAMERAS: &str = "cameras";
    /// The model of COLMAP, a zip of its text files.
    pub const MODEL: &str = "model";
    /// The report on the camera poses.
    pub const POSES: &str = "poses";
    /// The visual hull, GLB.
    pub const HULL: &str = "hull";
    /// The mesh of an outside program, PLY or GLB.
    pub const MESH: &str = "mesh";
    /// What COLMAP said.
    pub const LOG: &str = "log";
}

/// Options of a reconstruction. An omitted option gets its default.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReconstructionOptions {
    /// Leave out views without a result. Otherwise every view must have one.
    pub partial: bool,
    /// Observations with a larger error of reprojection are left out, px, 0.1 to 16. Choose 4, the limit of COLMAP
    /// itself, for a lens with a distortion that the profile does not know.
    #[schema(minimum = 0.1, maximum = 16.0)]
    pub max_error_px: f64,
}

impl Default for ReconstructionOptions {
    fn default() -> Self {
        Self { partial: false, max_error_px: 1.0 }
    }
}

impl ReconstructionOptions {
    /// Checks what the types alone do not.
    ///
    /// # Errors
    /// [`Code::InvalidRequest`] for a limit outside its range.
    pub fn check(&self) -> Result<(), Fault> {
        if (0.1..=16.0).contains(&self.max_error_px) {
            return Ok(());
        }
        let detail = "max_error_px must be 0.1 to 16";
        let pointer = Some("/max_error_px".to_owned());
        let place = ErrorLocation { detail: detail.to_owned(), pointer, ..ErrorLocation::default() };
        Err(Fault::new(Code::InvalidRequest, detail).at(place))
    }
}

/// A result of a stack that a reconstruction reads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredPicture {
    /// Key in the blob store.
    pub key: String,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex.
    pub sha256: String,
}

/// A view that is to be reconstructed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReconstructionView {
    /// Name of its files, without extension: unique, of `A-Z a-z 0-9 _ - +` alone.
    pub name: String,
    /// Its stack.
    pub stack: Uuid,
    /// Extension of the image, without a dot.
    pub extension: String,
    /// Bits per sample of the image, 8 or 16.
    pub bit_depth: u8,
    /// Commanded pan and tilt.
    pub angles: Option<ViewAngles>,
    /// The fused image.
    pub image: StoredPicture,
    /// The mask.
    pub mask: Option<StoredPicture>,
    /// What is conspicuous about its stack, as sentences: the likely causes if the view does not register.
    pub remarks: Vec<String>,
}

/// The request of a reconstruction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReconstructionRequest {
    /// The scan.
    pub scan: Name,
    /// The options.
    pub options: ReconstructionOptions,
    /// Size and digest of all pictures together. They are results of stacks, so the key is empty.
    pub upload: Upload,
    /// How many views the scan should have.
    pub expected: u32,
    /// Width and height of every image, px.
    pub image_size_px: [u32; 2],
    /// The common camera, if it is known.
    pub intrinsics: Option<Intrinsics>,
    /// Centre of the uncropped image in these images, `[x, y]` px.
    pub canvas_centre_px: [f64; 2],
    /// Distance from the centre of projection to the point where the axes of pan and tilt meet, mm.
    pub radius_mm: Option<f64>,
    /// With growing pan the camera moves clockwise around the object, seen from above.
    pub pan_is_clockwise: bool,
    /// The views, at least one.
    pub views: Vec<ReconstructionView>,
}

impl ReconstructionRequest {
    /// The pictures, each with its path in a bundle for COLMAP.
    pub fn pictures(&self) -> impl Iterator<Item = (String, &StoredPicture)> {
        self.views.iter().flat_map(|view| {
            let file = format!("{}.{}", view.name, view.extension);
            let mask = view.mask.as_ref().map(|mask| (format!("masks/{file}.png"), mask));
            std::iter::once((format!("images/{file}"), &view.image)).chain(mask)
        })
    }
}

/// What a reconstruction found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReconstructionResult {
    /// Number of registered views. 0: there is no model, and of the files only the log.
    pub registered: u32,
    /// How many views the scan should have.
    pub expected: u32,
    /// Number of points.
    pub points: u32,
    /// Number of places in images at which the points were seen.
    pub observations: u64,
    /// Mean error of reprojection over all observations, px; null without a model.
    pub mean_error_px: Option<f64>,
    /// Focal length of the model, px; null without a model.
    pub focal_px: Option<f64>,
    /// Unit of `radial` and `tangential` of the views: `mm`, or `radius` (shares of the radius of the turntable).
    pub unit: Option<pinstack_science::photogrammetry::poses::LengthUnit>,
    /// The visual hull of the masks; null without masks, or where masks and cameras give none.
    #[serde(default)]
    pub hull: Option<ReconstructedHull>,
    /// Program and version that made it.
    pub program: String,
    /// The views, by tilt, pan and name.
    pub views: Vec<ReconstructedView>,
    /// What is conspicuous, the most serious first.
    pub findings: Vec<ReconstructionFinding>,
}

/// Figures of the visual hull, in `unit` (areas in its square, volumes in its cube).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReconstructedHull {
    /// Volume within the surface. It is at least that of the object: hollows that no outline shows are filled.
    pub volume: f64,
    /// Area of the surface.
    pub area: f64,
    /// Sides of its bounding box along the axes of the model.
    pub size: [f64; 3],
    /// Side of a cell: details smaller than this are not in it.
    pub cell: f64,
    /// Number of triangles.
    pub triangles: u32,
    /// File names of views that were left out, because their mask is empty or contradicts the others.
    pub left_out: Vec<String>,
}

/// A view of a reconstruction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReconstructedView {
    /// Name of the view.
    pub name: String,
    /// Id of its stack.
    pub stack: Uuid,
    /// Whether the view is part of the model.
    pub registered: bool,
    /// Features that were found in the image; null when COLMAP did not say.
    pub features: Option<u32>,
    /// Points of the model that it sees; null unless it is registered.
    pub points: Option<u32>,
    /// Mean error of reprojection of these points, px.
    pub mean_error_px: Option<f64>,
    /// Distance from the circle or sphere of the turntable, outwards, in `unit`.
    pub radial: Option<f64>,
    /// Distance along the circle or sphere from the place that pan and tilt command, in `unit`.
    pub tangential: Option<f64>,
}

/// Something conspicuous about a reconstruction.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ReconstructionFinding {
    /// `no_model`, `not_registered`, `several_parts`, `turntable_slipped`, `specimen_moved`, `turntable_wobbles`,
    /// `focal_length_disagrees`, `too_few_features`, `no_surface`, `no_mesh`, or a code of the report on poses.
    pub code: String,
    /// What it is, in which views, and what to do.
    pub detail: String,
    /// Names of the views concerned.
    pub views: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_outside_its_range_is_refused() {
        let options = |text: &str| serde_json::from_str::<ReconstructionOptions>(text).expect("options");
        assert_eq!(options("{}"), ReconstructionOptions { partial: false, max_error_px: 1.0 });
        assert_eq!(options(r#"{"max_error_px": 4}"#).check(), Ok(()));
        for wrong in [r#"{"max_error_px": 0}"#, r#"{"max_error_px": 17}"#] {
            assert!(options(wrong).check().expect_err("outside").detail.contains("0.1 to 16"));
        }
    }
}
