//! Lists of slices as phrases.

use crate::imaging::Slices;

/// At most five items.
pub(super) fn listed(indices: &[usize], text: impl Fn(usize) -> String) -> String {
    let mut items: Vec<String> = indices.iter().take(5).map(|&i| text(i)).collect();
    if indices.len() > 5 {
        items.push(format!("{} more", indices.len() - 5));
    }
    items.join(", ")
}

/// The names of the first `most` slices, with `...` when there are more.
pub(super) fn first_names(slices: &dyn Slices, indices: &[usize], most: usize) -> String {
    let more = (indices.len() > most).then_some("...");
    indices.iter().take(most).map(|&i| slices.name(i)).chain(more).collect::<Vec<_>>().join(", ")
}
