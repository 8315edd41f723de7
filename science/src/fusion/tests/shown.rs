//! Images of which only some pixels are shown.

use super::{
    rendered::{Rendered, rendered},
    *,
};
use crate::{
    fusion::shown::MARGIN,
    synth::{Light, Rig, Scene},
    types::metrics::FusionMetrics,
};

/// A stack, and a plane in which a block, a line and a dot are shown. The right third is far from all of them.
fn case() -> (Rendered, Plane<u8>) {
    let stack = rendered(&Rig { seed: 5, ..Rig::sized(900, 300, 7) }, &Scene::insect(5), Light::Front);
    let shown = Plane::from_fn(900, 300, |x, y| match (x, y) {
        (90..150, 60..130) | (150..260, 100) => 255,
        // faint: the tip of a hair
        (330, 240) => 1,
        _ => 0,
    });
    (stack, shown)
}

/// Whether a pixel that is shown is within `margin` px along x and y.
fn near(shown: &Plane<u8>, margin: usize) -> Plane<bool> {
    let range = |at: usize, length: usize| at.saturating_sub(margin)..=(at + margin).min(length - 1);
    let (width, height) = (shown.width, shown.height);
    let beside = Plane::from_fn(width, height, |x, y| range(x, width).any(|x| shown.at(x, y) != 0));
    Plane::from_fn(width, height, |x, y| range(y, height).any(|y| beside.at(x, y)))
}

#[test]
fn what_is_shown_and_its_surroundings_are_fused_as_in_the_whole_image() {
    let (stack, shown) = case();
    let near = near(&shown, MARGIN);
    for method in Method::ALL {
        let plan = Plan { method, ..stack.plan.clone() };
        let whole = fused(&stack.slices, &plan);
        let expected = values(&whole.image);
        for tile in [64, 150, 1000] {
            let request = FusionRequest { shown: Some(&shown), ..FusionRequest::default() };
            let part = fused_as_asked(&stack.slices, &plan, &request, tile);
            let found = values(&part.image);
            let pixels = found.chunks_exact(3).zip(expected.chunks_exact(3)).zip(&near.data);
            let wrong = pixels.filter(|((found, expected), near)| **near && found != expected).count();
            assert_eq!(wrong, 0, "{method:?}, tiles of {tile} px");
            let slices = part.index.data.iter().zip(&whole.index.data).zip(&near.data);
            assert!(slices.filter(|(_, near)| **near).all(|((ours, theirs), _)| ours == theirs), "{method:?}");
            assert_eq!(part.valid, whole.valid, "{method:?}");
            let refined_everywhere = part.index == whole.index;
            assert_eq!(refined_everywhere, !method.refines_the_index(), "{method:?}: what is far is not refined");
        }
    }
}

#[test]
fn far_from_what_is_shown_are_the_pixels_of_the_reference_slice() {
    let (stack, shown) = case();
    let reference = values(&warped_slice(&&stack.slices[..], &stack.plan, stack.plan.reference).unwrap());
    let near = near(&shown, 64 + 2 * MARGIN);
    for method in Method::ALL {
        let plan = Plan { method, ..stack.plan.clone() };
        let request = FusionRequest { shown: Some(&shown), ..FusionRequest::default() };
        let found = values(&fused_as_asked(&stack.slices, &plan, &request, 64).image);
        let pixels = found.chunks_exact(3).zip(reference.chunks_exact(3)).zip(&near.data);
        let (mut compared, mut other) = (0, 0);
        for ((found, reference), _) in pixels.filter(|(_, near)| !**near) {
            (compared, other) = (compared + 1, other + usize::from(found != reference));
        }
        assert!(compared > 5_000 && other == 0, "{method:?}: {other} of {compared}");
    }
}

#[test]
fn metrics_of_the_object_are_the_same_whatever_else_is_shown() {
    let (stack, object) = case();
    for method in Method::ALL {
        let plan = Plan { method, ..stack.plan.clone() };
        let of = |shown| {
            let request = FusionRequest { metrics: true, object: Some(&object), shown, decision: false };
            fused_as_asked(&stack.slices, &plan, &request, 64).quality.unwrap()
        };
        let (mut part, mut whole) = (of(Some(&object)), of(None));
        let [ours, theirs] = [&mut part, &mut whole].map(|quality| std::mem::take(&mut quality.fusion));
        assert_eq!(part, whole, "{method:?}");
        // sums over windows are rounded differently beside other values
        let metrics = |of: FusionMetrics| {
            [of.q_g_top, of.q_w_top, of.sharpness_retention, of.overshoot_fraction, of.tenengrad, of.mean_level]
                .map(|metric| metric.unwrap())
        };
        for (ours, theirs) in metrics(ours).into_iter().zip(metrics(theirs)) {
            assert!((ours - theirs).abs() < 1e-5 * theirs.abs().max(1.0), "{method:?}: {ours} for {theirs}");
        }
    }
}

#[test]
fn if_nothing_is_shown_nothing_is_fused() {
    let (stack, _) = case();
    let reference = warped_slice(&&stack.slices[..], &stack.plan, stack.plan.reference).unwrap();
    let nothing = Plane::filled(900, 300, 0);
    for method in Method::ALL {
        let plan = Plan { method, ..stack.plan.clone() };
        let request = FusionRequest { metrics: true, object: Some(&nothing), shown: Some(&nothing), decision: false };
        assert_eq!(fused_as_asked(&stack.slices, &plan, &request, 64).image, reference, "{method:?}");
    }
}
