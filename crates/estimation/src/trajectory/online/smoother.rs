//! The Bayes tree of the online smoother (Kaess, Johannsson, Roberts, Ila, Leonard, Dellaert 2012).
//!
//! Eliminated in time order, a drive's tree is a chain with the newest node and bias as the root. A
//! new step adds one front and changes the root. Where a node has moved too far from where it was
//! linearised, elimination starts again there, from the normal equations carried to it.

use super::options::{OnlineOptions, Thresholds};
use crate::adjustment::{
    CHANGE, Carry, ChainFactor, ChainLayout, ChainProblem, NODE, STEP, TAIL, Unknown, solve_rows,
};
use crate::error::{Error, Problem, Result};
use crate::sensor::ImuBias;
use crate::trajectory::graph::Graph;
use crate::trajectory::imu_series::ImuSeries;
use crate::trajectory::states::{BIAS, NodeState, State};
use std::collections::VecDeque;

const UNDAMPED: [f64; TAIL] = [0.0; TAIL];

/// The work done by one update.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Work {
    /// Fronts eliminated.
    pub eliminated: usize,
    /// Nodes with a new linearisation point.
    pub relinearised: usize,
}

/// The graph, its linearisation point, its factor, and the step from that point to the estimate.
#[derive(Debug, Clone)]
pub struct Smoother {
    pub graph: Graph,
    /// Linearisation points.
    pub state: State,
    pub factor: ChainFactor,
    /// Normal equations carried to the steps from `first_carry` on, before the bias changes there.
    carries: VecDeque<Carry>,
    first_carry: usize,
    node_step: Vec<[f64; NODE]>,
    bias_step: Vec<[f64; BIAS]>,
    /// The step at which each bias begins.
    bias_begin: Vec<usize>,
    /// The first step whose front is out of date.
    changed: usize,
    /// The first step whose front has changed since the last back-substitution.
    unsolved: usize,
    /// Steps that may jump.
    loose: Vec<usize>,
    /// Fronts eliminated since the last update.
    eliminated: usize,
    options: OnlineOptions,
}

impl Smoother {
    /// A smoother of a graph with a single node, linearised at `state`.
    pub fn new(graph: Graph, state: State, options: OnlineOptions) -> Self {
        Self {
            carries: VecDeque::from([Carry::new(&graph.prior(&state))]),
            first_carry: 0,
            graph,
            state,
            factor: ChainFactor::new(ChainLayout::default(), 0),
            node_step: vec![[0.0; NODE]],
            bias_step: vec![[0.0; BIAS]],
            bias_begin: vec![0],
            changed: 0,
            unsolved: 0,
            loose: Vec::new(),
            eliminated: 0,
            options,
        }
    }

    pub fn newest_s(&self) -> f64 {
        let nodes = &self.graph.timeline.node_s;
        nodes[nodes.len() - 1]
    }

    pub fn steps(&self) -> usize {
        self.graph.timeline.steps()
    }

    /// The estimate of a node.
    pub fn node(&self, node: usize) -> NodeState {
        self.state.nodes[node].retracted(&self.node_step[node])
    }

    /// The estimate of the bias in force in a step; in the step that is not complete yet, the newest.
    pub fn bias(&self, step: usize) -> ImuBias {
        let bias = self.graph.layout().segment(step);
        self.state.biases[bias].retracted(&self.bias_step[bias])
    }

    /// The first step at which elimination can start again.
    pub fn reach(&self) -> usize {
        self.first_carry
    }

    /// Marks the fronts from `step` on as out of date.
    pub fn touch(&mut self, step: usize) {
        self.changed = self.changed.min(step);
    }

