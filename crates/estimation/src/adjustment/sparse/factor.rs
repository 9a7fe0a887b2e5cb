//! The factor L, solutions and covariances.

use super::dense::{Part, Shape, Target, add_product, cholesky};
use super::inverse::SelectedInverse;
use super::structure::{NotPositiveBlock, Structure};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// The Cholesky factor of normal equations.
#[derive(Debug, Clone)]
pub struct SparseFactor {
    structure: Arc<Structure>,
    /// Of each supernode, column by column.
    values: Vec<Vec<f64>>,
}

impl SparseFactor {
    pub(super) fn new(structure: Arc<Structure>) -> Self {
        let l = &structure.l;
        let entries = |supernode| l.height(supernode) * l.pivots(supernode).len();
        let values = (0..l.count()).map(|s| vec![0.0; entries(s)]).collect();
        Self { structure, values }
    }

    pub(super) fn has_structure(&self, structure: &Arc<Structure>) -> bool {
        Arc::ptr_eq(&self.structure, structure)
    }

    pub(super) fn factorise(&mut self, h: &[f64]) -> Result<(), NotPositiveBlock> {
        let structure = &*self.structure;
        for level in structure.l.levels() {
            let mut panels: Vec<(usize, Vec<f64>)> = level
                .iter()
                .map(|&s| (s, std::mem::take(&mut self.values[s])))
                .collect();
            let failed = panels.par_iter_mut().map_init(
                Workspace::default,
                |workspace, (supernode, panel)| {
                    workspace
                        .eliminate(structure, &self.values, h, *supernode, panel)
                        .err()
                },
            );
            let failed = failed.flatten().min();
            for (supernode, panel) in panels {
                self.values[supernode] = panel;
            }
            if let Some(scalar) = failed {
                return Err(NotPositiveBlock(structure.block_of(scalar)));
            }
        }
        Ok(())
    }

    /// Number of scalars.
    pub fn unknowns(&self) -> usize {
        self.structure.unknowns()
    }

    /// H⁻¹ times `count` right-hand sides, one after the other.
    pub fn solve(&self, sides: &mut [f64], count: usize) {
        let mut ordered = self.ordered(sides, count);
        let unknowns = self.unknowns().max(1);
        ordered
            .par_chunks_mut(unknowns)
            .for_each(|side| self.solve_ordered(side));
        for (side, ordered) in self.columns_mut(sides).zip(self.columns(&ordered)) {
            for (value, &place) in side.iter_mut().zip(&self.structure.place) {
                *value = ordered[place];
            }
        }
    }

    /// The squared length of a step d of the last unknowns in the order of elimination, such as those that couple with
    /// nearly everything, in their standard deviations: |Mᵀ d|², where M is the last rows and columns of L, because M Mᵀ
    /// is the inverse of their covariance.
    pub fn last_squared_length(&self, step: &[f64]) -> f64 {
        let structure = &*self.structure;
        let first = self.unknowns() - step.len();
        let l = &structure.l;
        let supernodes = (0..l.count()).rev();
        let mut sum = 0.0;
        for supernode in supernodes.take_while(|&s| l.pivots(s).end > first) {
            let (pivots, height) = (l.pivots(supernode), l.height(supernode));
            let values = &self.values[supernode];
            let (front, front_row) = l.front(supernode);
            for column in first.max(pivots.start)..pivots.end {
                let values = &values[(column - pivots.start) * height..][..height];
                let mut product = 0.0;
                for (&position, &row) in front.iter().zip(front_row) {
                    let start = structure.start[position as usize];
                    for i in 0..structure.size(position as usize) {
                        if start + i >= column {
                            product += values[row as usize + i] * step[start + i - first];
                        }
                    }
                }
                sum += product * product;
            }
        }
        sum
    }

    /// H⁻¹ where L has entries, in the columns of the requested blocks. Much of the work falls on the blocks that
    /// are eliminated first, which are seldom requested.
    pub fn selected_inverse(&self, is_requested: impl Fn(usize) -> bool) -> SelectedInverse {
        SelectedInverse::new(&self.structure, &self.values, &is_requested)
    }

