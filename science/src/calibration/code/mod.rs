//! The code of a coded target: which dot of the target a dot of the image is.
//!
//! Input: the contrast of a slice and the labelled positions of its dots. Output: the position of the labels in the
//! code, with the probability that chance gives such an agreement.
//!
//! | module | what it does |
//! |---|---|
//! | `reading` | the size of each dot relative to the others, -1 to 1 |
//! | `search` | correlation with the code over all shifts and symmetries |
//! | `significance` | an upper bound of the probability of a chance agreement |
//! | `equalisation` | makes the dots of both sizes equal, so that phases are not biased |
//! | `place` | where the labels of a grid lie in the code |
//! | `identification` | compares the labels of a tracked slice with the code, and corrects them |

mod equalisation;
mod identification;
mod place;
mod reading;
mod search;
mod significance;

pub(super) use equalisation::SizeDifferences;
pub(super) use identification::{Identification, identify, relabelled};
pub(super) use place::{CodePlace, Identity, RecognisedCode};

use super::lattice::{Label, Places};
use crate::imaging::Plane;
use crate::target::CODE_PERIOD;

/// Least certainty with which a code is recognised: the probability of a chance agreement is below 1e-9.
const RECOGNISED: f64 = 9.0;

/// The code of the grid with dots at `places` (px of the plane), or `None` when the probability of a chance agreement
/// is not below 1e-9.
pub(super) fn recognise(contrast: &Plane<f32>, places: &Places) -> Option<RecognisedCode> {
    let readings = reading::read(contrast, places);
    recognise_readings(&readings)
}

fn recognise_readings(readings: &[(Label, f64)]) -> Option<RecognisedCode> {
    let weights: Vec<f64> = readings.iter().map(|(_, reading)| *reading).collect();
    // not worth a search
    if significance::chance(weights.iter().map(|w| w.abs()).sum(), &weights) + log_hypotheses() > -RECOGNISED {
        return None;
    }
    let (place, agreement) = search::best(readings)?;
    let certainty = -(significance::chance(agreement, &weights) + log_hypotheses());
    (certainty >= RECOGNISED).then_some(RecognisedCode { place, certainty })
}

/// Decadic logarithm of the number of shifts and symmetries that are compared.
fn log_hypotheses() -> f64 {
    (8.0 * f64::from(CODE_PERIOD).powi(2)).log10()
}

#[cfg(test)]
mod tests;
