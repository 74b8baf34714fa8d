//! Modules of a crate and what they import, read from its sources: for tests of layers and cycles.
//!
//! A name that a module itself only imports leads on to where that module has it from, so `super::Frame` counts as an
//! import from the file that defines `Frame`. Tests are not read.

#![allow(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use super::workspace;

/// Names from the root of the crate on; the root itself is empty.
type Module = Vec<String>;

/// Re-exports followed from one to the next at most.
const LONGEST_CHAIN: usize = 8;

pub struct Modules {
    files: BTreeMap<Module, String>,
    /// From where a module has a name that it imports.
    imported: BTreeMap<(Module, String), Module>,
    imports: BTreeSet<(Module, Module)>,
}

impl Modules {
    /// Reads the sources below a folder of the workspace.
    pub fn read(folder: &str) -> Self {
        let mut texts = BTreeMap::new();
        read(&workspace().join(folder), &mut Vec::new(), &mut texts);
        let files = texts.keys().map(|module: &Module| (module.clone(), file_of(module))).collect();
        let mut modules = Self { files, imported: BTreeMap::new(), imports: BTreeSet::new() };
        let paths: Vec<_> = texts.iter().map(|(module, text)| (module, paths(text))).collect();
        for (module, paths) in &paths {
            for path in paths.iter().filter(|path| path.is_use) {
                if let Some((source, Some(name))) = modules.resolve(module, &path.names)
                    && source != **module
                {
                    modules.imported.insert(((*module).clone(), name), source);
                }
            }
        }
        for (module, paths) in &paths {
            for path in paths {
                let Some((source, name)) = modules.resolve(module, &path.names) else { continue };
                let source = modules.definition(source, name);
                if source != **module {
                    modules.imports.insert(((*module).clone(), source));
                }
            }
        }
        modules
    }

    /// The module a path leads to, and the first name behind it.
    fn resolve(&self, from: &Module, path: &[String]) -> Option<(Module, Option<String>)> {
        let mut at = from.clone();
        let mut names = path;
        match names.first()?.as_str() {
            "crate" => (at, names) = (Vec::new(), &names[1..]),
            "self" => names = &names[1..],
            "super" => {
                while let ["super", ..] = names.iter().map(String::as_str).collect::<Vec<_>>()[..] {
                    at.pop();
                    names = &names[1..];
                }
            }
            _ if self.files.contains_key(&child(from, names.first()?)) => {}
            _ => return None,
        }
        while let Some(name) = names.first().filter(|name| self.files.contains_key(&child(&at, name))) {
            at.push(name.clone());
            names = &names[1..];
        }
        Some((at, names.first().cloned()))
    }

    /// The module a name is from, behind re-exports.
    fn definition(&self, mut module: Module, name: Option<String>) -> Module {
        let Some(name) = name else { return module };
        for _ in 0..LONGEST_CHAIN {
            let Some(source) = self.imported.get(&(module.clone(), name.clone())) else { break };
            module.clone_from(source);
        }
        module
    }

    /// Imports that a table of layers does not allow. It lists each module at the root with those it may import, which
    /// come before it; the root itself may import all.
    pub fn violations(&self, layers: &[(&str, &[&str])]) -> String {
        let allowed: BTreeMap<_, _> = layers.iter().copied().collect();
        let mut report = String::new();
        for (place, (layer, used)) in layers.iter().enumerate() {
            let is_before = |name: &&&str| layers[..place].iter().any(|(layer, _)| layer == *name);
            for name in used.iter().filter(|name| !is_before(name)) {
                writeln!(report, "{name} must come before {layer} in the table of layers").unwrap();
            }
        }
        for module in self.files.keys().filter_map(|module| module.first()).collect::<BTreeSet<_>>() {
            if !allowed.contains_key(module.as_str()) {
                writeln!(report, "{module} is not in the table of layers").unwrap();
            }
        }
        for (from, to) in &self.imports {
            let (Some(layer), Some(used)) = (from.first(), to.first()) else { continue };
            let is_allowed =
                allowed.get(layer.as_str()).is_none_or(|allowed| allowed.contains(&used.as_str()));
            if layer != used && !is_allowed {
                writeln!(report, "{}: {layer} must not import {}", self.files[from], to.join("::")).unwrap();
            }
        }
        report
    }

    /// Files below a folder that import from a module.
    pub fn importers(&self, folder: &str, module: &str) -> Vec<&str> {
        let is_meant = |(from, to): &&(Module, Module)| {
            from.first().is_some_and(|name| name == folder) && to.first().is_some_and(|name| name == module)
        };
        let files: BTreeSet<_> = self.imports.iter().filter(is_meant).map(|(from, _)| from).collect();
        files.into_iter().map(|from| self.files[from].as_str()).collect()
    }

