//! The object cut out with its fused back light: darker than the threshold is object.

mod components;
mod otsu;

use crate::{
    imaging::{Plane, Raster, Sample, grey},
    model::{
        Warning,
        metrics::MaskMetrics,
        options::{MaskThreshold, StackOptions},
    },
};
use components::{Connectivity, remove_small};
use otsu::Histogram;

/// Below this share of explained variance there are hardly two kinds of pixels.
const DOUBTFUL_SEPARABILITY: f64 = 0.75;
/// An object that takes so much of the border is probably the background.
const INVERTED_BORDER: f64 = 0.5;

/// How the object is cut out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskParams {
    /// Share of full scale below which a pixel is object, or Otsu's.
    pub threshold: MaskThreshold,
    /// Object parts of fewer pixels are removed.
    pub min_blob_px: u32,
    /// Holes of fewer pixels are filled.
    pub min_hole_px: u32,
}

impl MaskParams {
    /// What `options` say for a `width` x `height` picture: by default parts below 0.002 % and holes below
    /// 0.0005 % of it are cleaned away, at least 4 px.
    pub fn from_options(options: &StackOptions, width: usize, height: usize) -> Self {
        let share = |percent: f64| ((width * height) as f64 * percent / 100.0).round().max(4.0) as u32;
        Self {
            threshold: options.mask_threshold,
            min_blob_px: options.mask_min_blob_px.unwrap_or_else(|| share(0.002)),
            min_hole_px: options.mask_min_hole_px.unwrap_or_else(|| share(0.0005)),
        }
    }
}

/// The object, cut out.
#[derive(Debug, Clone, PartialEq)]
pub struct Silhouette {
    /// 255 object, 0 background and pixels that are not valid.
    pub alpha: Plane<u8>,
    /// Figures to judge it by; `separability` is null when the picture has one value only.
    pub metrics: MaskMetrics,
    /// What looks wrong with it.
    pub warnings: Vec<Warning>,
}

/// Cuts the object out of its fused back light (1 or 3 channels; its grey value counts). `valid` is 255
/// where the picture is valid; elsewhere is background, and nothing there enters the threshold.
///
/// Connectivity: parts of the object touch also over corners (8 neighbours), so that hairs hold together;
/// holes are of background that touches over edges alone (4 neighbours), and do not reach the border of the
/// canvas or what is not valid. Removing comes before filling.
pub fn cut_out(backlight: &Raster, valid: &Plane<u8>, params: &MaskParams) -> Silhouette {
    let (width, height) = (backlight.width, backlight.height);
    let grey = shares(backlight);
    let is_valid = |at: usize| valid.data.get(at).is_some_and(|&v| v != 0);
    let histogram = Histogram::of(grey.iter().enumerate().filter(|&(at, _)| is_valid(at)).map(|(_, &v)| v));
    let otsu = histogram.otsu();
    let threshold = match params.threshold {
        MaskThreshold::Fixed(threshold) => threshold,
        // one value only: no threshold can part it
        MaskThreshold::Auto => otsu.map_or(0.5, |otsu| otsu.threshold),
    };
    let separability = match params.threshold {
        MaskThreshold::Auto => otsu.map(|otsu| otsu.separability),
        MaskThreshold::Fixed(threshold) => histogram.separability(threshold),
    };

    let object = |at: usize| is_valid(at) && f64::from(grey[at]) < threshold;
    let mut alpha = Plane { width, height, data: (0..grey.len()).map(|at| if object(at) { 255 } else { 0 }).collect() };
    let components = remove_small(&mut alpha, 255, 0, Connectivity::Eight, params.min_blob_px, |_| true);
    // what is not valid is outside: background that touches it is no hole
    let closed = |at: usize| is_valid(at);
    let holes = remove_small(&mut alpha, 0, 255, Connectivity::Four, params.min_hole_px, closed);

    let metrics = MaskMetrics {
        foreground_fraction: share(alpha.data.iter().copied()),
        threshold,
        separability,
        border_contact_fraction: share(border(&alpha)),
        components: components.kept,
        holes: holes.kept_inside,
    };
    let warnings = warnings(&metrics);
    Silhouette { alpha, metrics, warnings }
}

/// Grey value of each pixel as a share of full scale.
fn shares(raster: &Raster) -> Vec<f32> {
    fn of<S: Sample>(samples: &[S], channels: usize, pixels: usize) -> Vec<f32> {
        let mut out = vec![0.0; pixels];
        grey::luma_row(samples, channels, &mut out);
        out.iter_mut().for_each(|v| *v /= 255.0);
        out
    }
    let pixels = raster.width * raster.height;
    match &raster.samples {
        crate::imaging::Samples::Eight(samples) => of(samples, raster.channels, pixels),
        crate::imaging::Samples::Sixteen(samples) => of(samples, raster.channels, pixels),
    }
}

/// The border pixels, each once.
fn border(alpha: &Plane<u8>) -> impl Iterator<Item = u8> + '_ {
    let (width, height) = (alpha.width, alpha.height);
    (0..height).flat_map(move |y| {
        let whole_row = y == 0 || y + 1 == height;
        let step = if whole_row || width < 2 { 1 } else { width - 1 };
        (0..width).step_by(step).map(move |x| alpha.at(x, y))
    })
}

fn share(values: impl Iterator<Item = u8>) -> f64 {
    let (mut object, mut all) = (0u64, 0u64);
    for value in values {
        object += u64::from(value != 0);
        all += 1;
    }
    object as f64 / all.max(1) as f64
}

fn warnings(metrics: &MaskMetrics) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let mut warn = |code: &str, detail: String| warnings.push(Warning::new(code, detail));
    let percent = 100.0 * metrics.threshold;
    if metrics.foreground_fraction == 0.0 {
        warn(
            "mask_empty",
            format!("nothing is darker than {percent:.1} % of full scale in the back light: the mask is empty"),
        );
    }
    if metrics.foreground_fraction > 0.999 {
        warn("mask_full", format!("everything is darker than {percent:.1} % of full scale: was the back light on?"));
    }
    if let Some(separability) = metrics.separability
        && separability < DOUBTFUL_SEPARABILITY
    {
        warn(
            "mask_low_separability",
            format!(
                "object and background of the back light hardly differ (separability {separability:.2}, good is above \
                 0.9): raise the back light or shield the object from the front light"
            ),
        );
    }
    let border = metrics.border_contact_fraction;
    if border > INVERTED_BORDER && metrics.foreground_fraction <= 0.999 {
        warn(
            "mask_inverted",
            format!(
                "{:.0} % of the border of the picture counts as object: the background must be brighter than the \
                 object, look whether these are the back-light slices",
                100.0 * border
            ),
        );
    } else if border > 0.0 && metrics.foreground_fraction <= 0.999 {
        warn(
            "mask_touches_border",
            format!("{:.1} % of the border of the picture is object: the object is cut off there", 100.0 * border),
        );
    }
    warnings
}

#[cfg(test)]
mod tests;
