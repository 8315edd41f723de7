//! Halo-corrected fusion: against rendered truth, and by property.

use super::{
    rendered::{Rendered, rendered},
    *,
};
use crate::{
    imaging::filter::disc::Disc,
    quality::full_reference::psnr,
    synth::{Light, Rig, Scene},
};

pub(super) fn halo_corrected(plan: Plan) -> Plan {
    Plan { method: Method::HaloCorrected, ..plan }
}

/// A rendered stack with its plan and the true image. `edges` are the pixels within 8 px of a depth step, `flat` all
/// others.
struct Case {
    slices: Vec<Raster>,
    plan: Plan,
    truth: Plane<f32>,
    edges: Plane<u8>,
    flat: Plane<u8>,
}

impl Case {
    fn new(scene: &Scene, seed: u64) -> Self {
        let rig = Rig { seed, ..Rig::sized(480, 320, 11) };
        let Rendered { slices, plan, truth } = rendered(&rig, scene, Light::Front);
        let depth = |x: usize, y: usize| {
            let slice = truth.slice.at(x, y);
            if slice.is_nan() { 99.0 } else { slice }
        };
        let step = Plane::from_fn(480, 320, |x, y| {
            let (right, below) = ((x + 1).min(479), (y + 1).min(319));
            (depth(x, y) - depth(right, y)).abs() > 1.0 || (depth(x, y) - depth(x, below)).abs() > 1.0
        });
        // a margin of the canvas is not covered by every slice
        let counted = |x: usize, y: usize| (16..464).contains(&x) && (16..304).contains(&y);
        let near_step = Plane::from_fn(480, 320, |x, y| {
            let rows = y.saturating_sub(8)..(y + 9).min(320);
            rows.into_iter().any(|v| step.row(v)[x.saturating_sub(8)..(x + 9).min(480)].iter().any(|&step| step))
        });
        let of = |edge: bool| {
            Plane::from_fn(480, 320, |x, y| if counted(x, y) && near_step.at(x, y) == edge { 255u8 } else { 0 })
        };
        Self { slices, plan, truth: truth.sharp.luma(), edges: of(true), flat: of(false) }
    }

    /// PSNR at edges and elsewhere, dB.
    fn score(&self, method: Method) -> [f64; 2] {
        let fused = fused(&self.slices, &Plan { method, ..self.plan.clone() });
        [&self.edges, &self.flat].map(|mask| psnr(&fused.image.luma(), &self.truth, Some(mask)).unwrap())
    }
}

fn nearer_than_other_methods(scenes: [(Scene, u64); 2]) {
    for (scene, seed) in scenes {
        let case = Case::new(&scene, seed);
        let [edges, elsewhere] = case.score(Method::HaloCorrected);
        for other in [Method::Guided, Method::Pyramid] {
            let [other_edges, other_elsewhere] = case.score(other);
            let text = format!(
                "seed {seed}, {other:?}: edges {edges:.2} against {other_edges:.2}, elsewhere {elsewhere:.2} against \
                 {other_elsewhere:.2}"
            );
            println!("{text}");
            assert!(edges > other_edges + 0.2, "{text}");
            assert!(elsewhere > other_elsewhere - 0.1, "{text}");
        }
    }
}

