//! Softness of the edges of an image: shows whether a synthetic lens is as sharp as real ones.

use pinstack_science::imaging::{Raster, Samples};

/// Half the length of the profile of an edge, px.
const REACH: usize = 4;

/// Least slope (grey levels per px) and least contrast (grey levels) of an edge.
const SLOPE: f32 = 12.0;
const CONTRAST: f32 = 40.0;

/// Tolerance for noise in a monotonic edge, grey levels.
const NOISE: f32 = 3.0;

/// The spread of each edge along rows and columns of the green (or grey) channel, px, ascending: the standard deviation
/// of the Gaussian that blurs a step to such an edge, `contrast / (sqrt(2 pi) * largest slope)`.
pub fn spreads(picture: &Raster) -> Vec<f32> {
    let Samples::Eight(samples) = &picture.samples else { return Vec::new() };
    let (width, height) = (picture.width, picture.height);
    let value = |x: usize, y: usize| f32::from(samples[(y * width + x) * picture.channels + picture.channels / 2]);
    let mut found = Vec::new();
    for y in 0..height {
        along(&(0..width).map(|x| value(x, y)).collect::<Vec<f32>>(), &mut found);
    }
    for x in 0..width {
        along(&(0..height).map(|y| value(x, y)).collect::<Vec<f32>>(), &mut found);
    }
    found.sort_by(f32::total_cmp);
    found
}

fn along(line: &[f32], found: &mut Vec<f32>) {
    let slope = |at: usize| (line[at + 1] - line[at - 1]) / 2.0;
    for at in REACH + 2..line.len().saturating_sub(REACH + 2) {
        let steepest = slope(at).abs();
        let is_peak = [at - 2, at - 1, at + 1, at + 2].iter().all(|&beside| slope(beside).abs() <= steepest);
        if steepest < SLOPE || !is_peak {
            continue;
        }
        let edge = &line[at - REACH..=at + REACH];
        let rises = edge.windows(2).all(|two| (two[1] - two[0]) * slope(at).signum() > -NOISE);
        let (low, high) = edge.iter().fold((f32::MAX, f32::MIN), |(low, high), &v| (low.min(v), high.max(v)));
        if rises && high - low >= CONTRAST {
            found.push((high - low) / ((2.0 * std::f32::consts::PI).sqrt() * steepest));
        }
    }
}
