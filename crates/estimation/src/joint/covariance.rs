//! Covariance of all unknowns, with what the normal equations do not know of.

use nalgebra::{DMatrix, DVector};

use super::followed::Followed;
use super::problem::JointProblem;
use super::row::Row;
use super::slow::SlowMotions;
use super::state::State;
use crate::adjustment::SelectedInverse;

/// Covariance H⁻¹ of selected unknowns, plus terms from changes of all unknowns.
pub struct Covariance<'a> {
    pub problem: &'a JointProblem<'a>,
    pub inverse: SelectedInverse,
    /// Changes whose squares are added: with the height of the reference and directions of the mountings, which
    /// are held, and with noise of slopes.
    pub changes: Vec<Vec<f64>>,
    /// Motions of mountings with which all unknowns change.
    pub slow: &'a SlowMotions,
}

impl<'a> Covariance<'a> {
    /// Of all unknowns but those of the surface, with the factor that the problem holds, at this state. `None` without it.
    pub fn of(problem: &'a JointProblem<'a>, state: &State, slow: &'a SlowMotions) -> Option<Self> {
        let layout = &problem.layout;
        let surface = layout.first_surfel..layout.first_plane + state.planes.len();
        let factor = problem.factor()?;
        let mut changes: Vec<Vec<f64>> = problem.side_of_height().into_iter().collect();
        changes.extend(problem.sides_of_held(state));
        if let Some(mountings) = Followed::of(problem, state) {
            changes.extend(problem.sides_of_slopes(state, &mountings));
            changes.extend(problem.sides_of_places(state, &mountings));
        }
        Some(Self {
            problem,
            inverse: factor.selected_inverse(|block| !surface.contains(&block)),
            changes,
            slow,
        })
    }

    /// Covariance of two blocks of unknowns; `None` if no row couples them.
    pub fn block(&self, a: usize, b: usize) -> Option<DMatrix<f64>> {
        let mut part = self.inverse.block(a, b)?;
        let (rows, columns) = part.shape();
        let (row, column) = (self.problem.offset(a), self.problem.offset(b));
        for change in &self.changes {
            let segment =
                |first: usize, count| DVector::from_column_slice(&change[first..][..count]);
            part += segment(row, rows) * segment(column, columns).transpose();
        }
        for drive in &self.slow.drives {
            let follow = &drive.held.follow;
            let mut scaled = follow.columns(column, columns).into_owned();
            for mut by_value in scaled.column_iter_mut() {
                by_value.component_mul_assign(&drive.variance);
            }
            part += follow.columns(row, rows).tr_mul(&scaled);
        }
        Some(part)
    }

    /// The variance j P jᵀ of a row of a drive with the derivatives j, also by the slow motions of this drive; `None` if
    /// no row couples its blocks.
    pub fn of_row(&self, row: &Row<'_>, drive: usize) -> Option<f64> {
        let (mut by, mut parts) = (row.by, Vec::new());
        for &block in row.blocks {
            // A coefficient of a motion is no unknown.
            let size = self.problem.layout.sizes.get(block as usize);
            let (of_block, others) = by.split_at(*size.unwrap_or(&1));
            by = others;
            if size.is_some() {
                parts.push((block as usize, DVector::from_column_slice(of_block)));
            }
        }
        let mut sum = 0.0;
        for (i, (a, by_a)) in parts.iter().enumerate() {
            sum += by_a.dot(&(self.inverse.block(*a, *a)? * by_a));
            for (b, by_b) in &parts[..i] {
                sum += 2.0 * by_a.dot(&(self.inverse.block(*a, *b)? * by_b));
            }
        }
        let mut places = Vec::new();
        self.problem.places(row, &mut places);
        let unknowns = self.problem.unknowns();
        let along = |change: &Vec<f64>| {
            let by = places.iter().zip(row.by);
            by.map(|(place, by)| by * change.get(*place).unwrap_or(&0.0))
                .sum::<f64>()
        };
        sum += self.changes.iter().map(|c| along(c).powi(2)).sum::<f64>();
        for slow in &self.slow.drives {
            let mut along = DVector::zeros(slow.variance.len());
            for (&place, &by) in places.iter().zip(row.by) {
                match place.checked_sub(unknowns) {
                    None => along.axpy(by, &slow.held.follow.column(place), 1.0),
                    Some(value) if slow.drive == drive => along[value] += by,
                    Some(_) => {}
                }
            }
            sum += along.component_mul(&along).dot(&slow.variance);
        }
        Some(sum)
    }
}
