//! The flat field: brightness of the target's ground as a polynomial surface over the image, and the contrast image
//! derived from it.
//!
//! Without it, vignetting of 30 % shifts the centres of blurred dots by 0.2 to 0.5 px, because each dot is biased along
//! the brightness gradient; with it the shift is 0.03 px.

use nalgebra::{DMatrix, DVector};

use super::statistics::{median, quantile};
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

/// Evenly spread samples of a plane: 33,000 to 100,000, or all of a smaller one.
fn thinned(plane: &Plane<f32>) -> Vec<f64> {
    let stride = (plane.data.len() / 50_000).max(1) | 1;
    plane.data.iter().step_by(stride).map(|&v| f64::from(v)).collect()
}

/// A polynomial surface over the image, in coordinates (u, v) from -1 to 1 along each axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Surface {
    degree: usize,
    coefficients: Vec<f64>,
}

/// A sample for the fit of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct LevelSample {
    /// Horizontal coordinate, -1..1.
    pub u: f64,
    /// Vertical coordinate, -1..1.
    pub v: f64,
    /// Level at (u, v), 0..255.
    pub value: f64,
}

/// Highest degree of a surface.
const HIGHEST: usize = 4;

/// Exponents of u and v with a sum of at most `degree`.
fn terms(degree: usize) -> impl Iterator<Item = (i32, i32)> {
    (0..=degree as i32).flat_map(move |j| (0..=degree as i32 - j).map(move |i| (i, j)))
}

impl Surface {
    /// Robust least squares with Tukey's biweight. With `upper` (true: the ground is the upper envelope, false: the
    /// lower), values on the dots' side of the surface get less weight in the first rounds. Falls back to lower degrees
    /// when there are too few values.
    pub(super) fn fit(levels: &[LevelSample], degree: usize, upper: Option<bool>) -> Self {
        let count = terms(degree).count();
        let degree = degree.min(HIGHEST);
        let fitted = (levels.len() >= 3 * count).then(|| Self::try_fit(levels, degree, upper)).flatten();
        match fitted {
            Some(surface) => surface,
            None if degree > 0 => Self::fit(levels, degree - 1, upper),
            None => {
                let mut values: Vec<f64> = levels.iter().map(|l| l.value).collect();
                Self { degree: 0, coefficients: vec![median(&mut values)] }
            }
        }
    }

    fn try_fit(levels: &[LevelSample], degree: usize, upper: Option<bool>) -> Option<Self> {
        let powers: Vec<(i32, i32)> = terms(degree).collect();
        let size = powers.len();
        let rows: Vec<f64> =
            levels.iter().flat_map(|l| powers.iter().map(|&(i, j)| l.u.powi(i) * l.v.powi(j))).collect();
        let mut weights = vec![1.0; levels.len()];
        let mut surface: Option<Self> = None;
        for round in 0..10 {
            let mut sums = vec![0.0; size * size];
            let mut right = DVector::zeros(size);
            for ((row, level), &weight) in rows.chunks_exact(size).zip(levels).zip(&weights) {
                if weight == 0.0 {
                    continue;
                }
                for (a, sums) in sums.chunks_exact_mut(size).enumerate() {
                    let weighted = weight * row[a];
                    right[a] += weighted * level.value;
                    sums.iter_mut().zip(&row[..=a]).for_each(|(sum, other)| *sum += weighted * other);
                }
            }
            // only the lower triangle of the sums is filled and read
            let mut normal = DMatrix::from_row_slice(size, size, &sums);
            let ridge = 1e-9 * normal.trace();
            for a in 0..size {
                normal[(a, a)] += ridge;
            }
            let solved = Self { degree, coefficients: normal.cholesky()?.solve(&right).iter().copied().collect() };
            let level_of = |row: &[f64]| row.iter().zip(&solved.coefficients).map(|(r, c)| r * c).sum::<f64>();
            let residuals: Vec<f64> =
                rows.chunks_exact(size).zip(levels).map(|(row, l)| l.value - level_of(row)).collect();
            let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
            let spread = (1.4826 * median(&mut sizes)).max(1e-3);
            for (weight, residual) in weights.iter_mut().zip(&residuals) {
                let t = residual / (4.685 * spread);
                *weight = if t.abs() < 1.0 { (1.0 - t * t).powi(2) } else { 0.0 };
                let doubted = match upper {
                    Some(true) => *residual < -0.5 * spread,
                    Some(false) => *residual > 0.5 * spread,
                    None => false,
                };
                if doubted && round < 5 {
                    *weight *= 0.1;
                }
            }
            // changes below a hundredth of a grey level do not move a dot
            let settled = round >= 5 - 4 * usize::from(upper.is_none())
                && surface.as_ref().is_some_and(|before| before.nearly(&solved));
            surface = Some(solved);
            if settled {
                break;
            }
        }
        surface.filter(|s| s.coefficients.iter().all(|c| c.is_finite()))
    }

    /// True when the coefficients differ by less than a hundredth of a grey level.
    fn nearly(&self, other: &Self) -> bool {
        self.coefficients.iter().zip(&other.coefficients).all(|(a, b)| (a - b).abs() < 0.01)
    }

    /// The level at (u, v).
    pub(super) fn at(&self, u: f64, v: f64) -> f64 {
        terms(self.degree).zip(&self.coefficients).map(|((i, j), c)| c * u.powi(i) * v.powi(j)).sum()
    }

