//! Options of stacks: types, defaults and checks. Every option has a default.

mod crop;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use pinstack_science::types::{
    fusion_options::{GuidedParams, Method},
    mask_options::{MaskEdge, MaskThreshold},
    text_or_number::TextOrNumber,
};

pub use crop::Crop;

use super::{
    Name, Priority,
    input::{InputBits, SliceOrder},
};

/// Whether the object is cut out with the back-light stack.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskMode {
    /// If there is a back-light stack.
    #[default]
    Auto,
    /// Never.
    None,
    /// Always. A stack without a back light is refused.
    Required,
}

/// File format of the image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ImageFormat {
    /// PNG, RGBA.
    #[default]
    Png,
    /// TIFF, RGBA, deflated.
    #[serde(alias = "tif")]
    Tiff,
    /// JPEG, RGB, 8 bits, without alpha. Pixels outside the object have the colour of `under_alpha`.
    #[serde(alias = "jpg")]
    Jpeg,
}

/// Whether a height map is measured.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeightMode {
    /// No.
    #[default]
    None,
    /// Yes, in the unit that the profile allows: millimetres in the object, millimetres of the rail, or steps.
    Auto,
}

/// What happens to the lateral colour of the lens that the profile knows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LateralColourMode {
    /// Red and blue are moved to where green is.
    #[default]
    Correct,
    /// Colours stay where the lens images them.
    Keep,
}

/// Bits per sample of the image: `auto`, `8` or `16`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "TextOrNumber", into = "String")]
pub enum BitDepth {
    /// The depth of the slices; 8 bits in a JPEG.
    Auto,
    /// 8 bits. The default: COLMAP 3.8 does not open a PNG or TIFF of 16-bit RGBA.
    #[default]
    Eight,
    /// 16 bits.
    Sixteen,
}

impl BitDepth {
    /// Bytes per sample of an image made from slices of `slices` bits per sample.
    pub fn sample_bytes(self, slices: u8) -> u64 {
        match self {
            Self::Auto if slices > 8 => 2,
            Self::Auto | Self::Eight => 1,
            Self::Sixteen => 2,
        }
    }
}

impl TryFrom<TextOrNumber> for BitDepth {
    type Error = String;
    fn try_from(value: TextOrNumber) -> Result<Self, String> {
        match value.into_text().as_str() {
            "auto" => Ok(Self::Auto),
            "8" => Ok(Self::Eight),
            "16" => Ok(Self::Sixteen),
            text => Err(format!("bit_depth is '{text}'; it must be 'auto', '8' or '16'")),
        }
    }
}

impl From<BitDepth> for String {
    fn from(depth: BitDepth) -> Self {
        match depth {
            BitDepth::Auto => "auto",
            BitDepth::Eight => "8",
            BitDepth::Sixteen => "16",
        }
        .into()
    }
}

/// Colour of the pixels whose alpha is 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum UnderAlpha {
    /// Black: most feature extractors ignore alpha and would see the background.
    #[default]
    Black,
    /// The fused colour.
    Keep,
    /// The colour of the object continued by 4 px beyond its outline, black farther out: without the step from the
    /// object to black that feature detectors and the interpolation of textures would see.
    Pad,
}

impl UnderAlpha {
    /// Whether pixels whose alpha is 0 have the colour that was fused there.
    pub fn is_fused_colour(self) -> bool {
        match self {
            Self::Keep => true,
            Self::Black | Self::Pad => false,
        }
    }
}

/// Default quality of a JPEG. Its compression errors are as large as the noise of a photograph.
pub const JPEG_QUALITY: u8 = 95;

