//! The card's pictures against the CPU's; one program, for it takes long to link.

mod common;
mod hard_cases;
mod renderer;
mod stages;
