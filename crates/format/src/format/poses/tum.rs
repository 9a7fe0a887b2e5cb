//! TUM and its relatives: lines of a time, a position and a quaternion, with or without a header.
//!
//! Without a header the columns are `time x y z qx qy qz qw`. A header, in a comment or in the first line, may name them
//! in another order and between other columns, which are passed over. Times too large for seconds of any clock are in
//! milliseconds, microseconds or nanoseconds.

use super::order::Order;
use super::table::{TUM_COLUMNS, UNIT_QUATERNION, rotation};
use crate::error::Result;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::plausible::unit_of_date;
use crate::format::text::lines::{Lines, Separator, numbers};
use crate::format::text::numerals::{DECIMAL_COMMAS, Numerals};
use crate::geometry::{Vec3, WorldFromBody};
use crate::sensor::PoseRecord;

pub(crate) const TUM: Kind = Kind {
    numbers: Some(|line| line.len() == TUM_COLUMNS.len()),
    header: Some(is_header),
    extensions: &["tum"],
    poses: Some(read),
    frame: Frame::Fixed(
        "metres, seconds (the format); axes of the file, taken for the world; body as in the file",
    ),
    ..Kind::new("tum", "trajectory (TUM)")
};

/// Names of each column in headers, in lower case and without `_`, `.`, blanks and a unit in brackets.
const NAMES: [&[&str]; 8] = [
    &[
        "time",
        "timestamp",
        "t",
        "stamp",
        "sec",
        "times",
        "timestamps",
    ],
    &["tx", "x", "px", "posx", "positionx"],
    &["ty", "y", "py", "posy", "positiony"],
    &["tz", "z", "pz", "posz", "positionz"],
    &["qx", "quatx", "orientationx"],
    &["qy", "quaty", "orientationy"],
    &["qz", "quatz", "orientationz"],
    &["qw", "quatw", "orientationw"],
];

/// The index of each column in a header; `None` if one is missing.
fn columns(names: &[String]) -> Option<[usize; 8]> {
    let plain = |name: &String| {
        let name = name.split(['[', '(']).next().unwrap_or_default();
        let name = name.to_lowercase();
        name.replace(['_', '.', ' ', '#', '%', '"'], "")
    };
    let names: Vec<String> = names.iter().map(plain).collect();
    let mut columns = [0; 8];
    for (column, wanted) in columns.iter_mut().zip(NAMES) {
        *column = names.iter().position(|name| wanted.contains(&&**name))?;
    }
    Some(columns)
}

/// Whether a header names the columns of poses.
pub(crate) fn is_header(names: &[String]) -> bool {
    columns(names).is_some()
}

/// Reads the poses.
fn read(input: &Input) -> Result<Vec<PoseRecord>> {
    let mut lines = Lines::open(input)?;
    let (mut order, mut width): (Option<[usize; 8]>, Option<usize>) = (None, None);
    let mut poses = PoseRows::default();
    let mut cells = Vec::new();
    let mut numerals = Numerals::default();
    while lines.advance()? {
        let text = lines.text();
        let comment = text.strip_prefix(['#', '%']);
        if comment.is_some() || text.is_empty() {
            let names = comment.map(|text| Separator::of(text).names(text));
            order = names.as_deref().and_then(columns).or(order);
            continue;
        }
        if width.is_none() && !numbers(text, &mut cells) {
            let names = Separator::of(text).names(text);
            if let Some(found) = columns(&names) {
                (order, width) = (Some(found), Some(names.len()));
                continue;
            }
        }
        let wanted =
            *width.get_or_insert(order.map_or(8, |_| Separator::of(text).names(text).len()));
        if !some_numbers(text, &mut numerals, &mut cells) || cells.len() != wanted {
            let found: String = text.chars().take(80).collect();
            return Err(lines.error(format!("`{found}`"), format!("{wanted} finite numbers")));
        }
        let order = order.unwrap_or([0, 1, 2, 3, 4, 5, 6, 7]);
        let row = order.map(|index| cells.get(index).copied().unwrap_or(f64::NAN));
        poses.push(&row, &lines)?;
    }
    if numerals.has_decimal_commas {
        input.remark(DECIMAL_COMMAS);
    }
    poses.finish(input)
}

/// Reads the numbers of a line; NaN stands for a cell that is text, as of a column that is passed over. False if no cell
/// is a number.
fn some_numbers(text: &str, numerals: &mut Numerals, into: &mut Vec<f64>) -> bool {
    into.clear();
    let _ = Separator::of(text).split::<()>(text, |_, cell| {
        into.push(numerals.number(cell).unwrap_or(f64::NAN));
        Ok(())
    });
    into.first().is_some_and(|first| !first.is_nan())
}

