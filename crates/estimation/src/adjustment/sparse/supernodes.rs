//! The pattern of L in supernodes: neighbouring columns with the same rows, which are stored and worked on as one dense
//! matrix (Ng & Peyton 1993).

use super::lists::{Lists, sums};
use std::ops::Range;

/// A supernode is merged with the next if L has at most so many columns in both, and this share of entries that are zero
/// (Ashcraft & Grimes 1989, with the numbers of CHOLMOD: Chen et al. 2008).
const RELAXED: [(usize, f64); 4] = [(4, 1.0), (16, 0.8), (48, 0.1), (usize::MAX, 0.05)];

/// Rows of an earlier supernode that change a later one.
#[derive(Debug, Clone, Copy)]
pub struct Update {
    /// The earlier supernode.
    pub from: u32,
    /// The first of its rows that are columns of the later one, among its positions.
    pub first: u32,
}

/// Rows of a matrix that are neighbours in a supernode, too.
#[derive(Debug, Default, Clone, Copy)]
pub struct RowRun {
    /// The first row in the matrix, and the row after the last.
    pub begin: usize,
    pub end: usize,
    /// The first row in the supernode.
    pub to: usize,
}

impl RowRun {
    /// The rows in the supernode.
    pub fn rows(&self) -> Range<usize> {
        self.to..self.to + self.end - self.begin
    }
}

/// The supernodes of L.
#[derive(Debug)]
pub struct Supernodes {
    /// First scalar of each supernode, and the number of scalars.
    begin: Vec<usize>,
    /// The supernode of each position.
    of: Vec<usize>,
    /// Positions in the rows of each supernode, its own first.
    front: Lists<u32>,
    /// For each of `front`, its first row in the supernode; then the number of rows.
    front_row: Lists<u32>,
    /// What changes each supernode, ascending.
    updates: Lists<Update>,
    /// Supernodes that do not depend on each other, and only on those of earlier levels.
    levels: Vec<Vec<usize>>,
}

impl Supernodes {
    /// From the positions that H couples with each position, from itself on, ascending, and the first scalar of each
    /// position, then the number of scalars.
    pub fn new(rows: &Lists<u32>, start: &[usize]) -> Self {
        let mut of = vec![0; start.len() - 1];
        let mut begin = vec![0];
        let (mut front, mut front_row) = (Vec::new(), Vec::new());
        for (supernode, run) in merged(fundamental(rows), start).into_iter().enumerate() {
            of[run.positions.clone()].fill(supernode);
            begin.push(start[run.positions.end]);
            let own = run.positions.start as u32..run.positions.end as u32;
            let positions: Vec<u32> = own.chain(run.below).collect();
            let sizes = positions
                .iter()
                .map(|&p| start[p as usize + 1] - start[p as usize]);
            front_row.push(sums(sizes).into_iter().map(|row| row as u32).collect());
            front.push(positions);
        }
        let updates = updates(&front, &of);
        let levels = levels(&updates);
        Self {
            begin,
            of,
            front: front.into_iter().collect(),
            front_row: front_row.into_iter().collect(),
            updates: updates.into_iter().collect(),
            levels,
        }
    }

    /// Number of supernodes.
    pub fn count(&self) -> usize {
        self.begin.len() - 1
    }

    /// The scalars that a supernode eliminates.
    pub fn pivots(&self, supernode: usize) -> Range<usize> {
        self.begin[supernode]..self.begin[supernode + 1]
    }

    /// The supernode of a position.
    pub fn of(&self, position: usize) -> usize {
        self.of[position]
    }

    /// Number of rows of a supernode.
    pub fn height(&self, supernode: usize) -> usize {
        self.front_row
            .get(supernode)
            .last()
            .map_or(0, |&rows| rows as usize)
    }

    /// Number of entries that L stores, zeros of merged supernodes included.
    pub fn entries(&self) -> usize {
        (0..self.count())
            .map(|s| self.height(s) * self.pivots(s).len())
            .sum()
    }

    /// Number of multiplications that compute L: half the square of the height of each column.
    pub fn products(&self) -> f64 {
        let heights = (0..self.count()).flat_map(|s| {
            let columns = 0..self.pivots(s).len();
            columns.map(move |column| self.height(s) - column)
        });
        heights.map(|height| 0.5 * (height as f64).powi(2)).sum()
    }

    /// Positions in the rows of a supernode, ascending, and their first rows in it, then the number of rows.
    pub fn front(&self, supernode: usize) -> (&[u32], &[u32]) {
        (self.front.get(supernode), self.front_row.get(supernode))
    }

