//! A body between two veined membranes, one behind it and one before it, and a net of bare veins through whose meshes
//! the body is seen.

use super::super::noise::{between, key};
use super::{Part, Pattern, Relief, Scene, Shape, Skin, Stroke};

pub(super) fn scene(seed: u64) -> Scene {
    let mut parts = vec![membrane(seed, 0, [0.02, -0.05], [0.56, -0.34], [0.80, 0.97])];
    // segments of the body from tail to head
    for segment in 0..5 {
        parts.push(body(seed, segment));
    }
    parts.push(membrane(seed, 1, [-0.06, -0.02], [-0.62, -0.36], [0.52, 0.30]));
    parts.push(net(seed));
    Scene::of(parts, [0.58, 0.62, 0.66], seed)
}

fn body(seed: u64, segment: u64) -> Part {
    let along = segment as f64 / 4.0;
    let random = |what: u64, low: f64, high: f64| between(key(&[seed, 0xb0d7, segment, what]), low, high);
    let centre = [0.46 - 0.84 * along, 0.16 - 0.10 * along + random(0, -0.01, 0.01)];
    let radii = [0.15, 0.10 + 0.06 * along];
    let dark = random(1, 0.0, 0.2) as f32;
    Part {
        shape: Shape::Ellipse { centre, radii, angle: 0.12 },
        holes: Vec::new(),
        relief: Relief::Dome { centre, depth: 0.92 - 0.30 * along, slope: [-0.2, 0.1], bulge: 0.14, radius: 0.17 },
        skin: Skin {
            base: [0.50 - dark, 0.30 - dark, 0.10],
            accent: [0.10, 0.07, 0.05],
            pattern: if segment.is_multiple_of(2) { Pattern::Striped(34.0) } else { Pattern::Pitted(58.0) },
            grain: 0.8,
            gloss: 0.2,
            seed: key(&[seed, 0xb0d8, segment]),
        },
    }
}

/// A thin wing of one piece.
fn membrane(seed: u64, wing: u64, from: [f64; 2], to: [f64; 2], depths: [f64; 2]) -> Part {
    Part {
        shape: Shape::Blade { from, to, half_width: 0.12, fullness: 0.65 },
        holes: Vec::new(),
        relief: Relief::Along { from, to, depths },
        skin: Skin {
            base: [0.66, 0.70, 0.62],
            accent: [0.24, 0.16, 0.10],
            pattern: Pattern::Veined(26.0),
            grain: 0.4,
            gloss: 0.25,
            seed: key(&[seed, 0x3e3b, wing]),
        },
    }
}

/// Veins fanned out over the body from the near side to the camera, and the cross veins between them.
fn net(seed: u64) -> Part {
    const RAYS: u64 = 9;
    const CROSSINGS: u64 = 11;
    let root = [-0.34, 0.30];
    let turn = |ray: u64| -0.75 + 0.95 * ray as f64 / (RAYS - 1) as f64;
    let reach = |ray: u64| 0.85 - 0.25 * (turn(ray) + 0.3).abs();
    let at = |ray: u64, share: f64| {
        let (sin, cos) = turn(ray).sin_cos();
        [root[0] + share * reach(ray) * cos, root[1] + share * reach(ray) * sin]
    };
    let mut strokes: Vec<Stroke> =
        (0..RAYS).map(|ray| Stroke { from: at(ray, 0.0), to: at(ray, 1.0), radii: [0.0055, 0.0022] }).collect();
    for ray in 0..RAYS - 1 {
        for crossing in 0..CROSSINGS {
            let jitter = between(key(&[seed, 0x3e7, ray, crossing]), -0.035, 0.035);
            let share = (crossing as f64 + 1.0) / CROSSINGS as f64 + if ray % 2 == 0 { 0.0 } else { -0.04 };
            let ends = [at(ray, share + jitter), at(ray + 1, share - jitter)];
            strokes.push(Stroke { from: ends[0], to: ends[1], radii: [0.0022, 0.0016] });
        }
    }
    Part {
        shape: Shape::Strokes(strokes),
        holes: Vec::new(),
        relief: Relief::Along { from: root, to: [0.50, -0.10], depths: [0.36, 0.04] },
        skin: Skin {
            base: [0.20, 0.12, 0.07],
            accent: [0.55, 0.40, 0.22],
            pattern: Pattern::Mottled,
            grain: 0.6,
            gloss: 0.3,
            seed: key(&[seed, 0x3e8]),
        },
    }
}
