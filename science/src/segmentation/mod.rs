//! The object cut out with its fused back light: what keeps more than half of the light away is object.

mod components;
mod exchanged;
mod light;
mod otsu;
mod soft;
mod tones;
mod translucent;
mod warnings;

use crate::{
    imaging::{Plane, Raster, Sample, grey},
    types::{
        Warning,
        mask_options::{MaskEdge, MaskThreshold},
        metrics::MaskMetrics,
    },
};
use components::{Connectivity, Parts};
pub use exchanged::exchanged;
use light::Light;
use otsu::Histogram;
use tones::Tones;

/// A hole of this many pixels and more is wide enough to show the back light in its middle as bright as it is. What stays
/// darker than the first share of the way from dark to bright, or is brighter than the second, is a reflection.
const WIDE_HOLE_PX: u64 = 16;
const HOLE_LIGHT: [f64; 2] = [0.65, 1.2];

/// How the object is cut out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskParams {
    /// Share of full scale below which a pixel is object, or the one that is found.
    pub threshold: MaskThreshold,
    /// Object parts of fewer pixels are removed.
    pub min_blob_px: u32,
    /// Holes of fewer pixels are filled.
    pub min_hole_px: u32,
    /// Whether pixels at the edge are told by how much of them is object.
    pub edge: MaskEdge,
}

impl MaskParams {
    /// The default parameters for a `width` x `height` picture: parts below 0.002 % and holes below 0.0005 % of it are
    /// removed, but never fewer than 4 px.
    pub fn default_for(width: usize, height: usize) -> Self {
        let share = |percent: f64| ((width * height) as f64 * percent / 100.0).round().max(4.0) as u32;
        Self {
            threshold: MaskThreshold::default(),
            min_blob_px: share(0.002),
            min_hole_px: share(0.0005),
            edge: MaskEdge::default(),
        }
    }
}

/// The object, cut out.
#[derive(Debug, Clone, PartialEq)]
pub struct Silhouette {
    /// 255 object, 0 background and pixels that are not valid.
    pub alpha: Plane<u8>,
    /// With [`MaskEdge::Soft`]: share of each pixel that is object, 255 all of it; 128 and more where `alpha` is 255.
    pub soft: Option<Plane<u8>>,
    /// Figures to judge it by; `separability` is null when the picture has one value only.
    pub metrics: MaskMetrics,
    /// What looks wrong with it.
    pub warnings: Vec<Warning>,
}

impl Silhouette {
    /// The alpha of the picture: soft when that was asked for.
    pub fn of_picture(&self) -> &Plane<u8> {
        self.soft.as_ref().unwrap_or(&self.alpha)
    }
}

/// Cuts the object out of its fused back light (1 or 3 channels; its grey value counts). `valid` is 255
/// where the picture is valid; elsewhere is background, and nothing there enters the threshold.
///
/// Unless the threshold is given, the light is made even first, and areas that it shines through (wings) belong to the
/// object that they hang on.
///
/// Connectivity: parts of the object touch also over corners (8 neighbours) and over what is only just darker than
/// the background, so that hairs hold together; holes are of background that touches over edges alone (4 neighbours),
/// and do not reach the border of the canvas or what is not valid. Removing comes before filling.
pub fn cut_out(backlight: &Raster, valid: &Plane<u8>, params: &MaskParams) -> Silhouette {
    let (width, height) = (backlight.width, backlight.height);
    let mut grey = shares(backlight);
    let is_valid = |at: usize| valid.data.get(at).is_some_and(|&v| v != 0);
    // a threshold that is given is meant for the picture as it is
    let finds = params.threshold == MaskThreshold::Auto;
    let light = finds.then(|| Light::of(&grey, width, height, is_valid)).flatten();
    if let Some(light) = &light {
        light.even_out(&mut grey, width);
    }
    let histogram = Histogram::of(grey.iter().enumerate().filter(|&(at, _)| is_valid(at)).map(|(_, &v)| v));
    let tones = Tones::of(&histogram, params.threshold);

    let object = |at: usize| is_valid(at) && f64::from(grey[at]) < tones.threshold;
    let mut alpha = Plane { width, height, data: (0..grey.len()).map(|at| if object(at) { 255 } else { 0 }).collect() };
    let thin = if finds { translucent::find(&grey, &alpha, is_valid, &tones) } else { None };
    if let Some(thin) = &thin {
        alpha.data.iter_mut().zip(&thin.pixels).filter(|(_, thin)| **thin).for_each(|(v, _)| *v = 255);
    }
    let faint = |at: usize| is_valid(at) && tones.cover(grey[at]) > soft::LEAST;
    let components = remove_small(&mut alpha, params.min_blob_px, faint);
    let holes = fill_holes(&mut alpha, params.min_hole_px, is_valid, |at| {
        (f64::from(grey[at]) - tones.dark) / (tones.bright - tones.dark).max(1e-6)
    });

    let metrics = MaskMetrics {
        foreground_fraction: share(alpha.data.iter().copied()),
        threshold: tones.threshold,
        separability: tones.separability,
        border_contact_fraction: share(border(&alpha)),
        components,
        holes,
        light_falloff: light.map(|light| light.falloff()),
        translucent_fraction: thin.as_ref().map_or(0.0, |thin| thin.share),
    };
    let soft = (params.edge == MaskEdge::Soft).then(|| soft::edge(&grey, &alpha, thin.as_ref(), is_valid, &tones));
    let warnings = warnings::of(&metrics, thin.as_ref());
    Silhouette { alpha, soft, metrics, warnings }
}

