//! Thin near parts before strong texture: halo-corrected fusion keeps them.

use super::*;
use crate::{imaging::filter::disc::Disc, quality::full_reference::psnr};

const SIZE: (usize, usize) = (280, 160);
/// The slices in which the near and the far part are sharp.
const NEAR: usize = 1;
const FAR: usize = 6;

fn is_bar(x: usize) -> bool {
    x % 40 > 17 && x % 40 < 22
}

/// Nine slices and the true image: bars of weak contrast, 4 px wide, before a far part with strong texture. The blur
/// radius is 1.5 px per step.
fn bars() -> (Vec<Raster>, Plane<f32>) {
    let (width, height) = SIZE;
    let plane = |value: &dyn Fn(usize, usize) -> f64| Plane::from_fn(width, height, |x, y| value(x, y) as f32);
    let far = Disc::new(1.0).blurred(&plane(&|x, y| 60.0 + 140.0 * noise(x / 3, y / 3, 1)));
    let bar = plane(&|x, _| f64::from(u8::from(is_bar(x))));
    let near = plane(&|x, y| if is_bar(x) { 60.0 + 20.0 * noise(x, y / 4, 2) } else { 0.0 });
    let of_slice = |slice: usize| {
        let [of_near, of_far] = [NEAR, FAR].map(|sharp| Disc::new(1.5 * slice.abs_diff(sharp) as f32));
        let (far, bar, near) = (of_far.blurred(&far), of_near.blurred(&bar), of_near.blurred(&near));
        let value = |at: usize| {
            let shown = far.data[at] * (1.0 - bar.data[at]) + near.data[at];
            (f64::from(shown) + 2.0 * (noise(at, slice, 7) - 0.5)) / 255.0
        };
        let values = (0..width * height * 3).map(|at| value(at / 3));
        eight(width, height, &values.collect::<Vec<f64>>())
    };
    let truth = Plane::from_fn(width, height, |x, y| if is_bar(x) { near.at(x, y) } else { far.at(x, y) });
    ((0..9).map(of_slice).collect(), truth)
}

#[test]
fn thin_bars_before_strong_texture_are_kept() {
    let (slices, truth) = bars();
    let plan = Plan { near_first: Some(true), ..Plan::aligned(SIZE.0, SIZE.1, 9) };
    let inside = |x: usize, y: usize| (20..260).contains(&x) && (20..140).contains(&y);
    let fused = fused(&slices, &Plan { method: Method::HaloCorrected, ..plan });
    let places: Vec<(usize, usize)> =
        (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))).filter(|&(x, y)| inside(x, y)).collect();
    let near = |&&(x, y): &&(usize, usize)| usize::from(fused.index.at(x, y)) < NEAR + 2;
    let share = |of: &dyn Fn(usize) -> bool| {
        let places: Vec<_> = places.iter().filter(|(x, _)| of(*x)).collect();
        places.iter().filter(|place| near(place)).count() as f64 / places.len() as f64
    };
    let kept = share(&is_bar);
    // far from the bars
    let wrong = share(&|x| (0..6).contains(&(x % 40)));
    let counted = Plane::from_fn(SIZE.0, SIZE.1, |x, y| if inside(x, y) && is_bar(x) { 255u8 } else { 0 });
    let on_bars = psnr(&fused.image.luma(), &truth, Some(&counted)).unwrap();
    assert!(kept > 0.8, "{kept:.2} of the bars are of their slice");
    assert!(wrong < 0.01, "{wrong:.3} of the far part is of the slice of the bars");
    assert!(on_bars > 25.0, "{on_bars:.1} dB on the bars");
}
