//! Links of the documents: each file exists, and each anchor is a heading of it.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use super::{pages, project};

/// README.md, CHANGELOG.md, SECURITY.md, the pages of docs and of its folders, and the README of the Python client.
fn documents() -> Vec<PathBuf> {
    let mut found = pages();
    found.extend(
        ["README.md", "CHANGELOG.md", "SECURITY.md", "clients/python/README.md"].map(|name| project().join(name)),
    );
    found
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The lines of a document that are no code.
fn prose(markdown: &str) -> impl Iterator<Item = &str> {
    let mut in_code = false;
    markdown.lines().filter(move |line| {
        let is_fence = line.trim_start().starts_with("```");
        in_code ^= is_fence;
        !in_code && !is_fence
    })
}

/// The anchors of the headings, as viewers of repositories make them, and those of headings that moved to another page.
fn anchors(markdown: &str) -> BTreeSet<String> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let headings = prose(markdown).filter_map(|line| line.strip_prefix('#')?.trim_start_matches('#').strip_prefix(' '));
    let left =
        prose(markdown).flat_map(|line| line.split("<a id=\"").skip(1)).filter_map(|rest| rest.split('"').next());
    headings
        .map(|heading| {
            let text = heading.to_lowercase().replace(' ', "-");
            let anchor: String = text.chars().filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect();
            let count = counts.entry(anchor.clone()).or_default();
            *count += 1;
            if *count == 1 { anchor } else { format!("{anchor}-{}", *count - 1) }
        })
        .chain(left.map(str::to_owned))
        .collect()
}

/// The targets of the links and pictures.
fn targets(markdown: &str) -> Vec<String> {
    let text: String = prose(markdown).map(|line| format!("{line}\n")).collect();
    let found = text.match_indices("](").map(|(at, _)| text[at + 2..].chars().take_while(|c| *c != ')').collect());
    found.collect()
}

#[test]
fn every_link_leads_to_a_file_of_the_project_and_a_heading_in_it() {
    let mut wrong = Vec::new();
    let mut checked = 0;
    for document in documents() {
        let text = read(&document);
        for target in targets(&text).into_iter().filter(|target| !target.contains("://")) {
            checked += 1;
            let (file, anchor) = target.split_once('#').unwrap_or((&target, ""));
            let path = if file.is_empty() { document.clone() } else { document.with_file_name("").join(file) };
            let is_there = path.exists() && (anchor.is_empty() || anchors(&read(&path)).contains(anchor));
            if !is_there {
                wrong.push(format!("{} links to {target}", document.display()));
            }
        }
    }
    assert!(checked > 150, "only {checked} links were found");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_readme_and_the_pages_of_operations_are_short() {
    let operations = read(&project().join("docs/OPERATIONS.md"));
    let files = targets(&operations).into_iter().map(|target| target.split('#').next().unwrap_or_default().to_owned());
    let listed: BTreeSet<String> = files.collect();
    assert!(listed.len() > 10, "{listed:?}");
    let mut long = Vec::new();
    for (path, limit) in listed.iter().map(|file| (format!("docs/{file}"), 350)).chain([("README.md".to_owned(), 250)])
    {
        let lines = read(&project().join(&path)).lines().count();
        if lines >= limit {
            long.push(format!("{path} has {lines} lines"));
        }
    }
    assert!(long.is_empty(), "split them by what their readers want to do: {long:#?}");
}

#[test]
fn every_page_and_picture_of_the_docs_is_linked() {
    let mut linked = BTreeSet::new();
    for document in documents() {
        for target in targets(&read(&document)) {
            let file = target.split('#').next().unwrap_or_default();
            linked.extend(document.with_file_name("").join(file).canonicalize());
        }
    }
    let mut unlinked = Vec::new();
    let mut folders = vec![project().join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if !linked.contains(&path.canonicalize().expect("a path")) {
                unlinked.push(path);
            }
        }
    }
    assert!(unlinked.is_empty(), "no document links to {unlinked:#?}");
}

#[test]
fn the_pictures_of_troubleshooting_are_small() {
    let folder = project().join("docs/troubleshooting");
    let files = fs::read_dir(folder).expect("pictures").map(|entry| entry.expect("a picture"));
    let sizes: Vec<u64> = files.map(|file| file.metadata().expect("its size").len()).collect();
    assert!(sizes.len() >= 12, "{} pictures", sizes.len());
    assert!(sizes.iter().all(|&size| size < 40_000) && sizes.iter().sum::<u64>() < 700_000, "{sizes:?}");
}

#[test]
fn anchors_are_those_of_a_repository() {
    let found =
        anchors("# A\n## Run `it`, now\n```sh\n# no heading\n```\n### a_b\n## Run it now\n<a id=\"old\"></a>Old\n");
    assert_eq!(found, ["a", "a_b", "old", "run-it-now", "run-it-now-1"].map(str::to_owned).into());
}
