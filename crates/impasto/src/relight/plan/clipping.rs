//! What a display clips: light above its white, and light below 0, of colours outside its gamut.
//!
//! Clipping is part of the tone curve and costs nothing: where no light lies beyond the display it is
//! proven to change nothing. Where all light of a tile does, in every channel, the tile has one colour,
//! and nothing of it is lit.

use super::decide::LampSeen;
use super::display::{Beyond, Clipping};
use super::interval::{Interval, either, plus};
use super::{Decided, Decision, Effect, Row, Shown, Work};
use crate::relight::bounds;
use crate::relight::statistics::{LobeRange, Range, SIDE, TileStatistics};

impl Work<'_> {
    /// What of a tile's light lies beyond the display.
    pub(super) fn beyond(
        &self,
        tile: &TileStatistics,
        [column, row]: [usize; 2],
        lamps: &[LampSeen],
    ) -> Beyond {
        let Self { grid, scene, options, bounded, .. } = self;
        let whole = SIDE.min(grid.width - column * SIDE) * SIDE.min(grid.height - row * SIDE);
        let (Some(weights), Some(display)) = (&bounded.shown, &options.display) else {
            return Beyond { light: [f64::NAN; 2], pixels: whole, all: None };
        };
        let hole = |range: &Range| range.holes;
        let of_lobe = |lobe: &LobeRange| lobe.strength.iter().chain(&lobe.shape).any(hole);
        let holes = tile.gaps || tile.ambient.iter().any(hole) || tile.lobes.iter().any(of_lobe);
        let unknown = options.more_light || scene.environment().is_some();
        let mut ends: Option<Interval> = None;
        let mut add = |light: [Interval; 3]| {
            for one in light {
                ends = Some(ends.map_or(one, |all| either(all, one)));
            }
        };
        let mut all = None;
        if tile.pixels > 0 && !unknown {
            let shadows = options.over.shadows;
            let light = self.light(tile, lamps, weights, shadows);
            add(light);
            let lit = if shadows { self.light(tile, lamps, weights, false) } else { light };
            // Beyond it by more than what is rounded to its end; light that overflows is none.
            let clipped = lit.map(|[low, high]| {
                let finite = low > -1e30 && high < 1e30;
                (finite && !holes && (low > 1.0 || high < 0.0)).then_some(low > 1.0)
            });
            if let [Some(red), Some(green), Some(blue)] = clipped {
                all = Some([red, green, blue]);
            }
        }
        let projected = scene.is_projected() && bounds::steepest_view(scene.view(), *grid) > 0.0;
        let behind = self.background(display);
        if holes || projected {
            add(behind);
        }
        let mut light =
            if unknown && tile.pixels > 0 { [f64::NAN; 2] } else { ends.unwrap_or([0.0; 2]) };
        if projected {
            // Mixed with what is behind the painting: shares of both sum up to 1 but for roundings, and
            // a share of the background may be less than 0.
            let [low, high] = behind.into_iter().fold([0.0; 2], either);
            let rounding = bounded.rounding * low.abs().max(high);
            light = plus(light, [-rounding, rounding]);
        }
        Beyond { light, pixels: whole, all }
    }

    /// What the display makes of the background.
    fn background(&self, Shown { matrix, background }: &Shown) -> [Interval; 3] {
        [0, 1, 2].map(|channel: usize| {
            let terms = background.iter().zip(matrix).map(|(&light, column)| {
                let term = f64::from(light) * column[channel];
                let size = self.bounded.rounding * term.abs();
                [term - size, term + size]
            });
            terms.fold([0.0; 2], plus)
        })
    }

    /// How much may be clipped, and by how much the exposure would have to fall.
    pub(super) fn rows_of_display(
        &self,
        decided: &[Decided],
        clipping: Option<&Clipping>,
    ) -> [Row; 2] {
        let row = |effect, clipped: &[&Beyond], reason| {
            let decision = if clipped.is_empty() { Decision::NoOp } else { Decision::On };
            Row { effect, decision, tiles: clipped.len(), error: 0.0, reason }
        };
        let tiles = || decided.iter().map(|tile| &tile.beyond);
        let above: Vec<_> = tiles().filter(|tile| !tile.is_below_white()).collect();
        let below: Vec<_> = tiles().filter(|tile| !tile.is_above_black()).collect();
        let pixels = self.grid.width * self.grid.height;
        let share = |clipped: &[&Beyond]| {
            let clipped: usize = clipped.iter().map(|tile| tile.pixels).sum();
            format!("{:.3} % of the painting", 100.0 * clipped as f64 / pixels as f64)
        };
        if self.options.display.is_none() {
            let reason = "the exposure is not known before the picture".to_owned();
            let all: Vec<_> = tiles().collect();
            return [
                row(Effect::Clipping, &all, reason.clone()),
                row(Effect::GamutClipping, &all, reason),
            ];
        }
        let brightest = tiles().map(|tile| tile.light[1]).fold(0.0, f64::max);
        let darkest = tiles().map(|tile| tile.light[0]).fold(0.0, f64::min);
        let bounded = tiles().all(|tile| tile.light[0].is_finite() && tile.light[1].is_finite());
        let whole = match clipping.map_or(0, Clipping::whole) {
            0 => String::new(),
            tiles => format!("; {tiles} tiles are clipped whole, and not lit"),
        };
        let too_bright = match (above.is_empty(), bounded) {
            (true, _) => format!("no light exceeds {brightest:.3} of the range"),
            (_, true) => format!(
                "light of up to {brightest:.3} of the range, {:.2} stops too many, in at most {}{whole}",
                brightest.log2(),
                share(&above)
            ),
            (_, false) => format!("light without a bound in {}{whole}", share(&above)),
        };
        let outside = match (below.is_empty(), bounded) {
            (true, _) => "no channel falls below 0".to_owned(),
            (_, true) => {
                format!(
                    "a channel may fall to {darkest:.2e} of the range, in at most {}",
                    share(&below)
                )
            }
            (_, false) => format!("light without a bound in {}", share(&below)),
        };
        [row(Effect::Clipping, &above, too_bright), row(Effect::GamutClipping, &below, outside)]
    }
}