    /// Coefficients of the polynomial in u along row `v`.
    fn along_row(&self, v: f64) -> Vec<f64> {
        let mut row = vec![0.0; self.degree + 1];
        for ((i, j), c) in terms(self.degree).zip(&self.coefficients) {
            row[i as usize] += c * v.powi(j);
        }
        row
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
        let cell = (plane.width.max(plane.height) / 24).max(4);
        let columns = plane.width / cell;
        let wanted = near.map(|(places, reach)| cells_near(plane, cell, places, reach));
        let mut levels = Vec::new();
        let mut values = Vec::with_capacity(cell * cell);
        for top in (0..plane.height.saturating_sub(cell - 1)).step_by(cell) {
            for left in (0..plane.width.saturating_sub(cell - 1)).step_by(cell) {
                if wanted.as_ref().is_some_and(|w| !w[top / cell * columns + left / cell]) {
                    continue;
                }
                values.clear();
                for y in top..top + cell {
                    values.extend_from_slice(&plane.row(y)[left..left + cell]);
                }
                let eighth = (values.len() / 8).max(1);
                let cut = if upper { values.len() - eighth } else { eighth - 1 };
                values.select_nth_unstable_by(cut, f32::total_cmp);
                let part = if upper { &mut values[cut..] } else { &mut values[..eighth] };
                let centre = [left as f64 + (cell as f64 - 1.0) / 2.0, top as f64 + (cell as f64 - 1.0) / 2.0];
                let [u, v] = normalised(centre, plane.width, plane.height);
                levels.push(LevelSample { u, v, value: f64::from(part.iter().sum::<f32>()) / eighth as f64 });
            }
        }
        let ground = Surface::fit(&levels, 2, Some(upper));
        let mut all = match near {
            None => thinned(plane),
            Some((places, _)) => places.iter().filter_map(|p| sample(plane, *p)).map(f64::from).collect(),
        };
        // for bright dots: their level above the ground
        let low = near.map(|_| median(&mut levels.iter().map(|l| l.value).collect::<Vec<_>>()));
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
        let cell = (plane.width.max(plane.height) / 48).max(4);
        let columns = plane.width / cell;
        let wanted = cells_near(plane, cell, places, reach);
        let mut levels = Vec::new();
        for top in (0..plane.height.saturating_sub(cell - 1)).step_by(cell) {
            for left in (0..plane.width.saturating_sub(cell - 1)).step_by(cell) {
                if !wanted[top / cell * columns + left / cell] {
                    continue;
                }
                let (mut grey, mut contrast, mut count) = (0.0_f64, 0.0_f64, 0.0_f64);
                for y in top..top + cell {
                    let row = left..left + cell;
                    let samples =
                        plane.row(y)[row.clone()].iter().zip(&dots.row(y)[row.clone()]).zip(&valid.row(y)[row]);
                    for ((&g, &d), _) in samples.filter(|(_, valid)| **valid != 0) {
                        grey += f64::from(g);
                        contrast += f64::from(d);
                        count += 1.0;
                    }
                }
                if count < 1.0 {
                    continue;
                }
                let bare = 1.0 - contrast / count;
                let value = match self.polarity {
                    Polarity::DarkOnLight if bare > 0.6 => grey / count / bare,
                    Polarity::LightOnDark if bare > 0.6 => grey / count - self.span * contrast / count,
                    _ => continue,
                };
                let centre = [left as f64 + (cell as f64 - 1.0) / 2.0, top as f64 + (cell as f64 - 1.0) / 2.0];
                let [u, v] = normalised(centre, plane.width, plane.height);
                levels.push(LevelSample { u, v, value });
            }
        }
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

/// Row by row, which cells of `cell` px lie within `reach` px of a place.
fn cells_near(plane: &Plane<f32>, cell: usize, places: &[[f64; 2]], reach: f64) -> Vec<bool> {
    let (columns, rows) = (plane.width / cell, plane.height / cell);
    let mut wanted = vec![false; columns * rows];
    let range = |v: f64, count: usize| {
        let low = ((v - reach) / cell as f64).floor().max(0.0) as usize;
        let high = ((v + reach) / cell as f64).floor().max(-1.0) + 1.0;
        low.min(count)..(high as usize).min(count).max(low.min(count))
    };
    for p in places {
        for row in range(p[1], rows) {
            wanted[row * columns..][range(p[0], columns)].fill(true);
        }
    }
    wanted
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

    #[test]
    fn a_surface_follows_a_polynomial_through_gross_errors() {
        let truth = |u: f64, v: f64| 200.0 - 20.0 * u + 5.0 * v - 30.0 * u * u + 10.0 * u * v - 12.0 * v * v;
        let levels: Vec<LevelSample> = (0..400)
            .map(|k| {
                let (u, v) = (f64::from(k % 20) / 10.0 - 0.95, f64::from(k / 20) / 10.0 - 0.95);
                let gross = if k % 7 == 0 { -90.0 } else { 0.0 };
                LevelSample { u, v, value: truth(u, v) + gross }
            })
            .collect();
        let surface = Surface::fit(&levels, 2, None);
        assert!((surface.at(0.3, -0.4) - truth(0.3, -0.4)).abs() < 0.01);
    }

    #[test]
    fn too_few_levels_give_a_flat_surface() {
        let surface = Surface::fit(&[LevelSample { u: 0.0, v: 0.0, value: 9.0 }], 4, None);
        assert_eq!(surface.at(0.7, 0.7), 9.0);
    }
}