/// Options of a stack: the query parameters of `POST /v1/stacks`, the `options` part of a form, and the `options` of a
/// stack. The descriptions of the query parameters and of the schemas are the comments below; the ranges are in
/// [`super::ranges::STACK`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StackOptions {
    /// Revision of the profile. Default: the current one.
    pub profile_revision: Option<u32>,
    /// Whether the object is cut out with the back-light stack: `auto` (if there is one), `none`, or `required`.
    pub mask: MaskMode,
    /// Threshold of the fused back light: `auto` (half-way between object and background), or 0 to 1.
    #[schema(value_type = String, example = "auto")]
    pub mask_threshold: MaskThreshold,
    /// Remove parts of the object smaller than this, px (area). Default: 0.002 % of a slice, at least 4. Null where no
    /// mask is made.
    pub mask_min_blob_px: Option<u32>,
    /// Fill holes smaller than this, px (area). Default: 0.0005 % of a slice, at least 4. Null where no mask is made.
    pub mask_min_hole_px: Option<u32>,
    /// Alpha of the image at the edge of the object: `hard` (0 or full), or `soft` (the fraction of the pixel that is
    /// object). The separate mask is always hard.
    pub mask_edge: MaskEdge,
    /// File format of the image.
    pub format: ImageFormat,
    /// Quality of the image with `format=jpeg`. Colour is kept at full resolution (4:4:4).
    pub jpeg_quality: u8,
    /// Bits per sample of the image: `8`, `16`, or `auto` (as the slices).
    #[schema(value_type = String, default = "8", example = "8", pattern = "^(auto|8|16)$")]
    pub bit_depth: BitDepth,
    /// Order of the slices relative to the profile: `name` (natural order of the names, or that of `manifest.json`), or
    /// `reverse`.
    pub order: SliceOrder,
    /// Significant bits of 16-bit files. `10`, `12` and `14` are scaled to full range. `auto` uses samples unchanged
    /// and warns when they look like fewer bits. `16` uses them unchanged without a warning.
    #[schema(value_type = String, example = "auto", pattern = "^(auto|10|12|14|16)$")]
    pub input_bits: InputBits,
    /// Part of the canvas that the results show: `none` (all of it), `valid` (the largest rectangle that every slice
    /// covers), or `x,y,w,h` in px of the reference slice.
    #[schema(value_type = String, example = "none")]
    pub crop: Crop,
    /// Lateral colour of the lens, if the profile has it: `correct` (red and blue are moved to where green is), or
    /// `keep`.
    pub lateral_colour: LateralColourMode,
    /// Colour of pixels whose alpha is 0: `black`, `keep` (the fused colour), or `pad` (the colour of the object
    /// continued by 4 px).
    pub under_alpha: UnderAlpha,
    /// Height map: `none`, or `auto` (measured, in the unit that the profile allows; it takes time and memory).
    pub height: HeightMode,
    /// Fusion method. `guided` is the method of the paper; `r1`, `eps1`, `r2`, `eps2`, `average`, `r_g` and `sigma_g`
    /// are its parameters and have no effect on the others.
    pub method: Method,
    /// `guided`: radius of the guided filter for the weights of the base layer, px.
    pub r1: u32,
    /// `guided`: regularisation for the base layer, for intensities in 0..1.
    pub eps1: f64,
    /// `guided`: radius of the guided filter for the weights of the detail layer, px.
    pub r2: u32,
    /// `guided`: regularisation for the detail layer, for intensities in 0..1.
    pub eps2: f64,
    /// `guided`: side of the mean filter that makes the base layer, px, odd.
    pub average: u32,
    /// `guided`: radius of the Gaussian that smooths |Laplacian| to the saliency, px.
    pub r_g: u32,
    /// `guided`: standard deviation of the Gaussian that smooths |Laplacian| to the saliency, px.
    pub sigma_g: f64,
    /// Free text; used in the file names of the results.
    pub label: Option<String>,
    /// The scan that this view belongs to.
    pub scan: Option<Name>,
    /// Commanded pan of the turntable, degrees.
    pub pan_deg: Option<f64>,
    /// Commanded tilt, degrees.
    pub tilt_deg: Option<f64>,
    /// Delete upload and results this many days after the end. Default: never.
    pub keep_days: Option<u32>,
    /// `high`: before the other jobs of its rig, as calibrations are; `normal`; or `low`: only when no job of any rig
    /// waits. Rigs take turns.
    pub priority: Priority,
}

impl Default for StackOptions {
    fn default() -> Self {
        let GuidedParams { r1, eps1, r2, eps2, average, r_g, sigma_g } = GuidedParams::default();
        Self {
            profile_revision: None,
            mask: MaskMode::default(),
            mask_threshold: MaskThreshold::default(),
            mask_min_blob_px: None,
            mask_min_hole_px: None,
            mask_edge: MaskEdge::default(),
            format: ImageFormat::default(),
            jpeg_quality: JPEG_QUALITY,
            bit_depth: BitDepth::default(),
            order: SliceOrder::default(),
            input_bits: InputBits::default(),
            crop: Crop::default(),
            lateral_colour: LateralColourMode::default(),
            under_alpha: UnderAlpha::default(),
            height: HeightMode::default(),
            method: Method::default(),
            r1,
            eps1,
            r2,
            eps2,
            average,
            r_g,
            sigma_g,
            label: None,
            scan: None,
            pan_deg: None,
            tilt_deg: None,
            keep_days: None,
            priority: Priority::default(),
        }
    }
}
