//! From a model of COLMAP to the numbers and files of a reconstruction.

use std::io::{self, Write};

use serde::Serialize;

use super::{
    commands::Features,
    findings::Evidence,
    model::{Errors, Image, Model},
    turntable::Placed,
};
use crate::contract::reconstruction::{ReconstructedView, ReconstructionRequest, ReconstructionResult};
use pinstack_science::{
    photogrammetry::poses::{Commanded, Distance, KnownScale, PoseOptions, PoseReport},
    types::view::ViewAngles,
};

/// What a run of COLMAP found.
pub(super) struct Found {
    /// `COLMAP 3.8`.
    pub program: String,
    pub features: Features,
    /// Numbers of registered views of all models, the largest first.
    pub parts: Vec<u64>,
    /// The largest model; empty when there is none.
    pub model: Model,
    /// The report on its poses; `None` when there is none.
    pub poses: Option<PoseReport>,
}

/// What is known of the poses, for their report.
pub(super) fn pose_options(request: &ReconstructionRequest) -> PoseOptions {
    let commanded = request.views.iter().map(|view| Commanded {
        name: view.name.clone(),
        angles_deg: view.angles.map(|angles| [angles.pan_deg, angles.tilt_deg]),
    });
    let principal_distance = request.intrinsics.map(|camera| {
        let to_px = camera.principal_distance_px / camera.principal_distance_mm;
        let sigma_px = camera.principal_distance_sigma_mm.map(|sigma| to_px * sigma);
        Distance { px: camera.principal_distance_px, sigma_px }
    });
    PoseOptions {
        expected: Some(request.expected),
        scale: request.radius_mm.map(|mm| KnownScale::Radius { mm }),
        principal_distance,
        commanded: commanded.collect(),
        ..PoseOptions::default()
    }
}

impl Found {
    /// The numbers of the reconstruction.
    pub(super) fn result(&self, request: &ReconstructionRequest) -> ReconstructionResult {
        let errors: Vec<Errors> = self.model.images.iter().map(|image| self.model.errors(image)).collect();
        let views: Vec<ReconstructedView> = request
            .views
            .iter()
            .map(|asked| {
                let file = format!("{}.{}", asked.name, asked.extension);
                let at = self.model.images.iter().position(|image| image.name == file);
                let errors = at.and_then(|at| errors.get(at));
                let features = self.features.of_images.iter().find(|(name, _)| *name == file);
                let pose = self.poses.iter().flat_map(|report| &report.views).find(|pose| pose.name == file);
                ReconstructedView {
                    name: asked.name.clone(),
                    stack: asked.stack,
                    registered: at.is_some(),
                    features: features.map(|(_, count)| *count),
                    points: errors.map(|errors| u32::try_from(errors.count).unwrap_or(u32::MAX)),
                    mean_error_px: errors.and_then(|errors| errors.mean()),
                    radial: pose.and_then(|pose| pose.radial_residual),
                    tangential: pose.and_then(|pose| pose.tangential_residual),
                }
            })
            .collect();
        let total = errors.iter().fold(Errors::default(), |sum, errors| sum.add(*errors));
        let placed = self.placed(request);
        let poses = self.poses.as_ref();
        let evidence = Evidence { request, views: &views, parts: &self.parts, placed: &placed, poses };
        let findings = evidence.findings();
        ReconstructionResult {
            registered: u32::try_from(views.iter().filter(|view| view.registered).count()).unwrap_or(u32::MAX),
            expected: request.expected,
            points: u32::try_from(self.model.points.len()).unwrap_or(u32::MAX),
            observations: total.count,
            mean_error_px: total.mean(),
            focal_px: self.model.images.first().and_then(|image| Some(self.model.camera(image)?.focal[0])),
            unit: poses.map(|report| report.scale.unit),
            hull: None,
            program: self.program.clone(),
            views,
            findings,
        }
    }

    fn image(&self, file: &str) -> Option<&Image> {
        self.model.images.iter().find(|image| image.name == file)
    }

    /// The registered views whose pan and tilt are known.
    fn placed(&self, request: &ReconstructionRequest) -> Vec<Placed> {
        let placed = request.views.iter().filter_map(|asked| {
            let image = self.image(&format!("{}.{}", asked.name, asked.extension))?;
            let ViewAngles { pan_deg, tilt_deg } = asked.angles?;
            let pan_deg = if request.pan_is_clockwise { -pan_deg } else { pan_deg };
            let angles = ViewAngles { pan_deg, tilt_deg };
            Some(Placed { name: asked.name.clone(), angles, rotation: image.rotation, centre: image.centre() })
        });
        placed.collect()
    }

    /// The document of the cameras.
    pub(super) fn cameras(&self, request: &ReconstructionRequest) -> Cameras {
        let cameras = request.views.iter().map(|asked| {
            let image = self.image(&format!("{}.{}", asked.name, asked.extension));
            let camera = image.and_then(|image| self.model.camera(image));
            let [width, height] = request.image_size_px;
            CameraOfView {
                name: asked.name.clone(),
                stack: Some(asked.stack.to_string()).filter(|_| !asked.stack.is_nil()),
                registered: image.is_some(),
                center: image.map(Image::centre),
                rotation: image.map(|image| image.rotation.concat()),
                width,
                height,
                focal_px: camera.map(|camera| (camera.focal[0] + camera.focal[1]) / 2.0),
                // COLMAP counts from the corner of the top-left pixel
                principal_point: camera.map(|camera| camera.centre.map(|c| c - 0.5)),
            }
        });
        let turntable = self.poses.as_ref().and_then(|report| {
            let surface = report.surface?;
            let radius = surface.radius / report.scale.per_file_unit;
            Some(Turntable { center: surface.centre, axis: report.axis?, radius })
        });
        Cameras { cameras: cameras.collect(), turntable }
    }

    /// Writes the points as PLY, in the order of their ids.
    pub(super) fn write_points(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut ids: Vec<&u64> = self.model.points.keys().collect();
        ids.sort_unstable();
        write!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", ids.len())?;
        for axis in ["x", "y", "z"] {
            writeln!(out, "property float {axis}")?;
        }
        for colour in ["red", "green", "blue"] {
            writeln!(out, "property uchar {colour}")?;
        }
        writeln!(out, "end_header")?;
        for point in ids.into_iter().filter_map(|id| self.model.points.get(id)) {
            for coordinate in point.position {
                out.write_all(&(coordinate as f32).to_le_bytes())?;
            }
            out.write_all(&point.colour)?;
        }
        Ok(())
    }
}

/// The document of the cameras, in the world and the unit of the model.
#[derive(Debug, Serialize)]
pub(super) struct Cameras {
    cameras: Vec<CameraOfView>,
    turntable: Option<Turntable>,
}

/// A camera. What is not known of a view that is not registered is null.
#[derive(Debug, Serialize)]
struct CameraOfView {
    name: String,
    stack: Option<String>,
    registered: bool,
    /// Centre of projection.
    center: Option<[f64; 3]>,
    /// World to camera, by rows.
    rotation: Option<Vec<f64>>,
    width: u32,
    height: u32,
    focal_px: Option<f64>,
    /// The centre of the top-left pixel is (0, 0).
    principal_point: Option<[f64; 2]>,
}

/// The sphere or circle of the turntable.
#[derive(Debug, Serialize)]
struct Turntable {
    center: [f64; 3],
    axis: [f64; 3],
    radius: f64,
}
