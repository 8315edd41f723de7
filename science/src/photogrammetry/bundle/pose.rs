//! The poses that pan and tilt place the cameras at.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::types::BundleScan;
use crate::types::view::ViewAngles;

/// Views that each view is matched with.
const NEIGHBOURS: usize = 12;

/// Cosine of phi below which omega and kappa turn about the same axis.
const LEVEL: f64 = 1e-9;

/// A pose in the coordinates of [`crate::types::view`].
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pose {
    /// World to camera; camera axes x right, y down, z forward.
    pub rotation: Matrix3<f64>,
    /// Centre of projection.
    pub centre: Vector3<f64>,
}

impl Pose {
    /// `t = -R C`.
    pub(super) fn translation(&self) -> Vector3<f64> {
        -(self.rotation * self.centre)
    }

    /// World to camera as (w, x, y, z).
    pub(super) fn quaternion(&self) -> [f64; 4] {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation);
        let q = UnitQuaternion::from_rotation_matrix(&rotation);
        [q.w, q.i, q.j, q.k]
    }

    /// Camera to world, with camera axes x right, y up, z backward (OpenGL, photogrammetry).
    pub(super) fn upright(&self) -> Matrix3<f64> {
        let [right, down, forward] = [0, 1, 2].map(|row| self.rotation.row(row).transpose());
        Matrix3::from_columns(&[right, -down, -forward])
    }

    /// Omega, phi and kappa in degrees: [`Self::upright`] is `Rx(omega) Ry(phi) Rz(kappa)`.
    pub(super) fn omega_phi_kappa(&self) -> [f64; 3] {
        let m = self.upright();
        let phi = m[(0, 2)].clamp(-1.0, 1.0).asin();
        let (omega, kappa) = if m[(1, 2)].hypot(m[(2, 2)]) > LEVEL {
            ((-m[(1, 2)]).atan2(m[(2, 2)]), (-m[(0, 1)]).atan2(m[(0, 0)]))
        } else {
            // the axes of omega and kappa coincide: only their sum or difference is known
            (0.0, m[(1, 0)].atan2(m[(1, 1)]))
        };
        [omega, phi, kappa].map(f64::to_degrees)
    }
}

/// The poses of all views; `None` unless every view has pan and tilt. Without a radius it is 1.
pub(super) fn of(scan: &BundleScan) -> Option<Vec<Pose>> {
    let radius = scan.radius_mm.unwrap_or(1.0);
    let pose = |angles: ViewAngles| {
        let angles = camera_angles(scan, angles);
        let rows = angles.rotation().map(nalgebra::RowVector3::from);
        Pose { rotation: Matrix3::from_rows(&rows), centre: radius * Vector3::from(angles.direction()) }
    };
    scan.views.iter().map(|view| view.angles.map(pose)).collect()
}

/// Pan and tilt of the camera in the convention of the world.
fn camera_angles(scan: &BundleScan, angles: ViewAngles) -> ViewAngles {
    let pan_deg = if scan.pan_is_clockwise { -angles.pan_deg } else { angles.pan_deg };
    ViewAngles { pan_deg, ..angles }
}

/// The pairs of views that see much of the same: each with its nearest in angle. Sorted, without repetition.
pub(super) fn pairs(poses: &[Pose]) -> Vec<(usize, usize)> {
    let mut pairs = Vec::new();
    for (at, pose) in poses.iter().enumerate() {
        let mut others: Vec<(f64, usize)> = poses
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != at)
            .map(|(other, of_other)| (-pose.centre.dot(&of_other.centre), other))
            .collect();
        if others.len() > NEIGHBOURS {
            others.select_nth_unstable_by(NEIGHBOURS, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        }
        pairs.extend(others.into_iter().take(NEIGHBOURS).map(|(_, other)| (at.min(other), at.max(other))));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
