//! The dot target, rendered from its formula.

use super::rig::Rig;
use super::sensor::expose;
use crate::imaging::Raster;
use crate::model::Homography;
use nalgebra::Matrix3;

/// A flat plate with a grid of round dots, parallel to the sensor.
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
    /// Light of the plate, 0..1 of full scale.
    pub white: f64,
    /// Light of the dots, 0..1 of full scale.
    pub black: f64,
    /// Bright dots on a dark plate.
    pub invert: bool,
    /// Where the plate stands, as a depth fraction of the rig; `None`: in focus in the reference slice.
    /// It stays there in all slices.
    pub depth: Option<f64>,
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
        }
    }

    fn depth_fraction(&self, rig: &Rig) -> f64 {
        self.depth.unwrap_or_else(|| rig.focus_fraction(rig.reference))
    }

    /// Grid units (column, row; the middle of the grid is (0, 0)) -> px of slice `i`.
    fn to_slice(&self, rig: &Rig, i: usize) -> Matrix3<f64> {
        let fraction = self.depth_fraction(rig);
        let reference_d2 = rig.sensor_distance(rig.reference);
        let scale = rig.scale(i, fraction) * reference_d2 / rig.object_distance(fraction) / rig.pixel_pitch_mm;
        let (sin, cos) = self.rotation_deg.to_radians().sin_cos();
        let step = scale * self.pitch_mm;
        let [cx, cy] = rig.centre();
        let middle = [cx + scale * self.offset_mm[0], cy + scale * self.offset_mm[1]];
        let ideal = Matrix3::new(step * cos, -step * sin, middle[0], step * sin, step * cos, middle[1], 0.0, 0.0, 1.0);
        rig.disturbance(i) * ideal
    }

    /// The true centres of all dots in px of slice `i`, row by row: dot `row * columns + column`, the same
    /// dot at the same place of the list in every slice. Dots outside the picture are listed too.
    pub fn dots(&self, rig: &Rig, i: usize) -> Vec<[f64; 2]> {
        let Some(map) = Homography::from_matrix(&self.to_slice(rig, i)) else {
            return Vec::new();
        };
        let middle = [(self.columns as f64 - 1.0) / 2.0, (self.rows as f64 - 1.0) / 2.0];
        (0..self.rows)
            .flat_map(|row| (0..self.columns).map(move |column| [column as f64 - middle[0], row as f64 - middle[1]]))
            .map(|place| map.apply(place))
            .collect()
    }

    /// Distance of neighbouring dots in the middle of slice `i`, px.
    pub fn pitch_px(&self, rig: &Rig, i: usize) -> f64 {
        Homography::from_matrix(&self.to_slice(rig, i)).map_or(f64::NAN, |map| map.scale_at([0.0, 0.0]))
    }

    /// Radius in px of the circle of confusion of the target in slice `i`.
    pub fn blur_radius_px(&self, rig: &Rig, i: usize) -> f64 {
        rig.blur_radius_px(i, self.depth_fraction(rig))
    }
}

/// Slice `i` of a stack of the target: every pixel is the share of its circle of confusion that lies on
/// dots (overlap of two circles), with the rig's drift, exposure, vignetting and noise.
///
/// The square of the pixel is taken as a disc of the same second moment; everything is symmetric about the
/// dot's centre, so no position is biased by sampling.
pub fn render_target(rig: &Rig, target: &DotTarget, i: usize) -> Raster {
    let map = target.to_slice(rig, i);
    let Some(back) = Homography::from_matrix(&map).and_then(|map| map.inverse()) else {
        return expose(rig, i, 0xd075, |_, _| {});
    };
    const PIXEL_MOMENT: f64 = 1.0 / 3.0;
    let blur_px = (target.blur_radius_px(rig, i).powi(2) + PIXEL_MOMENT).sqrt();
    let middle = [(target.columns as f64 - 1.0) / 2.0, (target.rows as f64 - 1.0) / 2.0];
    let dot = target.dot_diameter_mm / target.pitch_mm / 2.0;
    let (plate, mark) = if target.invert { (target.black, target.white) } else { (target.white, target.black) };
    let near = |at: f64, reach: f64, count: usize| {
        let first = (at - reach).ceil().max(0.0) as usize;
        let end = ((at + reach).floor() + 1.0).clamp(0.0, count as f64) as usize;
        first..end.max(first)
    };
    expose(rig, i, 0xd075, |y, row| {
        for (x, light) in row.iter_mut().enumerate() {
            let [u, v] = back.apply([x as f64, y as f64]);
            let blur = blur_px * back.scale_at([x as f64, y as f64]);
            let (column, line) = (u + middle[0], v + middle[1]);
            let reach = dot + blur;
            let mut covered = 0.0;
            for c in near(column, reach, target.columns) {
                for r in near(line, reach, target.rows) {
                    let distance = (column - c as f64).hypot(line - r as f64);
                    covered += overlap(dot, blur, distance) / (std::f64::consts::PI * blur * blur);
                }
            }
            *light = [(plate + (mark - plate) * covered) as f32; 3];
        }
    })
}

