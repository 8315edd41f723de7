//! COLMAP `images.txt`: two lines per image, `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME` and its points.
//!
//! <https://colmap.github.io/format.html#images-txt>

use super::{Found, colmap_pose, shown};
use crate::{photogrammetry::poses::invalid, types::Error};

pub(super) fn read(text: &str, found: &mut Found) -> Result<(), Error> {
    let mut lines = text.lines().enumerate();
    while let Some((at, line)) = lines.next() {
        if line.starts_with('#') || line.trim().is_empty() {
            continue;
        }
        let place = || format!("line {}", at + 1);
        let wrong = |what: &str| {
            let detail = format!(
                "line {}: {what}; an image has a line of 10 values (IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME), and a \
                 line with its points, which may be empty",
                at + 1
            );
            invalid(detail)
        };
        let mut rest = line.trim();
        let mut numbers = [0.0; 9];
        for (column, number) in numbers.iter_mut().enumerate() {
            let (word, after) = rest.split_once([' ', '\t']).unwrap_or((rest, ""));
            *number = word.parse().map_err(|_| wrong(&format!("value {} is '{}'", column + 1, shown(word))))?;
            rest = after.trim_start();
        }
        let [_, w, x, y, z, tx, ty, tz, _] = numbers;
        let pose = colmap_pose(rest.to_owned(), [w, x, y, z], [tx, ty, tz]);
        found.pose(pose.ok_or_else(|| wrong("the quaternion has no length"))?, place)?;
        // its points
        lines.next();
    }
    Ok(())
}
