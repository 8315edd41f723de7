//! The kernels against the definition, against each other, and tile against whole.

use std::ops::Range;

use super::{
    window::{SCALE, clip},
    *,
};

fn speckle(x: usize, y: usize) -> u16 {
    ((x * x * 37 + y * 8123 + x * y * 977) % 65_536) as u16
}

struct Case {
    grey: Plane<u16>,
    map: Plane<bool>,
    valid: Vec<Range<usize>>,
}

impl Case {
    fn new(width: usize, height: usize, valid: impl Fn(usize) -> Range<usize>) -> Self {
        Self {
            grey: Plane::from_fn(width, height, speckle),
            map: Plane::from_fn(width, height, |x, y| (x / 5 + y / 7) % 3 == 0),
            valid: (0..height).map(valid).collect(),
        }
    }

    fn filter(&self, radius: usize, eps: f64, inner: Rect) -> Vec<f32> {
        let mut out = vec![f32::NAN; inner.width * inner.height];
        let guide = Guide { grey: &self.grey, valid: &self.valid };
        GuidedFilter::new(radius, eps).apply(guide, &self.map, inner, &mut out);
        out
    }

    /// The definition, window by window, in f64.
    fn definition(&self, radius: usize, eps: f64) -> Plane<f64> {
        let (width, height) = (self.grey.width, self.grey.height);
        let around = |x: usize, y: usize| {
            let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
            rows.flat_map(move |v| (x.saturating_sub(radius)..(x + radius + 1).min(width)).map(move |u| (u, v)))
                .filter(|&(u, v)| self.valid[v].contains(&u))
                .collect::<Vec<_>>()
        };
        let intensity = |(x, y): (usize, usize)| f64::from(self.grey.at(x, y)) / SCALE;
        let p = |(x, y): (usize, usize)| f64::from(u8::from(self.map.at(x, y)));
        let lines = Plane::from_fn(width, height, |x, y| {
            let window = around(x, y);
            let n = window.len() as f64;
            let mean_i = window.iter().map(|&at| intensity(at)).sum::<f64>() / n;
            let mean_p = window.iter().map(|&at| p(at)).sum::<f64>() / n;
            let cov = window.iter().map(|&at| (intensity(at) - mean_i) * (p(at) - mean_p)).sum::<f64>() / n;
            let var = window.iter().map(|&at| (intensity(at) - mean_i).powi(2)).sum::<f64>() / n;
            let a = cov / (var + eps);
            (a, mean_p - a * mean_i)
        });
        Plane::from_fn(width, height, |x, y| {
            if !self.valid[y].contains(&x) {
                return 0.0;
            }
            let window = around(x, y);
            let sum =
                window.iter().fold((0.0, 0.0), |sum, &(u, v)| (sum.0 + lines.at(u, v).0, sum.1 + lines.at(u, v).1));
            (sum.0 * intensity((x, y)) + sum.1) / window.len() as f64
        })
    }
}

#[test]
fn results_match_the_definition_on_the_valid_pixels() {
    for (radius, eps) in [(3, 1e-6), (6, 0.3), (23, 0.3)] {
        for case in [Case::new(31, 26, |_| 0..31), Case::new(31, 26, |y| (y / 3)..(31 - y / 5))] {
            let expected = case.definition(radius, eps);
            let got = case.filter(radius, eps, Rect::whole(31, 26));
            for (got, expected) in got.iter().zip(&expected.data) {
                assert!((f64::from(*got) - expected).abs() < 1e-5, "{got} instead of {expected}");
            }
        }
    }
}

