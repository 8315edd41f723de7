//! `pinstack demo`: one stack of a synthetic insect.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::{Context, Result};
use serde_json::Value;

use super::{
    client::{Client, pages, start_service},
    files::{TARGET_COLUMNS, write_stack, write_target},
    sheet,
    truth::{Known, Score},
};
use crate::cli::output::{note, say};
use pinstack_science::{
    imaging::{Raster, codec},
    synth::{DotTarget, Rig, Scene, Stage},
};

// the names used in README.md
const RIG: &str = "bench-1";
const LENS: &str = "macro65-1x";

/// Scale of the insect. Its legs and antennae must end inside the picture, as those of a real object should.
const SCENE_SCALE: f64 = 0.9;

/// What to render.
pub(super) struct SingleDemo {
    /// Folder of all files.
    pub out: PathBuf,
    /// Keep the service running afterwards.
    pub keep: bool,
    /// Port of the service; `None`: the default, or a free one.
    pub port: Option<u16>,
    /// Width of a slice, px.
    pub width: usize,
    /// Number of slices.
    pub slices: usize,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl SingleDemo {
    /// Runs the demo.
    pub(super) async fn run(self) -> Result<()> {
        let begin = Instant::now();
        let rig = Rig { seed: self.seed, ..Rig::sized(self.width, self.width * 2 / 3, self.slices) };
        let out = self.out;
        let data = out.join("data");
        std::fs::create_dir_all(&data).with_context(|| format!("cannot make the folder {}", data.display()))?;
        note("rendering the dot target and the stack");
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
                write_target(&rig, &target, &target_zip)?;
                let stage = Stage::new(&rig, &Scene::insect(self.seed).scaled(SCENE_SCALE));
                write_stack(&stage, &stack_zip)?;
                Ok(Known { rig, stage })
            })
            .await??
        };
        let rendered = begin.elapsed();

        let service = start_service(data, self.port).await?;
        let url = format!("http://{}", service.address());
        let client = Client::new(url.clone());
        note("calibrating");
        let begin_calibration = Instant::now();
        let path = format!("/v1/profiles/{RIG}/{LENS}/calibrations?{optics}");
        let calibration = client.run_job(&path, &target_zip).await?;
        let calibrated = begin_calibration.elapsed();
        note("fusing");
        let begin_stack = Instant::now();
        let path = format!("/v1/stacks?rig={RIG}&lens={LENS}&label=demo&height=auto");
        let stack = client.run_job(&path, &stack_zip).await?;
        let fused = begin_stack.elapsed();

        note("comparing with the truth");
        let results = Results::fetch(&client, &calibration, &stack, known.rig.reference, &out).await?;
        let folder = out.clone();
        let score = tokio::task::spawn_blocking(move || -> Result<Score> {
            let score = known.score(&results.profile, &results.image, &results.mask)?;
            sheet::write(&folder, &known.rig, &score, &results.height)?;
            Ok(score)
        })
        .await??;

        say(score.table());
        say(format!(
            "time        rendering {:.1} s, calibrating {:.1} s, fusing {:.1} s, in all {:.1} s",
            rendered.as_secs_f64(),
            calibrated.as_secs_f64(),
            fused.as_secs_f64(),
            begin.elapsed().as_secs_f64()
        ));
        say(format!("results in  {}; open {} in a browser", out.display(), out.join(sheet::FILE).display()));
        if self.keep {
            print_calls(&url, &stack, &stack_zip);
            tokio::signal::ctrl_c().await?;
        }
        service.stop().await
    }
}

/// The results that are compared with the truth.
struct Results {
    profile: Value,
    image: Raster,
    mask: Raster,
    height: Raster,
}

impl Results {
    /// Fetches every result and writes it to a file in `out`.
    async fn fetch(client: &Client, calibration: &Value, stack: &Value, reference: usize, out: &Path) -> Result<Self> {
        let stack = format!("/v1/stacks/{}", stack["id"].as_str().context("a stack has an id")?);
        let calibration =
            format!("/v1/calibrations/{}", calibration["id"].as_str().context("a calibration has an id")?);
        let metrics = client.get_json(&format!("{stack}/metrics")).await?;
        let profile = client.get_json(&format!("/v1/profiles/{RIG}/{LENS}")).await?;
        for (name, value) in [("metrics.json", &metrics), ("profile.json", &profile)] {
            std::fs::write(out.join(name), serde_json::to_string_pretty(value)?)?;
        }
        let fetched = async |path: String, name: &str| -> Result<Vec<u8>> {
            let bytes = client.get_bytes(&path).await?;
            std::fs::write(out.join(name), &bytes)?;
            Ok(bytes)
        };
        for (path, name) in [
            (format!("{stack}/depth"), "depth.png"),
            (format!("{stack}/backlight"), "backlight.png"),
            (format!("{calibration}/overlay?slice={reference}"), "overlay.png"),
        ] {
            fetched(path, name).await?;
        }
        let picture = async |name: &str| -> Result<Raster> {
            let file = format!("{name}.png");
            let bytes = fetched(format!("{stack}/{name}"), &file).await?;
            codec::decode_rgba(&bytes, &codec::Limits::default()).with_context(|| format!("{file} cannot be read back"))
        };
        let (image, mask, height) = (picture("image").await?, picture("mask").await?, picture("height").await?);
        Ok(Self { profile, image, mask, height })
    }
}

fn print_calls(url: &str, stack: &Value, zip: &Path) {
    let id = stack["id"].as_str().unwrap_or_default();
    say("\nThe service is still running; Ctrl-C stops it. Try:\n");
    say(format!("  curl {url}/v1/profiles/{RIG}/{LENS}"));
    say(format!("  curl {url}/v1/stacks/{id}"));
    say(format!("  curl {url}/v1/stacks/{id}/metrics"));
    say(format!("  curl -o image.tif -H 'Accept: image/tiff' {url}/v1/stacks/{id}/image"));
    say(format!(
        "  curl -X POST -T {} -H 'Content-Type: application/zip' -H 'Prefer: wait=50' '{url}/v1/stacks?rig={RIG}&lens={LENS}&crop=valid'",
        zip.display()
    ));
    say("\nand in a browser:\n");
    say(pages(url, &[("the stack", &format!("stacks/{id}")), ("its profile", &format!("profiles/{RIG}/{LENS}"))]));
}