    /// Adds a step to a new node at `time_s`, linearised at `guess` or, without one, at the prediction by
    /// the IMU. With `begins`, a new bias begins at the newest node.
    pub fn append(
        &mut self,
        imu: &ImuSeries,
        time_s: f64,
        begins: bool,
        guess: Option<&(NodeState, ImuBias)>,
    ) -> Result<()> {
        let step = self.steps();
        let bias = self.bias(step);
        self.graph.push_step(imu, time_s, begins, &bias)?;
        if begins && step > 0 {
            self.state.biases.push(guess.map_or(bias, |g| g.1));
            self.bias_step.push([0.0; BIAS]);
            self.bias_begin.push(step);
        }
        let node = match guess {
            Some((node, _)) => *node,
            None => {
                let gravity_m_s2 = self.state.constants.gravity_m_s2.value;
                let sums = &self.graph.imu[step].sums;
                sums.predict(&self.node(step), &bias, gravity_m_s2)
            }
        };
        self.state.nodes.push(node);
        self.node_step.push([0.0; NODE]);
        self.factor
            .push_step(self.graph.layout().segment_of_step[step]);
        self.touch(step);
        Ok(())
    }

    /// Brings fronts, root and the steps to the estimates up to date, and relinearises nodes and biases
    /// that have moved too far.
    pub fn update(&mut self, imu: &ImuSeries) -> Result<Work> {
        let wildfire = self.options.wildfire;
        self.eliminate()?;
        let lowest = self.back_substitute(Some(&wildfire));
        let relinearised = self.relinearise(imu, lowest);
        if relinearised > 0 {
            self.eliminate()?;
            self.back_substitute(Some(&wildfire));
        }
        Ok(Work {
            eliminated: std::mem::take(&mut self.eliminated),
            relinearised,
        })
    }

    /// Lets the newest step jump, with these standard deviations of rotation, position and velocity.
    pub fn loosen_newest_step(&mut self, imu: &ImuSeries, sigma: [f64; 3]) {
        if let Some(step) = self.steps().checked_sub(1) {
            let about = self.bias(step);
            self.graph.loosen_newest_step(imu, &about, sigma);
            self.loose.push(step);
            self.touch(step);
        }
    }

    /// Eliminates from the first front that is out of date to the root.
    pub fn eliminate(&mut self) -> Result<()> {
        let steps = self.steps();
        let from = self.changed;
        self.carries.truncate(from - self.first_carry + 1);
        let not_determined = |step: usize, graph: &Graph| {
            Error::of(
                Problem::NotDetermined,
                format!(
                    "the trajectory at {:.3} s is not determined",
                    graph.timeline.node_s[step]
                ),
                "check lever arm, axes, heading offset and the clocks of the logs",
            )
        };
        for step in from..steps {
            let mut carry = self.carries[step - self.first_carry].clone();
            if self.graph.layout().changes_before(step) {
                let old = self.graph.layout().segment_of_step[step] as usize - 1;
                let walk = self.graph.walk(&self.state, old);
                if !carry.change_segment(&walk, &UNDAMPED, self.factor.change_mut(old)) {
                    return Err(not_determined(step, &self.graph));
                }
            }
            let mut system = self.graph.step_system(&self.state, step);
            if !carry.eliminate_step(&mut system, &UNDAMPED, self.factor.step_mut(step)) {
                return Err(not_determined(step, &self.graph));
            }
            self.carries.push_back(carry);
            if self.carries.len() > self.options.reach + 1 {
                self.carries.pop_front();
                self.first_carry += 1;
            }
        }
        self.changed = steps;
        self.unsolved = self.unsolved.min(from);
        let mut root = self.carries[steps - self.first_carry].clone();
        root.add_newest(&self.graph.newest_system(&self.state));
        if !root.eliminate_tail(&UNDAMPED, self.factor.tail_mut()) {
            return Err(not_determined(steps, &self.graph));
        }
        self.eliminated += steps - from;
        self.solve_root();
        Ok(())
    }

    /// Solves for the steps of the newest node and bias.
    fn solve_root(&mut self) {
        let (tail, _) = self.factor.tail();
        let x = solve_rows::<TAIL, TAIL>(&tail.rows, &tail.y, [0.0; TAIL]);
        let (mut node, mut bias) = ([0.0; NODE], [0.0; BIAS]);
        node.copy_from_slice(&x[..NODE]);
        bias.copy_from_slice(&x[NODE..]);
        let (n, k) = (self.steps(), self.bias_step.len() - 1);
        self.node_step[n] = node;
        self.bias_step[k] = bias;
    }

