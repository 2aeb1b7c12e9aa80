//! The card's pictures against the CPU's; one program, for it takes long to link.

mod common;
mod environments;
mod hard_cases;
mod lamps;
mod renderer;
mod stages;
