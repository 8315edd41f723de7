//! Overlapping plates.

use super::super::noise::{between, key, uniform};
use super::{Part, Pattern, Relief, Scene, Shape, Skin, Stroke};

pub(super) fn scene(seed: u64) -> Scene {
    const COUNT: usize = 9;
    let mut parts = Vec::new();
    for i in 0..COUNT {
        let random = |what: u64, low: f64, high: f64| between(key(&[seed, 0x91a7e, i as u64, what]), low, high);
        let depth = 0.97 - 0.94 * i as f64 / (COUNT - 1) as f64;
        // on a ring about the middle, so that neighbours in depth overlap
        let turn = i as f64 * 2.399 + random(0, -0.2, 0.2);
        let away = if i == 0 { 0.05 } else { random(1, 0.14, 0.28) };
        let centre = [1.25 * away * turn.cos(), away * turn.sin()];
        let size = if i == 0 { [0.46, 0.36] } else { [random(2, 0.13, 0.22), random(3, 0.09, 0.17)] };
        let colour = |what: u64| std::array::from_fn(|c| random(what + c as u64, 0.12, 0.75) as f32);
        let patterns = [Pattern::Mottled, Pattern::Striped(26.0), Pattern::Pitted(30.0), Pattern::Chequered(22.0)];
        let hole = [centre[0] + 0.3 * size[0], centre[1] - 0.2 * size[1]];
        let round = uniform(key(&[seed, 0x0e11, i as u64])) < 0.35 && i > 0;
        let angle = random(4, -0.7, 0.7);
        parts.push(Part {
            shape: if round {
                Shape::Ellipse { centre, radii: size, angle }
            } else {
                Shape::Plate { centre, half: size, angle, corner: 0.02 }
            },
            holes: if i % 2 == 1 { vec![(hole, 0.3 * size[1])] } else { Vec::new() },
            relief: Relief::Dome {
                centre,
                depth,
                slope: [random(5, -0.12, 0.12), random(6, -0.12, 0.12)],
                bulge: if round { 0.05 } else { 0.0 },
                radius: size[0],
            },
            skin: Skin {
                base: colour(10),
                accent: colour(20),
                pattern: patterns[(i + seed as usize) % patterns.len()],
                grain: 0.7,
                gloss: if round { 0.25 } else { 0.0 },
                seed: key(&[seed, 0x5c1, i as u64]),
            },
        });
        if i % 3 == 2 {
            parts.push(hairs(seed, i, depth - 0.04));
        }
    }
    Scene::of(parts, [0.62, 0.66, 0.70], seed)
}

/// A few hairs across the picture, 1 to 3 px wide in pictures of ordinary size.
fn hairs(seed: u64, group: usize, depth: f64) -> Part {
    let strokes = (0..5)
        .map(|hair| {
            let random =
                |what: u64, low: f64, high: f64| between(key(&[seed, 0x4a12, group as u64, hair, what]), low, high);
            let from = [random(0, -0.55, 0.55), random(1, -0.42, 0.42)];
            let (turn, length) = (random(2, 0.0, std::f64::consts::TAU), random(3, 0.25, 0.5));
            let radius = random(4, 0.001, 0.0025);
            let to = [from[0] + length * f64::cos(turn), from[1] + length * f64::sin(turn)];
            Stroke { from, to, radii: [radius, 0.6 * radius] }
        })
        .collect();
    Part {
        shape: Shape::Strokes(strokes),
        holes: Vec::new(),
        relief: Relief::Along { from: [-0.5, 0.0], to: [0.5, 0.0], depths: [depth - 0.03, depth + 0.03] },
        skin: Skin {
            base: [0.07, 0.05, 0.04],
            accent: [0.3, 0.2, 0.1],
            pattern: Pattern::Mottled,
            grain: 0.4,
            gloss: 0.3,
            seed: key(&[seed, 0x4a13, group as u64]),
        },
    }
}
