//! `pinstack demo`: calibrates and fuses a synthetic stack through the service over HTTP, and compares the results with
//! the truth of the renderer.

mod client;
mod compare;
mod scan;
mod sheet;
mod stacks;
mod truth;

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;

use self::{
    client::Client,
    scan::ScanDemo,
    sheet::{Cell, contact_sheet, depth_colours, shaded},
    truth::{Known, Score},
};
use super::serve::Service;
use crate::settings::Settings;
use pinstack_science::{
    imaging::{
        Raster,
        codec::{self, Metadata},
    },
    synth::{DotTarget, Rig, Scene, Stage},
};

// the names used in README.md
const RIG: &str = "bench-1";
const LENS: &str = "macro65-1x";
/// Dots of the target from left to right.
const TARGET_COLUMNS: usize = 19;

/// Scale of the insect. Its legs and antennae must end inside the picture, as those of a real object should.
const SCENE_SCALE: f64 = 0.9;

/// Render a dot target and a focus stack, send them through the service, and compare the results with the truth.
#[derive(Debug, clap::Args)]
pub struct Demo {
    /// Folder of the results, the zips and the data of the service [default: demo-out; with --scan demo-scan].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Keep the service running afterwards and print requests to try.
    #[arg(long)]
    keep: bool,
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
    #[arg(long, requires = "scan", value_delimiter = ',', allow_hyphen_values = true, default_values_t = [0.0, 12.0], value_parser = tilt)]
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
        tokio::runtime::Builder::new_multi_thread()
            .enable_all()
            .build()?
            .block_on(async { if self.scan { self.of_a_scan().run().await } else { self.run_steps().await } })
    }

    fn of_a_scan(self) -> ScanDemo {
        ScanDemo {
            out: self.out.unwrap_or_else(|| "demo-scan".into()),
            render_only: self.render_only,
            keep: self.keep,
            width: self.width.unwrap_or(600) as usize,
            slices: self.slices.unwrap_or(9) as usize,
            pans: self.pans,
            tilts: self.tilts,
            seed: self.seed,
        }
    }

    async fn run_steps(self) -> Result<()> {
        let begin = Instant::now();
        let rig = self.rig();
        let out = self.out.unwrap_or_else(|| "demo-out".into());
        let data = out.join("data");
        std::fs::create_dir_all(&data).with_context(|| format!("cannot make the folder {}", data.display()))?;
        let bar = steps();
        bar.set_message("rendering the dot target and the stack");
        let (target_zip, stack_zip) = (out.join("target.zip"), out.join("stack.zip"));
        // no edge of the plate is in view, so only a code tells that no slice is off by a whole pitch
        let target = DotTarget { code: Some([0, 0]), ..DotTarget::for_rig(&rig, TARGET_COLUMNS) };
        let optics = format!(
            "focal_mm={}&pixel_pitch_mm={:.5}&target_pitch_mm={:.4}",
            rig.focal_mm, rig.pixel_pitch_mm, target.pitch_mm
        );
        let known = {
            let (target_zip, stack_zip) = (target_zip.clone(), stack_zip.clone());
            tokio::task::spawn_blocking(move || -> Result<Known> {
                stacks::write_target(&rig, &target, &target_zip)?;
                let stage = Stage::new(&rig, &Scene::insect(self.seed).scaled(SCENE_SCALE));
                stacks::write_stack(&stage, &stack_zip)?;
                Ok(Known { rig, stage })
            })
            .await??
        };
        let rendered = begin.elapsed();

        let service = start_service(data).await?;
        let url = format!("http://{}", service.address());
        let client = Client::new(url.clone());
        let begin_calibration = Instant::now();
        let calibration = client
            .run_job(&format!("/v1/profiles/{RIG}/{LENS}/calibrations?{optics}"), &target_zip, |stage, share| {
                show(&bar, "calibrating", stage, share);
            })
            .await?;
        let calibrated = begin_calibration.elapsed();
        let begin_stack = Instant::now();
        let stack = client
            .run_job(&format!("/v1/stacks?rig={RIG}&lens={LENS}&label=demo&height=auto"), &stack_zip, |stage, share| {
                show(&bar, "fusing", stage, share);
            })
            .await?;
        let fused = begin_stack.elapsed();

        bar.set_message("comparing with the truth");
        let results = Results::fetch(&client, &calibration, &stack, known.rig.reference, &out).await?;
        let sheet = out.join("contact-sheet.png");
        let score = tokio::task::spawn_blocking(move || -> Result<Score> {
            let score = known.score(&results.profile, &results.image, &results.mask)?;
            results.write_contact_sheet(&known, &score, &sheet)?;
            Ok(score)
        })
        .await??;
        bar.finish_and_clear();

        println!("{}", score.table());
        println!(
            "time        rendering {:.1} s, calibrating {:.1} s, fusing {:.1} s, in all {:.1} s",
            rendered.as_secs_f64(),
            calibrated.as_secs_f64(),
            fused.as_secs_f64(),
            begin.elapsed().as_secs_f64()
        );
        println!(
            "results in  {}: contact-sheet.png image.png mask.png depth.png height.png backlight.png overlay.png metrics.json profile.json",
            out.display()
        );
        if self.keep {
            print_calls(&url, &stack, &stack_zip);
            tokio::signal::ctrl_c().await?;
        }
        service.stop().await
    }

    /// The camera on its rail.
    fn rig(&self) -> Rig {
        let (width, slices) = (self.width.unwrap_or(1200) as usize, self.slices.unwrap_or(13) as usize);
        Rig { seed: self.seed, ..Rig::sized(width, width * 2 / 3, slices) }
    }
}

