//! The colour of each vertex from the views that see it best.
//!
//! A view sees a vertex when the surface faces the camera and nothing of the hull is nearer: a depth map of the
//! vertices, of pixels of [`DEPTH_CELLS`] cells, says what is nearest. Of the views with the largest cosine of
//! incidence the weighted median by brightness is taken: highlights and shadows move with the camera and are outvoted,
//! and no colours of different places are mixed. Vertices that no view sees take the mean of their neighbours.

use rayon::prelude::*;

use super::mesh::{Mesh, dot, length, minus};
use crate::{
    imaging::{Plane, Raster, Samples},
    types::pinhole::PinholeCamera,
};

/// Width of a pixel of the depth map, cells: no gaps between vertices, which are at most two cells apart.
const DEPTH_CELLS: f64 = 2.0;
/// How much farther than the nearest vertex a visible one may be, cells.
const BEHIND_CELLS: f64 = 4.0;
/// Least cosine between the normal and the direction to the camera.
const LEAST_COSINE: f64 = 0.2;
/// Views that are asked for the colour of a vertex.
const VIEWS: usize = 5;
/// Colour where nothing is known.
const GREY: [u8; 3] = [128; 3];
/// Weights of red, green and blue in brightness, of 256.
const BRIGHTNESS: [u32; 3] = [77, 150, 29];

/// The best samples of a vertex so far: weight and colour. The weight of an unused one is 0.
#[derive(Debug, Clone, Copy, Default)]
struct BestSamples([(f32, [u8; 3]); VIEWS]);

/// Collects the colours of the vertices, view by view.
pub(super) struct Colouring {
    samples: Vec<BestSamples>,
    cell: f64,
}

impl Colouring {
    /// For a mesh of cells of this size.
    pub(super) fn new(mesh: &Mesh, cell: f64) -> Self {
        Self { samples: vec![BestSamples::default(); mesh.positions.len()], cell }
    }

    /// Adds what a view sees.
    pub(super) fn add(&mut self, mesh: &Mesh, camera: &PinholeCamera, picture: &Raster) {
        let seen: Vec<Option<([f64; 2], f64)>> =
            mesh.positions.par_iter().map(|position| camera.project(position.map(f64::from))).collect();
        let depths = DepthMap::of(camera, &seen, self.cell);
        let tolerance = BEHIND_CELLS * self.cell;
        let vertices = self.samples.par_iter_mut().zip(&mesh.positions).zip(&mesh.normals).zip(&seen);
        vertices.for_each(|(((samples, position), normal), seen)| {
            let Some((px, depth)) = *seen else { return };
            let towards = minus(camera.centre, position.map(f64::from));
            let cosine = dot(normal.map(f64::from), towards) / length(towards);
            if cosine < LEAST_COSINE || depth > depths.at(px) + tolerance {
                return;
            }
            if let Some(colour) = sampled(picture, px) {
                // nearer cameras see more detail
                samples.add((cosine / depth) as f32, colour);
            }
        });
    }

    /// The colours; those of vertices that no view has seen follow from their neighbours.
    pub(super) fn finish(self, mesh: &Mesh) -> Vec<[u8; 3]> {
        let mut colours: Vec<Option<[u8; 3]>> = self.samples.into_par_iter().map(BestSamples::median).collect();
        let mut unseen: Vec<&[u32; 3]> =
            mesh.triangles.iter().filter(|corners| is_unfinished(corners, &colours)).collect();
        while !unseen.is_empty() {
            let mut sums = std::collections::BTreeMap::<u32, ([u32; 3], u32)>::new();
            for corners in &unseen {
                let known = corners.iter().filter_map(|&corner| colours[corner as usize]);
                let known: Vec<[u8; 3]> = known.collect();
                for &corner in corners.iter().filter(|corner| colours[**corner as usize].is_none()) {
                    for colour in &known {
                        let (sum, count) = sums.entry(corner).or_default();
                        *sum = [0, 1, 2].map(|channel| sum[channel] + u32::from(colour[channel]));
                        *count += 1;
                    }
                }
            }
            if sums.is_empty() {
                break;
            }
            for (corner, (sum, count)) in sums {
                colours[corner as usize] = Some(sum.map(|value| (value / count) as u8));
            }
            unseen.retain(|corners| is_unfinished(corners, &colours));
        }
        colours.into_iter().map(|colour| colour.unwrap_or(GREY)).collect()
    }
}