/// Area shared by two circles of radii `a` and `b` whose centres are `distance` apart.
fn overlap(a: f64, b: f64, distance: f64) -> f64 {
    if distance >= a + b {
        return 0.0;
    }
    if distance <= (a - b).abs() {
        return std::f64::consts::PI * a.min(b).powi(2);
    }
    let angle = |own: f64, other: f64| {
        ((distance * distance + own * own - other * other) / (2.0 * distance * own)).clamp(-1.0, 1.0).acos()
    };
    let (alpha, beta) = (angle(a, b), angle(b, a));
    let segment = |radius: f64, half: f64| radius * radius * (half - half.sin() * half.cos());
    segment(a, alpha) + segment(b, beta)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Rig {
        Rig { noise: 0.0, vignetting: 0.0, ..Rig::sized(480, 360, 7) }
    }

    /// Centre of gravity of the darkness within half a pitch of `about`.
    fn centroid(luma: &crate::imaging::Plane<f32>, about: [f64; 2], reach: f64) -> [f64; 2] {
        let (mut sum, mut at) = (0.0, [0.0; 2]);
        let white = luma.data.iter().copied().fold(0.0, f32::max);
        for y in (about[1] - reach).ceil() as usize..=(about[1] + reach).floor() as usize {
            for x in (about[0] - reach).ceil() as usize..=(about[0] + reach).floor() as usize {
                let dark = f64::from(white - luma.at(x, y));
                sum += dark;
                at = [at[0] + dark * x as f64, at[1] + dark * y as f64];
            }
        }
        [at[0] / sum, at[1] / sum]
    }

    #[test]
    fn dots_are_drawn_where_the_truth_says_sharp_and_blurred() {
        let rig = rig();
        let target = DotTarget::for_rig(&rig, 12);
        for i in [0, 3, 6] {
            let luma = render_target(&rig, &target, i).luma();
            let reach = 0.48 * target.pitch_px(&rig, i);
            for dot in target.dots(&rig, i) {
                let found = centroid(&luma, dot, reach);
                let error = (found[0] - dot[0]).hypot(found[1] - dot[1]);
                assert!(error < 0.06, "slice {i}: {dot:?} found at {found:?}");
            }
        }
    }

    #[test]
    fn the_true_homography_sends_each_dot_to_its_place_in_the_reference() {
        for rig in [rig(), rig().moving_lens()] {
            let target = DotTarget::for_rig(&rig, 12);
            let reference = target.dots(&rig, rig.reference);
            assert_eq!(reference.len(), target.columns * target.rows);
            for i in 0..rig.slices() {
                for (dot, expected) in target.dots(&rig, i).into_iter().zip(&reference) {
                    let mapped = rig.homography(i).apply(dot);
                    assert!((mapped[0] - expected[0]).hypot(mapped[1] - expected[1]) < 1e-9);
                }
            }
        }
    }

    #[test]
    fn the_plate_is_bright_the_dots_are_dark_and_the_other_way_round_when_inverted() {
        let rig = rig();
        for invert in [false, true] {
            let target = DotTarget { invert, ..DotTarget::for_rig(&rig, 12) };
            let luma = render_target(&rig, &target, rig.reference).luma();
            let dots = target.dots(&rig, rig.reference);
            let on = luma.at(dots[0][0].round() as usize, dots[0][1].round() as usize);
            let off = luma.at(
                ((dots[0][0] + dots[1 + target.columns][0]) / 2.0).round() as usize,
                ((dots[0][1] + dots[1 + target.columns][1]) / 2.0).round() as usize,
            );
            let (bright, dark) = if invert { (on, off) } else { (off, on) };
            assert!((bright - 0.85 * 255.0).abs() < 1.0, "{bright}");
            assert!((dark - 0.06 * 255.0).abs() < 1.0, "{dark}");
        }
    }

    #[test]
    fn white_follows_the_exposure_so_the_gain_takes_it_back() {
        let rig = rig();
        let target = DotTarget::for_rig(&rig, 12);
        let white = |i| render_target(&rig, &target, i).luma().data.into_iter().fold(0.0, f32::max);
        let ratio = f64::from(white(6)) * rig.gain(6) / f64::from(white(3));
        assert!((ratio - 1.0).abs() < 0.005, "{ratio}");
    }

    #[test]
    fn a_blurred_dot_keeps_its_amount_of_darkness() {
        let area = |b: f64| {
            let step = 0.01;
            let grid = -300..300;
            let at = |k: i32| f64::from(k) * step;
            let shares = grid.clone().flat_map(|i| grid.clone().map(move |j| overlap(0.5, b, at(i).hypot(at(j)))));
            shares.sum::<f64>() * step * step / (std::f64::consts::PI * b * b)
        };
        for blur in [0.2, 0.5, 1.3] {
            assert!((area(blur) - std::f64::consts::PI * 0.25).abs() < 1e-3, "blur {blur}");
        }
    }
}
