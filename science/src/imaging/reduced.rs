//! A small grey copy of a picture, for questions that need no detail.

use super::{Raster, Sample, Samples, grey};

/// The luma of `raster` averaged over squares, so that its longer side has at most `most` px; 8 bits, one channel. What
/// does not fill a square at the right and bottom is left out.
pub fn reduced(raster: &Raster, most: usize) -> Raster {
    let step = raster.width.max(raster.height).div_ceil(most.max(1)).max(1);
    let step = step.min(raster.width.min(raster.height).max(1));
    match &raster.samples {
        Samples::Eight(samples) => averaged(samples, raster, step),
        Samples::Sixteen(samples) => averaged(samples, raster, step),
    }
}

fn averaged<S: Sample>(samples: &[S], raster: &Raster, step: usize) -> Raster {
    let (width, height) = (raster.width / step, raster.height / step);
    let stride = raster.width * raster.channels;
    let mut luma = vec![0.0f32; raster.width];
    let mut out = Vec::with_capacity(width * height);
    for y in 0..height {
        let mut sums = vec![0.0f32; width];
        for row in y * step..(y + 1) * step {
            grey::luma_row(&samples[row * stride..(row + 1) * stride], raster.channels, &mut luma);
            for (sum, cell) in sums.iter_mut().zip(luma.chunks_exact(step)) {
                *sum += cell.iter().sum::<f32>();
            }
        }
        out.extend(sums.iter().map(|sum| u8::rounded(sum / (step * step) as f32)));
    }
    Raster::eight(width, height, 1, out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_averaged_in_either_depth() {
        let eight: Vec<u8> = (0..7 * 5).map(|i| if i % 7 < 2 { 200 } else { 100 }).collect();
        let sixteen = eight.iter().map(|&v| u16::from(v) * 257).collect();
        for raster in [Raster::eight(7, 5, 1, eight.clone()), Raster::sixteen(7, 5, 1, sixteen)] {
            assert_eq!(reduced(&raster, 4), Raster::eight(3, 2, 1, vec![200, 100, 100, 200, 100, 100]));
            assert_eq!(reduced(&raster, 7), Raster::eight(7, 5, 1, eight.clone()));
        }
        assert_eq!(reduced(&Raster::eight(9, 1, 1, vec![8; 9]), 2).height, 1);
    }
}
