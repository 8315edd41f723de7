//! AliceVision's SfMData as JSON, which Meshroom writes as `cameras.sfm`.
//!
//! `poses[].pose.transform` has the centre, and the rotation by columns: read by rows, it leads from camera to world. A
//! view has the pose whose `poseId` is its own; the ids of views may differ from those of poses.

use std::collections::HashMap;

use serde::Deserialize;

use super::{
    found::Found,
    json::{Id, Number, bounded, parse, rows, transposed},
};
use crate::{photogrammetry::poses::Pose, types::Error};

#[derive(Deserialize)]
struct SfmData {
    #[serde(deserialize_with = "bounded")]
    views: Vec<View>,
    #[serde(default, deserialize_with = "bounded")]
    poses: Vec<PoseOfId>,
}

#[derive(Deserialize)]
struct View {
    #[serde(rename = "viewId")]
    view_id: Id,
    #[serde(rename = "poseId")]
    pose_id: Option<Id>,
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
    let SfmData { views, poses } = parse(text, "cameras.sfm of AliceVision")?;
    let poses: HashMap<Id, Transform> = poses.into_iter().map(|of| (of.pose_id, of.pose.transform)).collect();
    for View { view_id, pose_id, path } in views {
        let place = || format!("view {}", view_id.0);
        let name = if path.is_empty() { view_id.0.clone() } else { path };
        match poses.get(pose_id.as_ref().unwrap_or(&view_id)) {
            Some(Transform { rotation, center }) => {
                let rotation = Some(transposed(rows(*rotation)));
                let centre = center.map(|number| number.0);
                found.pose(Pose { name, centre, rotation, commanded_deg: None }, place)?;
            }
            None => found.unregistered(name, place)?,
        }
    }
    Ok(())
}
