//! The tables of docs/project.md: keys and their meaning from `written.rs`, defaults from the output of the program.

use std::fmt::Write;
use std::path::Path;

use super::{Project, folder, read};
use crate::joint::ReferenceSigma;

/// The project as written, whose doc comments are the chapter's text.
const WRITTEN: &str = include_str!("../written.rs");
/// Marks before and after the tables.
const MARKS: [&str; 2] = ["<!-- keys: begin -->\n", "<!-- keys: end -->"];

/// A project with only the required keys and those on which other keys depend.
const LOGS: &str = r#"
[imu]
file = "imu.csv"
[prism]
file = "prism.csv"
lever_arm_m = [0, 0, 1]
station_m = [0, 0, 0]
station_orientation_deg = 0
observations = "polar"
[gnss]
file = "gnss.csv"
lever_arm_m = [0, 0, 1]
[heading]
file = "heading.csv"
[bending]
file = "bending.csv"
columns = ["temperature_c"]
[[scanner]]
name = "left"
profiles = "left.bin"
translation_m = [0, 0, 0]
rotation_deg = [0, 0, 0]
[reference]
file = "tls.laz"
"#;
const POSES: &str = "[trajectory]\nfile = \"poses.csv\"\n";

/// A table of the project with its keys.
struct Struct<'a> {
    name: &'a str,
    fields: Vec<Field<'a>>,
}

struct Field<'a> {
    name: &'a str,
    /// The type in the source code.
    kind: &'a str,
    /// The doc comment, without its last sentence if this gives the default.
    text: String,
    default: Option<String>,
}

fn structs() -> Vec<Struct<'static>> {
    let mut all: Vec<Struct<'static>> = Vec::new();
    let (mut text, mut is_inside) = (String::new(), false);
    for line in WRITTEN.lines() {
        let line = line.trim();
        if let Some(more) = line.strip_prefix("/// ") {
            text += if text.is_empty() { "" } else { " " };
            text += more;
        } else if let Some(rest) = line.strip_prefix("pub struct ") {
            let name = rest.trim_end_matches(" {");
            let fields = Vec::new();
            all.push(Struct { name, fields });
            is_inside = true;
            text.clear();
        } else if line == "}" {
            is_inside = false;
        } else if let Some((name, kind)) =
            line.strip_prefix("pub ").and_then(|l| l.split_once(": "))
            && is_inside
        {
            all.last_mut()
                .unwrap()
                .fields
                .push(field(name, kind, &text));
            text.clear();
        } else if !line.starts_with('#') {
            text.clear();
        }
    }
    all
}

fn field<'a>(name: &'a str, kind: &'a str, text: &str) -> Field<'a> {
    let split = ["Default: ", "Default "].into_iter();
    let split = split.filter_map(|word| text.rsplit_once(word)).next();
    let (text, default) = match split {
        Some((text, default)) => (text, Some(default.trim_end_matches('.').to_owned())),
        None => (text, None),
    };
    Field {
        name,
        kind: kind.trim_end_matches(','),
        text: text.trim().trim_end_matches('.').to_owned(),
        default,
    }
}

/// The type inside `Option<…>`, `Tables<…>`, `Vec<…>`.
fn inner(kind: &str) -> &str {
    let inner = kind.split_once('<').map_or(kind, |(_, rest)| rest);
    inner.trim_end_matches('>')
}

/// The value that the program prints for a key that was not given.
fn printed(text: &str, table: &str, key: &str) -> Option<toml::Value> {
    let value_in = |text: &str| -> Option<toml::Value> {
        let all: toml::Table = text.parse().unwrap();
        let one = all.get(table)?;
        let one = one.as_array().map_or(Some(one), |all| all.first())?;
        one.get(key).cloned()
    };
    let project = read(text).unwrap().to_toml().unwrap();
    value_in(&project).filter(|_| value_in(text).is_none())
}

