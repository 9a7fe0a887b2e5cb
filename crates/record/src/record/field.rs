//! `field.toml`: the sensors of a recording.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::geocom::TrackingSettings;
use super::place::Place;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::project::{Source as Text, Step};

/// Default rate of a serial port, bits per second.
const BAUD: u32 = 115_200;
/// Default length of the sides of a board, metres.
const BOARD_M: f64 = 0.5;

/// A checked `field.toml`.
#[derive(Debug, Clone)]
pub struct Field {
    /// The file, absolute.
    pub path: PathBuf,
    /// Folder in which each recording gets a new folder.
    pub folder: PathBuf,
    /// The sensors; names are unique.
    pub sources: Vec<Source>,
    /// Boards for which the view shows the courses on which they were crossed.
    pub boards: Vec<Board>,
    /// The tables of the project that is written into a recording.
    pub project: toml::Table,
}

/// A board in the field.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// Name.
    pub name: String,
    /// Its centre in the project's world: east, north, up, metres.
    pub position_m: Vec3,
    /// Length of its sides, metres.
    pub size_m: f64,
}

/// A sensor.
#[derive(Debug, Clone)]
pub struct Source {
    /// Letters, digits, `-` and `_`, because it becomes part of file names.
    pub name: String,
    /// Its port or address.
    pub place: Place,
    /// Its kind.
    pub kind: Kind,
}

/// The kind of a sensor.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// A Leica total station.
    Geocom(Box<TrackingSettings>),
    /// An inertial sensor of SBG Systems.
    Sbg,
    /// A receiver that sends NMEA sentences.
    Nmea,
    /// A Gocator profile scanner on its data channel.
    Gocator,
    /// Lines of a table with this header; if it names no time, each line gets the time of its arrival.
    Lines(String),
}

impl Kind {
    /// Whether its lines get the time of their arrival as a column.
    pub fn is_timed_here(&self) -> bool {
        match self {
            Self::Lines(header) => !header.to_lowercase().contains("time"),
            _ => false,
        }
    }

    /// Extension of its file.
    pub fn extension(&self) -> &'static str {
        match self {
            Self::Geocom(_) | Self::Lines(_) => "csv",
            Self::Sbg => "sbg",
            Self::Nmea => "nmea",
            Self::Gocator => "gocator",
        }
    }
}

