//! Tests of the joint adjustment on small cases, against slow and dense ways of the same.

mod case;
mod jacobians;
