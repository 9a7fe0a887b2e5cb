//! Coordinate reference systems in files: the well-known text of OGC (WKT 1, and WKT 2 of ISO 19162).
//!
//! Only name, code and unit are read: nothing is projected.

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
const VERTICAL: [&str; 4] = ["VERT_CS", "VERTCRS", "VERTICALCRS", "VERTCS"];
/// Relative tolerance within which a unit is the metre.
const SAME_UNIT: f64 = 1e-9;

/// Text for the unit of coordinates; if it is not the metre, `read_as` says how it is read.
pub(crate) fn describe_unit(name: &str, metres: f64, read_as: &str) -> String {
    if is_metre(metres) {
        "metres".to_owned()
    } else {
        format!("unit {name} of {metres} m, {read_as}")
    }
}

/// Whether a unit is the metre.
pub(crate) fn is_metre(metres: f64) -> bool {
    (metres - 1.0).abs() < SAME_UNIT
}

/// Text for coordinates that are angles.
pub(crate) const ANGLES: &str = "latitude and longitude, but read as metres";

/// The unit of coordinates.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum CoordinateUnit {
    /// Latitude and longitude.
    Degree,
    /// A length with this name, metres: of the horizontal coordinates, and of the heights.
    Length {
        name: String,
        horizontal_m: f64,
        vertical_m: f64,
    },
}

/// The unit of the coordinates of a system given as well-known text; `None` if the text does not name it.
pub(crate) fn unit(text: &str) -> Option<CoordinateUnit> {
    let nodes = nodes(text.trim_end_matches('\0'));
    let find = |keywords: &[&str]| find(&nodes, keywords);
    let Some(projected) = find(&PROJECTED) else {
        return find(&GEOGRAPHIC).map(|_| CoordinateUnit::Degree);
    };
    let length = |at: usize| {
        let [name, metres, ..] = unit_below(&nodes, at)? else {
            return None;
        };
        Some((*name, metres.parse().ok()?))
    };
    let (name, horizontal_m) = length(projected)?;
    // Without a unit of their own, heights have that of the other coordinates.
    let vertical_m = find(&VERTICAL)
        .and_then(length)
        .map_or(horizontal_m, |(_, metres)| metres);
    Some(CoordinateUnit::Length {
        name: name.to_owned(),
        horizontal_m,
        vertical_m,
    })
}

/// The first node with one of these keywords.
fn find(nodes: &[Node<'_>], keywords: &[&str]) -> Option<usize> {
    let is_one = |node: &Node<'_>| {
        keywords
            .iter()
            .any(|k| node.keyword.eq_ignore_ascii_case(k))
    };
    nodes.iter().position(is_one)
}

/// The nodes within a node.
fn below<'a, 'n>(nodes: &'a [Node<'n>], at: usize) -> impl Iterator<Item = &'a Node<'n>> {
    let depth = nodes[at].depth;
    nodes[at + 1..]
        .iter()
        .take_while(move |node| node.depth > depth)
}

/// Name and size of the unit of a projected or vertical system: its child, or in WKT 2 that of its last axis. The units
/// of ellipsoids and parameters come before it.
fn unit_below<'a, 'n>(nodes: &'a [Node<'n>], at: usize) -> Option<&'a [&'n str]> {
    let depth = nodes[at].depth + 1;
    let is_unit = |node: &&Node<'_>| {
        let keyword = node.keyword.to_ascii_uppercase();
        keyword == "LENGTHUNIT" || (keyword == "UNIT" && node.depth == depth)
    };
    let last = below(nodes, at).filter(is_unit).last()?;
    Some(last.values.as_slice())
}

/// Code, name and unit of the coordinate reference system in a well-known text; `None` for other texts. `read_as` says
/// how a unit other than the metre is read.
pub(crate) fn describe(text: &str, read_as: &str) -> Option<String> {
    let nodes = nodes(text.trim_end_matches('\0'));
    let root = nodes.first()?;
    let find = |keywords: &[&str]| find(&nodes, keywords);
    let projected = find(&PROJECTED);
    let horizontal = projected.or_else(|| find(&GEOGRAPHIC));
    let code = |at: usize| {
        let is_code = |node: &&Node<'_>| {
            node.depth == nodes[at].depth + 1
                && ["AUTHORITY", "ID"]
                    .iter()
                    .any(|k| node.keyword.eq_ignore_ascii_case(k))
        };
        match below(&nodes, at).find(is_code)?.values.as_slice() {
            [authority, code, ..] => Some(format!("{authority}:{code}, ")),
            _ => None,
        }
    };
    let code = code(0).or_else(|| code(horizontal?)).unwrap_or_default();
    let name = root.values.first()?;
    let name: String = name.chars().take(80).collect();
    let unit = match (projected, horizontal) {
        (Some(at), _) => match unit_below(&nodes, at) {
            Some([name, metres, ..]) => match metres.parse() {
                Ok(metres) => describe_unit(name, metres, read_as),
                Err(_) => format!("unit {name}"),
            },
            _ => "unit not named".to_owned(),
        },
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

    fn described(text: &str) -> Option<String> {
        describe(text, "but read as metres")
    }

    #[test]
    fn heights_may_have_a_unit_of_their_own() {
        let feet = UTM.replace(r#"UNIT["metre",1,"#, r#"UNIT["foot",0.3048,"#);
        let vertical = r#"VERT_CS["h",VERT_DATUM["d",2005],UNIT["metre",1]]"#;
        let compound = format!(r#"COMPD_CS["both",{feet},{vertical}]"#);
        for (text, expected) in [(&feet, 0.3048), (&compound, 1.0)] {
            let CoordinateUnit::Length {
                horizontal_m,
                vertical_m,
                ..
            } = unit(text).unwrap()
            else {
                panic!("{text}");
            };
            assert_eq!((horizontal_m, vertical_m), (0.3048, expected));
        }
        let angles = unit(r#"GEOGCRS["WGS 84",ID["EPSG",4326]]"#);
        assert_eq!(angles, Some(CoordinateUnit::Degree));
    }

    #[test]
    fn code_name_and_unit_are_those_of_the_coordinates() {
        let found = described(UTM).unwrap();
        assert_eq!(found, "EPSG:25832, ETRS89 / UTM zone 32N; metres");
        let compound = format!(r#"COMPD_CS["both (a, b]",{UTM},VERT_CS["h",UNIT["foot",0.3048]]]"#);
        let found = described(&compound).unwrap();
        assert_eq!(found, "EPSG:25832, both (a, b]; metres");
        let feet = UTM.replace(r#"UNIT["metre",1,"#, r#"UNIT["foot",0.3048,"#);
        let found = described(&feet).unwrap();
        assert!(
            found.ends_with("unit foot of 0.3048 m, but read as metres"),
            "{found}"
        );
        let found = described(r#"GEOGCRS["WGS 84",ID["EPSG",4326]]"#).unwrap();
        assert!(found.starts_with("EPSG:4326, WGS 84; latitude"), "{found}");
    }

    #[test]
    fn damaged_text_does_not_panic() {
        for end in 0..UTM.len() {
            let _ = described(&UTM[..end]);
            let _ = described(&UTM[end..]);
        }
        assert_eq!(described(""), None);
        assert_eq!(described("]]\"é"), None);
        assert_eq!(described("no text of this kind"), None);
    }
}
