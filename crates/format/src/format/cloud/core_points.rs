//! Core points of a comparison, optionally with normals.

use crate::error::Result;
use crate::format::cloud::table::CLOUD_TABLE;
use crate::format::detect::detect;
use crate::format::input::Input;
use crate::format::log::tables::read_rows;
use crate::format::read::read_cloud;
use crate::format::text::lines::header_names;
use crate::format::text::table::Columns;
use crate::geometry::Vec3;

const WITH_NORMALS: Columns = Columns {
    needed: &[
        "east_m", "north_m", "up_m", "normal_x", "normal_y", "normal_z",
    ],
    optional: &[],
};

/// Core points and their normals.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CorePoints {
    /// East, north, up, metres.
    pub points: Vec<Vec3>,
    /// Normals as in the file, of any length, one for each point; empty if the file has none.
    pub normals: Vec<Vec3>,
}

/// Reads core points: any cloud that [`read_cloud`] reads. A native table with the columns
/// `normal_x`, `normal_y`, `normal_z` also gives their normals.
///
/// # Errors
/// Those of [`read_cloud`]; a table with one or two of the three columns.
pub fn read_core_points(input: impl Into<Input>) -> Result<CorePoints> {
    let input = &input.into();
    let is_table = detect(input).is_ok_and(|format| format.id() == CLOUD_TABLE.id);
    let components = &WITH_NORMALS.needed[3..];
    let has_normals = is_table
        && header_names(input)?
            .iter()
            .any(|name| components.contains(&name.as_str()));
    if !has_normals {
        return Ok(CorePoints {
            points: read_cloud(input)?.points,
            normals: Vec::new(),
        });
    }
    let rows = read_rows::<6, _>(input, &WITH_NORMALS, "point", |row, _| {
        let vector = |i: usize| Vec3::new(row[i], row[i + 1], row[i + 2]);
        Ok((vector(0), vector(3)))
    })?;
    let (points, normals) = rows.into_iter().unzip();
    Ok(CorePoints { points, normals })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<CorePoints> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("core.csv");
        std::fs::write(&path, text).unwrap();
        read_core_points(&path)
    }

    #[test]
    fn tables_may_contain_normals() {
        let core = read("normal_z,north_m,east_m,up_m,normal_x,normal_y\n1,2,3,4,5,6\n").unwrap();
        assert_eq!(core.points, [Vec3::new(3.0, 2.0, 4.0)]);
        assert_eq!(core.normals, [Vec3::new(5.0, 6.0, 1.0)]);
        let core = read("east_m,north_m,up_m\n1,2,3\n").unwrap();
        assert_eq!(core.points, [Vec3::new(1.0, 2.0, 3.0)]);
        assert!(core.normals.is_empty());
        let missing = read("east_m,north_m,up_m,normal_x\n1,2,3,4\n").unwrap_err();
        assert!(missing.to_string().contains("normal_y"), "{missing}");
        let infinite = read("east_m,north_m,up_m,normal_x,normal_y,normal_z\n1,2,3,nan,0,0\n");
        assert!(infinite.unwrap_err().to_string().contains("line 2"));
        assert!(read("east_m,north_m,up_m,normal_x,normal_y,normal_z\n").is_err());
    }
}
