//! Which slices are missing, read from the numbers in the names.

use super::{
    member_names,
    natural_order::{self, Piece},
};

/// Most gaps that are named.
const MOST: usize = 3;

/// Where the numbering of `names`, which are in order, skips a step: `after slice_05.jpg comes slice_07.jpg`. `None`
/// when the names do not differ in one number alone, when that number has no usual step, or when it is never skipped.
pub fn skipped(names: &[String]) -> Option<String> {
    let cut: Vec<Vec<Piece<'_>>> = names.iter().map(|name| natural_order::pieces(member_names::stem(name))).collect();
    let first = cut.first()?;
    if cut.iter().any(|other| other.len() != first.len()) {
        return None;
    }
    let mut varying = (0..first.len()).filter(|&i| cut.iter().any(|other| other[i] != first[i]));
    let counter = varying.next()?;
    if varying.next().is_some() {
        return None;
    }
    let numbers: Vec<i64> = cut.iter().map(|pieces| number(&pieces[counter])).collect::<Option<_>>()?;
    let steps: Vec<i64> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let usual = usual(&steps)?;
    let is_gap = |step: i64| step.signum() == usual.signum() && step.abs() > usual.abs();
    let gaps: Vec<String> = (0..steps.len())
        .filter(|&i| is_gap(steps[i]))
        .map(|i| format!("after {} comes {}", member_names::base(&names[i]), member_names::base(&names[i + 1])))
        .collect();
    let more = gaps.len().saturating_sub(MOST);
    match gaps.len() {
        0 => None,
        _ if more > 0 => Some(format!("{}, and {more} more gaps", gaps[..MOST].join(", "))),
        _ => Some(gaps.join(", ")),
    }
}

/// Names of slices of one light that the other light lacks; empty when the two are named in different ways.
pub(super) fn unmatched<'a>(these: &'a [String], others: &[String]) -> Vec<&'a str> {
    let key = |name: &str| member_names::base(member_names::stem(name)).to_lowercase();
    let others: std::collections::HashSet<String> = others.iter().map(|name| key(name)).collect();
    let lacking: Vec<&str> = these.iter().filter(|name| !others.contains(&key(name))).map(String::as_str).collect();
    // more than half unmatched: not the same names
    if lacking.len() * 2 > these.len() { Vec::new() } else { lacking }
}

fn number(piece: &Piece<'_>) -> Option<i64> {
    match piece {
        Piece::Number { negative, digits } => {
            digits.parse::<i64>().ok().map(|value| if *negative { -value } else { value })
        }
        Piece::Text(_) => None,
    }
}

/// The step that more than half of all have.
fn usual(steps: &[i64]) -> Option<i64> {
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
        let told = of(&["front/s_03.jpg", "front/s_04.jpg", "front/s_05.jpg", "front/s_07.jpg"]);
        assert_eq!(told.as_deref(), Some("after s_05.jpg comes s_07.jpg"));
        let told = of(&["_step_-00800_.jpg", "_step_-00400_.jpg", "_step_00000_.jpg", "_step_01200_.jpg"]);
        assert_eq!(told.as_deref(), Some("after _step_00000_.jpg comes _step_01200_.jpg"));
        let told = of(&["s9.jpg", "s8.jpg", "s6.jpg", "s5.jpg"]);
        assert_eq!(told.as_deref(), Some("after s8.jpg comes s6.jpg"));
    }

    #[test]
    fn where_numbers_tell_nothing_nothing_is_said() {
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
