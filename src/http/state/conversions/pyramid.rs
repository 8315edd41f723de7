//! A picture at full and at reduced resolutions, in one file, for viewers that show parts of it.
//!
//! The file has width and height (two little-endian `u32`), then the rows of every level as RGBA of 8 bits. Level 0 has
//! full resolution; each further level has half the width and height of the one before, until one tile holds all of it.
//! Colours are averaged with their alpha as weight, so that what is hidden does not colour the rim of the object.
//!
//! The file is made once and read tile by tile, so a tile costs the same whatever the size of the picture.

use std::{
    fs::File,
    io::{self, BufWriter, Read, Seek, SeekFrom, Write},
    path::Path,
};

use anyhow::Context;

use crate::contract::artifact::Colours;
use pinstack_science::imaging::{Raster, Samples, codec};

/// Side of a tile, px.
pub const TILE: u32 = 512;
/// Bytes before the rows.
const HEAD: u64 = 8;

/// Stops of the colour map, from low to high (viridis): equal steps look equal, also in grey and to the colour-blind.
const MAP: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// Width and height of each level.
pub fn levels(width: u32, height: u32) -> Vec<(u32, u32)> {
    let mut levels = vec![(width.max(1), height.max(1))];
    while let Some(&(width, height)) = levels.last()
        && width.max(height) > TILE
    {
        levels.push((width.div_ceil(2), height.div_ceil(2)));
    }
    levels
}

/// Size of the file for a picture of this size.
pub fn most_bytes(width: u32, height: u32) -> u64 {
    HEAD + levels(width, height).iter().map(|&(w, h)| 4 * u64::from(w) * u64::from(h)).sum::<u64>()
}

/// Writes the pyramid of the picture at `path` into `file`. Returns the size in bytes.
///
/// # Errors
/// When the picture cannot be read or the file cannot be written.
pub fn write(path: &Path, file: &File, colours: Colours) -> anyhow::Result<u64> {
    let bytes = std::fs::read(path).context("cannot read the picture")?;
    let raster = codec::decode_rgba(&bytes, &codec::Limits::default()).context("cannot decode the picture")?;
    drop(bytes);
    write_raster(raster, file, colours)
}

/// Writes the pyramid of a picture of 1, 3 or 4 channels into `file`. Returns the size in bytes.
///
/// # Errors
/// When the file cannot be written.
pub fn write_raster(raster: Raster, file: &File, colours: Colours) -> anyhow::Result<u64> {
    let (width, height) = (u32::try_from(raster.width)?, u32::try_from(raster.height)?);
    let mut out = BufWriter::with_capacity(1 << 20, file);
    out.write_all(&width.to_le_bytes())?;
    out.write_all(&height.to_le_bytes())?;
    let paint = Paint::new(&raster, colours);
    let mut half = Half::new(raster.width, raster.height);
    let mut row = vec![0; 4 * raster.width];
    for y in 0..raster.height {
        paint.row(y, &mut row);
        out.write_all(&row)?;
        half.add(y, &row);
    }
    drop(raster);
    for &(width, height) in &levels(width, height)[1..] {
        let level = half.finish();
        out.write_all(&level)?;
        half = Half::new(width as usize, height as usize);
        for (y, row) in level.chunks_exact(4 * width as usize).enumerate() {
            half.add(y, row);
        }
    }
    out.flush()?;
    drop(out);
    Ok(most_bytes(width, height))
}

/// Turns rows of samples into RGBA.
struct Paint<'a> {
    raster: &'a Raster,
    colours: Colours,
    low: u32,
    high: u32,
}

impl<'a> Paint<'a> {
    fn new(raster: &'a Raster, colours: Colours) -> Self {
        let mut paint = Self { raster, colours, low: 0, high: 1 };
        if colours == Colours::Plain {
            return paint;
        }
        let (mut low, mut high) = (u32::MAX, 0);
        let mut see = |value: u32| {
            if !paint.is_none(value) {
                (low, high) = (low.min(value), high.max(value));
            }
        };
        match &raster.samples {
            Samples::Eight(samples) => samples.iter().for_each(|&v| see(u32::from(v))),
            Samples::Sixteen(samples) => samples.iter().for_each(|&v| see(u32::from(v))),
        }
        (paint.low, paint.high) = (low.min(high), high.max(low.min(high) + 1));
        paint
    }

