//! The printed page, read back, and photographed.

use super::*;
use crate::{
    calibration::calibrate,
    imaging::Raster,
    synth::{DotTarget, Rig, target_stack},
    types::{NoControl, calibration_options::CalibrationOptions},
};

fn input() -> TargetInput {
    TargetInput {
        pitch_mm: 2.0,
        columns: 14,
        rows: 10,
        coded: true,
        dot_ratio: 0.5,
        inverted: false,
        paper: Paper::A4,
        format: PageFormat::Svg,
    }
}

/// The circles of an SVG: centre and radius.
fn circles(svg: &str) -> Vec<[f64; 3]> {
    let value = |line: &str, name: &str| {
        let from = line.find(&format!("{name}=\"")).expect(name) + name.len() + 2;
        line[from..].split('"').next().and_then(|text| text.parse::<f64>().ok()).expect("a number")
    };
    svg.lines()
        .filter(|line| line.starts_with("<circle"))
        .map(|line| [value(line, "cx"), value(line, "cy"), value(line, "r")])
        .collect()
}

#[test]
fn the_svg_has_the_dots_at_true_scale() {
    let page = TargetPage::new(&input()).expect("it fits");
    let svg = page.svg();
    assert!(svg.contains("width=\"210mm\" height=\"297mm\" viewBox=\"0 0 210 297\""), "{svg}");
    let circles = circles(&svg);
    assert_eq!(circles.len(), 140);
    assert!((circles[1][0] - circles[0][0] - 2.0).abs() < 1e-9 && circles[1][1] == circles[0][1]);
    assert!((circles[14][1] - circles[0][1] - 2.0).abs() < 1e-9);
    for (at, circle) in circles.iter().enumerate() {
        let factor = dot_size(at as i64 % 14, at as i64 / 14).factor();
        assert!((circle[2] - 0.5 * factor).abs() < 1e-6, "{at}");
    }
    assert!(svg.contains("The line below is 100 mm long") && svg.contains("H110"), "{svg}");
}

/// The operands before each operator of a kind in a content stream, points.
fn operands(content: &str, operator: &str) -> Vec<Vec<f64>> {
    content
        .lines()
        .filter_map(|line| line.strip_suffix(operator)?.strip_suffix(' '))
        .map(|line| line.split(' ').filter_map(|number| number.parse().ok()).collect())
        .collect()
}

#[test]
fn the_pdf_has_the_same_circles_in_points() {
    let page = TargetPage::new(&input()).expect("it fits");
    let pdf = page.pdf();
    assert!(pdf.starts_with(b"%PDF-1.7"));
    let text = String::from_utf8_lossy(&pdf);
    let content = text.split("stream\n").nth(1).and_then(|rest| rest.split("\nendstream").next()).expect("a stream");
    let starts = operands(content, "m");
    let curves = operands(content, "c");
    // the check line starts with a move, too
    assert_eq!((starts.len(), curves.len()), (141, 4 * 140));
    let mm = |points: f64| points * 25.4 / 72.0;
    for (at, dot) in page.dots.iter().enumerate() {
        let start = &starts[at];
        assert!((mm(start[0]) - dot.x - dot.diameter / 2.0).abs() < 1e-4, "{at}");
        assert!((page.height - mm(start[1]) - dot.y).abs() < 1e-4, "{at}");
        for (quarter, curve) in curves[4 * at..4 * at + 4].iter().enumerate() {
            // the middle of a Bezier curve: (p0 + 3 p1 + 3 p2 + p3) / 8
            let from = if quarter == 0 { start.as_slice() } else { &curves[4 * at + quarter - 1][4..] };
            let middle = [0, 1].map(|k| mm((from[k] + 3.0 * curve[k] + 3.0 * curve[2 + k] + curve[4 + k]) / 8.0));
            let radius = (middle[0] - dot.x).hypot(page.height - middle[1] - dot.y);
            assert!((radius / (dot.diameter / 2.0) - 1.0).abs() < 1e-3, "{at} {radius}");
        }
    }
}

