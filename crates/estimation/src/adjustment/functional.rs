//! Covariances of linear functionals of all unknowns, by one forward substitution.

use super::chain::ChainFactor;
use super::front::{change_place, forward};
use super::layout::{CHANGE, ChainLayout, NODE, SEGMENT, STEP, TAIL};
use nalgebra::DMatrix;

/// Marks a block that is zero.
const NONE: u32 = u32::MAX;

/// Blocks of `size` entries, most of them zero and not stored.
#[derive(Debug, Clone)]
struct Blocks {
    size: usize,
    slot: Vec<u32>,
    values: Vec<f64>,
}

impl Blocks {
    fn new(count: usize, size: usize) -> Self {
        Self {
            size,
            slot: vec![NONE; count],
            values: Vec::new(),
        }
    }

    fn get_mut(&mut self, index: usize) -> &mut [f64] {
        if self.slot[index] == NONE {
            self.slot[index] = (self.values.len() / self.size.max(1)) as u32;
            self.values.resize(self.values.len() + self.size, 0.0);
        }
        let start = self.slot[index] as usize * self.size;
        &mut self.values[start..start + self.size]
    }

    fn get(&self, index: usize) -> Option<&[f64]> {
        let slot = self.slot[index];
        let start = slot as usize * self.size;
        (slot != NONE).then(|| &self.values[start..start + self.size])
    }

    fn first(&self) -> Option<usize> {
        self.slot.iter().position(|&slot| slot != NONE)
    }
}

/// Gradient G of m linear functionals by all unknowns, sparse over nodes and segments. Blocks are stored
/// row by row.
#[derive(Debug, Clone)]
pub struct ChainGradient {
    rows: usize,
    nodes: Blocks,
    segments: Blocks,
    border: Vec<f64>,
}

impl ChainGradient {
    /// The zero gradient of m = `rows` functionals.
    pub fn new(rows: usize, layout: &ChainLayout, border: usize) -> Self {
        Self {
            rows,
            nodes: Blocks::new(layout.nodes(), rows * NODE),
            segments: Blocks::new(layout.segments(), rows * SEGMENT),
            border: vec![0.0; rows * border],
        }
    }

    /// The m × 9 block of a node, to add to.
    pub fn node_mut(&mut self, node: usize) -> &mut [f64] {
        self.nodes.get_mut(node)
    }

    /// The m × 6 block of a segment, to add to.
    pub fn segment_mut(&mut self, segment: usize) -> &mut [f64] {
        self.segments.get_mut(segment)
    }

    /// The m × n block of the border, to add to.
    #[cfg_attr(
        not(test),
        expect(dead_code, reason = "poses do not reach the border yet")
    )]
    pub fn border_mut(&mut self) -> &mut [f64] {
        &mut self.border
    }
}

