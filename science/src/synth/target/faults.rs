//! Faults of a capture, each with its exact truth. By default there is none, and nothing is computed for them.
//!
//! Faults that the rig and the object share (a jump of the rig) belong to [`Rig`]; here are those of the target, the
//! lens as the sensor sees it, the lamp and the camera.

use nalgebra::Matrix3;

use crate::imaging::LUMA;
use crate::synth::noise::{between, key};
use crate::synth::rig::Rig;
use crate::types::Homography;

/// The faults. The default has none.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Faults {
    /// The target is moved on its plane at a slice and stays there.
    pub moved: Option<Moved>,
    /// 0-based index of a slice, and what it shows instead.
    pub replaced: Option<(usize, Replacement)>,
    /// Radial distortion k1 of the sensor side, the same in all slices: the ideal position of the pixel d is
    /// `c + (d - c)(1 + k1 |d - c|^2 / R^2)` with the image centre c and half the image diagonal R. Above -0.3;
    /// positive is barrel distortion, because the direction is opposite to that of
    /// [`Distortion`](crate::types::distortion::Distortion).
    pub distortion: f64,
    /// Lateral colour: the size of the red, green and blue image relative to the nominal one, minus 1.
    pub lateral: [f64; 3],
    /// Axial colour: the signed blur radius of the red, green and blue image minus the nominal one, px.
    pub axial_px: [f64; 3],
    /// Stripes of a lamp that flickers while the shutter rolls.
    pub banding: Option<Banding>,
    /// Light on the plate: relative change per pitch to the right and down, from the middle of the grid. It acts before
    /// the blur, whereas vignetting acts after it.
    pub illumination: [f64; 2],
    /// Light that the plate loses with the square of the distance from the middle of the grid, as a share per square of a
    /// pitch: a lamp near the middle. It acts before the blur, too.
    pub spot: f64,
    /// Shape of the blur.
    pub kernel: Kernel,
    /// Stored values follow an S-shaped curve, then sRGB.
    pub filmic: bool,
    /// One per slice: light of red, green and blue relative to the nominal exposure. A slice without entry has 1.
    pub exposures: Vec<[f64; 3]>,
    /// Largest error of the position of a printed dot per axis, and of its radius, in pitches.
    pub print_error: f64,
}

/// The target is moved by `by` pitches and turned about the middle of its grid from slice `from` on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// The first slice that shows it moved.
    pub from: usize,
    /// To the right and down on the plate, pitches.
    pub by: [f64; 2],
    /// Degrees.
    pub turn_deg: f64,
}

/// What a replaced slice shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Replacement {
    /// No light.
    Black,
    /// The plate without dots.
    Blank,
    /// The picture mirrored, left for right.
    Mirrored,
    /// Another target: 1.37 times the pitch, turned by 23 degrees.
    Other,
}

/// Stripes across the image: light is multiplied by `1 + strength cos(2 pi y / period + phase)`, with a random phase in
/// each slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Banding {
    /// Distance of neighbouring stripes, px.
    pub period_px: f64,
    /// Amplitude, as a share of the light.
    pub strength: f64,
}

/// Shape of the blur. All shapes are sums of concentric discs and have the second moment of the nominal disc.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kernel {
    /// A disc: an ideal lens.
    #[default]
    Disc,
    /// Nearly a Gaussian: five discs of equal light, one per class of radii.
    Gaussian,
    /// A bright core within a weak wide halo.
    CoreAndHalo,
    /// A bright ring: an over-corrected lens, or a mirror lens.
    Ring,
}

impl Kernel {
    /// The discs: radius relative to the nominal blur, and share of the light (negative ones are subtracted). The shares
    /// sum to 1, shares times squared radii too.
    pub(super) fn discs(self) -> &'static [[f64; 2]] {
        match self {
            Self::Disc => &[[1.0, 1.0]],
            // a Gaussian of standard deviation b / 2 consists of discs of radius R with R^2 / (b^2 / 2) distributed as
            // Gamma(2): its conditional means in five classes of equal probability
            Self::Gaussian => &[[0.5049, 0.2], [0.7411, 0.2], [0.9180, 0.2], [1.1094, 0.2], [1.4568, 0.2]],
            // 0.8 * 0.25 + 0.2 * 4 = 1
            Self::CoreAndHalo => &[[0.5, 0.8], [2.0, 0.2]],
            // squared radii 0.8 and 0.4, shares 1.5 and -0.5: a bright ring around a weaker middle; 1.5 * 0.8 - 0.5 * 0.4 = 1
            Self::Ring => &[[0.894_427_190_999_916, 1.5], [0.632_455_532_033_675_9, -0.5]],
        }
    }

    /// The largest radius relative to the nominal blur.
    pub(super) fn reach(self) -> f64 {
        self.discs().iter().map(|disc| disc[0]).fold(0.0, f64::max)
    }
}

