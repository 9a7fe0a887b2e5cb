//! A factor that grows with its chain, step by step; the newest node and bias are its root.

use super::border::ConstantsFactor;
use super::front::{Carry, ChangeFront, StepFront, TailFront, step_place};
use super::{ChainFactor, ChainLayout, StepSystem, TAIL};

impl Carry {
    /// Adds what records say of the carry's node and bias; node i + 1 must not be touched.
    pub fn add_newest(&mut self, system: &StepSystem) {
        for a in 0..TAIL {
            for b in a..TAIL {
                self.h[a][b] += system.h[step_place(a)][step_place(b)];
            }
            self.g[a] += system.g[step_place(a)];
        }
    }
}

impl ChainFactor {
    /// Of a single node, without constants.
    pub fn growing() -> Self {
        Self {
            layout: ChainLayout {
                bias_of_step: Vec::new(),
            },
            steps: Vec::new(),
            changes: Vec::new(),
            tail: TailFront::ZERO,
            step_border: Vec::new(),
            change_border: Vec::new(),
            tail_border: Vec::new(),
            constants: ConstantsFactor::new(0),
        }
    }

    /// Room for one more step, with this bias: that of the step before or the next one.
    pub fn push_step(&mut self, bias: u32) {
        self.layout.bias_of_step.push(bias);
        self.steps.push(StepFront::ZERO);
        if self.layout.changes_before(self.steps.len() - 1) {
            self.changes.push(ChangeFront::ZERO);
        }
    }

    /// The front of step i, to be written.
    pub fn step_mut(&mut self, i: usize) -> &mut StepFront {
        &mut self.steps[i]
    }

    /// The front that eliminates bias `old`, to be written.
    pub fn change_mut(&mut self, old: usize) -> &mut ChangeFront {
        &mut self.changes[old]
    }

    /// The front of the newest node and bias, to be written.
    pub fn tail_mut(&mut self) -> &mut TailFront {
        &mut self.tail
    }
}
