//! What shows a picture, what a plan knows of the colours that it shows, and what it clips.

use super::interval::Interval;
use crate::relight::scene::{Colour, Scene};
use crate::surface::Surface;

/// How a picture is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Columns: linear display light, white 1, from the scene's output unit.
    pub matrix: [[f64; 3]; 3],
    /// The light where no painting is seen.
    pub background: [f32; 3],
}

/// A [`Colour`] whose weights are known within bounds.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    pub(super) diffuse: Vec<[Interval; 3]>,
    pub(super) interface: [Interval; 3],
}

impl Weights {
    fn exact(colour: &Colour) -> Self {
        Self::by(colour, |column| column.map(|value| [value; 2]))
    }

    /// Those of linear display light, with the roundings of everything from maps to codes: a share of
    /// the magnitudes that are summed up.
    fn shown(colour: &Colour, matrix: &[[f64; 3]; 3], rounding: f64) -> Self {
        Self::by(colour, |column| {
            [0, 1, 2].map(|channel: usize| {
                let terms = column.iter().zip(matrix).map(|(light, to)| light * to[channel]);
                let (sum, size) =
                    terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + f64::abs(term)));
                [sum - rounding * size, sum + rounding * size]
            })
        })
    }

    fn by(colour: &Colour, weigh: impl Fn(&[f64; 3]) -> [Interval; 3]) -> Self {
        Self {
            diffuse: colour.diffuse.iter().map(&weigh).collect(),
            interface: weigh(&colour.interface),
        }
    }
}

/// The colours of a scene with bounds: in its output unit, and as a display shows them.
#[derive(Clone, Debug)]
pub(super) struct Bounded {
    pub(super) light: Vec<Weights>,
    pub(super) shown: Option<Vec<Weights>>,
    /// What single precision adds to light that is shown, as a share of what it sums up.
    pub(super) rounding: f64,
}

impl Bounded {
    pub(super) fn of(surface: &Surface<'_>, scene: &Scene, display: Option<&Shown>) -> Self {
        let (lamps, lobes) = (scene.lamps().len() as f64, surface.lobes.len() as f64);
        let terms = scene.coefficients() as f64 + lamps * (2.0 + lobes);
        // Constants, weights and products are rounded, too, and the averages of a slanted view or of a
        // lens: less than sixty-four times besides the sums.
        let rounding = (64.0 + terms) * 2.0_f64.powi(-23);
        let shown = |display: &Shown| {
            let weights = |colour| Weights::shown(colour, &display.matrix, rounding);
            scene.colours().iter().map(weights).collect()
        };
        Self {
            light: scene.colours().iter().map(Weights::exact).collect(),
            shown: display.map(shown),
            rounding,
        }
    }
}

/// Light of a tile beyond the display.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beyond {
    /// The darkest and the brightest of all channels: linear display light, white 1. NaN where nothing
    /// is known.
    pub(super) light: Interval,
    /// Pixels that show something.
    pub(super) pixels: usize,
    /// Where all light lies beyond the display, whether each channel is above it; holds without
    /// shadows.
    pub(super) all: Option<[bool; 3]>,
}

impl Beyond {
    /// Whether no light exceeds the display's white; not where nothing is known.
    pub(super) fn is_below_white(&self) -> bool {
        self.light[1] <= 1.0
    }

    /// Whether no light is below 0; not where nothing is known.
    pub(super) fn is_above_black(&self) -> bool {
        self.light[0] >= 0.0
    }
}

/// What is known of the light that a display shows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Clipping {
    matrix: [[f64; 3]; 3],
    /// Per tile, as of [`Beyond`].
    all: Vec<Option<[bool; 3]>>,
}

impl Clipping {
    /// Of all tiles, and whether a shadow may fall on each.
    pub(super) fn new<'a>(
        display: &Shown,
        tiles: impl Iterator<Item = (&'a Beyond, bool)>,
    ) -> Self {
        let all = tiles.map(|(tile, shaded)| tile.all.filter(|_| !shaded)).collect();
        Self { matrix: display.matrix, all }
    }

    /// How many tiles have one colour.
    pub(super) fn whole(&self) -> usize {
        self.all.iter().flatten().count()
    }

    /// That of a tile; nothing is known of another display.
    pub(super) fn all(&self, tile: usize, matrix: &[[f64; 3]]) -> Option<[bool; 3]> {
        self.all[tile].filter(|_| self.matrix[..] == *matrix)
    }
}