/// Removes parts of fewer than `least` pixels; what is faint joins parts and is not counted. The number of parts left.
fn remove_small(alpha: &mut Plane<u8>, least: u32, faint: impl Fn(usize) -> bool) -> u32 {
    let (width, height) = (alpha.width, alpha.height);
    let mut parts = Parts::of(width, height, Connectivity::Eight, |at| alpha.data[at] != 0 || faint(at));
    let pixels = parts.survey(|pixels: &mut u64, y, columns| {
        *pixels += alpha.row(y)[columns.clone()].iter().filter(|&&v| v != 0).count() as u64;
    });
    parts.visit(&pixels, |pixels, y, columns| {
        if *pixels < u64::from(least) {
            alpha.row_mut(y)[columns.clone()].fill(0);
        }
    });
    pixels.iter().filter(|&&pixels| pixels > 0 && pixels >= u64::from(least)).count() as u32
}

/// Background that the object encloses.
#[derive(Debug, Clone, Copy, Default)]
struct Hole {
    pixels: u64,
    /// It reaches the border of the canvas or what is not valid.
    open: bool,
    /// The brightest place in it, 0 as the object to 1 as the background.
    brightest: f64,
}

/// Fills holes of fewer than `least` pixels, and those that the back light does not shine through. The number left.
fn fill_holes(
    alpha: &mut Plane<u8>,
    least: u32,
    is_valid: impl Fn(usize) -> bool,
    brightness: impl Fn(usize) -> f64,
) -> u32 {
    let (width, height) = (alpha.width, alpha.height);
    let mut parts = Parts::of(width, height, Connectivity::Four, |at| alpha.data[at] == 0);
    let holes = parts.survey(|hole: &mut Hole, y, columns| {
        let start = y * width;
        hole.pixels += columns.len() as u64;
        hole.open |= y == 0 || y + 1 == height || columns.start == 0 || columns.end == width;
        for at in start + columns.start..start + columns.end {
            hole.open |= !is_valid(at);
            hole.brightest = hole.brightest.max(brightness(at));
        }
    });
    let goes = |hole: &Hole| {
        let reflects = hole.pixels >= WIDE_HOLE_PX && !(HOLE_LIGHT[0]..=HOLE_LIGHT[1]).contains(&hole.brightest);
        !hole.open && (hole.pixels < u64::from(least) || reflects)
    };
    parts.visit(&holes, |hole, y, columns| {
        if goes(hole) {
            alpha.row_mut(y)[columns.clone()].fill(255);
        }
    });
    holes.iter().filter(|hole| hole.pixels > 0 && !hole.open && !goes(hole)).count() as u32
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

#[cfg(test)]
mod tests;
