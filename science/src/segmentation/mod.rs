//! Silhouette segmentation: the mask of the object from its fused back light.
//!
//! In: the fused back-lit slices and where they are valid. Out: a [`Silhouette`], a mask that is full where the object
//! covers more than half of a pixel, with metrics and warnings. The steps:
//!
//! 1. `illumination` fits a smooth surface to the background and makes the light even.
//! 2. `tones` finds the threshold, half-way between object and background, from a histogram (`otsu`).
//! 3. `translucent` adds areas that the light shines through, such as wings.
//! 4. `components`: small parts are removed, small holes are filled, and what remains is counted.
//! 5. `soft_alpha`, if asked for, makes the edge of the image's alpha proportional to the cover.
//! 6. `warnings` report suspected faults.
//!
//! Apart from these, [`lights_exchanged`] detects stacks whose front light and back light changed places.

mod components;
mod exchanged_lights;
mod illumination;
mod otsu;
mod soft_alpha;
mod tones;
mod translucent;
mod warnings;

use rayon::prelude::*;

use crate::{
    imaging::{Plane, Raster, Sample, grey},
    types::{
        Warning,
        mask_options::{MaskEdge, MaskThreshold},
        metrics::MaskMetrics,
    },
};
use components::{Components, Connectivity};
pub use exchanged_lights::lights_exchanged;
use illumination::Illumination;
use otsu::{Histogram, PART};
use soft_alpha::{MIN_COVER, soft_alpha};
use tones::Tones;
use warnings::Cleaning;

/// Holes of at least this many pixels are wide enough to show the back light in their middle as bright as it is.
const WIDE_HOLE_PX: u64 = 16;
/// Range of the brightest value of a true hole, where 0 is as bright as the object and 1 as the background. A wide hole
/// outside of this range is a reflection.
const HOLE_BRIGHTNESS: [f64; 2] = [0.65, 1.2];

/// Parameters of [`segment`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskParams {
    /// Threshold below which a pixel is object: a share of full scale, or found in the picture.
    pub threshold: MaskThreshold,
    /// Parts of the object with fewer pixels are removed.
    pub min_blob_px: u32,
    /// Holes with fewer pixels are filled.
    pub min_hole_px: u32,
    /// Whether the image's alpha has a soft edge.
    pub edge: MaskEdge,
}

