//! The structure of `src/` and of the crates: modules import only from those above them in the table of `lib.rs`, no
//! file imports itself indirectly, and the README shows the same table.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::source_folders;

/// The path of a module from the crate's root.
type Module = Vec<String>;

/// The imports and exports of one source file.
struct Source {
    module: Module,
    /// Paths that it imports or names, from the crate's root.
    uses: Vec<Module>,
    /// Names that it re-exports, and their paths.
    exports: BTreeMap<String, Module>,
}

/// The file with the table of modules.
fn lib() -> PathBuf {
    source_folders()[0].join("lib.rs")
}

fn source_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap();
        if path.is_dir() {
            if name != "tests" {
                source_files(&path, files);
            }
        } else if path.extension().is_some_and(|e| e == "rs")
            && !["tests", "main", "small_case"].contains(&name)
            && (name != "lib" || path == lib())
        {
            files.push(path);
        }
    }
}

fn module_of(path: &Path) -> Module {
    let folders = source_folders();
    let mut inner = folders
        .iter()
        .filter_map(|folder| path.strip_prefix(folder).ok());
    let inner = inner.next().unwrap().with_extension("");
    let mut names: Module = inner
        .iter()
        .map(|name| name.to_str().unwrap().to_owned())
        .collect();
    if ["mod", "lib"].contains(&names.last().unwrap().as_str()) {
        names.pop();
    }
    names
}

/// The code without comments, strings and tests.
fn plain(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod ").next().unwrap();
    code.lines()
        .map(|line| line.split("//").next().unwrap())
        .collect::<Vec<_>>()
        .join("\n")
}

/// All paths of a `use` tree: those of `a::{b, c::d}` are `a::b` and `a::c::d`. An alias is dropped.
fn leaves(tree: &str, before: &[String], paths: &mut Vec<Module>) {
    let tree = tree.trim();
    if let Some(open) = tree.find('{') {
        let mut path = before.to_vec();
        path.extend(names(&tree[..open]));
        let inner = &tree[open + 1..tree.rfind('}').unwrap()];
        let (mut depth, mut from) = (0, 0);
        for (at, c) in inner.char_indices().chain([(inner.len(), ',')]) {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    if !inner[from..at].trim().is_empty() {
                        leaves(&inner[from..at], &path, paths);
                    }
                    from = at + 1;
                }
                _ => {}
            }
        }
    } else {
        let mut path = before.to_vec();
        path.extend(names(tree.split(" as ").next().unwrap()));
        paths.push(path);
    }
}

fn names(path: &str) -> impl Iterator<Item = String> + '_ {
    path.split("::")
        .map(|name| name.trim().to_owned())
        .filter(|name| !name.is_empty() && name != "self")
}

/// The path from the crate's root of a `path` that is used in `module`; `None` for other crates.
fn absolute(path: &[String], module: &Module, children: &BTreeSet<Module>) -> Option<Module> {
    let mut base = module.clone();
    let mut rest = path;
    match path.first()?.as_str() {
        "crate" => {
            base.clear();
            rest = &path[1..];
        }
        "super" => {
            while rest.first().is_some_and(|name| name == "super") {
                base.pop();
                rest = &rest[1..];
            }
        }
        first => {
            base.push(first.to_owned());
            if !children.contains(&base) {
                return None;
            }
            base.pop();
        }
    }
    base.extend_from_slice(rest);
    Some(base)
}

