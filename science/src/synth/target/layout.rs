//! The ground truth of a target: positions, blur and brightness of its dots.

use nalgebra::Matrix3;

use super::DotTarget;
use crate::synth::rig::Rig;
use crate::synth::sensor::transmission;
use crate::types::Homography;

impl DotTarget {
    fn depth_fraction(&self, rig: &Rig) -> f64 {
        self.depth.unwrap_or_else(|| rig.focus_fraction(rig.reference))
    }

    /// Position of a dot, with its print error, in grid units: pitches, the first dot at (0, 0).
    pub(super) fn grid_position(&self, column: usize, row: usize) -> [f64; 2] {
        let shift = if self.asymmetric && row % 2 == 1 { 0.5 } else { 0.0 };
        let [across, down, _] = self.flaws.faults.print_error(self.flaws.seed, column, row);
        [column as f64 + shift + across, row as f64 * self.row_step() + down]
    }

    /// Distance of neighbouring rows in pitches.
    pub(super) fn row_step(&self) -> f64 {
        if self.asymmetric { 0.5 } else { 1.0 }
    }

    /// Middle of the grid in grid units.
    pub(super) fn middle(&self) -> [f64; 2] {
        let width = self.columns as f64 - 1.0 + if self.asymmetric { 0.5 } else { 0.0 };
        [width / 2.0, (self.rows as f64 - 1.0) * self.row_step() / 2.0]
    }

    /// Which dots were printed, row by row.
    pub(super) fn printed(&self) -> Vec<bool> {
        let mut printed = vec![true; self.columns * self.rows];
        for &dot in &self.missing {
            if let Some(there) = printed.get_mut(dot) {
                *there = false;
            }
        }
        printed
    }

    /// Coefficients `[fu, fv, d]`: a point (u, v) grid units from the middle of the grid is `d + fu u + fv v` mm from
    /// the centre of projection when the rail is at the reference.
    fn distances(&self, rig: &Rig) -> [f64; 3] {
        let [(sin_x, _), (sin_y, cos_y)] = self.tilt_deg.map(|angle| angle.to_radians().sin_cos());
        let (sin, cos) = self.rotation_deg.to_radians().sin_cos();
        let (across, down) = (-sin_y, sin_x * cos_y);
        let pitch = self.pitch_mm;
        [
            pitch * (across * cos + down * sin),
            pitch * (-across * sin + down * cos),
            rig.object_distance(self.depth_fraction(rig)),
        ]
    }

    /// Px of the reference slice -> grid units from the middle of the grid.
    pub(super) fn anchor(&self, rig: &Rig) -> Option<Homography> {
        Homography::from_matrix(&self.to_slice(rig, rig.reference))?.inverse()
    }

    /// Grid units from the middle of the grid -> px of slice `i`.
    pub(super) fn to_slice(&self, rig: &Rig, i: usize) -> Matrix3<f64> {
        let ideal = if self.tilt_deg == [0.0; 2] { self.parallel(rig, i) } else { self.tilted(rig, i) };
        let ideal = self.flaws.faults.moved(i).map_or(ideal, |moved| ideal * moved);
        rig.disturbance(i) * ideal
    }

    fn parallel(&self, rig: &Rig, i: usize) -> Matrix3<f64> {
        let fraction = self.depth_fraction(rig);
        let reference = rig.principal_distance(rig.reference);
        let scale = rig.scale(i, fraction) * reference / rig.object_distance(fraction) / rig.pixel_pitch_mm;
        let (sin, cos) = self.rotation_deg.to_radians().sin_cos();
        let step = scale * self.pitch_mm;
        let [cx, cy] = rig.centre();
        let middle = [cx + scale * self.offset_mm[0], cy + scale * self.offset_mm[1]];
        Matrix3::new(step * cos, -step * sin, middle[0], step * sin, step * cos, middle[1], 0.0, 0.0, 1.0)
    }

