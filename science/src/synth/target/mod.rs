//! The dot target: its geometry, its rendering, and typical defects of a real setup.

mod beyond;
mod disc_overlap;
#[cfg(test)]
mod fault_tests;
mod faults;
mod flaws;
mod layout;
mod render;
mod specks;
#[cfg(test)]
mod tests;

use super::noise::{key, uniform};
use super::rig::Rig;

pub use faults::{Banding, Faults, Kernel, Moved, Replacement};
pub use flaws::{Flaws, Glare, Surround};
pub use render::render_target;

/// A flat plate with a grid of round dots, parallel to the sensor or nearly so.
#[derive(Debug, Clone, PartialEq)]
pub struct DotTarget {
    /// Dots per row.
    pub columns: usize,
    /// Dots per column.
    pub rows: usize,
    /// Distance of neighbouring dots, mm.
    pub pitch_mm: f64,
    /// Diameter of a dot, mm.
    pub dot_diameter_mm: f64,
    /// Rotation of the grid, degrees.
    pub rotation_deg: f64,
    /// Where the middle of the grid lies relative to the optical axis, mm.
    pub offset_mm: [f64; 2],
    /// Light of the bright part, 0..1 of full scale: the plate; with `invert` the dots.
    pub white: f64,
    /// Light of the dark part, 0..1 of full scale: the dots; with `invert` the plate.
    pub black: f64,
    /// Bright dots on a dark plate.
    pub invert: bool,
    /// Depth of the plate, as a fraction of the rig; `None`: in focus in the reference slice.
    /// It stays there in all slices.
    pub depth: Option<f64>,
    /// Every other row is shifted by half a step and rows lie half a step apart: dot (row, column) at
    /// `((2 column + row % 2) / 2, row / 2)` pitches.
    pub asymmetric: bool,
    /// Dots that were not printed, as indices of [`DotTarget::dots`].
    pub missing: Vec<usize>,
    /// How far the plate is turned out of the plane of the sensor, degrees: about the x axis (its lower
    /// border goes away from the camera), then about the y axis (its right border comes nearer). The
    /// middle of the grid stays at [`DotTarget::depth`]. With a moving lens a tilted plate has parallax: then
    /// `Rig::homography` is exact for the depth of its middle only.
    pub tilt_deg: [f64; 2],
    /// Column and row of the code at the first dot: the dots are small or large ([`crate::target`]). `None`: all dots
    /// have one size.
    pub code: Option<[i64; 2]>,
    /// What is not as it should be.
    pub flaws: Flaws,
}

impl DotTarget {
    /// A target that fills the picture of `rig` in its reference slice: dots half a pitch wide, `columns`
    /// in a row, all of them within every slice of an ordinary stack, slightly rotated.
    pub fn for_rig(rig: &Rig, columns: usize) -> Self {
        let field_mm = rig.width as f64 * rig.pixel_pitch_mm / rig.magnification;
        let pitch_mm = 0.94 * field_mm / columns.max(2) as f64;
        let visible_rows = 0.94 * field_mm * rig.height as f64 / rig.width as f64 / pitch_mm;
        Self {
            columns: columns.max(2),
            rows: (visible_rows.floor() as usize).max(2),
            pitch_mm,
            dot_diameter_mm: pitch_mm / 2.0,
            rotation_deg: 0.7,
            offset_mm: [0.03 * pitch_mm, -0.02 * pitch_mm],
            white: 0.85,
            black: 0.06,
            invert: false,
            depth: None,
            asymmetric: false,
            missing: Vec::new(),
            tilt_deg: [0.0; 2],
            code: None,
            flaws: Flaws::default(),
        }
    }

    /// No target for a calibration: a small plate lying obliquely on a table among discs, rings and sticks.
    pub fn oblique(rig: &Rig, columns: usize) -> Self {
        let whole = Self::for_rig(rig, columns);
        Self {
            pitch_mm: 0.6 * whole.pitch_mm,
            dot_diameter_mm: 0.6 * whole.dot_diameter_mm,
            rotation_deg: 12.0,
            tilt_deg: [35.0, -12.0],
            flaws: Flaws { surround: Some(Surround { clutter: 60, ..Surround::table() }), ..Flaws::default() },
            ..whole
        }
    }

    /// A target shown by a monitor whose pixels look nearly as large as the camera's own, so that
    /// the picture is full of moiré where it is sharp.
    pub fn on_monitor(rig: &Rig, columns: usize) -> Self {
        let flaws = Flaws { raster_px: Some(1.15), ..Flaws::default() };
        Self { flaws, rotation_deg: 2.2, ..Self::for_rig(rig, columns) }
    }

    /// The same target without about `share` (0..1) of its dots; which ones follows from `seed`.
    #[must_use]
    pub fn without(mut self, share: f64, seed: u64) -> Self {
        let lost = |&dot: &usize| uniform(key(&[seed, 0x0107, dot as u64])) < share;
        self.missing = (0..self.columns * self.rows).filter(lost).collect();
        self
    }
}
