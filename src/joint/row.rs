//! Whitened rows over blocks of unknowns: what every factor of the adjustment yields.

/// Rows of many factors, one behind the other.
///
/// A row is a residual in standard deviations with its derivatives by the blocks of unknowns that
/// it touches; blocks count over the whole problem.
#[derive(Debug, Clone, Default)]
pub struct RowBatch {
    heads: Vec<Head>,
    blocks: Vec<u32>,
    by: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Head {
    group: u32,
    weight: f64,
    residual: f64,
    cost: f64,
    first_block: usize,
    first_by: usize,
}

/// Where Huber's loss turns from squares to lengths, standard deviations: 1 good row in 80 lies
/// beyond.
const HUBER_SIGMAS: f64 = 2.5;

/// Where Hampel's loss lets go of a row, and where it has: a leaf that moved is no noise.
const HAMPEL_SIGMAS: [f64; 2] = [5.0, 8.0];

/// The weight ψ(r)/r and the cost ρ(r) of a residual under Huber's loss.
pub fn huber(residual: f64) -> (f64, f64) {
    let length = residual.abs();
    match length <= HUBER_SIGMAS {
        true => (1.0, 0.5 * residual * residual),
        false => (
            HUBER_SIGMAS / length,
            HUBER_SIGMAS * (length - 0.5 * HUBER_SIGMAS),
        ),
    }
}

/// The same under Hampel's: ψ as Huber's up to 5, and from there falling to zero at 8.
pub fn hampel(residual: f64) -> (f64, f64) {
    let length = residual.abs();
    let [from, to] = HAMPEL_SIGMAS;
    if length <= from {
        return huber(residual);
    }
    let left = (to - length).max(0.0) / (to - from);
    let fallen = 0.5 * (to - from) * (1.0 - left * left);
    (
        HUBER_SIGMAS * left / length,
        HUBER_SIGMAS * (from - 0.5 * HUBER_SIGMAS + fallen),
    )
}

/// The weight and the cost of a residual.
pub type Loss = fn(f64) -> (f64, f64);

/// One row.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    /// The group of observations that it belongs to.
    pub group: usize,
    /// Weight that the loss leaves, 0 to 1; the cost is ½ weight · residual².
    pub weight: f64,
    /// In standard deviations.
    pub residual: f64,
    /// Blocks, each once.
    pub blocks: &'a [u32],
    /// Derivatives of the residual, block after block.
    pub by: &'a [f64],
}

impl RowBatch {
    /// Begins a row without derivatives.
    pub fn begin(&mut self, group: usize, weight: f64, residual: f64) {
        self.heads.push(Head {
            group: group as u32,
            weight,
            residual,
            cost: 0.5 * weight * residual * residual,
            first_block: self.blocks.len(),
            first_by: self.by.len(),
        });
    }

    /// Begins a row under a loss that gives its weight and cost.
    pub fn begin_under(&mut self, loss: Loss, group: usize, residual: f64) {
        let (weight, cost) = loss(residual);
        self.begin(group, weight, residual);
        if let Some(head) = self.heads.last_mut() {
            head.cost = cost;
        }
    }

    /// Adds the derivatives of the last row by one block.
    pub fn touch(&mut self, block: usize, by: &[f64]) {
        self.blocks.push(block as u32);
        self.by.extend_from_slice(by);
    }

    /// The rows in their order.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.heads.iter().enumerate().map(|(i, head)| {
            let next = self.heads.get(i + 1);
            let blocks_end = next.map_or(self.blocks.len(), |next| next.first_block);
            let by_end = next.map_or(self.by.len(), |next| next.first_by);
            Row {
                group: head.group as usize,
                weight: head.weight,
                residual: head.residual,
                blocks: &self.blocks[head.first_block..blocks_end],
                by: &self.by[head.first_by..by_end],
            }
        })
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.heads.len()
    }

    /// The cost of all rows.
    pub fn cost(&self) -> f64 {
        self.heads.iter().map(|head| head.cost).sum()
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.heads.clear();
        self.blocks.clear();
        self.by.clear();
    }
}
