//! What a client can ask of a stack. Every option has a default that needs no thought.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use pinstack_science::segmentation::MaskParams;
use pinstack_science::types::{
    error::ErrorLocation,
    fusion_options::{GuidedParams, Method},
    mask_options::{MaskEdge, MaskThreshold},
    text_or_number::TextOrNumber,
};

use super::{
    Code, Fault, Name,
    input::{InputBits, SliceOrder},
};

/// Whether the object is cut out with the back-light stack.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskMode {
    /// When there is a back-light stack.
    #[default]
    Auto,
    /// Never.
    None,
    /// Always; a stack without a back light is refused.
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
    /// JPEG, RGB, 8 bits. There is no alpha: pixels outside the object have the colour that `under_alpha` says.
    #[serde(alias = "jpg")]
    Jpeg,
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
    /// Black: most feature extractors do not look at alpha, and would see the background.
    #[default]
    Black,
    /// The fused colour.
    Keep,
}

/// Which part of the reference slice's canvas comes out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Crop {
    /// All of it: one intrinsic for every view.
    #[default]
    None,
    /// The largest rectangle that every slice covers; depends on the profile alone.
    Valid,
    /// A rectangle in reference-slice pixels.
    Rect {
        /// Left column.
        x: u32,
        /// Top row.
        y: u32,
        /// Width in px.
        width: u32,
        /// Height in px.
        height: u32,
    },
}

impl TryFrom<String> for Crop {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
        match (text.as_str(), numbers.as_deref()) {
            ("none", _) => Ok(Self::None),
            ("valid", _) => Ok(Self::Valid),
            (_, Some(&[x, y, width, height])) if width > 0 && height > 0 => Ok(Self::Rect { x, y, width, height }),
            _ => Err(format!("crop is '{text}'; it must be 'none', 'valid' or 'x,y,w,h' in px of the reference slice")),
        }
    }
}

impl From<Crop> for String {
    fn from(crop: Crop) -> Self {
        match crop {
            Crop::None => "none".into(),
            Crop::Valid => "valid".into(),
            Crop::Rect { x, y, width, height } => format!("{x},{y},{width},{height}"),
        }
    }
}

/// Quality of a JPEG that nobody asked another of. Its errors are those of the noise of a photograph.
pub const JPEG_QUALITY: u8 = 95;

/// Options of a stack, as query parameters, as the `options` part of a form, and as the stack shows what
/// was used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StackOptions {
    /// Use this revision of the profile instead of the current one.
    pub profile_revision: Option<u32>,
    /// Whether the object is cut out.
    pub mask: MaskMode,
    /// Threshold of the fused back light: `auto` (half-way between object and background) or 0 to 1.
    #[schema(value_type = String, example = "auto")]
    pub mask_threshold: MaskThreshold,
    /// Object parts smaller than this are removed, px. Default: 0.002 % of a slice, at least 4. Null where no mask is made.
    pub mask_min_blob_px: Option<u32>,
    /// Holes smaller than this are filled, px. Default: 0.0005 % of a slice, at least 4. Null where no mask is made.
    pub mask_min_hole_px: Option<u32>,
    /// What the alpha of the image is at the edge of the object.
    pub mask_edge: MaskEdge,
    /// File format of the image.
    pub format: ImageFormat,
    /// Quality of the image with `format=jpeg`, 1 to 100. Colour is kept at full resolution (4:4:4).
    #[schema(default = 95, minimum = 1, maximum = 100)]
    pub jpeg_quality: u8,
    /// Bits per sample of the image: `8`, `16`, or `auto` for the depth of the slices.
    #[schema(value_type = String, default = "8", example = "8", pattern = "^(auto|8|16)$")]
    pub bit_depth: BitDepth,
    /// Order of the slices against the profile.
    pub order: SliceOrder,
    /// Bits that the camera puts into 16-bit files; `auto`: samples are used as they are, and a warning says when they look
    /// like fewer.
    #[schema(value_type = String, example = "auto", pattern = "^(auto|10|12|14|16)$")]
    pub input_bits: InputBits,
    /// Which part of the canvas comes out: `none`, `valid` or `x,y,w,h`.
    #[schema(value_type = String, example = "none")]
    pub crop: Crop,
    /// Colour where alpha is 0.
    pub under_alpha: UnderAlpha,
    /// How slices are fused.
    pub method: Method,
    /// Radius of the guided filter for the base layer's weights, px.
    #[schema(default = 45)]
    pub r1: u32,
    /// Its regularisation, for intensities in 0..1.
    #[schema(default = 0.3)]
    pub eps1: f64,
    /// Radius of the guided filter for the detail layer's weights, px.
    #[schema(default = 7)]
    pub r2: u32,
    /// Its regularisation.
    #[schema(default = 1e-6)]
    pub eps2: f64,
    /// Side of the mean filter that makes the base layer, px, odd.
    #[schema(default = 31)]
    pub average: u32,
    /// Radius of the Gaussian that smooths |Laplacian| into the saliency, px.
    #[schema(default = 5)]
    pub r_g: u32,
    /// Its standard deviation, px.
    #[schema(default = 5.0)]
    pub sigma_g: f64,
    /// Free text, at most 200 characters.
    pub label: Option<String>,
    /// The scan that this view belongs to.
    pub scan: Option<Name>,
    /// Commanded pan of the turntable, degrees.
    pub pan_deg: Option<f64>,
    /// Commanded tilt, degrees.
    pub tilt_deg: Option<f64>,
    /// Remove upload and results this many days after the end. Default: never.
    pub keep_days: Option<u32>,
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
            under_alpha: UnderAlpha::default(),
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
        }
    }
}