fn is_unfinished(corners: &[u32; 3], colours: &[Option<[u8; 3]>]) -> bool {
    corners.iter().any(|&corner| colours[corner as usize].is_none())
}

impl BestSamples {
    /// Replaces the sample with the least weight if this one has more.
    fn add(&mut self, weight: f32, colour: [u8; 3]) {
        let least = (1..VIEWS).fold(0, |least, at| if self.0[at].0 < self.0[least].0 { at } else { least });
        if weight > self.0[least].0 {
            self.0[least] = (weight, colour);
        }
    }

    /// The sample in the middle of the weight, by brightness.
    fn median(mut self) -> Option<[u8; 3]> {
        let brightness = |colour: [u8; 3]| (0..3).map(|c| BRIGHTNESS[c] * u32::from(colour[c])).sum::<u32>();
        self.0.sort_by_key(|(_, colour)| brightness(*colour));
        let half = self.0.iter().map(|(weight, _)| weight).sum::<f32>() / 2.0;
        let mut sum = 0.0;
        let reached = |(weight, _): &&(f32, [u8; 3])| {
            sum += weight;
            *weight > 0.0 && sum >= half
        };
        self.0.iter().find(reached).map(|(_, colour)| *colour)
    }
}

/// Depth of the nearest vertex at each pixel of a reduced picture.
struct DepthMap {
    depths: Plane<f32>,
    /// Pixels of the picture per pixel of the map.
    step: f64,
}

impl DepthMap {
    fn of(camera: &PinholeCamera, seen: &[Option<([f64; 2], f64)>], cell: f64) -> Self {
        let nearest = seen.iter().flatten().map(|(_, depth)| *depth).fold(f64::INFINITY, f64::min);
        let step = (DEPTH_CELLS * cell * camera.focal_px[0] / nearest).max(1.0);
        let [width, height] = camera.size.map(|size| (size as f64 / step).ceil() as usize + 1);
        let mut map = Self { depths: Plane::filled(width, height, f32::INFINITY), step };
        for (px, depth) in seen.iter().flatten() {
            if let Some(at) = map.place(*px) {
                map.depths.data[at] = map.depths.data[at].min(*depth as f32);
            }
        }
        map
    }

    fn place(&self, px: [f64; 2]) -> Option<usize> {
        let [x, y] = px.map(|p| (p / self.step + 0.5).floor());
        let is_within = x >= 0.0 && y >= 0.0 && x < self.depths.width as f64 && y < self.depths.height as f64;
        is_within.then(|| y as usize * self.depths.width + x as usize)
    }

    fn at(&self, px: [f64; 2]) -> f64 {
        self.place(px).map_or(f64::NEG_INFINITY, |at| f64::from(self.depths.data[at]))
    }
}

/// The colour at a position of a picture, bilinear, 8 bits; `None` outside of the picture.
fn sampled(picture: &Raster, [x, y]: [f64; 2]) -> Option<[u8; 3]> {
    let [last_x, last_y] = [picture.width - 1, picture.height - 1];
    if x < 0.0 || y < 0.0 || x > last_x as f64 || y > last_y as f64 {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    // what is transparent has no colour, or one that was made up
    let is_opaque = |x: usize, y: usize| match &picture.samples {
        _ if picture.channels != 4 => true,
        Samples::Eight(samples) => samples[(y * picture.width + x) * 4 + 3] == u8::MAX,
        Samples::Sixteen(samples) => samples[(y * picture.width + x) * 4 + 3] == u16::MAX,
    };
    let [columns, rows] = [[column, (column + 1).min(last_x)], [row, (row + 1).min(last_y)]];
    if !rows.into_iter().all(|row| columns.into_iter().all(|column| is_opaque(column, row))) {
        return None;
    }
    let (u, v) = (x - column as f64, y - row as f64);
    let sample = |x: usize, y: usize, channel: usize| {
        let at = (y * picture.width + x) * picture.channels + if picture.channels < 3 { 0 } else { channel };
        match &picture.samples {
            Samples::Eight(samples) => f64::from(samples[at]),
            Samples::Sixteen(samples) => f64::from(samples[at]) / 257.0,
        }
    };
    Some([0, 1, 2].map(|channel| {
        let line = |y: usize| (1.0 - u) * sample(column, y, channel) + u * sample((column + 1).min(last_x), y, channel);
        ((1.0 - v) * line(row) + v * line((row + 1).min(last_y))).round() as u8
    }))
}
