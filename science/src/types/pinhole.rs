//! A pinhole camera in space: where points of the world appear in one view.

/// Intrinsics and pose of a view. The centre of the top-left pixel is (0, 0); lengths have the unit of the world.
#[derive(Debug, Clone, PartialEq)]
pub struct PinholeCamera {
    /// Rotation from world to camera, by rows; camera axes x right, y down, z forward.
    pub rotation: [[f64; 3]; 3],
    /// Centre of projection.
    pub centre: [f64; 3],
    /// Principal distance along x and y, px.
    pub focal_px: [f64; 2],
    /// Principal point, `[x, y]` px; also the centre of the distortion.
    pub principal_point_px: [f64; 2],
    /// Coefficients `k1`, `k2` of the radial distortion `(x, y) (1 + k1 r^2 + k2 r^4)` (OpenCV, COLMAP); 0 without.
    pub radial: [f64; 2],
    /// Width and height of the picture, px.
    pub size: [usize; 2],
}

impl PinholeCamera {
    /// Where a point appears, `[x, y]` px, and its distance from the centre of projection along the optical axis.
    /// `None` behind the camera.
    pub fn project(&self, point: [f64; 3]) -> Option<([f64; 2], f64)> {
        let from = [0, 1, 2].map(|axis| point[axis] - self.centre[axis]);
        let [x, y, depth] = self.rotation.map(|row| row[0] * from[0] + row[1] * from[1] + row[2] * from[2]);
        if depth <= 0.0 {
            return None;
        }
        let (x, y) = (x / depth, y / depth);
        let square = x * x + y * y;
        let stretch = 1.0 + square * (self.radial[0] + square * self.radial[1]);
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.principal_point_px);
        Some(([cx + fx * stretch * x, cy + fy * stretch * y], depth))
    }

    /// Direction in the world of what appears at a pixel, without the distortion; not of length 1.
    pub fn direction(&self, px: [f64; 2]) -> [f64; 3] {
        let [x, y] = [0, 1].map(|axis| (px[axis] - self.principal_point_px[axis]) / self.focal_px[axis]);
        [0, 1, 2].map(|axis| self.rotation[0][axis] * x + self.rotation[1][axis] * y + self.rotation[2][axis])
    }

    /// The camera of a picture that was reduced by a whole factor, and whose top-left pixel is then at `offset`.
    #[must_use]
    pub fn reduced(&self, factor: usize, offset: [usize; 2], size: [usize; 2]) -> Self {
        let scale = factor as f64;
        let moved = |axis: usize| (self.principal_point_px[axis] + 0.5) / scale - 0.5 - offset[axis] as f64;
        Self {
            focal_px: self.focal_px.map(|focal| focal / scale),
            principal_point_px: [0, 1].map(moved),
            size,
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::view::ViewAngles;

    fn camera() -> PinholeCamera {
        let angles = ViewAngles { pan_deg: 30.0, tilt_deg: 10.0 };
        PinholeCamera {
            rotation: angles.rotation(),
            centre: angles.direction().map(|c| 100.0 * c),
            focal_px: [2000.0, 2010.0],
            principal_point_px: [403.5, 295.0],
            radial: [0.0; 2],
            size: [800, 600],
        }
    }

    #[test]
    fn a_point_appears_on_its_ray_and_nothing_behind_the_camera() {
        let camera = camera();
        let (px, depth) = camera.project([0.0; 3]).expect("in front");
        assert!((px[0] - 403.5).abs() < 1e-9 && (px[1] - 295.0).abs() < 1e-9 && (depth - 100.0).abs() < 1e-9);
        let direction = camera.direction([120.0, 450.0]);
        let point = [0, 1, 2].map(|axis| camera.centre[axis] + 70.0 * direction[axis]);
        let (px, depth) = camera.project(point).expect("in front");
        assert!((px[0] - 120.0).abs() < 1e-9 && (px[1] - 450.0).abs() < 1e-9 && (depth - 70.0).abs() < 1e-9);
        assert_eq!(camera.project(camera.centre.map(|c| 2.0 * c)), None);
    }

    #[test]
    fn a_reduced_picture_shows_the_same_at_its_blocks() {
        let camera = PinholeCamera { radial: [0.1, 0.05], ..camera() };
        let reduced = camera.reduced(3, [10, 20], [200, 100]);
        let (px, _) = camera.project([1.0, -3.0, 2.0]).expect("in front");
        let (small, _) = reduced.project([1.0, -3.0, 2.0]).expect("in front");
        for axis in 0..2 {
            // the middle of a block of 3 px is the second of them
            assert!((3.0 * (small[axis] + [10.0, 20.0][axis]) + 1.0 - px[axis]).abs() < 1e-9);
        }
    }
}
