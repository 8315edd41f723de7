//! The eight EXIF orientations.

use crate::imaging::{Raster, Samples};

/// True when the orientation exchanges width and height.
pub(super) fn swaps(orientation: u8) -> bool {
    (5..=8).contains(&orientation)
}

/// The orientation of a tag: values other than 1 to 8 mean upright.
pub(super) fn sane(value: u32) -> u8 {
    if (1..=8).contains(&value) { value as u8 } else { 1 }
}

/// Rotates and mirrors `raster` from the stored orientation (EXIF tag 274) to upright.
pub(super) fn apply(raster: Raster, orientation: u8) -> Raster {
    if orientation <= 1 || orientation > 8 {
        return raster;
    }
    let Raster { width, height, channels, samples } = raster;
    let (out_width, out_height) = if swaps(orientation) { (height, width) } else { (width, height) };
    let samples = match samples {
        Samples::Eight(s) => Samples::Eight(turned(&s, width, height, channels, orientation)),
        Samples::Sixteen(s) => Samples::Sixteen(turned(&s, width, height, channels, orientation)),
    };
    Raster { width: out_width, height: out_height, channels, samples }
}

fn turned<T: Copy>(stored: &[T], width: usize, height: usize, channels: usize, orientation: u8) -> Vec<T> {
    let (right, bottom) = (width - 1, height - 1);
    let (out_width, out_height) = if swaps(orientation) { (height, width) } else { (width, height) };
    let mut out = Vec::with_capacity(stored.len());
    for y in 0..out_height {
        for x in 0..out_width {
            // where the upright pixel (x, y) is stored
            let (sx, sy) = match orientation {
                2 => (right - x, y),
                3 => (right - x, bottom - y),
                4 => (x, bottom - y),
                5 => (y, x),
                6 => (y, bottom - x),
                7 => (right - y, bottom - x),
                8 => (right - y, x),
                _ => (x, y),
            };
            let at = (sy * width + sx) * channels;
            out.extend_from_slice(&stored[at..at + channels]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture `1 2 3 / 4 5 6` as a camera stores it under each orientation (EXIF 2.3, figure 4).
    #[test]
    fn every_orientation_gives_the_same_upright_picture() {
        let stored: [(u8, usize, [u8; 6]); 8] = [
            (1, 3, [1, 2, 3, 4, 5, 6]),
            (2, 3, [3, 2, 1, 6, 5, 4]),
            (3, 3, [6, 5, 4, 3, 2, 1]),
            (4, 3, [4, 5, 6, 1, 2, 3]),
            (5, 2, [1, 4, 2, 5, 3, 6]),
            (6, 2, [3, 6, 2, 5, 1, 4]),
            (7, 2, [6, 3, 5, 2, 4, 1]),
            (8, 2, [4, 1, 5, 2, 6, 3]),
        ];
        for (orientation, width, samples) in stored {
            let raster = Raster::eight(width, 6 / width, 1, samples.to_vec());
            let upright = apply(raster, orientation);
            assert_eq!(upright, Raster::eight(3, 2, 1, vec![1, 2, 3, 4, 5, 6]), "orientation {orientation}");
        }
    }

    #[test]
    fn an_invalid_orientation_is_upright() {
        assert_eq!([0, 9, 65_536 + 3].map(sane), [1, 1, 1]);
    }
}
