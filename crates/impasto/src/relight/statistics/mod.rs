//! What is known of every 256 x 256 pixels of a painting: bounds of its maps, from which a plan
//! proves what a scene does not call for.
//!
//! The normals of a tile lie in a cone [@shirman1993cone]; the slopes of its relief have a support
//! function, the steepest rise in each of 64 directions; every other map has a
//! smallest and a largest value. Pixels that no picture can show, because a normal or a colour is not
//! a number, are left out.

mod table;
mod tiles;

pub use table::Pieces;
pub use tiles::{
    AZIMUTHS, LobeRange, Range, ReliefRange, SIDE, Statistics, TileStatistics, azimuth,
};
