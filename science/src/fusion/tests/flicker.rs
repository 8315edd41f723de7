//! One slice that a flash exposed differently changes nothing but its own share of the image, by every method.

use super::{
    rendered::{Rendered, rendered},
    *,
};
use crate::{
    quality::full_reference::psnr,
    synth::{Light, Rig, Scene},
};

/// The slice with every channel multiplied by its factor.
fn exposed(slice: &Raster, by: [f64; 3]) -> Raster {
    let Samples::Eight(samples) = &slice.samples else { panic!("8 bits expected") };
    let factors = by.into_iter().cycle();
    let new = samples.iter().zip(factors).map(|(&v, by)| (f64::from(v) * by).round().min(255.0) as u8).collect();
    Raster { samples: Samples::Eight(new), ..slice.clone() }
}

/// By how much the mean of each channel of `after` differs from that of `before`, where neither takes from `slice`.
fn change_elsewhere(before: &Fused, after: &Fused, slice: u16) -> [f64; 3] {
    let (mut old, mut new) = ([0.0; 3], [0.0; 3]);
    let pixels = values(&before.image);
    let pixels = pixels.as_chunks::<3>().0.iter().zip(values(&after.image).as_chunks::<3>().0.to_vec());
    for ((old_pixel, new_pixel), (a, b)) in pixels.zip(before.index.data.iter().zip(&after.index.data)) {
        if *a != slice && *b != slice {
            for c in 0..3 {
                old[c] += old_pixel[c];
                new[c] += new_pixel[c];
            }
        }
    }
    [0, 1, 2].map(|c| new[c] / old[c] - 1.0)
}

/// Stacks of so many slices, each with the place of its odd slice, and the exposures of that slice.
fn changes_no_other_part(stacks: &[(Scene, usize, usize)], exposures: &[[f64; 3]]) {
    for (scene, count, odd) in stacks {
        let (count, odd) = (*count, *odd);
        let Rendered { slices, plan, .. } = rendered(&Rig::sized(300, 220, count), scene, Light::Front);
        for method in Method::ALL {
            let plan = Plan { method, ..plan.clone() };
            let even = fused(&slices, &plan);
            for &by in exposures {
                let mut slices = slices.clone();
                slices[odd] = exposed(&slices[odd], by);
                let flash = fused(&slices, &plan);
                let change = change_elsewhere(&even, &flash, odd as u16);
                let same = psnr(&flash.image.luma(), &even.image.luma(), None).unwrap();
                println!("{method:?}, {count} slices, {by:?}: {change:.4?}, {same:.1} dB from the even stack");
                assert!(change.iter().all(|change| change.abs() < 0.02), "{method:?}, {count}, {by:?}: {change:?}");
                assert!(same > 34.0, "{method:?}, {count}, {by:?}: {same:.1} dB");
            }
        }
    }
}

#[test]
fn one_slice_of_another_exposure_or_colour_changes_no_other_part() {
    changes_no_other_part(&[(Scene::insect(3), 7, 2)], &[[1.6; 3], [1.0, 1.0, 1.3]]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_slices_of_another_exposure_or_colour_change_no_other_part() {
    changes_no_other_part(&[(Scene::insect(3), 7, 2)], &[[1.3; 3], [0.75; 3], [1.3, 1.0, 1.0]]);
    let exposures = [[1.3; 3], [1.6; 3], [0.75; 3], [1.3, 1.0, 1.0], [1.0, 1.0, 1.3]];
    changes_no_other_part(&[(Scene::flower(2), 4, 2), (Scene::insect(5), 9, 4)], &exposures);
}
