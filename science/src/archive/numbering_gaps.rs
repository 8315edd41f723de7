//! Missing slices, inferred from the numbers in the file names.

use super::{
    member_names,
    messages::one_or_more,
    natural_order::{self, Piece},
    slice_order,
};
use crate::types::text::folded;

/// Maximum number of gaps that are listed.
const MOST: usize = 3;

/// The gaps in the numbering of ordered `names`, as a clause: `after slice_05.jpg comes slice_07.jpg`. `None` when
/// there are none, when the names differ in more than one number, or when that number has no step that over half of all
/// share.
pub fn skipped(names: &[String]) -> Option<String> {
    let shown: Vec<&str> = names.iter().map(String::as_str).collect();
    let counters = natural_order::varying_pieces(&shown, &slice_order::notation(&shown))?;
    let numbers: Vec<i128> = counters.iter().map(number).collect::<Option<_>>()?;
    let steps: Vec<i128> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let usual = usual(&steps)?;
    let is_gap = |step: i128| step.signum() == usual.signum() && step.unsigned_abs() > usual.unsigned_abs();
    let gaps: Vec<String> = (0..steps.len())
        .filter(|&i| is_gap(steps[i]))
        .map(|i| format!("after {} comes {}", member_names::base(&names[i]), member_names::base(&names[i + 1])))
        .collect();
    let more = gaps.len().saturating_sub(MOST);
    match gaps.len() {
        0 => None,
        _ if more > 0 => {
            let word = one_or_more(more, "gap", "gaps");
            Some(format!("{}, and {more} more {word}", gaps[..MOST].join(", ")))
        }
        _ => Some(gaps.join(", ")),
    }
}

/// Slices of one light without a counterpart of the same name in the other. Empty when the lights use different names.
pub(super) fn unmatched<'a>(these: &'a [String], others: &[String]) -> Vec<&'a str> {
    let key = |name: &str| folded(member_names::base(member_names::stem(name)));
    let others: std::collections::HashSet<String> = others.iter().map(|name| key(name)).collect();
    let lacking: Vec<&str> = these.iter().filter(|name| !others.contains(&key(name))).map(String::as_str).collect();
    // more than half unmatched: different naming schemes
    if lacking.len() * 2 > these.len() { Vec::new() } else { lacking }
}

/// Digits after the decimal point that are compared.
const DECIMALS: usize = 12;

/// The number in units of the last decimal; `None` for text, and for numbers that far apart that they number nothing.
fn number(piece: &Piece<'_>) -> Option<i128> {
    match piece {
        Piece::Number { negative, whole, fraction } if whole.len() < 20 && fraction.len() <= DECIMALS => {
            let value: i128 = format!("{whole}{fraction:0<DECIMALS$}").parse().ok()?;
            Some(if *negative { -value } else { value })
        }
        _ => None,
    }
}

/// The step that over half of all share.
fn usual(steps: &[i128]) -> Option<i128> {
    let mut sorted = steps.to_vec();
    sorted.sort_unstable();
    let middle = *sorted.get(sorted.len() / 2)?;
    let count = steps.iter().filter(|&&step| step == middle).count();
    (middle != 0 && count * 2 > steps.len()).then_some(middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(names: &[&str]) -> Option<String> {
        skipped(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn a_gap_in_the_numbering_is_named() {
        let found = of(&["front/s_03.jpg", "front/s_04.jpg", "front/s_05.jpg", "front/s_07.jpg"]);
        assert_eq!(found.as_deref(), Some("after s_05.jpg comes s_07.jpg"));
        let found = of(&["_step_-00800_.jpg", "_step_-00400_.jpg", "_step_00000_.jpg", "_step_01200_.jpg"]);
        assert_eq!(found.as_deref(), Some("after _step_00000_.jpg comes _step_01200_.jpg"));
        let found = of(&["s9.jpg", "s8.jpg", "s6.jpg", "s5.jpg"]);
        assert_eq!(found.as_deref(), Some("after s8.jpg comes s6.jpg"));
    }

    #[test]
    fn gaps_beyond_the_first_three_are_counted() {
        let numbers: Vec<i32> = (0..40).filter(|n| ![3, 9, 15, 21].contains(n)).collect();
        let names = |numbers: &[i32]| numbers.iter().map(|n| format!("s{n}.jpg")).collect::<Vec<_>>();
        let found = skipped(&names(&numbers)).unwrap();
        assert!(found.ends_with("after s14.jpg comes s16.jpg, and 1 more gap"), "{found}");
        let fewer: Vec<i32> = numbers.into_iter().filter(|&n| n != 30).collect();
        assert!(skipped(&names(&fewer)).unwrap().ends_with(", and 2 more gaps"));
    }

    #[test]
    fn numbers_near_the_ends_of_their_range_do_not_overflow() {
        let (low, high) = ("s_-9000000000000000000.jpg", "s_9000000000000000000.jpg");
        assert_eq!(of(&[low, high]), None);
        // a step of -2^63 has no absolute value
        let down = ["s_9.jpg", "s_8.jpg", "s_7.jpg", "s_6.jpg", "s_-9223372036854775802.jpg"];
        assert_eq!(of(&down).as_deref(), Some("after s_6.jpg comes s_-9223372036854775802.jpg"));
    }

    #[test]
    fn names_without_a_regular_numbering_have_no_gaps() {
        for names in [
            &["a.jpg", "b.jpg"][..],
            &["s1.jpg", "s2.jpg", "s3.jpg"],
            &["s1.jpg", "s5.jpg", "s6.jpg", "s9.jpg"],
            &["s9998.jpg", "s9999.jpg", "s0001.jpg", "s0002.jpg"],
            &["s1_1.jpg", "s2_5.jpg", "s3_7.jpg"],
            &["s1.jpg"],
            &[],
        ] {
            assert_eq!(of(names), None, "{names:?}");
        }
    }
}