impl ChainFactor {
    /// G H⁻¹ Gᵀ (m × m) = V Vᵀ + Vk Vkᵀ with V = G U⁻¹ and, of the border,
    /// Vk = (Gk − V Y) U_k⁻¹.
    pub fn of_functional(&self, gradient: &ChainGradient) -> DMatrix<f64> {
        let (m, n) = (gradient.rows, self.border());
        if m == 0 {
            return DMatrix::zeros(0, 0);
        }
        let steps = self.layout.steps();
        let mut sums = Sums::new(gradient, n);
        // Right-hand sides of (node, segment), 15 rows of m, which each front reads and passes on.
        let mut carry = vec![0.0; TAIL * m];
        let mut front = vec![0.0; STEP * m];
        for i in self.first_step(gradient)..steps {
            if self.layout.changes_before(i) {
                let old = self.layout.segment_of_step[i - 1] as usize;
                let front = &mut front[..CHANGE * m];
                front[TAIL * m..].fill(0.0);
                for (a, carried) in carry.chunks_exact(m).enumerate() {
                    let place = change_place(a) * m;
                    front[place..place + m].copy_from_slice(carried);
                }
                let (change, border) = self.change(old);
                forward(&change.rows, front, m);
                sums.add(&front[..SEGMENT * m], border);
                carry.copy_from_slice(&front[SEGMENT * m..]);
            }
            let (next, shared) = (NODE * m, 2 * NODE * m);
            front[..next].copy_from_slice(&carry[..next]);
            front[next..shared].fill(0.0);
            front[shared..].copy_from_slice(&carry[next..]);
            add_block::<NODE>(gradient.nodes.get(i), m, &mut front[..next]);
            if i == 0 || self.layout.changes_before(i) {
                let block = gradient
                    .segments
                    .get(self.layout.segment_of_step[i] as usize);
                add_block::<SEGMENT>(block, m, &mut front[shared..]);
            }
            let (step, border) = self.step(i);
            forward(&step.rows, &mut front, m);
            sums.add(&front[..next], border);
            carry.copy_from_slice(&front[next..]);
        }
        add_block::<NODE>(gradient.nodes.get(steps), m, &mut carry);
        let (tail, border) = self.tail();
        forward(&tail.rows, &mut carry, m);
        sums.add(&carry, border);
        let mut border = std::mem::take(&mut sums.border);
        self.border_factor().forward(&mut border, m);
        sums.add_squares(&border);
        DMatrix::from_fn(m, m, |a, b| sums.squares[a.min(b) * m + a.max(b)])
    }

    /// The first step whose front contains part of the gradient; the right-hand sides before it are zero.
    fn first_step(&self, gradient: &ChainGradient) -> usize {
        let steps = self.layout.steps();
        let first_by_segment = gradient.segments.first().map(|first| {
            self.layout
                .segment_of_step
                .partition_point(|&segment| (segment as usize) < first)
        });
        let first_by_node = gradient.nodes.first();
        first_by_node
            .into_iter()
            .chain(first_by_segment)
            .min()
            .unwrap_or(steps)
    }
}

/// Adds an m × W block, transposed, to the first W rows of m.
fn add_block<const W: usize>(block: Option<&[f64]>, m: usize, front: &mut [f64]) {
    for (row, values) in block.unwrap_or(&[]).chunks_exact(W).enumerate() {
        for (unknown, value) in values.iter().enumerate() {
            front[unknown * m + row] += value;
        }
    }
}

/// The sums that the forward substitution accumulates front by front.
struct Sums {
    m: usize,
    n: usize,
    /// The upper triangle of V Vᵀ, m × m.
    squares: Vec<f64>,
    /// (Gk − V Y)ᵀ, n × m.
    border: Vec<f64>,
}

impl Sums {
    fn new(gradient: &ChainGradient, n: usize) -> Self {
        let m = gradient.rows;
        let border = (0..n * m).map(|at| gradient.border[(at % m) * n + at / m]);
        Self {
            m,
            n,
            squares: vec![0.0; m * m],
            border: border.collect(),
        }
    }

    /// Adds some rows of Vᵀ (m columns) and of Y (n columns).
    fn add(&mut self, v: &[f64], border: &[f64]) {
        self.add_squares(v);
        if self.n > 0 {
            for (v, y) in v.chunks_exact(self.m).zip(border.chunks_exact(self.n)) {
                for (factor, target) in y.iter().zip(self.border.chunks_exact_mut(self.m)) {
                    for (x, v) in target.iter_mut().zip(v) {
                        *x -= factor * v;
                    }
                }
            }
        }
    }

    fn add_squares(&mut self, v: &[f64]) {
        let m = self.m;
        for row in v.chunks_exact(m) {
            for (b, factor) in row.iter().enumerate() {
                let target = &mut self.squares[b * m + b..(b + 1) * m];
                for (x, y) in target.iter_mut().zip(&row[b..]) {
                    *x += factor * y;
                }
            }
        }
    }
}
