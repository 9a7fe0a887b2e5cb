//! Detection of file formats: by content, then by name.

use super::compressed::without_extension;
use super::file::{extension, nothing_in};
use super::input::{Input, PARQUET};
use super::kind::{Format, Kind, Start};
use super::kinds::KINDS;
use super::parquet;
use crate::error::{Error, Location, Result};
use crate::format::cloud::headerless::{self, Likeness};
use crate::format::cloud::{pts, table as cloud_table};
use crate::format::log::positions;
use crate::format::poses::{navigation, tum};
use crate::format::text::lines::{Lines, Separator, numbers};

/// Detects the format of a file; that of an [`Input`] is remembered.
///
/// # Errors
/// A file that is missing, empty, or of an unknown format; the error names its first columns.
pub fn detect(input: impl Into<Input>) -> Result<Format> {
    let input = input.into();
    let index = input.detected(|| {
        let kind = by_content(&input)?;
        let is_same = |other: &&Kind| other.id == kind.id;
        Ok(KINDS.iter().position(is_same).unwrap_or_default())
    })?;
    Ok(Format(KINDS[index]))
}

fn by_content(input: &Input) -> Result<&'static Kind> {
    let (mut stream, size) = input.open()?;
    let extension = extension(&without_extension(input.path()));
    let start = Start {
        bytes: &input.first_bytes(&mut stream)?,
        size,
        extension: &extension,
    };
    let is_signed = |kind: &&&Kind| kind.signature.is_some_and(|matches| matches(&start));
    if let Some(kind) = KINDS.iter().find(is_signed) {
        return Ok(kind);
    }
    if start.bytes.starts_with(PARQUET) {
        return by_parquet(input);
    }
    // The content is ambiguous: the extension decides if it is known, and its reader reports errors.
    let is_named = |kind: &&&Kind| kind.extensions.contains(&extension.as_str());
    match KINDS.iter().find(is_named) {
        Some(kind) => Ok(kind),
        None => by_text(input),
    }
}

/// The format of a table or of lines of numbers.
fn by_text(input: &Input) -> Result<&'static Kind> {
    let mut lines = Lines::open(input)?;
    let mut cells = Vec::new();
    let mut comment = Vec::new();
    let mut single = 0;
    while lines.advance()? {
        let text = lines.text();
        if text.is_empty() {
            continue;
        }
        if let Some(text) = text.strip_prefix(['#', '%']) {
            comment = Separator::of(text).names(text);
            continue;
        }
        if !numbers(text, &mut cells) {
            // CloudCompare marks its header with `//`; native tables never have this mark.
            let (text, is_marked) = match text.strip_prefix("//") {
                Some(rest) => (rest, true),
                None => (text, false),
            };
            let names = Separator::of(text).names(text);
            let table = by_columns(&names).filter(|_| !is_marked);
            return table
                .or_else(|| by_header(&names))
                .or_else(|| by_header(&Separator::Tab.names(text)))
                .ok_or_else(|| match headerless::coded_points(&names) {
                    Some(found) => headerless_table(input, found),
                    None => unknown(&lines, &names),
                });
        }
        if let Some(format) = by_columns(&comment) {
            return Ok(format);
        }
        if tum::is_header(&comment) {
            return Ok(&tum::TUM);
        }
        let header = by_header(&comment).filter(|_| comment.len() == cells.len());
        if let Some(format) = header {
            refuse_matrix(input, &mut lines, cells)?;
            return Ok(format);
        }
        // A header with unknown names must not pass for a comment above lines of x y z.
        if comment.len() == cells.len()
            && comment
                .first()
                .is_some_and(|name| name.to_lowercase().starts_with("time"))
        {
            return Err(unknown(&lines, &comment));
        }
        match (cells.len(), single) {
            (1, 0) => single = 1,
            (1, _) => return Ok(&pts::PTX),
            (3.., 1) => return Ok(&pts::PTS),
            (3.., _) if extension(&without_extension(input.path())) == "xyz" => {
                return lines_of_xyz(input);
            }
            (3.., _) => {
                let fits = |kind: &&&Kind| kind.numbers.is_some_and(|fit| fit(&cells));
                if let Some(kind) = KINDS.iter().find(fits) {
                    return Ok(kind);
                }
                refuse_matrix(input, &mut lines, cells)?;
                return lines_of_xyz(input);
            }
            (n, _) => {
                return Err(lines.error(
                    format!("{n} numbers without a header"),
                    "a header, or lines of x y z",
                ));
            }
        }
    }
    Err(nothing_in(input.path(), "line of data"))
}

/// The error of a table without a header whose first columns are not coordinates; `None` for other files.
///
/// # Errors
/// A file that cannot be read as text.
pub(super) fn other_table(input: &Input) -> Result<Option<Error>> {
    let mut lines = Lines::open(input)?;
    let mut rows = Vec::new();
    let mut has_commas = false;
    while rows.len() < headerless::ROWS && lines.advance()? {
        let text = lines.text();
        let mut cells = Vec::new();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        if !numbers(text, &mut cells) {
            let first = rows.is_empty().then(|| Separator::of(text).names(text));
            let coded = first.as_deref().and_then(headerless::coded_points);
            if let Some(found) = coded {
                return Ok(Some(headerless_table(input, found)));
            }
            break;
        }
        has_commas |= Separator::of(text) == Separator::Comma;
        rows.push(cells);
    }
    let found = headerless::other_than_xyz(&rows, has_commas);
    Ok(found.map(|found| headerless_table(input, found)))
}

