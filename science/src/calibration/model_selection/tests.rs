//! The selection on stacks whose transforms are known.

use super::*;
use crate::calibration::testkit::Noise;

/// Nine slices of 150 dots whose transforms are `map(dz)`.
fn stack(map: impl Fn(f64) -> Parameters, seed: u64) -> (Vec<Evidence>, Vec<f64>) {
    let mut noise = Noise(seed);
    let offsets: Vec<f64> = (-4..=4).map(f64::from).collect();
    let evidence = offsets
        .iter()
        .map(|dz| {
            let labels: Vec<Label> = (0..150).map(|k| [k % 15, k / 15]).collect();
            let matches = labels.iter().map(|l| {
                let base = [f64::from(l[0]) / 9.0 - 0.78, f64::from(l[1]) / 9.0 - 0.5];
                let here = transform_models::map_point(&map(*dz), base).map(|v| v + 5e-5 * noise.normal());
                Match { base, here, sigma: 5e-5 }
            });
            let matches = if *dz == 0.0 { Vec::new() } else { matches.collect() };
            Evidence { labels, matches, overlap: 2.25 }
        })
        .collect();
    (evidence, offsets)
}

/// Corner errors from the fits of the models.
fn corners(evidence: &[Evidence], offsets: &[f64], model: StackModel) -> Vec<CornerError> {
    let frame = transform_models::Frame { centre: [400.0, 300.0], half: 500.0 };
    let all: Vec<Vec<Match>> = evidence.iter().map(|e| e.matches.clone()).collect();
    let rail_fit = RailFit::fit(&all, offsets).expect("a law");
    let at = |model: TransformModel, e: &Evidence| {
        let fit = transform_models::fit(model, &e.matches).expect("a fit");
        let sigma = transform_models::corner_sigma(model, &fit.free, &fit.covariance, &frame, 801, 601);
        (frame.homography(&model.parameters(&fit.free)).expect("regular"), sigma)
    };
    let measured = (0..offsets.len()).filter(|&i| !evidence[i].matches.is_empty());
    measured
        .map(|i| {
            let (full, full_sigma) = at(TransformModel::Homography, &evidence[i]);
            let (own, sigma) = match model {
                StackModel::PerSlice(model) => at(model, &evidence[i]),
                StackModel::RailLinear => (
                    frame.homography(&rail_fit.parameters(offsets[i])).expect("regular"),
                    500.0 * rail_fit.corner_sigma(offsets[i]),
                ),
            };
            CornerError { sigma, full_sigma, doubt: 0.0, apart: own.corner_distance(&full, 801, 601) }
        })
        .collect()
}

fn select(evidence: &[Evidence], offsets: &[f64], requested: ModelChoice) -> Selection {
    let all: Vec<&Evidence> = evidence.iter().collect();
    select_model(&all, offsets, 500.0, &|m| corners(evidence, offsets, m), requested)
}

fn chosen(map: impl Fn(f64) -> Parameters) -> HomographyModel {
    let (evidence, offsets) = stack(map, 3);
    let Selection { model, candidates, .. } = select(&evidence, &offsets, ModelChoice::Auto);
    assert_eq!(candidates.iter().filter(|c| c.chosen).count(), 1);
    assert!(candidates.iter().all(|c| c.held_out_px.is_some() && c.bic.is_some()));
    model.name()
}

#[test]
fn the_model_with_the_least_corner_error_is_selected() {
    assert_eq!(chosen(|z| [0.007 * z, 0.0, 0.001 * z, 0.0, 0.007 * z, 0.0, 0.0, 0.0]), HomographyModel::RailLinear);
    let turning = |z: f64| [0.007 * z, -3e-4 * z * z, 0.001 * z, 3e-4 * z * z, 0.007 * z, 0.0, 0.0, 0.0];
    assert_eq!(chosen(turning), HomographyModel::Similarity);
    assert_eq!(chosen(|z| [0.007 * z, 1e-3 * z, 0.0, 0.0, 0.008 * z, 0.0, 0.0, 0.0]), HomographyModel::Affine);
    assert_eq!(
        chosen(|z| [0.007 * z, 0.0, 0.0, 0.0, 0.007 * z, 0.0, 8e-4 * z, -5e-4 * z]),
        HomographyModel::Homography
    );
}

#[test]
fn a_requested_model_is_used_and_the_better_one_is_named() {
    let (evidence, offsets) = stack(|z| [0.007 * z, 0.0, 0.0, 0.0, 0.007 * z, 0.0, 8e-4 * z, 0.0], 4);
    let Selection { model, reason, .. } = select(&evidence, &offsets, ModelChoice::Similarity);
    assert_eq!(model.name(), HomographyModel::Similarity);
    assert!(reason.contains("the dots favour a homography"), "{reason}");
}
