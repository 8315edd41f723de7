//! The families of stacks: each fault alone at several strengths, and stacks without a fault.

use pinstack_science::synth::{Alone, Banding, DotTarget, Faults, Flaws, Kernel, Moved, Replacement, Rig, Surround};

/// A stack with its truth.
pub struct Stack {
    pub family: &'static str,
    /// Codes of findings of which one names the fault; empty when there is nothing to name.
    pub codes: &'static [&'static str],
    /// A verdict of Good is due where the result is right: no fault, or one that does not matter.
    pub clean: bool,
    pub rig: Rig,
    pub target: DotTarget,
    /// Slices in the order in which they are read.
    pub order: Vec<usize>,
    pub what: String,
}

pub(super) type Change = fn(&mut Stack, f64);

/// Name, strengths, codes that name it, whether Good is due, and the change itself.
pub(super) struct Family {
    pub name: &'static str,
    pub strengths: &'static [f64],
    pub codes: &'static [&'static str],
    pub clean: bool,
    pub change: Change,
}

const MOVED: &[&str] = &["rig_bumped", "shift_ambiguous", "slice_displaced", "target_moved", "uneven_step"];
const ORDER: &[&str] = &["slices_out_of_order"];
const SLICE: &[&str] = &["slice_interpolated", "slice_displaced", "other_target", "many_outliers"];
const ALONE: &[&str] = &["slice_displaced", "perspective", "target_moved"];
const STRIPES: &[&str] = &["lamp_banding", "slice_interpolated"];
const GAIN: &[&str] = &["uncertain_gains", "exposure_outlier", "tint_outlier"];

