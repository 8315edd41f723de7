//! `pinstack poses`: a report on camera poses, without a server.

use std::{fs, path::PathBuf};

use anyhow::{Context, anyhow};
use clap::{Args, ValueEnum};
use serde::{Deserialize, de::IntoDeserializer};

use super::output::say;
use crate::http::{pages::pose_report, poses::MAX_BYTES};
use pinstack_science::photogrammetry::poses::{KnownScale, PoseFormat, PoseOptions, read, report};

/// Report on the camera poses of a scan: sphere, steps of pan and tilt, residual of each view
#[derive(Debug, Args)]
pub struct Poses {
    /// COLMAP images.txt or images.bin, or a zip of the folder of the model; AliceVision cameras.sfm, Metashape XML,
    /// OpenMVG sfm_data.json, or CSV
    file: PathBuf,
    /// Format of the file: colmap_text, colmap_binary, alicevision, metashape, openmvg or csv [default: found from its
    /// content]
    #[arg(long, value_name = "FORMAT", value_parser = file_format)]
    file_format: Option<PoseFormat>,
    /// Format of the report
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// Number of views that should be registered
    #[arg(long, value_name = "N")]
    expected: Option<u32>,
    /// Known distance from the centre of the turntable to the centre of projection, mm
    #[arg(long, value_name = "MM", value_parser = length)]
    radius_mm: Option<f64>,
    /// Instead of --radius-mm: two views whose distance is known
    #[arg(long, num_args = 2, value_names = ["VIEW", "VIEW"], requires = "pair_mm", conflicts_with = "radius_mm")]
    pair: Option<Vec<String>>,
    /// Their distance, mm
    #[arg(long, value_name = "MM", requires = "pair", value_parser = length)]
    pair_mm: Option<f64>,
    /// File to write [default: the terminal]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Format of the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A table to read
    Text,
    /// Data, as POST /v1/poses answers
    Json,
    /// A table for a paper
    Latex,
    /// A page with a drawing of the sphere and the residuals
    Html,
}

fn file_format(text: &str) -> Result<PoseFormat, serde::de::value::Error> {
    PoseFormat::deserialize(text.into_deserializer())
}

/// A length greater than 0.
pub(super) fn length(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("must be greater than 0".to_owned()) }
}

impl Poses {
    /// Runs the command.
    ///
    /// # Errors
    /// When the file cannot be read or has no poses, or the report cannot be written.
    pub fn run(self) -> anyhow::Result<()> {
        let name = self.file.display();
        let bytes = fs::metadata(&self.file).with_context(|| format!("cannot read {name}"))?.len();
        if bytes > MAX_BYTES {
            return Err(anyhow!("{name} has {bytes} bytes; a file of poses has at most {MAX_BYTES}"));
        }
        let bytes = fs::read(&self.file).with_context(|| format!("cannot read {name}"))?;
        let pair = self.pair.as_deref().zip(self.pair_mm);
        let scale = match (self.radius_mm, pair) {
            (Some(mm), _) => Some(KnownScale::Radius { mm }),
            (None, Some(([from, to], mm))) => Some(KnownScale::Pair { from: from.clone(), to: to.clone(), mm }),
            (None, _) => None,
        };
        let options = PoseOptions { expected: self.expected, scale, ..PoseOptions::default() };
        let found = read(&bytes, self.file_format).map_err(|error| anyhow!("{name}: {}", error.detail))?;
        let report = report(&found, &options).map_err(|error| anyhow!("{}", error.detail))?;
        let text = match self.format {
            Format::Text => report.text(),
            Format::Json => serde_json::to_string_pretty(&report)? + "\n",
            Format::Latex => report.latex(),
            Format::Html => pose_report::page(&report),
        };
        match &self.out {
            Some(out) => fs::write(out, text).with_context(|| format!("cannot write {}", out.display()))?,
            None => say(text.trim_end()),
        }
        Ok(())
    }
}
