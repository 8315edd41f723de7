//! The sources of a crate, read by `syn`: which file names an item that another one defines, and which lines are
//! production code.
//!
//! In: the folder of a crate's sources. Out: arrows between files, and the circles that they form. A bare `use` or
//! `pub use` is no arrow: the name has to occur in the code. Names are followed through re-exports to the file that
//! defines them. What stands behind `#[cfg(test)]` or `#[cfg(doc)]` does not count. Items that a macro defines are not
//! seen.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    fs,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use quote::ToTokens;
use syn::{Item, UseTree, spanned::Spanned};

use crate::syntax::{attributes_of, child_file, is_left_out, name_of, paths_in};

/// The folders of the sources of all crates.
pub const SOURCES: &[&str] = &["science/src", "src"];

/// The folder of the project.
pub fn project() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every Rust file below some folders of the project, tests included, in order.
pub fn rust_files(folders: &[&str]) -> Vec<PathBuf> {
    fn find(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).expect("the folder can be read") {
            let path = entry.expect("the folder can be read").path();
            if path.is_dir() {
                find(&path, found);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    folders.iter().for_each(|folder| find(&project().join(folder), &mut found));
    found.sort();
    found
}

/// Path of a module from the root of its crate.
type ModulePath = Vec<String>;

/// One module: a file, or an inline module of one.
#[derive(Default)]
struct Module {
    /// Index of its file.
    file: usize,
    /// Names of the items that it defines, modules apart.
    items: BTreeSet<String>,
    /// Names that `use` brings: name, path as written.
    uses: HashMap<String, Vec<String>>,
    /// Modules whose names `use path::*` brings.
    globs: Vec<Vec<String>>,
    /// Paths that its code names.
    named: BTreeSet<Vec<String>>,
}

/// The files of one crate and who names whom.
pub struct Graph {
    /// Paths of the files, within the project.
    pub files: Vec<String>,
    /// Per file, the lines that stand behind `#[cfg(test)]`: first and last, counted from 1.
    test_lines: Vec<Vec<(usize, usize)>>,
    /// `(a, b)`: file `a` names an item that file `b` defines, with one such item.
    pub arrows: BTreeMap<(usize, usize), String>,
}

impl Graph {
    /// The graph of a folder of [`SOURCES`], read once for all tests.
    pub fn of(folder: &'static str) -> Arc<Self> {
        static READ: Mutex<BTreeMap<&str, Arc<Graph>>> = Mutex::new(BTreeMap::new());
        let mut read = READ.lock().expect("no test panicked while it read the sources");
        Arc::clone(read.entry(folder).or_insert_with(|| Arc::new(Self::read(folder))))
    }

    /// Reads every file that `lib.rs` in the folder reaches by `mod`, and `main.rs`.
    fn read(folder: &str) -> Self {
        let root = project().join(folder);
        let mut reader = Reader::default();
        reader.file(&root.join("lib.rs"), &root, &[]);
        if root.join("main.rs").exists() {
            reader.file(&root.join("main.rs"), &root, &["main".to_owned()]);
        }
        let mut arrows = BTreeMap::new();
        for (path, module) in &reader.modules {
            for named in &module.named {
                if let Some((file, item)) = reader.resolve(path, named, 0)
                    && file != module.file
                {
                    arrows.entry((module.file, file)).or_insert(item);
                }
            }
        }
        Self { files: reader.files, test_lines: reader.test_lines, arrows }
    }

    /// The sets of files that reach each other, largest first.
    pub fn circles(&self) -> Vec<Vec<usize>> {
        let n = self.files.len();
        let mut reaches = vec![vec![false; n]; n];
        for (start, reached) in reaches.iter_mut().enumerate() {
            let mut open = vec![start];
            while let Some(at) = open.pop() {
                for &(_, to) in self.arrows.range((at, 0)..(at + 1, 0)).map(|(arrow, _)| arrow) {
                    if !std::mem::replace(&mut reached[to], true) {
                        open.push(to);
                    }
                }
            }
        }
        let mut circles: Vec<Vec<usize>> = (0..n)
            .filter(|&a| reaches[a][a])
            .map(|a| (0..n).filter(|&b| reaches[a][b] && reaches[b][a]).collect())
            .collect();
        circles.sort_by_key(|circle: &Vec<usize>| (std::cmp::Reverse(circle.len()), circle.clone()));
        circles.dedup();
        circles
    }

    /// The files with their numbers of production lines.
    pub fn production_lines(&self) -> impl Iterator<Item = (&String, usize)> {
        self.files.iter().enumerate().map(|(index, file)| (file, self.lines(index).len()))
    }

    /// The lines of code of a file, trimmed: without blanks, comments, imports, lines of punctuation alone, and tests.
    pub fn code_lines(&self, index: usize) -> Vec<String> {
        let is_code =
            |line: &&str| !(line.starts_with("//") || line.starts_with("use ")) && line.contains(char::is_alphanumeric);
        let lines = self.lines(index);
        lines.iter().map(|line| line.trim()).filter(is_code).map(str::to_owned).collect()
    }

    /// The production lines of a file.
    fn lines(&self, index: usize) -> Vec<String> {
        let text = fs::read_to_string(project().join(&self.files[index])).expect("source is UTF-8");
        let is_test = |number: usize| self.test_lines[index].iter().any(|&(a, b)| (a..=b).contains(&number));
        text.lines().enumerate().filter(|(i, _)| !is_test(i + 1)).map(|(_, line)| line.to_owned()).collect()
    }

    /// A circle in words: its arrows, one a line.
    pub fn describe(&self, circle: &[usize]) -> String {
        let mut lines = vec![format!("a circle of {} files:", circle.len())];
        for (&(a, b), item) in &self.arrows {
            if circle.contains(&a) && circle.contains(&b) {
                lines.push(format!("  {} -> {} ({item})", self.files[a], self.files[b]));
            }
        }
        lines.join("\n")
    }
}

#[derive(Default)]
struct Reader {
    files: Vec<String>,
    test_lines: Vec<Vec<(usize, usize)>>,
    modules: HashMap<ModulePath, Module>,
}

impl Reader {
    /// Reads a file as the module `path`; its child modules are in `children`.
    fn file(&mut self, file: &Path, children: &Path, path: &[String]) {
        let text = fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let parsed = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let shown = file.strip_prefix(project()).unwrap_or(file).display().to_string();
        let shown = without_parents(&shown);
        let index = self.files.iter().position(|f| *f == shown).unwrap_or_else(|| {
            self.files.push(shown);
            self.test_lines.push(Vec::new());
            self.files.len() - 1
        });
        self.items(&parsed.items, index, file, children, path);
    }

    fn items(&mut self, items: &[Item], file: usize, at: &Path, children: &Path, path: &[String]) {
        let mut module = Module { file, ..Module::default() };
        for item in items {
            let attributes = attributes_of(item);
            if attributes.iter().any(is_left_out) {
                if !matches!(item, Item::Use(_)) {
                    let span = item.span();
                    self.test_lines[file].push((span.start().line, span.end().line));
                }
                continue;
            }
            match item {
                Item::Use(import) => bring(&import.tree, &mut Vec::new(), &mut module),
                Item::Mod(child) => {
                    let name = child.ident.to_string();
                    let mut inner = path.to_vec();
                    inner.push(name.clone());
                    if let Some((_, items)) = &child.content {
                        self.items(items, file, at, &children.join(&name), &inner);
                    } else {
                        let (file, folder) = child_file(attributes, at, children, &name);
                        self.file(&file, &folder, &inner);
                    }
                }
                other => {
                    if let Some(name) = name_of(other) {
                        module.items.insert(name);
                    }
                    paths_in(other.to_token_stream(), &mut module.named);
                }
            }
        }
        self.modules.insert(path.to_vec(), module);
    }

    /// The file that defines what `named` means in the module `at`, and its name.
    fn resolve(&self, at: &[String], named: &[String], depth: usize) -> Option<(usize, String)> {
        if depth > 32 {
            return None;
        }
        let module = self.modules.get(at)?;
        let (first, rest) = named.split_first()?;
        match first.as_str() {
            "crate" => return self.resolve(&[], rest, depth + 1),
            "self" => return self.resolve(at, rest, depth + 1),
            "super" => return self.resolve(&at[..at.len().checked_sub(1)?], rest, depth + 1),
            _ => {}
        }
        // a module and a function may have the same name: `name::` is the module
        let child: ModulePath = at.iter().cloned().chain([first.clone()]).collect();
        let is_module = self.modules.contains_key(&child);
        if is_module && !rest.is_empty() {
            return self.resolve(&child, rest, depth + 1);
        }
        if module.items.contains(first) {
            return Some((module.file, first.clone()));
        }
        if is_module {
            return None;
        }
        if let Some(path) = module.uses.get(first) {
            let whole: Vec<String> = path.iter().chain(rest).cloned().collect();
            // `use name::...` of another crate must not be looked up here again
            return if path.first() == Some(first) && !self.modules.contains_key(&vec![first.clone()]) {
                None
            } else {
                self.resolve(at, &whole, depth + 1)
            };
        }
        module.globs.iter().find_map(|glob| {
            let whole: Vec<String> = glob.iter().chain(named).cloned().collect();
            self.resolve(at, &whole, depth + 1)
        })
    }
}

/// A path without `folder/..`: a file that two modules share by `#[path]` is one file.
fn without_parents(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/') {
        if part == ".." {
            parts.pop();
        } else {
            parts.push(part);
        }
    }
    parts.join("/")
}

/// Notes the names that a `use` brings.
fn bring(tree: &UseTree, prefix: &mut Vec<String>, module: &mut Module) {
    match tree {
        UseTree::Path(path) => {
            prefix.push(path.ident.to_string());
            bring(&path.tree, prefix, module);
            prefix.pop();
        }
        UseTree::Group(group) => group.items.iter().for_each(|tree| bring(tree, prefix, module)),
        UseTree::Glob(_) => module.globs.push(prefix.clone()),
        UseTree::Name(name) => {
            let name = name.ident.to_string();
            let mut path = prefix.clone();
            if name != "self" {
                path.push(name);
            }
            module.uses.insert(path.last().cloned().unwrap_or_default(), path);
        }
        UseTree::Rename(rename) => {
            let mut path = prefix.clone();
            if rename.ident != "self" {
                path.push(rename.ident.to_string());
            }
            module.uses.insert(rename.rename.to_string(), path);
        }
    }
}