/// Starts the service on its default port, or on a free port if that is in use.
async fn start_service(data_dir: PathBuf) -> Result<Service> {
    let config = Settings { data_dir, ..Settings::default() };
    match Service::start(&config).await {
        Ok(service) => Ok(service),
        Err(_) => Service::start(&Settings { listen: "127.0.0.1:0".into(), ..config }).await,
    }
}

/// The results from the service.
struct Results {
    profile: Value,
    image: Raster,
    mask: Raster,
    depth: Raster,
    height: Raster,
    backlight: Raster,
    overlay: Raster,
}

impl Results {
    /// Fetches every result and writes it to a file in `out`.
    async fn fetch(client: &Client, calibration: &Value, stack: &Value, reference: usize, out: &Path) -> Result<Self> {
        let stack_path = format!("/v1/stacks/{}", stack["id"].as_str().context("a stack has an id")?);
        let calibration_path =
            format!("/v1/calibrations/{}", calibration["id"].as_str().context("a calibration has an id")?);
        let metrics = client.get_json(&format!("{stack_path}/metrics")).await?;
        let profile = client.get_json(&format!("/v1/profiles/{RIG}/{LENS}")).await?;
        for (name, value) in [("metrics.json", &metrics), ("profile.json", &profile)] {
            std::fs::write(out.join(name), serde_json::to_string_pretty(value)?)?;
        }
        let mut pictures = Vec::new();
        for (path, name) in [
            (format!("{stack_path}/image"), "image.png"),
            (format!("{stack_path}/mask"), "mask.png"),
            (format!("{stack_path}/depth"), "depth.png"),
            (format!("{stack_path}/height"), "height.png"),
            (format!("{stack_path}/backlight"), "backlight.png"),
            (format!("{calibration_path}/overlay?slice={reference}"), "overlay.png"),
        ] {
            let bytes = client.get_bytes(&path).await?;
            std::fs::write(out.join(name), &bytes)?;
            pictures.push(
                codec::decode_rgba(&bytes, &codec::Limits::default())
                    .with_context(|| format!("{name} cannot be read back"))?,
            );
        }
        let mut next = pictures.into_iter();
        let mut take = || next.next().context("six pictures were fetched");
        Ok(Self {
            profile,
            image: take()?,
            mask: take()?,
            depth: take()?,
            height: take()?,
            backlight: take()?,
            overlay: take()?,
        })
    }

    fn write_contact_sheet(&self, known: &Known, score: &Score, path: &Path) -> Result<()> {
        let depth = depth_colours(&self.depth, known.rig.slices());
        let relief = shaded(&self.height);
        let end = known.rig.slices() - 1;
        let cell = |caption: String, picture| Cell { caption, picture };
        let sheet = contact_sheet(
            &[
                cell(format!("dots found in slice {} (reference)", known.rig.reference), &self.overlay),
                cell("front light, first slice".into(), &score.first_slice),
                cell(format!("front light, last slice ({end})"), &score.last_slice),
                cell(format!("fused and cut out: {:.1} dB", score.psnr_fused), &self.image),
                cell("truth".into(), &score.truth),
                cell("difference from truth, 4 times".into(), &score.difference),
                cell("fused back light".into(), &self.backlight),
                cell(format!("mask: IoU {:.4}", score.iou), &self.mask),
                cell("slice in focus: first violet, last yellow".into(), &depth),
                cell("height map: shaded relief".into(), &relief),
            ],
            4,
        );
        let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
        codec::encode_png(&mut file, &sheet, &Metadata::default())
            .with_context(|| format!("cannot write {}", path.display()))
    }
}

fn steps() -> ProgressBar {
    let bar = ProgressBar::new(100);
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg:45} {bar:30} {percent}%") {
        bar.set_style(style);
    }
    bar
}

fn show(bar: &ProgressBar, job: &str, stage: &str, share: f64) {
    bar.set_message(format!("{job}: {stage}"));
    bar.set_position((share * 100.0) as u64);
}

fn print_calls(url: &str, stack: &Value, zip: &Path) {
    let id = stack["id"].as_str().unwrap_or_default();
    println!("\nThe service is still running; Ctrl-C stops it. Try:\n");
    println!("  curl {url}/v1/profiles/{RIG}/{LENS}");
    println!("  curl {url}/v1/stacks/{id}");
    println!("  curl {url}/v1/stacks/{id}/metrics");
    println!("  curl -o image.tif -H 'Accept: image/tiff' {url}/v1/stacks/{id}/image");
    println!(
        "  curl -X POST -T {} -H 'Content-Type: application/zip' -H 'Prefer: wait=60' '{url}/v1/stacks?rig={RIG}&lens={LENS}&crop=valid'",
        zip.display()
    );
    println!("\nand in a browser: {url}/docs");
}
