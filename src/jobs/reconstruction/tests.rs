//! The names of pictures, and the need of space.

use super::*;
use crate::contract::{
    Name,
    reconstruction::{ReconstructionOptions, ReconstructionView, StoredPicture},
    request::Upload,
};
use pinstack_science::types::view::ViewAngles;

fn request(views: usize) -> ReconstructionRequest {
    let picture = || StoredPicture { key: "results/x".into(), bytes: 10, sha256: String::new() };
    let view = |at: usize| {
        let angles = ViewAngles { pan_deg: 10.0 * at as f64, tilt_deg: 0.0 };
        ReconstructionView {
            name: angles.file_stem(),
            stack: uuid::Uuid::nil(),
            extension: "jpg".into(),
            bit_depth: 8,
            angles: Some(angles),
            image: picture(),
            mask: (at != 1).then(picture),
            remarks: Vec::new(),
        }
    };
    ReconstructionRequest {
        scan: Name::new("bee").expect("a name"),
        options: ReconstructionOptions::default(),
        upload: Upload { key: String::new(), bytes: 50, sha256: String::new(), filename: None },
        expected: 36,
        image_size_px: [6400, 3200],
        intrinsics: None,
        canvas_centre_px: [3199.5, 1599.5],
        radius_mm: None,
        pan_is_clockwise: false,
        views: (0..views).map(view).collect(),
    }
}

#[test]
fn pictures_are_where_the_bundle_has_them() {
    let request = request(3);
    let mut paths: Vec<String> = request.pictures().map(|(path, _)| path).collect();
    paths.sort_unstable();
    let entries = bundle::plan(Layout::Colmap, &described(&request)).expect("a bundle");
    let is_picture = |content: &Content| matches!(content, Content::Image(_) | Content::Mask(_));
    let mut planned: Vec<String> =
        entries.into_iter().filter(|entry| is_picture(&entry.content)).map(|entry| entry.path).collect();
    planned.sort_unstable();
    assert_eq!(paths, planned);
}

#[test]
fn needs_grow_with_views_and_threads() {
    // 3200 x 1600 px
    let per_thread = 3200 * 1600 * 200;
    assert_eq!(need::memory(&request(3), 4) - need::memory(&request(3), 2), 2 * per_thread);
    assert_eq!(need::extraction_threads(&request(3), 8, (300 << 20) + 3 * per_thread), 3);
    assert_eq!(need::extraction_threads(&request(3), 8, 0), 1);
    let mut unknown = request(100);
    let neighbours = need::disk(&unknown);
    unknown.views[7].angles = None;
    assert_eq!(need::disk(&unknown) - neighbours, (100 * 99 / 2 - 1200) * 150_000, "every pair is matched");
}
