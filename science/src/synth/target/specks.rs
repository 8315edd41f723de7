//! Dust on the plate and on the sensor.

use std::f64::consts::PI;

use super::DotTarget;
use super::disc_overlap::{PIXEL_MOMENT, overlap};
use crate::synth::noise::{between, key, uniform};
use crate::synth::rig::Rig;
use crate::types::Homography;

/// A dark speck as one slice sees it; all in px.
pub(super) struct Speck {
    at: [f64; 2],
    radius: f64,
    blur: f64,
    darkness: f64,
}

impl Speck {
    pub(super) fn touches_row(&self, y: f64) -> bool {
        (y - self.at[1]).abs() < self.radius + self.blur
    }

    /// Share of the light that it takes at `px`.
    pub(super) fn shade(&self, px: [f64; 2]) -> f64 {
        let distance = (px[0] - self.at[0]).hypot(px[1] - self.at[1]);
        self.darkness * overlap(self.radius, self.blur, distance) / (PI * self.blur * self.blur)
    }
}

/// All dust: what lies on the plate moves and blurs with it, what lies on the sensor does neither.
pub(super) fn specks(rig: &Rig, target: &DotTarget, i: usize, map: &Homography) -> Vec<Speck> {
    let flaws = &target.flaws;
    let number = |kind: u64, index: usize, what: u64| key(&[flaws.seed, kind, index as u64, what]);
    let on_picture = |kind: u64, index: usize| {
        [
            between(number(kind, index, 0), 0.0, rig.width as f64),
            between(number(kind, index, 1), 0.0, rig.height as f64),
        ]
    };
    let anchor = target.anchor(rig);
    let plate = (0..flaws.target_dust).filter_map(|index| {
        let place = anchor?.apply(on_picture(0xd051, index));
        let at = flaws.faults.distort(rig, map.apply(place));
        // most specks are small
        let size = 0.02 + 0.18 * uniform(number(0xd051, index, 2)).powi(3);
        let blur = (target.blur_at(rig, i, place).powi(2) + PIXEL_MOMENT).sqrt();
        let darkness = between(number(0xd051, index, 3), 0.3, 0.95);
        Some(Speck { at, radius: size * map.scale_at(place), blur, darkness })
    });
    let sensor = (0..flaws.sensor_dust).map(|index| {
        let radius = between(number(0xd052, index, 2), 1.5, 7.0);
        let darkness = between(number(0xd052, index, 3), 0.1, 0.5);
        Speck { at: on_picture(0xd052, index), radius, blur: 0.6 * radius, darkness }
    });
    plate.chain(sensor).collect()
}