    /// The plate as the pinhole in the entrance pupil sees it: the chief rays go through there, so this
    /// is where the middles of all blurred spots lie.
    fn tilted(&self, rig: &Rig, i: usize) -> Matrix3<f64> {
        let [(sin_x, cos_x), (sin_y, cos_y)] = self.tilt_deg.map(|angle| angle.to_radians().sin_cos());
        let (sin, cos) = self.rotation_deg.to_radians().sin_cos();
        let pitch = self.pitch_mm;
        // plate coordinates (x, y) of u and v, turned about the x axis, then about the y axis
        let turned = |x: f64, y: f64| [pitch * (x * cos_y + y * sin_x * sin_y), pitch * y * cos_x];
        let (u, v) = (turned(cos, sin), turned(-sin, cos));
        let [far_u, far_v, middle] = self.distances(rig);
        let far = [far_u, far_v, rig.distance_in(i, middle)];
        let scale = rig.principal_distance(i) / rig.pixel_pitch_mm;
        let [cx, cy] = rig.centre();
        let row = |axis: usize, about: f64| {
            let point = [u[axis], v[axis], self.offset_mm[axis]];
            [0, 1, 2].map(|k| scale * point[k] + about * far[k])
        };
        let (x, y) = (row(0, cx), row(1, cy));
        Matrix3::new(x[0], x[1], x[2], y[0], y[1], y[2], far[0], far[1], far[2])
    }

    /// The true centres of all dots in px of slice `i`, row by row: dot `row * columns + column`, the same
    /// dot at the same index in every slice. Dots outside the picture and missing ones are listed too.
    pub fn dots(&self, rig: &Rig, i: usize) -> Vec<[f64; 2]> {
        let Some(map) = Homography::from_matrix(&self.to_slice(rig, i)) else {
            return Vec::new();
        };
        let middle = self.middle();
        (0..self.rows)
            .flat_map(|row| (0..self.columns).map(move |column| self.grid_position(column, row)))
            .map(|place| map.apply([place[0] - middle[0], place[1] - middle[1]]))
            .map(|ideal| self.flaws.faults.distort(rig, ideal))
            .collect()
    }

    /// Index of the slice in which the middle of the target is in focus, with a fraction between two slices.
    pub(super) fn slice_in_focus(&self, rig: &Rig) -> f64 {
        rig.slice_in_focus(self.depth_fraction(rig))
    }

    /// Pitch at the middle of the grid in slice `i`, px; NaN if it cannot be computed.
    pub fn pitch_px(&self, rig: &Rig, i: usize) -> f64 {
        Homography::from_matrix(&self.to_slice(rig, i)).map_or(f64::NAN, |map| map.scale_at([0.0, 0.0]))
    }

    /// Radius in px of the circle of confusion of the middle of the target in slice `i`.
    pub fn blur_radius_px(&self, rig: &Rig, i: usize) -> f64 {
        rig.blur_radius_px(i, self.depth_fraction(rig))
    }

    /// The same at a point in grid units from the middle of the grid.
    pub(super) fn blur_at(&self, rig: &Rig, i: usize, place: [f64; 2]) -> f64 {
        let [far_u, far_v, middle] = self.distances(rig);
        rig.blur_radius_of(i, middle + far_u * place[0] + far_v * place[1])
    }

    /// What slice `i` stores at `px` for the bright one of plate and dots, 0..1 of full scale, without blur,
    /// dust, glare, stripes, uneven light on the plate and noise. The ratio of two slices is the gain between them at this
    /// position.
    pub fn stored_white(&self, rig: &Rig, i: usize, px: [f64; 2]) -> f64 {
        let exposure = rig.exposure(i) * self.flaws.faults.grey_exposure(i);
        let light = self.white.max(self.black) * exposure * transmission(rig, px);
        f64::from(self.flaws.response(light as f32)).min(1.0)
    }
}
