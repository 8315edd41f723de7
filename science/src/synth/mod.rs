//! Synthetic focus stacks with ground truth, rendered with a thin-lens model.
//!
//! In: a [`Rig`] (the camera on its rail) and its subject, a [`Scene`] or a [`DotTarget`]. Out: each slice as a camera
//! would store it, and the ground truth with which calibration, fusion and segmentation are evaluated. The same input
//! gives the same bytes on any number of threads.
//!
//! The sensor is linear unless [`Flaws::gamma`] or [`Faults::filmic`] is set: sample values are proportional to light,
//! so occlusion, exposure and [`Rig::gain`] are exact multiplications of stored values.
//!
//! The renderer has its own blur and its own interpolation: the ground truth must not share code with the methods that
//! it evaluates.

mod bake;
mod disc;
mod noise;
mod rig;
pub mod scene;
mod sensor;
mod stack;
mod stage;
mod target;
#[cfg(test)]
mod tests;
pub mod turntable;

pub use rig::{Alone, Rig};
pub use scene::Scene;
pub use sensor::Light;
pub use stack::{Rendered, render, target_stack, truth};
pub use stage::{Stage, Truth};
pub use target::{Banding, DotTarget, Faults, Flaws, Glare, Kernel, Moved, Replacement, Surround, render_target};
