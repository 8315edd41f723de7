//! One case of the comparison in docs/POSES.md: which lens moves, how slices are aligned, how they are fused.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
    process::Command,
};

use pinstack_science::{synth::Rig, types::view::ViewAngles};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::{
    colmap::{Accuracy, reconstruct},
    run::run,
    server::Server,
    setup::{PANS, SLICES, Setup, Sharp, TILTS, WIDTH, image_of, mask_of},
};

/// What moves between the slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lens {
    /// The sensor: one centre of projection.
    Fixed,
    /// Camera and lens together.
    Moving,
}

/// Where the homographies come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alignment {
    /// No slices: what an ideal camera would store.
    Ideal,
    /// No slices: what an ideal camera with the noise and the JPEG files of the real one would store.
    Noisy,
    /// The calibration of the service.
    Calibrated,
    /// An affine transform to the neighbouring slice by image content (ECC), as most focus stackers do.
    Ecc,
    /// The identity.
    None,
}

/// The camera that COLMAP gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Camera {
    /// That of the rig.
    True,
    /// That of the bundle of the service, which the calibration has measured; then the same pictures with the true one.
    Bundle,
}

/// A case, written as `seed=1 width=810 pans=18 tilts=0,8,16 lens=fixed pupil_ratio=1 alignment=calibrated camera=true
/// method=halo_corrected limit=4`. Everything may be left out.
#[derive(Debug, Clone)]
pub struct Case {
    seed: u64,
    width: usize,
    pans: usize,
    tilts: Vec<f64>,
    lens: Lens,
    pupil_ratio: f64,
    alignment: Alignment,
    camera: Camera,
    method: String,
    /// Error of reprojection beyond which COLMAP leaves observations out, px; its default without.
    limit_px: Option<f64>,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seed, width, pans, tilts, lens, pupil_ratio, alignment, camera, method, limit_px } = self;
        write!(f, "seed {seed}, {width} px, {pans} pans, tilts {tilts:?}, {lens:?} lens, pupil ratio {pupil_ratio}, ")?;
        write!(f, "{alignment:?}, {camera:?} camera, {method}")?;
        limit_px.map_or(Ok(()), |px| write!(f, ", limit {px} px"))
    }
}

impl Case {
    pub fn of(text: &str) -> Self {
        let mut case = Self {
            seed: 1,
            width: WIDTH,
            pans: PANS,
            tilts: TILTS.to_vec(),
            lens: Lens::Fixed,
            pupil_ratio: 1.0,
            alignment: Alignment::Calibrated,
            camera: Camera::True,
            method: "halo_corrected".into(),
            limit_px: None,
        };
        for setting in text.split_whitespace() {
            match setting.split_once('=').unwrap_or_else(|| panic!("{setting} has no =")) {
                ("seed", seed) => case.seed = seed.parse().expect("a whole number"),
                ("width", width) => case.width = width.parse().expect("a whole number"),
                ("pans", pans) => case.pans = pans.parse().expect("a whole number"),
                ("tilts", tilts) => case.tilts = tilts.split(',').map(|tilt| tilt.parse().expect("degrees")).collect(),
                ("lens", "fixed") => case.lens = Lens::Fixed,
                ("lens", "moving") => case.lens = Lens::Moving,
                ("pupil_ratio", ratio) => case.pupil_ratio = ratio.parse().expect("a number"),
                ("camera", "true") => case.camera = Camera::True,
                ("camera", "bundle") => case.camera = Camera::Bundle,
                ("alignment", "ideal") => case.alignment = Alignment::Ideal,
                ("alignment", "noisy") => case.alignment = Alignment::Noisy,
                ("alignment", "calibrated") => case.alignment = Alignment::Calibrated,
                ("alignment", "ecc") => case.alignment = Alignment::Ecc,
                ("alignment", "none") => case.alignment = Alignment::None,
                ("limit", limit) => case.limit_px = Some(limit.parse().expect("px")),
                ("method", method) => case.method = method.to_owned(),
                other => panic!("no setting {other:?}"),
            }
        }
        let has_bundle = case.camera == Camera::True || case.alignment == Alignment::Calibrated;
        assert!(has_bundle, "camera=bundle needs alignment=calibrated");
        case
    }

    /// Renders, fuses, reconstructs. Pictures and model are left in `folder` if there is one, with `surface.ply`, the
    /// true surface of the specimen.
    pub fn run(&self, folder: Option<&Path>) -> Accuracy {
        let mut setup = Setup::new(self.width, SLICES, self.pans, &self.tilts, self.seed);
        setup.rig.pupil_ratio = self.pupil_ratio;
        if self.lens == Lens::Moving {
            setup.rig = setup.rig.moving_lens();
        }
        let server = Server::start();
        let folder = folder.map_or_else(|| server.folder.path().join("case"), PathBuf::from);
        fs::create_dir_all(&folder).expect("a folder");
        setup.write_surface(&folder.join("surface.ply"));
        match self.alignment {
            Alignment::Ideal => setup.write_ideal(&folder, Sharp::Truth),
            Alignment::Noisy => setup.write_ideal(&folder, Sharp::Stored),
            _ => self.fuse(&setup, &server, &folder),
        }
        let path = format!("/v1/poses?expected={}", setup.views.len());
        let accuracy = |folder: &Path| {
            let poses = reconstruct(folder, self.limit_px);
            Accuracy::of(&server.curl(&["--data-binary", &format!("@{}", poses.display())], &path))
        };
        if self.camera == Camera::True {
            return accuracy(&folder);
        }
        let [bundle, truth] = [accuracy(&folder.join(BUNDLE)), accuracy(&folder)];
        println!("with the true camera: {truth}; bundle over true: {:.3?}", bundle.ratios(&truth));
        bundle
    }

