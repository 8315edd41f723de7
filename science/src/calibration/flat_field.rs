//! The flat field: brightness of the target's ground as a polynomial surface over the image, and the contrast image
//! derived from it.
//!
//! Without it, vignetting of 30 % shifts the centres of blurred dots by 0.2 to 0.5 px, because each dot is biased along
//! the brightness gradient; with it the shift is 0.03 px.

use super::statistics::{median, median_of, quantile, thinned};
use super::surface::{HIGHEST, LevelSample, Surface};
use super::working_image::sample;
use crate::imaging::Plane;

/// Polarity of the dots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Polarity {
    /// Dark dots on bright ground.
    DarkOnLight,
    /// Bright dots on dark ground.
    LightOnDark,
}

impl Polarity {
    /// The opposite polarity.
    pub(super) fn other(self) -> Self {
        match self {
            Self::DarkOnLight => Self::LightOnDark,
            Self::LightOnDark => Self::DarkOnLight,
        }
    }

    /// The likely polarity: dots cover less than half of a target, so the ground is the more frequent level.
    pub(super) fn guess(plane: &Plane<f32>) -> Self {
        let mut levels = thinned(plane);
        let (low, high) = (quantile(&mut levels, 0.02), quantile(&mut levels, 0.98));
        if median(&mut levels) >= (low + high) / 2.0 { Self::DarkOnLight } else { Self::LightOnDark }
    }
}

/// The flat field of one image.
#[derive(Debug, Clone)]
pub(super) struct FlatField {
    /// Level of the ground, 0..255.
    pub ground: Surface,
    /// Polarity of the dots.
    pub polarity: Polarity,
    /// For bright dots: grey levels that correspond to a contrast of 1.
    pub span: f64,
    width: usize,
    height: usize,
}

impl FlatField {
    /// The initial estimate, before any dot is measured: a surface of degree 2 through the mean of the brightest eighth
    /// (for bright dots the darkest eighth) of each cell. With `near`, approximate dot positions and a radius in px,
    /// only cells within that radius of a dot are used.
    pub(super) fn estimate(plane: &Plane<f32>, polarity: Polarity, near: Option<(&[[f64; 2]], f64)>) -> Self {
        let upper = polarity == Polarity::DarkOnLight;
        let cells = Cells::new(plane, 24);
        let wanted = near.map(|(places, reach)| cells.near(places, reach));
        let mut values = Vec::with_capacity(cells.side * cells.side);
        let levels = cells.levels(wanted.as_deref(), |left, top| {
            values.clear();
            for y in top..top + cells.side {
                values.extend_from_slice(&plane.row(y)[left..left + cells.side]);
            }
            let eighth = (values.len() / 8).max(1);
            let cut = if upper { values.len() - eighth } else { eighth - 1 };
            values.select_nth_unstable_by(cut, f32::total_cmp);
            let part = if upper { &values[cut..] } else { &values[..eighth] };
            Some(f64::from(part.iter().sum::<f32>()) / eighth as f64)
        });
        let ground = Surface::fit(&levels, 2, Some(upper));
        let mut all = match near {
            None => thinned(plane),
            Some((places, _)) => places.iter().filter_map(|p| sample(plane, *p)).map(f64::from).collect(),
        };
        // for bright dots: their level above the ground
        let low = near.map(|_| median_of(levels.iter().map(|l| l.value)));
        let span = (quantile(&mut all, 0.99) - low.unwrap_or_else(|| quantile(&mut all, 0.3))).max(1.0);
        Self { ground, polarity, span, width: plane.width, height: plane.height }
    }

    /// The refined estimate from measured dots. `dots` is their contrast (0 ground, about 1 dot); removing it leaves
    /// the ground everywhere, also between dots whose blur overlaps. Uses only samples within `reach` px of a place and
    /// not 0 in `valid`: beyond the target may be a table.
    pub(super) fn refine(
        &self,
        plane: &Plane<f32>,
        dots: &Plane<f32>,
        valid: &Plane<u8>,
        places: &[[f64; 2]],
        reach: f64,
        degree: usize,
    ) -> Self {
        let cells = Cells::new(plane, 48);
        let levels = cells.levels(Some(&cells.near(places, reach)), |left, top| {
            let (mut grey, mut contrast, mut count) = (0.0_f64, 0.0_f64, 0.0_f64);
            for y in top..top + cells.side {
                let row = left..left + cells.side;
                let samples = plane.row(y)[row.clone()].iter().zip(&dots.row(y)[row.clone()]).zip(&valid.row(y)[row]);
                for ((&g, &d), _) in samples.filter(|(_, valid)| **valid != 0) {
                    grey += f64::from(g);
                    contrast += f64::from(d);
                    count += 1.0;
                }
            }
            let bare = 1.0 - contrast / count;
            match self.polarity {
                _ if count < 1.0 => None,
                Polarity::DarkOnLight if bare > 0.6 => Some(grey / count / bare),
                Polarity::LightOnDark if bare > 0.6 => Some(grey / count - self.span * contrast / count),
                _ => None,
            }
        });
        if levels.len() < 12 {
            return self.clone();
        }
        Self { ground: Surface::fit(&levels, degree, None), ..self.clone() }
    }