/// The error of a table without a header.
fn headerless_table(input: &Input, Likeness { found, expected }: Likeness) -> Error {
    let found = format!("a table without a header that looks like {found}");
    Error::format(input.path(), Location::Whole, found, expected)
}

/// The format of lines of x y z, if the table without a header is not another one.
fn lines_of_xyz(input: &Input) -> Result<&'static Kind> {
    other_table(input)?.map_or(Ok(&cloud_table::XYZ), Err)
}

/// An error if the file is a 4 by 4 matrix.
fn refuse_matrix(input: &Input, lines: &mut Lines, cells: Vec<f64>) -> Result<()> {
    if is_matrix(lines, cells)? {
        Err(Error::format(
            input.path(),
            Location::Whole,
            "a 4 by 4 matrix",
            KNOWN,
        ))
    } else {
        Ok(())
    }
}

/// Whether the file holds just four lines of four numbers, the last 0 0 0 1. This is a transformation, which
/// would otherwise be read as four points.
fn is_matrix(lines: &mut Lines, mut cells: Vec<f64>) -> Result<bool> {
    let mut rows = 1;
    while rows <= 4 && cells.len() == 4 {
        let is_last = cells == [0.0, 0.0, 0.0, 1.0];
        loop {
            if !lines.advance()? {
                return Ok(rows == 4 && is_last);
            }
            if !lines.text().is_empty() {
                break;
            }
        }
        if !numbers(lines.text(), &mut cells) {
            return Ok(false);
        }
        rows += 1;
    }
    Ok(false)
}

/// Expected content of a text file, in error messages.
const KNOWN: &str = "the columns of an IMU, prism or heading log, of profiles, a trajectory or a cloud, or one \
                     of the binary formats";

fn unknown(lines: &Lines, names: &[String]) -> Error {
    match navigation::unstated_angles(names) {
        Some(found) => lines.error(found, navigation::EXPECTED),
        None => lines.error(listed(names), foreign_log(names).unwrap_or(KNOWN)),
    }
}

/// What a table of an IMU or of headings with a header of its own should have.
fn foreign_log(names: &[String]) -> Option<&'static str> {
    let stems: Vec<String> = names
        .iter()
        .map(|name| {
            name.split(['[', '('])
                .next()
                .unwrap_or_default()
                .trim()
                .to_lowercase()
        })
        .collect();
    let along_x = |starts: &[&str]| {
        let is_x = |stem: &String| {
            starts.iter().any(|start| stem.starts_with(start)) && stem.contains('x')
        };
        stems.iter().any(is_x)
    };
    if along_x(&["g", "w", "rate", "ang", "omega"]) && along_x(&["a", "lin", "f"]) {
        return Some(
            "the header `time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2` if it is the \
             log of an IMU, also with the ends `_deg_s` and `_g`",
        );
    }
    let is_heading = |stem: &String| {
        ["heading", "azimuth", "hdg"]
            .iter()
            .any(|word| stem.contains(word))
    };
    stems.iter().any(is_heading).then_some(
        "the header `time_s,heading_deg` if it is a log of headings, clockwise from north",
    )
}

fn listed(names: &[String]) -> String {
    let shown: String = names.join(", ").chars().take(200).collect();
    format!("`{shown}`")
}

/// The format of the table in a Parquet file.
fn by_parquet(input: &Input) -> Result<&'static Kind> {
    let header = parquet::header(input)?;
    if header.is_foreign_cloud {
        return Ok(&cloud_table::CLOUD_TABLE);
    }
    let unknown = || Error::format(input.path(), Location::Whole, listed(&header.names), KNOWN);
    by_columns(&header.names).ok_or_else(unknown)
}

/// The format of the table with these columns. A prism log and a cloud with times can have the same
/// columns, but a cloud begins with its coordinates.
fn by_columns(names: &[String]) -> Option<&'static Kind> {
    let has_columns = |kind: &&&Kind| kind.columns.is_some_and(|columns| columns.are_in(names));
    let kind = *KINDS.iter().find(has_columns)?;
    let is_cloud = names.first().is_some_and(|name| name == "east_m")
        || names.iter().any(|n| n == "intensity" || n == "scanner");
    if kind.id == positions::POSITION_TABLE.id && is_cloud {
        Some(&cloud_table::CLOUD_TABLE)
    } else {
        Some(kind)
    }
}

/// The format of another program's table with this header.
fn by_header(names: &[String]) -> Option<&'static Kind> {
    let has_header = |kind: &&&Kind| kind.header.is_some_and(|matches| matches(names));
    KINDS.iter().find(has_header).copied()
}
