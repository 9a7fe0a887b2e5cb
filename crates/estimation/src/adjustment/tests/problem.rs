//! A small problem with a mounting and a patch of a surface in the border, against dense algebra.

use crate::adjustment::chain::{ChainFactor, ChainStep};
use crate::adjustment::layout::{ChainLayout, NODE, SEGMENT, STEP, TAIL};
use crate::adjustment::levenberg_marquardt::StopReason;
use crate::adjustment::prior::{BorderPrior, Prior};
use crate::adjustment::problem::ChainProblem;
use crate::adjustment::rows::{FactorRows, Rows};
use crate::adjustment::unknown::{Columns, Parameter, Retract, Unknown};
use crate::geometry::so3::{exp, hat};
use crate::geometry::{BodyFromScanner, Vec3};
use crate::progress::Silent;
use nalgebra::{DMatrix, DVector, SVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

type Node = SVector<f64, NODE>;
type Segment = SVector<f64, SEGMENT>;

#[derive(Clone)]
struct State {
    nodes: Vec<Node>,
    segments: Vec<Segment>,
    mounting: Parameter<BodyFromScanner>,
    /// Offset and two slopes.
    patch: Parameter<Vec3>,
}

/// Links between consecutive nodes, points that a scanner sees from each node, and their heights above a
/// patch.
struct Problem {
    layout: ChainLayout,
    links: Vec<SVector<f64, NODE>>,
    seen: Vec<Vec3>,
    placed: Vec<Vec3>,
    weights: Vec<f64>,
}

const SIGMA: f64 = 0.1;

impl Problem {
    /// Difference between the next node and its prediction from this node and the segment.
    fn link(&self, state: &State, step: usize) -> FactorRows<NODE> {
        let segment = &state.segments[self.layout.segment(step)];
        let (node, next) = (&state.nodes[step], &state.nodes[step + 1]);
        let mut residual = next - node - self.links[step];
        let mut by_step = [[0.0; STEP]; NODE];
        for a in 0..NODE {
            residual[a] += 0.1 * node[a].sin();
            by_step[a][a] = -1.0 + 0.1 * node[a].cos();
            by_step[a][NODE + a] = 1.0;
        }
        for a in 0..SEGMENT {
            residual[a] -= segment[a];
            by_step[a][2 * NODE + a] = -1.0;
        }
        FactorRows::new(
            (residual / SIGMA).into(),
            by_step.map(|row| row.map(|x| x / SIGMA)),
        )
    }

    /// Position of a point of the scanner, seen from the node, and its height above the patch.
    fn scan(&self, state: &State, step: usize) -> FactorRows<4> {
        let from = Vec3::from_column_slice(&state.nodes[step].as_slice()[3..6]);
        let mounting = &state.mounting.value;
        let arm = mounting.rotation * self.seen[step];
        let point = from + mounting.map(&self.seen[step]);
        let patch = &state.patch.value;
        let above = point.z - patch.x - patch.y * point.x - patch.z * point.y;
        let normal = Vec3::new(-patch.y, -patch.z, 1.0);
        let off = point - self.placed[step];
        let mut by_step = [[0.0; STEP]; 4];
        let mut by_mounting = [[0.0; 4]; 6];
        let by_rotation = -hat(&arm);
        for axis in 0..3 {
            by_step[axis][3 + axis] = 1.0;
            by_step[3][3 + axis] = normal[axis];
            by_mounting[3 + axis][axis] = 1.0;
            by_mounting[3 + axis][3] = normal[axis];
            for row in 0..3 {
                by_mounting[axis][row] = by_rotation[(row, axis)];
            }
            by_mounting[axis][3] = normal.dot(&by_rotation.column(axis));
        }
        let mut rows = FactorRows::new([off.x, off.y, off.z, above], by_step);
        rows.touch(state.mounting.block().expect("estimated"), by_mounting);
        let by_patch = [-1.0, -point.x, -point.y].map(|x| [0.0, 0.0, 0.0, x]);
        rows.touch(state.patch.block().expect("estimated"), by_patch);
        rows
    }
}

impl ChainProblem for Problem {
    type State = State;
    type Source<'a> = &'a Self;

    fn layout(&self) -> &ChainLayout {
        &self.layout
    }

    fn rows<'a>(&'a self, state: &State, step: usize, mut visit: impl FnMut(&'a Self, Rows<'_>)) {
        visit(self, self.link(state, step).weighted(1.0));
        visit(self, self.scan(state, step).weighted(self.weights[step]));
    }

    fn residuals<'a>(
        &'a self,
        state: &State,
        step: usize,
        mut visit: impl FnMut(&'a Self, f64, &[f64]),
    ) {
        visit(self, 1.0, &self.link(state, step).residual);
        visit(self, self.weights[step], &self.scan(state, step).residual);
    }

    fn prior(&self, state: &State) -> Prior<TAIL> {
        let (node, segment) = (state.nodes[0].iter(), state.segments[0].iter());
        let values: Vec<f64> = node.chain(segment).copied().collect();
        Prior {
            weight: [0.5; TAIL],
            miss: std::array::from_fn(|i| values[i] - 0.1),
        }
    }

    fn walk(&self, state: &State, old: usize) -> Prior<SEGMENT> {
        Prior {
            weight: [4.0; SEGMENT],
            miss: (state.segments[old + 1] - state.segments[old]).into(),
        }
    }

    fn border_prior(&self, state: &State) -> BorderPrior {
        let mut miss = vec![0.0; 9];
        state.mounting.correction(&mut miss);
        state.patch.correction(&mut miss);
        BorderPrior {
            weight: vec![0.01; 9],
            miss,
        }
    }

    fn damping_sigma(&self) -> [f64; TAIL] {
        [1.0; TAIL]
    }

    fn retracted(&self, state: &State, step: &ChainStep) -> State {
        let mut moved = state.clone();
        for (node, d) in moved.nodes.iter_mut().zip(&step.nodes) {
            *node = node.retracted(d);
        }
        for (segment, d) in moved.segments.iter_mut().zip(&step.segments) {
            *segment = segment.retracted(d);
        }
        moved.mounting.retract(&step.border);
        moved.patch.retract(&step.border);
        moved
    }
}

