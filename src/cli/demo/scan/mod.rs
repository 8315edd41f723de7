//! `pinstack demo --scan`: renders the scan of a specimen on a turntable, sends it through the service over HTTP, and
//! compares the views with the truth. The rig is knocked in one view, so that the scan has an outlier; that view is
//! photographed again.
//!
//! The files are those that a user of a real rig has: the dot target, one zip with all views, and the zip of the view
//! that is photographed again. docs/TUTORIAL.md works with them.

mod files;
mod score;
mod setup;

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::{Context, Result};
use serde_json::{Value, json};

use self::{
    score::{Figures, Pictures, ViewFigures},
    setup::{SCAN, Setup},
};
use super::client::{Client, pages, start_service};
use crate::cli::output::{note, say};
use pinstack_science::{
    archive::{self, ArchiveLimits},
    imaging::{Raster, codec},
    photogrammetry::poses::COLMAP_MODEL,
};

// the names used in docs/TUTORIAL.md
const RIG: &str = "turntable-1";
const LENS: &str = "macro65";

/// What to render, and what to do with it.
pub(super) struct ScanDemo {
    /// Folder of all files.
    pub out: PathBuf,
    /// Render the files and send nothing.
    pub render_only: bool,
    /// Keep the service running afterwards.
    pub keep: bool,
    /// Port of the service; `None`: the default, or a free one.
    pub port: Option<u16>,
    /// Width of a slice, px.
    pub width: usize,
    /// Number of slices.
    pub slices: usize,
    /// Views around the axis.
    pub pans: u32,
    /// Tilts of the camera, degrees.
    pub tilts: Vec<f64>,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl ScanDemo {
    /// Runs the demo.
    pub(super) async fn run(self) -> Result<()> {
        let begin = Instant::now();
        let data = self.out.join("data");
        std::fs::create_dir_all(&self.out).with_context(|| format!("cannot make the folder {}", self.out.display()))?;
        let setup = Setup::new(self.width, self.slices, self.pans, &self.tilts, self.seed);
        let (rendering, out) = (setup.clone(), self.out.clone());
        tokio::task::spawn_blocking(move || files::write(&rendering, &out)).await??;
        let rendered = begin.elapsed();
        if self.render_only {
            say(self.left(&[]));
            say(settings(&setup));
            return Ok(());
        }
        let service = start_service(data, self.port).await?;
        let url = format!("http://{}", service.address());
        let scan = Scan { client: Client::new(url.clone()), setup: &setup, out: &self.out };
        let figures = scan.run().await?;
        say(figures.table());
        say(format!(
            "time          rendering {:.1} s, in all {:.1} s",
            rendered.as_secs_f64(),
            begin.elapsed().as_secs_f64()
        ));
        say(self.left(&["bundle.zip", "poses.txt", "figures.json"]));
        if self.keep {
            say("\nThe service is still running; Ctrl-C stops it. In a browser:\n");
            say(pages(
                &url,
                &[("the scan", &format!("scans/{SCAN}")), ("its profile", &format!("profiles/{RIG}/{LENS}"))],
            ));
            tokio::signal::ctrl_c().await?;
        }
        service.stop().await
    }

    /// The line that names the files.
    fn left(&self, results: &[&str]) -> String {
        let rendered = [files::TARGET, files::SCAN, files::RETAKE, files::TRUTH];
        let names: Vec<&str> = rendered.iter().chain(results).copied().collect();
        format!("files in      {}: {}", self.out.display(), names.join(" "))
    }
}

/// What the rig knows about itself, as parameters of the requests.
fn settings(setup: &Setup) -> String {
    format!(
        "the rig       focal_mm={} pixel_pitch_mm={:.5} target_pitch_mm={:.4} radius_mm={:.3}",
        setup.rig.focal_mm,
        setup.rig.pixel_pitch_mm,
        setup.target().pitch_mm,
        setup.radius_mm()
    )
}

/// The scan on its way through the service.
struct Scan<'a> {
    client: Client,
    setup: &'a Setup,
    out: &'a Path,
}