    fn is_none(&self, value: u32) -> bool {
        match (self.colours, &self.raster.samples) {
            (Colours::Plain, _) => false,
            (Colours::Heights, _) => value == 0,
            (Colours::Indices, Samples::Eight(_)) => value == 255,
            (Colours::Indices, Samples::Sixteen(_)) => value == 65_535,
        }
    }

    fn row(&self, y: usize, out: &mut [u8]) {
        let channels = self.raster.channels;
        let start = y * self.raster.width * channels;
        let end = start + self.raster.width * channels;
        match &self.raster.samples {
            Samples::Eight(samples) => self.pixels(&samples[start..end], out, u32::from, |v| v),
            Samples::Sixteen(samples) => self.pixels(&samples[start..end], out, u32::from, |v| (v >> 8) as u8),
        }
    }

    fn pixels<S: Copy>(&self, row: &[S], out: &mut [u8], wide: impl Fn(S) -> u32, byte: impl Fn(S) -> u8) {
        for (pixel, out) in row.chunks_exact(self.raster.channels).zip(out.chunks_exact_mut(4)) {
            let rgba = match (self.colours, pixel) {
                (Colours::Plain, [r, g, b, a]) => [byte(*r), byte(*g), byte(*b), byte(*a)],
                (Colours::Plain, [r, g, b]) => [byte(*r), byte(*g), byte(*b), 255],
                (Colours::Plain, _) => [byte(pixel[0]), byte(pixel[0]), byte(pixel[0]), 255],
                _ => self.mapped(wide(pixel[0])),
            };
            out.copy_from_slice(&rgba);
        }
    }

    fn mapped(&self, value: u32) -> [u8; 4] {
        if self.is_none(value) {
            return [0; 4];
        }
        let steps = (MAP.len() - 1) as f32;
        let at = (value.saturating_sub(self.low)) as f32 / (self.high - self.low) as f32 * steps;
        let stop = (at as usize).min(MAP.len() - 2);
        let part = at - stop as f32;
        let mix = |c: usize| {
            let (from, to) = (f32::from(MAP[stop][c]), f32::from(MAP[stop + 1][c]));
            (from + (to - from) * part).round() as u8
        };
        [mix(0), mix(1), mix(2), 255]
    }
}

/// The next level, half as wide and high, made row by row.
struct Half {
    width: usize,
    height: usize,
    /// The first row of the present pair.
    first: Vec<u8>,
    pixels: Vec<u8>,
}

impl Half {
    fn new(width: usize, height: usize) -> Self {
        let pixels = Vec::with_capacity(4 * width.div_ceil(2) * height.div_ceil(2));
        Self { width, height, first: Vec::new(), pixels }
    }

    fn add(&mut self, y: usize, row: &[u8]) {
        if y.is_multiple_of(2) && y + 1 < self.height {
            self.first.clear();
            self.first.extend_from_slice(row);
            return;
        }
        // the last row of an odd number counts twice
        let upper: &[u8] = if !y.is_multiple_of(2) { &self.first } else { row };
        for x in (0..self.width).step_by(2) {
            let right = (x + 1).min(self.width - 1);
            let four = [
                &upper[4 * x..4 * x + 4],
                &upper[4 * right..4 * right + 4],
                &row[4 * x..4 * x + 4],
                &row[4 * right..4 * right + 4],
            ];
            let alpha: u32 = four.iter().map(|pixel| u32::from(pixel[3])).sum();
            let mean = |c: usize| {
                let sum: u32 = four.iter().map(|pixel| u32::from(pixel[c]) * u32::from(pixel[3])).sum();
                (sum + alpha / 2).checked_div(alpha).unwrap_or(0) as u8
            };
            self.pixels.extend([mean(0), mean(1), mean(2), ((alpha + 2) / 4) as u8]);
        }
    }

    fn finish(self) -> Vec<u8> {
        self.pixels
    }
}

