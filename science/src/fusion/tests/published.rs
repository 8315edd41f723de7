//! Guided filtering fusion of real image pairs, against the figures of the published implementation.

use super::*;
use crate::quality::two_source::tests::over_lytro;

#[test]
#[ignore = "needs the pictures of PINSTACK_SHARED"]
fn the_ten_lytro_pairs_score_as_the_published_implementation() {
    let by_guided = |_, a: &Raster, b: &Raster| {
        let plan = Plan { method: Method::Guided, ..Plan::aligned(a.width, a.height, 2) };
        fused(&[a.clone(), b.clone()], &plan).image
    };
    let found = over_lytro(by_guided);
    println!("Q_G, Q_W, VIFF, SF: {found:.4?}");
    for ((found, published), tolerance) in
        found.into_iter().zip([0.7498, 0.9284, 0.943, 19.38]).zip([0.003, 0.003, 0.003, 0.005 * 19.38])
    {
        assert!((found - published).abs() <= tolerance, "{found} instead of {published}");
    }
}
