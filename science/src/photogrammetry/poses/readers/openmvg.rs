//! OpenMVG `sfm_data.json`: a view has the extrinsics whose `key` is its `id_pose`.

use std::collections::HashMap;

use serde::Deserialize;

use super::{
    found::Found,
    json::{Id, Number, bounded, parse},
};
use crate::{photogrammetry::poses::Pose, types::Error};

#[derive(Deserialize)]
struct SfmData {
    #[serde(deserialize_with = "bounded")]
    views: Vec<View>,
    #[serde(default, deserialize_with = "bounded")]
    extrinsics: Vec<Extrinsic>,
}

#[derive(Deserialize)]
struct View {
    value: Wrapped,
}

#[derive(Deserialize)]
struct Wrapped {
    ptr_wrapper: Wrapper,
}

#[derive(Deserialize)]
struct Wrapper {
    data: ViewData,
}

#[derive(Deserialize)]
struct ViewData {
    filename: String,
    id_pose: Id,
}

#[derive(Deserialize)]
struct Extrinsic {
    key: Id,
    value: Placed,
}

#[derive(Deserialize)]
struct Placed {
    rotation: [[Number; 3]; 3],
    center: [Number; 3],
}

pub(super) fn read(text: &str, found: &mut Found) -> Result<(), Error> {
    let SfmData { views, extrinsics } = parse(text, "sfm_data.json of OpenMVG")?;
    let poses: HashMap<Id, Placed> = extrinsics.into_iter().map(|of| (of.key, of.value)).collect();
    for View { value } in views {
        let ViewData { filename: name, id_pose } = value.ptr_wrapper.data;
        let place = || format!("the view with id_pose {}", id_pose.0);
        match poses.get(&id_pose) {
            Some(Placed { rotation, center }) => {
                let rotation = Some(rotation.map(|row| row.map(|number| number.0)));
                let centre = center.map(|number| number.0);
                found.pose(Pose { name, centre, rotation, commanded_deg: None }, place)?;
            }
            None => found.unregistered(name, place)?,
        }
    }
    Ok(())
}