fn parse(path: &Path, modules: &BTreeSet<Module>) -> Source {
    let module = module_of(path);
    let code = plain(&fs::read_to_string(path).unwrap());
    let (mut uses, mut exports) = (Vec::new(), BTreeMap::new());
    let mut rest = code.as_str();
    let mut without = String::new();
    while let Some(at) = rest.find("use ") {
        let before = rest[..at].rsplit('\n').next().unwrap_or("").trim();
        let starts = before.is_empty() || before.starts_with("pub");
        let Some(end) = rest[at..].find(';').filter(|_| starts) else {
            without.push_str(&rest[..at + 4]);
            rest = &rest[at + 4..];
            continue;
        };
        let line = rest[..at].rfind('\n').map_or(0, |n| n + 1);
        let public = rest[line..at].trim_start().starts_with("pub");
        let mut paths = Vec::new();
        leaves(&rest[at + 4..at + end], &[], &mut paths);
        for path in paths {
            let Some(target) = absolute(&path, &module, modules) else {
                continue;
            };
            if public {
                exports.insert(target.last().unwrap().clone(), target);
            } else {
                uses.push(target);
            }
        }
        without.push_str(&rest[..line]);
        rest = &rest[at + end + 1..];
    }
    without.push_str(rest);
    // Paths within the code.
    for (at, _) in without.match_indices("::") {
        let start = without[..at]
            .rfind(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'))
            .map_or(0, |n| n + 1);
        let first = &without[start..at];
        let length = without[start..]
            .find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'))
            .unwrap_or(without.len() - start);
        if ["crate", "super"].contains(&first) || modules.contains(&child(&module, first)) {
            let path: Vec<String> = names(&without[start..start + length]).collect();
            uses.extend(absolute(&path, &module, modules));
        }
    }
    Source {
        module,
        uses,
        exports,
    }
}

fn child(module: &Module, name: &str) -> Module {
    module.iter().cloned().chain([name.to_owned()]).collect()
}

/// The module that defines the item at `path`.
fn home(path: &[String], sources: &BTreeMap<Module, Source>) -> Module {
    let mut at = path.len();
    while !sources.contains_key(&path[..at]) {
        at -= 1;
    }
    let module = path[..at].to_vec();
    let exported = path
        .get(at)
        .and_then(|name| sources[&module].exports.get(name));
    match exported {
        Some(from) if from != path => home(from, sources),
        _ => module,
    }
}

/// The imports of each file.
fn imports() -> BTreeMap<Module, BTreeSet<Module>> {
    let mut files = Vec::new();
    for folder in source_folders() {
        source_files(&folder, &mut files);
    }
    let modules: BTreeSet<Module> = files.iter().map(|path| module_of(path)).collect();
    let sources: BTreeMap<Module, Source> = files
        .iter()
        .map(|path| (module_of(path), parse(path, &modules)))
        .collect();
    let targets = |source: &Source| {
        let homes = source.uses.iter().map(|path| home(path, &sources));
        homes.filter(|target| *target != source.module).collect()
    };
    sources
        .iter()
        .map(|(module, source)| (module.clone(), targets(source)))
        .collect()
}

/// The modules in the order of the table in `text`, whose rows begin with a name in backquotes, and their contents.
fn table(text: &str) -> Vec<(String, String)> {
    let rows = text.lines().filter_map(|line| {
        let line = line.trim_start_matches("//!").trim();
        let row = line.strip_prefix("| ")?.strip_suffix(" |")?;
        let (name, contents) = row.split_once(" | ")?;
        let name = name
            .trim_matches(['[', ']', '`'])
            .trim_start_matches("mod@");
        let is_in = |folder: &PathBuf| {
            folder.join(name).is_dir() || folder.join(format!("{name}.rs")).is_file()
        };
        let is_module = source_folders().iter().any(is_in);
        is_module.then(|| (name.to_owned(), contents.to_owned()))
    });
    rows.collect()
}

#[test]
fn modules_import_only_from_above() {
    let lib = fs::read_to_string(lib()).unwrap();
    let modules: Vec<String> = table(&lib).into_iter().map(|(name, _)| name).collect();
    assert!(modules.len() > 10, "{modules:?}");
    let place = |name: &String| modules.iter().position(|module| module == name);
    let mut wrong = Vec::new();
    for (module, targets) in imports() {
        let Some(importer) = module.first() else {
            continue;
        };
        let Some(at) = place(importer) else {
            wrong.push(format!("{importer} is not in the table of lib.rs"));
            continue;
        };
        for target in targets {
            if let Some(other) = target.first().filter(|other| place(other) > Some(at)) {
                wrong.push(format!(
                    "{} imports {}: {importer} stands above {other}",
                    module.join("::"),
                    target.join("::")
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn no_file_imports_itself_indirectly() {
    let imports = imports();
    let mut circles = Vec::new();
    for start in imports.keys() {
        // The shortest way back through modules that come later in the alphabet.
        let mut ways = vec![vec![start.clone()]];
        let mut seen = BTreeSet::new();
        while let Some(way) = (!ways.is_empty()).then(|| ways.remove(0)) {
            for next in imports.get(&way[way.len() - 1]).into_iter().flatten() {
                if next == start {
                    let names = way.iter().map(|module| module.join("::"));
                    circles.push(names.collect::<Vec<_>>().join(" -> "));
                    ways.clear();
                    break;
                }
                if next > start && seen.insert(next.clone()) {
                    ways.push(way.iter().chain([next]).cloned().collect());
                }
            }
        }
    }
    assert!(circles.is_empty(), "\n{}", circles.join("\n"));
}

#[test]
fn the_readme_shows_the_table_of_the_library() {
    let lib = fs::read_to_string(lib()).unwrap();
    let readme =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    assert_eq!(table(&lib), table(&readme));
}
