//! What the numerics cost, beside a peer in the same run.
//!
//! Lower times are better; the fastest of the samples disturbs least. Only ratios within one run
//! mean anything: machines, and their neighbours, differ.

mod display;
mod height;
mod lm;
mod painting;
mod predict;
mod stereo;

fn main() {
    divan::main();
}