    /// The contrast image: 0 on the ground, positive on dots of either polarity.
    pub(super) fn contrast(&self, plane: &Plane<f32>) -> Plane<f32> {
        let mut out = Plane { width: plane.width, height: plane.height, data: Vec::with_capacity(plane.data.len()) };
        for y in 0..plane.height {
            let [_, v] = normalised([0.0, y as f64], plane.width, plane.height);
            // f32 is exact to about 1e-4 of a grey level here
            let mut row = [0.0_f32; HIGHEST + 1];
            row.iter_mut().zip(self.ground.along_row(v)).for_each(|(to, from)| *to = from as f32);
            let (scale, per_span) = (2.0 / plane.width as f32, 1.0 / self.span as f32);
            let pixels = plane.row(y).iter().enumerate().map(|(x, &grey)| {
                let u = (x as f32 + 0.5) * scale - 1.0;
                (grey, row.iter().rev().fold(0.0, |sum, c| sum * u + c))
            });
            match self.polarity {
                Polarity::DarkOnLight => out.data.extend(pixels.map(|(grey, ground)| 1.0 - grey / ground.max(1.0))),
                Polarity::LightOnDark => out.data.extend(pixels.map(|(grey, ground)| (grey - ground) * per_span)),
            }
        }
        out
    }

    /// Level of the ground at a position of the plane that the field was estimated from.
    pub(super) fn ground_at(&self, p: [f64; 2]) -> f64 {
        let [u, v] = normalised(p, self.width, self.height);
        self.ground.at(u, v)
    }
}

/// Square cells of a plane, in each of which one level is measured. Incomplete ones at the right and bottom are left
/// out.
struct Cells {
    width: usize,
    height: usize,
    /// Px per cell.
    side: usize,
}

impl Cells {
    /// `count` cells along the longer side of the plane, of at least 4 px.
    fn new(plane: &Plane<f32>, count: usize) -> Self {
        let (width, height) = (plane.width, plane.height);
        Self { width, height, side: (width.max(height) / count).max(4) }
    }

    /// Row by row, which cells lie within `reach` px of a place.
    fn near(&self, places: &[[f64; 2]], reach: f64) -> Vec<bool> {
        let (columns, rows) = (self.width / self.side, self.height / self.side);
        let mut wanted = vec![false; columns * rows];
        let range = |v: f64, count: usize| {
            let low = ((v - reach) / self.side as f64).floor().max(0.0) as usize;
            let high = ((v + reach) / self.side as f64).floor().max(-1.0) + 1.0;
            low.min(count)..(high as usize).min(count).max(low.min(count))
        };
        for p in places {
            for row in range(p[1], rows) {
                wanted[row * columns..][range(p[0], columns)].fill(true);
            }
        }
        wanted
    }

    /// The level of each cell, or of the `wanted` ones, by its left and top px.
    fn levels(&self, wanted: Option<&[bool]>, mut level: impl FnMut(usize, usize) -> Option<f64>) -> Vec<LevelSample> {
        let (columns, rows) = (self.width / self.side, self.height / self.side);
        let mut levels = Vec::new();
        for k in (0..columns * rows).filter(|&k| wanted.is_none_or(|wanted| wanted[k])) {
            let (left, top) = (k % columns * self.side, k / columns * self.side);
            let Some(value) = level(left, top) else { continue };
            let centre = [left, top].map(|v| v as f64 + (self.side as f64 - 1.0) / 2.0);
            let [u, v] = normalised(centre, self.width, self.height);
            levels.push(LevelSample { u, v, value });
        }
        levels
    }
}

/// Pixel coordinates to -1..1.
fn normalised(p: [f64; 2], width: usize, height: usize) -> [f64; 2] {
    [(p[0] + 0.5) / width as f64 * 2.0 - 1.0, (p[1] + 0.5) / height as f64 * 2.0 - 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lit(x: usize, y: usize) -> f32 {
        let (u, v) = (x as f32 / 100.0 - 1.1, y as f32 / 80.0 - 0.9);
        220.0 * (1.0 - 0.15 * (u * u + v * v))
    }

    #[test]
    fn the_ground_is_found_under_dots_of_either_polarity() {
        let dot = |x: usize, y: usize| (x % 20 < 9) && (y % 20 < 9);
        let dark = Plane::from_fn(200, 160, |x, y| if dot(x, y) { 0.2 * lit(x, y) } else { lit(x, y) });
        assert_eq!(Polarity::guess(&dark), Polarity::DarkOnLight);
        let field = FlatField::estimate(&dark, Polarity::DarkOnLight, None);
        for (x, y) in [(5, 5), (100, 80), (195, 150)] {
            let truth = f64::from(lit(x, y));
            let found = field.ground_at([x as f64, y as f64]);
            assert!((found / truth - 1.0).abs() < 0.04, "{found} for {truth}");
        }
        let bright = dark.map(|v| 255.0 - v);
        assert_eq!(Polarity::guess(&bright), Polarity::LightOnDark);
        let contrast = FlatField::estimate(&bright, Polarity::LightOnDark, None).contrast(&bright);
        assert!(contrast.at(4, 4) > 0.5 && contrast.at(15, 15).abs() < 0.1);
    }
}