fn default(table: &str, field: &Field<'_>) -> String {
    let is_optional = ["Option<", "Tables<"]
        .iter()
        .any(|word| field.kind.starts_with(word));
    let printed_value = [LOGS, POSES]
        .iter()
        .find_map(|text| printed(text, table, field.name));
    match (&field.default, printed_value) {
        (_, _) if !is_optional => "required".into(),
        (Some(stated), printed_value) => {
            let is_repeated =
                printed_value.is_some_and(|value| stated.trim_matches('`') == value.to_string());
            assert!(
                !is_repeated,
                "{table}.{}: the program prints this default, so the comment must not repeat it",
                field.name
            );
            stated.clone()
        }
        (None, Some(value)) => format!("`{value}`"),
        (None, None) => "–".into(),
    }
}

/// The chapter's tables.
fn tables() -> String {
    let structs = structs();
    let struct_of = |kind: &str| structs.iter().find(|one| one.name == kind).unwrap();
    let mut page = String::new();
    for table in &struct_of("Written").fields {
        let heading = match table.kind.split_once('<') {
            Some(("Tables", _)) => format!("`[{0}]`, or several `[[{0}]]`", table.name),
            Some(("Vec", _)) => format!("`[[{}]]`", table.name),
            _ => format!("`[{}]`", table.name),
        };
        writeln!(
            page,
            "\n## {heading}\n\n{}.\n\n| key | default | |\n|---|---|---|",
            table.text
        )
        .unwrap();
        for field in &struct_of(inner(table.kind)).fields {
            let default = default(table.name, field);
            writeln!(page, "| `{}` | {default} | {} |", field.name, field.text).unwrap();
        }
    }
    page + "\n"
}

#[test]
fn the_tables_in_the_chapter_match_the_code() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/project.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = page.split_once(MARKS[0]).unwrap();
    let (current, after) = rest.split_once(MARKS[1]).unwrap();
    let expected = tables();
    if std::env::var_os("BORESIGHT_WRITE").is_some() {
        let [begin, end] = MARKS;
        std::fs::write(&path, format!("{before}{begin}{expected}{end}{after}")).unwrap();
    } else {
        assert_eq!(
            current, expected,
            "docs/project.md does not match the code: run `just keys`"
        );
    }
}

#[test]
fn every_key_has_a_description() {
    let all = structs();
    let keys: usize = all.iter().map(|one| one.fields.len()).sum();
    assert!(keys > 100, "{keys} keys were found");
    for one in &all {
        for field in &one.fields {
            assert!(
                field.text.len() > 5,
                "{}.{}: `{}`",
                one.name,
                field.name,
                field.text
            );
        }
    }
}

/// The defaults of the reference are not printed, because values in a project do not count as assumed.
#[test]
fn assumed_defaults_of_the_reference_are_documented() {
    let assumed = ReferenceSigma::default();
    let all = structs();
    let reference = all.iter().find(|one| one.name == "Reference").unwrap();
    let documented_default = |name| {
        let mut fields = reference.fields.iter();
        fields
            .find(|field| field.name == name)
            .unwrap()
            .default
            .clone()
    };
    assert_eq!(
        documented_default("sigma_m"),
        Some(assumed.shift_m.to_string())
    );
    assert_eq!(
        documented_default("sigma_deg"),
        Some(assumed.tilt_rad.to_degrees().to_string())
    );
}

/// The program refuses unknown keys, so the tables list none that does not exist. They list all keys if they list every
/// printed key.
#[test]
fn printed_keys_are_in_the_tables() {
    let generated = tables();
    for text in [
        super::EXAMPLE,
        super::UNUSUAL,
        super::POSES,
        super::SEVERAL,
        super::joint::JOINT,
    ] {
        let folder = folder();
        let project = Project::read(&super::write(folder.path(), text)).unwrap();
        for line in project.to_toml().unwrap().lines() {
            if let Some((key, _)) = line.split_once(" = ") {
                assert!(generated.contains(&format!("| `{key}` |")), "{key}");
            }
        }
    }
}
