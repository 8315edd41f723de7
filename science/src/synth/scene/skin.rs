//! Colours of a surface: pattern, fine grain, light from the upper left.

use super::super::noise::fractal;
use super::shape::Place;

/// What is drawn on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pattern {
    /// Clouds of the two colours.
    Mottled,
    /// Stripes along the part's axis, this many per unit.
    Striped(f64),
    /// Rows of pits along the part's axis, this many per unit.
    Pitted(f64),
    /// A midrib with side veins, this many per unit.
    Veined(f64),
    /// Squares of the two colours, this many per unit.
    Chequered(f64),
}

/// How a surface looks under front light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skin {
    /// Its colour, linear RGB 0..1.
    pub base: [f32; 3],
    /// The other colour of its pattern.
    pub accent: [f32; 3],
    /// How the two are laid out.
    pub pattern: Pattern,
    /// Depth of the fine grain, 0..1. Grain reaches down to the size of a pixel, so that there is always
    /// something to focus on.
    pub grain: f32,
    /// Strength of the highlight, 0..1.
    pub gloss: f32,
    /// The grain follows from it.
    pub seed: u64,
}

impl Skin {
    /// Linear RGB at `place`, which lies at `point`; `pixel` is the size of a pixel in scene units.
    pub(crate) fn colour(&self, place: &Place, point: [f64; 2], pixel: f64) -> [f32; 3] {
        const GRAINS_PER_UNIT: f64 = 24.0;
        let finest = 1.2 * pixel * GRAINS_PER_UNIT;
        let (x, y) = (point[0] * GRAINS_PER_UNIT, point[1] * GRAINS_PER_UNIT);
        let grain = fractal(self.seed, x, y, 6, 0.72, finest);
        // the coarser grain as a relief: its slope bends the normal
        let coarse = |x: f64, y: f64| fractal(self.seed, x, y, 3, 0.72, finest);
        let (step, steep) = (0.3, 0.45 * self.grain);
        let here = coarse(x, y);
        let bend = [(coarse(x + step, y) - here) * steep, (coarse(x, y + step) - here) * steep];
        let share = self.accent_share(place, point, pixel, grain);
        let light = self.light(place, bend);
        let rim = 1.0 - 0.3 * ((place.distance / 0.012).min(0.0).exp() as f32);
        let tone = (1.0 + 0.75 * self.grain * grain) * rim;
        let highlight = self.gloss * light.1;
        std::array::from_fn(|channel| {
            let colour = self.base[channel] + share * (self.accent[channel] - self.base[channel]);
            (colour * tone * light.0 + highlight).clamp(0.0, 1.0)
        })
    }

    /// 0 where the base colour is seen, 1 where the accent is.
    fn accent_share(&self, place: &Place, point: [f64; 2], pixel: f64, grain: f32) -> f32 {
        let [along, across] = place.local;
        let edge = |value: f64, width: f64| (0.5 + value / width.max(1e-9)).clamp(0.0, 1.0) as f32;
        match self.pattern {
            Pattern::Mottled => {
                let cloud = fractal(self.seed ^ 0xc10d, point[0] * 9.0, point[1] * 9.0, 3, 0.6, pixel * 9.0);
                edge(f64::from(cloud + 0.5 * grain), 0.7)
            }
            Pattern::Striped(count) => {
                let phase = (across * count).rem_euclid(1.0) - 0.5;
                edge(phase.abs() - 0.25 + 0.05 * f64::from(grain), 0.1 + 2.0 * pixel * count)
            }
            Pattern::Pitted(count) => {
                let row = (across * count).floor();
                let shift = if row.rem_euclid(2.0) < 1.0 { 0.0 } else { 0.5 };
                let cell = [(along * count + shift).rem_euclid(1.0) - 0.5, (across * count).rem_euclid(1.0) - 0.5];
                edge(0.27 - cell[0].hypot(1.2 * cell[1]) + 0.05 * f64::from(grain), 0.12 + 2.0 * pixel * count)
            }
            Pattern::Veined(count) => {
                let rib = edge(0.006 - across.abs(), 0.004 + 2.0 * pixel);
                let phase = ((along - 0.8 * across.abs()) * count).rem_euclid(1.0) - 0.5;
                let side = 0.8 * edge(0.07 - phase.abs(), 0.06 + 2.0 * pixel * count);
                rib.max(side).max(0.25 * (grain + 0.5).clamp(0.0, 1.0))
            }
            Pattern::Chequered(count) => {
                let square = |v: f64| (v * count).rem_euclid(1.0) - 0.5;
                let (a, b) = (square(along), square(across));
                let width = 2.0 * pixel * count;
                let side = |v: f64| edge(0.25 - v.abs(), width) * 2.0 - 1.0;
                0.5 + 0.5 * side(a) * side(b)
            }
        }
    }

    /// Diffuse light and highlight.
    fn light(&self, place: &Place, bend: [f32; 2]) -> (f32, f32) {
        const TOWARDS_LIGHT: [f32; 3] = [-0.45, -0.62, 0.642];
        let mut normal = [place.normal[0] as f32 - bend[0], place.normal[1] as f32 - bend[1]];
        let flat = normal[0].hypot(normal[1]);
        if flat > 0.97 {
            normal = [normal[0] * 0.97 / flat, normal[1] * 0.97 / flat];
        }
        let up = (1.0 - normal[0] * normal[0] - normal[1] * normal[1]).max(0.0).sqrt();
        let facing = TOWARDS_LIGHT[0] * normal[0] + TOWARDS_LIGHT[1] * normal[1] + TOWARDS_LIGHT[2] * up;
        let diffuse = 0.38 + 0.85 * facing.max(0.0);
        // half way between the light and the camera
        let half = [-0.248, -0.342, 0.906];
        let mirrored = (half[0] * normal[0] + half[1] * normal[1] + half[2] * up).max(0.0);
        (diffuse, mirrored.powi(40))
    }
}