fn problem() -> (Problem, State) {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut draw = |size: f64| random.random_range(-size..size);
    let layout = ChainLayout {
        segment_of_step: vec![0, 0, 1, 1, 2],
    };
    let truth = BodyFromScanner::new(exp(&Vec3::new(-2.1, 0.4, 0.7)), Vec3::new(1.2, -0.5, 0.6));
    let steps = layout.steps();
    let seen: Vec<Vec3> = (0..steps)
        .map(|_| Vec3::from_fn(|_, _| draw(1.5)))
        .collect();
    let placed = seen
        .iter()
        .map(|x| truth.map(x) + Vec3::from_fn(|_, _| draw(0.05)));
    let problem = Problem {
        placed: placed.collect(),
        links: (0..steps)
            .map(|_| Node::from_fn(|_, _| draw(0.2)))
            .collect(),
        weights: vec![1.0, 0.3, 1.0, 0.0, 1.0],
        layout,
        seen,
    };
    let mut columns = Columns::default();
    let start = truth.perturbed(&Vec3::new(0.3, -0.2, 0.2), &Vec3::new(0.2, 0.1, -0.3));
    let mut mounting = Parameter::held(start);
    let mut patch = Parameter::held(Vec3::zeros());
    mounting.estimate(&mut columns);
    patch.estimate(&mut columns);
    let state = State {
        nodes: vec![Node::zeros(); steps + 1],
        segments: vec![Segment::zeros(); 3],
        mounting,
        patch,
    };
    (problem, state)
}

/// Columns of the chain, then those of the border.
const NODES: usize = 6 * NODE;
const CHAIN: usize = NODES + 3 * SEGMENT;
const ALL: usize = CHAIN + 9;

fn place(problem: &Problem, step: usize, a: usize) -> usize {
    if a < 2 * NODE {
        step * NODE + a
    } else {
        NODES + problem.layout.segment(step) * SEGMENT + a - 2 * NODE
    }
}

/// Whitened, weighted rows of all factors, dense, each with its residual.
fn dense_rows(problem: &Problem, state: &State) -> Vec<(DVector<f64>, f64)> {
    let mut all = Vec::new();
    for step in 0..problem.layout.steps() {
        problem.rows(state, step, |_, rows| {
            let root = rows.weight.sqrt();
            for (i, (row, residual)) in rows.by_step.iter().zip(rows.residual).enumerate() {
                let mut dense = DVector::zeros(ALL);
                for (a, x) in row.iter().enumerate() {
                    dense[place(problem, step, a)] += root * x;
                }
                for (column, by) in rows.by_column() {
                    dense[CHAIN + column] += root * by[i];
                }
                all.push((dense, root * residual));
            }
        });
    }
    let prior = problem.prior(state);
    for a in 0..TAIL {
        let mut dense = DVector::zeros(ALL);
        dense[if a < NODE { a } else { NODES + a - NODE }] = prior.weight[a].sqrt();
        all.push((dense, prior.weight[a].sqrt() * prior.miss[a]));
    }
    for old in 0..2 {
        let walk = problem.walk(state, old);
        for a in 0..SEGMENT {
            let mut dense = DVector::zeros(ALL);
            dense[NODES + old * SEGMENT + a] = -walk.weight[a].sqrt();
            dense[NODES + (old + 1) * SEGMENT + a] = walk.weight[a].sqrt();
            all.push((dense, walk.weight[a].sqrt() * walk.miss[a]));
        }
    }
    let border = problem.border_prior(state);
    for (c, (w, d)) in border.weight.iter().zip(&border.miss).enumerate() {
        let mut dense = DVector::zeros(ALL);
        dense[CHAIN + c] = w.sqrt();
        all.push((dense, w.sqrt() * d));
    }
    all
}

