//! Memory and disk space that a reconstruction needs, from the sizes of its images.

use crate::contract::reconstruction::ReconstructionRequest;

/// COLMAP reduces larger images to this size for the extraction of features, px.
const LARGEST_SIDE: u64 = 3200;
/// Bytes per pixel of an image while its features are extracted: a pyramid of floats that begins at twice the size.
const EXTRACTION_BYTES: u64 = 200;
/// The rest of COLMAP: libraries, the matcher, the mapper without its points.
const BASE: u64 = 300 << 20;
/// Bytes of a view in the mapper: features, matches and points.
const MAPPING_BYTES: u64 = 3 << 20;
/// Most bytes of the features of a view in the database: 8192 descriptors of 128 bytes, and their places.
const FEATURE_BYTES: u64 = 2 << 20;
/// Most bytes of the matches of a pair of views, before and after their check.
const PAIR_BYTES: u64 = 150_000;
/// Pairs per view where neighbours are known.
const NEIGHBOURS: u64 = 12;
/// Bytes of a view in the models, their texts and the artifacts.
const MODEL_BYTES: u64 = 4 << 20;
/// Most bytes of the visual hull: about a million vertices.
const HULL_BYTES: u64 = 64 << 20;
/// Bytes per pixel of a view that the command for a mesh may write: undistorted images, and maps of depth and normals.
const MESH_PIXEL_BYTES: u64 = 40;
/// Other files.
const FILES: u64 = 64 << 20;

/// Pixels of an image as features are extracted from it.
fn pixels(request: &ReconstructionRequest) -> u64 {
    let [width, height] = request.image_size_px.map(u64::from);
    let side = width.max(height).max(1);
    let reduced = |length: u64| if side > LARGEST_SIDE { length * LARGEST_SIDE / side } else { length };
    reduced(width) * reduced(height)
}

/// Memory that a thread needs to extract features, bytes.
fn per_thread(request: &ReconstructionRequest) -> u64 {
    pixels(request).saturating_mul(EXTRACTION_BYTES)
}

/// Threads that extract features within `most` bytes.
pub(super) fn extraction_threads(request: &ReconstructionRequest, threads: usize, most: u64) -> usize {
    let fit = most.saturating_sub(BASE) / per_thread(request).max(1);
    usize::try_from(fit).unwrap_or(usize::MAX).clamp(1, threads.max(1))
}

/// Peak memory with `threads` threads, bytes.
pub fn memory(request: &ReconstructionRequest, threads: usize) -> u64 {
    let extracting = per_thread(request).saturating_mul(threads as u64);
    let mapping = MAPPING_BYTES.saturating_mul(request.views.len() as u64);
    extracting.max(mapping).saturating_add(BASE)
}

/// Bytes that the command for a mesh may write.
pub fn mesh_disk(request: &ReconstructionRequest) -> u64 {
    let [width, height] = request.image_size_px.map(u64::from);
    (request.views.len() as u64).saturating_mul(width * height).saturating_mul(MESH_PIXEL_BYTES)
}

/// Bytes that COLMAP and this program write at most, without the pictures.
pub fn disk(request: &ReconstructionRequest) -> u64 {
    let views = request.views.len() as u64;
    let every = views.saturating_mul(views.saturating_sub(1)) / 2;
    let has_angles = request.views.iter().all(|view| view.angles.is_some());
    let pairs = if has_angles { every.min(NEIGHBOURS * views) } else { every };
    let of_views = views.saturating_mul(FEATURE_BYTES + MODEL_BYTES);
    (FILES + HULL_BYTES).saturating_add(of_views).saturating_add(pairs.saturating_mul(PAIR_BYTES))
}
