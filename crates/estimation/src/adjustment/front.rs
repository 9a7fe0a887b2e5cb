//! Elimination one front at a time, for the batch and for online use.

use super::layout::{CHANGE, NODE, SEGMENT, STEP, TAIL};
use super::prior::Prior;
use super::system::StepSystem;

/// The rows of U of one front (P pivots, N − P separator columns) and their part of y = U⁻ᵀ g.
/// Only the upper triangle of the pivots is used. Aligned to cache lines.
#[derive(Debug, Clone, PartialEq)]
#[repr(align(64))]
pub struct Front<const P: usize, const N: usize> {
    pub rows: [[f64; N]; P],
    pub y: [f64; P],
}

/// Pivots node i; separator node i + 1, segment.
pub type StepFront = Front<NODE, STEP>;
/// Pivots old segment; separator node, new segment.
pub type ChangeFront = Front<SEGMENT, CHANGE>;
/// Pivots last node and segment.
pub type TailFront = Front<TAIL, TAIL>;

impl<const P: usize, const N: usize> Front<P, N> {
    pub const ZERO: Self = Self {
        rows: [[0.0; N]; P],
        y: [0.0; P],
    };

    fn keep(&mut self, h: &[[f64; N]; N], g: &[f64; N]) {
        self.rows.copy_from_slice(&h[..P]);
        self.y.copy_from_slice(&g[..P]);
    }
}

/// Normal equations of (node, segment) carried over from the previous fronts; upper triangle.
#[derive(Debug, Clone, PartialEq)]
pub struct Carry {
    pub h: [[f64; TAIL]; TAIL],
    pub g: [f64; TAIL],
}

/// The place of unknown `a` of (node, segment) in a step's front.
pub fn step_place(a: usize) -> usize {
    if a < NODE { a } else { a + NODE }
}

/// The place of unknown `a` of (node, old segment) in the front of a change of segment.
pub fn change_place(a: usize) -> usize {
    if a < NODE { SEGMENT + a } else { a - NODE }
}

impl Carry {
    /// The carry before the first step.
    pub fn new(prior: &Prior<TAIL>) -> Self {
        let mut h = [[0.0; TAIL]; TAIL];
        for (a, weight) in prior.weight.iter().enumerate() {
            h[a][a] = *weight;
        }
        Self { h, g: prior.g() }
    }

    /// Adds the carry over (node i, segment) to the system of step i, eliminates node i and carries
    /// on to (node i + 1, segment). Overwrites `system`. Returns false if node i is not determined; the
    /// carry is then unchanged.
    #[must_use]
    pub fn eliminate_step(
        &mut self,
        system: &mut StepSystem,
        damping: &[f64; TAIL],
        front: &mut StepFront,
    ) -> bool {
        for a in 0..TAIL {
            let row = &mut system.h[step_place(a)];
            for b in a..TAIL {
                row[step_place(b)] += self.h[a][b];
            }
            system.g[step_place(a)] += self.g[a];
        }
        for (a, damping) in damping[..NODE].iter().enumerate() {
            system.h[a][a] += damping;
        }
        if !eliminate::<NODE, STEP>(&mut system.h, &mut system.g) {
            return false;
        }
        front.keep(&system.h, &system.g);
        for a in 0..TAIL {
            self.h[a].copy_from_slice(&system.h[NODE + a][NODE..]);
            self.g[a] = system.g[NODE + a];
        }
        true
    }

