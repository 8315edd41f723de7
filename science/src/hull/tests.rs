//! Hulls of bodies with known surfaces, from exact and from wrong masks.

mod files;
mod shapes;

use std::f64::consts::PI;

use super::*;
use crate::types::{Cancelled, NoControl};
use shapes::{PIXEL, SIDE, Shape, Views, distances, mask, open_edges, turntable};

const BALL: Shape = Shape::Ellipsoid([1.0, -0.5, 0.3], [7.0; 3]);
const LEG: Shape = Shape::Leg([-8.0, 1.0, -6.0], [7.0, -2.0, 7.0], 1.5 * PIXEL);

fn views(body: &[Shape], cameras: &[PinholeCamera]) -> Views {
    Views { masks: cameras.par_iter().map(|camera| mask(body, camera)).collect(), ..Views::default() }
}

fn hull(cameras: &[PinholeCamera], views: &Views, options: &HullOptions) -> Hull {
    from_views(cameras, views, options, &NoControl).expect("a hull")
}

/// The hull of a body from exact masks.
fn exact(body: &[Shape]) -> Hull {
    let cameras = turntable(12, &[0.0, 30.0]);
    let found = hull(&cameras, &views(body, &cameras), &HullOptions::default());
    assert_eq!(open_edges(&found.mesh), 0);
    found
}

