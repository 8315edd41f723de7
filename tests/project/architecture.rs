//! The layers of the code, checked by reading the source: `docs/ARCHITECTURE.md` gives the reasons.

use std::fs;

use crate::source::{project, rust_files};

/// The modules of `science/src`, lowest layer first. A module may name only modules of the layers before its own.
const SCIENCE: &[&[&str]] = &[
    &["types"],
    &["imaging", "target"],
    &["synth"],
    &["quality", "segmentation"],
    &["fusion", "calibration"],
    &["archive", "optics"],
    &["photogrammetry", "hull"],
];

/// The modules of `src`, lowest layer first.
const SERVICE: &[&[&str]] = &[
    &["contract", "https"],
    &["telemetry"],
    &["supervision"],
    &["store"],
    &["disk_budget"],
    &["jobs"],
    &["worker"],
    &["settings"],
    &["http"],
    &["cli"],
];

/// The two crates: folder of the sources and layers.
const CRATES: [(&str, &[&[&str]]); 2] = [("science/src", SCIENCE), ("src", SERVICE)];

/// A source file.
struct Source {
    /// Path within the project.
    path: String,
    /// Layers of its crate.
    layers: &'static [&'static [&'static str]],
    /// Top module that it belongs to.
    module: String,
    /// Its text without comments.
    code: String,
}

impl Source {
    fn layer_of(&self, module: &str) -> Option<usize> {
        self.layers.iter().position(|layer| layer.contains(&module))
    }
}

/// Every source file of both crates.
fn files() -> Vec<Source> {
    let mut all = Vec::new();
    for (folder, layers) in CRATES {
        let root = project().join(folder);
        all.extend(rust_files(&[folder]).into_iter().map(|path| {
            let relative = path.strip_prefix(&root).expect("inside the folder");
            let first = relative.components().next().expect("a file").as_os_str().to_string_lossy();
            let text = fs::read_to_string(&path).expect("source is UTF-8");
            let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect();
            Source {
                module: first.trim_end_matches(".rs").to_owned(),
                path: path.strip_prefix(project()).expect("inside the project").display().to_string(),
                layers,
                code: code.join("\n"),
            }
        }));
    }
    all
}

/// Modules named as `crate::name` in a piece of code, grouped imports (`crate::{a, b::c}`) included.
fn named_modules(code: &str) -> Vec<String> {
    let mut names = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        let word = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
        if !rest.starts_with('{') {
            names.push(word(rest));
            continue;
        }
        let (mut depth, mut start) = (0, true);
        for (i, c) in rest.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            if depth == 0 {
                break;
            }
            if depth == 1 && (c == '{' || c == ',') {
                start = true;
            } else if start && !c.is_whitespace() {
                names.push(word(&rest[i..]));
                start = false;
            }
        }
    }
    names
}

#[test]
fn every_module_imports_only_from_the_layers_below_it() {
    let mut wrong = Vec::new();
    for source in files() {
        let Some(own) = source.layer_of(&source.module) else { continue };
        for name in named_modules(&source.code) {
            let Some(other) = source.layer_of(&name) else { continue };
            if other > own || (other == own && name != source.module) {
                wrong.push(format!("{} names crate::{name}, which is not below {}", source.path, source.module));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_module_belongs_to_a_layer() {
    for source in files() {
        let known = ["lib", "main"].contains(&source.module.as_str()) || source.layer_of(&source.module).is_some();
        assert!(known, "{} belongs to no layer: add its module to SCIENCE or SERVICE", source.path);
    }
}

#[test]
fn the_science_depends_on_no_runtime_no_database_and_no_clock() {
    let manifest = fs::read_to_string(project().join("science/Cargo.toml")).expect("the manifest is UTF-8");
    for name in ["tokio", "axum", "sqlx", "tower", "tower-http", "reqwest", "tracing", "jiff", "chrono"] {
        let is_named = manifest.lines().any(|line| line.split(['.', ' ', '=']).next() == Some(name));
        assert!(!is_named, "science/Cargo.toml names {name}; the science has pure functions");
    }
}

#[test]
fn one_module_alone_names_the_zip_crate() {
    // tests make zips of their own
    let is_test = |source: &Source| source.path.contains("tests") || source.path.contains("testkit");
    let names_zip = |source: &Source| {
        source.code.lines().any(|line| line.trim_start().starts_with("use zip") || line.contains(" zip::"))
    };
    let naming: Vec<String> =
        files().into_iter().filter(|source| !is_test(source) && names_zip(source)).map(|source| source.path).collect();
    let is_container = |path: &&String| path.starts_with("science/src/archive/container");
    let others: Vec<&String> = naming.iter().filter(|path| !is_container(path)).collect();
    assert!(others.is_empty(), "the zip crate is named by {others:?}; archive/container reads and writes zips");
}

#[test]
fn grouped_imports_are_understood() {
    let code = "use crate::{a::x, b::{self, c}, d};\nlet y = crate::e::f();";
    assert_eq!(named_modules(code), ["a", "b", "d", "e"]);
}