fn dense_step(x: &[f64]) -> ChainStep {
    let (nodes, segments) = x[..CHAIN].split_at(NODES);
    ChainStep {
        nodes: nodes.as_chunks().0.to_vec(),
        segments: segments.as_chunks().0.to_vec(),
        border: x[CHAIN..].to_vec(),
    }
}

/// H and g.
fn dense_system(problem: &Problem, state: &State) -> (DMatrix<f64>, DVector<f64>) {
    let (mut h, mut g) = (DMatrix::zeros(ALL, ALL), DVector::zeros(ALL));
    for (row, residual) in dense_rows(problem, state) {
        h += &row * row.transpose();
        g -= row * residual;
    }
    (h, g)
}

fn solved() -> (Problem, State, ChainFactor) {
    let (problem, mut state) = problem();
    let mut factor = ChainFactor::new(problem.layout.clone(), 9);
    let ended = problem
        .solve(&mut state, &mut factor, 50, &Silent)
        .expect("nothing cancels");
    assert_eq!(ended.stop, StopReason::Converged);
    assert!(ended.cost < ended.cost_initial);
    // Beyond the limit of convergence, down to rounding.
    for _ in 0..60 {
        problem
            .solve(&mut state, &mut factor, 1, &Silent)
            .expect("nothing cancels");
    }
    (problem, state, factor)
}

#[test]
fn a_pose_and_a_patch_in_the_border_are_solved_as_by_dense_algebra() {
    let (problem, solution, _) = solved();
    let (_, mut dense) = self::problem();
    for _ in 0..90 {
        let (h, g) = dense_system(&problem, &dense);
        let step = h.cholesky().expect("positive definite").solve(&g);
        dense = problem.retracted(&dense, &dense_step(step.as_slice()));
    }
    let (a, b) = (&solution.mounting.value, &dense.mounting.value);
    let mut apart = [0.0; 6];
    a.step_from(b, &mut apart);
    assert!(apart.iter().all(|x| x.abs() < 1e-9), "{apart:?}");
    assert!((solution.patch.value - dense.patch.value).norm() < 1e-9);
    for (a, b) in solution.nodes.iter().zip(&dense.nodes) {
        assert!((a - b).norm() < 1e-9);
    }
}

#[test]
fn the_cost_is_flat_at_the_solution() {
    let (problem, solution, _) = solved();
    // Central differences of 1e-4 carry an error of about 1e-8 of the third derivative.
    let h = 1e-4;
    for column in 0..ALL {
        let cost = |h: f64| {
            let mut x = vec![0.0; ALL];
            x[column] = h;
            problem.cost(&problem.retracted(&solution, &dense_step(&x)))
        };
        let slope = (cost(h) - cost(-h)) / (2.0 * h);
        assert!(slope.abs() < 1e-6, "{column}: {slope}");
    }
}

#[test]
fn covariances_and_redundancies_are_those_of_dense_algebra() {
    let (problem, solution, mut factor) = solved();
    problem
        .factorise(&solution, 0.0, &mut factor)
        .expect("positive definite");
    let (h, _) = dense_system(&problem, &solution);
    let dense = h.try_inverse().expect("regular");
    let border = factor.border_covariance();
    let difference = &border - dense.view((CHAIN, CHAIN), (9, 9));
    assert!(difference.amax() < 1e-9 * border.amax());
    let rows = dense_rows(&problem, &solution);
    let mut steps: Vec<Vec<f64>> = Vec::new();
    factor.marginals(|step, marginal| {
        let covariance = marginal.joint();
        let mut of_step = Vec::new();
        problem.rows(&solution, step, |_, rows| {
            of_step.extend(covariance.redundancies(&rows, &border));
        });
        steps.push(of_step);
    });
    let redundancies = steps.into_iter().rev().flatten();
    for ((row, _), redundancy) in rows.iter().zip(redundancies) {
        let expected = 1.0 - (row.transpose() * &dense * row)[0];
        assert!(
            (redundancy - expected).abs() < 1e-9,
            "{redundancy} {expected}"
        );
    }
}
