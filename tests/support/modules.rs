//! Modules of a crate and their imports, read from the source code, for tests of layers and cycles.
//!
//! An import leads to the file that defines the imported name: re-exports are followed, so `super::Notice` is
//! an import from the file that defines `Notice`. Imports of tests are ignored.

#![allow(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use super::code::blanked;
use super::workspace;

/// Max number of aliases that are followed for one path.
const LONGEST_CHAIN: usize = 16;

/// Names from the root of the crate; the root itself is empty.
type ModulePath = Vec<String>;

/// A name that a `use` declares in a module.
struct Import {
    is_exported: bool,
    name: String,
    path: Vec<String>,
}

/// A file without comments, strings, tests and imports.
struct Module {
    body: String,
    imports: Vec<Import>,
    /// Modules imported with `*`.
    globs: Vec<Vec<String>>,
}

/// All modules of a crate.
pub struct Modules(BTreeMap<ModulePath, Module>);

/// A cycle of imports within a folder.
pub struct Cycle {
    /// The folder, from the root of the crate.
    pub folder: String,
    /// Files and folders of the cycle in order, each with a path to the next one.
    pub chain: String,
}

/// Imports between the nodes of a folder, each with one path as an example.
type Graph = BTreeMap<String, BTreeMap<String, String>>;

impl Modules {
    /// Reads the sources below a folder of the workspace.
    pub fn read(folder: &str) -> Self {
        let root = workspace().join(folder);
        let mut files = Vec::new();
        collect(&root, &mut files);
        let name = |path: &Path| path.strip_prefix(&root).unwrap().display().to_string();
        Self::of(files.iter().map(|path| (name(path), fs::read_to_string(path).unwrap())))
    }

    /// The modules of files with these paths below the root.
    pub fn of(files: impl Iterator<Item = (String, String)>) -> Self {
        let mut modules = BTreeMap::new();
        let mut tests: Vec<ModulePath> = Vec::new();
        for (file, text) in files {
            let mut path: ModulePath = file.trim_end_matches(".rs").split('/').map(str::to_owned).collect();
            if path == ["main"] {
                continue;
            }
            if path.last().is_some_and(|last| last == "mod") || path == ["lib"] {
                path.pop();
            }
            let (text, of_tests) = without_tests(&blanked(&text));
            tests.extend(of_tests.into_iter().map(|name| child(&path, &name)));
            modules.insert(path, Module::parse(&text));
        }
        modules.retain(|path, _| !tests.iter().any(|test| path.starts_with(test)));
        Self(modules)
    }

    /// The module whose file defines the name at the end of a path in `module`; `None` for other crates.
    fn defining(&self, module: &[String], path: &[String], chain: usize) -> Option<ModulePath> {
        if chain > LONGEST_CHAIN {
            return None;
        }
        let first = path.first()?;
        let ups = path.iter().take_while(|name| *name == "super").count();
        match first.as_str() {
            "crate" | "$crate" => self.walk(&[], &path[1..], chain),
            "self" => self.walk(module, &path[1..], chain),
            "super" => self.walk(module.get(..module.len().checked_sub(ups)?)?, &path[ups..], chain),
            _ if self.0.contains_key(&child(module, first)) => self.walk(module, path, chain),
            _ => {
                let imports = &self.0.get(module)?.imports;
                let import = imports.iter().find(|import| import.name == *first && import.path != path)?;
                self.defining(module, &[&import.path, &path[1..]].concat(), chain + 1)
            }
        }
    }

    fn walk(&self, module: &[String], rest: &[String], chain: usize) -> Option<ModulePath> {
        let Some((name, behind)) = rest.split_first() else { return Some(module.to_vec()) };
        let below = child(module, name);
        if self.0.contains_key(&below) {
            return self.walk(&below, behind, chain);
        }
        let own = self.0.get(module)?;
        if let Some(import) = own.imports.iter().find(|import| import.name == *name) {
            return self.defining(module, &[&import.path, behind].concat(), chain + 1);
        }
        for glob in &own.globs {
            let from = self.defining(module, glob, chain + 1)?;
            if self.0.get(&from).is_some_and(|module| module.declares(name)) {
                return self.walk(&from, rest, chain + 1);
            }
        }
        Some(module.to_vec())
    }

    /// All imports: importing module, defining module, and the path in the source.
    fn imports(&self) -> Vec<(&ModulePath, ModulePath, String)> {
        let mut all = Vec::new();
        for (from, module) in &self.0 {
            for path in module.paths() {
                if let Some(to) = self.defining(from, &path, 0).filter(|to| to != from) {
                    all.push((from, to, path.join("::")));
                }
            }
        }
        all
    }

