//! Whether front light and back light changed places: one picture of both tells.

use super::{border, otsu::Histogram, share, shares};
use crate::imaging::{Plane, Raster, thumbnail};

/// Longer side of the copies that are compared, px.
const SIDE: usize = 400;
/// A silhouette is told from its background at least so well ...
const SEPARABILITY: f64 = 0.85;
/// ... takes at most this share of the border, and lets at most this share of the light through.
const BORDER: f64 = 0.5;
const PASSES: f64 = 0.35;
/// Lit from the front the object is so many times brighter against its background, and has so many times the detail.
const BRIGHTER: f64 = 2.0;
const MORE_DETAIL: f64 = 3.0;
/// Mean difference of neighbouring pixels, as a share of full scale, that noise and compression alone make.
const NO_DETAIL: f64 = 0.004;
/// The outline, which has detail in both, is this far away, px.
const MARGIN: usize = 3;
/// Fewer pixels say nothing.
const LEAST: usize = 100;

/// True when `front` shows a silhouette and `back` shows the same object lit: the folders were exchanged, or the lamps
/// were.
///
/// The dark part of `front` is the object, if there is one. In a stack whose lights are right the back light is darker
/// there than the front light, or shows less of it.
pub fn exchanged(front: &Raster, back: &Raster) -> bool {
    let (front, back) = (thumbnail::luma(front, SIDE), thumbnail::luma(back, SIDE));
    let (width, height) = (front.width, front.height);
    if (back.width, back.height) != (width, height) {
        return false;
    }
    let (front, back) = (shares(&front), shares(&back));
    let Some(otsu) = Histogram::of(front.iter().copied()).otsu() else { return false };
    let data = front.iter().map(|&v| if f64::from(v) < otsu.threshold { 255 } else { 0 }).collect();
    let object = Plane { width, height, data };
    if otsu.separability < SEPARABILITY || share(border(&object)) > BORDER {
        return false;
    }
    let (Some(front), Some(back)) = (Look::of(&front, &object), Look::of(&back, &object)) else { return false };
    front.brightness <= PASSES
        && back.brightness > BRIGHTER * front.brightness
        && back.detail > MORE_DETAIL * front.detail.max(NO_DETAIL)
}

/// What one light shows of an object.
struct Look {
    /// Of the object over that of its surroundings.
    brightness: f64,
    /// Mean difference of neighbouring pixels within the object.
    detail: f64,
}

impl Look {
    /// None when there is too little of the object, or no light around it.
    fn of(grey: &[f32], object: &Plane<u8>) -> Option<Self> {
        let inner = eroded(object);
        let mean = |picked: &dyn Fn(usize) -> bool| {
            let picked: Vec<f64> = (0..grey.len()).filter(|&at| picked(at)).map(|at| f64::from(grey[at])).collect();
            (picked.len() >= LEAST).then(|| picked.iter().sum::<f64>() / picked.len() as f64)
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

/// Pixels whose surroundings of [`MARGIN`] px are all object.
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
    fn lights_of_every_scene_are_told_apart() {
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
            assert!(!exchanged(&front, &back), "{name}: the lights are right");
            assert!(!exchanged(&front, &front) && !exchanged(&back, &back), "{name}: one light twice");
            if name.contains("insect") {
                assert!(exchanged(&back, &front), "{name}: the lights are exchanged");
            }
        }
    }

    #[test]
    fn plain_and_uneven_pictures_are_not_accused() {
        let plain = |value: u8| Raster::eight(60, 40, 1, vec![value; 2_400]);
        assert!(!exchanged(&plain(0), &plain(255)));
        assert!(!exchanged(&plain(9), &Raster::eight(40, 60, 1, vec![7; 2_400])));
    }
}
