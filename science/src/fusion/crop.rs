//! The part of the canvas that every slice covers.

use crate::{
    imaging::{Coverage, Rect, SliceMapping},
    types::{Homography, distortion::Distortion},
};

/// The largest rectangle of the canvas that every slice covers; `None` if no pixel is covered by every slice.
///
/// Slices and canvas are `width` x `height` px. Coverage follows the same rule as resampling, so no slice has an
/// uncovered pixel in the rectangle. The result depends only on the profile: all views of a scan are cropped alike.
///
/// ```
/// # use pinstack_science::{fusion::crop::valid_rect, imaging::Rect, types::Homography};
/// let moved = Homography::similarity(1.0, [4.0, 0.0]);
/// let rect = valid_rect(&[Homography::IDENTITY, moved], None, 60, 40);
/// assert_eq!(rect, Some(Rect { x: 4, y: 0, width: 56, height: 40 }));
/// ```
pub fn valid_rect(
    homographies: &[Homography],
    distortion: Option<&Distortion>,
    width: u32,
    height: u32,
) -> Option<Rect> {
    let size = (width as usize, height as usize);
    let mut common = Coverage::full(size.0, size.1);
    for homography in homographies.iter().filter(|homography| !homography.is_identity()) {
        let to_slice = homography.inverse()?;
        let coverage = match distortion {
            None => Coverage::of(&to_slice, size, size.0, size.1),
            Some(distortion) => Coverage::of_mapping(&SliceMapping::new(to_slice, *distortion, size), size),
        };
        common = common.intersection(&coverage);
    }
    largest_rect(&common)
}

/// The largest rectangle of covered pixels.
fn largest_rect(common: &Coverage) -> Option<Rect> {
    let rows = common.height();
    let mut best = Rect::default();
    for top in 0..rows {
        let first = common.span(top);
        // not even the full top row, extended to the last row, would be larger
        if first.len() * (rows - top) <= best.width * best.height {
            continue;
        }
        let (mut left, mut right) = (first.start, first.end);
        for bottom in top..rows {
            let last = common.span(bottom);
            (left, right) = (left.max(last.start), right.min(last.end));
            if left >= right {
                break;
            }
            let (width, height) = (right - left, bottom + 1 - top);
            if width * height > best.width * best.height {
                best = Rect { x: left, y: top, width, height };
            }
        }
    }
    (best.width > 0).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(rect: Rect) -> usize {
        rect.width * rect.height
    }

    #[test]
    fn aligned_slices_are_not_cropped() {
        let all = [Homography::IDENTITY; 3];
        assert_eq!(valid_rect(&all, None, 60, 40), Some(Rect::whole(60, 40)));
    }

    #[test]
    fn a_shift_crops_the_sides_that_it_uncovers() {
        let all = [Homography::similarity(1.0, [3.5, 0.0]), Homography::similarity(1.0, [-2.0, 4.0])];
        assert_eq!(valid_rect(&all, None, 60, 40), Some(Rect { x: 4, y: 4, width: 54, height: 36 }));
    }

    #[test]
    fn every_slice_covers_the_rectangle_and_no_larger_one_is_covered() {
        let turn = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            Homography([cos, -sin, 2.0, sin, cos, -3.0, 1e-4, -2e-4, 1.0])
        };
        let all = [turn(4.0), turn(-3.0), Homography::similarity(0.95, [1.0, 1.0])];
        let (width, height) = (48usize, 32usize);
        let found = valid_rect(&all, None, 48, 32).unwrap();
        let coverages: Vec<Coverage> =
            all.iter().map(|h| Coverage::of(&h.inverse().unwrap(), (width, height), width, height)).collect();
        let covered = |rect: Rect| coverages.iter().all(|coverage| coverage.contains(rect));
        assert!(covered(found));
        for y in 0..height {
            for x in 0..width {
                for rows in 1..=height - y {
                    // the widest rectangle with this corner and height that would beat the one found
                    let columns = area(found) / rows + 1;
                    if x + columns <= width {
                        assert!(!covered(Rect { x, y, width: columns, height: rows }));
                    }
                }
            }
        }
    }

    #[test]
    fn slices_without_a_common_pixel_have_no_rectangle() {
        let all = [Homography::similarity(1.0, [40.0, 0.0]), Homography::similarity(1.0, [-40.0, 0.0])];
        assert_eq!(valid_rect(&all, None, 60, 40), None);
    }
}