    /// Imports that a table of layers does not permit. The table lists each module at the root with its
    /// permitted imports, which precede it; the root itself may import all.
    pub fn violations(&self, layers: &[(&str, &[&str])]) -> String {
        let allowed: BTreeMap<_, _> = layers.iter().copied().collect();
        let mut report = String::new();
        for (place, (layer, used)) in layers.iter().enumerate() {
            let is_before = |name: &&&str| layers[..place].iter().any(|(layer, _)| layer == *name);
            for name in used.iter().filter(|name| !is_before(name)) {
                writeln!(report, "{name} must come before {layer} in the table of layers").unwrap();
            }
        }
        for module in self.0.keys().filter_map(|module| module.first()).collect::<BTreeSet<_>>() {
            if !allowed.contains_key(module.as_str()) {
                writeln!(report, "{module} is not in the table of layers").unwrap();
            }
        }
        for (from, to, path) in self.imports() {
            let (Some(layer), Some(used)) = (from.first(), to.first()) else { continue };
            let is_allowed =
                allowed.get(layer.as_str()).is_none_or(|allowed| allowed.contains(&used.as_str()));
            if layer != used && !is_allowed {
                writeln!(report, "{}: {layer} must not import {used}: {path}", shown(from)).unwrap();
            }
        }
        report
    }

    /// Files below a folder that import from a module.
    pub fn importers(&self, folder: &str, module: &str) -> Vec<String> {
        let is = |path: &ModulePath, name: &str| path.first().is_some_and(|first| first == name);
        let imports = self.imports();
        let meant = imports.iter().filter(|(from, to, _)| is(from, folder) && is(to, module));
        let files: BTreeSet<_> = meant.map(|(from, ..)| shown(from)).collect();
        files.into_iter().collect()
    }

    /// The shortest cycle of each folder that has one. The nodes of a folder are its files and its subfolders
    /// with all their contents. A `mod.rs` is a file like the others: it contains either shared definitions
    /// or code that uses the other files, never both. Its `mod` lines and re-exports only list the folder.
    pub fn cycles(&self) -> Vec<Cycle> {
        let mut graphs: BTreeMap<&[String], Graph> = BTreeMap::new();
        for (from, to, path) in self.imports() {
            let shared = from.iter().zip(&to).take_while(|(one, other)| one == other).count();
            let node = |of: &ModulePath| of.get(shared).map_or("mod.rs", String::as_str).to_owned();
            let graph = graphs.entry(&from[..shared]).or_default();
            let import = format!("{} uses {path}", shown(from));
            graph.entry(node(from)).or_default().entry(node(&to)).or_insert(import);
        }
        let found = graphs.iter().filter_map(|(folder, graph)| Some((folder, graph, shortest_cycle(graph)?)));
        let reported = found.map(|(folder, graph, nodes)| {
            let uses = nodes.windows(2).map(|pair| format!("\n    {}", graph[&pair[0]][&pair[1]]));
            let chain = nodes.join(" → ") + &uses.collect::<String>();
            Cycle { folder: folder.join("/"), chain }
        });
        reported.collect()
    }
}

impl Module {
    fn parse(text: &str) -> Self {
        let (mut body, mut imports, mut globs) = (String::new(), Vec::new(), Vec::new());
        let mut rest = text;
        while let Some(at) = rest.find("use ") {
            let (before, from) = rest.split_at(at);
            body.push_str(before);
            if before.ends_with(|c: char| c.is_alphanumeric() || c == '_') {
                body.push_str("use ");
                rest = &from[4..];
                continue;
            }
            let is_exported = before.trim_end().rsplit(['\n', ';', '}']).next().is_some_and(is_visibility);
            let (tree, after) = from[4..].split_once(';').unwrap_or((from, ""));
            for (path, name) in leaves(tree) {
                match name.as_str() {
                    "*" => globs.push(path),
                    _ => imports.push(Import { is_exported, name, path }),
                }
            }
            rest = after;
        }
        body.push_str(rest);
        Self { body, imports, globs }
    }

    /// Whether a name is defined or imported here.
    fn declares(&self, name: &str) -> bool {
        let words: Vec<_> = words(&self.body).collect();
        let kinds = ["fn", "struct", "enum", "trait", "type", "const", "static", "macro_rules"];
        words.windows(2).any(|pair| kinds.contains(&pair[0]) && pair[1] == name)
            || self.imports.iter().any(|import| import.name == name)
    }

    /// All paths of imports, except those that are only re-exported, and paths in the code.
    fn paths(&self) -> Vec<Vec<String>> {
        let used: BTreeSet<_> = words(&self.body).collect();
        let imports =
            self.imports.iter().filter(|import| !import.is_exported || used.contains(&*import.name));
        let mut paths: Vec<_> = imports.map(|import| import.path.clone()).collect();
        paths.extend(self.globs.iter().cloned());
        paths.extend(in_text(&self.body));
        paths
    }
}

/// Name of a module in reports.
fn shown(module: &[String]) -> String {
    if module.is_empty() { "the root".to_owned() } else { module.join("/") }
}

fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

fn child(module: &[String], name: &str) -> ModulePath {
    [module, &[name.to_owned()]].concat()
}

