//! The synthetic rig: a thin-lens renderer that makes focus stacks of which everything is known.
//!
//! A [`Rig`] is the camera on its rail, a [`DotTarget`] and a [`Scene`] are what can stand before it. The
//! renderer gives each slice as a camera would store it, and beside it the truth that calibration, fusion
//! and masking are judged by. The same input gives the same bytes on any number of threads.
//!
//! The sensor is linear: sample values are proportional to light (no gamma curve), so that occlusion,
//! exposure and [`Rig::gain`] are exact multiplications of stored values.

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

pub use rig::Rig;
pub use scene::Scene;
pub use sensor::Light;
pub use stack::{Rendered, render, target_stack, truth};
pub use stage::{Stage, Truth};
pub use target::{DotTarget, Flaws, Glare, Surround, render_target};
