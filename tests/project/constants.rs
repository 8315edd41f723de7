//! The floating-point constants of the default fusion and of the height map, and what docs/method/CONSTANTS.md says of
//! them.

use std::{collections::BTreeMap, fs};

use crate::source::{project, rust_files};

/// The value of each constant, as it is written, by folder or file and name. `scripts/ablation.py` names them so too.
fn constants() -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let folder = project().join("science/src/fusion");
    for path in rust_files(&["science/src/fusion/halo_corrected", "science/src/fusion/height"]) {
        let file = path.strip_prefix(&folder).expect("below that folder").with_extension("");
        let file = file.to_str().expect("a name in UTF-8").trim_end_matches("/mod");
        if file.ends_with("/tests") {
            continue;
        }
        let text = fs::read_to_string(&path).expect("source is UTF-8");
        for line in text.lines().map(str::trim) {
            let line = line.trim_start_matches("pub").trim_start_matches("(super)").trim_start();
            let Some((name, rest)) = line.strip_prefix("const ").and_then(|rest| rest.split_once(": f")) else {
                continue;
            };
            if let Some((_, value)) = rest.trim_end_matches(';').split_once(" = ").filter(|(bits, _)| bits.len() == 2) {
                found.insert(format!("{file}::{name}"), value.to_owned());
            }
        }
    }
    found
}

#[test]
fn each_constant_of_the_fusion_says_why_it_has_its_value() {
    let page = fs::read_to_string(project().join("docs/method/CONSTANTS.md")).expect("the page");
    let rows: BTreeMap<String, String> = page
        .lines()
        .filter_map(|line| line.strip_prefix("| `"))
        .map(|row| row.split('|').map(str::trim).collect::<Vec<_>>())
        .map(|cells| (cells[0].trim_end_matches('`').to_owned(), cells[1].to_owned()))
        .collect();
    let constants = constants();
    assert!(constants.len() > 50, "{constants:?}");
    for (name, value) in &constants {
        assert_eq!(rows.get(name), Some(value), "the row of {name} in docs/method/CONSTANTS.md; scripts/ablation.py");
    }
    let gone: Vec<&String> = rows.keys().filter(|name| !constants.contains_key(*name)).collect();
    assert!(gone.is_empty(), "these rows of docs/method/CONSTANTS.md name no constant: {gone:?}");
}