impl MaskParams {
    /// The default parameters for a picture of `width` x `height` px: parts below 0.002 % of its pixels are removed and
    /// holes below 0.0005 % are filled; either limit is at least 4 px.
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

/// The object, separated from its background.
#[derive(Debug, Clone, PartialEq)]
pub struct Silhouette {
    /// 255 where the object is, 0 for background and pixels that are not valid.
    pub mask: Plane<u8>,
    /// With [`MaskEdge::Soft`]: share of each pixel that the object covers, 255 for all of it; at least 128 exactly
    /// where `mask` is 255.
    pub soft_alpha: Option<Plane<u8>>,
    /// Measurements of the mask; `separability` is none when the picture has a single value.
    pub metrics: MaskMetrics,
    /// Suspected faults of the mask.
    pub warnings: Vec<Warning>,
}

impl Silhouette {
    /// The alpha of the image: soft when that was asked for, otherwise the mask.
    pub fn image_alpha(&self) -> &Plane<u8> {
        self.soft_alpha.as_ref().unwrap_or(&self.mask)
    }
}

/// Segments a fused back light (1 or 3 channels; its grey value counts). `valid` is 255 where the picture is valid;
/// elsewhere is background, which does not influence the threshold.
///
/// With [`MaskThreshold::Auto`] the light is made even first, and translucent areas (wings) belong to the object they
/// are attached to. A fixed threshold applies to the picture as it is.
///
/// Connectivity: parts of the object are 8-connected and also joined by pixels that are only slightly darker than the
/// background, so that hairs hold together. Holes are 4-connected background that reaches neither the border of the
/// canvas nor pixels that are not valid. Small parts are removed before small holes are filled.
///
/// ```
/// # use pinstack_science::{imaging::{Plane, Raster}, segmentation::{MaskParams, segment}};
/// // a dark square in front of a lamp
/// let inside = |at: usize| (40..80).contains(&(at % 120)) && (20..60).contains(&(at / 120));
/// let light = (0..120 * 80).map(|at| if inside(at) { 20 } else { 220 }).collect();
/// let light = Raster::eight(120, 80, 1, light);
/// let silhouette = segment(&light, &Plane::filled(120, 80, 255), &MaskParams::default_for(120, 80));
/// assert_eq!((silhouette.mask.at(60, 40), silhouette.mask.at(10, 10)), (255, 0));
/// assert_eq!(silhouette.metrics.components, 1);
/// ```
pub fn segment(backlight: &Raster, valid: &Plane<u8>, params: &MaskParams) -> Silhouette {
    let (width, height) = (backlight.width, backlight.height);
    let mut grey = grey_values(backlight);
    let is_valid = |at: usize| valid.data.get(at).is_some_and(|&v| v != 0);
    let is_auto = params.threshold == MaskThreshold::Auto;
    let illumination = is_auto.then(|| Illumination::fit(&grey, width, height, is_valid)).flatten();
    if let Some(illumination) = &illumination {
        illumination.even_out(&mut grey, width);
    }
    let tones = Tones::of(&Histogram::of_pixels(&grey, is_valid), params.threshold);

    let object = |at: usize| is_valid(at) && f64::from(grey[at]) < tones.threshold;
    let pixels = (0..grey.len()).into_par_iter();
    let mut mask = Plane { width, height, data: pixels.map(|at| if object(at) { 255 } else { 0 }).collect() };
    let translucent = if is_auto { translucent::find(&grey, &mask, is_valid, &tones) } else { None };
    if let Some(translucent) = &translucent {
        mask.data
            .iter_mut()
            .zip(&translucent.pixels)
            .filter(|(_, translucent)| **translucent)
            .for_each(|(v, _)| *v = 255);
    }
    let faint = |at: usize| is_valid(at) && tones.cover(grey[at]) > MIN_COVER;
    let removed_parts = remove_small(&mut mask, params.min_blob_px, faint);
    let holes = fill_holes(&mut mask, params.min_hole_px, is_valid, &grey, &tones);

    let metrics = MaskMetrics {
        foreground_fraction: object_share(mask.data.iter().copied()),
        threshold: tones.threshold,
        separability: tones.separability,
        border_contact_fraction: object_share(border(&mask)),
        // after filling: an island in a filled hole is no part of its own
        components: count_parts(&mask, faint),
        holes,
        light_falloff: illumination.map(|illumination| illumination.falloff()),
        translucent_fraction: translucent.as_ref().map_or(0.0, |translucent| translucent.share),
    };
    let soft_alpha =
        (params.edge == MaskEdge::Soft).then(|| soft_alpha(&grey, &mask, translucent.as_ref(), is_valid, &tones));
    let cleaning = Cleaning { min_blob_px: params.min_blob_px, removed_parts };
    let warnings = warnings::of(&metrics, translucent.as_ref(), !is_auto, cleaning);
    Silhouette { mask, soft_alpha, metrics, warnings }
}

/// Removes parts of fewer than `least` pixels, and returns their number. Faint pixels join parts but do not count.
fn remove_small(mask: &mut Plane<u8>, least: u32, faint: impl Fn(usize) -> bool + Sync) -> u32 {
    let (mut components, pixels) = parts(mask, faint);
    components.for_each_run(&pixels, |pixels, y, columns| {
        if *pixels < u64::from(least) {
            mask.row_mut(y)[columns.clone()].fill(0);
        }
    });
    pixels.iter().filter(|&&pixels| pixels > 0 && pixels < u64::from(least)).count() as u32
}

/// Number of parts of the object. Faint pixels join parts.
fn count_parts(mask: &Plane<u8>, faint: impl Fn(usize) -> bool + Sync) -> u32 {
    parts(mask, faint).1.iter().filter(|&&pixels| pixels > 0).count() as u32
}

/// The parts of the object, joined by faint pixels, and the number of object pixels of each.
fn parts(mask: &Plane<u8>, faint: impl Fn(usize) -> bool + Sync) -> (Components, Vec<u64>) {
    let (width, height) = (mask.width, mask.height);
    let joined: Vec<bool> = mask.data.par_iter().enumerate().map(|(at, &object)| object != 0 || faint(at)).collect();
    let mut components = Components::of(width, height, Connectivity::Eight, |at| joined[at]);
    let pixels = components.accumulate(|pixels: &mut u64, y, columns| {
        *pixels += mask.row(y)[columns.clone()].iter().filter(|&&v| v != 0).count() as u64;
    });
    (components, pixels)
}

/// A component of the background.
#[derive(Debug, Clone, Copy, Default)]
struct Hole {
    pixels: u64,
    /// Whether it reaches the border of the canvas or pixels that are not valid.
    open: bool,
    /// Its largest grey value.
    brightest: f32,
}

/// Fills holes of fewer than `least` pixels and reflections, and returns the number of holes that remain.
fn fill_holes(mask: &mut Plane<u8>, least: u32, is_valid: impl Fn(usize) -> bool, grey: &[f32], tones: &Tones) -> u32 {
    let (width, height) = (mask.width, mask.height);
    let mut components = Components::of(width, height, Connectivity::Four, |at| mask.data[at] == 0);
    let holes = components.accumulate(|hole: &mut Hole, y, columns| {
        let start = y * width;
        hole.pixels += columns.len() as u64;
        hole.open |= y == 0 || y + 1 == height || columns.start == 0 || columns.end == width;
        let pixels = start + columns.start..start + columns.end;
        hole.brightest = grey[pixels.clone()].iter().fold(hole.brightest, |brightest, &v| brightest.max(v));
        hole.open |= !pixels.into_iter().all(&is_valid);
    });
    let is_filled = |hole: &Hole| {
        // 0 as the object to 1 as the background
        let brightest = (f64::from(hole.brightest) - tones.dark) / (tones.bright - tones.dark).max(1e-6);
        let reflects = hole.pixels >= WIDE_HOLE_PX && !(HOLE_BRIGHTNESS[0]..=HOLE_BRIGHTNESS[1]).contains(&brightest);
        !hole.open && (hole.pixels < u64::from(least) || reflects)
    };
    components.for_each_run(&holes, |hole, y, columns| {
        if is_filled(hole) {
            mask.row_mut(y)[columns.clone()].fill(255);
        }
    });
    holes.iter().filter(|hole| hole.pixels > 0 && !hole.open && !is_filled(hole)).count() as u32
}

/// Luma of each pixel as a share of full scale.
fn grey_values(raster: &Raster) -> Vec<f32> {
    fn of<S: Sample>(samples: &[S], channels: usize, pixels: usize) -> Vec<f32> {
        let mut out = vec![0.0; pixels];
        let parts = out.par_chunks_mut(PART).zip(samples.par_chunks(PART * channels));
        parts.for_each(|(out, samples)| {
            grey::luma_row(samples, channels, out);
            out.iter_mut().for_each(|v| *v /= 255.0);
        });
        out
    }
    let pixels = raster.width * raster.height;
    match &raster.samples {
        crate::imaging::Samples::Eight(samples) => of(samples, raster.channels, pixels),
        crate::imaging::Samples::Sixteen(samples) => of(samples, raster.channels, pixels),
    }
}

/// The pixels of the border of the canvas, each once.
fn border(mask: &Plane<u8>) -> impl Iterator<Item = u8> + '_ {
    let (width, height) = (mask.width, mask.height);
    (0..height).flat_map(move |y| {
        let whole_row = y == 0 || y + 1 == height;
        let step = if whole_row || width < 2 { 1 } else { width - 1 };
        (0..width).step_by(step).map(move |x| mask.at(x, y))
    })
}

/// Share of the values that are not 0.
fn object_share(values: impl Iterator<Item = u8>) -> f64 {
    let (mut object, mut all) = (0u64, 0u64);
    for value in values {
        object += u64::from(value != 0);
        all += 1;
    }
    object as f64 / all.max(1) as f64
}

#[cfg(test)]
mod tests;
