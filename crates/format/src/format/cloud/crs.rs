//! Coordinate reference systems in files: the well-known text of OGC (WKT 1, and WKT 2 of ISO 19162).
//!
//! Only name, code and unit are read, for `inspect`: nothing is projected or converted.

/// A keyword and the content of its brackets.
struct Node<'a> {
    depth: usize,
    keyword: &'a str,
    /// Quoted texts and bare numbers between the brackets, without those of nested nodes.
    values: Vec<&'a str>,
}

/// The nodes of a well-known text, each before its nested nodes.
fn nodes(text: &str) -> Vec<Node<'_>> {
    let mut nodes: Vec<Node<'_>> = Vec::new();
    let mut open: Vec<usize> = Vec::new();
    let (mut start, mut is_quoted) = (0, false);
    for (at, byte) in text.bytes().enumerate() {
        if byte != b'"' && is_quoted {
            continue;
        }
        match byte {
            b'"' | b',' | b']' | b')' | b'[' | b'(' => {}
            _ => continue,
        }
        // All of these characters are single bytes in UTF-8.
        let piece = text[start..at].trim_matches(|c: char| c == '"' || c.is_whitespace());
        start = at + 1;
        match byte {
            b'[' | b'(' => {
                let depth = open.len();
                open.push(nodes.len());
                nodes.push(Node {
                    depth,
                    keyword: piece,
                    values: Vec::new(),
                });
                continue;
            }
            b'"' => is_quoted = !is_quoted,
            _ => {}
        }
        if let Some(node) = open.last().filter(|_| !piece.is_empty()) {
            nodes[*node].values.push(piece);
        }
        if matches!(byte, b']' | b')') {
            open.pop();
        }
    }
    nodes
}

const PROJECTED: [&str; 3] = ["PROJCS", "PROJCRS", "PROJECTEDCRS"];
const GEOGRAPHIC: [&str; 5] = [
    "GEOGCS",
    "GEOGCRS",
    "GEOGRAPHICCRS",
    "GEODCRS",
    "GEODETICCRS",
];
/// Relative tolerance within which a unit is the metre.
const SAME_UNIT: f64 = 1e-9;

/// Text for the unit of coordinates; if it is not the metre, the text also says that the readers assume metres.
pub(crate) fn describe_unit(name: &str, metres: f64) -> String {
    if (metres - 1.0).abs() < SAME_UNIT {
        "metres".to_owned()
    } else {
        format!("unit {name} of {metres} m, but read as metres")
    }
}

/// Text for coordinates that are angles.
pub(crate) const ANGLES: &str = "latitude and longitude, but read as metres";

/// Code, name and unit of the coordinate reference system in a well-known text; `None` for other texts.
pub(crate) fn describe(text: &str) -> Option<String> {
    let nodes = nodes(text.trim_end_matches('\0'));
    let root = nodes.first()?;
    let find = |keywords: &[&str]| {
        let matches = |node: &Node<'_>| {
            keywords
                .iter()
                .any(|k| node.keyword.eq_ignore_ascii_case(k))
        };
        nodes.iter().position(matches)
    };
    let projected = find(&PROJECTED);
    let horizontal = projected.or_else(|| find(&GEOGRAPHIC));
    let below = |at: usize| {
        let depth = nodes[at].depth;
        nodes[at + 1..]
            .iter()
            .take_while(move |node| node.depth > depth)
    };
    let code = |at: usize| {
        let is_code = |node: &&Node<'_>| {
            node.depth == nodes[at].depth + 1
                && ["AUTHORITY", "ID"]
                    .iter()
                    .any(|k| node.keyword.eq_ignore_ascii_case(k))
        };
        match below(at).find(is_code)?.values.as_slice() {
            [authority, code, ..] => Some(format!("{authority}:{code}, ")),
            _ => None,
        }
    };
    let code = code(0).or_else(|| code(horizontal?)).unwrap_or_default();
    let name = root.values.first()?;
    let name: String = name.chars().take(80).collect();
    let unit = match (projected, horizontal) {
        (Some(at), _) => {
            // The unit of the coordinates is a child of a projected system, or in WKT 2 of its last axis.
            // The units of ellipsoids and parameters come before it.
            let depth = nodes[at].depth + 1;
            let is_unit = |node: &&Node<'_>| {
                let keyword = node.keyword.to_ascii_uppercase();
                keyword == "LENGTHUNIT" || (keyword == "UNIT" && node.depth == depth)
            };
            match below(at)
                .filter(is_unit)
                .last()
                .map(|n| n.values.as_slice())
            {
                Some([name, metres, ..]) => match metres.parse() {
                    Ok(metres) => describe_unit(name, metres),
                    Err(_) => format!("unit {name}"),
                },
                _ => "unit not named".to_owned(),
            }
        }
        (None, Some(_)) => ANGLES.to_owned(),
        (None, None) => "unit not looked up".to_owned(),
    };
    Some(format!("{code}{name}; {unit}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const UTM: &str = r#"PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["D",SPHEROID["GRS 1980",6378137,298.257222101]],
        UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4258"]],PROJECTION["Transverse_Mercator"],
        UNIT["metre",1,AUTHORITY["EPSG","9001"]],AUTHORITY["EPSG","25832"]]"#;

    #[test]
    fn code_name_and_unit_are_those_of_the_coordinates() {
        let found = describe(UTM).unwrap();
        assert_eq!(found, "EPSG:25832, ETRS89 / UTM zone 32N; metres");
        let compound = format!(r#"COMPD_CS["both (a, b]",{UTM},VERT_CS["h",UNIT["foot",0.3048]]]"#);
        let found = describe(&compound).unwrap();
        assert_eq!(found, "EPSG:25832, both (a, b]; metres");
        let feet = UTM.replace(r#"UNIT["metre",1,"#, r#"UNIT["foot",0.3048,"#);
        let found = describe(&feet).unwrap();
        assert!(
            found.ends_with("unit foot of 0.3048 m, but read as metres"),
            "{found}"
        );
        let found = describe(r#"GEOGCRS["WGS 84",ID["EPSG",4326]]"#).unwrap();
        assert!(found.starts_with("EPSG:4326, WGS 84; latitude"), "{found}");
    }

    #[test]
    fn damaged_text_does_not_panic() {
        for end in 0..UTM.len() {
            let _ = describe(&UTM[..end]);
            let _ = describe(&UTM[end..]);
        }
        assert_eq!(describe(""), None);
        assert_eq!(describe("]]\"é"), None);
        assert_eq!(describe("no text of this kind"), None);
    }
}
