//! A rendered turntable scan: what the camera would store, and what an ideal camera would.

use std::{fs, path::Path};

use pinstack_science::{
    archive::pack,
    imaging::{
        Raster, Samples,
        codec::{self, Metadata},
    },
    photogrammetry::bundle::{self, BundleScan, BundleView, Content, Layout},
    synth::{
        DotTarget, Light, Rig, render_target,
        turntable::{self, Specimen, Surface},
    },
    types::{intrinsics::Intrinsics, profile::CaptureMode, view::ViewAngles},
};
use rayon::prelude::*;

use crate::server::Server;

/// Steps of pan around the axis, and the tilts.
pub const PANS: usize = 18;
pub const TILTS: [f64; 3] = [0.0, 8.0, 16.0];
pub const WIDTH: usize = 810;
pub const SLICES: usize = 9;

/// JPEG quality of the slices, that of the setting "fine" of cameras.
const QUALITY: u8 = 95;
/// Dots of the target from left to right.
const TARGET_COLUMNS: usize = 19;

/// How much nearer to the lens the target is in one more picture, which measures the principal distance, mm.
const TARGET_ADVANCE_MM: f64 = 5.0;

/// Length of the edges of the true surface: two pixels.
const SURFACE_EDGE_MM: f64 = 0.1;

/// The pictures of an ideal camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharp {
    /// Without noise, as PNG.
    Truth,
    /// With the noise of the sensor, and stored as JPEG once, as a slice is.
    Stored,
}

/// What is photographed, and how.
#[derive(Debug, Clone)]
pub struct Setup {
    pub rig: Rig,
    pub specimen: Specimen,
    pub views: Vec<ViewAngles>,
}

impl Setup {
    /// Views at every combination of `pans` equal steps around the axis and the tilts.
    pub fn new(width: usize, slices: usize, pans: usize, tilts: &[f64], seed: u64) -> Self {
        let angles = |tilt_deg: f64| {
            (0..pans).map(move |pan| ViewAngles { pan_deg: 360.0 * pan as f64 / pans as f64, tilt_deg })
        };
        Self {
            rig: Rig { seed, ..turntable::scan_rig(width, slices) },
            specimen: Specimen::beetle(seed),
            views: tilts.iter().flat_map(|&tilt| angles(tilt)).collect(),
        }
    }

    pub fn radius_mm(&self) -> f64 {
        turntable::scan_radius(&self.rig)
    }

    /// The dot target that the rig is calibrated with. No edge of it is in view, so its dots carry a code.
    pub fn target(&self) -> DotTarget {
        DotTarget { code: Some([0, 0]), ..DotTarget::for_rig(&self.rig, TARGET_COLUMNS) }
    }

    /// Sends the dot target and waits for a calibration that is good.
    pub fn calibrate(&self, server: &Server, folder: &Path) {
        let zip = folder.join("target.zip");
        self.write_target(&zip);
        let mode = match self.rig.mode {
            CaptureMode::FixedLens => "fixed_lens",
            CaptureMode::MovingLens => "moving_lens",
            CaptureMode::LensAlone => "lens_alone",
        };
        let path = format!(
            "/v1/profiles/rig/lens/calibrations?capture_mode={mode}&focal_mm={}&pixel_pitch_mm={}&target_pitch_mm={}\
             &target_advance_mm={TARGET_ADVANCE_MM}",
            self.rig.focal_mm,
            self.rig.pixel_pitch_mm,
            self.target().pitch_mm
        );
        let made = server.curl(&["-X", "POST", "-T", zip.to_str().expect("plain")], &path);
        let made = server.finished(&made);
        assert_eq!(made["state"], "succeeded", "{made}");
        let profile = server.curl(&[], "/v1/profiles/rig/lens");
        let distance = profile["principal_distance_mm"].as_f64().expect("the distance from the lens to the sensor");
        let expected = self.rig.principal_distance(self.rig.reference);
        println!("principal distance {distance:.4} mm, truly {expected:.4} mm");
        assert!((distance / expected - 1.0).abs() < 2e-3, "{distance} mm, truly {expected} mm");
    }

    /// Writes the slices of the target as a zip, with a picture of the target moved towards the lens.
    pub fn write_target(&self, zip: &Path) {
        let Self { rig, .. } = self;
        let target = self.target();
        let distance_mm = rig.object_distance(rig.focus_fraction(rig.reference));
        let near = DotTarget { depth: Some(rig.depth_of(distance_mm - TARGET_ADVANCE_MM)), ..target.clone() };
        let slice = |i: usize| (format!("front/dots_{i:02}.jpg"), jpeg(&render_target(rig, &target, i)));
        let mut slices: Vec<(String, Vec<u8>)> = (0..rig.slices()).into_par_iter().map(slice).collect();
        slices.push(("moved/near.jpg".into(), jpeg(&render_target(rig, &near, rig.reference))));
        write_zip(slices, zip);
    }

    /// Writes the slices of all views as one zip, with a folder per view and light.
    pub fn write_scan(&self, zip: &Path) {
        let members = self.views.par_iter().flat_map(|&angles| {
            let folder = angles.file_stem();
            self.slices(angles).into_iter().map(|(name, file)| (format!("{folder}/{name}"), file)).collect::<Vec<_>>()
        });
        write_zip(members.collect(), zip);
    }

