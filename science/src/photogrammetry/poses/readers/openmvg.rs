//! OpenMVG `sfm_data.json`: a view has the extrinsics whose `key` is its `id_pose`, and the intrinsics whose `key` is
//! its `id_intrinsic`.

use std::collections::HashMap;

use serde::Deserialize;

use super::{
    found::Found,
    json::{Id, Number, bounded, mean, parse},
};
use crate::{photogrammetry::poses::Pose, types::Error};

#[derive(Deserialize)]
struct SfmData {
    #[serde(deserialize_with = "bounded")]
    views: Vec<View>,
    #[serde(default, deserialize_with = "bounded")]
    intrinsics: Vec<Entry<Wrapped<Camera>>>,
    #[serde(default, deserialize_with = "bounded")]
    extrinsics: Vec<Entry<Placed>>,
}

#[derive(Deserialize)]
struct View {
    value: Wrapped<ViewData>,
}

#[derive(Deserialize)]
struct Entry<T> {
    key: Id,
    value: T,
}

#[derive(Deserialize)]
struct Camera {
    #[serde(default, deserialize_with = "mean")]
    focal_length: Option<Number>,
}

#[derive(Deserialize)]
struct Wrapped<T> {
    ptr_wrapper: Wrapper<T>,
}

#[derive(Deserialize)]
struct Wrapper<T> {
    data: T,
}

#[derive(Deserialize)]
struct ViewData {
    filename: String,
    id_pose: Id,
    id_intrinsic: Option<Id>,
}

#[derive(Deserialize)]
struct Placed {
    rotation: [[Number; 3]; 3],
    center: [Number; 3],
}

pub(super) fn read(text: &str, found: &mut Found) -> Result<(), Error> {
    let SfmData { views, intrinsics, extrinsics } = parse(text, "sfm_data.json of OpenMVG")?;
    for Entry { key, value } in intrinsics {
        found.camera(key.0, value.ptr_wrapper.data.focal_length.map_or(0.0, |px| px.0));
    }
    let poses: HashMap<Id, Placed> = extrinsics.into_iter().map(|of| (of.key, of.value)).collect();
    for View { value } in views {
        let ViewData { filename: name, id_pose, id_intrinsic } = value.ptr_wrapper.data;
        let camera = id_intrinsic.map_or_else(String::new, |id| id.0);
        let place = || format!("the view with id_pose {}", id_pose.0);
        match poses.get(&id_pose) {
            Some(Placed { rotation, center }) => {
                let rotation = Some(rotation.map(|row| row.map(|number| number.0)));
                let centre = center.map(|number| number.0);
                found.pose(Pose { name, centre, rotation, commanded_deg: None }, &camera, place)?;
            }
            None => found.unregistered(name, place)?,
        }
    }
    Ok(())
}
