//! AliceVision's SfMData as JSON, which Meshroom writes as `cameras.sfm`.
//!
//! `poses[].pose.transform` has the centre, and the rotation by columns: read by rows, it leads from camera to world. A
//! view has the pose whose `poseId` is its own; the ids of views may differ from those of poses. The focal length is in
//! mm, beside the width of the sensor; older versions have it in px.

use std::collections::HashMap;

use serde::Deserialize;

use super::{
    found::Found,
    json::{Id, Number, bounded, mean, parse, rows, transposed},
};
use crate::{photogrammetry::poses::Pose, types::Error};

#[derive(Deserialize)]
struct SfmData {
    #[serde(deserialize_with = "bounded")]
    views: Vec<View>,
    #[serde(default, deserialize_with = "bounded")]
    intrinsics: Vec<Intrinsic>,
    #[serde(default, deserialize_with = "bounded")]
    poses: Vec<PoseOfId>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Intrinsic {
    intrinsic_id: Id,
    width: Option<Number>,
    sensor_width: Option<Number>,
    focal_length: Option<Number>,
    #[serde(default, deserialize_with = "mean")]
    px_focal_length: Option<Number>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    view_id: Id,
    pose_id: Option<Id>,
    intrinsic_id: Option<Id>,
    #[serde(default)]
    path: String,
}

#[derive(Deserialize)]
struct PoseOfId {
    #[serde(rename = "poseId")]
    pose_id: Id,
    pose: Transformed,
}

#[derive(Deserialize)]
struct Transformed {
    transform: Transform,
}

#[derive(Deserialize)]
struct Transform {
    rotation: [Number; 9],
    center: [Number; 3],
}

pub(super) fn read(text: &str, found: &mut Found) -> Result<(), Error> {
    let SfmData { views, intrinsics, poses } = parse(text, "cameras.sfm of AliceVision")?;
    for Intrinsic { intrinsic_id, width, sensor_width, focal_length, px_focal_length } in intrinsics {
        let of_mm = focal_length.zip(width).zip(sensor_width).map(|((mm, px), sensor)| mm.0 / sensor.0 * px.0);
        found.camera(intrinsic_id.0, of_mm.or(px_focal_length.map(|px| px.0)).unwrap_or_default());
    }
    let poses: HashMap<Id, Transform> = poses.into_iter().map(|of| (of.pose_id, of.pose.transform)).collect();
    for View { view_id, pose_id, intrinsic_id, path } in views {
        let camera = intrinsic_id.map_or_else(String::new, |id| id.0);
        let place = || format!("view {}", view_id.0);
        let name = if path.is_empty() { view_id.0.clone() } else { path };
        match poses.get(pose_id.as_ref().unwrap_or(&view_id)) {
            Some(Transform { rotation, center }) => {
                let rotation = Some(transposed(rows(*rotation)));
                let centre = center.map(|number| number.0);
                found.pose(Pose { name, centre, rotation, commanded_deg: None }, &camera, place)?;
            }
            None => found.unregistered(name, place)?,
        }
    }
    Ok(())
}