impl Faults {
    /// Where the target lies in slice `i`: grid units from the middle -> the same, moved.
    pub(super) fn moved(&self, i: usize) -> Option<Matrix3<f64>> {
        let moved = self.moved.filter(|moved| i >= moved.from)?;
        let (sin, cos) = moved.turn_deg.to_radians().sin_cos();
        Some(Matrix3::new(cos, -sin, moved.by[0], sin, cos, moved.by[1], 0.0, 0.0, 1.0))
    }

    /// Error of a printed dot in pitches: across, down, radius. The same in all slices.
    pub(super) fn print_error(&self, seed: u64, column: usize, row: usize) -> [f64; 3] {
        if self.print_error == 0.0 {
            return [0.0; 3];
        }
        [0, 1, 2].map(|what| {
            let number = key(&[seed, 0x9417, column as u64, row as u64, what]);
            between(number, -self.print_error, self.print_error)
        })
    }

    /// Light of red, green and blue in slice `i`, relative to the nominal exposure.
    pub(super) fn exposure(&self, i: usize) -> [f64; 3] {
        self.exposures.get(i).copied().unwrap_or([1.0; 3])
    }

    /// Light of slice `i` as grey, relative to the nominal exposure.
    pub(super) fn grey_exposure(&self, i: usize) -> f64 {
        match self.exposure(i) {
            [red, green, blue] if red == green && green == blue => red,
            exposure => exposure.iter().zip(LUMA).map(|(light, share)| light * f64::from(share)).sum(),
        }
    }

    /// Light on the plate at a place in grid units from the middle, relative to that in the middle.
    pub(super) fn light_at(&self, [x, y]: [f64; 2]) -> f64 {
        (1.0 + self.illumination[0] * x + self.illumination[1] * y - self.spot * (x * x + y * y)).max(0.02)
    }

    /// Factor of the light in row `y` of slice `i`.
    pub(super) fn stripe(&self, seed: u64, i: usize, y: usize) -> f64 {
        let Some(banding) = self.banding else { return 1.0 };
        let phase = between(key(&[seed, 0xba9d, i as u64]), 0.0, std::f64::consts::TAU);
        1.0 + banding.strength * (std::f64::consts::TAU * y as f64 / banding.period_px + phase).cos()
    }

    /// True when the channels see different pictures.
    pub(super) fn channels_differ(&self) -> bool {
        self.lateral != [0.0; 3] || self.axial_px != [0.0; 3]
    }

    /// Px of the sensor -> px without distortion.
    pub fn undistort(&self, rig: &Rig, px: [f64; 2]) -> [f64; 2] {
        if self.distortion == 0.0 {
            return px;
        }
        let [cx, cy] = rig.centre();
        let factor = 1.0 + self.distortion * relative_square(rig, px);
        [cx + (px[0] - cx) * factor, cy + (px[1] - cy) * factor]
    }

    /// The inverse of [`Faults::undistort`], to 1e-12 px near the image.
    pub fn distort(&self, rig: &Rig, ideal: [f64; 2]) -> [f64; 2] {
        if self.distortion == 0.0 {
            return ideal;
        }
        let [cx, cy] = rig.centre();
        let wanted = relative_square(rig, ideal).sqrt();
        // Newton's method for r (1 + k1 r^2) = wanted
        let mut radius = wanted;
        for _ in 0..20 {
            let square = radius * radius;
            let slope = (1.0 + 3.0 * self.distortion * square).max(0.1);
            radius -= (radius * (1.0 + self.distortion * square) - wanted) / slope;
        }
        let factor = if wanted > 0.0 { radius / wanted } else { 1.0 };
        [cx + (ideal[0] - cx) * factor, cy + (ideal[1] - cy) * factor]
    }

    /// Px without distortion per px of the sensor at `px`: the root of the ratio of areas.
    pub(super) fn stretch(&self, rig: &Rig, px: [f64; 2]) -> f64 {
        if self.distortion == 0.0 {
            return 1.0;
        }
        let square = self.distortion * relative_square(rig, px);
        ((1.0 + square) * (1.0 + 3.0 * square)).max(0.0).sqrt()
    }

    /// The truth for slice `i` with distortion: px of the slice -> px of the reference slice, for what is in focus in the
    /// reference slice.
    pub fn to_reference(&self, rig: &Rig, map: &Homography, px: [f64; 2]) -> [f64; 2] {
        self.distort(rig, map.apply(self.undistort(rig, px)))
    }
}

/// Squared distance from the image centre, relative to half the diagonal.
fn relative_square(rig: &Rig, px: [f64; 2]) -> f64 {
    let [cx, cy] = rig.centre();
    ((px[0] - cx).powi(2) + (px[1] - cy).powi(2)) / (cx * cx + cy * cy).max(1.0)
}

/// An S-shaped tone curve of 0..1: contrast is lower in shadows and highlights. The fit of the ACES curve by Narkowicz
/// (2016), scaled to end at 1.
pub(super) fn filmic(light: f32) -> f32 {
    let curve = |x: f32| x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
    (curve(light.clamp(0.0, 1.0)) / curve(1.0)).clamp(0.0, 1.0)
}
