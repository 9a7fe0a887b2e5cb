//! Links, anchors and pictures.

use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

use super::{Page, chapters, pages, root};

/// The targets of the links and pictures of a page.
fn targets(page: &Page) -> Vec<String> {
    let prose = page.prose();
    // Text in backticks is not a link.
    let plain: String = prose.split('`').step_by(2).collect();
    let parts = plain.split("](").skip(1);
    let targets = parts.filter_map(|part| part.split_once(')'));
    let mut targets: Vec<String> = targets.map(|(target, _)| target.to_owned()).collect();
    targets.extend(
        prose
            .split("src=\"")
            .skip(1)
            .filter_map(|part| Some(part.split_once('"')?.0.to_owned())),
    );
    targets
}

/// The anchors of a page, as GitHub and mdBook derive them from headings.
fn anchors(page: &Page) -> Vec<String> {
    let mut counts: HashMap<String, usize> = HashMap::new();
    let mut anchors = Vec::new();
    let mut is_code = false;
    for line in page.text.lines() {
        is_code ^= line.trim_start().starts_with("```");
        let heading = line.trim_start_matches('#');
        if is_code || heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        let lower = heading.trim().to_lowercase();
        let allowed = lower
            .chars()
            .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        let anchor: String = allowed.map(|c| if c == ' ' { '-' } else { c }).collect();
        let count = counts.entry(anchor.clone()).or_default();
        anchors.push(if *count == 0 {
            anchor
        } else {
            format!("{anchor}-{count}")
        });
        *count += 1;
    }
    anchors
}

/// A path without `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        if part == Component::ParentDir {
            plain.pop();
        } else {
            plain.push(part);
        }
    }
    plain
}

#[test]
fn every_link_leads_somewhere() {
    let mut broken = Vec::new();
    let mut count = 0;
    for page in pages() {
        for target in targets(&page) {
            if target.starts_with("http") || target.starts_with("mailto:") {
                continue;
            }
            count += 1;
            let (file, anchor) = target.split_once('#').unwrap_or((&target, ""));
            let path = match file {
                "" => page.path.clone(),
                file => plain(&page.path.parent().unwrap().join(file)),
            };
            let in_book = page.path.starts_with(root().join("docs"));
            if !path.exists() {
                broken.push(format!("{}: {target} does not exist", page.name()));
            } else if in_book && !path.starts_with(root().join("docs")) {
                broken.push(format!("{}: {target} is outside the book", page.name()));
            } else if !anchor.is_empty()
                && !anchors(&Page::read(path))
                    .iter()
                    .any(|known| known == anchor)
            {
                broken.push(format!("{}: {target} has no such heading", page.name()));
            }
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
    assert!(count > 80, "only {count} links were found");
}

#[test]
fn the_summary_lists_every_page_once() {
    let summary = Page::read(root().join("docs/SUMMARY.md"));
    let mut listed = targets(&summary);
    listed.sort();
    let mut pages: Vec<String> = chapters()
        .iter()
        .map(|page| page.name()["docs/".len()..].to_owned())
        .collect();
    pages.retain(|name| name != "SUMMARY.md");
    pages.sort();
    assert_eq!(listed, pages);
}

#[test]
fn every_picture_is_shown_and_drawings_support_dark_pages() {
    let shown: Vec<PathBuf> = pages()
        .iter()
        .flat_map(|page| {
            let folder = page.path.parent().unwrap().to_owned();
            targets(page)
                .into_iter()
                .map(move |target| plain(&folder.join(target)))
        })
        .collect();
    for folder in ["docs/pictures", "docs/figures"] {
        for entry in std::fs::read_dir(root().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            assert!(shown.contains(&path), "no page shows {}", path.display());
            if path.extension().is_some_and(|end| end == "svg") {
                let text = std::fs::read_to_string(&path).unwrap();
                for part in ["<title", "prefers-color-scheme: dark", "class=\"back\""] {
                    assert!(text.contains(part), "{} is without {part}", path.display());
                }
                assert!(
                    !text.contains("http://") || text.matches("http").count() == 1,
                    "{}",
                    path.display()
                );
            }
        }
    }
}