    /// Writes the slices of one view as a zip.
    pub fn write_stack(&self, angles: ViewAngles, zip: &Path) {
        write_zip(self.slices(angles), zip);
    }

    /// The slices of one view as the camera stores them: `front/slice_00.jpg`, ..., `back/slice_00.jpg`, ...
    pub fn slices(&self, angles: ViewAngles) -> Vec<(String, Vec<u8>)> {
        let stage = turntable::view(&self.rig, &self.specimen, angles);
        let lights = [("front", Light::Front), ("back", Light::Back)];
        let all = lights.into_iter().flat_map(|light| (0..self.rig.slices()).map(move |i| (light, i)));
        all.map(|((name, light), i)| (format!("{name}/slice_{i:02}.jpg"), jpeg(&stage.render(light, i)))).collect()
    }

    /// Writes the true surface of the specimen, in mm, in the coordinates of the poses of a bundle.
    pub fn write_surface(&self, path: &Path) {
        let file = fs::File::create(path).expect("a file");
        Surface::of(&self.specimen, SURFACE_EDGE_MM).write_ply(std::io::BufWriter::new(file)).expect("written");
    }

    /// Writes the bundle for COLMAP of what an ideal camera, with everything in focus, would store of each view.
    pub fn write_ideal(&self, folder: &Path, sharp: Sharp) {
        self.write_bundle(folder);
        // so small an aperture that no blur is left
        let pinhole = Rig { f_number: 1e4 * self.rig.f_number, ..self.rig.clone() };
        self.views.par_iter().for_each(|&angles| {
            let truth = turntable::view(&self.rig, &self.specimen, angles).truth();
            let mut sharp = match sharp {
                Sharp::Truth => truth.sharp,
                Sharp::Stored => {
                    let stage = turntable::view(&pinhole, &self.specimen, angles);
                    let file = jpeg(&stage.render(Light::Front, self.rig.reference));
                    codec::decode(&file, &codec::Limits::default()).expect("a JPEG")
                }
            };
            black_outside(&mut sharp, &truth.mask.data);
            let mask = Raster::eight(truth.mask.width, truth.mask.height, 1, truth.mask.data);
            write_png(&folder.join(image_of(angles)), &sharp);
            write_png(&folder.join(mask_of(angles)), &mask);
        });
    }

    /// Writes all of a bundle for COLMAP but the pictures: README, camera, pairs of views; makes the folders for them.
    pub fn write_bundle(&self, folder: &Path) {
        let distance_mm = self.rig.principal_distance(self.rig.reference);
        let view = |&angles: &ViewAngles| BundleView {
            stem: angles.file_stem(),
            extension: "png".into(),
            bit_depth: 8,
            has_mask: true,
            angles: Some(angles),
        };
        let scan = BundleScan {
            name: "beetle".into(),
            width: self.rig.width as u32,
            height: self.rig.height as u32,
            intrinsics: Some(Intrinsics {
                principal_distance_px: distance_mm / self.rig.pixel_pitch_mm,
                principal_distance_mm: distance_mm,
                principal_distance_sigma_mm: Some(1e-3 * distance_mm),
                pixel_pitch_mm: self.rig.pixel_pitch_mm,
                principal_point_px: None,
                distortion: None,
            }),
            canvas_centre_px: self.rig.centre(),
            radius_mm: Some(self.radius_mm()),
            pan_is_clockwise: false,
            views: self.views.iter().map(view).collect(),
        };
        for folder in ["images", "masks", "sparse/0"].map(|name| folder.join(name)) {
            fs::create_dir_all(folder).expect("a folder");
        }
        for entry in bundle::plan(Layout::Colmap, &scan).expect("a bundle") {
            let Content::Text(text) = entry.content else { continue };
            fs::write(folder.join(entry.path), text).expect("written");
        }
    }
}

/// Where the image of a view is in a bundle for COLMAP.
pub fn image_of(angles: ViewAngles) -> String {
    format!("images/{}.png", angles.file_stem())
}

/// Where the mask of a view is in a bundle for COLMAP.
pub fn mask_of(angles: ViewAngles) -> String {
    format!("masks/{}.png.png", angles.file_stem())
}

fn write_png(path: &Path, picture: &Raster) {
    let mut png = Vec::new();
    codec::encode_png(&mut png, picture, &Metadata::default()).expect("a PNG");
    fs::write(path, png).expect("written");
}

fn black_outside(picture: &mut Raster, mask: &[u8]) {
    let Samples::Eight(samples) = &mut picture.samples else { panic!("rendered with 8 bits") };
    for (pixel, &mask) in samples.chunks_exact_mut(picture.channels).zip(mask) {
        if mask == 0 {
            pixel.fill(0);
        }
    }
}

fn jpeg(picture: &Raster) -> Vec<u8> {
    codec::encode_jpeg(picture, QUALITY)
}

fn write_zip(members: Vec<(String, Vec<u8>)>, path: &Path) {
    pack(fs::File::create(path).expect("a file"), members.into_iter()).expect("a zip");
}
