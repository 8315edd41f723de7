//! The text model of COLMAP: cameras, images with their observations, and points.
//!
//! In: `cameras.txt`, `images.txt` and `points3D.txt`. Out: numbers, and for each image the mean error of reprojection,
//! which the files do not have. A line that cannot be read is an error: the files are written by a program that just
//! ended well.

use std::{
    collections::HashMap,
    fs::File,
    io::{self, BufRead, BufReader},
    path::Path,
    str::{FromStr, SplitAsciiWhitespace},
};

/// A camera.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Camera {
    /// Focal lengths, px.
    pub focal: [f64; 2],
    /// Principal point from the corner of the top-left pixel, px.
    pub centre: [f64; 2],
    /// Coefficients of `r^2` and `r^4`.
    radial: [f64; 2],
}

/// A registered image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Image {
    /// File name.
    pub name: String,
    /// World to camera, by rows.
    pub rotation: [[f64; 3]; 3],
    /// Translation of world to camera.
    translation: [f64; 3],
    camera: u32,
    /// Places of points in the image, px, and the ids of the points.
    observations: Vec<([f64; 2], u64)>,
}

/// A point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub position: [f64; 3],
    pub colour: [u8; 3],
}

/// A model.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Model {
    pub cameras: HashMap<u32, Camera>,
    pub images: Vec<Image>,
    pub points: HashMap<u64, Point>,
}

/// Errors of reprojection: their number and their sum.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Errors {
    pub count: u64,
    sum: f64,
}

impl Errors {
    /// The mean, px; `None` without observations.
    pub(super) fn mean(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }

    pub(super) fn add(self, other: Self) -> Self {
        Self { count: self.count + other.count, sum: self.sum + other.sum }
    }
}

impl Model {
    /// Reads the three files in a folder.
    ///
    /// # Errors
    /// When one cannot be read, or has a line of another form.
    pub(super) fn read(folder: &Path) -> io::Result<Self> {
        let mut model = Self::default();
        each_line(&folder.join("cameras.txt"), |line, _| {
            let (id, camera) = camera(line)?;
            model.cameras.insert(id, camera);
            Some(())
        })?;
        let mut last: Option<Image> = None;
        each_line(&folder.join("images.txt"), |line, is_first| {
            if is_first {
                last = Some(image(line)?);
            } else if let Some(mut image) = last.take() {
                image.observations = observations(line)?;
                model.images.push(image);
            }
            Some(())
        })?;
        each_line(&folder.join("points3D.txt"), |line, _| {
            let (id, point) = point(line)?;
            model.points.insert(id, point);
            Some(())
        })?;
        Ok(model)
    }

    /// The errors of reprojection of an image.
    pub(super) fn errors(&self, image: &Image) -> Errors {
        let Some(camera) = self.cameras.get(&image.camera) else { return Errors::default() };
        let mut errors = Errors::default();
        for (seen, id) in &image.observations {
            let Some(point) = self.points.get(id) else { continue };
            let [x, y] = camera.project(image.to_camera(point.position));
            let error = (x - seen[0]).hypot(y - seen[1]);
            if error.is_finite() {
                errors = errors.add(Errors { count: 1, sum: error });
            }
        }
        errors
    }

    /// The camera of an image.
    pub(super) fn camera(&self, image: &Image) -> Option<&Camera> {
        self.cameras.get(&image.camera)
    }
}

impl Image {
    fn to_camera(&self, point: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|row| dot(self.rotation[row], point) + self.translation[row])
    }

    /// Centre of projection in the world: `-R^T t`.
    pub(super) fn centre(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| -(0..3).map(|row| self.rotation[row][axis] * self.translation[row]).sum::<f64>())
    }
}

impl Camera {
    fn project(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        let [u, v] = [x / z, y / z];
        let square = u * u + v * v;
        let stretch = 1.0 + self.radial[0] * square + self.radial[1] * square * square;
        [self.focal[0] * u * stretch + self.centre[0], self.focal[1] * v * stretch + self.centre[1]]
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Calls `take` with each line that is no comment, and whether its number among these is odd. Empty lines count: an
/// image without observations has one.
fn each_line(path: &Path, mut take: impl FnMut(&str, bool) -> Option<()>) -> io::Result<()> {
    let mut number = 0;
    for line in BufReader::new(File::open(path)?).lines() {
        let line = line?;
        if line.starts_with('#') {
            continue;
        }
        number += 1;
        if take(&line, number % 2 == 1).is_none() {
            let start: String = line.chars().take(80).collect();
            let file = path.file_name().unwrap_or_default().to_string_lossy();
            return Err(io::Error::new(io::ErrorKind::InvalidData, format!("{file} has the line '{start}'")));
        }
    }
    Ok(())
}

/// The words of a line.
struct Words<'a>(SplitAsciiWhitespace<'a>);

fn words_of(line: &str) -> Words<'_> {
    Words(line.split_ascii_whitespace())
}