/// `pub`, `pub(super)`, `pub(in crate::capture)`.
fn is_visibility(text: &str) -> bool {
    let text = text.trim();
    text == "pub" || (text.starts_with("pub(") && text.ends_with(')'))
}

/// Identifiers and keywords of a text.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// The paths of a tree of imports, and the names that they declare.
fn leaves(tree: &str) -> Vec<(Vec<String>, String)> {
    let tree = tree.trim();
    if let Some((head, inner)) = tree.strip_suffix('}').and_then(|tree| tree.split_once('{')) {
        let head: Vec<String> = words(head).map(str::to_owned).collect();
        let under = |(path, name): (Vec<String>, String)| ([head.as_slice(), &path].concat(), name);
        let mut all: Vec<_> = parts(inner).into_iter().flat_map(leaves).map(under).collect();
        for (path, name) in &mut all {
            if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
                path.pop();
                if name == "self" {
                    name.clone_from(path.last().unwrap());
                }
            }
        }
        return all;
    }
    let (path, alias) = tree.split_once(" as ").unwrap_or((tree, ""));
    let mut path: Vec<String> = path.split("::").map(|name| name.trim().to_owned()).collect();
    let name = if alias.is_empty() { path.last().unwrap().clone() } else { alias.trim().to_owned() };
    if name == "*" {
        path.pop();
    }
    vec![(path, name)]
}

/// Parts between commas outside braces.
fn parts(text: &str) -> Vec<&str> {
    let mut depth = 0;
    let parts = text.split(|c| {
        depth += match c {
            '{' => 1,
            '}' => -1,
            _ => 0,
        };
        c == ',' && depth == 0
    });
    parts.map(str::trim).filter(|part| !part.is_empty()).collect()
}

/// Paths of at least two names in a text.
fn in_text(text: &str) -> Vec<Vec<String>> {
    let mut paths = Vec::new();
    let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '$';
    let mut rest = text;
    while let Some(start) = rest.find(is_word) {
        // `pub(in crate::rules)` is a visibility, not an import.
        rest = &rest[start..];
        let is_visibility = text[..text.len() - rest.len()].ends_with("(in ");
        let mut path = Vec::new();
        loop {
            let end = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
            path.push(rest[..end].to_owned());
            rest = &rest[end..];
            match rest.trim_start().strip_prefix("::").map(str::trim_start) {
                Some(next) if next.starts_with(|c: char| c.is_alphabetic() || c == '_') => rest = next,
                _ => break,
            }
        }
        if path.len() > 1 && !is_visibility {
            paths.push(path);
        }
    }
    paths
}

/// The text without code for tests, and the names of modules for tests.
fn without_tests(text: &str) -> (String, Vec<String>) {
    const MARKS: [&str; 2] = ["#[cfg(test)]", "#[cfg(all(test"];
    let (mut kept, mut modules, mut rest) = (String::new(), Vec::new(), text);
    while let Some(at) = MARKS.iter().filter_map(|mark| rest.find(mark)).min() {
        kept.push_str(&rest[..at]);
        let mut item = &rest[at..];
        while item.starts_with("#[") {
            item = item.split_once(']').unwrap().1.trim_start();
        }
        let end = end_of_item(item);
        let mut words = words(&item[..end]).skip_while(|word| matches!(*word, "pub" | "super" | "crate"));
        if words.next() == Some("mod") && item[..end].ends_with(';') {
            modules.extend(words.next().map(str::to_owned));
        }
        rest = &item[end..];
    }
    kept.push_str(rest);
    (kept, modules)
}

/// End of an item: after its semicolon or its braces.
fn end_of_item(item: &str) -> usize {
    let mut depth = 0_i32;
    let is_import = words(item).find(|word| *word != "pub") == Some("use");
    for (at, c) in item.char_indices() {
        match c {
            '{' | '(' | '[' => depth += 1,
            '}' | ')' | ']' => depth -= 1,
            _ => {}
        }
        if depth == 0 && (c == ';' || (c == '}' && !is_import)) {
            return at + 1;
        }
    }
    item.len()
}

/// The nodes of the shortest cycle, with the first one repeated at the end.
fn shortest_cycle(graph: &Graph) -> Option<Vec<String>> {
    graph.keys().filter_map(|start| way_back(graph, start)).min_by_key(Vec::len)
}

fn way_back(graph: &Graph, start: &str) -> Option<Vec<String>> {
    let mut ways = VecDeque::from([vec![start.to_owned()]]);
    let mut seen = BTreeSet::new();
    while let Some(way) = ways.pop_front() {
        for next in graph.get(way.last()?).into_iter().flat_map(BTreeMap::keys) {
            let longer = [way.as_slice(), std::slice::from_ref(next)].concat();
            if next == start {
                return Some(longer);
            }
            if seen.insert(next.clone()) {
                ways.push_back(longer);
            }
        }
    }
    None
}
