//! What the camera sees beyond the plate: a frame, and things on a table.

use std::f64::consts::PI;

use super::DotTarget;
use super::disc_overlap::{PIXEL_MOMENT, overlap, rectangle};
use crate::synth::noise::{between, fractal, key, uniform};
use crate::synth::rig::Rig;

/// What lies beyond the plate, as one slice sees it. All in grid units from the middle of the grid.
pub(super) struct Beyond {
    half: [f64; 2],
    frame: f64,
    light: f64,
    unevenness: f64,
    seed: u64,
    /// Radius of the blur in the middle of the plate, px.
    blur: f64,
    things: Vec<Thing>,
}

enum Outline {
    /// Outer and inner radius.
    Ring([f64; 2]),
    /// Half sides, and cosine and sine of the angle.
    Stick([f64; 2], [f64; 2]),
}

struct Thing {
    at: [f64; 2],
    outline: Outline,
    light: f64,
}

impl Beyond {
    pub(super) fn new(rig: &Rig, target: &DotTarget, i: usize) -> Option<Self> {
        let surround = target.flaws.surround?;
        let seed = target.flaws.seed;
        let middle = target.middle();
        let anchor = target.anchor(rig)?;
        let thing = |index: usize| {
            let number = |what: u64| key(&[seed, 0x7416, index as u64, what]);
            let side = |what: u64, size: usize| between(number(what), -0.1, 1.1) * size as f64;
            let at = anchor.apply([side(0, rig.width), side(1, rig.height)]);
            let size = 0.15 + 1.6 * uniform(number(2)).powi(2);
            let turn = between(number(3), 0.0, PI);
            let outline = match index % 3 {
                0 => Outline::Ring([size, 0.0]),
                1 => Outline::Ring([size, 0.5 * size]),
                _ => Outline::Stick([3.0 * size, 0.2 * size], [turn.cos(), turn.sin()]),
            };
            Thing { at, outline, light: between(number(4), 0.03, 0.95) }
        };
        Some(Self {
            half: [middle[0] + surround.margin, middle[1] + surround.margin],
            frame: surround.frame,
            light: surround.light,
            unevenness: surround.unevenness,
            seed,
            blur: (target.blur_radius_px(rig, i).powi(2) + PIXEL_MOMENT).sqrt(),
            things: (0..surround.clutter).map(thing).collect(),
        })
    }

    /// `plate` where the plate is, the surround elsewhere.
    pub(super) fn around(&self, plate: f64, place: [f64; 2], zoom: f64) -> f64 {
        const BLACK: f64 = 0.03;
        let blur = self.blur * zoom;
        let inside = rectangle(self.half, place, blur);
        if inside >= 1.0 {
            return plate;
        }
        let texture = f64::from(fractal(self.seed, 0.4 * place[0], 0.4 * place[1], 6, 0.6, 0.8 * blur));
        let mut light = self.light * (1.0 + self.unevenness * texture).max(0.0);
        for thing in &self.things {
            let [x, y] = [place[0] - thing.at[0], place[1] - thing.at[1]];
            let share = match thing.outline {
                Outline::Ring([outer, inner]) => {
                    let distance = x.hypot(y);
                    (overlap(outer, blur, distance) - overlap(inner, blur, distance)) / (PI * blur * blur)
                }
                Outline::Stick(half, [cos, sin]) => rectangle(half, [x * cos + y * sin, y * cos - x * sin], blur),
            };
            light += (thing.light - light) * share;
        }
        if self.frame > 0.0 {
            let framed = rectangle(self.half.map(|half| half + self.frame), place, blur);
            light += (BLACK - light) * framed;
        }
        light + (plate - light) * inside
    }
}
