//! The factor L, solutions and covariances.

use super::dense::{Part, Shape, Target, add_product, cholesky};
use super::inverse::SelectedInverse;
use super::lists::Lists;
use super::structure::{NotPositiveBlock, Structure};
use super::supernodes::RowRun;
use rayon::prelude::*;
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
                    let elimination = Elimination {
                        structure,
                        values: &self.values,
                        supernode: *supernode,
                    };
                    elimination.run(h, panel, workspace).err()
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

/// Columns of a supernode that are computed together, by one thread.
const TILE: usize = 64;

/// What the elimination of a supernode needs beside its values.
#[derive(Default)]
struct Workspace {
    /// Where the rows of H lie in the supernode, position by position.
    runs_of_h: Vec<RowRun>,
    /// Where the rows of each update lie in it.
    runs: Lists<RowRun>,
    product: Vec<f64>,
}

/// The elimination of a supernode.
struct Elimination<'a> {
    structure: &'a Structure,
    /// The values of earlier supernodes.
    values: &'a [Vec<f64>],
    supernode: usize,
}

impl Elimination<'_> {
    /// Computes the values of the supernode from H and from those on which it depends.
    ///
    /// # Errors
    /// The scalar whose pivot is not positive or not finite.
    fn run(&self, h: &[f64], panel: &mut [f64], workspace: &mut Workspace) -> Result<(), usize> {
        let Workspace {
            runs_of_h,
            runs,
            product,
        } = workspace;
        let l = &self.structure.l;
        let (pivots, height) = (l.pivots(self.supernode), l.height(self.supernode));
        self.fill(h, panel, runs_of_h);
        runs.clear();
        for update in l.updates(self.supernode) {
            let (positions, rows) = l.front(update.from as usize);
            let first = update.first as usize;
            let begin = rows[first] as usize;
            runs.push_with(|all| {
                l.append_runs(self.supernode, &positions[first..], begin, all);
            });
        }
        if pivots.len() > TILE {
            let tiles = panel.par_chunks_mut(TILE * height).enumerate();
            tiles.for_each_init(Vec::new, |product, (at, tile)| {
                self.update(at * TILE, tile, runs, product);
            });
        } else {
            self.update(0, panel, runs, product);
        }
        cholesky(panel, height, 0, pivots.len()).map_err(|column| pivots.start + column)
    }

    /// The columns of H.
    fn fill(&self, h: &[f64], panel: &mut [f64], runs: &mut Vec<RowRun>) {
        let (structure, l) = (self.structure, &self.structure.l);
        panel.fill(0.0);
        let mut columns = panel.chunks_exact_mut(l.height(self.supernode));
        let (front, _) = l.front(self.supernode);
        let positions = front.iter().map(|&position| position as usize);
        for position in positions.take_while(|&position| l.of(position) == self.supernode) {
            runs.clear();
            l.append_runs(self.supernode, structure.coupled(position), 0, runs);
            let of_h = h[structure.columns(position)].chunks_exact(structure.height(position));
            for (from, to) in of_h.zip(&mut columns) {
                for run in &*runs {
                    to[run.rows()].copy_from_slice(&from[run.begin..run.end]);
                }
            }
        }
    }

    /// Subtracts the products of earlier supernodes from a tile, which begins with column `first`.
    fn update(&self, first: usize, tile: &mut [f64], runs: &Lists<RowRun>, product: &mut Vec<f64>) {
        let l = &self.structure.l;
        let height = l.height(self.supernode);
        let end = first + tile.len() / height;
        for (i, update) in l.updates(self.supernode).iter().enumerate() {
            let runs = runs.get(i);
            let runs = &runs[runs.partition_point(|run| run.rows().end <= first)..];
            let own = &runs[..runs.partition_point(|run| run.to < end)];
            let (Some(top), Some(bottom)) = (own.first(), own.last()) else {
                continue;
            };
            let top = top.begin + first.saturating_sub(top.to);
            let bottom = bottom.end.min(bottom.begin + end - bottom.to);
            let from = update.from as usize;
            let (from_height, inner) = (l.height(from), l.pivots(from).len());
            let (count, columns) = (from_height - top, bottom - top);
            let a = Part::of(&self.values[from][top..], from_height);
            product.resize(product.len().max(count * columns), 0.0);
            let target = Target {
                data: &mut product[..count * columns],
                height: count,
                rows: count,
                columns,
                shape: Shape::Lower,
            };
            add_product(0.0, target, 1.0, a, a.transpose(), inner);
            for (at, run) in own.iter().enumerate() {
                for row in run.begin.max(top)..run.end.min(bottom) {
                    let column = run.to + row - run.begin - first;
                    let to = &mut tile[column * height..][..height];
                    let product = &product[(row - top) * count..][row - top..count];
                    subtract_from_diagonal(to, row, product, &runs[at..]);
                }
            }
        }
    }
}

/// Subtracts a column of a product from a column of a supernode. The product begins with its diagonal, row `diagonal` of the
/// matrix whose runs these are, the first of which contains it; nothing is computed above.
fn subtract_from_diagonal(column: &mut [f64], diagonal: usize, product: &[f64], runs: &[RowRun]) {
    for run in runs {
        let begin = run.begin.max(diagonal);
        let to = &mut column[run.to + begin - run.begin..];
        let from = &product[begin - diagonal..run.end - diagonal];
        for (to, from) in to.iter_mut().zip(from) {
            *to -= from;
        }
    }
}
