//! The views of a file beside those that were expected: which are registered, missing, unknown, or occur twice.

use std::collections::{HashMap, HashSet};

use crate::{
    photogrammetry::poses::{Commanded, Pose, PoseFile, PoseOptions, view_key, without_extension},
    types::view::ViewAngles,
};

/// The views of a file beside those that were expected.
pub(super) struct Views<'a> {
    pub poses: Vec<&'a Pose>,
    pub commanded: Vec<Option<[f64; 2]>>,
    pub not_registered: Vec<String>,
    pub unknown: Vec<String>,
    pub duplicates: Vec<String>,
}

impl<'a> Views<'a> {
    pub(super) fn of(file: &'a PoseFile, options: &PoseOptions) -> Self {
        let listed: HashMap<String, &Commanded> =
            options.commanded.iter().map(|view| (view_key(&view.name), view)).collect();
        let mut seen = HashSet::new();
        let (mut poses, mut commanded) = (Vec::new(), Vec::new());
        let (mut unknown, mut duplicates) = (Vec::new(), Vec::new());
        for pose in &file.poses {
            let key = view_key(&pose.name);
            let expected = listed.get(&key);
            if !seen.insert(key) {
                duplicates.push(pose.name.clone());
                continue;
            }
            if expected.is_none() && !listed.is_empty() {
                unknown.push(pose.name.clone());
            }
            poses.push(pose);
            commanded.push(match expected {
                Some(expected) => expected.angles_deg,
                None if listed.is_empty() => pose.commanded_deg.or_else(|| angles_of(&pose.name)),
                // a view of another scan has angles of another scan
                None => None,
            });
        }
        let not_registered = match options.commanded.as_slice() {
            [] => file.unregistered.clone(),
            views => {
                views.iter().map(|view| &view.name).filter(|name| !seen.contains(&view_key(name))).cloned().collect()
            }
        };
        Self { poses, commanded, not_registered, unknown, duplicates }
    }
}

/// The angles that a name contains, with or without its folders.
fn angles_of(name: &str) -> Option<[f64; 2]> {
    let whole = without_extension(name);
    let last = whole.rsplit(['/', '\\']).next().unwrap_or(whole);
    let ViewAngles { pan_deg, tilt_deg } = ViewAngles::of_name(last).or_else(|| ViewAngles::of_name(whole))?;
    Some([pan_deg, tilt_deg])
}
