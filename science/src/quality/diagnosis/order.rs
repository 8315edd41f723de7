//! Findings on identity and order: `duplicate_slice`, `foreign_slice`, `slices_reversed`, `slices_out_of_order`.

use super::{Diagnoser, geometry, warning};
use crate::types::{WarningCode, metrics::Finding};

impl Diagnoser<'_> {
    pub(super) fn duplicates(&self) -> Vec<Finding> {
        let duplicates = self.quality.slices.iter().filter_map(|slice| Some((slice.index, slice.duplicate_of?)));
        let findings = duplicates.map(|(slice, original)| {
            let detail = format!(
                "slice {} is the same image as slice {}: one file was uploaded twice, or copied over another; replace it with \
                 the right file and send the stack again",
                self.name(slice),
                self.name(original)
            );
            warning(WarningCode::DuplicateSlice, vec![original, slice], detail)
        });
        findings.collect()
    }

    /// Slices of another view or another object.
    pub(super) fn foreign(&self) -> Option<Finding> {
        let foreign = self.evidence.foreign;
        let (show, their) = if foreign.len() == 1 { ("shows", "its") } else { ("show", "their") };
        (!foreign.is_empty()).then(|| {
            let detail = format!(
                "{} {show} something else than the slices around, which show the same: another view or another object \
                 got into the stack, or the object moved or was not lit, and {their} detail is in the fused image; put \
                 the right file in the place and send the stack again",
                self.named(foreign)
            );
            warning(WarningCode::ForeignSlice, foreign.to_vec(), detail)
        })
    }

    /// The slices run in the opposite direction to the profile. Findings on focus, alignment and brightness would only
    /// repeat this.
    pub(super) fn reversed(&self) -> Option<Finding> {
        let residual = self.quality.alignment.similarity.as_ref().filter(|_| self.evidence.reversed)?;
        if !geometry::is_misfit(residual) {
            return None;
        }
        let last = self.quality.slices.len().saturating_sub(1) as u32;
        let detail = format!(
            "the stack runs in the opposite direction to the profile: slice {} was taken at the end of the rail where the \
             profile has slice {}, and the corners of the image are {:.1} px off; send the stack again with order=reverse \
             (or without it, if it was sent with order=reverse). No new calibration is needed",
            self.name(0),
            self.name(last),
            residual.corner_drift_px
        );
        Some(warning(WarningCode::SlicesReversed, Vec::new(), detail))
    }

    pub(super) fn out_of_order(&self) -> Option<Finding> {
        let order = self.quality.focus.order.as_ref().filter(|_| !self.shows_other_parts())?;
        let misplaced = out_of_place(order);
        let (are, them, each) = if misplaced.len() == 1 { ("is", "it", "it") } else { ("are", "them", "each") };
        let detail = format!(
            "{} {are} not in the order of focus: around {them} the object becomes sharp, unsharp and sharp again, and \
             {each} was warped by the homography of another position; check how the files are numbered and sorted, or \
             set the order in manifest.json",
            self.named(&misplaced)
        );
        Some(warning(WarningCode::SlicesOutOfOrder, misplaced, detail))
    }
}

/// The fewest slices that explain an order: the slices outside the longest rising (or falling) subsequence, or the
/// slices that are not at their own position, if those are not more.
fn out_of_place(order: &[u32]) -> Vec<u32> {
    let longest = |values: &[i64]| -> Vec<i64> {
        let mut best: Vec<Vec<i64>> = Vec::with_capacity(values.len());
        for (i, &value) in values.iter().enumerate() {
            let before = best[..i].iter().filter(|run| run.last().is_some_and(|&last| last < value));
            let mut run = before.max_by_key(|run| run.len()).cloned().unwrap_or_default();
            run.push(value);
            best.push(run);
        }
        best.into_iter().max_by_key(Vec::len).unwrap_or_default()
    };
    let rising: Vec<i64> = order.iter().map(|&n| i64::from(n)).collect();
    let falling: Vec<i64> = rising.iter().map(|n| -n).collect();
    let (up, down) = (longest(&rising), longest(&falling));
    let kept: Vec<i64> = if up.len() >= down.len() { up } else { down.into_iter().map(|n| -n).collect() };
    let mut outside: Vec<u32> = order.iter().copied().filter(|&n| !kept.contains(&i64::from(n))).collect();
    outside.sort_unstable();
    // two slices that changed places are two, although more may lie outside the longest run
    let displaced: Vec<u32> =
        (0..).zip(order).filter(|(place, slice)| place != *slice).map(|(place, _)| place).collect();
    if displaced.len() <= outside.len() { displaced } else { outside }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slices_out_of_place_are_the_fewest_that_explain_the_order() {
        assert_eq!(out_of_place(&[0, 1, 2, 4, 3, 5]).len(), 1);
        assert_eq!(out_of_place(&[0, 1, 4, 3, 2, 5]), [2, 4]);
        assert_eq!(out_of_place(&[0, 7, 1, 2, 3, 4, 5, 6]), [7]);
        assert_eq!(out_of_place(&[5, 4, 3, 0, 2, 1]), [0]);
        assert_eq!(out_of_place(&[0, 1, 2]), [0; 0]);
    }
}