    /// Renders the stacks of all views as zips, unless `SCAN_STACKS` names a folder where an earlier case left them.
    fn stacks(&self, setup: &Setup, temporary: &Path) -> Vec<(ViewAngles, PathBuf)> {
        let Self { seed, width, lens, pupil_ratio, .. } = self;
        let folder = match std::env::var_os("SCAN_STACKS") {
            Some(kept) => PathBuf::from(kept).join(format!("{lens:?}_{pupil_ratio}_{seed}_{width}")),
            None => temporary.join("stacks"),
        };
        fs::create_dir_all(&folder).expect("a folder");
        // rendering uses all cores; sending does not wait for it
        let rendered = setup.views.par_iter().map(|&angles| {
            let zip = folder.join(format!("{}.zip", angles.file_stem()));
            if !zip.exists() {
                let unfinished = zip.with_extension("part");
                setup.write_stack(angles, &unfinished);
                fs::rename(unfinished, &zip).expect("renamed");
            }
            (angles, zip)
        });
        rendered.collect()
    }

    fn fuse(&self, setup: &Setup, server: &Server, folder: &Path) {
        setup.write_bundle(folder);
        match self.alignment {
            Alignment::Calibrated => setup.calibrate(server, server.folder.path()),
            Alignment::None => put_profile(server, &setup.rig, "lens", &vec![IDENTITY; setup.rig.slices()]),
            // one profile per view
            Alignment::Ecc | Alignment::Ideal | Alignment::Noisy => {}
        }
        if self.camera == Camera::Bundle {
            put_scan(server);
        }
        let zips = self.stacks(setup, server.folder.path());
        let stacks: Vec<(ViewAngles, Value)> = zips
            .iter()
            .map(|(angles, zip)| {
                let lens = match self.alignment {
                    Alignment::Ecc => {
                        let lens = angles.file_stem();
                        put_profile(server, &setup.rig, &lens, &ecc(zip, setup.rig.reference));
                        lens
                    }
                    _ => "lens".to_owned(),
                };
                let ViewAngles { pan_deg, tilt_deg } = angles;
                let view = match self.camera {
                    Camera::True => String::new(),
                    Camera::Bundle => format!("&scan=beetle&pan_deg={pan_deg}&tilt_deg={tilt_deg}"),
                };
                let query = format!("/v1/stacks?rig=rig&lens={lens}&method={}{view}", self.method);
                (*angles, server.curl(&["-X", "POST", "-T", zip.to_str().expect("plain")], &query))
            })
            .collect();
        for (angles, stack) in &stacks {
            let stack = server.finished(stack);
            assert_eq!(stack["state"], "succeeded", "{stack}");
            let path = stack["links"]["self"].as_str().expect("a path");
            server.download(&["-H", "Accept: image/png"], &format!("{path}/image"), &folder.join(image_of(*angles)));
            server.download(&[], &format!("{path}/mask"), &folder.join(mask_of(*angles)));
        }
        if self.camera == Camera::Bundle {
            let zip = server.folder.path().join("bundle.zip");
            server.download(&[], "/v1/scans/beetle/bundle?layout=colmap", &zip);
            let file = fs::File::open(&zip).expect("the bundle");
            zip::ZipArchive::new(file).expect("a zip").extract(folder.join(BUNDLE)).expect("extracted");
        }
    }
}

/// The folder of the bundle of the service.
const BUNDLE: &str = "bundle";
const IDENTITY: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

/// Makes the scan that the views belong to.
fn put_scan(server: &Server) {
    let scan = json!({ "rig": "rig", "lens": "lens" }).to_string();
    server.curl(&["-X", "PUT", "-H", "Content-Type: application/json", "-d", &scan], "/v1/scans/beetle");
}

/// Stores these homographies, with the true gains: only the geometry differs between the cases.
fn put_profile(server: &Server, rig: &Rig, lens: &str, homographies: &[[f64; 9]]) {
    let body = json!({
        "image_width": rig.width, "image_height": rig.height, "reference_index": rig.reference,
        "homographies": homographies, "gains": (0..rig.slices()).map(|i| rig.gain(i)).collect::<Vec<_>>(),
    });
    let arguments = ["-X", "PUT", "-H", "Content-Type: application/json", "-d", &body.to_string()];
    let profile = server.curl(&arguments, &format!("/v1/profiles/rig/{lens}"));
    assert!(profile["revision"].is_number(), "{profile}");
}

/// Slice px -> reference px by OpenCV's `findTransformECC`, from the front-lit slices of a stack.
fn ecc(stack: &Path, reference: usize) -> Vec<[f64; 9]> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = fs::File::open(stack).expect("the stack");
    zip::ZipArchive::new(file).expect("a zip").extract(folder.path()).expect("extracted");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/clients/scan/ecc.py");
    let mut python = Command::new("python3");
    python.arg(script).arg(folder.path().join("front")).arg(reference.to_string());
    serde_json::from_str(&run(&mut python)).expect("homographies")
}
