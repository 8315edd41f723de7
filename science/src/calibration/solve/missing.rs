//! Errors for slices whose dots cannot be measured.

use crate::calibration::lost::{self, Loss};
use crate::calibration::names::first_names;
use crate::imaging::Slices;
use crate::types::error::ErrorLocation;
use crate::types::{Error, ErrorKind};

pub(super) fn reference_without_grid(slices: &dyn Slices, reference: usize, loss: Loss) -> Error {
    let name = slices.name(reference);
    let detail = match loss {
        Loss::Blurred => format!(
            "the reference slice {name} (slice {reference}) is too blurred to measure its dots: set reference_index to \
             a sharper slice"
        ),
        other => format!(
            "the reference slice {name} (slice {reference}) is {}: {}, or set reference_index to another slice",
            other.phrase(),
            other.advice()
        ),
    };
    Error::new(ErrorKind::TargetNotFound, detail).in_file(name, Some(reference as u32))
}

/// The slices to omit at the ends of the stack, as a phrase; `None` when slices in between are missing or too few would
/// remain.
fn ends(count: usize, lost: &[usize]) -> Option<String> {
    let first = (0..count).take_while(|i| lost.contains(i)).count();
    let last = (0..count).rev().take_while(|i| lost.contains(i)).count();
    if first + last != lost.len() || count < first + last + 2 {
        return None;
    }
    let some = |n: usize, end: &str| match n {
        0 => None,
        1 => Some(format!("the {end} slice")),
        n => Some(format!("the {end} {n} slices")),
    };
    Some([some(first, "first"), some(last, "last")].into_iter().flatten().collect::<Vec<_>>().join(" and "))
}

/// The error for slices that can neither be measured nor predicted. `loss` says why each was not measured.
pub(super) fn unmeasured_slices(
    slices: &dyn Slices,
    indices: &[usize],
    loss: impl Fn(usize) -> Loss,
    why: &str,
) -> Error {
    let causes: Vec<Loss> = lost::ALL.into_iter().filter(|cause| indices.iter().any(|&i| loss(i) == *cause)).collect();
    let named: Vec<String> = causes
        .iter()
        .filter(|cause| **cause != Loss::Blurred)
        .map(|cause| {
            let some: Vec<usize> = indices.iter().copied().filter(|&i| loss(i) == *cause).collect();
            let verb = if some.len() == 1 { "is" } else { "are" };
            format!("{} {verb} {}", first_names(slices, &some, 8), cause.phrase())
        })
        .collect();
    let named = if named.is_empty() { String::new() } else { format!("; {}", named.join("; ")) };
    let advice: Vec<&str> = causes.iter().map(|cause| cause.advice()).collect();
    let detail = format!(
        "the dots could not be measured in {}{why}{named}: {}{}",
        first_names(slices, indices, 8),
        ends(slices.count(), indices)
            .map_or_else(String::new, |ends| format!("omit {ends}, from the target and from every stack, or ")),
        advice.join("; "),
    );
    let mut error = Error::new(ErrorKind::TargetNotFound, detail);
    for &index in indices {
        error = error.at(ErrorLocation {
            detail: "too few dots of this slice agree with the reference slice".into(),
            pointer: None,
            file: Some(slices.name(index).to_owned()),
            slice: Some(index as u32),
        });
    }
    error
}

#[cfg(test)]
mod tests {
    use super::ends;

    #[test]
    fn slices_at_the_ends_can_be_omitted_and_those_between_cannot() {
        assert_eq!(ends(9, &[0, 1, 8]).as_deref(), Some("the first 2 slices and the last slice"));
        assert_eq!(ends(9, &[7, 8]).as_deref(), Some("the last 2 slices"));
        assert_eq!(ends(9, &[0, 4]), None);
        assert_eq!(ends(3, &[0, 2]), None);
    }
}