impl StackOptions {
    /// The parameters of `method=guided`.
    pub fn guided(&self) -> GuidedParams {
        let &Self { r1, eps1, r2, eps2, average, r_g, sigma_g, .. } = self;
        GuidedParams { r1, eps1, r2, eps2, average, r_g, sigma_g }
    }

    /// How the object of a `width` x `height` picture is cut out.
    pub fn mask_params(&self, width: usize, height: usize) -> MaskParams {
        let default = MaskParams::default_for(width, height);
        MaskParams {
            threshold: self.mask_threshold,
            min_blob_px: self.mask_min_blob_px.unwrap_or(default.min_blob_px),
            min_hole_px: self.mask_min_hole_px.unwrap_or(default.min_hole_px),
            edge: self.mask_edge,
        }
    }

    /// Checks the rules that types alone do not hold.
    ///
    /// # Errors
    /// A [`Fault`] with [`Code::InvalidRequest`] that names each parameter.
    pub fn check(&self) -> Result<(), Fault> {
        let guided = self.guided();
        let is_deep_jpeg = self.format == ImageFormat::Jpeg && self.bit_depth == BitDepth::Sixteen;
        let rules: [(&str, bool, &str); 13] = [
            ("r1", (1..=200).contains(&guided.r1), "must be 1 to 200"),
            ("r2", (1..=200).contains(&guided.r2), "must be 1 to 200"),
            ("eps1", (1e-9..=10.0).contains(&guided.eps1), "must be 1e-9 to 10"),
            ("eps2", (1e-9..=10.0).contains(&guided.eps2), "must be 1e-9 to 10"),
            ("average", (3..=201).contains(&guided.average) && guided.average % 2 == 1, "must be odd, 3 to 201"),
            ("r_g", (1..=20).contains(&guided.r_g), "must be 1 to 20"),
            ("sigma_g", (0.1..=50.0).contains(&guided.sigma_g), "must be 0.1 to 50"),
            ("jpeg_quality", (1..=100).contains(&self.jpeg_quality), "must be 1 to 100"),
            ("bit_depth", !is_deep_jpeg, "is 16, and a JPEG has 8 bits: send bit_depth=8, or format=png or tiff"),
            ("label", self.label.as_ref().is_none_or(|l| l.chars().count() <= 200), "has at most 200 characters"),
            ("pan_deg", self.pan_deg.is_none_or(|v| v.abs() <= 3600.0), "must be -3600 to 3600"),
            ("tilt_deg", self.tilt_deg.is_none_or(|v| v.abs() <= 360.0), "must be -360 to 360"),
            ("keep_days", self.keep_days.is_none_or(|d| (1..=36_500).contains(&d)), "must be 1 to 36500"),
        ];
        let places: Vec<ErrorLocation> = rules
            .into_iter()
            .filter(|(_, holds, _)| !holds)
            .map(|(name, _, rule)| ErrorLocation {
                detail: format!("{name} {rule}"),
                pointer: Some(name.to_owned()),
                ..ErrorLocation::default()
            })
            .collect();
        match places.first() {
            None => Ok(()),
            Some(first) => Err(Fault { code: Code::InvalidRequest, detail: first.detail.clone(), locations: places }),
        }
    }
}
