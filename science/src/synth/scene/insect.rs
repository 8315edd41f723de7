//! A beetle on a gnawed leaf, its head towards the camera.

use super::super::noise::{between, key};
use super::{Part, Pattern, Relief, Scene, Shape, Skin, Stroke};

/// Direction of the body from head to tail, radians from x towards y.
const AXIS: f64 = -0.42;

const METAL: [f32; 3] = [0.05, 0.30, 0.20];
const METAL_DARK: [f32; 3] = [0.015, 0.06, 0.07];
const HORN: [f32; 3] = [0.16, 0.075, 0.035];

/// A point of the body: `along` from the middle towards the tail, `across` towards the lower side.
fn body(along: f64, across: f64) -> [f64; 2] {
    let (sin, cos) = AXIS.sin_cos();
    [0.02 + along * cos - across * sin, 0.0 + along * sin + across * cos]
}

/// Depth of the body's middle plane.
fn plane(along: f64) -> f64 {
    0.50 + 0.95 * along
}

pub(super) fn scene(seed: u64) -> Scene {
    let mut parts = vec![leaf(seed)];
    // legs come from under the body
    for side in [-1.0, 1.0] {
        for pair in 0..3 {
            leg(seed, pair, side, &mut parts);
        }
    }
    parts.push(bristles(seed, 0, 0.13, 0.155, 0.26, 80));
    parts.push(wing_cases(seed));
    parts.push(seam());
    parts.push(bristles(seed, 1, -0.155, 0.115, 0.10, 34));
    parts.push(dome(seed, 2, body(-0.145, 0.0), [0.105, 0.125], -0.145, 0.10, METAL, Pattern::Pitted(75.0)));
    parts.push(dome(seed, 3, body(-0.265, 0.0), [0.072, 0.078], -0.265, 0.07, METAL_DARK, Pattern::Pitted(110.0)));
    for side in [-1.0, 1.0] {
        parts.push(eye(seed, side));
    }
    for side in [-1.0, 1.0] {
        parts.push(jaw(seed, side));
        parts.push(antenna(seed, side));
    }
    Scene::of(parts, [0.66, 0.67, 0.64], seed)
}

fn skin(seed: u64, what: u64, base: [f32; 3], accent: [f32; 3], pattern: Pattern, gloss: f32) -> Skin {
    Skin { base, accent, pattern, grain: 0.65, gloss, seed: key(&[seed, 0x5c14, what]) }
}

fn leaf(seed: u64) -> Part {
    let (from, to) = ([-0.60, 0.20], [0.52, 0.30]);
    let holes = vec![
        ([-0.30, 0.335], 0.036),
        ([-0.255, 0.36], 0.028),
        ([0.12, 0.36], 0.042),
        ([0.17, 0.335], 0.03),
        ([0.33, 0.22], 0.02),
        ([-0.43, 0.17], 0.018),
    ];
    Part {
        shape: Shape::Blade { from, to, half_width: 0.20, fullness: 0.45 },
        holes,
        relief: Relief::Dome { centre: [0.0, 0.25], depth: 0.86, slope: [0.12, -0.10], bulge: 0.05, radius: 0.6 },
        skin: skin(seed, 1, [0.13, 0.28, 0.07], [0.40, 0.52, 0.22], Pattern::Veined(13.0), 0.06),
    }
}

#[allow(clippy::too_many_arguments)] // one line per body segment reads better than a struct each
fn dome(
    seed: u64,
    what: u64,
    centre: [f64; 2],
    radii: [f64; 2],
    along: f64,
    bulge: f64,
    base: [f32; 3],
    pattern: Pattern,
) -> Part {
    Part {
        shape: Shape::Ellipse { centre, radii, angle: AXIS },
        holes: Vec::new(),
        relief: body_relief(centre, along, bulge, radii[0].max(radii[1])),
        skin: skin(seed, what, base, METAL_DARK, pattern, 0.4),
    }
}

fn body_relief(centre: [f64; 2], along: f64, bulge: f64, radius: f64) -> Relief {
    let slope = [0.95 * AXIS.cos(), 0.95 * AXIS.sin()];
    Relief::Dome { centre, depth: plane(along), slope, bulge, radius }
}

