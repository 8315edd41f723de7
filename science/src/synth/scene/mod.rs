//! The subject of a rendered stack: parts, each with a shape, a relief and a skin.
//!
//! Scene coordinates do not depend on a rig: the origin is the centre of the image, x points right, y down, and the
//! unit is the shorter side of the reference image. Depth is the fraction 0..1 of the focus range of the rig (see
//! [`Rig`](super::Rig)).

mod flower;
mod insect;
mod parts;
mod plates;
mod rim;
mod shape;
mod skin;
mod weave;
mod wing;

pub use parts::{Part, Relief, Scene};
pub use shape::{Shape, Stroke};
pub use skin::{Pattern, Skin};

impl Scene {
    /// A beetle on a gnawed leaf: domed wing cases, jointed legs at different depths, antennae, bristles.
    pub fn insect(seed: u64) -> Self {
        insect::scene(seed)
    }

    /// A flower head seen aslant: two rings of petals, a domed middle, stamens that reach to the camera.
    pub fn flower(seed: u64) -> Self {
        flower::scene(seed)
    }

    /// Nine overlapping plates at hard steps of depth, with windows in them and hairs across.
    pub fn plates(seed: u64) -> Self {
        plates::scene(seed)
    }

    /// Two dark domes with bright rims before a black ground. It is not one of [`SCENES`]: it serves tests.
    pub fn rim(seed: u64) -> Self {
        rim::scene(seed)
    }

    /// A thicket of blades and bristles that cross each other at many depths.
    pub fn weave(seed: u64) -> Self {
        weave::scene(seed)
    }

    /// A body in segments between two veined membranes, one behind it and one before it, and a net of bare veins in
    /// front.
    pub fn wing(seed: u64) -> Self {
        wing::scene(seed)
    }
}

/// A scene from a seed.
pub type SceneFromSeed = fn(u64) -> Scene;

/// The scenes that fusion is evaluated on, by name. Each is difficult in another way. [`Scene::rim`] is for tests only.
pub const SCENES: [(&str, SceneFromSeed); 5] = [
    ("insect", Scene::insect),
    ("flower", Scene::flower),
    ("plates", Scene::plates),
    ("weave", Scene::weave),
    ("wing", Scene::wing),
];
