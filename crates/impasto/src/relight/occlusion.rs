//! One bounce of light between places of a relief, from how much of the sky each sees: the ambient
//! occlusion form of radiosity [@goral1984radiosity].
//!
//! A place that sees the share V of the sky sees `1 - V` of the relief. What it sees of the relief is
//! near it, sees about as much of the sky and reflects about as much: `rho V E` comes from it. The
//! irradiance is then `E V (1 + rho (1 - V))`, exact in a cavity where V is the same everywhere, such as
//! a part of a sphere. In a groove of two planes V rises towards the edge; there the factor is too high,
//! by less than 0.05 of E in a right-angled groove.

use super::shadow::horizon::Horizons;
use crate::error::{Error, Result};
use crate::geometry::Grid;
use crate::pixels::Run;

/// The share of an even sky's irradiance on the painting's plane that each pixel has, `(y, x)`, over a
/// relief `(y, x)` in mm: what it sees at so many azimuths, and one bounce from surroundings of a mean
/// reflectance `albedo` (0: none).
///
/// # Errors
/// If a number is out of range, the sizes disagree, or the caller cancels.
pub fn sky(
    relief: &[f32],
    grid: Grid,
    azimuths: usize,
    albedo: f64,
    run: &Run<'_>,
) -> Result<Vec<f32>> {
    if !(0.0..=1.0).contains(&albedo) {
        return Err(Error::argument("albedo", format!("expected 0 to 1, found {albedo}")));
    }
    let mut seen = Horizons::sky(azimuths)?.seen(relief, grid, run)?;
    for share in &mut seen {
        *share = one_bounce(*share, albedo as f32);
    }
    Ok(seen)
}

/// Irradiance relative to the open sky, with one bounce: `visible` is V, `albedo` the mean reflectance
/// of the surroundings, 0 to 1.
#[must_use]
pub fn one_bounce(visible: f32, albedo: f32) -> f32 {
    visible * albedo.mul_add(1.0 - visible, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;

    #[test]
    fn in_a_groove_one_bounce_is_near_the_integral_over_its_other_wall() {
        // Two walls of length 1 at a right angle; a place at t from the bottom sees the element at s
        // of the other by half the difference of sin(angle from its normal), which is
        // t / hypot(t, s): Hottel's strings.
        const CELLS: usize = 2000;
        let visible = |t: f64| 0.5 + 0.5 * t / t.hypot(1.0);
        for t in [0.05_f64, 0.2, 0.5, 0.8, 1.0] {
            let (mut bounce, mut hidden) = (0.0, 0.0);
            for cell in 0..CELLS {
                let [near, far] = [cell, cell + 1].map(|s| s as f64 / CELLS as f64);
                let factor = 0.5 * (t / t.hypot(near) - t / t.hypot(far));
                bounce += factor * visible(0.5 * (near + far));
                hidden += factor;
            }
            assert!((hidden + visible(t) - 1.0).abs() < 1e-9);
            for albedo in [0.2, 0.8] {
                let exact = visible(t) + albedo * bounce;
                let found = f64::from(one_bounce(visible(t) as f32, albedo as f32));
                assert!((found - exact).abs() < 0.05, "{t}: {found} for {exact}");
            }
        }
    }

    #[test]
    fn no_relief_hides_more_of_the_sky_than_its_slopes_allow() {
        let grid = Grid::whole(80, 80, 0.1);
        for depth in [0.002_f64, 0.01, 0.05] {
            let relief: Vec<f32> = (0..6400)
                .map(|i| {
                    let (x, y) = (f64::from(i % 80), f64::from(i / 80));
                    (depth * ((0.6 * x).sin() + (0.5 * y).cos())) as f32
                })
                .collect();
            let steepest = depth / 0.1 * 0.6_f64.hypot(0.5);
            // All places on a cone of that slope see what lies inside the mirrored cone.
            let most = 1.0 - steepest.hypot(1.0).powi(-3);
            let seen = serially(|run| Horizons::sky(16).unwrap().seen(&relief, grid, run)).unwrap();
            let darkest = seen.iter().copied().fold(1.0, f32::min);
            assert!(f64::from(1.0 - darkest) <= most, "{darkest}");
            assert!(darkest < 1.0 || depth < 0.005);
        }
    }
}
