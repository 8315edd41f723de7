//! Whole scans: their zips, lists of names, and the poses that reconstruction programs write.

use std::{
    collections::BTreeMap,
    io::{Cursor, Write},
};

use pinstack::contract::{Code, Fault};
use pinstack_science::{
    archive::{
        self,
        scan::{ScanRules, group_names, open_scan},
    },
    photogrammetry::poses::{self, PoseOptions},
};

use super::{archives::REFUSALS, limits, refused_with};

/// Names that are taken from an input at most.
const MAX_NAMES: usize = 300;

/// The zip of a whole scan, and the zip of each of its views.
pub fn scan(bytes: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().expect("a file");
    file.write_all(bytes).expect("a file");
    let scan = match open_scan(file.path(), &limits(), &ScanRules::default()) {
        Ok(scan) => scan,
        Err(error) => return refused_with(&Fault::from(error), &REFUSALS),
    };
    let mut placed: BTreeMap<&str, usize> = BTreeMap::new();
    for (at, view) in scan.views().iter().enumerate() {
        assert!(view.front.len() >= 2 && (view.back.is_empty() || view.back.len() == view.front.len()), "{view:?}");
        view.front.iter().chain(&view.back).for_each(|name| *placed.entry(name).or_default() += 1);
        let mut zip = Cursor::new(Vec::new());
        match scan.write_view(at, &mut zip) {
            Ok(()) => {
                assert!(zip.get_ref().len() as u64 <= view.bytes, "view {at} is larger than announced");
                match archive::open_in_memory(zip.into_inner(), &limits()) {
                    Ok(stack) => assert_eq!(stack.layout().front.len(), view.front.len(), "no slice is lost"),
                    Err(error) => refused_with(&Fault::from(error), &REFUSALS),
                }
            }
            Err(error) => refused_with(&Fault::from(error), &REFUSALS),
        }
    }
    scan.ignored().iter().for_each(|file| *placed.entry(&file.name).or_default() += 1);
    assert!(placed.values().all(|count| *count == 1), "a picture is in two places: {placed:?}");
}

/// A list of names, one per line.
pub fn names(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let names: Vec<String> = text.lines().take(MAX_NAMES).map(str::to_owned).collect();
    let grouping = match group_names(&names, None, &ScanRules::default()) {
        Ok(grouping) => grouping,
        Err(error) => return refused_with(&Fault::from(error), &[Code::InvalidArchive]),
    };
    let mut placed: BTreeMap<&str, usize> = BTreeMap::new();
    for view in &grouping.views {
        view.front.iter().chain(&view.back).for_each(|name| *placed.entry(name).or_default() += 1);
        let is_whole = view.front.len() >= 2 && (view.back.is_empty() || view.back.len() == view.front.len());
        assert!(is_whole || view.problem.is_some(), "{view:?}");
        let angles = view.pan_deg.into_iter().chain(view.tilt_deg);
        assert!(angles.into_iter().all(f64::is_finite), "{view:?}");
    }
    grouping.ignored.iter().for_each(|file| *placed.entry(&file.name).or_default() += 1);
    assert!(placed.values().all(|count| *count == 1), "a file is in two places: {placed:?}");
    assert!(placed.len() <= names.len());
}

/// A file of camera poses of any format, and its report.
pub fn pose_file(bytes: &[u8]) {
    let file = match poses::read(bytes, None) {
        Ok(file) => file,
        Err(error) => return refused_with(&Fault::from(error), &[Code::InvalidPoses]),
    };
    assert!(!file.poses.is_empty() && file.poses.len() <= poses::MAX_VIEWS);
    assert!(file.poses.iter().all(|pose| pose.centre.iter().all(|value| value.is_finite())), "{file:?}");
    match poses::report(&file, &PoseOptions::default()) {
        Ok(report) => {
            // JSON has no infinite numbers: a null in place of a number could not be read again
            let text = serde_json::to_string(&report).expect("a report can be written");
            serde_json::from_str::<serde_json::Value>(&text).expect("and read");
            assert!(!report.text().is_empty() && !report.latex().is_empty());
        }
        Err(error) => refused_with(&Fault::from(error), &[Code::InvalidPoses, Code::InvalidRequest]),
    }
}