fn wing_cases(seed: u64) -> Part {
    let shape = dome(seed, 10, body(0.13, 0.0), [0.27, 0.165], 0.13, 0.16, METAL, Pattern::Pitted(44.0));
    let skin = Skin { accent: [0.42, 0.20, 0.03], gloss: 0.5, ..shape.skin };
    Part { skin, ..shape }
}

/// The line where the wing cases meet.
fn seam() -> Part {
    let ends = [body(-0.06, 0.0), body(0.395, 0.0)];
    Part {
        shape: Shape::Strokes(vec![Stroke { from: ends[0], to: ends[1], radii: [0.0035, 0.0025] }]),
        holes: Vec::new(),
        // on the surface of the wing cases
        relief: body_relief(body(0.13, 0.0), 0.13, 0.16, 0.27),
        skin: skin(0, 11, [0.01, 0.03, 0.03], METAL_DARK, Pattern::Mottled, 0.1),
    }
}

/// Fine hairs that stand out from the rim of an ellipse of the body.
fn bristles(seed: u64, group: u64, along: f64, across_radius: f64, along_radius: f64, count: u64) -> Part {
    let strokes = (0..count)
        .map(|i| {
            let random = |what: u64, low: f64, high: f64| between(key(&[seed, 0xb415, group, i, what]), low, high);
            let turn = std::f64::consts::TAU * (i as f64 + random(0, -0.4, 0.4)) / count as f64;
            let (out, length) = ([turn.cos(), turn.sin()], random(1, 0.02, 0.045));
            let root = [along + 0.85 * along_radius * out[0], 0.9 * across_radius * out[1]];
            let tip = [root[0] + (0.04 + length) * out[0] + 0.01, root[1] + (0.02 + length) * out[1]];
            let radius = random(2, 0.0009, 0.0016);
            Stroke { from: body(root[0], root[1]), to: body(tip[0], tip[1]), radii: [radius, 0.5 * radius] }
        })
        .collect();
    Part {
        shape: Shape::Strokes(strokes),
        holes: Vec::new(),
        relief: body_relief(body(along, 0.0), along, 0.0, 1.0),
        skin: skin(seed, 20 + group, [0.25, 0.17, 0.09], HORN, Pattern::Mottled, 0.2),
    }
}

fn eye(seed: u64, side: f64) -> Part {
    let centre = body(-0.285, 0.064 * side);
    Part {
        shape: Shape::Ellipse { centre, radii: [0.026, 0.022], angle: AXIS },
        holes: Vec::new(),
        relief: Relief::Dome { centre, depth: plane(-0.285) - 0.03, slope: [0.0; 2], bulge: 0.03, radius: 0.026 },
        skin: skin(seed, 30, [0.03, 0.02, 0.02], [0.16, 0.11, 0.07], Pattern::Pitted(200.0), 0.8),
    }
}

fn jaw(seed: u64, side: f64) -> Part {
    let points = [body(-0.325, 0.035 * side), body(-0.372, 0.040 * side), body(-0.395, 0.010 * side)];
    let strokes = vec![
        Stroke { from: points[0], to: points[1], radii: [0.017, 0.012] },
        Stroke { from: points[1], to: points[2], radii: [0.012, 0.003] },
    ];
    Part {
        shape: Shape::Strokes(strokes),
        holes: Vec::new(),
        relief: Relief::Along { from: points[0], to: points[2], depths: [plane(-0.325) - 0.01, 0.09] },
        skin: skin(seed, 31, HORN, [0.05, 0.02, 0.01], Pattern::Mottled, 0.5),
    }
}

