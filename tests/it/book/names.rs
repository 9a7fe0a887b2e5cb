//! Messages and functions that the book mentions.

use std::fs;
use std::path::Path;

use super::{Page, root};
use crate::common::source_folders;

/// Appends all sources of the library, without the line breaks in long texts.
fn sources(folder: &Path, all: &mut String) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, all);
        } else if path.extension().is_some_and(|end| end == "rs") {
            let text = fs::read_to_string(path).unwrap().replace("\\\"", "\"");
            for (index, part) in text.split("\\\n").enumerate() {
                *all += if index == 0 { part } else { part.trim_start() };
            }
        }
    }
}

#[test]
fn the_messages_of_the_troubleshooting_page_are_those_of_the_program() {
    let mut all = String::new();
    for folder in source_folders() {
        sources(&folder, &mut all);
    }
    let page = Page::read(root().join("docs/troubleshooting.md"));
    let rows = page
        .text
        .lines()
        .filter(|line| line.starts_with("| `") || line.starts_with("| *"));
    let mut count = 0;
    for row in rows {
        let cell = row.trim_start_matches("| ").split(" | ").next().unwrap();
        let mark = &cell[..1];
        for message in cell.split(mark).skip(1).step_by(2) {
            for piece in message
                .split('…')
                .map(str::trim)
                .filter(|piece| piece.len() >= 4)
            {
                assert!(all.contains(piece), "no source has `{piece}` of {row}");
                count += 1;
            }
        }
    }
    assert!(count > 40, "{count} pieces of messages");
}

/// `a::{b, c}` as `a::b` and `a::c`.
fn expanded(name: &str) -> Vec<String> {
    match name.split_once("::{") {
        Some((before, list)) => {
            let list = list.trim_end_matches('}').split(',');
            list.map(|one| format!("{before}::{}", one.trim()))
                .collect()
        }
        None => vec![name.to_owned()],
    }
}

/// Whether a text defines an item of this kind with exactly this name.
fn names(text: &str, kind: &str, name: &str) -> bool {
    let whole = format!("{kind}{name}");
    let mut rests = text.split(&whole).skip(1);
    rests.any(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
}

/// Whether a path of the library exists in one of its folders.
fn is_there(name: &str) -> bool {
    source_folders().iter().any(|folder| is_in(folder, name))
}

/// Whether a path from a folder leads to a module, or to an item that a file along the path defines.
fn is_in(folder: &Path, name: &str) -> bool {
    let mut folder = folder.to_owned();
    let mut text = String::new();
    for part in name.split("::") {
        let file = folder.join(format!("{part}.rs"));
        let is_module = file.is_file() || folder.join(part).is_dir();
        if is_module {
            folder.push(part);
            text.clear();
            if file.is_file() {
                text = fs::read_to_string(file).unwrap();
            } else {
                sources(&folder, &mut text);
            }
        } else if !["fn ", "struct ", "enum "]
            .iter()
            .any(|kind| names(&text, kind, part))
        {
            return false;
        }
    }
    true
}

#[test]
fn the_functions_of_the_method_page_exist() {
    let page = Page::read(root().join("docs/method.md"));
    let rows = page.text.lines().filter(|line| line.starts_with("| "));
    let mut count = 0;
    for row in rows {
        let second = row.split(" | ").nth(1).unwrap_or_default();
        for name in second.split('`').skip(1).step_by(2) {
            for name in expanded(name) {
                assert!(is_there(&name), "{name} of {row}");
                count += 1;
            }
        }
    }
    assert!(count > 30, "{count} names");
}
