//! Identification of the dots of a tracked slice: are the labels, which tracking carried over from the neighbour, those
//! of the code?

use super::place::{CodePlace, Identity, agreement};
use super::{reading, recognise_readings, significance};
use crate::calibration::lattice::{Label, Places, label_range};
use crate::imaging::Plane;
use crate::target::CODE_PERIOD;

/// Least certainty that confirms labels, where there is only one hypothesis.
const CONFIRMED: f64 = 6.0;

/// What the code of a slice says about its labels.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::calibration) enum Identification {
    /// The code cannot be read.
    Unreadable,
    /// The labels are right.
    Confirmed(Identity),
    /// The labels were wrong by whole steps: the labels of the same dots by the code.
    Corrected(Places, Identity),
    /// The image is turned by quarter turns or mirrored (true) against the slice in which the grid was found.
    Turned(bool),
}

/// Compares the labels of `places` (px of the plane) with the code. `code` is where the labels lie in the code by the
/// slice in which the grid was found.
pub(in crate::calibration) fn identify(contrast: &Plane<f32>, places: &Places, code: &CodePlace) -> Identification {
    let readings = reading::read(contrast, places);
    let weights: Vec<f64> = readings.iter().map(|(_, reading)| *reading).collect();
    let certainty = -significance::chance(agreement(&readings, code), &weights);
    if certainty >= CONFIRMED {
        return Identification::Confirmed(Identity { shift: [0; 2], certainty });
    }
    let Some(found) = recognise_readings(&readings) else { return Identification::Unreadable };
    if found.place.symmetry != code.symmetry {
        return Identification::Turned(found.place.symmetry.determinant() != code.symmetry.determinant());
    }
    let identity = Identity { shift: [0; 2], certainty: found.certainty };
    Identification::Corrected(relabelled(places, &found.place, code), identity)
}

/// The same dots with labels that lie in the code as `to` says, when `from` says where their present labels lie.
pub(in crate::calibration) fn relabelled(places: &Places, from: &CodePlace, to: &CodePlace) -> Places {
    let back = to.symmetry.inverse();
    let unshifted = |label: Label| {
        let at = from.position(label);
        back.apply([at[0] - to.shift[0], at[1] - to.shift[1]])
    };
    // The code is periodic. Labels are counted from a dot in the middle of the image in which the grid was found.
    let period = CODE_PERIOD as i32;
    let nearest = |v: i32| (v + period / 2).rem_euclid(period) - period / 2;
    let middle = middle(places);
    let wrong = unshifted(middle);
    let by = [0, 1].map(|a| nearest(wrong[a]) - wrong[a]);
    places
        .iter()
        .map(|(label, at)| {
            let [i, j] = unshifted(*label);
            ([i + by[0], j + by[1]], *at)
        })
        .collect()
}

/// The middle of the labels.
fn middle(places: &Places) -> Label {
    [0, 1].map(|axis| {
        let (low, high) = label_range(places.keys().copied(), axis);
        if places.is_empty() { 0 } else { (low + high) / 2 }
    })
}