    /// L⁻ᵀ L⁻¹ times a right-hand side in the order of elimination.
    fn solve_ordered(&self, side: &mut [f64]) {
        let structure = &*self.structure;
        let l = &structure.l;
        let mut others = Vec::new();
        for supernode in 0..l.count() {
            let (pivots, height) = (l.pivots(supernode), l.height(supernode));
            others.clear();
            others.resize(height - pivots.len(), 0.0);
            for (j, column) in self.values[supernode].chunks_exact(height).enumerate() {
                let own = &mut side[pivots.start + j..pivots.end];
                own[0] /= column[j];
                let value = own[0];
                let (of_own, of_others) = column.split_at(pivots.len());
                for (sum, l) in own[1..].iter_mut().zip(&of_own[j + 1..]) {
                    *sum -= l * value;
                }
                for (sum, l) in others.iter_mut().zip(of_others) {
                    *sum += l * value;
                }
            }
            for (place, row) in structure.rows_below(supernode) {
                let (to, from) = (&mut side[place.clone()], &others[row..][..place.len()]);
                to.iter_mut().zip(from).for_each(|(to, from)| *to -= from);
            }
        }
        for supernode in (0..l.count()).rev() {
            let (pivots, height) = (l.pivots(supernode), l.height(supernode));
            others.clear();
            others.resize(height - pivots.len(), 0.0);
            for (place, row) in structure.rows_below(supernode) {
                others[row..][..place.len()].copy_from_slice(&side[place]);
            }
            let columns = self.values[supernode].chunks_exact(height).enumerate();
            for (j, column) in columns.rev() {
                let own = &mut side[pivots.start + j..pivots.end];
                let (of_own, of_others) = column.split_at(pivots.len());
                let by_own = dot(&of_own[j + 1..], &own[1..]);
                own[0] = (own[0] - by_own - dot(of_others, &others)) / column[j];
            }
        }
    }

    fn columns<'a>(&self, sides: &'a [f64]) -> std::slice::ChunksExact<'a, f64> {
        sides.chunks_exact(self.unknowns().max(1))
    }

    fn columns_mut<'a>(&self, sides: &'a mut [f64]) -> std::slice::ChunksExactMut<'a, f64> {
        sides.chunks_exact_mut(self.unknowns().max(1))
    }

    /// Right-hand sides in the order of elimination.
    fn ordered(&self, sides: &[f64], count: usize) -> Vec<f64> {
        assert_eq!(
            sides.len(),
            self.unknowns() * count,
            "one value for each unknown and right-hand side"
        );
        let mut ordered = vec![0.0; sides.len()];
        for (ordered, side) in self.columns_mut(&mut ordered).zip(self.columns(sides)) {
            for (&place, value) in self.structure.place.iter().zip(side) {
                ordered[place] = *value;
            }
        }
        ordered
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// What the elimination of a supernode needs beside its values.
#[derive(Default)]
struct Workspace {
    runs: Vec<Range<usize>>,
    product: Vec<f64>,
}

impl Workspace {
    /// Computes the values of a supernode from H and from those on which it depends.
    ///
    /// # Errors
    /// The scalar whose pivot is not positive or not finite.
    fn eliminate(
        &mut self,
        structure: &Structure,
        values: &[Vec<f64>],
        h: &[f64],
        supernode: usize,
        panel: &mut [f64],
    ) -> Result<(), usize> {
        let Self { runs, product } = self;
        let l = &structure.l;
        let (pivots, height) = (l.pivots(supernode), l.height(supernode));
        panel.fill(0.0);
        let mut columns = panel.chunks_exact_mut(height);
        let (front, _) = l.front(supernode);
        let positions = front.iter().map(|&position| position as usize);
        for position in positions.take_while(|&position| l.of(position) == supernode) {
            l.runs(supernode, structure.coupled(position), runs);
            let of_h = h[structure.columns(position)].chunks_exact(structure.height(position));
            for (from, to) in of_h.zip(&mut columns) {
                let mut rest = from;
                for run in &*runs {
                    let (values, others) = rest.split_at(run.len());
                    to[run.clone()].copy_from_slice(values);
                    rest = others;
                }
            }
        }
        for update in l.updates(supernode) {
            let from = update.from as usize;
            let (positions, rows) = l.front(from);
            let (first, end) = (update.first as usize, update.end as usize);
            let (from_height, inner) = (l.height(from), l.pivots(from).len());
            let top = rows[first] as usize;
            let (count, columns) = (from_height - top, rows[end] as usize - top);
            let a = Part::of(&values[from][top..], from_height);
            product.resize(product.len().max(count * columns), 0.0);
            let target = Target {
                data: &mut product[..count * columns],
                height: count,
                rows: count,
                columns,
                shape: Shape::Lower,
            };
            add_product(0.0, target, 1.0, a, a.transpose(), inner);
            l.runs(supernode, &positions[first..], runs);
            let own = runs.iter().cloned().flatten();
            for (k, (column, product)) in own
                .zip(product.chunks_exact(count))
                .take(columns)
                .enumerate()
            {
                let to = &mut panel[column * height..][..height];
                let mut begin = 0;
                for run in &*runs {
                    // Nothing is computed above the diagonal.
                    let skipped = k.saturating_sub(begin).min(run.len());
                    let to = &mut to[run.start + skipped..run.end];
                    for (to, from) in to.iter_mut().zip(&product[begin + skipped..]) {
                        *to -= from;
                    }
                    begin += run.len();
                }
            }
        }
        cholesky(panel, height, 0, pivots.len()).map_err(|column| pivots.start + column)
    }
}