fn antenna(seed: u64, side: f64) -> Part {
    let points = [
        body(-0.31, 0.05 * side),
        body(-0.40, 0.17 * side),
        body(-0.36 - 0.06 * side, 0.30 * side),
        body(-0.28 - 0.14 * side, 0.40 * side),
    ];
    let mut strokes = Vec::new();
    for (joint, pair) in points.windows(2).enumerate() {
        const BEADS: usize = 4;
        for bead in 0..BEADS {
            let at = |share: f64| {
                [pair[0][0] + share * (pair[1][0] - pair[0][0]), pair[0][1] + share * (pair[1][1] - pair[0][1])]
            };
            let share = bead as f64 / BEADS as f64;
            let thick = 0.0045 + 0.001 * joint as f64;
            strokes.push(Stroke { from: at(share), to: at(share + 0.24), radii: [0.6 * thick, thick] });
        }
        for hair in 0..9_u64 {
            let random = |what: u64| between(key(&[seed, 0xa47, joint as u64, hair, what]), -1.0, 1.0);
            let share = (hair as f64 + 0.5) / 9.0;
            let root = [pair[0][0] + share * (pair[1][0] - pair[0][0]), pair[0][1] + share * (pair[1][1] - pair[0][1])];
            let tip = [root[0] + 0.022 * random(0), root[1] + 0.022 * random(1)];
            strokes.push(Stroke { from: root, to: tip, radii: [0.0011, 0.0007] });
        }
    }
    let depths = if side > 0.0 { [plane(-0.31) - 0.04, 0.02] } else { [plane(-0.31) - 0.04, 0.36] };
    Part {
        shape: Shape::Strokes(strokes),
        holes: Vec::new(),
        relief: Relief::Along { from: points[0], to: points[3], depths },
        skin: skin(seed, 32, HORN, [0.30, 0.16, 0.07], Pattern::Mottled, 0.4),
    }
}

/// One leg, from the body to the claw, in three parts; `side` 1 is the near (lower) one.
fn leg(seed: u64, pair: usize, side: f64, parts: &mut Vec<Part>) {
    // (along, across) of hip, knee, ankle and claw, per pair
    const JOINTS: [[[f64; 2]; 4]; 3] = [
        [[-0.16, 0.09], [-0.23, 0.21], [-0.33, 0.29], [-0.42, 0.33]],
        [[-0.03, 0.11], [-0.03, 0.25], [-0.08, 0.37], [-0.14, 0.44]],
        [[0.10, 0.12], [0.20, 0.24], [0.31, 0.33], [0.43, 0.38]],
    ];
    const THICKNESS: [[f64; 2]; 3] = [[0.017, 0.022], [0.013, 0.009], [0.006, 0.004]];
    let reach = if side > 0.0 { 1.0 } else { 0.88 };
    // the near side's legs bend towards the camera, the far side's away from it
    let depth_at = |joint: usize, along: f64| {
        let out = if side > 0.0 { [0.07, -0.22, -0.08, 0.06] } else { [0.10, 0.02, 0.10, 0.18] };
        (plane(along) + out[joint]).clamp(0.02, 0.98)
    };
    for segment in 0..3 {
        let ends = [JOINTS[pair][segment], JOINTS[pair][segment + 1]];
        let [from, to] = ends.map(|[along, across]| body(along, side * reach * across));
        let mut strokes = vec![Stroke { from, to, radii: THICKNESS[segment] }];
        if segment == 2 {
            let tip = body(ends[1][0] - 0.02, side * reach * (ends[1][1] + 0.03));
            let other = body(ends[1][0] + 0.015, side * reach * (ends[1][1] + 0.03));
            strokes.push(Stroke { from: to, to: tip, radii: [0.0035, 0.0012] });
            strokes.push(Stroke { from: to, to: other, radii: [0.0035, 0.0012] });
        }
        for hair in 0..16_u64 {
            let random = |what: u64, low: f64, high: f64| {
                let side = u64::from(side > 0.0);
                between(key(&[seed, 0x1e6, pair as u64, side, segment as u64, hair, what]), low, high)
            };
            let share = random(0, 0.05, 1.0);
            let root = [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])];
            let turn = random(1, 0.0, std::f64::consts::TAU);
            let length = THICKNESS[segment][1] + random(2, 0.010, 0.024);
            let tip = [root[0] + length * turn.cos(), root[1] + length * turn.sin()];
            strokes.push(Stroke { from: root, to: tip, radii: [0.0014, 0.0008] });
        }
        parts.push(Part {
            shape: Shape::Strokes(strokes),
            holes: Vec::new(),
            relief: Relief::Along {
                from,
                to,
                depths: [depth_at(segment, ends[0][0]), depth_at(segment + 1, ends[1][0])],
            },
            skin: skin(seed, 40 + segment as u64, HORN, [0.05, 0.10, 0.07], Pattern::Mottled, 0.35),
        });
    }
}
