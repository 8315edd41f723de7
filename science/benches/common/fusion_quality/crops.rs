//! The square with the largest error of one image, cut out of several images and placed side by side.

use pinstack_science::imaging::{Raster, Rect};

use super::case::samples;

/// Side of a crop, px; magnification; gap between crops, px.
const SIDE: usize = 110;
const ZOOM: usize = 2;
const GAP: usize = 6;

/// The square with the largest squared error of `picture` against `truth`.
pub fn worst(picture: &Raster, truth: &Raster) -> Rect {
    let (width, height) = (truth.width, truth.height);
    let square = |x: usize, y: usize| -> f64 {
        (0..3)
            .map(|c| {
                (f64::from(samples(picture)[(y * width + x) * 3 + c])
                    - f64::from(samples(truth)[(y * width + x) * 3 + c]))
                .powi(2)
            })
            .sum()
    };
    let error = |rect: &Rect| -> f64 {
        (rect.y..rect.y + SIDE)
            .flat_map(|y| (rect.x..rect.x + SIDE).map(move |x| (x, y)))
            .map(|(x, y)| square(x, y))
            .sum()
    };
    let along = |length: usize| (0..=length.saturating_sub(SIDE)).step_by(SIDE / 3);
    let places = along(height).flat_map(|y| along(width).map(move |x| Rect { x, y, width: SIDE, height: SIDE }));
    places.max_by(|a, b| error(a).total_cmp(&error(b))).unwrap_or_default()
}

/// The same square of several images, side by side.
pub struct Crop {
    picture: Raster,
}

impl Crop {
    pub fn of(pictures: &[&Raster], rect: Rect) -> Self {
        let (side, gap) = (SIDE * ZOOM, GAP);
        let width = pictures.len() * (side + gap) - gap;
        let mut out = vec![255; width * side * 3];
        for (number, picture) in pictures.iter().enumerate() {
            for y in 0..side {
                for x in 0..side {
                    let from = ((rect.y + y / ZOOM) * picture.width + rect.x + x / ZOOM) * 3;
                    let to = (y * width + number * (side + gap) + x) * 3;
                    out[to..to + 3].copy_from_slice(&samples(picture)[from..from + 3]);
                }
            }
        }
        Self { picture: Raster::eight(width, side, 3, out) }
    }

    pub fn jpeg(&self) -> Vec<u8> {
        pinstack_science::imaging::codec::encode_jpeg(&self.picture, 90)
    }
}
