//! Defects of a target, its light and its surroundings.

use super::Faults;

/// The defects. The default is a perfect target in front of a linear sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Flaws {
    /// Number of dark specks on the plate; they move with it.
    pub target_dust: usize,
    /// Number of soft dark specks on the sensor, at the same px in all slices.
    pub sensor_dust: usize,
    /// Reflections of lamps, at the same px in all slices.
    pub glare: Vec<Glare>,
    /// What is seen beyond the plate; `None`: the plate has no end.
    pub surround: Option<Surround>,
    /// The target is shown by a monitor whose pixels are this large in the reference slice, px of the
    /// camera.
    pub raster_px: Option<f64>,
    /// Stored values are sRGB encoded. Blur, exposure, vignetting and glare act before the encoding, noise after it.
    pub gamma: bool,
    /// Factor on all light. A plate of light `white` clips with a factor above `1 / white`.
    pub overexposure: f64,
    /// Faults of the capture.
    pub faults: Faults,
    /// Seed of all random positions and sizes.
    pub seed: u64,
}

impl Default for Flaws {
    fn default() -> Self {
        Self {
            target_dust: 0,
            sensor_dust: 0,
            glare: Vec::new(),
            surround: None,
            raster_px: None,
            gamma: false,
            overexposure: 1.0,
            faults: Faults::default(),
            seed: 1,
        }
    }
}

/// A smooth bright patch that adds light, and clips where that is too much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Glare {
    /// Middle, as shares of the width and the height of the picture.
    pub at: [f64; 2],
    /// Standard deviation of its Gaussian, as a share of the shorter side.
    pub radius: f64,
    /// Light added in its middle, 0..1 of full scale.
    pub light: f64,
}

/// The world beyond the plate. It lies at the plate's depth and is blurred like it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surround {
    /// From the outermost dots to the border of the plate, pitches.
    pub margin: f64,
    /// Width of a black frame around the plate, pitches.
    pub frame: f64,
    /// Mean light beyond, 0..1 of full scale.
    pub light: f64,
    /// How much that varies from place to place, as a share of it.
    pub unevenness: f64,
    /// Number of things that lie there: coins, washers, sticks.
    pub clutter: usize,
}

impl Surround {
    /// A grey uneven table with a dozen things on it.
    pub fn table() -> Self {
        Self { margin: 0.8, frame: 0.0, light: 0.35, unevenness: 0.5, clutter: 12 }
    }

    /// A black frame, then a bright wall.
    pub fn framed() -> Self {
        Self { margin: 1.0, frame: 1.5, light: 0.6, unevenness: 0.1, clutter: 0 }
    }
}
