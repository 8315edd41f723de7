//! No two source files name each other's items, directly or by way of others: a file can be read with what is below it.

use crate::source::{Graph, SOURCES};

#[test]
fn no_files_name_each_other_in_a_circle() {
    for folder in SOURCES {
        let graph = Graph::of(folder);
        let circles: Vec<String> = graph.circles().iter().map(|circle| graph.describe(circle)).collect();
        assert!(circles.is_empty(), "move what they share into a file below both:\n{}", circles.join("\n"));
    }
}
