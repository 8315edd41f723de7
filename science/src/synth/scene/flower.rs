//! A flower head seen aslant.

use super::super::noise::{between, key};
use super::{Part, Pattern, Relief, Scene, Shape, Skin, Stroke};

/// Middle of the flower head.
const HEART: [f64; 2] = [-0.02, -0.05];

/// A point at `away` from the heart in direction `turn`, foreshortened in y as a tilted disc is.
fn around(turn: f64, away: f64) -> [f64; 2] {
    [HEART[0] + away * turn.cos(), HEART[1] + 0.82 * away * turn.sin()]
}

/// The head leans towards the camera at the bottom: depth of its plane.
fn plane(point: [f64; 2]) -> f64 {
    0.62 - 0.5 * (point[1] - HEART[1])
}

pub(super) fn scene(seed: u64) -> Scene {
    let mut parts = vec![stem(seed), leaf(seed)];
    ring(seed, 0, 13, 0.42, 0.10, &mut parts);
    ring(seed, 1, 11, 0.31, 0.0, &mut parts);
    parts.push(heart(seed));
    for i in 0..17 {
        stamen(seed, i, &mut parts);
    }
    Scene::of(parts, [0.30, 0.36, 0.30], seed)
}

fn stem(seed: u64) -> Part {
    let (from, to) = (HEART, [0.22, 0.75]);
    let hairs = (0..40_u64).map(|i| {
        let random = |what: u64, low: f64, high: f64| between(key(&[seed, 0x57e3, i, what]), low, high);
        let t = random(0, 0.45, 1.0);
        let root = [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])];
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        let tip = [root[0] + side * random(1, 0.035, 0.06), root[1] - random(2, -0.01, 0.02)];
        Stroke { from: root, to: tip, radii: [0.0016, 0.0009] }
    });
    let stalk = Stroke { from, to, radii: [0.024, 0.028] };
    Part {
        shape: Shape::Strokes(std::iter::once(stalk).chain(hairs).collect()),
        holes: Vec::new(),
        relief: Relief::Along { from, to, depths: [0.8, 0.96] },
        skin: Skin {
            base: [0.16, 0.30, 0.09],
            accent: [0.30, 0.42, 0.15],
            pattern: Pattern::Striped(90.0),
            grain: 0.6,
            gloss: 0.08,
            seed: key(&[seed, 0x57e4]),
        },
    }
}

fn leaf(seed: u64) -> Part {
    let (from, to) = ([0.19, 0.52], [0.60, 0.16]);
    Part {
        shape: Shape::Blade { from, to, half_width: 0.11, fullness: 0.3 },
        holes: vec![([0.36, 0.35], 0.022), ([0.43, 0.27], 0.014)],
        relief: Relief::Along { from, to, depths: [0.92, 0.7] },
        skin: Skin {
            base: [0.12, 0.27, 0.08],
            accent: [0.34, 0.47, 0.20],
            pattern: Pattern::Veined(17.0),
            grain: 0.75,
            gloss: 0.1,
            seed: key(&[seed, 0x1eaf]),
        },
    }
}

/// A ring of petals whose tips curl towards the camera.
fn ring(seed: u64, ring: u64, count: u64, length: f64, back: f64, parts: &mut Vec<Part>) {
    let mut petals: Vec<Part> = (0..count)
        .map(|i| {
            let random = |what: u64, low: f64, high: f64| between(key(&[seed, 0x9e7a1, ring, i, what]), low, high);
            let turn = std::f64::consts::TAU * (i as f64 + 0.5 * ring as f64 + random(0, -0.18, 0.18)) / count as f64;
            let from = around(turn, 0.05);
            let to = around(turn + random(1, -0.08, 0.08), length * random(2, 0.9, 1.06));
            let curl = random(3, 0.02, 0.16);
            let warm = random(4, 0.0, 1.0) as f32;
            Part {
                shape: Shape::Blade { from, to, half_width: random(5, 0.058, 0.072), fullness: 0.75 },
                holes: Vec::new(),
                relief: Relief::Along { from, to, depths: [plane(from) + back, plane(to) + back - curl] },
                skin: Skin {
                    base: [0.86, 0.50 + 0.12 * warm, 0.10 + 0.05 * warm],
                    accent: [0.70, 0.20 + 0.08 * warm, 0.07],
                    pattern: Pattern::Striped(75.0),
                    grain: 0.55,
                    gloss: 0.03,
                    seed: key(&[seed, 0x9e7a2, ring, i]),
                },
            }
        })
        .collect();
    // what is nearer hides what is farther
    let middle = |part: &Part| match part.relief {
        Relief::Along { depths, .. } => depths[0] + depths[1],
        Relief::Dome { depth, .. } => 2.0 * depth,
    };
    petals.sort_by(|a, b| middle(b).total_cmp(&middle(a)));
    parts.extend(petals);
}

fn heart(seed: u64) -> Part {
    Part {
        shape: Shape::Ellipse { centre: HEART, radii: [0.125, 0.105], angle: 0.0 },
        holes: Vec::new(),
        relief: Relief::Dome { centre: HEART, depth: 0.56, slope: [0.0, -0.5], bulge: 0.16, radius: 0.125 },
        skin: Skin {
            base: [0.20, 0.09, 0.04],
            accent: [0.62, 0.36, 0.07],
            pattern: Pattern::Pitted(62.0),
            grain: 0.8,
            gloss: 0.05,
            seed: key(&[seed, 0x4ea7]),
        },
    }
}

/// A filament from the heart towards the camera with an anther at its end.
fn stamen(seed: u64, i: u64, parts: &mut Vec<Part>) {
    let random = |what: u64, low: f64, high: f64| between(key(&[seed, 0x57a3, i, what]), low, high);
    let turn = i as f64 * 2.399 + random(0, -0.3, 0.3);
    let reach = 0.03 + 0.1 * ((i as f64 + 0.5) / 17.0).sqrt();
    let (root, tip) = (around(turn, reach), around(turn + random(1, -0.2, 0.2), reach + random(2, 0.035, 0.085)));
    let depths = [0.42 - 0.4 * (root[1] - HEART[1]), random(3, 0.04, 0.32)];
    let skin = |base: [f32; 3], what: u64| Skin {
        base,
        accent: [0.95, 0.75, 0.25],
        pattern: Pattern::Mottled,
        grain: 0.7,
        gloss: 0.12,
        seed: key(&[seed, 0x57a4, i, what]),
    };
    parts.push(Part {
        shape: Shape::Strokes(vec![Stroke { from: root, to: tip, radii: [0.0035, 0.0022] }]),
        holes: Vec::new(),
        relief: Relief::Along { from: root, to: tip, depths },
        skin: skin([0.55, 0.62, 0.20], 0),
    });
    parts.push(Part {
        shape: Shape::Ellipse { centre: tip, radii: [0.016, 0.009], angle: random(4, 0.0, 3.0) },
        holes: Vec::new(),
        relief: Relief::Dome { centre: tip, depth: depths[1], slope: [0.0; 2], bulge: 0.02, radius: 0.016 },
        skin: skin([0.72, 0.40, 0.06], 1),
    });
}
