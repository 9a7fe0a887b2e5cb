//! Checks that a page is well formed and self-contained.

/// Checks that every tag is closed in the right order, that attributes are quoted, and that text has no
/// bare `&` or `<`. Returns the number of elements.
pub fn check_well_formed(page: &str) -> usize {
    let mut rest = page.strip_prefix("<!DOCTYPE html>").expect("a doctype");
    let mut open: Vec<&str> = Vec::new();
    let mut elements = 0;
    while let Some(start) = rest.find('<') {
        check_text(&rest[..start]);
        rest = &rest[start + 1..];
        let end = rest.find('>').expect("an open tag ends");
        let (tag, after) = (&rest[..end], &rest[end + 1..]);
        assert!(!tag.contains('<'), "a bare < near {tag:.80}");
        rest = after;
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "closing tag");
            continue;
        }
        elements += 1;
        assert_eq!(tag.matches('"').count() % 2, 0, "quotes in {tag:.80}");
        let name = tag.split([' ', '/']).next().expect("a name");
        assert!(name.chars().all(|c| c.is_ascii_alphanumeric()), "{name}");
        if tag.ends_with('/') {
            continue;
        }
        open.push(name);
        if name == "style" {
            rest = &rest[rest.find("</style>").expect("the style ends")..];
        }
    }
    check_text(rest);
    assert!(open.is_empty(), "not closed: {open:?}");
    elements
}

fn check_text(text: &str) {
    for piece in text.split('&').skip(1) {
        let known = ["amp;", "lt;", "gt;", "quot;", "#39;"];
        assert!(
            known.iter().any(|k| piece.starts_with(k)),
            "bare & in {text:.80}"
        );
    }
}

/// Checks that the page loads nothing, and contains no NaN or infinity.
pub fn check_self_contained(page: &str) {
    // A namespace is not loaded, and base64 may spell any word.
    let mut without = String::new();
    for (i, piece) in page
        .replace("xmlns=\"http://www.w3.org/2000/svg\"", "")
        // A link to the paper loads nothing.
        .replace("<a href=\"https://arxiv.org/abs/2403.17788\">", "")
        .split("href=\"data:image/png;base64,")
        .enumerate()
    {
        let end = if i == 0 {
            0
        } else {
            piece.find('"').expect("the image ends")
        };
        without.push_str(&piece[end..]);
    }
    for word in ["http://", "https://", "<script", "<link", "@import", "NaN"] {
        assert!(!without.contains(word), "{word}");
    }
    for attribute in ["src=\"", "href=\""] {
        for value in without.split(attribute).skip(1) {
            assert!(value.starts_with('#'), "{value:.80}");
        }
    }
    assert!(!without.contains("url("), "a reference in the style");
    let is_word = |c: char| c.is_alphanumeric();
    assert!(!without.split(|c| !is_word(c)).any(|word| word == "inf"));
}
