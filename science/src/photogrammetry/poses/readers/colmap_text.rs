//! COLMAP `images.txt`: two lines per image, `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME` and its points.
//!
//! <https://colmap.github.io/format.html#images-txt>
//!
//! A line of `points3D.txt` has nine numbers, too. So the ids must be whole numbers, the quaternion of length 1, and
//! the name more than numbers.

use super::found::{Found, colmap_pose, shown};
use crate::{photogrammetry::poses::invalid, types::Error};

/// Values of a line of an image without blanks in its name.
const VALUES: usize = 10;
/// Largest deviation of the length of a quaternion from 1. Programs write six digits or more.
const MAX_DEVIATION: f64 = 0.01;

pub(super) fn read(text: &str, found: &mut Found) -> Result<(), Error> {
    let mut lines = text.lines().enumerate();
    while let Some((at, line)) = lines.next() {
        if line.starts_with('#') || line.trim().is_empty() {
            continue;
        }
        let place = || format!("line {}", at + 1);
        let mut rest = line.trim();
        let mut words = [""; 9];
        let mut numbers = [0.0; 9];
        for (column, (word, number)) in words.iter_mut().zip(&mut numbers).enumerate() {
            let (first, after) = rest.split_once([' ', '\t']).unwrap_or((rest, ""));
            *word = first;
            *number = first.parse().map_err(|_| wrong(at, &format!("value {} is '{}'", column + 1, shown(first))))?;
            rest = after.trim_start();
        }
        if let Some(what) = is_no_image(&words, &numbers, rest) {
            return Err(of_another_file(at, &what));
        }
        let [_, w, x, y, z, tx, ty, tz, _] = numbers;
        let pose = colmap_pose(rest.to_owned(), [w, x, y, z], [tx, ty, tz]);
        found.pose(pose.ok_or_else(|| wrong(at, "the quaternion has no length"))?, words[8], place)?;
        if let Some((at, _)) = lines.next().filter(|(_, points)| is_an_image(points)) {
            return Err(wrong(at, "a line of points is missing before this image"));
        }
    }
    Ok(())
}

/// Why nine numbers and a name are not those of an image.
fn is_no_image(words: &[&str; 9], numbers: &[f64; 9], name: &str) -> Option<String> {
    for column in [0, 8] {
        if words[column].parse::<u64>().is_err() {
            return Some(format!("value {} is '{}', not a whole number", column + 1, shown(words[column])));
        }
    }
    let length = numbers[1..5].iter().map(|q| q * q).sum::<f64>().sqrt();
    if length.is_nan() || (length - 1.0).abs() > MAX_DEVIATION {
        return Some(format!("the quaternion (values 2 to 5) has the length {length:.3}, not 1"));
    }
    let mut parts = name.split_ascii_whitespace();
    if !name.is_empty() && parts.all(is_number) {
        return Some(format!("the name is '{}', which has numbers alone", shown(name)));
    }
    None
}

/// Whether a line where points are due is the next image: points end with a number.
fn is_an_image(line: &str) -> bool {
    let mut words = line.split_ascii_whitespace();
    let last = words.next_back();
    last.is_some_and(|word| !is_number(word)) && words.take(VALUES - 1).count() == VALUES - 1
}

fn is_number(word: &str) -> bool {
    word.parse::<f64>().is_ok()
}

fn wrong(at: usize, what: &str) -> Error {
    invalid(format!(
        "line {}: {what}; an image has a line of {VALUES} values (IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME), and a \
         line with its points, which may be empty",
        at + 1
    ))
}

fn of_another_file(at: usize, what: &str) -> Error {
    invalid(format!("{}; send images and not cameras or points3D", wrong(at, what).detail))
}