/// Poses from rows of time, position and quaternion.
#[derive(Default)]
struct PoseRows {
    poses: Vec<PoseRecord>,
    order: Order,
    /// Unit of the times, seconds, from the first.
    unit_s: Option<f64>,
    /// Rows without a pose, and the line of the first.
    empty: u64,
    first_empty: u64,
}

impl PoseRows {
    fn push(&mut self, row: &[f64; 8], lines: &Lines) -> Result<()> {
        let [time, x, y, z, qx, qy, qz, qw] = *row;
        let is_unset = [qx, qy, qz, qw] == [0.0; 4];
        if is_unset || row.iter().any(|value| !value.is_finite()) {
            if self.empty == 0 {
                self.first_empty = lines.number();
            }
            self.empty += 1;
            return Ok(());
        }
        self.order
            .add(time, |found, expected| lines.error(found, expected));
        let rotation = rotation(qx, qy, qz, qw).map_err(|length| {
            lines.error(format!("a quaternion of length {length}"), UNIT_QUATERNION)
        })?;
        let unit_s = *self.unit_s.get_or_insert_with(|| unit_of_date(time));
        let world_from_body = WorldFromBody::new(rotation, Vec3::new(x, y, z));
        self.poses
            .push(PoseRecord::new(time * unit_s, world_from_body));
        Ok(())
    }

    /// The poses, in which a few may be out of the order of time; remarks on rows that were left out and on the unit.
    ///
    /// # Errors
    /// As many poses out of the order of time as in it.
    fn finish(self, input: &Input) -> Result<Vec<PoseRecord>> {
        self.order.finish()?;
        if self.empty > 0 {
            input.remark(format!(
                "rows without a pose (values that are not finite, or a quaternion of zeros) left out: {}, the first in line {}",
                self.empty, self.first_empty
            ));
        }
        match self.unit_s {
            Some(unit_s) if unit_s < 1.0 => {
                input.remark(format!("the times are taken for units of {unit_s:e} s"));
            }
            _ => {}
        }
        Ok(self.poses)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<(Vec<PoseRecord>, Vec<String>)> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, text).unwrap();
        let input = Input::from(&path);
        Ok((crate::format::read_trajectory(&input)?, input.remarks()))
    }

    #[test]
    fn headers_name_the_columns_in_any_order() {
        for header in [
            "# timestamp x y z q_x q_y q_z q_w",
            "num,t,x,y,z,qx,qy,qz,qw",
            "%time x y z qx qy qz qw userfields",
            "#time [s], qw, qx, qy, qz, p_x, p_y, p_z",
        ] {
            let names = Separator::of(header).names(header.trim_start_matches(['#', '%']));
            let separator = if header.contains(',') { "," } else { " " };
            let order = columns(&names).unwrap();
            let mut cells = vec!["9".to_owned(); names.len()];
            for (slot, value) in order.iter().zip([5.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8]) {
                cells[*slot] = value.to_string();
            }
            let (poses, _) = read_text(&format!("{header}\n{}\n", cells.join(separator))).unwrap();
            assert_eq!(poses[0].time_s, 5.0, "{header}");
            let pose = poses[0].world_from_body;
            assert_eq!(pose.translation_m, Vec3::new(1.0, 2.0, 3.0));
            assert_eq!((pose.rotation.k, pose.rotation.w), (0.6, 0.8));
        }
    }

    #[test]
    fn rows_without_a_pose_and_repeated_times_are_left_out_and_said() {
        let text = "1 0 0 0 0 0 0 1\n2 nan nan nan nan nan nan nan\n3 1 1 1 0 0 0 0\n\
                    4 1 0 0 0 0 0 1\n4 1 0 0 0 0 0 1\n5 2 0 0 0 0 0 1\n";
        let (poses, remarks) = read_text(text).unwrap();
        let times_s: Vec<f64> = poses.iter().map(|pose| pose.time_s).collect();
        assert_eq!(times_s, [1.0, 4.0, 5.0]);
        let remarks = remarks.join("\n");
        assert!(
            remarks.contains("left out: 2, the first in line 2"),
            "{remarks}"
        );
        assert!(
            remarks.contains("1 of 4 poses left out: 1 with the time of the pose before"),
            "{remarks}"
        );
        let late = read_text("5 0 0 0 0 0 0 1\n4 1 0 0 0 0 0 1\n").unwrap_err();
        assert!(
            late.to_string()
                .contains("line 2: found time 4 s after 5 s"),
            "{late}"
        );
        let wrong = read_text("1 0 0 0 0 0 0 0.5\n").unwrap_err().to_string();
        assert!(
            wrong.contains("line 1: found a quaternion of length 0.5"),
            "{wrong}"
        );
    }
}