#[test]
fn it_is_nearer_to_the_truth_than_the_other_methods_at_edges_and_elsewhere() {
    nearer_than_other_methods([(Scene::plates(3), 5), (Scene::insect(2), 6)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_scenes_are_nearer_to_the_truth_than_by_other_methods() {
    nearer_than_other_methods([(Scene::flower(2), 7), (Scene::plates(8), 8)]);
}

/// Five slices. Left: texture, in focus in the middle slice. Right: haze that no slice shows sharp; its brightness
/// differs from slice to slice, and it has specks of noise.
fn haze() -> Vec<Raster> {
    let texture = Plane::from_fn(200, 160, |x, y| 90.0 + 60.0 * noise(x, y, 0) as f32);
    let of_slice = |slice: usize| {
        let blurred = Disc::new(4.0 * slice.abs_diff(2) as f32).blurred(&texture);
        let value = |x: usize, y: usize| match x {
            ..200 => f64::from(blurred.at(x, y)) + 2.0 * (noise(x, y, 7 + slice) - 0.5),
            _ => {
                let specks = if (5.0 * noise(x / 16, y / 16, 30)) as usize == slice { 12.0 } else { 4.0 };
                170.0 - 12.0 * slice as f64 + 0.2 * (y as f64 - 80.0) + specks * (noise(x, y, 90 + slice) - 0.5)
            }
        };
        let values = (0..280 * 160 * 3).map(|at| value(at / 3 % 280, at / 840) / 255.0);
        eight(280, 160, &values.collect::<Vec<f64>>())
    };
    (0..5).map(of_slice).collect()
}

#[test]
fn haze_that_no_slice_shows_sharp_gets_no_patches() {
    let slices = haze();
    let plan = Plan { near_first: Some(true), ..Plan::aligned(280, 160, 5) };
    let of = |method: Method| fused(&slices, &Plan { method, ..plan.clone() }).image.luma();
    let (halo_corrected, pyramid) = (of(Method::HaloCorrected), of(Method::Pyramid));
    let mean = |picture: &Plane<f32>, x: usize, y: usize| {
        (0..25).map(|at| picture.at(x + at % 5 - 2, y + at / 5 - 2)).sum::<f32>() / 25.0
    };
    let places = (10..150).flat_map(|y| (225..270).map(move |x| (x, y)));
    let off: Vec<f32> = places.map(|(x, y)| (mean(&halo_corrected, x, y) - mean(&pyramid, x, y)).abs()).collect();
    let share = off.iter().filter(|&&off| off > 6.0).count() as f64 / off.len() as f64;
    assert!(share < 0.05, "{share:.3} of the haze differs by more than 6 grey levels");
}

#[test]
fn a_stack_taken_from_far_to_near_gives_the_same_picture() {
    let case = Case::new(&Scene::plates(4), 4);
    let forward = fused(&case.slices, &halo_corrected(case.plan.clone()));
    let mut plan = halo_corrected(case.plan.clone());
    plan.slices.reverse();
    plan.reference = plan.slices.len() - 1 - plan.reference;
    plan.near_first = Some(false);
    let slices: Vec<Raster> = case.slices.iter().rev().cloned().collect();
    let backward = fused(&slices, &plan);
    let same = psnr(&backward.image.luma(), &forward.image.luma(), None).unwrap();
    assert!(same > 50.0, "they differ by {same:.1} dB");
}

fn without_a_depth_order(scenes: impl IntoIterator<Item = (Scene, u64)>) {
    for (scene, seed) in scenes {
        let rig = Rig { seed, ..Rig::sized(300, 200, 9) };
        let Rendered { slices, plan, .. } = rendered(&rig, &scene, Light::Front);
        let of = |near_first: Option<bool>| fused(&slices, &halo_corrected(Plan { near_first, ..plan.clone() }));
        let warned = |fused: &Fused| fused.warnings.iter().any(|warning| warning.code == "depth_order_disagrees");
        let (given, inferred, wrong) = (of(Some(true)), of(None), of(Some(false)));
        assert!(given.image != wrong.image && !warned(&given), "scene {seed}");
        assert!(inferred.image != wrong.image && !warned(&inferred), "scene {seed}");
        if seed == 2 {
            assert!(inferred.image == given.image && warned(&wrong), "the insect has clear outlines");
        }
    }
}

#[test]
fn without_a_depth_order_in_the_profile_the_stack_gives_it_or_nothing_is_corrected() {
    without_a_depth_order([(Scene::insect(5), 2), (Scene::wing(2), 5)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_stacks_give_the_depth_order_or_nothing_is_corrected() {
    without_a_depth_order([(Scene::plates(4), 1), (Scene::flower(2), 3), (Scene::weave(3), 4)]);
}

#[test]
fn the_decision_map_names_the_slice_that_shows_each_strip_sharp() {
    let slices = strips(160, 60, 4);
    let fused = fused(&slices, &halo_corrected(Plan::aligned(160, 60, 4)));
    for y in 8..52 {
        for x in (0..160).filter(|x| (8..32).contains(&(x % 40))) {
            assert_eq!(usize::from(fused.index.at(x, y)), x / 40, "at {x}, {y}");
        }
    }
}

#[test]
fn equal_slices_give_that_slice_bit_by_bit_in_every_sample_format() {
    let values = strip(90, 50, 3, 1);
    for slice in [eight(90, 50, &values), sixteen(90, 50, &values)] {
        for count in [1, 2, 70] {
            let slices = vec![slice.clone(); count];
            assert_eq!(fused(&slices, &halo_corrected(Plan::aligned(90, 50, count))).image, slice, "{count} slices");
        }
    }
    let grey = Raster::eight(90, 50, 1, values.chunks_exact(3).map(|p| (p[0] * 255.0) as u8).collect());
    assert_eq!(fused(&vec![grey.clone(); 3], &halo_corrected(Plan::aligned(90, 50, 3))).image, grey);
}

#[test]
fn the_number_of_threads_does_not_change_the_bytes_of_halo_corrected_fusion() {
    let case = Case::new(&Scene::insect(5), 5);
    let plan = halo_corrected(case.plan);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fused(&case.slices, &plan))
    };
    let one = run(1);
    assert_eq!(run(2), one);
    assert_eq!(run(3), one);
}

#[test]
fn uncovered_parts_of_a_slice_leave_no_trace() {
    let (slices, plan) = unaligned(120, 80, 5);
    let bright: Vec<Raster> = slices
        .iter()
        .map(|slice| eight(120, 80, &values(slice).iter().map(|v| 0.4 + 0.6 * v).collect::<Vec<_>>()))
        .collect();
    let fused = fused(&bright, &halo_corrected(plan));
    // nothing in the slices is darker than 0.4 of full scale, before gains
    for (pixel, &valid) in values(&fused.image).chunks_exact(3).zip(&fused.valid.data) {
        assert!(valid == 0 || pixel.iter().all(|&v| v > 0.2), "a black wedge: {pixel:?}");
        assert!(valid != 0 || pixel.iter().all(|&v| v == 0.0));
    }
}

fn beside_the_border(cases: impl IntoIterator<Item = (Scene, u64, usize)>) {
    for (scene, seed, border) in cases {
        let Case { slices, plan, truth, edges, .. } = Case::new(&scene, seed);
        // the same slices, without the columns of the canvas before `border`
        let (mut cut_slices, mut cut_plan) = (slices.clone(), plan.clone());
        for (slice, plan) in cut_slices.iter_mut().zip(&mut cut_plan.slices) {
            let Samples::Eight(samples) = &mut slice.samples else { panic!("8 bits") };
            let shift = border * slice.channels;
            samples.chunks_exact_mut(slice.width * slice.channels).for_each(|row| row.copy_within(shift.., 0));
            plan.homography = Homography::similarity(1.0, [border as f64, 0.0]).then(&plan.homography).unwrap();
        }
        // near the border, where all slices cover the canvas
        let columns = border + 12..border + 40;
        let beside = Plane::from_fn(480, 320, |x, y| if columns.contains(&x) { edges.at(x, y) } else { 0 });
        let score = |slices: &[Raster], plan: Plan| {
            psnr(&fused(slices, &halo_corrected(plan)).image.luma(), &truth, Some(&beside)).unwrap()
        };
        let (cut, whole) = (score(&cut_slices, cut_plan), score(&slices, plan));
        assert!(cut > whole - 0.6, "seed {seed}: {cut:.2} dB beside the border, {whole:.2} where the slices go on");
    }
}

#[test]
fn beside_the_border_of_the_slices_the_correction_works_as_elsewhere() {
    beside_the_border([(Scene::insect(2), 6, 140), (Scene::plates(3), 5, 220)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_borders_of_the_slices_leave_the_correction_as_elsewhere() {
    beside_the_border([(Scene::insect(1), 7, 140)]);
}

#[test]
fn a_hot_pixel_in_one_slice_spreads_by_at_most_two_pixels() {
    let mut slices = vec![eight(80, 60, &strip(80, 60, 1, 0)); 5];
    let clean = slices[0].clone();
    if let Samples::Eight(samples) = &mut slices[3].samples {
        samples[(30 * 80 + 40) * 3..][..3].fill(255);
    }
    let fused = fused(&slices, &halo_corrected(Plan::aligned(80, 60, 5)));
    let (got, expected) = (values(&fused.image), values(&clean));
    let off = |at: usize| got[at * 3..at * 3 + 3].iter().zip(&expected[at * 3..]).any(|(a, b)| (a - b).abs() > 0.02);
    let near = |at: usize| (at % 80).abs_diff(40) <= 2 && (at / 80).abs_diff(30) <= 2;
    assert!((0..80 * 60).all(|at| near(at) || !off(at)));
}

#[test]
fn extreme_pictures_stay_in_range() {
    for count in [2, 5] {
        let checks: Vec<Raster> = (0..count)
            .map(|slice| {
                let values: Vec<f64> = (0..64 * 48 * 3)
                    .map(|i| if (i / 3 % 64 / (slice + 1) + i / 192 / (slice + 1)) % 2 == 0 { 1.0 } else { 0.0 })
                    .collect();
                eight(64, 48, &values)
            })
            .collect();
        let plan = Plan { near_first: Some(true), ..halo_corrected(Plan::aligned(64, 48, count)) };
        let fused = fused(&checks, &plan);
        assert!(fused.valid.data.iter().all(|&v| v == 255));
        assert!(fused.index.data.iter().all(|&slice| usize::from(slice) < count));
    }
}

#[test]
fn a_given_decision_map_replaces_the_one_that_is_found() {
    let (slices, folder) = (strips(180, 90, 3), std::env::temp_dir());
    let plan = halo_corrected(Plan::aligned(180, 90, 3));
    let given = Plane::from_fn(180, 90, |x, _| if x < 90 { 2 } else { UNCOVERED });
    let found = fused(&slices, &plan).index;
    let of = |given: &Plane<u16>| fuse_by_decision_map(&&slices[..], &plan, given, &folder, &NoControl);
    let index = of(&given).unwrap().index;
    assert!((0..180 * 90).all(|at| index.data[at] == if at % 180 < 90 { 2 } else { found.data[at] }));
    assert!(of(&Plane::filled(60, 90, 0)).is_err());
}
