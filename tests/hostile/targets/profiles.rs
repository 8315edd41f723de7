//! Profiles in every upload format, and options.

use axum::http::Uri;
use pinstack::{
    contract::{Code, options::StackOptions, ranges::check_calibration},
    http::{
        extract::{json, params},
        ingest::fields::Fields,
        profiles::{
            file::ProfileFile,
            numbers::{self, Kind},
        },
    },
};
use pinstack_science::{
    archive::{npy, npz},
    types::{
        calibration_options::CalibrationOptions,
        profile::{ProfileInput, ProfileSlice},
        rig_parameters::RigParameters,
    },
};
use serde::{Serialize, de::DeserializeOwned};

use super::refused_with;

const REFUSALS: [Code; 2] = [Code::InvalidProfile, Code::InvalidRequest];

/// JSON that is a profile, rig parameters, or an exported profile.
pub fn profile(bytes: &[u8]) {
    for query in [
        "/p",
        "/p?image_width=640&image_height=480",
        "/p?image_width=640&image_height=480&direction=reference_to_slice",
    ] {
        match numbers::read(Kind::Json, bytes.to_vec(), &uri(query)) {
            Ok((input, _)) => sound(&input),
            Err(error) => refused_with(error.fault(), &REFUSALS),
        }
    }
    match json::parse::<RigParameters>(bytes, Code::InvalidProfile).and_then(|told| Ok(told.profile()?)) {
        Ok(input) => sound(&input),
        Err(fault) => refused_with(&fault, &REFUSALS),
    }
    match ProfileFile::read(bytes) {
        Ok(file) => sound(&file.profile.input),
        Err(fault) => refused_with(&fault, &REFUSALS),
    }
}

/// `.npy` and `.npz`.
pub fn numpy(bytes: &[u8]) {
    for wanted in [None, Some(npz::HOMOGRAPHIES), Some("gains")] {
        match npz::matrices(bytes.to_vec(), wanted) {
            Ok(matrices) => {
                let again = npy::of_floats(&[matrices.len(), 3, 3], matrices.iter().flatten().copied());
                let again = npy::matrices(&again, "what was written").expect("what was written can be read");
                let bits = |of: &[[f64; 9]]| of.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&again), bits(&matrices));
            }
            Err(fault) => refused_with(&fault.into(), &[Code::InvalidProfile]),
        }
    }
    match numbers::read(Kind::Numpy, bytes.to_vec(), &uri("/p?image_width=640&image_height=480&rail_step_mm=0.5")) {
        Ok((input, _)) => sound(&input),
        Err(error) => refused_with(error.fault(), &REFUSALS),
    }
}

/// Options of stacks and calibrations, as the JSON part of a form and as a query string.
pub fn options(bytes: &[u8]) {
    let document = Fields { pairs: Vec::new(), options: Some(bytes.to_vec()) };
    each_options(&document);
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(uri) = format!("/v1/stacks?{text}").parse::<Uri>() else { return };
    match params::pairs(&uri) {
        Ok(pairs) => each_options(&Fields { pairs, options: None }),
        Err(error) => refused_with(error.fault(), &[Code::InvalidRequest]),
    }
}

fn each_options(fields: &Fields) {
    match fields.options::<StackOptions>() {
        Ok(options) => {
            if options.check().is_ok() {
                survives(&options);
            }
        }
        Err(error) => refused_with(error.fault(), &[Code::InvalidRequest]),
    }
    match fields.options::<CalibrationOptions>() {
        Ok(options) => {
            if check_calibration(&options).is_ok() {
                survives(&options);
            }
        }
        Err(error) => refused_with(error.fault(), &[Code::InvalidRequest]),
    }
}

/// Checks that an accepted profile satisfies its rules, and can be stored and returned.
fn sound(input: &ProfileInput) {
    input.check().expect("what was let in keeps the rules");
    survives(input);
    for slice in ProfileSlice::all_given(input) {
        assert!(slice.scale.is_finite() && slice.shift_px.iter().all(|v| v.is_finite()), "{slice:?}");
    }
}

fn survives<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(told: &T) {
    let text = serde_json::to_vec(told).expect("JSON");
    let again: T = serde_json::from_slice(&text).expect("what was written can be read");
    assert_eq!(&again, told);
}

fn uri(text: &'static str) -> Uri {
    Uri::from_static(text)
}
