//! Displacements: neighbouring pairs of slices that are shifted against each other, grouped by their cause.
//!
//! A knock, and the vibration after it, moves several neighbouring slices. Pairs that are off belong together if no
//! pair between them is known not to be displaced.
//!
//! A shift is what the common similarity of all steps does not explain. In a stack of three slices the common shift is
//! the mean of only two steps, and a displaced slice gives two opposite shifts whichever slice it is. So none is named.

/// What is known of a pair of neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Pair {
    /// Not measured.
    Unknown,
    /// Not certainly displaced, or one of the slices is duplicated.
    NotDisplaced,
    /// The second slice is shifted by this against the first one, px.
    Off((f64, f64)),
}

/// Slices that one cause displaced.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Displacement {
    /// These slices are off; the others agree. The shift is that of the slice that is off most, px.
    Slices { slices: Vec<u32>, shift: (f64, f64) },
    /// One of the three slices of the stack is off, by about this, px: they do not tell which.
    OneOfThree { shift: (f64, f64) },
    /// The image moves between the slices `from` and `to`, by `shift` in all, and does not come back.
    Jump { from: u32, to: u32, shift: (f64, f64) },
}

/// Slices came back when their shifts cancel to within this share of the largest displacement.
const BACK: f64 = 0.5;

/// The displacements of a stack, by its `pairs` of neighbours.
pub(super) fn displacements(pairs: &[Pair]) -> Vec<Displacement> {
    let (mut found, mut run) = (Vec::new(), Vec::new());
    for (index, pair) in pairs.iter().enumerate() {
        match pair {
            Pair::Off(shift) => run.push((index, *shift)),
            Pair::Unknown => {}
            Pair::NotDisplaced => found.extend(of_run(&std::mem::take(&mut run), pairs.len())),
        }
    }
    found.extend(of_run(&run, pairs.len()));
    found
}

/// The displacement of one run of pairs that are off: the index of each pair and its shift.
fn of_run(run: &[(usize, (f64, f64))], pairs: usize) -> Option<Displacement> {
    let (&(first, shift), &(last, _)) = (run.first()?, run.last()?);
    if run.len() == 1 && (first == 0 || first + 1 == pairs) {
        // with one pair only, the second slice is named
        return Some(match (pairs, first) {
            (2, _) => Displacement::OneOfThree { shift },
            // the shift is that of the second slice against the first one, which is off by the opposite
            (3.., 0) => Displacement::Slices { slices: vec![0], shift: (-shift.0, -shift.1) },
            _ => Displacement::Slices { slices: vec![first as u32 + 1], shift },
        });
    }
    // displacement of each slice of the run from the slices before it
    let mut total = (0.0, 0.0);
    let mut places: Vec<(u32, (f64, f64))> = Vec::new();
    let mut steps = run.iter().peekable();
    for pair in first..=last {
        if let Some((_, (x, y))) = steps.next_if(|(index, _)| *index == pair) {
            total = (total.0 + x, total.1 + y);
        }
        places.push((pair as u32 + 1, total));
    }
    let length = |(x, y): (f64, f64)| x.hypot(y);
    let most = places.iter().map(|&(_, place)| place).max_by(|a, b| length(*a).total_cmp(&length(*b)))?;
    if length(total) >= BACK * length(most) {
        return Some(Displacement::Jump { from: first as u32, to: last as u32 + 1, shift: total });
    }
    if pairs == 2 {
        return Some(Displacement::OneOfThree { shift: most });
    }
    let slices = places.iter().filter(|(_, place)| length(*place) >= BACK * length(most)).map(|(slice, _)| *slice);
    Some(Displacement::Slices { slices: slices.collect(), shift: most })
}

#[cfg(test)]
mod tests {
    use super::{Displacement::*, Pair::*, *};

    const AWAY: (f64, f64) = (4.0, -3.0);
    const BACK_AGAIN: (f64, f64) = (-4.1, 2.9);

    #[test]
    fn a_knock_that_takes_several_slices_is_one_jump() {
        let pairs = [
            NotDisplaced,
            NotDisplaced,
            Off(AWAY),
            Off((1.0, -1.0)),
            Unknown,
            Off((-0.5, 1.0)),
            Off((1.0, 0.0)),
            NotDisplaced,
        ];
        assert_eq!(displacements(&pairs), [Jump { from: 2, to: 7, shift: (5.5, -3.0) }]);
        let pairs = [Off(AWAY), Off(AWAY), NotDisplaced];
        assert_eq!(displacements(&pairs), [Jump { from: 0, to: 2, shift: (8.0, -6.0) }]);
    }

    #[test]
    fn one_step_is_a_jump_between_two_slices() {
        let jump = || [Jump { from: 1, to: 2, shift: AWAY }];
        assert_eq!(displacements(&[NotDisplaced, Off(AWAY), NotDisplaced]), jump());
        assert_eq!(displacements(&[Unknown, Off(AWAY), Unknown]), jump());
    }

    #[test]
    fn slices_that_come_back_are_named_alone() {
        let of = |slices: &[u32]| [Slices { slices: slices.to_vec(), shift: AWAY }];
        assert_eq!(displacements(&[NotDisplaced, Off(AWAY), Off(BACK_AGAIN), NotDisplaced]), of(&[2]));
        // the pair between them is not measured: both may be off
        assert_eq!(displacements(&[NotDisplaced, Off(AWAY), Unknown, Off(BACK_AGAIN)]), of(&[2, 3]));
        assert_eq!(displacements(&[NotDisplaced, NotDisplaced, Off(AWAY)]), of(&[3]));
        assert_eq!(displacements(&[Off(AWAY)]), of(&[1]));
    }

    #[test]
    fn the_shift_of_the_first_slice_is_against_those_after_it() {
        let first = Slices { slices: vec![0], shift: (-AWAY.0, -AWAY.1) };
        assert_eq!(displacements(&[Off(AWAY), NotDisplaced, NotDisplaced]), [first]);
    }

    #[test]
    fn of_three_slices_none_is_named() {
        let one = [OneOfThree { shift: AWAY }];
        assert_eq!(displacements(&[Off(AWAY), Off(BACK_AGAIN)]), one);
        assert_eq!(displacements(&[Off(AWAY), NotDisplaced]), one);
        assert_eq!(displacements(&[Unknown, Off(AWAY)]), one);
        assert_eq!(displacements(&[Off(AWAY), Off(AWAY)]), [Jump { from: 0, to: 2, shift: (8.0, -6.0) }]);
    }

    #[test]
    fn two_knocks_with_slices_in_place_between_them_are_two_jumps() {
        let pairs = [NotDisplaced, Off(AWAY), NotDisplaced, Off(AWAY), NotDisplaced];
        let jump = |from| Jump { from, to: from + 1, shift: AWAY };
        assert_eq!(displacements(&pairs), [jump(1), jump(3)]);
        assert_eq!(displacements(&[NotDisplaced, Unknown]), []);
    }
}
