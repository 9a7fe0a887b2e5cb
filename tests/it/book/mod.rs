//! The book in docs/: its links, its examples, and the messages and functions that it mentions.

mod examples;
mod links;
mod names;

use std::fs;
use std::path::{Path, PathBuf};

/// The folder of the package.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A page of the repository.
struct Page {
    path: PathBuf,
    text: String,
}

impl Page {
    fn read(path: PathBuf) -> Self {
        let text = fs::read_to_string(&path).unwrap();
        Self { path, text }
    }

    /// Its path from the root.
    fn name(&self) -> String {
        let path = self.path.strip_prefix(root()).unwrap();
        path.to_string_lossy().replace('\\', "/")
    }

    /// Its code blocks: language, position and text.
    fn blocks(&self) -> Vec<Block> {
        let (mut blocks, mut inside): (Vec<Block>, bool) = (Vec::new(), false);
        for (line, text) in self.text.lines().enumerate() {
            match text.trim_start().strip_prefix("```") {
                Some(language) if !inside => {
                    inside = true;
                    blocks.push(Block {
                        language: language.to_owned(),
                        at: format!("{}:{}", self.name(), line + 1),
                        lines: (line, line),
                        text: String::new(),
                    });
                }
                Some(_) => {
                    inside = false;
                    blocks.last_mut().unwrap().lines.1 = line;
                }
                None if inside => blocks.last_mut().unwrap().text += &format!("{text}\n"),
                None => {}
            }
        }
        blocks
    }

    /// Its text without code blocks.
    fn prose(&self) -> String {
        let mut prose = String::new();
        for (index, part) in self.text.split("```").enumerate() {
            if index % 2 == 0 {
                prose += part;
            }
        }
        prose
    }
}

struct Block {
    language: String,
    at: String,
    /// First and last line, counted from 0.
    lines: (usize, usize),
    text: String,
}

/// The pages of the book.
fn chapters() -> Vec<Page> {
    let entries = fs::read_dir(root().join("docs")).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let mut pages: Vec<PathBuf> = paths
        .filter(|path| path.extension().is_some_and(|end| end == "md"))
        .collect();
    pages.sort();
    pages.into_iter().map(Page::read).collect()
}

/// The pages of the book, and other pages with links.
fn pages() -> Vec<Page> {
    let others = [
        "README.md",
        "CHANGELOG.md",
        "web/README.md",
        "tests/data/README.md",
    ];
    let others = others.iter().map(|name| Page::read(root().join(name)));
    chapters().into_iter().chain(others).collect()
}
