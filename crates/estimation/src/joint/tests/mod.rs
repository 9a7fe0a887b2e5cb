//! Tests of the joint adjustment on small cases, against slow and dense ways of the same.

mod association;
mod bends;
mod case;
mod columns;
mod dense;
mod gauss_markov;
mod grid;
mod jacobians;
mod known;
mod places;
mod pose_errors;
mod reference;
mod relief;
mod rows;
mod slopes;
mod slow;
mod whole;
