//! The stages of a job, each measured by itself.

use std::{
    fs::File,
    io::BufWriter,
    path::Path,
    sync::Mutex,
    time::{Duration, Instant},
};

use pinstack_science::{
    fusion::{Fused, FusionRequest, Plan, SlicePlan, fuse},
    imaging::{
        Sample, Samples, Slices,
        codec::{self, Metadata},
        filter::saliency::{Rows, Saliency},
        grey,
        grey_slices::{GreySlices, GreyValue},
        warp::Warp,
    },
    segmentation::{MaskParams, segment},
    types::Control,
};
use rayon::prelude::*;

use super::{
    case::Case,
    clock::{Cost, Passes, Watchmaker, cpu, peak_mb},
};

/// The stages that are measured, each in a process of its own.
pub const STAGES: [&str; 11] = [
    "decode only",
    "warp",
    "saliency",
    "first pass",
    "second pass",
    "whole",
    "with metrics",
    "back light",
    "its mask",
    "within the mask",
    "PNG of the result",
];

/// Those of them that need a back light.
pub const OF_BACK: [&str; 3] = ["back light", "its mask", "within the mask"];

/// What the child does: one stage.
pub fn stage(name: &str, case: Case, folder: &Path) -> Cost {
    let archive = case.archive(folder);
    let plan = case.plan();
    let watch = Watchmaker::default();
    let fused = |control: &dyn Control| {
        fuse(archive.front(), &plan, &FusionRequest::default(), folder, control).expect("it can be fused")
    };
    let fused_back = |control: &dyn Control| {
        let back = case.back(folder);
        let grey = GreySlices::of(back.front(), GreyValue::Luma);
        fuse(&grey, &case.plan_of_back(), &FusionRequest::default(), folder, control).expect("it can be fused")
    };
    let silhouette =
        |back: &Fused| segment(&back.image, &back.valid, &MaskParams::default_for(case.width, case.height));
    let started = (cpu(), Instant::now());
    let passes = Passes(Mutex::new(None));
    let since = |(cpu_then, wall_then): (Duration, Instant)| Cost {
        cpu: (cpu() - cpu_then).as_secs_f64(),
        wall: wall_then.elapsed().as_secs_f64(),
        peak_mb: peak_mb("self"),
    };
    match name {
        "decode only" => {
            let load = |i: usize| archive.front().load(i).expect("a slice").width;
            (0..case.slices).into_par_iter().with_max_len(1).map(load).sum::<usize>();
            since(started)
        }
        "warp" => {
            measure_warp(archive.front(), case, &plan, &watch);
            watch.cost()
        }
        "saliency" => {
            measure_saliency(archive.front(), case, &plan, &watch);
            watch.cost()
        }
        "with metrics" => {
            let request = FusionRequest { metrics: true, object: None, shown: None, decision: false };
            fuse(archive.front(), &plan, &request, folder, &passes).expect("it can be fused");
            since(started)
        }
        "back light" => {
            fused_back(&passes);
            since(started)
        }
        "its mask" => {
            let back = fused_back(&passes);
            watch.time(|| std::hint::black_box(silhouette(&back)));
            watch.cost()
        }
        // what a job does with the front light of a stack that has a back light
        "within the mask" => {
            let silhouette = silhouette(&fused_back(&passes));
            let inside = silhouette.mask.data.iter().filter(|v| **v != 0).count() as f64;
            eprintln!("the object covers {:.0} % of the canvas", 100.0 * inside / (case.width * case.height) as f64);
            let request = FusionRequest {
                metrics: true,
                object: Some(&silhouette.mask),
                shown: Some(silhouette.image_alpha()),
                decision: false,
            };
            watch.time(|| fuse(archive.front(), &plan, &request, folder, &passes)).expect("it can be fused");
            watch.cost()
        }
        "PNG of the result" => {
            let image = fused(&passes).image;
            let file = || BufWriter::new(File::create(folder.join("fused.png")).expect("a file"));
            watch.time(|| codec::encode_png(file(), &image, &Metadata::default())).expect("a PNG");
            watch.cost()
        }
        _ => {
            fused(&passes);
            let second = passes.0.lock().expect("no thread panicked").expect("there is a second pass");
            let (whole, second) = (since(started), since(second));
            match name {
                "first pass" => Cost { cpu: whole.cpu - second.cpu, wall: whole.wall - second.wall, ..whole },
                "second pass" => second,
                _ => whole,
            }
        }
    }
}

/// Warps each slice.
fn measure_warp(slices: &dyn Slices, case: Case, plan: &Plan, watch: &Watchmaker) {
    let size = (case.width, case.height);
    for i in 0..case.slices {
        let SlicePlan { homography, gain, .. } = &plan.slices[i];
        let warp = Warp::new(homography, *gain, size, size).expect("a regular homography");
        match slices.load(i).expect("a slice").samples {
            Samples::Eight(samples) => watch.time(|| warp_rows(&warp, &samples)),
            Samples::Sixteen(samples) => watch.time(|| warp_rows(&warp, &samples)),
        }
    }
}

/// Measures the saliency of each slice, and forgets it row by row.
fn measure_saliency(slices: &dyn Slices, case: Case, plan: &Plan, watch: &Watchmaker) {
    let size = (case.width, case.height);
    let saliency = Saliency::new(plan.params.r_g as usize, plan.params.sigma_g);
    for i in 0..case.slices {
        let raster = slices.load(i).expect("a slice");
        let row = |y: usize, out: &mut [f32]| {
            let samples = y * case.width * 3..(y + 1) * case.width * 3;
            match &raster.samples {
                Samples::Eight(all) => grey::luma_row(&all[samples], 3, out),
                Samples::Sixteen(all) => grey::luma_row(&all[samples], 3, out),
            }
        };
        let bands = (0..case.height).into_par_iter().step_by(128);
        watch.time(|| {
            bands.for_each_init(Rows::default, |buffers, y| {
                saliency.rows(size, y..(y + 128).min(case.height), buffers, row, |_, _, values| {
                    std::hint::black_box(values);
                });
            });
        });
    }
}

/// Warps a slice, and forgets it row by row.
fn warp_rows<S: Sample>(warp: &Warp, samples: &[S]) {
    let (rows, width) = (warp.rows::<S, 3>(samples), warp.coverage().width());
    (0..warp.coverage().height()).into_par_iter().with_min_len(64).for_each_init(
        || vec![S::default(); width * 3],
        |out, y| {
            rows.row(y, out);
            std::hint::black_box(out);
        },
    );
}
