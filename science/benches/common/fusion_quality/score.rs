//! PSNR over regions of the image, and tables of it.

use pinstack_science::{imaging::Raster, synth::Truth};

use super::case::samples;

/// Names of the columns.
pub const COLUMNS: [&str; 6] = ["whole", "object", "interior", "edges", "object edges", "flat ground"];

/// Distance from an edge up to which a pixel belongs to it, px, for an image 1200 px wide.
const EDGE: usize = 12;

/// The regions of an image that are scored separately.
pub struct Regions {
    object: Vec<bool>,
    edge: Vec<bool>,
    covered: Vec<bool>,
}

impl Regions {
    /// Edges are the pixels near a depth step of more than one slice, or near the silhouette. Only `covered` pixels
    /// count.
    pub fn of(truth: &Truth, covered: Vec<bool>) -> Self {
        let (depth, width, height) = (&truth.slice, truth.slice.width, truth.slice.height);
        let step = |a: f32, b: f32| a.is_nan() != b.is_nan() || (a - b).abs() > 1.0;
        let mut edge = vec![false; width * height];
        for y in 0..height {
            for x in 0..width {
                let beside = [(x + 1, y), (x, y + 1)].into_iter().filter(|&(x, y)| x < width && y < height);
                for (u, v) in beside.filter(|&(u, v)| step(depth.at(x, y), depth.at(u, v))) {
                    edge[y * width + x] = true;
                    edge[v * width + u] = true;
                }
            }
        }
        let reach = (EDGE * width / 1200).max(1);
        for y in 0..height {
            widen(&mut edge, y * width, 1, width, reach);
        }
        for x in 0..width {
            widen(&mut edge, x, width, height, reach);
        }
        let object = truth.mask.data.iter().map(|&v| v != 0).collect();
        Self { object, edge, covered }
    }

    fn counts(&self, column: usize, at: usize) -> bool {
        let (object, edge) = (self.object[at], self.edge[at]);
        self.covered[at]
            && match column {
                0 => true,
                1 => object,
                2 => object && !edge,
                3 => edge,
                4 => object && edge,
                _ => !object && !edge,
            }
    }
}

/// Sets every flag of a line within `reach` of a set one.
fn widen(flags: &mut [bool], first: usize, stride: usize, length: usize, reach: usize) {
    let set: Vec<usize> = (0..length).filter(|i| flags[first + i * stride]).collect();
    for at in set {
        for i in at.saturating_sub(reach)..(at + reach + 1).min(length) {
            flags[first + i * stride] = true;
        }
    }
}

/// PSNR over RGB per column, dB.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scores(pub [f64; COLUMNS.len()]);

impl Scores {
    pub fn of(picture: &Raster, truth: &Truth, regions: &Regions) -> Self {
        let pixels = samples(picture).chunks_exact(3).zip(samples(&truth.sharp).chunks_exact(3));
        let (mut squares, mut counts) = ([0.0; COLUMNS.len()], [0usize; COLUMNS.len()]);
        for (at, (found, wanted)) in pixels.enumerate() {
            let square: f64 = found.iter().zip(wanted).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
            for column in (0..COLUMNS.len()).filter(|&column| regions.counts(column, at)) {
                squares[column] += square;
                counts[column] += 3;
            }
        }
        Self(std::array::from_fn(|c| 10.0 * (255.0 * 255.0 * counts[c] as f64 / squares[c].max(1e-9)).log10()))
    }
}

/// Scores of the methods and of the other programs over all cases.
#[derive(Default)]
pub struct Table {
    /// Name, whether it is a method of pinstack, and its scores.
    rows: Vec<(&'static str, bool, Vec<Scores>)>,
}

impl Table {
    pub fn enter(&mut self, name: &'static str, ours: bool, scores: Scores) {
        match self.rows.iter_mut().find(|row| row.0 == name) {
            Some(row) => row.2.push(scores),
            None => self.rows.push((name, ours, vec![scores])),
        }
    }

    /// Prints the means as a Markdown table, with the distance of each own method from the best other program per
    /// column.
    pub fn print(&self, title: &str) {
        println!("\n### {title}\n\n| PSNR, dB | {} |\n|---{}|", COLUMNS.join(" | "), "|---:".repeat(COLUMNS.len()));
        let means: Vec<(&str, bool, [f64; COLUMNS.len()])> =
            self.rows.iter().map(|(name, ours, scores)| (*name, *ours, mean(scores))).collect();
        for (name, _, mean) in &means {
            println!("| {name} | {} |", mean.map(|v| format!("{v:.2}")).join(" | "));
        }
        let peers: Vec<_> = means.iter().filter(|row| !row.1).collect();
        if peers.is_empty() {
            return;
        }
        let best: [f64; COLUMNS.len()] =
            std::array::from_fn(|c| peers.iter().map(|row| row.2[c]).fold(f64::NEG_INFINITY, f64::max));
        println!("| **best peer** | {} |", best.map(|v| format!("{v:.2}")).join(" | "));
        for (name, _, mean) in means.iter().filter(|row| row.1) {
            let away: [f64; COLUMNS.len()] = std::array::from_fn(|c| mean[c] - best[c]);
            println!("| {name}, from it | {} |", away.map(|v| format!("{v:+.2}")).join(" | "));
        }
    }
}

/// Mean over the cases that have pixels in the region.
fn mean(scores: &[Scores]) -> [f64; COLUMNS.len()] {
    std::array::from_fn(|c| {
        let values: Vec<f64> = scores.iter().map(|s| s.0[c]).filter(|v| v.is_finite()).collect();
        values.iter().sum::<f64>() / values.len() as f64
    })
}