    /// Eliminates the old segment from the carry over (node, old segment) and leaves (node, new
    /// segment); `walk` ties the two segments, with the deviation new − old. Returns false if the old
    /// segment is not determined; the carry is then unchanged.
    #[must_use]
    pub fn change_segment(
        &mut self,
        walk: &Prior<SEGMENT>,
        damping: &[f64; TAIL],
        front: &mut ChangeFront,
    ) -> bool {
        // Order: old segment, node, new segment.
        let mut h = [[0.0; CHANGE]; CHANGE];
        let mut g = [0.0; CHANGE];
        for a in 0..TAIL {
            for b in a..TAIL {
                let (i, j) = (change_place(a), change_place(b));
                h[i.min(j)][i.max(j)] = self.h[a][b];
            }
            g[change_place(a)] = self.g[a];
        }
        for a in 0..SEGMENT {
            let w = walk.weight[a];
            h[a][a] += w + damping[NODE + a];
            h[a][TAIL + a] = -w;
            h[TAIL + a][TAIL + a] = w;
            g[a] += w * walk.miss[a];
            g[TAIL + a] = -w * walk.miss[a];
        }
        if !eliminate::<SEGMENT, CHANGE>(&mut h, &mut g) {
            return false;
        }
        front.keep(&h, &g);
        for a in 0..TAIL {
            self.h[a].copy_from_slice(&h[SEGMENT + a][SEGMENT..]);
            self.g[a] = g[SEGMENT + a];
        }
        true
    }

    /// Adds the normal equations of records at the carry's node; they must not touch node i + 1.
    pub fn add_newest(&mut self, system: &StepSystem) {
        for a in 0..TAIL {
            for b in a..TAIL {
                self.h[a][b] += system.h[step_place(a)][step_place(b)];
            }
            self.g[a] += system.g[step_place(a)];
        }
    }

    /// Eliminates the last node and segment. Returns false if they are not determined.
    #[must_use]
    pub fn eliminate_tail(&self, damping: &[f64; TAIL], front: &mut TailFront) -> bool {
        front.rows = self.h;
        front.y = self.g;
        for (a, damping) in damping.iter().enumerate() {
            front.rows[a][a] += damping;
        }
        eliminate::<TAIL, TAIL>(&mut front.rows, &mut front.y)
    }
}

/// Eliminates the first P of N unknowns in place: rows 0..P become rows of U, the rest the Schur
/// complement. Upper triangles. Returns false if a pivot is not positive.
fn eliminate<const P: usize, const N: usize>(h: &mut [[f64; N]; N], g: &mut [f64; N]) -> bool {
    for k in 0..P {
        let pivot = h[k][k];
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        let inverse = 1.0 / pivot.sqrt();
        h[k].iter_mut().for_each(|x| *x *= inverse);
        let row = h[k];
        g[k] *= inverse;
        let y = g[k];
        for i in k + 1..N {
            let factor = row[i];
            // From the multiple of 4 below i: whole vectors, the entries left of i are not used.
            let start = i & !3;
            for (x, r) in h[i][start..].iter_mut().zip(&row[start..]) {
                *x -= factor * r;
            }
            g[i] -= factor * y;
        }
    }
    true
}

/// Completes `x`, whose last N − P entries are known, by solving U x = y.
pub fn solve_rows<const P: usize, const N: usize>(
    rows: &[[f64; N]; P],
    y: &[f64; P],
    mut x: [f64; N],
) -> [f64; N] {
    for a in (0..P).rev() {
        let sum: f64 = (a + 1..N).map(|b| rows[a][b] * x[b]).sum();
        x[a] = (y[a] - sum) / rows[a][a];
    }
    x
}

/// One front of the forward substitution U⁻ᵀ F, for right-hand sides F of m columns. Of the N rows in
/// `front`, the first P become U_PP⁻ᵀ F_P, and U_PSᵀ times these is subtracted from the others.
pub fn forward<const P: usize, const N: usize>(rows: &[[f64; N]; P], front: &mut [f64], m: usize) {
    for (a, row) in rows.iter().enumerate() {
        let (done, rest) = front.split_at_mut((a + 1) * m);
        let y = &mut done[a * m..];
        let scale = 1.0 / row[a];
        y.iter_mut().for_each(|x| *x *= scale);
        for (factor, target) in row[a + 1..].iter().zip(rest.chunks_exact_mut(m)) {
            for (x, y) in target.iter_mut().zip(y.iter()) {
                *x -= factor * y;
            }
        }
    }
}
