//! Runs COLMAP as the README of a bundle says, and reads what the pose report says of the result.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
    process::Command,
};

use serde_json::Value;

use crate::run;

/// Runs the first block of commands of `README.txt` in a bundle, on the CPU. Returns the file with the poses.
///
/// `limit_px` is the error of reprojection beyond which the mapper leaves observations out; `None` is its own limit of
/// 4 px.
pub fn reconstruct(bundle: &Path, limit_px: Option<f64>) -> PathBuf {
    let readme = fs::read_to_string(bundle.join("README.txt")).expect("a README");
    let commands: Vec<&str> = readme
        .lines()
        .skip_while(|line| !line.starts_with("Run in this folder"))
        .skip(1)
        .skip_while(|line| line.is_empty())
        .take_while(|line| !line.is_empty())
        .collect();
    assert!(commands.iter().any(|line| line.starts_with("colmap mapper")), "{readme}");
    let script = commands.join("\n");
    // as the README says for a computer without a GPU
    let script = script.replace("colmap feature_extractor", "colmap feature_extractor --SiftExtraction.use_gpu 0");
    let script = script.replace("colmap matches_importer", "colmap matches_importer --SiftMatching.use_gpu 0");
    let limited = limit_px.map(|px| {
        let settings =
            ["filter", "tri_complete", "tri_merge"].map(|step| format!(" --Mapper.{step}_max_reproj_error {px}"));
        script.replace("colmap mapper", &format!("colmap mapper{}", settings.concat()))
    });
    let script = format!("set -e\n{}", limited.unwrap_or(script));
    run(Command::new("sh").env("QT_QPA_PLATFORM", "offscreen").current_dir(bundle).args(["-c", &script]));
    let models = fs::read_dir(bundle.join("model")).expect("a model").count();
    assert_eq!(models, 1, "COLMAP made {models} models: the views do not hang together");
    bundle.join("model/0/images.bin")
}

/// The figures of table I of the paper.
#[derive(Debug, Clone, Copy)]
pub struct Accuracy {
    pub registered: usize,
    /// Standard deviation of the distance of the cameras from the centre of the sphere, % of the radius.
    pub radial_percent: f64,
    /// Standard deviation of the step of pan.
    pub pan_deg: f64,
    /// Standard deviation of the step of tilt.
    pub tilt_deg: f64,
}

impl Accuracy {
    /// The three standard deviations: radius, pan step, tilt step.
    pub fn deviations(&self) -> [f64; 3] {
        [self.radial_percent, self.pan_deg, self.tilt_deg]
    }

    /// How much larger they are than others, each.
    pub fn ratios(&self, others: &Self) -> [f64; 3] {
        let (own, others) = (self.deviations(), others.deviations());
        [0, 1, 2].map(|which| own[which] / others[which])
    }

    /// From the JSON of a pose report.
    pub fn of(report: &Value) -> Self {
        let number = |pointer: &str| {
            let value = report.pointer(pointer).and_then(Value::as_f64);
            value.unwrap_or_else(|| panic!("no {pointer} in {report}"))
        };
        Self {
            registered: number("/registered") as usize,
            radial_percent: number("/surface/std_percent"),
            pan_deg: number("/pan_steps/std_deg"),
            tilt_deg: number("/tilt_steps/std_deg"),
        }
    }
}

impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} views registered, STD of the radius {:.4} %, of the pan step {:.4} deg, of the tilt step {:.4} deg",
            self.registered, self.radial_percent, self.pan_deg, self.tilt_deg
        )
    }
}
