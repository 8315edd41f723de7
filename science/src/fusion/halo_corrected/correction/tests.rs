//! A tile is corrected like the whole canvas.

use super::{super::warped_slices::WarpedSlices, *};
use crate::{
    fusion::{
        FusionRequest, Plan,
        align::{self, coarse_focus::CELL, focus_measure::FocusMeasure},
        run::Run,
        sample_format::FormattedSlices,
    },
    imaging::{Plane, Raster},
    types::{NoControl, fusion_options::GuidedParams},
};

const WIDTH: usize = 420;
const HEIGHT: usize = 300;

/// A grey slice with a texture of its own.
fn slice(seed: usize) -> Raster {
    let value = |at: usize| {
        let (x, y) = (at % WIDTH, at / WIDTH);
        let hash = (x * 7919 + y * 104_729 + seed * 1_299_709 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (hash >> 40) as u8
    };
    Raster::eight(WIDTH, HEIGHT, 1, (0..WIDTH * HEIGHT).map(value).collect())
}

/// Stripes of the near slice 0, 50 px wide, before the far slice 1.
fn stripes() -> DecisionMap {
    let slice = Plane::from_fn(WIDTH, HEIGHT, |x, y| u16::from((x + y / 2) % 140 >= 50));
    DecisionMap { slice: slice.into(), textured: Plane::filled(WIDTH, HEIGHT, true) }
}

/// The mosaic of `rect`, and what becomes of it by a blur of `radius` px between the slices.
fn corrected(slices: &WarpedSlices<'_, u8, 1>, radius: f32, rect: Rect) -> [Vec<f32>; 2] {
    let (map, model) = (stripes(), DefocusModel::near_first(2, radius));
    let of_slices = [0, 1].map(|slice| slices.samples(slice, rect).expect("samples"));
    let own = map.slice.crop(rect).data;
    let mosaic: Vec<f32> = (0..own.len()).map(|at| f32::from(of_slices[usize::from(own[at])][at])).collect();
    let mut out = mosaic.clone();
    correct(slices, &map, &model, rect, &mut out).expect("nothing stops it");
    [mosaic, out]
}

#[test]
fn a_tile_is_corrected_like_the_whole_canvas() {
    let rasters = [slice(1), slice(2)];
    let (slices, plan, folder) = (&&rasters[..], Plan::aligned(WIDTH, HEIGHT, 2), std::env::temp_dir());
    let request = FusionRequest::default();
    let run = Run {
        slices: FormattedSlices::open(slices, &plan).expect("slices"),
        plan: &plan,
        request: &request,
        scratch_dir: &folder,
        control: &NoControl,
        decision_map: None,
        tile: 512,
    };
    let measure = FocusMeasure::saliency(&GuidedParams::default());
    let aligned = align::align::<u8, 1>(&run, measure, None).expect("the first pass");
    let slices = WarpedSlices::<u8, 1>::new(&aligned, &NoControl);
    // above 8 px, slices are blurred in squares; above 32 px, the cover is too
    for radius in [5.0, 13.0, 27.0, 52.0] {
        let [mosaic, whole] = corrected(&slices, radius, Rect::whole(WIDTH, HEIGHT));
        let changed = mosaic.iter().zip(&whole).filter(|(before, after)| (*before - *after).abs() > 1.0).count();
        assert!(changed > 2000, "radius {radius}: {changed} px are corrected");
        let whole = Plane { width: WIDTH, height: HEIGHT, data: whole };
        for (x, y, width, height) in [(101, 67, 150, 121), (7, 151, 93, 149), (233, 30, 61, 75)] {
            let rect = Rect { x, y, width, height };
            let [_, part] = corrected(&slices, radius, rect);
            let expected = whole.crop(rect).data;
            let most = part.iter().zip(&expected).map(|(part, whole)| (part - whole).abs()).fold(0.0, f32::max);
            assert!(most < 0.05, "radius {radius}, {rect:?}: {most} grey levels from the whole canvas");
        }
    }
}

#[test]
fn the_decision_map_matters_as_far_as_the_cover_by_the_largest_disc_reaches() {
    assert_eq!(Disc::new(MAX_RADIUS / CELL as f32).reach() * CELL, REACH);
}