impl Scan<'_> {
    async fn run(&self) -> Result<Figures> {
        let setup = self.setup;
        let (grade, profile) = self.calibrate().await?;
        let (worst_corner_px, principal_distance_mm) = score::of_profile(setup, &profile)?;
        self.send_views().await?;
        let outliers = outliers(&self.table().await?);
        let knocked = setup.knocked_view().file_stem();
        let bad = self.pictures(&self.stack_of(&knocked).await?).await?;
        self.retake().await?;

        let table = self.table().await?;
        let views = table["views"].as_array().context("a scan has views")?;
        let mut figures = Vec::new();
        note("comparing with the truth");
        for view in views {
            let name = view["name"].as_str().context("a view has a name")?;
            let fused = self.pictures(view["stack"].as_str().context("a view has a stack")?).await?;
            figures.push(ViewFigures::of(name, &fused, &self.truth(name)?)?);
        }
        let knocked_psnr_db = ViewFigures::of(&knocked, &bad, &self.truth(&knocked)?)?.psnr_db;
        let (poses, worst_centre_mm) = self.bundle().await?;
        let figures = Figures {
            grade,
            worst_corner_px,
            principal_distance_mm,
            true_principal_distance_mm: setup.rig.principal_distance(setup.rig.reference),
            views: figures,
            outliers,
            knocked,
            knocked_psnr_db,
            outliers_after_retake: self::outliers(&table),
            poses,
            worst_centre_mm,
        };
        self.write("figures.json", serde_json::to_string_pretty(&figures)?.as_bytes())?;
        Ok(figures)
    }

    /// Sends the dot target. Returns the verdict in one word and the profile.
    async fn calibrate(&self) -> Result<(String, Value)> {
        let rig = &self.setup.rig;
        let path = format!(
            "/v1/profiles/{RIG}/{LENS}/calibrations?focal_mm={}&pixel_pitch_mm={:.5}&target_pitch_mm={:.4}",
            rig.focal_mm,
            rig.pixel_pitch_mm,
            self.setup.target().pitch_mm
        );
        let zip = self.out.join(files::TARGET);
        note("calibrating");
        let made = self.client.run_job(&path, &zip).await?;
        let grade = made["result"]["grade"].as_str().unwrap_or("unknown").to_owned();
        Ok((grade, self.client.get_json(&format!("/v1/profiles/{RIG}/{LENS}")).await?))
    }

    /// Sends all views as one zip and waits until they are fused.
    async fn send_views(&self) -> Result<()> {
        let scan = json!({
            "rig": RIG, "lens": LENS, "expected_views": self.setup.views.len(), "radius_mm": self.setup.radius_mm(),
            "specimen": "rendered beetle"
        });
        self.client.put_json(&format!("/v1/scans/{SCAN}"), &scan).await?;
        note("sending the views");
        let (sent, _) = self.client.upload(&format!("/v1/scans/{SCAN}/archive"), &self.out.join(files::SCAN)).await?;
        let views = sent["views"].as_array().context("the answer lists the views")?;
        for (at, view) in views.iter().enumerate() {
            let stack = view["stack"].as_str().context("a view has a stack")?;
            note(format!("fusing view {} of {}", at + 1, views.len()));
            self.client.wait_for(stack).await?;
        }
        Ok(())
    }

    /// Sends the view with the fault again.
    async fn retake(&self) -> Result<()> {
        let angles = self.setup.knocked_view();
        let path = format!(
            "/v1/stacks?rig={RIG}&lens={LENS}&scan={SCAN}&pan_deg={}&tilt_deg={}",
            angles.pan_deg, angles.tilt_deg
        );
        let zip = self.out.join(files::RETAKE);
        note("fusing the view that was photographed again");
        self.client.run_job(&path, &zip).await?;
        Ok(())
    }

    async fn table(&self) -> Result<Value> {
        self.client.get_json(&format!("/v1/scans/{SCAN}")).await
    }

    async fn stack_of(&self, name: &str) -> Result<String> {
        let table = self.table().await?;
        let view = table["views"].as_array().into_iter().flatten().find(|view| view["name"] == name);
        let stack =
            view.and_then(|view| view["stack"].as_str()).with_context(|| format!("no view is called {name}"))?;
        Ok(stack.to_owned())
    }

    async fn pictures(&self, stack: &str) -> Result<Pictures> {
        let fetched = async |name: &str| -> Result<Raster> {
            let path = format!("{stack}/{name}");
            decoded(&self.client.get_bytes(&path).await?, &path)
        };
        Ok(Pictures { image: fetched("image").await?, mask: fetched("mask").await? })
    }

    fn truth(&self, name: &str) -> Result<Pictures> {
        let read = |name: String| -> Result<Raster> {
            let path = self.out.join(name);
            let bytes = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
            decoded(&bytes, &path.display().to_string())
        };
        Ok(Pictures { image: read(files::true_image(name))?, mask: read(files::true_mask(name))? })
    }

    /// Fetches the bundle for COLMAP and the report on its poses. Returns how many poses it has, and the largest
    /// distance from the truth in mm.
    async fn bundle(&self) -> Result<(usize, f64)> {
        let zip = self.client.get_bytes(&format!("/v1/scans/{SCAN}/bundle?layout=colmap")).await?;
        self.write("bundle.zip", &zip)?;
        let [images, _] = archive::read_files(zip, COLMAP_MODEL, &ArchiveLimits::scan())?;
        let (_, images) = images.context("the bundle has no poses")?;
        let report = self.client.post_bytes(&format!("/v1/scans/{SCAN}/poses?format=text"), images.clone()).await?;
        self.write("poses.txt", &report)?;
        score::of_poses(self.setup, &images)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.out.join(name);
        std::fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
    }
}

fn decoded(bytes: &[u8], name: &str) -> Result<Raster> {
    codec::decode_rgba(bytes, &codec::Limits::default()).with_context(|| format!("{name} cannot be read back"))
}

/// The names of the views that differ from their neighbours.
fn outliers(table: &Value) -> Vec<String> {
    let views = table["views"].as_array().into_iter().flatten();
    let views = views.filter(|view| view["outliers"].as_array().is_some_and(|outliers| !outliers.is_empty()));
    views.filter_map(|view| view["name"].as_str().map(str::to_owned)).collect()
}
