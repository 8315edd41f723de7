//! Calibration, fusion, segmentation and metrics of focus stacks.
//!
//! A *focus stack* is a set of slices of one view, each taken with the sensor (or the lens) at another rail position. A
//! *calibration profile* holds one homography per slice, which maps slice pixels to pixels of the reference slice.
//! Fusing the warped slices gives one image that is still a perspective image, which is what structure from motion
//! needs (Li and Nguyen, DICTA 2019).
//!
//! All functions are pure: no async runtime, no database, no clock. A slice comes in through [`imaging::Slices`],
//! progress and cancellation through [`types::Control`].
//!
//! # The whole method, on a rendered stack
//!
//! ```
//! use std::sync::Arc;
//!
//! use pinstack_science::{
//!     calibration::calibrate,
//!     fusion::{self, FusionRequest, Plan, SlicePlan},
//!     segmentation::{self, MaskParams},
//!     synth::{DotTarget, Light, Rendered, Rig, Scene, Stage},
//!     types::{NoControl, calibration_options::CalibrationOptions, fusion_options::Method},
//! };
//!
//! // A camera on its rail: 5 slices of 400 x 300 px. `Rendered` computes a slice when it is loaded; `archive::open`
//! // gives the slices of a zip in the same way.
//! let rig = Rig::sized(400, 300, 5);
//! let target = Rendered::target(&rig, &DotTarget::for_rig(&rig, 14));
//! let stage = Arc::new(Stage::new(&rig, &Scene::insect(1)));
//!
//! // Calibrate: one homography and one gain per slice, from photographs of a dot target.
//! let calibration = calibrate(&target, &CalibrationOptions::default(), &NoControl)?;
//! assert_eq!(calibration.slices.len(), 5);
//!
//! // Fuse: warp every slice to the reference slice, choose and blend.
//! let slices = calibration.slices.iter();
//! let plan = Plan {
//!     slices: slices.map(|s| SlicePlan { homography: s.homography, gain: s.gain, rail_mm: None }).collect(),
//!     reference: calibration.reference_index,
//!     method: Method::HaloCorrected,
//!     ..Plan::aligned(400, 300, 5)
//! };
//! let scratch = std::env::temp_dir();
//! let fuse = |light, request: &FusionRequest<'_>| {
//!     fusion::fuse(&Rendered::scene(stage.clone(), light), &plan, request, &scratch, &NoControl)
//! };
//!
//! // Segment: the silhouette of the object, from the fused back light.
//! let back = fuse(Light::Back, &FusionRequest::default())?;
//! let silhouette = segmentation::segment(&back.image, &back.valid, &MaskParams::default_for(400, 300));
//!
//! // Measure: the metrics of the front light, within the silhouette.
//! let wanted = FusionRequest { metrics: true, object: Some(&silhouette.mask), ..FusionRequest::default() };
//! let fused = fuse(Light::Front, &wanted)?;
//! let quality = fused.quality.expect("the metrics were requested");
//! assert_eq!(quality.slices.len(), 5);
//! # Ok::<(), pinstack_science::types::Interrupted>(())
//! ```

#![warn(unreachable_pub, clippy::disallowed_types, clippy::print_stdout, clippy::print_stderr)]

pub mod imaging;
pub mod target;
pub mod types;

pub mod calibration;
pub mod fusion;
pub mod quality;
pub mod segmentation;
pub mod synth;

pub mod archive;
pub mod hull;
pub mod optics;
pub mod photogrammetry;
