//! The search of `impasto::lm`, as its users see it: the same bits in any lane, certified
//! problems, and the ways in which problems go wrong.

mod batch;
mod dual;
mod endings;
mod hard;
mod mgh;
mod models;
mod nist;
