//! Slices of another view or object: each is named with its slice, wherever it is in the stack.

use super::*;
use crate::imaging::{Raster, Samples};

/// The stack with `slices` replaced by those that `other` has at these places.
fn with(clean: &Stack, other: &Stack, slices: &[usize]) -> Stack {
    let mut stack = clean.clone();
    slices.iter().for_each(|&slice| stack.slices[slice] = other.slices[slice].clone());
    stack
}

/// The stack with each picture turned by half a turn: another view of the same object.
fn turned(mut stack: Stack) -> Stack {
    let turn = |slice: &Raster| {
        let Samples::Eight(samples) = &slice.samples else { panic!("8 bits expected") };
        let turned = samples.as_chunks::<3>().0.iter().rev().flatten().copied();
        Raster::eight(slice.width, slice.height, 3, turned.collect())
    };
    stack.slices = stack.slices.iter().map(turn).collect();
    stack
}

/// Scenes that fill the picture: objects on plain ground may be taken for each other.
const FILLED: [&str; 3] = ["flower", "plates", "weave"];

fn other_views(cases: Cases) {
    let mut wrong = Vec::new();
    for (n, ((name, scene), clean)) in SCENES.into_iter().zip(&*OF_SEED_4).enumerate() {
        let view = turned(clean.clone());
        let places: [&[usize]; 4] = [&[0], &[5], &[10], &[6, 7]];
        let places = places.into_iter().enumerate().filter(|(place, _)| cases.take(place % 2 == n % 2));
        let mut replaced: Vec<(&str, &Stack, &[usize])> = places.map(|(_, place)| ("view", &view, place)).collect();
        let has_object = FILLED.contains(&name) && cases.take(name == FILLED[0]);
        let object = has_object.then(|| Stack::of(&Rig { seed: 4, ..Rig::sized(480, 360, 11) }, &scene(9)));
        replaced.extend(object.iter().map(|object| ("object", object, &[2][..])));
        for (kind, other, slices) in replaced {
            let found = with(clean, other, slices).findings(true).into_iter();
            let found: Vec<_> = found.filter(|finding| finding.severity == Severity::Warning).collect();
            let codes: Vec<_> = found.iter().map(|f| (f.code.as_str().to_owned(), f.slices.clone())).collect();
            println!("{name}, another {kind} at {slices:?}: {codes:?}");
            let expected: Vec<u32> = slices.iter().map(|&slice| slice as u32).collect();
            if !codes.contains(&("foreign_slice".to_owned(), expected)) {
                wrong.push(format!("{name}, another {kind} at {slices:?}: {codes:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_slice_of_another_view_is_named() {
    other_views(Cases::Few);
}

#[test]
#[ignore = "more cases of a test"]
fn more_slices_of_another_view_are_named() {
    other_views(Cases::Others);
}
