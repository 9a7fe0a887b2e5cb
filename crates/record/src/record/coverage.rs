//! On which courses each scanner crossed the boards.

use crate::geometry::heading::heading_rad;
use crate::geometry::{BodyFromScanner, Vec3, WorldFromBody};
use crate::project::Project;

use super::field::Board;

/// Range of a scanner, metres.
const REACH_M: f64 = 3.0;
/// Names of the directions in which the platform drives past.
const COURSES: [&str; 8] = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];

/// The courses on which the scanners crossed a board.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardCoverage {
    /// The board.
    pub board: String,
    /// Name of each scanner, and the courses on which its fan crossed the board.
    pub courses: Vec<(String, Vec<&'static str>)>,
}

/// The boards, and on which courses each scanner's fan crossed them.
pub(super) struct Coverage {
    boards: Vec<Board>,
    scanners: Vec<(String, BodyFromScanner)>,
    /// For each board, scanner and course: whether the fan crossed the board.
    crossed: Vec<Vec<[bool; 8]>>,
}

impl Coverage {
    pub(super) fn new(boards: &[Board], project: &Project) -> Self {
        let scanners = project.scanners.iter();
        let scanners: Vec<_> = scanners
            .map(|scanner| (scanner.name.clone(), scanner.body_from_scanner))
            .collect();
        Self {
            crossed: vec![vec![[false; 8]; scanners.len()]; boards.len()],
            boards: boards.to_vec(),
            scanners,
        }
    }

    /// Adds a pose in the project's world: a fan, which is the x-z plane of its scanner, crosses a board if it passes
    /// the board's centre by no more than half the board's size.
    pub(super) fn add(&mut self, world_from_body: &WorldFromBody) {
        let turns: f64 = heading_rad(&world_from_body.rotation) / std::f64::consts::TAU;
        let course = f64::rem_euclid((8.0 * turns).round(), 8.0) as usize % 8;
        for (board, crossed) in self.boards.iter().zip(&mut self.crossed) {
            for ((_, body_from_scanner), crossed) in self.scanners.iter().zip(crossed) {
                let world_from_scanner = *world_from_body * *body_from_scanner;
                let at_m: Vec3 = world_from_scanner.inverse().map(&board.position_m);
                crossed[course] |= at_m.y.abs() <= 0.5 * board.size_m && at_m.norm() <= REACH_M;
            }
        }
    }

    /// The courses on which each board was crossed so far.
    pub(super) fn boards(&self) -> Vec<BoardCoverage> {
        let boards = self.boards.iter().zip(&self.crossed);
        let boards = boards.map(|(board, crossed)| BoardCoverage {
            board: board.name.clone(),
            courses: self
                .scanners
                .iter()
                .zip(crossed)
                .map(|((name, _), crossed)| {
                    let courses = COURSES.iter().zip(crossed).filter(|(_, is)| **is);
                    (name.clone(), courses.map(|(name, _)| *name).collect())
                })
                .collect(),
        });
        boards.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BodyAxes, Rotation};

    #[test]
    fn a_board_is_covered_on_the_courses_on_which_the_fan_crosses_it() {
        let board = Board {
            name: "a".into(),
            position_m: Vec3::new(10.0, 20.0, 0.0),
            size_m: 0.5,
        };
        // A fan across the track, half a metre ahead: x of the scanner to the right, y backwards, z up.
        let turned = Rotation::from_matrix(&nalgebra::Matrix3::new(
            0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
        ));
        let mounting = BodyFromScanner::new(turned, Vec3::new(0.5, 0.0, -1.0));
        let mut coverage = Coverage {
            boards: vec![board],
            scanners: vec![("left".into(), mounting)],
            crossed: vec![vec![[false; 8]; 1]],
        };
        let mut drive = |heading: f64, from: f64, to: f64| {
            for i in 0..=40 {
                let along = from + (to - from) * f64::from(i) / 40.0;
                let rotation = BodyAxes::Frd.level_world_from_body(heading);
                let at = Vec3::new(10.0, 20.0, 1.5)
                    + Vec3::new(heading.sin(), heading.cos(), 0.0) * along;
                coverage.add(&WorldFromBody::new(rotation, at));
            }
            coverage.boards()[0].courses[0].1.clone()
        };
        // The drive ends early: the fan stops 1.5 m before the board.
        assert!(drive(0.0, -5.0, -2.0).is_empty());
        assert_eq!(drive(0.0, -2.0, 2.0), ["N"]);
        assert_eq!(drive(std::f64::consts::FRAC_PI_2, -2.0, 2.0), ["N", "E"]);
    }
}