impl Words<'_> {
    fn next<T: FromStr>(&mut self) -> Option<T> {
        self.0.next()?.parse().ok()
    }

    fn some<T: FromStr + Copy + Default, const N: usize>(&mut self) -> Option<[T; N]> {
        let mut all = [T::default(); N];
        for one in &mut all {
            *one = self.next()?;
        }
        Some(all)
    }
}

fn camera(line: &str) -> Option<(u32, Camera)> {
    let mut words = words_of(line);
    let (id, model) = (words.next()?, words.next::<String>()?);
    let [_width, _height]: [u32; 2] = words.some()?;
    let parameters: Vec<f64> = words.0.map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let (focal, centre, radial) = match (model.as_str(), parameters.as_slice()) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f; 2], [cx, cy], [0.0; 2]),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy], [cx, cy], [0.0; 2]),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f; 2], [cx, cy], [k, 0.0]),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f; 2], [cx, cy], [k1, k2]),
        _ => return None,
    };
    Some((id, Camera { focal, centre, radial }))
}

fn image(line: &str) -> Option<Image> {
    let mut words = words_of(line);
    words.next::<u32>()?;
    let quaternion: [f64; 4] = words.some()?;
    let translation = words.some()?;
    let (camera, name) = (words.next()?, words.next()?);
    let rotation = rotation(quaternion)?;
    Some(Image { name, rotation, translation, camera, observations: Vec::new() })
}

/// The matrix of a quaternion (w, x, y, z).
fn rotation(quaternion: [f64; 4]) -> Option<[[f64; 3]; 3]> {
    let norm = quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
    if !(norm > 0.0 && norm.is_finite()) {
        return None;
    }
    let [w, x, y, z] = quaternion.map(|q| q / norm);
    Some([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ])
}

/// The observations of points; features without a point are left out.
fn observations(line: &str) -> Option<Vec<([f64; 2], u64)>> {
    let mut words = words_of(line);
    let mut all = Vec::new();
    while let Some(x) = words.0.next() {
        let place = [x.parse().ok()?, words.next()?];
        if let Ok(id) = u64::try_from(words.next::<i64>()?) {
            all.push((place, id));
        }
    }
    Some(all)
}

fn point(line: &str) -> Option<(u64, Point)> {
    let mut words = words_of(line);
    Some((words.next()?, Point { position: words.some()?, colour: words.some()? }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_reprojection_are_computed_from_the_text_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
        write("cameras.txt", "# CAMERA\n1 RADIAL 100 80 100 50 40 0.1 0\n");
        // turned by 90 degrees about the optical axis, 2 in front of the world
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let images =
            format!("# I\n7 {half} 0 0 {half} 0 0 2 1 a.png\n50 45.125 3 10 10 -1\n8 1 0 0 0 0 0 2 1 b.png\n\n");
        write("images.txt", &images);
        write("points3D.txt", "3 0.1 0 0 10 20 30 0.5 7 0\n");
        let model = Model::read(folder.path()).expect("a model");
        let [a, b] = model.images.as_slice() else { panic!("two images: {:?}", model.images) };
        // (0.1, 0, 0) is at (0, 0.1, 2): 0.05 * 100 * (1 + 0.1 * 0.0025) below the centre
        let errors = model.errors(a);
        assert_eq!(errors.count, 1);
        assert!((errors.mean().expect("one") - (45.125 - 45.00125)).abs() < 1e-9, "{errors:?}");
        assert_eq!(model.errors(b).mean(), None);
        assert!(a.centre().iter().zip([0.0, 0.0, -2.0]).all(|(found, true_one)| (found - true_one).abs() < 1e-12));
        write("points3D.txt", "3 0.1 zero 0 10 20 30 0.5\n");
        let error = Model::read(folder.path()).expect_err("no number").to_string();
        assert!(error.contains("points3D.txt has the line '3 0.1 zero"), "{error}");
    }
}
