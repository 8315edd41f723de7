//! Dark parts with bright rims before a black ground: mandibles in glancing light.

use super::super::noise::{between, key};
use super::{Part, Pattern, Relief, Scene, Shape, Skin};

/// Width of the rims, in units of the shorter side of the picture.
const RIM: f64 = 0.014;

pub(super) fn scene(seed: u64) -> Scene {
    let mut parts = Vec::new();
    for (i, side) in [-1.0, 1.0].into_iter().enumerate() {
        let random = |what: u64, low: f64, high: f64| between(key(&[seed, 0x2143, i as u64, what]), low, high);
        let centre = [0.34 * side + random(0, -0.03, 0.03), random(1, -0.06, 0.06)];
        let (radii, angle) = ([random(2, 0.19, 0.23), random(3, 0.26, 0.31)], random(4, -0.4, 0.4));
        // one dome is nearer than the other
        let depth = 0.62 - 0.2 * i as f64;
        let relief = Relief::Dome {
            centre,
            depth,
            slope: [random(5, -0.06, 0.06), random(6, -0.12, 0.12)],
            bulge: 0.04,
            radius: 0.9 * radii[0],
        };
        let part = |radii: [f64; 2], base: [f32; 3], accent: [f32; 3], what: u64| Part {
            shape: Shape::Ellipse { centre, radii, angle },
            holes: Vec::new(),
            relief,
            skin: Skin {
                base,
                accent,
                pattern: Pattern::Mottled,
                grain: 0.5,
                gloss: 0.0,
                seed: key(&[seed, 0x2144, i as u64, what]),
            },
        };
        parts.push(part(radii, [0.86, 0.74, 0.55], [0.95, 0.9, 0.8], 0));
        parts.push(part(radii.map(|radius| radius - RIM), [0.16, 0.1, 0.07], [0.3, 0.2, 0.13], 1));
    }
    Scene { clouds: 0.0, ..Scene::of(parts, [0.055, 0.05, 0.055], seed) }
}
