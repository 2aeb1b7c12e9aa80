//! How often passes look at the caller's flag, counted instead of timed.

use super::Extraction;
use super::irls::ScaleReference;
use super::passes::Fit;
use super::pixel::Lobe;
use super::samples::{Photographs, State};
use crate::error::Result;
use crate::math::{Isa, Kernel, Level, Real};
use crate::pixels::{Run, looks};
use crate::sbrdf::tests::{PIXELS, Painting};

/// Pixels of a register.
struct Width;

impl Kernel for Width {
    type Output = usize;

    #[inline(always)]
    fn run<I: Isa>(self) -> usize {
        I::F32::WIDTH
    }
}

type Pass<'a> = &'a dyn Fn(&Fit<'_>, &State) -> Result<()>;

#[test]
fn a_pass_looks_before_every_register_of_pixels() {
    let painting = Painting::new();
    let (stack, start) = (&painting.stack(), &painting.start());
    let lobe = Lobe { beta: 10.0, log_sharpness: 3.0 };
    let looks_of = |level: Level, pass: Pass<'_>| {
        let all = |run: &Run<'_>| {
            let run = &Run { level, ..*run };
            let photographs = &Photographs {
                stack,
                rig: &painting.rig,
                index: 1.45,
                bands: 2,
                status: start.status,
                places: None,
            };
            let scale_reference = ScaleReference { reference: 0.5, noise_floor: 0.0 };
            let state = State::new(start, run)?;
            pass(&Fit { photographs, run, scale_reference }, &state)
        };
        looks::count(all)
    };
    // How often each goes over the painting: what is specular is first asked how large it is.
    let passes: [(&str, usize, Pass<'_>); 3] = [
        ("extract", 2, &|fit, state| fit.extract(state, Extraction::Residual).map(drop)),
        ("settle", 1, &|fit, state| {
            let mut to = state.copied(fit.run)?;
            fit.settle(state, &mut to, lobe, 1, true).map(drop)
        }),
        ("measure", 1, &|fit, state| fit.measure(state, lobe).map(drop)),
    ];
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        let registers = PIXELS / level.run(Width);
        let nothing = looks_of(level, &|_, _| Ok(()));
        for (name, times, pass) in passes {
            let looks = looks_of(level, pass) - nothing;
            // Besides, a few: before and after each tile, and for copies.
            assert!(looks >= times * registers, "{name} on {level:?}: {looks}");
        }
    }
}
