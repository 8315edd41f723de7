//! A thicket: blades and bristles at many depths that cross each other everywhere.

use super::super::noise::{between, key};
use super::{Part, Pattern, Relief, Scene, Shape, Skin, Stroke};

/// Layers, far to near: every other one is a blade, the others are bundles of bristles.
const LAYERS: u64 = 28;

pub(super) fn scene(seed: u64) -> Scene {
    let parts = (0..LAYERS)
        .map(|layer| {
            let depth = 0.96 - 0.92 * layer as f64 / (LAYERS - 1) as f64;
            if layer % 2 == 0 { blade(seed, layer, depth) } else { bristles(seed, layer, depth) }
        })
        .collect();
    Scene::of(parts, [0.52, 0.55, 0.47], seed)
}

/// A long leaf across the thicket, one end nearer than the other.
fn blade(seed: u64, layer: u64, depth: f64) -> Part {
    let random = |what: u64, low: f64, high: f64| between(key(&[seed, 0xb1ade, layer, what]), low, high);
    let turn = random(0, 0.0, std::f64::consts::TAU);
    let (middle, half) = ([random(1, -0.42, 0.42), random(2, -0.26, 0.26)], random(3, 0.24, 0.42));
    let end = |side: f64| [middle[0] + side * half * turn.cos(), middle[1] + side * half * turn.sin()];
    let (from, to) = (end(-1.0), end(1.0));
    let green = random(4, 0.0, 1.0) as f32;
    Part {
        shape: Shape::Blade { from, to, half_width: random(5, 0.022, 0.045), fullness: random(6, 0.3, 0.7) },
        holes: Vec::new(),
        relief: Relief::Along { from, to, depths: [depth - 0.02, depth + 0.02] },
        skin: Skin {
            base: [0.16 + 0.35 * green, 0.34 + 0.1 * green, 0.10],
            accent: [0.50, 0.58 - 0.2 * green, 0.22],
            pattern: if layer.is_multiple_of(4) { Pattern::Veined(24.0) } else { Pattern::Striped(110.0) },
            grain: 0.7,
            gloss: 0.08,
            seed: key(&[seed, 0xb1adf, layer]),
        },
    }
}

/// Bristles of 1 to 4 px in pictures of ordinary size, all at about one depth.
fn bristles(seed: u64, layer: u64, depth: f64) -> Part {
    let strokes = (0..7)
        .map(|bristle| {
            let random =
                |what: u64, low: f64, high: f64| between(key(&[seed, 0xb2157, layer, bristle, what]), low, high);
            let from = [random(0, -0.6, 0.6), random(1, -0.42, 0.42)];
            let (turn, length) = (random(2, 0.0, std::f64::consts::TAU), random(3, 0.2, 0.6));
            let radius = random(4, 0.0012, 0.0045);
            let to = [from[0] + length * f64::cos(turn), from[1] + length * f64::sin(turn)];
            Stroke { from, to, radii: [radius, 0.4 * radius] }
        })
        .collect();
    let pale = between(key(&[seed, 0xb2158, layer]), 0.0, 1.0) as f32;
    Part {
        shape: Shape::Strokes(strokes),
        holes: Vec::new(),
        relief: Relief::Along { from: [-0.5, -0.3], to: [0.5, 0.3], depths: [depth + 0.03, depth - 0.03] },
        skin: Skin {
            base: [0.10 + 0.55 * pale, 0.07 + 0.50 * pale, 0.05 + 0.35 * pale],
            accent: [0.42, 0.28, 0.14],
            pattern: Pattern::Mottled,
            grain: 0.6,
            gloss: 0.2,
            seed: key(&[seed, 0xb2159, layer]),
        },
    }
}
