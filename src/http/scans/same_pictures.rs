//! Views that show the same pictures: a folder was renamed and sent again, or a zip went out under two labels.
//!
//! Two stacks have the same pictures if their zips have the same SHA-256, or if every slice has exactly the same
//! sharpness. The second also finds pictures that were packed anew; two exposures differ in their noise.

use std::{
    collections::{BTreeSet, HashMap},
    hash::{DefaultHasher, Hash, Hasher},
};

use pinstack_science::types::metrics::SliceMetrics;

/// A hash of the sharpness of the slices; none unless all are known and one is above 0.
pub fn of_slices(slices: &[SliceMetrics]) -> Option<String> {
    let sharpness: Option<Vec<u64>> = slices.iter().map(|slice| slice.sharpness.map(f64::to_bits)).collect();
    let sharpness = sharpness.filter(|all| all.iter().any(|&bits| bits != 0))?;
    let mut hash = DefaultHasher::new();
    sharpness.hash(&mut hash);
    Some(format!("{:016x}", hash.finish()))
}

/// The names of views with the same pictures, group by group. Each view comes with its name, and with what it has in
/// common with others of the same pictures.
pub fn groups<'a>(views: impl Iterator<Item = (&'a str, &'a [String])>) -> Vec<Vec<String>> {
    let mut of_pictures: HashMap<&str, Vec<&str>> = HashMap::new();
    for (name, all) in views {
        for pictures in all {
            of_pictures.entry(pictures).or_default().push(name);
        }
    }
    // copies of a zip agree in both measures
    let groups: BTreeSet<Vec<&str>> = of_pictures.into_values().filter(|views| views.len() > 1).collect();
    groups.into_iter().map(|group| group.into_iter().map(str::to_owned).collect()).collect()
}
