//! The axis of the turntable: which end is up, and what the optical axes say of its steps.

use nalgebra::Vector3;

use crate::photogrammetry::poses::{
    Pose,
    turntable::{Direction, Turntable, measure},
};

/// The axis, upwards, and whether pan grows clockwise around it. From centres in one plane alone, a table that turns
/// one way cannot be told from one that turns the other way upside down: then the cameras tell, whose images are
/// upright. `None` without rotations.
pub(super) fn sense(turntable: &Turntable, poses: &[&Pose], tells_up: bool) -> Option<([f64; 3], bool)> {
    let Turntable { axis, is_clockwise, .. } = *turntable;
    if tells_up {
        return Some((axis, is_clockwise));
    }
    let downs = poses.iter().filter_map(|pose| pose.rotation).map(|[_, down, _]| Vector3::from(down));
    let along = downs.sum::<Vector3<f64>>().dot(&Vector3::from(axis));
    if along > 0.0 {
        return Some((axis.map(|value| -value), !is_clockwise));
    }
    (along < 0.0).then_some((axis, is_clockwise))
}

/// Steps from the optical axes: a camera on a turntable looks at its centre.
pub(super) fn of_axes(poses: &[&Pose], commanded: &[Option<[f64; 2]>]) -> Option<Turntable> {
    let directions: Vec<Direction> = poses
        .iter()
        .zip(commanded)
        .filter_map(|(pose, angles)| {
            let [_, _, forward] = pose.rotation?;
            Some(Direction { vector: forward.map(|value| -value), commanded_deg: (*angles)? })
        })
        .collect();
    measure(&directions)
}