/// Photographs of the circles of a page: `px_per_mm` about the middle of the page, with a blur of `blur` px radius (a
/// box in both directions, twice).
fn photograph(page: &TargetPage, px_per_mm: f64, blur: usize, width: usize, height: usize) -> Raster {
    const FINE: usize = 4;
    let mut light = vec![1.0f32; width * height];
    let middle = [page.width / 2.0, page.height / 2.0 - CAPTION_MM / 2.0];
    for [x, y, radius] in circles(&page.svg()) {
        let place = [
            (x - middle[0]) * px_per_mm + (width as f64 - 1.0) / 2.0,
            (y - middle[1]) * px_per_mm + (height as f64 - 1.0) / 2.0,
        ];
        let radius = radius * px_per_mm;
        let span = |centre: f64, size: usize| {
            let from = (centre - radius - 1.0).floor().clamp(0.0, size as f64) as usize;
            from..((centre + radius + 2.0).ceil().clamp(0.0, size as f64) as usize)
        };
        for row in span(place[1], height) {
            for column in span(place[0], width) {
                let offset = |k: usize| (k as f64 + 0.5) / FINE as f64 - 0.5;
                let inside = (0..FINE * FINE).filter(|k| {
                    let dx = column as f64 + offset(k % FINE) - place[0];
                    let dy = row as f64 + offset(k / FINE) - place[1];
                    dx * dx + dy * dy < radius * radius
                });
                light[row * width + column] -= 0.9 * inside.count() as f32 / (FINE * FINE) as f32;
            }
        }
    }
    for _ in 0..2 {
        light = boxed(&light, width, height, blur, 1, width);
        light = boxed(&light, width, height, blur, width, height);
    }
    Raster::eight(width, height, 1, light.iter().map(|value| (20.0 + 200.0 * value).round() as u8).collect())
}

/// The mean over `2 blur + 1` samples along one direction: `stride` between samples, `length` of them.
fn boxed(light: &[f32], width: usize, height: usize, blur: usize, stride: usize, length: usize) -> Vec<f32> {
    let mut out = vec![0.0; light.len()];
    for (at, value) in out.iter_mut().enumerate() {
        let own = if stride == 1 { at % width } else { at / width };
        debug_assert!(at / width < height);
        let (from, to) = (own.saturating_sub(blur), (own + blur).min(length - 1));
        let sum: f32 = (from..=to).map(|k| light[at + k * stride - own * stride]).sum();
        *value = sum / (to - from + 1) as f32;
    }
    out
}

#[test]
fn what_is_printed_is_what_the_calibration_reads() {
    let page = TargetPage::new(&TargetInput { columns: 24, rows: 16, ..input() }).expect("it fits");
    let (width, height) = (480, 320);
    let scales = [11.88, 12.0, 12.12];
    let slices: Vec<Raster> =
        scales.iter().zip([2, 1, 2]).map(|(scale, blur)| photograph(&page, *scale, blur, width, height)).collect();
    let found = calibrate(&slices.as_slice(), &CalibrationOptions::default(), &NoControl).expect("a grid");
    let code = found.report.target.as_ref().and_then(|target| target.code.as_ref()).expect("the code is recognised");
    assert!(!code.mirrored, "{code:?}");
    let reference = scales[found.reference_index];
    let pitch = found.dot_pitch_px;
    assert!((pitch / (2.0 * reference) - 1.0).abs() < 1e-4, "{pitch}");
    let (right, bottom) = (width as f64 - 1.0, height as f64 - 1.0);
    for (slice, scale) in found.slices.iter().zip(scales) {
        for corner in [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]] {
            let mapped = slice.homography.apply(corner);
            let expected = [right, bottom].map(|size| size / 2.0);
            for axis in 0..2 {
                let truth = expected[axis] + (corner[axis] - expected[axis]) * reference / scale;
                assert!((mapped[axis] - truth).abs() < 0.1, "{scale} {corner:?} {mapped:?}");
            }
        }
    }
}

/// The renderer has a target of its own.
#[test]
fn the_printed_target_goes_through_the_renderer_and_back_through_calibration() {
    let rig = Rig::sized(480, 320, 7);
    let page = TargetInput { pitch_mm: 1.2, columns: 24, rows: 16, paper: Paper::Fit, ..input() };
    let printed = TargetPage::new(&page).expect("any size");
    let target = DotTarget {
        columns: 24,
        rows: 16,
        pitch_mm: page.pitch_mm,
        dot_diameter_mm: page.dot_ratio * page.pitch_mm,
        rotation_deg: 0.0,
        offset_mm: [0.0; 2],
        code: Some([0, 0]),
        ..DotTarget::for_rig(&rig, 24)
    };
    let px_per_mm = rig.magnification / rig.pixel_pitch_mm;
    let [cx, cy] = rig.centre();
    let rendered = target.dots(&rig, rig.reference);
    let circles = circles(&printed.svg());
    assert_eq!(circles.len(), rendered.len());
    for ([x, y, _], dot) in circles.into_iter().zip(rendered) {
        let expected = [cx + (x - printed.width / 2.0) * px_per_mm, cy + (y - printed.height / 2.0) * px_per_mm];
        let apart = (expected[0] - dot[0]).hypot(expected[1] - dot[1]);
        assert!(apart < 1e-4, "{expected:?} on the page, {dot:?} rendered");
    }
    let options = CalibrationOptions {
        target_pitch_mm: Some(page.pitch_mm),
        pixel_pitch_mm: Some(rig.pixel_pitch_mm),
        ..CalibrationOptions::default()
    };
    let found = calibrate(&target_stack(&rig, &target).as_slice(), &options, &NoControl).expect("a grid");
    assert!(
        found.report.target.as_ref().and_then(|target| target.code.as_ref()).is_some_and(|code| !code.mirrored),
        "{:?}",
        found.report.target
    );
    let magnification = found.magnification.expect("pitch and pixels are known");
    assert!((magnification / rig.magnification - 1.0).abs() < 1e-3, "{magnification}");
    for (i, slice) in found.slices.iter().enumerate() {
        let apart = slice.homography.corner_distance(&rig.homography(i), rig.width as u32, rig.height as u32);
        assert!(apart < 0.2, "slice {i}: {apart} px at a corner");
    }
}

