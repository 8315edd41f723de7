//! Counters of cameras that start again within a stack: 9998, 9999, 0001, 0002.

use super::{
    natural_order::{self, Piece},
    notation::Notation,
};

/// Digits of the file number in the names of cameras (DCF: CIPA DC-009). Four free characters precede it, which may be
/// digits: `P1009999`, `DSC09999`.
const DCF_DIGITS: usize = 4;

/// Digits of a counter.
const DIGITS: std::ops::RangeInclusive<usize> = 2..=15;

/// A counter that started again.
pub(super) struct Restart {
    /// The index of the first slice.
    pub start: usize,
    /// The names alone tell it. Otherwise the times of capture must confirm it.
    pub is_certain: bool,
}

/// Whether the camera's counter started again in the stack with these names, which are in natural order.
///
/// The names differ in one number only. With `R` values of the digits that differ (10,000 for four digits) and `n`
/// slices, the numbers are a low run and a high run with the largest gap between them, at least `R / 10`. It is certain
/// when the gap is at least `R / 2`, the low run begins within `4 n` (at most `R / 20`) of 0, the high run ends within
/// `4 n` of the largest value, and no other step is larger than that: pictures in between may belong to another light.
/// No other numbering leaves such a gap.
pub(super) fn restart(names: &[&str], notation: &Notation) -> Option<Restart> {
    let pieces = natural_order::varying_pieces(names, notation)?;
    let digits = |piece| match piece {
        &Piece::Number { negative: false, whole, fraction: "" } => Some(whole),
        _ => None,
    };
    let numbers: Vec<&str> = pieces.iter().map(digits).collect::<Option<_>>()?;
    let (first, last) = (*numbers.first()?, *numbers.last()?);
    let is_padded = numbers.iter().all(|number| number.len() == last.len());
    let common = first.bytes().zip(last.bytes()).take_while(|(a, b)| a == b).count();
    let fixed = if is_padded { common } else { 0 };
    let width = last.len().checked_sub(fixed).filter(|width| DIGITS.contains(width))?;
    let values: Vec<u64> = numbers.iter().map(|number| number.get(fixed..)?.parse().ok()).collect::<Option<_>>()?;
    let range = 10u64.pow(width as u32);
    let steps: Vec<u64> = values.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).collect();
    let gap = (0..steps.len()).max_by_key(|&at| steps[at]).filter(|&at| steps[at] >= range / 10)?;
    let near = (4 * values.len() as u64).min(range / 20);
    // fewer or more digits behind fixed ones are no counter of a camera, unless they reach its very ends
    let ends = if fixed > 0 && width != DCF_DIGITS { 1 } else { near };
    let is_certain = steps[gap] >= range / 2
        && (fixed == 0 || width > 2)
        && *values.first()? <= ends
        && *values.last()? >= range - ends
        && steps.iter().enumerate().all(|(at, &step)| at == gap || step <= near);
    Some(Restart { start: gap + 1, is_certain })
}
