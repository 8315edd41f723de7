//! The contact sheet: all results of the demo on one picture.

use font8x8::UnicodeFonts;

use pinstack_science::{
    fusion::height::relief::relief,
    imaging::{Plane, Raster, Samples},
};

/// Size of one cell's picture, px.
const CELL: (usize, usize) = (480, 320);
/// Height of the line of text under a picture, px.
const CAPTION: usize = 28;
const GAP: usize = 10;
const PAPER: [u8; 3] = [246, 246, 244];
const INK: [u8; 3] = [40, 40, 44];

/// A captioned picture.
pub(super) struct Cell<'a> {
    /// Text below the picture.
    pub caption: String,
    /// 8 or 16 bits; alpha is shown over a checkerboard.
    pub picture: &'a Raster,
}

/// Lays the cells out in rows of `columns`. RGB, 8 bits.
pub(super) fn contact_sheet(cells: &[Cell<'_>], columns: usize) -> Raster {
    let rows = cells.len().div_ceil(columns);
    let (width, height) = (GAP + columns * (CELL.0 + GAP), GAP + rows * (CELL.1 + CAPTION + GAP));
    let mut sheet = Sheet { width, pixels: PAPER.repeat(width * height) };
    for (i, cell) in cells.iter().enumerate() {
        let (x, y) = (GAP + (i % columns) * (CELL.0 + GAP), GAP + (i / columns) * (CELL.1 + CAPTION + GAP));
        sheet.picture(x, y, cell.picture);
        sheet.text(x, y + CELL.1 + 8, &cell.caption);
    }
    Raster::eight(width, height, 3, sheet.pixels)
}

struct Sheet {
    width: usize,
    pixels: Vec<u8>,
}

impl Sheet {
    fn set(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        let at = (y * self.width + x) * 3;
        if let Some(pixel) = self.pixels.get_mut(at..at + 3) {
            pixel.copy_from_slice(&colour);
        }
    }

    /// Scales the picture into the cell at (x, y) by area averaging.
    fn picture(&mut self, x: usize, y: usize, picture: &Raster) {
        let scale = (picture.width as f64 / CELL.0 as f64).max(picture.height as f64 / CELL.1 as f64);
        let (wide, high) = ((picture.width as f64 / scale) as usize, (picture.height as f64 / scale) as usize);
        let (left, top) = (x + (CELL.0 - wide) / 2, y + (CELL.1 - high) / 2);
        for row in 0..high {
            for column in 0..wide {
                let colour = mean(picture, column, row, scale);
                self.set(left + column, top + row, colour);
            }
        }
    }

    fn text(&mut self, x: usize, y: usize, text: &str) {
        for (i, letter) in text.chars().take(CELL.0 / 9).enumerate() {
            let Some(glyph) = font8x8::BASIC_FONTS.get(letter) else { continue };
            for (row, bits) in glyph.into_iter().enumerate() {
                // each row twice: 8 x 16 px, readable at 1:1
                for (column, line) in (0..8).flat_map(|column| [(column, 0), (column, 1)]) {
                    if bits >> column & 1 == 1 {
                        self.set(x + i * 9 + column, y + row * 2 + line, INK);
                    }
                }
            }
        }
    }
}

/// The mean colour of the `scale` x `scale` pixels that belong to (column, row) of the scaled picture.
fn mean(picture: &Raster, column: usize, row: usize, scale: f64) -> [u8; 3] {
    let span = |at: usize, end: usize| {
        let first = ((at as f64 * scale) as usize).min(end - 1);
        first..(((at + 1) as f64 * scale) as usize).clamp(first + 1, end)
    };
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for y in span(row, picture.height) {
        for x in span(column, picture.width) {
            let light = (x / 16 + y / 16) % 2 == 0;
            let colour = over_checks(picture, x, y, if light { 236.0 } else { 212.0 });
            for c in 0..3 {
                sum[c] += colour[c];
            }
            count += 1.0;
        }
    }
    sum.map(|s| (s / count).round() as u8)
}

/// The colour of one pixel, 0..255, composited over a grey.
fn over_checks(picture: &Raster, x: usize, y: usize, grey: f32) -> [f32; 3] {
    let n = picture.channels;
    let at = (y * picture.width + x) * n;
    let sample = |c: usize| match &picture.samples {
        Samples::Eight(s) => f32::from(s[at + c]),
        Samples::Sixteen(s) => f32::from(s[at + c]) / 257.0,
    };
    match n {
        1 => [sample(0); 3],
        3 => [sample(0), sample(1), sample(2)],
        _ => {
            let alpha = sample(3) / 255.0;
            [0, 1, 2].map(|c| sample(c) * alpha + grey * (1.0 - alpha))
        }
    }
}

/// Slice indices as colours, from violet (first slice) over green to yellow (last); black where no slice covers the
/// pixel.
pub(super) fn depth_colours(index: &Raster, slices: usize) -> Raster {
    let value = |i: usize| match &index.samples {
        Samples::Eight(s) => usize::from(s[i]),
        Samples::Sixteen(s) => usize::from(s[i]),
    };
    let last = (slices.max(2) - 1) as f32;
    let pixels = (0..index.width * index.height).flat_map(|i| match value(i) {
        n if n >= slices => [0; 3],
        n => ramp(n as f32 / last),
    });
    Raster::eight(index.width, index.height, 3, pixels.collect())
}

/// A height map as a shaded relief; a checkerboard where the height is unknown.
pub(super) fn shaded(heights: &Raster) -> Raster {
    let (width, height, channels) = (heights.width, heights.height, heights.channels);
    let data = match &heights.samples {
        Samples::Eight(samples) => samples.iter().step_by(channels).copied().map(u16::from).collect(),
        Samples::Sixteen(samples) => samples.iter().step_by(channels).copied().collect(),
    };
    relief(&Plane { width, height, data })
}

/// A perceptually uniform colour ramp: viridis at five points, interpolated.
fn ramp(t: f32) -> [u8; 3] {
    const SUPPORTS: [[f32; 3]; 5] =
        [[68., 1., 84.], [59., 82., 139.], [33., 145., 140.], [94., 201., 98.], [253., 231., 37.]];
    let at = t.clamp(0.0, 1.0) * 4.0;
    let low = (at as usize).min(3);
    let part = at - low as f32;
    [0, 1, 2].map(|c| (SUPPORTS[low][c] + part * (SUPPORTS[low + 1][c] - SUPPORTS[low][c])) as u8)
}
