//! Which pixels the second pass fuses when only some of them will be shown.

use super::{align::Aligned, run::Run};
use crate::{
    imaging::{Plane, Rect, Sample},
    types::Interrupted,
};

/// All pixels within this distance of a shown pixel are fused, px. The windows of the metrics reach less far, and
/// colours are continued less far beyond outlines.
pub(super) const MARGIN: usize = 32;

impl Run<'_> {
    /// The part of `rect` that is fused, so that every pixel within `margin` px (along x and y) of a shown pixel is;
    /// `None` if there is none.
    pub(super) fn part_to_fuse(&self, rect: Rect, margin: usize) -> Option<Rect> {
        let Some(shown) = self.request.shown else { return Some(rect) };
        let (width, height) = (shown.width, shown.height);
        let bounds = bounds(shown, rect.grown(margin, width, height))?.grown(margin, width, height);
        let (x, y) = (bounds.x.max(rect.x), bounds.y.max(rect.y));
        let right = (bounds.x + bounds.width).min(rect.x + rect.width);
        let bottom = (bounds.y + bounds.height).min(rect.y + rect.height);
        (x < right && y < bottom).then(|| Rect { x, y, width: right - x, height: bottom - y })
    }

    /// The image before anything is fused: black, or what the reference slice shows where only some pixels are fused.
    pub(super) fn unfused<S: Sample, const C: usize>(&self, aligned: &Aligned) -> Result<Vec<S>, Interrupted> {
        let (width, height) = (self.plan.width, self.plan.height);
        let mut samples = Vec::new();
        match self.request.shown {
            None => samples.resize(width * height * C, S::default()),
            Some(_) => {
                let all = Rect::whole(width, height);
                aligned.scratch.read(self.plan.reference, all, &mut samples, &mut Vec::new())?;
            }
        }
        Ok(samples)
    }
}

/// The smallest rectangle around the pixels of `rect` that are not 0; `None` if there are none.
fn bounds(plane: &Plane<u8>, rect: Rect) -> Option<Rect> {
    let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
    for y in rect.y..rect.y + rect.height {
        let row = &plane.row(y)[rect.x..rect.x + rect.width];
        let Some(first) = row.iter().position(|&v| v != 0) else { continue };
        let last = row.iter().rposition(|&v| v != 0).unwrap_or(first);
        (left, right) = (left.min(rect.x + first), right.max(rect.x + last + 1));
        (top, bottom) = (top.min(y), y + 1);
    }
    (left < right).then(|| Rect { x: left, y: top, width: right - left, height: bottom - top })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_enclose_what_is_not_0() {
        let plane = Plane::from_fn(30, 20, |x, y| u8::from((x, y) == (4, 6) || (x, y) == (11, 9)));
        let all = Rect::whole(30, 20);
        assert_eq!(bounds(&plane, all), Some(Rect { x: 4, y: 6, width: 8, height: 4 }));
        assert_eq!(bounds(&plane, Rect { x: 5, width: 25, ..all }), Some(Rect { x: 11, y: 9, width: 1, height: 1 }));
        assert_eq!(bounds(&plane, Rect { x: 12, y: 0, width: 18, height: 20 }), None);
    }
}