#[test]
fn a_tile_gets_the_same_bits_as_the_whole_image() {
    let case = Case::new(90, 70, |y| if y < 9 { 0..0 } else { y / 4..90 });
    for (radius, eps) in [(4, 1e-6), (9, 0.3)] {
        let whole = case.filter(radius, eps, Rect::whole(90, 70));
        let part = Rect { x: 37, y: 22, width: 20, height: 13 };
        let cut = part.grown(2 * radius, 90, 70);
        let small = Case {
            grey: Plane::from_fn(cut.width, cut.height, |x, y| case.grey.at(x + cut.x, y + cut.y)),
            map: Plane::from_fn(cut.width, cut.height, |x, y| case.map.at(x + cut.x, y + cut.y)),
            valid: case.valid[cut.y..cut.y + cut.height].iter().map(|span| clip(span, cut.x, cut.width)).collect(),
        };
        let inner = Rect { x: part.x - cut.x, y: part.y - cut.y, ..part };
        let got = small.filter(radius, eps, inner);
        for y in 0..part.height {
            let start = (part.y + y) * 90 + part.x;
            assert_eq!(got[y * 20..(y + 1) * 20], whole[start..start + 20]);
        }
    }
}

#[test]
fn vector_instructions_give_the_same_bits() {
    for width in [1, 7, 64, 83] {
        let whole = Case::new(width, 50, |_| 0..width);
        let cut = Case::new(width, 50, |y| (y / 3).min(width / 2)..width - (y / 7).min(width / 3));
        for (case, inner) in [whole, cut].iter().flat_map(|case| {
            let part = Rect { x: width / 3, y: 11, width: width - width / 2, height: 17 };
            [Rect::whole(width, 50), part].map(|inner| (case, inner))
        }) {
            for (radius, eps) in [(7, 1e-6), (12, 0.3), (45, 0.3)] {
                let both = [None, Avx2::detect()].map(|simd| {
                    let mut out = vec![f32::NAN; inner.width * inner.height];
                    let guide = Guide { grey: &case.grey, valid: &case.valid };
                    GuidedFilter::with(simd, radius, eps).apply(guide, &case.map, inner, &mut out);
                    out
                });
                assert_eq!(both[0], both[1]);
            }
        }
    }
}

#[test]
fn skipping_regions_of_a_constant_map_changes_nothing() {
    // large regions where the map is 0, and large regions where it is 1
    let mut case = Case::new(420, 60, |_| 0..420);
    case.map = Plane::from_fn(420, 60, |x, y| (190..410).contains(&x) && (y > 20 || x % 40 < 3));
    for radius in [3, 7] {
        let guide = Guide { grey: &case.grey, valid: &case.valid };
        let narrow = case.filter(radius, 1e-6, Rect::whole(420, 60));
        let mut wide = GuidedFilter { radius, kernel: Kernel::Reference(Reference::new(radius, 1e-6)) };
        let mut out = vec![f32::NAN; 420 * 60];
        wide.apply(guide, &case.map, Rect::whole(420, 60), &mut out);
        let furthest = out.iter().zip(&narrow).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(furthest < 1e-5, "{furthest}");
        assert!(out.iter().zip(&narrow).all(|(a, b)| a == b || (*a != 0.0 && *a != 1.0)));
    }
}

#[test]
fn the_integer_and_the_reference_kernel_agree() {
    let case = Case::new(70, 60, |y| if y == 20 { 5..66 } else { 0..70 });
    let guide = Guide { grey: &case.grey, valid: &case.valid };
    for (radius, eps) in [(7, 1e-6), (30, 0.3)] {
        let mut filter = GuidedFilter { radius, kernel: GuidedFilter::per_pixel(Avx2::detect(), radius, eps) };
        assert!(matches!(filter.kernel, Kernel::Integer(_)));
        let mut narrow = vec![f32::NAN; 70 * 60];
        filter.apply(guide, &case.map, Rect::whole(70, 60), &mut narrow);
        let mut wide = GuidedFilter { radius, kernel: Kernel::Reference(Reference::new(radius, eps)) };
        let mut out = vec![f32::NAN; 70 * 60];
        wide.apply(guide, &case.map, Rect::whole(70, 60), &mut out);
        let furthest = out.iter().zip(&narrow).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(furthest < 1e-5, "{furthest}");
    }
    // sums that exceed 32 bits, and coefficients that are too large for them
    assert!(matches!(GuidedFilter::new(200, 0.3).kernel, Kernel::Reference(_)));
    assert!(matches!(GuidedFilter::new(40, 1e-9).kernel, Kernel::Reference(_)));
}

