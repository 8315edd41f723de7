//! A part of two images, enlarged and side by side.

use pinstack_science::imaging::{Raster, Rect, Samples};

/// Size of each half of a picture, px.
const HALF: [usize; 2] = [320, 240];
/// White between the halves, px.
const GAP: usize = 8;

/// What a half shows of the fused image.
#[derive(Clone, Copy)]
pub enum Part {
    /// All of it.
    Whole,
    /// The part in which the images differ most, so many times enlarged.
    Enlarged(usize),
}

/// A half of the picture. Where to look follows from the two images, so that both halves show the same part.
pub fn shown(image: &Raster, part: Part, right: &Raster, wrong: &Raster) -> Raster {
    let rect = match part {
        Part::Whole => Rect::whole(image.width, image.height),
        Part::Enlarged(times) => most_different(right, wrong, [HALF[0] / times, HALF[1] / times]),
    };
    resized(&image.crop(rect))
}

/// The place, on a grid, of the given size where the images differ most.
fn most_different(one: &Raster, other: &Raster, [width, height]: [usize; 2]) -> Rect {
    const STEP: usize = 20;
    // nothing of the rim, where fewer slices are
    const RIM: usize = 20;
    let (a, b) = (one.luma(), other.luma());
    let difference = |&[x, y]: &[usize; 2]| -> f64 {
        let rows = (y..y + height).flat_map(|y| (x..x + width).map(move |x| (x, y)));
        rows.map(|(x, y)| f64::from((a.at(x, y) - b.at(x, y)).abs())).sum()
    };
    let places = (RIM..=one.height - height - RIM).step_by(STEP);
    let places = places.flat_map(|y| (RIM..=one.width - width - RIM).step_by(STEP).map(move |x| [x, y]));
    let [x, y] = places.max_by(|a, b| difference(a).total_cmp(&difference(b))).expect("a place");
    Rect { x, y, width, height }
}

/// The picture in the size of a half, by linear interpolation.
fn resized(picture: &Raster) -> Raster {
    let Samples::Eight(samples) = &picture.samples else { panic!("8 bits expected") };
    let scale = [picture.width as f32 / HALF[0] as f32, picture.height as f32 / HALF[1] as f32];
    let mut out = Vec::with_capacity(HALF[0] * HALF[1] * 3);
    for y in 0..HALF[1] {
        for x in 0..HALF[0] {
            let at = |to: usize, scale: f32, end: usize| {
                let at = ((to as f32 + 0.5) * scale - 0.5).clamp(0.0, end as f32 - 1.0);
                (at as usize, (at as usize + 1).min(end - 1), at.fract())
            };
            let ((x0, x1, u), (y0, y1, v)) = (at(x, scale[0], picture.width), at(y, scale[1], picture.height));
            for channel in 0..3 {
                let sample = |x: usize, y: usize| {
                    f32::from(samples[(y * picture.width + x) * picture.channels + channel % picture.channels])
                };
                let upper = sample(x0, y0) * (1.0 - u) + sample(x1, y0) * u;
                let lower = sample(x0, y1) * (1.0 - u) + sample(x1, y1) * u;
                out.push((upper * (1.0 - v) + lower * v).round() as u8);
            }
        }
    }
    Raster::eight(HALF[0], HALF[1], 3, out)
}

/// Two halves side by side.
pub fn beside(left: &Raster, right: &Raster) -> Raster {
    let (Samples::Eight(a), Samples::Eight(b)) = (&left.samples, &right.samples) else { panic!("8 bits expected") };
    let row = 3 * HALF[0];
    let rows = (0..HALF[1]).flat_map(|y| {
        let part = |of: &[u8]| of[y * row..(y + 1) * row].to_vec();
        [part(a), vec![255; 3 * GAP], part(b)].concat()
    });
    Raster::eight(2 * HALF[0] + GAP, HALF[1], 3, rows.collect())
}
