//! Detects stacks whose front light and back light changed places, from one picture of each.

use super::{border, grey_values, object_share, otsu::Histogram};
use crate::imaging::{Plane, Raster, thumbnail};

/// Longer side of the copies that are compared, px.
const SIDE: usize = 400;
/// Criteria of a silhouette: least separability, largest share of the border that is object, and largest brightness of
/// the object relative to the background.
const MIN_SEPARABILITY: f64 = 0.85;
const MAX_BORDER: f64 = 0.5;
const MAX_BRIGHTNESS: f64 = 0.35;
/// Criteria of the same object lit from the front: its relative brightness and its detail, in multiples of the
/// silhouette's.
const BRIGHTER: f64 = 2.0;
const MORE_DETAIL: f64 = 3.0;
/// Mean difference of neighbouring pixels that noise and compression alone make, as a share of full scale.
const NO_DETAIL: f64 = 0.004;
/// Distance from the outline, which has detail in both lights, from which pixels count, px.
const MARGIN: usize = 3;
/// Least number of pixels for a mean.
const MIN_PIXELS: usize = 100;

/// True when `front` shows a silhouette and `back` shows the same object lit: the folders or the lamps were exchanged.
///
/// The object is the dark part of `front` by Otsu's threshold. When the lights are right, that part is darker in the
/// back light than in the front light, or has less detail there.
pub fn lights_exchanged(front: &Raster, back: &Raster) -> bool {
    let (front, back) = (thumbnail::luma(front, SIDE), thumbnail::luma(back, SIDE));
    let (width, height) = (front.width, front.height);
    if (back.width, back.height) != (width, height) {
        return false;
    }
    let (front, back) = (grey_values(&front), grey_values(&back));
    let Some(otsu) = Histogram::of(front.iter().copied()).otsu() else { return false };
    let data = front.iter().map(|&v| if f64::from(v) < otsu.threshold { 255 } else { 0 }).collect();
    let object = Plane { width, height, data };
    if otsu.separability < MIN_SEPARABILITY || object_share(border(&object)) > MAX_BORDER {
        return false;
    }
    let (Some(front), Some(back)) = (Appearance::of(&front, &object), Appearance::of(&back, &object)) else {
        return false;
    };
    front.brightness <= MAX_BRIGHTNESS
        && back.brightness > BRIGHTER * front.brightness
        && back.detail > MORE_DETAIL * front.detail.max(NO_DETAIL)
}

/// The object in one light.
struct Appearance {
    /// Mean brightness of the object over that of its surroundings.
    brightness: f64,
    /// Mean difference of neighbouring pixels within the object.
    detail: f64,
}

impl Appearance {
    /// None when the object or its surroundings are too small, or the surroundings are black.
    fn of(grey: &[f32], object: &Plane<u8>) -> Option<Self> {
        let inner = eroded(object);
        let mean = |picked: &dyn Fn(usize) -> bool| {
            let picked: Vec<f64> = (0..grey.len()).filter(|&at| picked(at)).map(|at| f64::from(grey[at])).collect();
            (picked.len() >= MIN_PIXELS).then(|| picked.iter().sum::<f64>() / picked.len() as f64)
        };
        let around = mean(&|at| object.data[at] == 0)?;
        let within = mean(&|at| inner.data[at] != 0)?;
        let width = object.width;
        // the margin keeps the neighbours within the picture
        let steps = (0..grey.len())
            .filter(|&at| inner.data[at] != 0)
            .map(|at| f64::from((grey[at + 1] - grey[at]).abs() + (grey[at + width] - grey[at]).abs()));
        let steps: Vec<f64> = steps.collect();
        let detail = steps.iter().sum::<f64>() / steps.len().max(1) as f64;
        (around > 0.0).then_some(Self { brightness: within / around, detail })
    }
}

/// Pixels whose surroundings within [`MARGIN`] px are all object.
fn eroded(object: &Plane<u8>) -> Plane<u8> {
    let (width, height) = (object.width, object.height);
    let is_inner = |x: usize, y: usize| {
        x >= MARGIN
            && y >= MARGIN
            && x + MARGIN < width
            && y + MARGIN < height
            && (y - MARGIN..=y + MARGIN).all(|y| object.row(y)[x - MARGIN..=x + MARGIN].iter().all(|&v| v != 0))
    };
    Plane::from_fn(width, height, |x, y| if is_inner(x, y) { 255 } else { 0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::{Light, Rig, Scene, Stage};

    #[test]
    fn exchanged_lights_are_detected_and_right_ones_are_not_reported() {
        let rig = Rig::sized(360, 240, 5);
        for (name, scene) in [
            ("insect", Scene::insect(3)),
            ("another insect", Scene::insect(11)),
            ("flower", Scene::flower(5)),
            ("wing", Scene::wing(2)),
            ("plates", Scene::plates(1)),
        ] {
            let stage = Stage::new(&rig, &scene);
            let [front, back] = [Light::Front, Light::Back].map(|light| stage.render(light, 2));
            assert!(!lights_exchanged(&front, &back), "{name}: the lights are right");
            assert!(!lights_exchanged(&front, &front) && !lights_exchanged(&back, &back), "{name}: one light twice");
            if name.contains("insect") {
                assert!(lights_exchanged(&back, &front), "{name}: the lights are exchanged");
            }
        }
    }

    #[test]
    fn pictures_of_one_value_or_of_different_sizes_are_not_reported() {
        let plain = |value: u8| Raster::eight(60, 40, 1, vec![value; 2_400]);
        assert!(!lights_exchanged(&plain(0), &plain(255)));
        assert!(!lights_exchanged(&plain(9), &Raster::eight(40, 60, 1, vec![7; 2_400])));
    }
}
