//! Detection of round spots in a sharp image: local threshold, connected components, moments.

use crate::imaging::Plane;

use super::statistics::{quantile, thinned};

/// A spot that may be a dot, in px of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Blob {
    /// Centre.
    pub at: [f64; 2],
    /// Area, px.
    pub area: f64,
}

/// Least contrast of a dot against its surroundings.
const MIN_CONTRAST: f64 = 0.03;

/// Round spots of `contrast` that stand out from the mean over `(2 radius + 1)^2` px around them. Spots that touch the
/// border are left out: their centres are not those of the dots.
pub(super) fn find(contrast: &Plane<f32>, radius: usize) -> Vec<Blob> {
    let (width, height) = (contrast.width, contrast.height);
    if width < 8 || height < 8 {
        return Vec::new();
    }
    let smooth = box_mean(contrast, 1);
    let around = box_mean(&smooth, radius);
    let standing = smooth.data.iter().zip(&around.data).map(|(a, b)| a - b).collect();
    let standing = Plane { width, height, data: standing };
    let contrast = quantile(&mut thinned(&standing), 0.985);
    if contrast < MIN_CONTRAST {
        return Vec::new();
    }
    let (threshold, standing) = ((0.35 * contrast) as f32, standing.data);
    let mut visited = vec![false; standing.len()];
    let mut blobs = Vec::new();
    let mut stack = Vec::new();
    for start in 0..standing.len() {
        if visited[start] || standing[start] <= threshold {
            continue;
        }
        let mut moments = Moments::default();
        let mut at_frame = false;
        visited[start] = true;
        stack.push(start);
        while let Some(at) = stack.pop() {
            let (x, y) = (at % width, at / width);
            moments.add(x as f64, y as f64, f64::from(standing[at] - threshold));
            at_frame |= x == 0 || y == 0 || x + 1 == width || y + 1 == height;
            let neighbours = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then(|| at + 1),
                (y > 0).then(|| at - width),
                (y + 1 < height).then(|| at + width),
            ];
            for next in neighbours.into_iter().flatten() {
                if !visited[next] && standing[next] > threshold {
                    visited[next] = true;
                    stack.push(next);
                }
            }
        }
        if !at_frame && let Some(blob) = moments.blob() {
            blobs.push(blob);
        }
    }
    blobs
}

/// Running moments of one component.
#[derive(Default)]
struct Moments {
    area: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    weight: f64,
    wx: f64,
    wy: f64,
}

impl Moments {
    fn add(&mut self, x: f64, y: f64, weight: f64) {
        self.area += 1.0;
        self.x += x;
        self.y += y;
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
        self.weight += weight;
        self.wx += weight * x;
        self.wy += weight * y;
    }

    /// The spot, if it is round and filled: axis ratio at most 1.8, and 0.8 to 1.15 of the area of its ellipse of
    /// inertia.
    fn blob(&self) -> Option<Blob> {
        if self.area < 7.0 || self.weight <= 0.0 {
            return None;
        }
        let n = self.area;
        let (mx, my) = (self.x / n, self.y / n);
        // 1/12: second moment of a single pixel
        let (a, b, c) = (self.xx / n - mx * mx + 1.0 / 12.0, self.xy / n - mx * my, self.yy / n - my * my + 1.0 / 12.0);
        let (mean, half) = ((a + c) / 2.0, (((a - c) / 2.0).powi(2) + b * b).sqrt());
        let (long, short) = (mean + half, mean - half);
        if short <= 0.0 || long / short > 1.8 * 1.8 {
            return None;
        }
        let fullness = n / (4.0 * std::f64::consts::PI * (long * short).sqrt());
        let round = (0.8..1.15).contains(&fullness);
        round.then_some(Blob { at: [self.wx / self.weight, self.wy / self.weight], area: n })
    }
}

/// Box mean over `(2 radius + 1)^2` px, divided by the number of pixels inside at the borders. Running sums in f64.
fn box_mean(plane: &Plane<f32>, radius: usize) -> Plane<f32> {
    let (width, height) = (plane.width, plane.height);
    let mut columns = vec![0.0_f64; width];
    let mut out = Vec::with_capacity(width * height);
    let add = |columns: &mut [f64], y: usize, sign: f64| {
        for (sum, &v) in columns.iter_mut().zip(plane.row(y)) {
            *sum += sign * f64::from(v);
        }
    };
    for y in 0..radius.min(height) {
        add(&mut columns, y, 1.0);
    }
    for y in 0..height {
        if y + radius < height {
            add(&mut columns, y + radius, 1.0);
        }
        if y > radius {
            add(&mut columns, y - radius - 1, -1.0);
        }
        let rows = (y + radius).min(height - 1) - y.saturating_sub(radius) + 1;
        let mut sum: f64 = columns[..radius.min(width)].iter().sum();
        for x in 0..width {
            if x + radius < width {
                sum += columns[x + radius];
            }
            if x > radius {
                sum -= columns[x - radius - 1];
            }
            let count = ((x + radius).min(width - 1) - x.saturating_sub(radius) + 1) * rows;
            out.push((sum / count as f64) as f32);
        }
    }
    Plane { width, height, data: out }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dots(centres: &[[f64; 2]], radius: f64) -> Plane<f32> {
        Plane::from_fn(120, 90, |x, y| {
            let nearest =
                centres.iter().map(|c| (x as f64 - c[0]).hypot(y as f64 - c[1])).fold(f64::INFINITY, f64::min);
            (radius + 0.5 - nearest).clamp(0.0, 1.0) as f32 * 0.7
        })
    }

    #[test]
    fn round_spots_are_located_to_a_fraction_of_a_pixel_and_cut_ones_are_left_out() {
        let truth = [[30.3, 40.6], [70.5, 30.2], [119.0, 60.0]];
        let found = find(&dots(&truth, 6.0), 20);
        assert_eq!(found.len(), 2, "{found:?}");
        for blob in &found {
            let error = truth.iter().map(|c| (blob.at[0] - c[0]).hypot(blob.at[1] - c[1])).fold(f64::MAX, f64::min);
            assert!(error < 0.15, "{error}");
        }
    }

    #[test]
    fn lines_and_blank_pictures_hold_no_spots() {
        let line = Plane::from_fn(120, 90, |x, y| if y == 40 && x > 10 && x < 90 { 0.8 } else { 0.0 });
        assert!(find(&line, 15).is_empty());
        assert!(find(&Plane::filled(120, 90, 0.5), 15).is_empty());
        assert!(find(&Plane::filled(3, 3, 0.5), 15).is_empty());
    }

    #[test]
    fn a_box_mean_divides_by_the_pixels_inside_at_the_border() {
        let plane = Plane::from_fn(5, 4, |x, y| (x + y) as f32);
        let mean = box_mean(&plane, 9);
        assert!(mean.data.iter().all(|v| (v - 3.5).abs() < 1e-6));
        assert!((box_mean(&plane, 1).at(0, 0) - 1.0).abs() < 1e-6);
    }
}