fn refused(cameras: &[PinholeCamera], views: &Views, options: &HullOptions) -> (ErrorKind, String) {
    match from_views(cameras, views, options, &NoControl) {
        Err(Interrupted::Failed(error)) => (error.kind, error.detail),
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_hull_of_round_bodies_is_the_body() {
    let ellipsoid = Shape::Ellipsoid([0.5, 0.0, -1.0], [4.0, 6.0, 8.0]);
    for (shape, volume) in [(BALL, 4.0 / 3.0 * PI * 343.0), (ellipsoid, 4.0 / 3.0 * PI * 192.0)] {
        let Hull { mesh, summary } = exact(&[shape]);
        let [median, most] = distances(&mesh, &[shape]);
        assert!(median < 0.1 && most < 0.6, "{median} px, {most} px");
        assert!((summary.volume / volume - 1.0).abs() < 0.01, "{}", summary.volume / volume);
    }
}

#[test]
fn the_hull_of_a_box_contains_it_and_little_more() {
    let shape = Shape::Box([6.0, 4.0, 7.0]);
    let Hull { mesh, summary } = exact(&[shape]);
    // a camera at the height of the middle sees above the upper face, so the hull has a flat pyramid there
    let level = |point: &&[f32; 3]| f64::from(point[2].abs()) < 7.0 - PIXEL;
    let sides = Mesh { positions: mesh.positions.iter().filter(level).copied().collect(), ..Mesh::default() };
    let [median, most] = distances(&sides, &[shape]);
    assert!(median < 2.0 && most < 4.0, "{median} px, {most} px");
    let deepest = mesh.positions.iter().map(|p| shape.distance(p.map(f64::from)) / PIXEL).fold(0.0, f64::min);
    assert!(deepest > -0.5, "{deepest} px inside");
    assert!((1.0..1.1).contains(&(summary.volume / (8.0 * 168.0))), "{}", summary.volume);
}

#[test]
fn a_leg_of_three_pixels_is_whole() {
    let Hull { mesh, summary } = exact(&[LEG]);
    let [median, most] = distances(&mesh, &[LEG]);
    assert!(median < 0.1 && most < 0.8, "{median} px, {most} px");
    assert!((summary.size[0] - 15.0).abs() < 6.0 * PIXEL && summary.removed_parts == 0, "{summary:?}");
}

#[test]
fn the_surface_has_its_colour_and_an_outward_normal_everywhere() {
    let cameras = turntable(12, &[0.0, 30.0]);
    let mut views = views(&[BALL], &cameras);
    let middle = [1.0, -0.5, 0.3];
    let painted = |normal: [f64; 3]| normal.map(|value| (127.5 + 100.0 * value).round() as u8);
    // one view has a highlight
    let picture = |(view, camera): (usize, &PinholeCamera)| {
        let colour = |at: usize| {
            let towards = camera.direction([(at % SIDE) as f64, (at / SIDE) as f64]);
            let normal = ball_normal(camera.centre, towards, middle, 7.0);
            if view == 3 { [255; 3] } else { normal.map_or([0; 3], painted) }
        };
        Raster::eight(camera.size[0], camera.size[1], 3, (0..SIDE * SIDE).flat_map(colour).collect())
    };
    views.pictures = cameras.iter().enumerate().map(picture).collect();
    let Hull { mesh, .. } = hull(&cameras, &views, &HullOptions { resolution: Some(64), ..HullOptions::default() });
    assert_eq!((mesh.colours.len(), mesh.normals.len()), (mesh.positions.len(), mesh.positions.len()));
    let mut wrong = 0;
    for ((position, normal), colour) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.colours) {
        let outward = mesh::minus(position.map(f64::from), middle).map(|value| value / 7.0);
        assert!(mesh::dot(outward, normal.map(f64::from)) > 0.9, "{position:?} {normal:?}");
        // no camera looks at the lowest part
        let is_near = |channel: usize| colour[channel].abs_diff(painted(outward)[channel]) < 16;
        wrong += usize::from(outward[2] > -0.9 && !(0..3).all(is_near));
    }
    assert!(wrong * 100 < mesh.positions.len(), "{wrong} of {} colours", mesh.positions.len());
}

/// The outward unit normal where a ray first meets a ball.
fn ball_normal(from: [f64; 3], towards: [f64; 3], middle: [f64; 3], radius: f64) -> Option<[f64; 3]> {
    let start = mesh::minus(from, middle);
    let (a, b) = (mesh::dot(towards, towards), mesh::dot(start, towards));
    let square = b * b - a * (mesh::dot(start, start) - radius * radius);
    let distance = (-b - square.max(0.0).sqrt()) / a;
    (square >= 0.0).then(|| [0, 1, 2].map(|axis| (start[axis] + distance * towards[axis]) / radius))
}

#[test]
fn a_bad_view_is_left_out_or_tolerated() {
    let cameras = turntable(12, &[0.0, 30.0]);
    let mut views = views(&[BALL], &cameras);
    // the lower half is missing
    let half = views.masks[5].data.len() / 2;
    views.masks[5].data[half..].fill(0);
    let volume = 4.0 / 3.0 * PI * 343.0;
    let options = HullOptions { resolution: Some(64), ..HullOptions::default() };
    for (leave_out, tolerated, low, high) in [(true, 0, 0.99, 1.02), (false, 0, 0.3, 0.7), (false, 1, 0.99, 1.02)] {
        let found = hull(&cameras, &views, &HullOptions { leave_out, tolerated, ..options.clone() });
        let ratio = found.summary.volume / volume;
        assert!((low..high).contains(&ratio), "{leave_out}, {tolerated} tolerated: {ratio}");
        assert_eq!(found.summary.contradicting_views, if leave_out { vec![5] } else { vec![] });
        assert_eq!(open_edges(&found.mesh), 0);
    }
}

#[test]
fn noisy_masks_give_a_closed_surface_near_the_body() {
    let cameras = turntable(12, &[0.0, 30.0]);
    let body = [BALL, LEG];
    let mut views = views(&body, &cameras);
    for (view, mask) in views.masks.iter_mut().enumerate() {
        for (at, alpha) in mask.data.iter_mut().enumerate() {
            // multiplicative hashing
            let random = ((view * SIDE * SIDE + at) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
            let noise = 120.0 * (random as f64 / f64::from(1 << 24) - 0.5);
            *alpha = if f64::from(*alpha) + noise > 127.5 { 255 } else { 0 };
        }
    }
    for (tolerated, limit) in [(0, 0.6), (1, 0.6)] {
        let found = hull(&cameras, &views, &HullOptions { tolerated, ..HullOptions::default() });
        assert_eq!(open_edges(&found.mesh), 0);
        let [median, most] = distances(&found.mesh, &body);
        assert!(median < limit, "{tolerated} tolerated: {median} px, {most} px");
    }
}

#[test]
fn a_body_beyond_the_picture_is_kept_where_others_see_it() {
    let cameras = turntable(12, &[0.0, 30.0]);
    let whole = views(&[BALL], &cameras);
    // the first camera sees the left half of the ball alone
    let mut cut = cameras;
    cut[0].size[0] = SIDE / 2;
    let mut masks = whole.masks;
    masks[0] = masks[0].crop(crate::imaging::Rect { x: 0, y: 0, width: SIDE / 2, height: SIDE });
    let found = hull(&cut, &Views { masks, ..Views::default() }, &HullOptions::default());
    assert!(distances(&found.mesh, &[BALL])[1] < 1.0);
}

#[test]
fn lengths_are_in_mm_if_the_scale_is_known() {
    let cameras = turntable(8, &[0.0, 30.0]);
    let views = views(&[BALL], &cameras);
    let plain = hull(&cameras, &views, &HullOptions { resolution: Some(48), ..HullOptions::default() }).summary;
    let options = HullOptions { resolution: Some(48), mm_per_unit: Some(2.0), ..HullOptions::default() };
    let scaled = hull(&cameras, &views, &options).summary;
    assert!(scaled.is_mm && !plain.is_mm);
    assert!((scaled.volume / plain.volume - 8.0).abs() < 1e-4 && (scaled.area / plain.area - 4.0).abs() < 1e-4);
    assert!((scaled.cell / plain.cell - 2.0).abs() < 1e-9);
}

#[test]
fn impossible_input_is_refused_with_what_is_wrong() {
    let cameras = turntable(6, &[0.0]);
    let good = views(&[BALL], &cameras);
    let options = HullOptions { resolution: Some(32), ..HullOptions::default() };
    let empty = |count: usize| {
        let masks =
            good.masks.iter().enumerate().map(|(at, mask)| if at < count { mask.map(|_| 0) } else { mask.clone() });
        Views { masks: masks.collect(), ..Views::default() }
    };
    let (kind, detail) = refused(&cameras, &empty(4), &options);
    assert!(kind == ErrorKind::InvalidPoses && detail.starts_with("2 of 6 views have a mask"), "{detail}");
    assert_eq!(hull(&cameras, &empty(2), &options).summary.empty_views, [0, 1]);
    let same = vec![cameras[0].clone(); 6];
    let first = Views { masks: vec![good.masks[0].clone(); 6], ..Views::default() };
    assert!(refused(&same, &first, &options).1.starts_with("all views look the same way"));
    // each mask somewhere else
    let shifted = |(at, mask): (usize, &Plane<u8>)| {
        Plane::from_fn(SIDE, SIDE, |x, y| if at % 2 == 0 { 255 * u8::from(y < 20) } else { mask.at(x, y) })
    };
    let apart = Views { masks: good.masks.iter().enumerate().map(shifted).collect(), ..Views::default() };
    let (kind, detail) = refused(&cameras, &apart, &options);
    assert!(kind == ErrorKind::InvalidPoses && detail.starts_with("no part of space"), "{detail}");
    let small = Views { masks: vec![Plane::filled(10, 10, 255); 6], ..Views::default() };
    assert_eq!(refused(&cameras, &small, &options).0, ErrorKind::SizeMismatch);
    for options in [
        HullOptions { resolution: Some(4), ..HullOptions::default() },
        HullOptions { tolerated: 9, ..HullOptions::default() },
        HullOptions { mm_per_unit: Some(0.0), ..HullOptions::default() },
    ] {
        assert_eq!(refused(&cameras, &good, &options).0, ErrorKind::InvalidParameter);
    }
    struct Stop;
    impl Control for Stop {
        fn progress(&self, _: &'static str, _: usize, _: usize) {}
        fn check(&self) -> Result<(), Cancelled> {
            Err(Cancelled)
        }
    }
    assert_eq!(from_views(&cameras, &good, &options, &Stop), Err(Interrupted::Cancelled(Cancelled)));
}
