//! The joint search by progressive sampling [@provost1999progressive]: a few pixels find the lobe,
//! and more of them go on from it until it is known well enough.
//!
//! A search visits its pixels some fifty times, most of them where the lobe is still far from where it
//! ends. Few pixels show the way there as well as many.

use crate::error::Result;

use super::joint::{JointLobe, find_lobe, refine_lobe};
use super::passes::Passes;
use super::pixel::CommonLobe;
use super::samples::{Begin, State};
use super::subset::{Subset, estimated_pixels};

/// Pixels of the first search, at least.
const FEWEST: usize = 1 << 10;

/// Each search has so many times the pixels of the last.
const GROWTH: usize = 4;

/// A search is the last if it has this share of the pixels that the caller allows, and beta and gamma
/// have smaller relative standard errors than this, which changes the code of a highlight on a display
/// by a fifth.
const ENOUGH: usize = 16;
const PRECISE: f64 = 3e-3;

/// The lobe of at most about `most` of the estimated pixels, from `lobe` on; none without a pixel.
pub(super) fn learn_progressively(
    passes: Passes<'_>,
    begin: Begin<'_>,
    most: usize,
    lobe: CommonLobe,
) -> Result<Option<JointLobe>> {
    let gaussian = passes.gaussian;
    let all = estimated_pixels(passes.photographs, passes.run)?;
    let mut found: Option<JointLobe> = None;
    for pixels in sizes(most.min(all)) {
        // The last takes what the caller allows, which may be more than all.
        let pixels = if pixels == all { most } else { pixels };
        let subset = Subset::gather(passes.photographs, begin, pixels, all, passes.run)?;
        if subset.len() == 0 {
            continue;
        }
        let stack = subset.stack()?;
        let photographs = &subset.photographs(passes.photographs, &stack);
        let state = State::new(subset.begin(), subset.len(), passes.run)?;
        let passes = Passes { photographs, ..passes };
        let after = match found.filter(|found| found.seen(gaussian)) {
            Some(rough) => {
                let passes = Passes { scale_reference: rough.scale_reference, ..passes };
                refine_lobe(passes, state, rough)?
            }
            None => find_lobe(passes, state, lobe)?,
        };
        let precise = after
            .standard_errors(gaussian)
            .is_some_and(|errors| errors.iter().all(|&error| error < PRECISE));
        found = Some(after);
        if precise && ENOUGH * pixels >= most {
            break;
        }
    }
    Ok(found)
}

/// Numbers of pixels, each [`GROWTH`] times the last, up to `most`.
fn sizes(most: usize) -> Vec<usize> {
    let mut sizes = vec![most];
    while let Some(&least) = sizes.last()
        && least / GROWTH >= FEWEST
    {
        sizes.push(least / GROWTH);
    }
    sizes.reverse();
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_pixels_are_searched_at_once_and_many_in_steps() {
        assert_eq!(sizes(0), [0]);
        assert_eq!(sizes(4095), [4095]);
        assert_eq!(sizes(4096), [1024, 4096]);
        assert_eq!(sizes(1 << 16), [1 << 10, 1 << 12, 1 << 14, 1 << 16]);
    }
}