    /// Appends where the rows of a matrix lie in a supernode: those of positions (ascending) that must all be among its
    /// rows, from row `begin` of the matrix on.
    pub fn append_runs(
        &self,
        supernode: usize,
        positions: &[u32],
        mut begin: usize,
        runs: &mut Vec<RowRun>,
    ) {
        let (front, front_row) = self.front(supernode);
        let first = runs.len();
        let mut at = 0;
        for &position in positions {
            while front[at] != position {
                at += 1;
            }
            let (to, to_end) = (front_row[at] as usize, front_row[at + 1] as usize);
            let end = begin + to_end - to;
            match runs[first..].last_mut() {
                Some(run) if run.rows().end == to => run.end = end,
                _ => runs.push(RowRun { begin, end, to }),
            }
            begin = end;
        }
    }

    /// What changes a supernode.
    pub fn updates(&self, supernode: usize) -> &[Update] {
        self.updates.get(supernode)
    }

    /// Supernodes that do not depend on each other, and only on those of earlier levels.
    pub fn levels(&self) -> &[Vec<usize>] {
        &self.levels
    }
}

/// Positions of a supernode.
struct Run {
    positions: Range<usize>,
    /// Positions of its rows below its own, ascending.
    below: Vec<u32>,
    /// Zeros among its entries, because it was merged.
    zeros: usize,
}

/// Supernodes without zeros.
fn fundamental(rows: &Lists<u32>) -> Vec<Run> {
    let count = rows.count();
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); count];
    // The rows of L in the columns of a position: those of H, and those of its children, which its elimination couples.
    let mut below: Vec<Vec<u32>> = Vec::with_capacity(count);
    let mut marked = vec![u32::MAX; count];
    let mut runs = Vec::new();
    let mut first = 0;
    let run = |positions: Range<usize>, below: &[u32]| Run {
        positions,
        below: below.to_vec(),
        zeros: 0,
    };
    for position in 0..count {
        let mark = position as u32;
        marked[position] = mark;
        let mut list = Vec::new();
        let of_children = children[position].iter().flat_map(|&child| &below[child]);
        for &row in rows.get(position).iter().chain(of_children) {
            if marked[row as usize] != mark {
                marked[row as usize] = mark;
                list.push(row);
            }
        }
        list.sort_unstable();
        if let Some(before) = below.last() {
            let continues = before.first() == Some(&mark) && before.len() == list.len() + 1;
            if !continues {
                runs.push(run(first..position, before));
                first = position;
            }
        }
        for child in std::mem::take(&mut children[position]) {
            below[child] = Vec::new();
        }
        if let Some(&parent) = list.first() {
            children[parent as usize].push(position);
        }
        below.push(list);
    }
    if let Some(last) = below.last() {
        runs.push(run(first..count, last));
    }
    runs
}

/// Merges supernodes with the next one, on which they depend.
fn merged(runs: Vec<Run>, start: &[usize]) -> Vec<Run> {
    let columns = |run: &Run| start[run.positions.end] - start[run.positions.start];
    let rows_below = |run: &Run| -> usize {
        let sizes = run
            .below
            .iter()
            .map(|&p| start[p as usize + 1] - start[p as usize]);
        sizes.sum()
    };
    let mut all: Vec<Run> = Vec::new();
    for mut run in runs {
        let (mut own, rows) = (columns(&run), rows_below(&run));
        while let Some(before) = all.last() {
            let first_below = before.below.first();
            if first_below.is_none_or(|&row| row as usize >= run.positions.end) {
                break;
            }
            let theirs = columns(before);
            let zeros = before.zeros + run.zeros + theirs * (own + rows - rows_below(before));
            let both = own + theirs;
            let entries = both * (both + 1) / 2 + both * rows;
            let share = zeros as f64 / entries as f64;
            let is_allowed = RELAXED
                .iter()
                .any(|&(most, zero)| both <= most && share <= zero);
            if !is_allowed {
                break;
            }
            run.positions.start = before.positions.start;
            run.zeros = zeros;
            own = both;
            all.pop();
        }
        all.push(run);
    }
    all
}

/// For each supernode the earlier ones that change it.
fn updates(front: &[Vec<u32>], of: &[usize]) -> Vec<Vec<Update>> {
    let mut updates = vec![Vec::new(); front.len()];
    for (from, positions) in front.iter().enumerate() {
        let mut first = positions.partition_point(|&position| of[position as usize] == from);
        while first < positions.len() {
            let to = of[positions[first] as usize];
            updates[to].push(Update {
                from: from as u32,
                first: first as u32,
            });
            first += positions[first..].partition_point(|&position| of[position as usize] == to);
        }
    }
    updates
}

fn levels(updates: &[Vec<Update>]) -> Vec<Vec<usize>> {
    let mut level = vec![0; updates.len()];
    let mut levels: Vec<Vec<usize>> = Vec::new();
    for (supernode, updates) in updates.iter().enumerate() {
        let earlier = updates.iter().map(|update| level[update.from as usize] + 1);
        level[supernode] = earlier.max().unwrap_or(0);
        levels.resize_with(levels.len().max(level[supernode] + 1), Vec::new);
        levels[level[supernode]].push(supernode);
    }
    levels
}