    /// Substitutes back from the root as long as steps change by more than `wildfire`, and at least through
    /// the fronts that are new; without thresholds, to the first step. Returns the first node reached.
    pub fn back_substitute(&mut self, wildfire: Option<&Thresholds>) -> usize {
        self.solve_root();
        let steps = self.steps();
        let first = match wildfire {
            Some(_) => self.first_carry,
            None => 0,
        };
        let mut calm = 0;
        for step in (first..steps).rev() {
            let bias = self.graph.layout().segment_of_step[step] as usize;
            let mut x = [0.0; STEP];
            x[NODE..2 * NODE].copy_from_slice(&self.node_step[step + 1]);
            x[2 * NODE..].copy_from_slice(&self.bias_step[bias]);
            let front = self.factor.step(step).0;
            let x = solve_rows::<NODE, STEP>(&front.rows, &front.y, x);
            let mut node = [0.0; NODE];
            node.copy_from_slice(&x[..NODE]);
            let mut moved =
                wildfire.is_none_or(|w| w.node_steps_differ(&node, &self.node_step[step]));
            self.node_step[step] = node;
            if self.graph.layout().changes_before(step) {
                let mut x = [0.0; CHANGE];
                x[BIAS..TAIL].copy_from_slice(&node);
                x[TAIL..].copy_from_slice(&self.bias_step[bias]);
                let front = self.factor.change(bias - 1).0;
                let x = solve_rows::<BIAS, CHANGE>(&front.rows, &front.y, x);
                let mut old = [0.0; BIAS];
                old.copy_from_slice(&x[..BIAS]);
                moved |=
                    wildfire.is_none_or(|w| w.bias_steps_differ(&old, &self.bias_step[bias - 1]));
                self.bias_step[bias - 1] = old;
            }
            // A calm node may lie between the newest node, whose change is not tested, and nodes that moved.
            calm = if moved { 0 } else { calm + 1 };
            if calm > 1 && step <= self.unsolved {
                self.unsolved = steps;
                return step;
            }
        }
        self.unsolved = steps;
        first
    }

    /// Moves the linearisation points of nodes and biases to their estimates, from node `lowest` on, where
    /// they are off by more than the thresholds. Returns the number of nodes.
    fn relinearise(&mut self, imu: &ImuSeries, lowest: usize) -> usize {
        let limit = self.options.relinearise;
        let none = ([0.0; NODE], [0.0; BIAS]);
        let first = self.first_carry;
        let mut count = 0;
        let mut again = usize::MAX;
        for i in lowest..self.state.nodes.len() {
            // The step before is linearised at this node too.
            if (i > first || i == 0) && limit.node_steps_differ(&self.node_step[i], &none.0) {
                self.state.nodes[i] = self.node(i);
                self.node_step[i] = none.0;
                again = again.min(i.saturating_sub(1));
                count += 1;
            }
        }
        let lowest_bias = self.graph.layout().segment(lowest);
        for k in lowest_bias..self.state.biases.len() {
            let begin = self.bias_begin[k];
            if begin >= first && limit.bias_steps_differ(&self.bias_step[k], &none.1) {
                self.state.biases[k] = self.state.biases[k].retracted(&self.bias_step[k]);
                self.bias_step[k] = none.1;
                let end = self.bias_begin.get(k + 1).copied();
                for step in begin..end.unwrap_or(self.graph.timeline.steps()) {
                    let (now, summed) = (&self.state.biases[k], self.graph.imu[step].sums.bias);
                    if limit.biases_differ(now, &summed) && !self.loose.contains(&step) {
                        self.graph.reintegrate(imu, step, now);
                    }
                }
                again = again.min(begin);
                count = count.max(1);
            }
        }
        if count > 0 {
            self.touch(again);
            if again == 0 {
                self.carries[0] = Carry::new(&self.graph.prior(&self.state));
            }
        }
        count
    }

    /// The estimates of all unknowns.
    pub fn estimate(&mut self) -> State {
        self.back_substitute(None);
        let biases = self.state.biases.iter().zip(&self.bias_step);
        State {
            nodes: (0..self.state.nodes.len()).map(|i| self.node(i)).collect(),
            biases: biases.map(|(bias, d)| bias.retracted(d)).collect(),
            constants: self.state.constants.clone(),
        }
    }
}