impl Source {
    /// The name of its file.
    pub fn file(&self) -> String {
        format!("{}.{}", self.name, self.kind.extension())
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenField {
    folder: Option<PathBuf>,
    #[serde(default)]
    source: Vec<WrittenSource>,
    #[serde(default)]
    board: Vec<WrittenBoard>,
    #[serde(default)]
    project: toml::Table,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenBoard {
    name: String,
    position_m: [f64; 3],
    size_m: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenSource {
    name: String,
    kind: WrittenKind,
    address: Option<String>,
    port: Option<PathBuf>,
    baud: Option<u32>,
    header: Option<String>,
    edm_mode: Option<u16>,
    program: Option<u16>,
    prism_type: Option<u16>,
    lock: Option<bool>,
    power_search: Option<bool>,
    checksum: Option<bool>,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum WrittenKind {
    Geocom,
    Sbg,
    Nmea,
    Gocator,
    Lines,
}

impl Field {
    /// Reads and checks a `field.toml`.
    ///
    /// # Errors
    /// The first mistake, with its line, what was found and what was expected.
    pub fn read(path: &Path) -> Result<Self> {
        let text = Text::read(path)?;
        let written: WrittenField = text.parsed()?;
        if written.source.is_empty() {
            return Err(text.error(&[], "no source", "[[source]] tables"));
        }
        let mut sources: Vec<Source> = Vec::new();
        for (index, source) in written.source.into_iter().enumerate() {
            let steps = |key| [Step::Key("source"), Step::Index(index), Step::Key(key)];
            let refused = |key: &'static str, found: String, expected: &str| {
                Err(text.error(&steps(key), found, expected))
            };
            let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
            if source.name.is_empty() || !source.name.chars().all(is_plain) {
                let expected = "letters, digits, - and _, because it becomes part of file names";
                return refused("name", format!("the name {:?}", source.name), expected);
            }
            if sources.iter().any(|other| other.name == source.name) {
                let found = format!("the source {:?} twice", source.name);
                return refused("name", found, "each name once");
            }
            let place = match (&source.port, &source.address) {
                (Some(port), None) => Place::Serial(port.clone(), source.baud.unwrap_or(BAUD)),
                (None, Some(address)) => place_of(address),
                _ => {
                    let expected = "`port`, such as \"/dev/ttyUSB0\", or `address`, such as \
                                    \"192.168.1.10:1212\" or \"udp://0.0.0.0:5000\"";
                    let found = match source.port {
                        Some(_) => "both `port` and `address`",
                        None => "neither `port` nor `address`",
                    };
                    return refused("name", found.into(), expected);
                }
            };
            if source.baud.is_some() && source.port.is_none() {
                return refused(
                    "baud",
                    "`baud` without `port`".into(),
                    "`baud` only for a serial port",
                );
            }
            let is_station = source.kind == WrittenKind::Geocom;
            let station_keys = [
                ("edm_mode", source.edm_mode.is_some()),
                ("program", source.program.is_some()),
                ("prism_type", source.prism_type.is_some()),
                ("lock", source.lock.is_some()),
                ("power_search", source.power_search.is_some()),
                ("checksum", source.checksum.is_some()),
            ];
            if let Some((key, _)) = station_keys
                .iter()
                .find(|(_, is_there)| *is_there && !is_station)
            {
                return refused(
                    key,
                    format!("`{key}`"),
                    "this key only with kind = \"geocom\"",
                );
            }
            if is_station && matches!(place, Place::Udp(_)) {
                return refused(
                    "address",
                    place.to_string(),
                    "a serial port or a TCP address",
                );
            }
            let kind = match (source.kind, source.header.clone()) {
                (WrittenKind::Lines, Some(header)) => Kind::Lines(header),
                (WrittenKind::Lines, None) => {
                    let expected =
                        "`header`: the names of the columns, such as \"time_s,heading_deg\"";
                    return refused("kind", "lines without a header".into(), expected);
                }
                (_, Some(_)) => {
                    return refused(
                        "header",
                        "`header`".into(),
                        "this key only with kind = \"lines\"",
                    );
                }
                (WrittenKind::Sbg, None) => Kind::Sbg,
                (WrittenKind::Nmea, None) => Kind::Nmea,
                (WrittenKind::Gocator, None) => Kind::Gocator,
                (WrittenKind::Geocom, None) => {
                    let default = TrackingSettings::default();
                    Kind::Geocom(Box::new(TrackingSettings {
                        // A program sets the mode.
                        edm_mode: source
                            .edm_mode
                            .or(default.edm_mode.filter(|_| source.program.is_none())),
                        program: source.program,
                        prism_type: source.prism_type,
                        lock: source.lock.unwrap_or(default.lock),
                        power_search: source.power_search.unwrap_or(default.power_search),
                        checksum: source.checksum.unwrap_or(default.checksum),
                        ..default
                    }))
                }
            };
            sources.push(Source {
                name: source.name,
                place,
                kind,
            });
        }
        Ok(Self {
            folder: text.absolute(&written.folder.unwrap_or_default()),
            path: text.path.clone(),
            sources,
            boards: boards(&text, written.board)?,
            project: written.project,
        })
    }

    /// The project of a recording: the tables of `[project]`, in which the file of the source replaces
    /// `source = "NAME"`.
    ///
    /// # Errors
    /// The name of a source that does not exist.
    pub fn project_text(&self) -> Result<String> {
        let text = Text::read(&self.path)?;
        let mut tables = self.project.clone();
        for (name, table) in &mut tables {
            let all: Vec<&mut toml::Table> = match table {
                toml::Value::Table(table) => vec![table],
                toml::Value::Array(all) => {
                    all.iter_mut().filter_map(|v| v.as_table_mut()).collect()
                }
                _ => Vec::new(),
            };
            for table in all {
                let Some(wanted) = table.remove("source") else {
                    continue;
                };
                let source = self
                    .sources
                    .iter()
                    .find(|source| wanted.as_str() == Some(&source.name));
                let Some(source) = source else {
                    let steps = [Step::Key("project"), Step::Key(name), Step::Key("source")];
                    let expected = "the name of a [[source]]";
                    return Err(text.error(&steps, format!("the source {wanted}"), expected));
                };
                let key = if name == "scanner" {
                    "profiles"
                } else {
                    "file"
                };
                table.insert(key.into(), source.file().into());
            }
        }
        toml::to_string(&tables).map_err(|error| text.error(&[], error.to_string(), "a project"))
    }
}

fn boards(text: &Text, written: Vec<WrittenBoard>) -> Result<Vec<Board>> {
    let mut boards = Vec::new();
    for (index, board) in written.into_iter().enumerate() {
        let size_m = board.size_m.unwrap_or(BOARD_M);
        let is_finite = board.position_m.iter().all(|value| value.is_finite());
        if !(is_finite && (0.01..=100.0).contains(&size_m)) {
            let key = if is_finite { "size_m" } else { "position_m" };
            let steps = [Step::Key("board"), Step::Index(index), Step::Key(key)];
            let found = format!("{size_m} m at {:?}", board.position_m);
            let expected = "a size from 0.01 to 100 m, and coordinates in the project's world";
            return Err(text.error(&steps, found, expected));
        }
        boards.push(Board {
            name: board.name,
            position_m: Vec3::from(board.position_m),
            size_m,
        });
    }
    Ok(boards)
}

fn place_of(address: &str) -> Place {
    let bare = |scheme: &str| address.strip_prefix(scheme).map(str::to_owned);
    match (bare("udp://"), bare("tcp://")) {
        (Some(address), _) => Place::Udp(address),
        (_, Some(address)) => Place::Tcp(address),
        _ => Place::Tcp(address.to_owned()),
    }
}
