//! The author of the report, as named on the page.

use std::path::{Path, PathBuf};

use base64::Engine as _;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Location, Result};

/// Largest size of a logo, bytes: every copy of the page includes it.
const MOST_BYTES: u64 = 1 << 20;

/// Title, author, organisation and logo of a report.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Imprint {
    /// Heading of the page; `None` for the name of the drive.
    pub title: Option<String>,
    /// Author, who is responsible for the report.
    pub author: Option<String>,
    /// Organisation of the author.
    pub organisation: Option<String>,
    /// Absolute path of a picture; it is not kept, because pages hold the picture itself.
    #[serde(skip)]
    pub logo: Option<PathBuf>,
}

impl Imprint {
    /// The logo as a data URI; `None` without one.
    ///
    /// # Errors
    /// The file cannot be read, or has more than 1 MiB.
    pub fn logo_uri(&self) -> Result<Option<String>> {
        let Some(path) = &self.logo else {
            return Ok(None);
        };
        let failed = |error| Error::io(path, error);
        let bytes = path.metadata().map_err(failed)?.len();
        if bytes > MOST_BYTES {
            let found = format!("a logo of {bytes} bytes");
            let expected = "a picture of at most 1 MiB";
            return Err(Error::format(path, Location::Whole, found, expected));
        }
        let content = std::fs::read(path).map_err(failed)?;
        let coded = base64::engine::general_purpose::STANDARD.encode(content);
        let media_type = media_type(path).unwrap_or("image/png");
        Ok(Some(format!("data:{media_type};base64,{coded}")))
    }
}

/// The media type of a picture, from the extension of its name; `None` for formats that browsers do not show.
pub fn media_type(path: &Path) -> Option<&'static str> {
    let end = path.extension()?.to_str()?.to_ascii_lowercase();
    match end.as_str() {
        "png" => Some("image/png"),
        "jpg" | "jpeg" => Some("image/jpeg"),
        "webp" => Some("image/webp"),
        "svg" => Some("image/svg+xml"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_logo_is_carried_by_the_page() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("logo.SVG");
        std::fs::write(&path, "<svg/>").unwrap();
        let mut imprint = Imprint {
            logo: Some(path.clone()),
            ..Imprint::default()
        };
        let uri = imprint.logo_uri().unwrap().unwrap();
        assert_eq!(uri, "data:image/svg+xml;base64,PHN2Zy8+");
        std::fs::write(&path, vec![b' '; MOST_BYTES as usize + 1]).unwrap();
        let error = imprint.logo_uri().unwrap_err().to_string();
        assert!(error.contains("1048577 bytes"), "{error}");
        imprint.logo = Some(folder.path().join("missing.png"));
        assert!(imprint.logo_uri().is_err());
        assert_eq!(Imprint::default().logo_uri().unwrap(), None);
    }
}
