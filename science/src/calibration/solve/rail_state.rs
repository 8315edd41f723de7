//! What the similarity estimates of the slices tell about the rail: positions, irregular steps, jumps of the image.

use crate::calibration::rail::{self, Law, OwnEstimate};
use crate::calibration::rail_anomalies::{self, RailAnomaly};
use crate::calibration::{rail_jumps, rail_order};

/// The rail, whichever transform model is selected in the end.
pub(in crate::calibration) struct RailState {
    /// Rail positions that the rail law is fitted with.
    pub positions: Vec<f64>,
    /// Rail positions derived from the scales, with standard deviations.
    pub positions_by_scale: Option<Vec<Option<(f64, f64)>>>,
    /// Scale parameter of each measured slice (0 at the reference) with its standard deviation.
    pub scales: Vec<Option<(f64, f64)>>,
    /// Irregular steps and jumps.
    pub anomalies: Vec<RailAnomaly>,
    /// The first slice after a sideways jump, if there is one.
    pub jump: Option<usize>,
    /// Per slice: true when it lies beside the line of the others. The rail law does not apply to it.
    pub displaced: Vec<bool>,
    /// Slopes of scale, rotation and shift over the positions, units.
    pub slopes: Option<[f64; 4]>,
}

/// Rail positions before any measurement: those that the user specified, else the indices of the slices.
pub(super) fn nominal_positions(given: Option<&[f64]>, count: usize) -> Vec<f64> {
    given.map_or_else(|| (0..count).map(|i| i as f64).collect(), <[f64]>::to_vec)
}

impl RailState {
    /// The rail by the similarity estimates `own`. `given`: rail positions that the user specified; `half`: px a unit.
    pub(super) fn of(own: &[Option<OwnEstimate>], given: Option<&[f64]>, reference: usize, half: f64) -> Self {
        let sigma = |o: &OwnEstimate, n: usize| o.covariance[(n, n)].max(0.0).sqrt();
        // of a turned image the parameters are cosine and sine
        let size = |o: &OwnEstimate| (1.0 + o.free[0]).hypot(o.free[1]) - 1.0;
        let scales: Vec<Option<(f64, f64)>> = own.iter().map(|o| o.as_ref().map(|o| (size(o), sigma(o, 0)))).collect();
        let order = rail_order::true_order(&scales);
        let mut positions = match (&order, given) {
            (Some(order), None) => rail_order::ranks(order, own.len()),
            _ => nominal_positions(given, own.len()),
        };
        let positions_by_scale = rail::positions_by_scale(&scales, &positions, reference);
        let mut anomalies = match (order, &positions_by_scale) {
            (Some(order), _) => vec![RailAnomaly::OutOfOrder { order }],
            (None, Some(positions_by_scale)) => rail_anomalies::step_anomalies(positions_by_scale, &positions),
            (None, None) => Vec::new(),
        };
        if let (Some(positions_by_scale), false) = (&positions_by_scale, anomalies.is_empty() || given.is_some()) {
            positions = filled(positions_by_scale, &positions);
        }
        let motion = |o: &OwnEstimate| [o.free[2], o.free[3], o.free[1]].map(|v| v * half);
        let motions: Vec<Option<[f64; 3]>> = own.iter().map(|o| o.as_ref().map(motion)).collect();
        let jumps = rail_jumps::find(&motions, &positions, half);
        let jump = jumps.iter().find_map(|a| if let RailAnomaly::Bumped { from, .. } = a { Some(*from) } else { None });
        let is_displaced =
            |i: usize| jumps.iter().any(|a| matches!(a, RailAnomaly::Displaced { slice, .. } if *slice == i));
        let displaced: Vec<bool> = (0..own.len()).map(is_displaced).collect();
        anomalies.extend(jumps);
        let law = Law::fit(&in_line(own, &displaced), &positions, jump);
        let slopes = law.map(|law| std::array::from_fn(|n| law.slopes()[n]));
        Self { positions, positions_by_scale, scales, anomalies, jump, displaced, slopes }
    }

    /// Adds the slices that differ `alone` from the model of the stack, unless it is known that they are displaced.
    pub(super) fn differ(&mut self, alone: &[bool]) {
        let found = (0..alone.len()).filter(|&i| alone[i] && !self.displaced[i]);
        self.anomalies.extend(found.map(|slice| RailAnomaly::Different { slice }));
    }
}

/// The estimates to which the rail law applies: those of displaced slices are left out.
pub(super) fn in_line(own: &[Option<OwnEstimate>], displaced: &[bool]) -> Vec<Option<OwnEstimate>> {
    own.iter().zip(displaced).map(|(o, displaced)| o.clone().filter(|_| !displaced)).collect()
}

/// Positions derived from the scales, extended by ordinary steps where there are none.
fn filled(positions_by_scale: &[Option<(f64, f64)>], positions: &[f64]) -> Vec<f64> {
    let known: Vec<usize> = (0..positions_by_scale.len()).filter(|&i| positions_by_scale[i].is_some()).collect();
    (0..positions_by_scale.len())
        .map(|i| {
            let nearest = known.iter().min_by_key(|k| k.abs_diff(i)).copied().unwrap_or(i);
            positions_by_scale[nearest].map_or(positions[i], |s| s.0) + positions[i] - positions[nearest]
        })
        .collect()
}
