//! `pinstack demo`: calibrates and fuses a synthetic stack, or the scan of a specimen, through the service over HTTP,
//! and compares the results with the truth of the renderer.

mod client;
mod compare;
mod files;
mod scan;
mod sheet;
mod single;
mod truth;

use std::path::PathBuf;

use anyhow::Result;

use self::{scan::ScanDemo, single::SingleDemo};

/// Render a dot target and a focus stack, send them through the service, and compare the results with the truth.
#[derive(Debug, clap::Args)]
pub struct Demo {
    /// Folder of the results, the zips and the data of the service [default: demo-out; with --scan demo-scan].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Keep the service running afterwards and print requests to try.
    #[arg(long)]
    keep: bool,
    /// Port of the service on this machine [default: 8080, or a free one if that is in use].
    #[arg(long)]
    port: Option<u16>,
    /// Seed of the random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Width of a slice, px; the height is two thirds of it [default: 1200; with --scan 600].
    #[arg(long, value_parser = clap::value_parser!(u32).range(240..=6000))]
    width: Option<u32>,
    /// Number of slices [default: 13; with --scan 9].
    #[arg(long, value_parser = clap::value_parser!(u32).range(3..=100))]
    slices: Option<u32>,
    /// Render the scan of a specimen on a turntable instead of a single stack.
    #[arg(long)]
    scan: bool,
    /// Render the files of the scan and send nothing.
    #[arg(long, requires = "scan", conflicts_with = "keep")]
    render_only: bool,
    /// Views of the scan around the axis of the turntable.
    #[arg(long, requires = "scan", default_value_t = 18, value_parser = clap::value_parser!(u32).range(3..=360))]
    pans: u32,
    /// Tilts of the camera at which the scan goes around, degrees.
    #[arg(long, requires = "scan", num_args = 1.., value_delimiter = ',', allow_negative_numbers = true, default_values_t = [0.0, 12.0], value_parser = tilt)]
    tilts: Vec<f64>,
}

/// A tilt at which the rendered turntable shows the specimen from the side.
fn tilt(text: &str) -> std::result::Result<f64, String> {
    let degrees: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (-30.0..=60.0).contains(&degrees) { Ok(degrees) } else { Err("must be from -30 to 60 degrees".to_owned()) }
}

impl Demo {
    /// Runs the demo.
    ///
    /// # Errors
    /// When a file cannot be written, or a request or a job fails.
    pub fn run(self) -> Result<()> {
        let size =
            |width: u32, slices: u32| (self.width.unwrap_or(width) as usize, self.slices.unwrap_or(slices) as usize);
        let (seed, keep, port) = (self.seed, self.keep, self.port);
        let runtime = tokio::runtime::Runtime::new()?;
        if self.scan {
            let (width, slices) = size(600, 9);
            let (pans, render_only) = (self.pans, self.render_only);
            let out = self.out.unwrap_or_else(|| "demo-scan".into());
            let demo = ScanDemo { out, render_only, keep, port, width, slices, pans, tilts: self.tilts, seed };
            runtime.block_on(demo.run())
        } else {
            let (width, slices) = size(1200, 13);
            let out = self.out.unwrap_or_else(|| "demo-out".into());
            runtime.block_on(SingleDemo { out, keep, port, width, slices, seed }.run())
        }
    }
}