#[test]
fn the_subsampled_kernel_approximates_the_reference() {
    let valid = |y: usize| if y < 3 { 9..201 } else { (y / 9)..(230 - y / 5) };
    let mut case = Case::new(230, 190, valid);
    // a ramp with a step and grain, and a map that follows the step except for some holes
    case.grey = Plane::from_fn(230, 190, |x, y| {
        (x * 90 + y * 40 + if x + y / 2 > 120 { 22_000 } else { 0 }) as u16 + speckle(x, y) / 9
    });
    case.map = Plane::from_fn(230, 190, |x, y| x + y / 2 > 117 && (x / 11 + y / 13) % 5 > 0);
    let guide = Guide { grey: &case.grey, valid: &case.valid };
    for (radius, most, mean) in [(24, 0.012, 0.0015), (45, 0.006, 0.001), (60, 0.005, 0.001)] {
        let cells = case.filter(radius, 0.3, Rect::whole(230, 190));
        let mut exact = GuidedFilter { radius, kernel: GuidedFilter::per_pixel(None, radius, 0.3) };
        let mut out = vec![f32::NAN; 230 * 190];
        exact.apply(guide, &case.map, Rect::whole(230, 190), &mut out);
        let errors: Vec<f32> = out.iter().zip(&cells).map(|(a, b)| (a - b).abs()).collect();
        let furthest = errors.iter().fold(0.0f32, |a, b| a.max(*b));
        let average = errors.iter().sum::<f32>() / errors.len() as f32;
        assert!(furthest < most && average < mean, "radius {radius}: {furthest}, {average} on average");
    }
}

#[test]
fn a_tile_on_the_grid_gets_the_subsampled_results_of_the_whole_image() {
    let case = Case::new(400, 330, |y| y / 4..400 - y / 9);
    let whole = case.filter(45, 0.3, Rect::whole(400, 330));
    let reach = GuidedFilter::new(45, 0.3).reach();
    let part = Rect { x: 131, y: 122, width: 90, height: 73 };
    let cut = part.grown(reach, 400, 330);
    let (x, y) = (cut.x / GRID * GRID, cut.y / GRID * GRID);
    let cut = Rect { x, y, width: cut.x + cut.width - x, height: cut.y + cut.height - y };
    let small = Case {
        grey: Plane::from_fn(cut.width, cut.height, |x, y| case.grey.at(x + cut.x, y + cut.y)),
        map: Plane::from_fn(cut.width, cut.height, |x, y| case.map.at(x + cut.x, y + cut.y)),
        valid: case.valid[cut.y..cut.y + cut.height].iter().map(|span| clip(span, cut.x, cut.width)).collect(),
    };
    let got = small.filter(45, 0.3, Rect { x: part.x - cut.x, y: part.y - cut.y, ..part });
    for y in 0..part.height {
        let start = (part.y + y) * 400 + part.x;
        assert_eq!(got[y * part.width..(y + 1) * part.width], whole[start..start + part.width]);
    }
}

#[test]
fn a_map_that_is_constant_within_reach_is_returned_exactly() {
    let mut case = Case::new(64, 64, |y| if y == 50 { 0..40 } else { 0..64 });
    for value in [false, true] {
        case.map.data.fill(value);
        for (radius, eps) in [(7, 1e-6), (45, 0.3)] {
            let out = case.filter(radius, eps, Rect { x: 0, y: 0, width: 64, height: 50 });
            assert!(out.iter().all(|&v| v == f32::from(u8::from(value))));
        }
    }
}

#[test]
fn windows_without_any_valid_pixel_give_zero_and_never_nan() {
    let case = Case::new(20, 20, |_| 0..0);
    assert!(case.filter(7, 1e-6, Rect::whole(20, 20)).iter().all(|&v| v == 0.0));
}