    /// Circles of imports among the files and folders of one folder.
    pub fn cycles(&self) -> String {
        let mut report = String::new();
        let folders = self.files.keys().filter_map(|module| module.split_last()).map(|(_, folder)| folder);
        for folder in folders.collect::<BTreeSet<_>>() {
            let mut edges: BTreeMap<&str, BTreeMap<&str, String>> = BTreeMap::new();
            for (from, to) in &self.imports {
                let inside = |module: &Module| module.starts_with(folder) && module.len() > folder.len();
                if inside(from) && inside(to) && from[folder.len()] != to[folder.len()] {
                    let import = format!("{} imports {}", self.files[from], to.join("::"));
                    edges.entry(&from[folder.len()]).or_default().insert(&to[folder.len()], import);
                }
            }
            if let Some(cycle) = cycle(&mut edges) {
                writeln!(report, "cycle in {}:\n  {}", file_of(folder), cycle.join("\n  ")).unwrap();
            }
        }
        report
    }
}

fn child(module: &Module, name: &str) -> Module {
    module.iter().map(String::as_str).chain([name]).map(str::to_owned).collect()
}

fn file_of(module: &[String]) -> String {
    if module.is_empty() { "the root".to_owned() } else { module.join("/") }
}

/// One circle, as its imports; what leads into none is taken out first.
fn cycle(edges: &mut BTreeMap<&str, BTreeMap<&str, String>>) -> Option<Vec<String>> {
    loop {
        let before = edges.len();
        let inner: BTreeSet<_> = edges.keys().copied().collect();
        edges.retain(|_, targets| {
            targets.retain(|target, _| inner.contains(target));
            !targets.is_empty()
        });
        if edges.len() == before {
            break;
        }
    }
    let mut at = *edges.keys().next()?;
    let mut way: Vec<(&str, String)> = Vec::new();
    while !way.iter().any(|(name, _)| *name == at) {
        let (target, import) = edges.get(at)?.iter().next()?;
        way.push((at, import.clone()));
        at = target;
    }
    Some(way.into_iter().skip_while(|(name, _)| *name != at).map(|(_, import)| import).collect())
}

/// Reads the files of a folder, without tests.
fn read(folder: &Path, module: &mut Module, texts: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let is_own = ["mod", "lib"].contains(&name.as_str());
        if name == "main" || name == "tests" {
            continue;
        }
        if !is_own {
            module.push(name);
        }
        if path.is_dir() {
            read(&path, module, texts);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            let text = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
            texts.insert(module.clone(), text.to_owned());
        }
        if !is_own {
            module.pop();
        }
    }
}

struct Names {
    names: Vec<String>,
    is_use: bool,
}

/// All paths of a file: those of `use` one by one, and those written out.
fn paths(text: &str) -> Vec<Names> {
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    let code = lines.collect::<Vec<_>>().join("\n");
    let tokens = tokens(&code);
    let (mut all, mut at) = (Vec::new(), 0);
    while let Some(token) = tokens.get(at) {
        let is_use = *token == "use";
        at += usize::from(is_use);
        let is_path = is_use || tokens.get(at + 1) == Some(&"::");
        at = if is_path { tree(&tokens, at, &[], is_use, &mut all) } else { at + 1 };
    }
    all
}

/// Identifiers, `::` and single characters.
fn tokens(code: &str) -> Vec<&str> {
    let mut all = Vec::new();
    let mut rest = code.trim_start();
    let is_word = |character: char| character.is_alphanumeric() || character == '_';
    while let Some(first) = rest.chars().next() {
        let length = if is_word(first) {
            rest.find(|character| !is_word(character)).unwrap_or(rest.len())
        } else if rest.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        all.push(&rest[..length]);
        rest = rest[length..].trim_start();
    }
    all
}

/// Takes one path, or several in braces, that begin with `prefix`; the place behind it.
fn tree(tokens: &[&str], mut at: usize, prefix: &[String], is_use: bool, all: &mut Vec<Names>) -> usize {
    let mut names = prefix.to_vec();
    while let Some(token) = tokens.get(at) {
        if *token == "{" {
            at += 1;
            while tokens.get(at).is_some_and(|token| *token != "}") {
                at = tree(tokens, at, &names, is_use, all);
                at += usize::from(tokens.get(at) == Some(&","));
            }
            return at + 1;
        }
        names.push((*token).to_owned());
        at += 1;
        if tokens.get(at) != Some(&"::") {
            break;
        }
        at += 1;
    }
    all.push(Names { names, is_use });
    at + if tokens.get(at) == Some(&"as") { 2 } else { 0 }
}
