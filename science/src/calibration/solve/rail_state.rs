//! What the similarity estimates of the slices tell about the rail: positions, irregular steps, jumps of the image.

use crate::calibration::rail::{self, Law, OwnEstimate};
use crate::calibration::rail_anomalies::{self, RailAnomaly};
use crate::calibration::size_law::{ScaleSample, SizeLaw};
use crate::calibration::{rail_jumps, rail_order};
use crate::types::profile::CaptureMode;

/// What moved, by the sizes; the flag says that the steps between the positions are known.
pub(super) type Capture<'a> = &'a dyn Fn(&[ScaleSample], bool) -> Option<CaptureMode>;

/// Least standard deviation of a size.
const LEAST_SIGMA: f64 = 1e-6;

/// The rail, whichever transform model is selected in the end.
pub(in crate::calibration) struct RailState {
    /// Rail positions.
    pub positions: Vec<f64>,
    /// The same, relative to the reference slice, in the coordinate over which the transforms are linear
    /// ([`SizeLaw::straight`]). The rail law is fitted with these.
    pub coordinates: Vec<f64>,
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
    /// Slopes of scale, rotation and shift over the coordinates, units.
    pub slopes: Option<[f64; 4]>,
}

/// Rail positions before any measurement: those that the user specified, else the indices of the slices.
pub(super) fn nominal_positions(given: Option<&[f64]>, count: usize) -> Vec<f64> {
    given.map_or_else(|| (0..count).map(|i| i as f64).collect(), <[f64]>::to_vec)
}

impl RailState {
    /// The rail by the similarity estimates `own`. `given`: rail positions that the user specified; `half`: px a unit.
    pub(super) fn of(
        own: &[Option<OwnEstimate>],
        given: Option<&[f64]>,
        reference: usize,
        half: f64,
        capture: Capture,
    ) -> Self {
        let sigma = |o: &OwnEstimate, n: usize| o.covariance[(n, n)].max(0.0).sqrt();
        // of a turned image the parameters are cosine and sine
        let size = |o: &OwnEstimate| (1.0 + o.free[0]).hypot(o.free[1]) - 1.0;
        let scales: Vec<Option<(f64, f64)>> = own.iter().map(|o| o.as_ref().map(|o| (size(o), sigma(o, 0)))).collect();
        let order = rail_order::true_order(&scales);
        let mut positions = match (&order, given) {
            (Some(order), None) => rail_order::ranks(order, own.len()),
            _ => nominal_positions(given, own.len()),
        };
        let mut positions_by_scale = rail::positions_by_scale(&scales, &positions, reference);
        let steps = |by_scale: &Option<Vec<Option<(f64, f64)>>>| match (&order, by_scale) {
            (Some(order), _) => vec![RailAnomaly::OutOfOrder { order: order.clone() }],
            (None, Some(by_scale)) => rail_anomalies::step_anomalies(by_scale, &positions),
            (None, None) => Vec::new(),
        };
        let mut anomalies = steps(&positions_by_scale);
        let bend = bent(&scales, &positions, reference, given.is_some() || anomalies.is_empty(), capture);
        let mut coordinates = relative(&positions, reference);
        if let Some(law) = bend {
            coordinates = coordinates.iter().map(|z| law.straight(*z)).collect();
            let to_rail = |(u, sigma): (f64, f64)| (positions[reference] + law.position(u), sigma);
            positions_by_scale = rail::positions_by_scale(&scales, &coordinates, reference)
                .map(|all| all.into_iter().map(|at| at.map(to_rail)).collect());
            anomalies = steps(&positions_by_scale);
        }
        if let (Some(positions_by_scale), false) = (&positions_by_scale, anomalies.is_empty() || given.is_some()) {
            positions = filled(positions_by_scale, &positions);
            let straight = |z: f64| bend.map_or(z, |law| law.straight(z));
            coordinates = relative(&positions, reference).into_iter().map(straight).collect();
        }
        let motion = |o: &OwnEstimate| [o.free[2], o.free[3], o.free[1]].map(|v| v * half);
        let motions: Vec<Option<[f64; 3]>> = own.iter().map(|o| o.as_ref().map(motion)).collect();
        let jumps = rail_jumps::find(&motions, &coordinates, half);
        let jump = jumps.iter().find_map(|a| if let RailAnomaly::Bumped { from, .. } = a { Some(*from) } else { None });
        let is_displaced =
            |i: usize| jumps.iter().any(|a| matches!(a, RailAnomaly::Displaced { slice, .. } if *slice == i));
        let displaced: Vec<bool> = (0..own.len()).map(is_displaced).collect();
        anomalies.extend(jumps);
        let law = Law::fit(&in_line(own, &displaced), &coordinates, jump);
        let slopes = law.map(|law| std::array::from_fn(|n| law.slopes()[n]));
        Self { positions, coordinates, positions_by_scale, scales, anomalies, jump, displaced, slopes }
    }

    /// Adds the slices that differ `alone` from the model of the stack, unless it is known that they are displaced.
    pub(super) fn differ(&mut self, alone: &[bool]) {
        let found = (0..alone.len()).filter(|&i| alone[i] && !self.displaced[i]);
        self.anomalies.extend(found.map(|slice| RailAnomaly::Different { slice }));
    }
}

/// Positions relative to that of the reference slice.
fn relative(positions: &[f64], reference: usize) -> Vec<f64> {
    positions.iter().map(|z| z - positions[reference]).collect()
}

/// The law of the sizes where it is no line: of a rail that moves the lens. `None` where what moved is not certain.
fn bent(
    scales: &[Option<(f64, f64)>],
    positions: &[f64],
    reference: usize,
    is_even: bool,
    capture: Capture,
) -> Option<SizeLaw> {
    let sample = |(scale, z): (&Option<(f64, f64)>, f64)| {
        scale.map(|(growth, sigma)| ScaleSample { position: z, size: 1.0 + growth, sigma: sigma.max(LEAST_SIGMA) })
    };
    let coordinates = relative(positions, reference);
    let sizes: Vec<ScaleSample> = scales.iter().zip(coordinates.iter().copied()).filter_map(sample).collect();
    let mode = capture(&sizes, is_even).filter(|mode| *mode != CaptureMode::FixedLens)?;
    // nearer than half of its distance no lens comes to its target
    SizeLaw::fit(&sizes, Some(mode)).filter(|law| coordinates.iter().all(|z| law.bend * law.growth * z < 0.5))
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
