//! A small renderer of dot targets for tests: anti-aliased discs under a known homography, with disc blur, vignetting
//! and noise. Shares no code with [`crate::synth`].

use crate::imaging::Raster;
use crate::types::Homography;

/// A slice of a target to render.
#[derive(Debug, Clone)]
pub(super) struct Shot {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Columns and rows of the grid.
    pub grid: [i32; 2],
    /// Dot pitch in the reference slice, px.
    pub pitch: f64,
    /// Dot diameter over the pitch.
    pub fill: f64,
    /// Slice px -> reference-slice px.
    pub homography: Homography,
    /// Blur radius, px.
    pub blur: f64,
    /// Level of white at the centre.
    pub white: f64,
    /// Relative loss of light in the corners, 0..1.
    pub vignetting: f64,
    /// Standard deviation of the noise.
    pub noise: f64,
    /// Bright dots on black.
    pub inverted: bool,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for Shot {
    fn default() -> Self {
        Self {
            width: 480,
            height: 360,
            grid: [13, 9],
            pitch: 30.0,
            fill: 0.5,
            homography: Homography::IDENTITY,
            blur: 0.8,
            white: 215.0,
            vignetting: 0.25,
            noise: 1.5,
            inverted: false,
            seed: 1,
        }
    }
}

/// Normal deviates from a counter: SplitMix64 and Box-Muller.
pub(super) struct Noise(pub u64);

impl Noise {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normal deviate: mean 0, standard deviation 1.
    pub(super) fn normal(&mut self) -> f64 {
        (-2.0 * self.unit().max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// Uniform between -1 and 1.
    pub(super) fn even(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }
}

/// Renders the slice as 8-bit grey.
pub(super) fn render(shot: &Shot) -> Raster {
    let (width, height) = (shot.width, shot.height);
    let extent = [f64::from(shot.grid[0] - 1) * shot.pitch, f64::from(shot.grid[1] - 1) * shot.pitch];
    let corner = [(width as f64 - 1.0 - extent[0]) / 2.0 + 0.31, (height as f64 - 1.0 - extent[1]) / 2.0 - 0.17];
    let back = shot.homography.inverse().expect("homographies of tests are regular");
    let disc = 0.5 * shot.fill * shot.pitch / shot.homography.scale_at([0.0, 0.0]);
    let profile = Profile::new(disc, shot.blur);
    let mut coverage = vec![0.0_f64; width * height];
    for j in 0..shot.grid[1] {
        for i in 0..shot.grid[0] {
            let c = back.apply([corner[0] + f64::from(i) * shot.pitch, corner[1] + f64::from(j) * shot.pitch]);
            let reach = disc + shot.blur + 2.0;
            let low = [(c[0] - reach).floor().max(0.0) as usize, (c[1] - reach).floor().max(0.0) as usize];
            let high = [(c[0] + reach).ceil().min(width as f64 - 1.0), (c[1] + reach).ceil().min(height as f64 - 1.0)];
            if high[0] < 0.0 || high[1] < 0.0 {
                continue;
            }
            for y in low[1]..=high[1] as usize {
                for x in low[0]..=high[0] as usize {
                    coverage[y * width + x] += profile.over_pixel(x as f64 - c[0], y as f64 - c[1]);
                }
            }
        }
    }
    let mut noise = Noise(shot.seed);
    let samples = (0..width * height)
        .map(|k| {
            let (u, v) = ((k % width) as f64 / width as f64 - 0.5, (k / width) as f64 / height as f64 - 0.5);
            let light = shot.white * (1.0 - 2.0 * shot.vignetting * (u * u + v * v));
            let cover = 0.85 * coverage[k].min(1.0);
            let grey = if shot.inverted { light * (0.06 + cover) } else { light * (1.0 - cover) };
            (grey + shot.noise * noise.normal()).round().clamp(0.0, 255.0) as u8
        })
        .collect();
    Raster::eight(width, height, 1, samples)
}

/// Disc blurred by a disc: the overlap of the two over the distance of their centres.
struct Profile {
    disc: f64,
    blur: f64,
}

impl Profile {
    fn new(disc: f64, blur: f64) -> Self {
        Self { disc, blur: blur.max(0.05) }
    }

    fn at(&self, d: f64) -> f64 {
        let (a, b) = (self.disc, self.blur);
        let whole = std::f64::consts::PI * b * b;
        if d >= a + b {
            return 0.0;
        }
        if d <= (a - b).abs() {
            return (std::f64::consts::PI * a.min(b).powi(2)) / whole;
        }
        let angle = |p: f64, q: f64| ((d * d + p * p - q * q) / (2.0 * d * p)).clamp(-1.0, 1.0).acos();
        let root = ((-d + a + b) * (d + a - b) * (d - a + b) * (d + a + b)).max(0.0).sqrt();
        (a * a * angle(a, b) + b * b * angle(b, a) - 0.5 * root) / whole
    }

    /// Mean over the pixel whose centre is (x, y) from the centre of the dot.
    fn over_pixel(&self, x: f64, y: f64) -> f64 {
        let mut sum = 0.0;
        for j in 0..4 {
            for i in 0..4 {
                let (dx, dy) = ((f64::from(i) - 1.5) / 4.0, (f64::from(j) - 1.5) / 4.0);
                sum += self.at((x + dx).hypot(y + dy));
            }
        }
        sum / 16.0
    }
}