/// One tile as a PNG; `None` when the pyramid has no such tile.
///
/// # Errors
/// When the file cannot be read.
pub fn tile(path: &Path, level: u32, x: u32, y: u32) -> io::Result<Option<Vec<u8>>> {
    let mut file = File::open(path)?;
    let mut head = [0; HEAD as usize];
    file.read_exact(&mut head)?;
    let [width, height] = [0, 4].map(|at| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]));
    let levels = levels(width, height);
    let Some(&(width, height)) = levels.get(level as usize) else { return Ok(None) };
    let inside = |at: u32, side: u32| at.checked_mul(TILE).filter(|start| *start < side);
    let (Some(left), Some(top)) = (inside(x, width), inside(y, height)) else { return Ok(None) };
    let before: u64 = levels[..level as usize].iter().map(|&(w, h)| 4 * u64::from(w) * u64::from(h)).sum();
    let (columns, rows) = (TILE.min(width - left) as usize, TILE.min(height - top));
    let mut pixels = vec![0; 4 * columns * rows as usize];
    for (row, out) in (top..top + rows).zip(pixels.chunks_exact_mut(4 * columns)) {
        let at = HEAD + before + 4 * (u64::from(row) * u64::from(width) + u64::from(left));
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(out)?;
    }
    let mut png = Vec::new();
    let raster = Raster::eight(columns, rows as usize, 4, pixels);
    codec::encode_png(&mut png, &raster, &codec::Metadata::default())?;
    Ok(Some(png))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pyramid(raster: &Raster, colours: Colours) -> tempfile::NamedTempFile {
        let picture = tempfile::NamedTempFile::new().expect("a file");
        codec::encode_png(picture.as_file(), raster, &codec::Metadata::default()).expect("a PNG");
        let file = tempfile::NamedTempFile::new().expect("a file");
        let bytes = write(picture.path(), file.as_file(), colours).expect("a pyramid");
        assert_eq!(file.as_file().metadata().expect("a size").len(), bytes);
        file
    }

    fn decoded(file: &tempfile::NamedTempFile, level: u32, x: u32, y: u32) -> Option<Raster> {
        let png = tile(file.path(), level, x, y).expect("read")?;
        Some(codec::decode_rgba(&png, &codec::Limits::default()).expect("a PNG"))
    }

    #[test]
    fn the_tiles_of_level_0_are_the_pixels_of_the_picture() {
        let (width, height) = (1100, 530);
        let samples: Vec<u8> = (0..width * height).flat_map(|i| [(i % 251) as u8, (i / width) as u8, 7, 255]).collect();
        let picture = Raster::eight(width, height, 4, samples);
        let file = pyramid(&picture, Colours::Plain);
        assert_eq!(levels(1100, 530), [(1100, 530), (550, 265), (275, 133)]);
        let corner = decoded(&file, 0, 2, 1).expect("a tile");
        assert_eq!((corner.width, corner.height), (1100 - 1024, 530 - 512));
        let rect = pinstack_science::imaging::Rect { x: 1024, y: 512, width: 76, height: 18 };
        assert_eq!(corner, picture.crop(rect));
        let all = decoded(&file, 2, 0, 0).expect("a tile");
        assert_eq!((all.width, all.height), (275, 133));
        for (level, x, y) in [(0, 3, 0), (0, 0, 2), (3, 0, 0), (u32::MAX, 0, 0), (0, u32::MAX, u32::MAX), (2, 1, 0)] {
            assert_eq!(decoded(&file, level, x, y), None, "{level} {x} {y}");
        }
    }

    #[test]
    fn what_is_transparent_does_not_colour_the_levels_below() {
        let samples: Vec<u8> =
            (0..600 * 2).flat_map(|i| if i % 2 == 0 { [200, 100, 50, 255] } else { [0, 0, 0, 0] }).collect();
        let file = pyramid(&Raster::eight(600, 2, 4, samples), Colours::Plain);
        let half = decoded(&file, 1, 0, 0).expect("a tile");
        let Samples::Eight(samples) = &half.samples else { panic!("8 bits") };
        assert_eq!(samples[..4], [200, 100, 50, 128]);
    }

    #[test]
    fn indices_and_heights_get_colours_and_gaps_are_transparent() {
        let file = pyramid(&Raster::sixteen(4, 1, 1, vec![0, 8, 65_535, 4]), Colours::Indices);
        let Some(Raster { samples: Samples::Eight(seen), .. }) = decoded(&file, 0, 0, 0) else { panic!("8 bits") };
        assert_eq!(seen[..3], MAP[0]);
        assert_eq!(seen[4..7], MAP[8]);
        assert_eq!((seen[3], seen[7], seen[11]), (255, 255, 0));
        assert_eq!(seen[12..15], MAP[4]);
        let file = pyramid(&Raster::sixteen(3, 1, 1, vec![0, 500, 900]), Colours::Heights);
        let Some(Raster { samples: Samples::Eight(seen), .. }) = decoded(&file, 0, 0, 0) else { panic!("8 bits") };
        assert_eq!((seen[3], &seen[4..7], &seen[8..11]), (0, &MAP[0][..], &MAP[8][..]));
    }
}
