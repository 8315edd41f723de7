//! The stacks of the bench: those of each family, and random mixtures of the families and of what leaves no residuals.

use super::family::{FAMILIES, Stack, alone, banding, faults, one_side, set_blur, small, typical};

/// Which stacks of the bench are judged.
#[derive(Debug)]
pub struct Selection {
    /// Stacks of each strength of each family.
    pub seeds: u64,
    /// Random mixtures.
    pub mixtures: u64,
    /// Added to the numbers of seeds and mixtures. Thresholds must also hold for stacks on which they were not chosen.
    pub offset: u64,
    /// Parts of names of families, or ends of names of stacks ("pitch 42 seed 3", "mixture 7"); empty: all stacks.
    pub only: Vec<String>,
}

impl Selection {
    fn wants(&self, stack: &Stack) -> bool {
        let named = |name: &String| stack.family.contains(name.as_str()) || stack.what.ends_with(name.as_str());
        self.only.is_empty() || self.only.iter().any(named)
    }
}

/// The stacks of each family, then the mixtures.
pub fn stacks(selection: &Selection) -> Vec<Stack> {
    let mut out = Vec::new();
    for family in &FAMILIES {
        for &strength in family.strengths {
            for seed in selection.offset + 1..=selection.offset + selection.seeds {
                let mut stack = typical(seed);
                (family.change)(&mut stack, strength);
                let (codes, clean) = (family.codes, family.clean);
                let what = format!("{} {strength} seed {seed}", family.name);
                out.push(Stack { family: family.name, codes, clean, what, ..stack });
            }
        }
    }
    out.extend((selection.offset..selection.offset + selection.mixtures).map(mixture));
    out.extend((selection.offset..selection.offset + selection.mixtures).map(together));
    out.retain(|stack| selection.wants(stack));
    out
}

/// One to three families at once, at random strengths.
fn mixture(index: u64) -> Stack {
    let mut draw = Draw(index ^ 0x5eed_ca5e);
    let mut stack = typical(1000 + index);
    let (mut clean, mut names) = (true, Vec::new());
    for _ in 0..1 + draw.below(3) {
        let family = &FAMILIES[draw.below(FAMILIES.len())];
        if names.contains(&family.name) {
            continue;
        }
        let strength = family.strengths[draw.below(family.strengths.len())];
        (family.change)(&mut stack, strength);
        clean &= family.clean;
        names.push(family.name);
    }
    let what = format!("{} mixture {index}", names.join(" + "));
    Stack { family: "mixture", codes: &[], clean, what, ..stack }
}

/// What leaves no residuals, at random strengths, several at once: a slice that differs alone, stripes near the pitch,
/// uneven light, a target aslant, a small or incomplete target, a rail that does not move.
fn together(index: u64) -> Stack {
    let mut draw = Draw(index ^ 0x0a11_7095);
    let mut stack = typical(5000 + index);
    let mut names = Vec::new();
    set_blur(&mut stack, draw.between(0.15, 0.55));
    stack.target.flaws.gamma = draw.below(2) == 0;
    if draw.below(2) == 0 {
        stack.target.rotation_deg = 0.0;
    }
    if draw.below(3) == 0 {
        small(&mut stack, draw.between(0.5, 0.95));
        names.push("small");
    }
    if draw.below(2) == 0 {
        let (size, angle) = (draw.between(0.005, 0.07), draw.between(0.0, std::f64::consts::TAU));
        one_side(&mut stack, [size * angle.cos(), size * angle.sin()]);
        names.push("one side");
    }
    if draw.below(3) == 0 {
        faults(&mut stack).spot = draw.between(0.0, 0.0025);
        names.push("spot");
    }
    if draw.below(2) == 0 {
        stack.target.tilt_deg = [draw.between(-8.0, 8.0), draw.between(-8.0, 8.0)];
        names.push("aslant");
    }
    if draw.below(3) == 0 {
        let keystone = [0, 1].map(|_| 10_f64.powf(draw.between(-4.0, -1.7)) * draw.between(-1.0, 1.0).signum());
        alone(&mut stack, [0, 1, 2, 3, 5, 6, 7, 8][draw.below(8)], keystone);
        names.push("alone");
    }
    if draw.below(4) == 0 {
        let pitches = [0.5, 1.0, 1.0, draw.between(0.9, 1.1)][draw.below(4)];
        banding(&mut stack, pitches, 10_f64.powf(draw.between(-2.7, -1.0)));
        names.push("stripes");
    }
    if draw.below(12) == 0 {
        stack.order.fill(4);
        names.push("still");
    }
    let clean = !["alone", "stripes", "still"].iter().any(|fault| names.contains(fault));
    let what = format!("{} together {index}", names.join(" + "));
    Stack { family: "together", codes: &[], clean, what, ..stack }
}

/// SplitMix64.
struct Draw(u64);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.below(1 << 20) as f64 / f64::from(1 << 20)
    }

    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % count as u64) as usize
    }
}
