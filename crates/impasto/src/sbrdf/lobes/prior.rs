//! What is typical of a painting's lobes, for pixels whose photographs hardly tell.
//!
//! Few lights fall near a pixel's highlight, and a narrow lobe between two of them fits anything.
//! Pixels that know their lobes' shapes tell what is typical; every pixel's shapes are then drawn
//! towards it as if by one measurement as uncertain as shapes usually differ. Where the
//! photographs know better that changes little; where they know nothing the pixel has the
//! painting's lobe, and its status says so.

use super::maps::MOST_LOBES;
use super::model::{LobeModel, MAX_SHAPES};
use super::tile::Place;

/// Pixels that must know a shape before it is typical of anything.
pub(super) const FEWEST: usize = 20;
/// Their share of all: some percent seem to have one lobe more than they have, by their noise.
const SHARE: f64 = 0.05;

/// Shapes of pixels with so many lobes, lobe by lobe.
type Shapes = [[f32; MAX_SHAPES]; MOST_LOBES];

/// Typical shapes by the number of lobes; none where too few pixels tell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior([Option<Shapes>; MOST_LOBES]);

impl Prior {
    /// Medians over pixels that know their shapes better than they usually differ.
    pub(super) fn of_places<M: LobeModel>(model: &M, places: &[Place]) -> Self {
        let spread = model.spreads()[0] as f32;
        let fewest = FEWEST.max((SHARE * places.len() as f64) as usize);
        Self(core::array::from_fn(|index| {
            let known: Vec<&Place> = places
                .iter()
                .filter(|place| place.lobes == index + 1)
                .filter(|place| place.shape_spread[..=index].iter().all(|&s| s < spread))
                .collect();
            (known.len() >= fewest).then(|| {
                core::array::from_fn(|lobe| {
                    core::array::from_fn(|shape| {
                        median(known.iter().map(|place| place.shapes[lobe][shape]).collect())
                    })
                })
            })
        }))
    }

    /// Whether anything is typical of pixels with so many lobes.
    pub(super) fn knows(&self, lobes: usize) -> bool {
        self.0[lobes - 1].is_some()
    }

    /// A typical number, and the inverse of how far from it shapes usually lie (0: nothing typical).
    pub(super) fn of<M: LobeModel>(
        &self,
        model: &M,
        lobes: usize,
        lobe: usize,
        shape: usize,
    ) -> [f32; 2] {
        match self.0[lobes - 1] {
            Some(shapes) => [shapes[lobe][shape], model.spreads()[shape].recip() as f32],
            None => [0.0, 0.0],
        }
    }
}

/// The upper of the two middle values of an even number.
fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}