#[test]
fn a_page_that_fits_the_target_has_no_caption() {
    let tiny = TargetInput { pitch_mm: 0.05, columns: 100, rows: 60, paper: Paper::Fit, ..input() };
    let page = TargetPage::new(&tiny).expect("any size");
    assert!((page.width - 5.15).abs() < 1e-9 && (page.height - 3.15).abs() < 1e-9);
    assert!(page.caption.is_empty() && page.check_line.is_none());
    assert!((page.dots[0].x - 0.1).abs() < 1e-9 && (page.dots[0].y - 0.1).abs() < 1e-9);
}

#[test]
fn a_target_that_does_not_fit_is_refused_with_what_does() {
    let wide = TargetInput { pitch_mm: 10.0, columns: 40, rows: 10, ..input() };
    let refused = TargetPage::new(&wide).expect_err("too wide");
    assert!(refused.detail.contains("27 x 10 do"), "{}", refused.detail);
    let on_its_side = TargetInput { pitch_mm: 10.0, columns: 26, rows: 10, ..input() };
    assert_eq!(TargetPage::new(&on_its_side).expect("it fits").width, 297.0);
    for wrong in [
        TargetInput { pitch_mm: f64::NAN, ..input() },
        TargetInput { columns: 1, ..input() },
        TargetInput { columns: 1000, rows: 1000, ..input() },
        TargetInput { dot_ratio: 0.75, ..input() },
    ] {
        assert!(TargetPage::new(&wrong).is_err(), "{wrong:?}");
    }
}

/// The numbers of the `N x M do` of a refusal.
fn suggested(detail: &str) -> Option<[u32; 2]> {
    let (columns, rest) = detail.split("; ").nth(1)?.split_once(" x ")?;
    let (rows, _) = rest.split_once(" do")?;
    Some([columns.parse().ok()?, rows.parse().ok()?])
}

#[test]
fn the_suggested_number_of_dots_fits() {
    for paper in [Paper::A4, Paper::Letter] {
        for pitch_mm in [0.1, 0.3, 1.9, 7.0, 10.0, 19.0, 47.5, 88.0, 95.0] {
            for [columns, rows] in [[1000, 65], [65, 1000], [1000, 2], [30, 30], [40, 10]] {
                let wanted = TargetInput { pitch_mm, columns, rows, paper, ..input() };
                let Err(refused) = TargetPage::new(&wanted) else { continue };
                let dots = suggested(&refused.detail).unwrap_or_else(|| panic!("{}", refused.detail));
                assert!(dots[0] <= columns && dots[1] <= rows, "{}", refused.detail);
                let fewer = TargetInput { columns: dots[0], rows: dots[1], ..wanted };
                assert!(TargetPage::new(&fewer).is_ok(), "{}", refused.detail);
            }
        }
    }
    let coarse = TargetInput { pitch_mm: 100.0, columns: 4, rows: 2, ..input() };
    let refused = TargetPage::new(&coarse).expect_err("one row fits");
    let wanted = "no grid of this pitch fits on the page; choose a smaller pitch or paper=fit";
    assert!(refused.detail.ends_with(wanted), "{}", refused.detail);
}

#[test]
fn a_pdf_that_readers_do_not_show_is_refused() {
    let fit = |pitch_mm, columns, rows| TargetInput { pitch_mm, columns, rows, paper: Paper::Fit, ..input() };
    for (wrong, size) in [(fit(0.01, 200, 20), "2.03 x 0.23 mm"), (fit(100.0, 60, 10), "6300.00 x 1300.00 mm")] {
        assert!(TargetPage::new(&wrong).is_ok(), "as SVG");
        let refused = TargetPage::new(&TargetInput { format: PageFormat::Pdf, ..wrong }).expect_err("as PDF");
        assert!(refused.detail.contains(size) && refused.detail.contains("1.06 to 5080 mm"), "{}", refused.detail);
        assert!(refused.detail.contains("choose format=svg"), "{}", refused.detail);
    }
    let pdf = TargetInput { format: PageFormat::Pdf, ..fit(50.0, 97, 10) };
    assert_eq!(TargetPage::new(&pdf).expect("a large page").width, 5000.0);
}