pub(super) const FAMILIES: [Family; 41] = [
    plain("typical", &[0.3, 0.4, 0.5], set_blur),
    plain("endless grid", &[0.3, 0.45], |s, blur| {
        endless(s);
        set_blur(s, blur);
    }),
    plain("pitch", &[20.0, 42.0], set_pitch),
    plain("asymmetric", &[1.0], |s, _| {
        s.target.asymmetric = true;
        s.target.rows *= 2;
        s.target.dot_diameter_mm *= 0.7;
    }),
    plain("bright dots", &[1.0], |s, _| s.target.invert = true),
    plain("small target", &[0.6], small),
    plain("noise", &[4.0], |s, noise| s.rig.noise = noise),
    plain("print errors", &[0.005, 0.02], |s, share| faults(s).print_error = share),
    plain("dust", &[40.0], |s, count| s.target.flaws.target_dust = count as usize),
    plain("sRGB", &[1.0], |s, _| s.target.flaws.gamma = true),
    plain("filmic tone", &[1.0], |s, _| faults(s).filmic = true),
    plain("blur shape", &[0.0, 1.0, 2.0], |s, kernel| {
        faults(s).kernel = [Kernel::Gaussian, Kernel::CoreAndHalo, Kernel::Ring][kernel as usize];
    }),
    plain("uneven light", &[0.01, 0.02], |s, change| faults(s).illumination = [change, 0.5 * change]),
    plain("uneven light, blur 0.6", &[0.02], |s, change| {
        set_blur(s, 0.6);
        faults(s).illumination = [change, 0.5 * change];
    }),
    plain("lit from one side", &[0.02, 0.045, 0.07], |s, change| one_side(s, [change, 0.0])),
    plain("lit from one side, blur 0.5, sRGB", &[0.03, 0.07], |s, change| {
        set_blur(s, 0.5);
        s.target.flaws.gamma = true;
        one_side(s, [0.6 * change, 0.8 * change]);
    }),
    plain("target aslant", &[3.0, 8.0], aslant),
    plain("target aslant, lamp in the middle", &[3.0, 6.0, 10.0], |s, degrees| {
        aslant(s, degrees);
        set_blur(s, 0.45);
        faults(s).spot = 0.0025;
    }),
    fault("rail still", &[0.0, 1.0], &["rail_still"], |s, way| {
        if way == 0.0 {
            s.order.fill(4);
        }
        let middle = s.rig.rail_mm[s.rig.reference];
        s.rig.rail_mm.iter_mut().for_each(|z| *z = middle + 1e-4 * (*z - middle));
        s.rig = Rig { drift_px: [0.0; 2], rotation_deg: 0.0, keystone: [0.0; 2], ..s.rig.clone() };
    }),
    fault("one slice tilts", &[5e-4, 2e-3, 8e-3], ALONE, |s, keystone| alone(s, 6, [keystone, 0.4 * keystone])),
    fault("one slice tilts, small target", &[5e-4, 2e-3, 8e-3], ALONE, |s, keystone| {
        small(s, 0.6);
        alone(s, 2, [keystone, -0.7 * keystone]);
    }),
    fault("one slice tilts, half a target", &[2e-3, 2e-2], ALONE, |s, keystone| {
        let columns = s.target.columns;
        s.target.missing = (0..columns * s.target.rows).filter(|dot| dot % columns > columns / 2).collect();
        alone(s, 7, [keystone, 0.0]);
    }),
    fault("one slice turned or sheared", &[-0.003, 0.003], ALONE, |s, by| {
        let turn_deg = if by < 0.0 { by.to_degrees() } else { 0.0 };
        s.rig.alone = Some(Alone { slice: 3, turn_deg, shear: by.max(0.0), ..Alone::default() });
    }),
    fault("banding at the pitch", &[0.006, 0.01, 0.02, 0.03, 0.1, 0.3], STRIPES, |s, strength| {
        s.target.rotation_deg = 0.0;
        banding(s, 1.0, strength);
    }),
    fault("jump", &[0.3, 0.6, 1.0, 1.4, 3.4], MOVED, |s, pitches| jump(s, pitches, 5, usize::MAX)),
    fault("jump, endless grid", &[0.6, 1.0, 3.4], MOVED, |s, pitches| {
        endless(s);
        jump(s, pitches, 5, usize::MAX);
    }),
    fault("end slice displaced", &[0.2, 0.4, 0.7], MOVED, |s, pitches| jump(s, pitches, 8, 9)),
    fault("middle slice displaced", &[0.2, 0.6, 1.0], MOVED, |s, pitches| jump(s, pitches, 2, 3)),
    fault("steady drift", &[0.5, 1.0], &[], drift),
    fault("steady drift, endless grid", &[0.7, 1.0], MOVED, |s, pitches| {
        endless(s);
        drift(s, pitches);
    }),
    fault("target moved", &[0.1, 0.5, 1.0], MOVED, |s, pitches| {
        faults(s).moved = Some(Moved { from: 5, by: [pitches, 0.3 * pitches], turn_deg: 0.0 });
    }),
    fault("target turned", &[0.5, 3.0], MOVED, |s, degrees| {
        faults(s).moved = Some(Moved { from: 5, by: [0.0; 2], turn_deg: degrees });
    }),
    fault("wrong order", &[0.0, 1.0, 2.0, 3.0], ORDER, |s, way| {
        let all = 0..s.order.len();
        s.order = match way as usize {
            // the counter rolled over
            0 => all.map(|i| (i + 4) % 9).collect(),
            // two exchanged
            1 => vec![0, 1, 6, 3, 4, 5, 2, 7, 8],
            // bracketed about the middle
            2 => vec![4, 3, 5, 2, 6, 1, 7, 0, 8],
            // reversed halves
            _ => vec![3, 2, 1, 0, 4, 8, 7, 6, 5],
        };
    }),
    fault("distortion, fixed lens", &[0.01, 0.03], &["lens_distortion"], |s, k1| {
        faults(s).distortion = k1;
    }),
    fault("distortion, moving lens", &[0.01, 0.03], &["lens_distortion"], |s, k1| {
        s.rig = s.rig.clone().moving_lens();
        s.target.depth = Some(0.5);
        faults(s).distortion = k1;
    }),
    fault("lateral and axial colour", &[0.001, 0.003], &["lateral_colour"], |s, scale| {
        s.rig.channels = 3;
        faults(s).lateral = [scale, 0.0, -scale];
        faults(s).axial_px = [1.5, 0.0, -1.5];
    }),
    fault("banding", &[0.5, 1.0, 2.0], STRIPES, |s, pitches| banding(s, pitches, 0.05)),
    fault("one slice darker", &[0.9, 0.65, 0.3], GAIN, |s, light| set_exposure(s, 6, [light; 3])),
    fault("flash missed", &[0.05], GAIN, |s, light| set_exposure(s, 6, [light; 3])),
    fault("white balance", &[1.19], GAIN, |s, factor| {
        s.rig.channels = 3;
        set_exposure(s, 6, [factor, 1.0, 1.0 / factor]);
    }),
    fault("slice replaced", &[0.0, 1.0, 2.0, 3.0], SLICE, |s, kind| {
        let kinds = [Replacement::Black, Replacement::Blank, Replacement::Mirrored, Replacement::Other];
        faults(s).replaced = Some((6, kinds[kind as usize]));
    }),
];

