//! What the tests send: a small stack, a scan of two views, and a profile for both.

use pinstack_science::{
    archive,
    imaging::{Raster, codec},
};
use serde_json::{Value, json};

const SIDE: u32 = 64;

/// Two lights of three slices each.
pub fn zip() -> Vec<u8> {
    zip_of(&[""])
}

/// A scan of two views.
pub fn scan_zip() -> Vec<u8> {
    zip_of(&["pan000_tilt00/", "pan020_tilt00/"])
}

/// Two lights of three slices each in every one of these folders.
fn zip_of(views: &[&str]) -> Vec<u8> {
    let slice = |seed: u32| {
        let value = |i: u32| ((i / 3 % SIDE / 4 * 37 + i / 3 / SIDE / 4 * (91 + seed)) % 251) as u8;
        codec::encode_jpeg(
            &Raster::eight(SIDE as usize, SIDE as usize, 3, (0..SIDE * SIDE * 3).map(value).collect()),
            90,
        )
    };
    let members = views.iter().flat_map(|view| {
        let slices = |light: &'static str| (0..3).map(move |i| (format!("{view}{light}/{i}.jpg"), i));
        slices("front").chain(slices("back"))
    });
    let file = tempfile::NamedTempFile::new().expect("a file");
    archive::pack(file.reopen().expect("a file"), members.map(|(name, i)| (name, slice(i)))).expect("a zip");
    std::fs::read(file.path()).expect("the zip")
}

/// A profile for these slices.
pub fn profile() -> Value {
    let homographies: Vec<Value> = [1.0, 1.001, 1.002].iter().map(|s| json!([s, 0, 0, 0, s, 0, 0, 0, 1])).collect();
    json!({ "image_width": SIDE, "image_height": SIDE, "reference_index": 0, "homographies": homographies })
}
