//! The commands of COLMAP, with fixed lists of arguments, and what their output says about their progress.
//!
//! The options are those of COLMAP 3.8 to 3.12. The README of a bundle has the same commands.

use crate::contract::reconstruction::ReconstructionRequest;
use pinstack_science::types::intrinsics::Intrinsics;

/// Relative standard deviation from which a principal distance is only a start, as in bundles.
const FIXED: f64 = 0.005;

/// What the lists of arguments depend on.
pub(super) struct Plan<'a> {
    pub request: &'a ReconstructionRequest,
    /// Whether there is a list of pairs to match.
    pub has_pairs: bool,
    /// Threads of every command but the next.
    pub threads: usize,
    /// Threads of the extraction of features, each of which needs much memory.
    pub extraction_threads: usize,
}

impl Plan<'_> {
    pub(super) fn extract(&self) -> Vec<String> {
        let mut all = owned(&[
            "feature_extractor",
            "--database_path=database.db",
            "--image_path=images",
            "--ImageReader.single_camera=1",
            "--SiftExtraction.use_gpu=0",
        ]);
        all.push(format!("--SiftExtraction.num_threads={}", self.extraction_threads));
        if self.request.views.iter().any(|view| view.mask.is_some()) {
            all.push("--ImageReader.mask_path=masks".to_owned());
        }
        match &self.request.intrinsics {
            Some(camera) => {
                let (model, parameters) = parameters(camera, self.request.canvas_centre_px);
                let parameters: Vec<String> = parameters.iter().map(f64::to_string).collect();
                all.push(format!("--ImageReader.camera_model={model}"));
                all.push(format!("--ImageReader.camera_params={}", parameters.join(",")));
            }
            None => all.push("--ImageReader.camera_model=SIMPLE_PINHOLE".to_owned()),
        }
        all
    }

    pub(super) fn match_views(&self) -> Vec<String> {
        let mut all = match self.has_pairs {
            true => owned(&["matches_importer", "--match_list_path=pairs.txt", "--match_type=pairs"]),
            false => owned(&["exhaustive_matcher"]),
        };
        all.extend(owned(&["--database_path=database.db", "--SiftMatching.use_gpu=0"]));
        all.push(format!("--SiftMatching.num_threads={}", self.threads));
        all
    }

    pub(super) fn map(&self) -> Vec<String> {
        let mut all = owned(&["mapper", "--database_path=database.db", "--image_path=images", "--output_path=model"]);
        all.push(format!("--Mapper.num_threads={}", self.threads));
        let limit = self.request.options.max_error_px;
        for option in ["filter_max_reproj_error", "tri_complete_max_reproj_error", "tri_merge_max_reproj_error"] {
            all.push(format!("--Mapper.{option}={limit}"));
        }
        if let Some(camera) = &self.request.intrinsics {
            let sigma = camera.principal_distance_sigma_mm.map(|sigma| sigma / camera.principal_distance_mm);
            let refined = u8::from(!sigma.is_some_and(|sigma| sigma < FIXED));
            all.push(format!("--Mapper.ba_refine_focal_length={refined}"));
            all.extend(owned(&["--Mapper.ba_refine_principal_point=0", "--Mapper.ba_refine_extra_params=0"]));
        }
        all
    }

    pub(super) fn as_text(&self, model: &str) -> Vec<String> {
        let mut all = owned(&["model_converter", "--output_path=text", "--output_type=TXT"]);
        all.push(format!("--input_path={model}"));
        all
    }
}

fn owned(arguments: &[&str]) -> Vec<String> {
    arguments.iter().map(|argument| (*argument).to_owned()).collect()
}

/// Model and parameters of the camera, as bundles have them. COLMAP counts from the corner of the top-left pixel.
fn parameters(camera: &Intrinsics, canvas_centre: [f64; 2]) -> (&'static str, Vec<f64>) {
    let f = camera.principal_distance_px;
    let centre = camera.distortion.map(|lens| lens.centre_px).or(camera.principal_point_px).unwrap_or(canvas_centre);
    let [cx, cy] = centre.map(|c| c + 0.5);
    match camera.distortion.filter(|lens| [lens.k1, lens.k2] != [0.0; 2]) {
        Some(lens) => ("RADIAL", vec![f, cx, cy, lens.k1, lens.k2]),
        None => ("PINHOLE", vec![f, f, cx, cy]),
    }
}

/// The two numbers of `[3/36]` in a line that begins with `word`, or the steps of `[1/4, 2/4]`.
pub(super) fn steps(line: &str, word: &str) -> Option<(usize, usize)> {
    let (before, rest) = line.split_once('[')?;
    if !before.contains(word) {
        return None;
    }
    let mut pairs = rest.split_once(']')?.0.split(',').map(|part| {
        let (done, all) = part.trim().split_once('/')?;
        Some((done.parse::<usize>().ok()?, all.parse::<usize>().ok()?))
    });
    let (row, rows) = pairs.next()??;
    match pairs.next() {
        None => Some((row, rows)),
        Some(column) => {
            let (column, columns) = column?;
            Some((row.checked_sub(1)?.checked_mul(columns)?.checked_add(column)?, rows.checked_mul(columns)?))
        }
    }
}

/// The number of views that are registered, of `Registering image #12 (5)`.
pub(super) fn registered(line: &str) -> Option<usize> {
    line.split_once("Registering image #")?.1.split_once('(')?.1.split_once(')')?.0.parse().ok()
}

/// Collects the number of features of each image from the output of the extraction.
#[derive(Debug, Default)]
pub(super) struct Features {
    name: Option<String>,
    pub(super) of_images: Vec<(String, u32)>,
}

impl Features {
    pub(super) fn read(&mut self, line: &str) {
        let value = |key: &str| line.split_once(key).map(|(_, value)| value.trim());
        if let Some(name) = value("Name:") {
            self.name = Some(name.to_owned());
        } else if let Some(count) = value("Features:").and_then(|count| count.parse().ok())
            && let Some(name) = self.name.take()
        {
            self.of_images.push((name, count));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_of_colmap_is_understood() {
        assert_eq!(steps("Processed file [3/36]", "Processed file"), Some((3, 36)));
        assert_eq!(steps("Matching block [2/4, 3/4] in 0.1s", "Matching block"), Some((7, 16)));
        assert_eq!(steps("Matching block [0/4, 3/4]", "Matching block"), None);
        assert_eq!(steps("Name: x[1/2]", "Processed file"), None);
        assert_eq!(registered("Registering image #12 (5)"), Some(5));
        assert_eq!(registered("Registering image #"), None);
        let mut features = Features::default();
        for line in ["  Name:            a.png", "  Dimensions:      6 x 4", "  Features:        1044", "  Features: 3"]
        {
            features.read(line);
        }
        assert_eq!(features.of_images, [("a.png".to_owned(), 1044)]);
    }
}