const fn plain(name: &'static str, strengths: &'static [f64], change: Change) -> Family {
    Family { name, strengths, codes: &[], clean: true, change }
}

const fn fault(
    name: &'static str,
    strengths: &'static [f64],
    codes: &'static [&'static str],
    change: Change,
) -> Family {
    Family { name, strengths, codes, clean: false, change }
}

pub(super) fn faults(stack: &mut Stack) -> &mut Faults {
    &mut stack.target.flaws.faults
}

fn jump(stack: &mut Stack, pitches: f64, from: usize, until: usize) {
    let px = pitches * stack.target.pitch_px(&stack.rig, stack.rig.reference);
    let at = |i: usize| if (from..until).contains(&i) { [px, 0.2 * px] } else { [0.0; 2] };
    stack.rig.displaced_px = (0..stack.rig.slices()).map(at).collect();
}

fn drift(stack: &mut Stack, pitches: f64) {
    let px = pitches * stack.target.pitch_px(&stack.rig, stack.rig.reference);
    stack.rig.displaced_px = (0..stack.rig.slices()).map(|i| [px * i as f64, 0.0]).collect();
}

fn set_exposure(stack: &mut Stack, slice: usize, light: [f64; 3]) {
    let at = |i: usize| if i == slice { light } else { [1.0; 3] };
    stack.target.flaws.faults.exposures = (0..stack.rig.slices()).map(at).collect();
}

pub(super) fn small(stack: &mut Stack, share: f64) {
    let fewer = |count: usize| (count as f64 * share) as usize;
    [stack.target.columns, stack.target.rows] = [fewer(stack.target.columns), fewer(stack.target.rows)];
}

/// Light that grows by `change` per pitch, exposed so that its brightest part does not clip.
pub(super) fn one_side(stack: &mut Stack, change: [f64; 2]) {
    faults(stack).illumination = change;
    let most = 10.0 * change[0].abs() + 7.0 * change[1].abs();
    stack.target.flaws.overexposure = 1.0 / (1.0 + most);
}

fn aslant(stack: &mut Stack, degrees: f64) {
    stack.target.tilt_deg = [0.5 * degrees, 0.8 * degrees];
}

pub(super) fn alone(stack: &mut Stack, slice: usize, keystone: [f64; 2]) {
    stack.rig.alone = Some(Alone { slice, keystone, ..Alone::default() });
}

pub(super) fn banding(stack: &mut Stack, pitches: f64, strength: f64) {
    let period_px = pitches * stack.target.pitch_px(&stack.rig, stack.rig.reference);
    faults(stack).banding = Some(Banding { period_px, strength });
}

/// No edge in view.
fn endless(stack: &mut Stack) {
    stack.target.flaws.surround = None;
    stack.target.columns += 16;
    stack.target.rows += 16;
}

/// Sets the largest blur radius over the pitch by the aperture.
pub(super) fn set_blur(stack: &mut Stack, share: f64) {
    let of = |i| stack.target.blur_radius_px(&stack.rig, i) / stack.target.pitch_px(&stack.rig, i);
    let largest: f64 = f64::max(of(0), of(stack.rig.slices() - 1));
    stack.rig.f_number *= largest / share;
}

fn set_pitch(stack: &mut Stack, px: f64) {
    let factor = px / stack.target.pitch_px(&stack.rig, stack.rig.reference);
    stack.target.pitch_mm *= factor;
    stack.target.dot_diameter_mm *= factor;
    stack.target.columns = (stack.target.columns as f64 / factor) as usize;
    stack.target.rows = (stack.target.rows as f64 / factor) as usize;
    set_blur(stack, 0.35);
}

/// 600 x 400 px, nine slices, a grid of 30 px that ends inside the image, blur to 0.35 of the pitch.
pub(super) fn typical(seed: u64) -> Stack {
    let rig = Rig { channels: 1, seed, noise: 1.5, ..Rig::sized(600, 400, 9) };
    let mut target = DotTarget::for_rig(&rig, 20);
    target.pitch_mm *= 30.0 / target.pitch_px(&rig, rig.reference);
    target.dot_diameter_mm = 0.5 * target.pitch_mm;
    [target.columns, target.rows] = [17, 11];
    target.rotation_deg = 0.7 + 0.9 * (seed % 7) as f64;
    target.flaws = Flaws { surround: Some(Surround { clutter: 0, ..Surround::table() }), seed, ..Flaws::default() };
    let order = (0..rig.slices()).collect();
    let mut stack = Stack { family: "", codes: &[], clean: true, rig, target, order, what: String::new() };
    set_blur(&mut stack, 0.35);
    stack
}
