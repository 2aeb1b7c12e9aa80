//! Light of an environment on the pixels of a block: irradiance, then every lobe, then colour.

use super::lafortune::{Prefiltered, level_of};
use super::light::Environment;
use super::table::projected;
use super::tables::{Lobes, Tables};
use crate::error::Result;
use crate::geometry::{Grid, View};
use crate::math::elementary::{exp_in_range, ln_in_range};
use crate::math::{Isa, Real, Vec3};
use crate::pixels::Run;
use crate::relight::block::{BLOCK, Block, Pixels, Plane};
use crate::relight::colour::{colour, shine};
use crate::relight::occlusion::one_bounce;
use crate::relight::scene::{Colour, Scene};
use crate::relight::shadow::Shares;
use crate::relight::shadow::horizon::Horizons;
use crate::surface::{Lobe, Strength, Surface, scaled};

/// Bounds of `ln |p|^n`, those of the model under a lamp (`brdf::lafortune`).
const LOG_POWER: [f64; 2] = [-60.0, 40.0];

/// Squared length of p below which a lobe is dark.
const SHORT: f64 = 1e-17;

/// An environment over a surface: all that does not depend on the pixel.
pub(crate) struct Lit<'a> {
    environment: &'a Environment,
    colours: [&'a Colour; 3],
    view: View,
    surface: &'a Surface<'a>,
    tables: Tables<'a>,
    sky: Option<Sky>,
}

/// Least `1 + n_z` of a normal, which may be longer than 1 by its rounding.
const AWAY: f32 = 1e-6;

/// Azimuths at which a pixel's horizon is looked for under an environment.
const AZIMUTHS: usize = 16;

/// What the relief hides of an environment and gives back of its light.
#[derive(Clone, Debug)]
pub struct Sky {
    /// Which share of an even sky's light each pixel sees. Over the share that a plane with its normal
    /// alone would see, `(1 + n_z) / 2`, it is taken for the share of the environment's light that
    /// is left, diffuse and mirrored.
    pub seen: Shares,
    /// Mean reflectance of the relief around a pixel, for one bounce of diffuse light; 0: none.
    pub albedo: f32,
}

impl Sky {
    /// Over a relief `(y, x)` in mm, where tiles are `wanted`, by column and row of tiles.
    ///
    /// # Errors
    /// If the sizes disagree, or the caller cancels.
    pub fn over(
        relief: &[f32],
        grid: Grid,
        albedo: f32,
        wanted: impl Fn(usize, usize) -> bool + Sync,
        run: &Run<'_>,
    ) -> Result<Self> {
        let seen = Horizons::sky(AZIMUTHS)?.seen_where(relief, grid, wanted, run)?;
        Ok(Self { seen, albedo })
    }
}

impl<'a> Lit<'a> {
    /// The tables that a surface needs.
    ///
    /// # Errors
    /// If the caller cancels.
    pub(crate) fn new(
        surface: &'a Surface<'a>,
        scene: &'a Scene,
        (environment, colours): (&'a Environment, [usize; 3]),
        sky: Option<Sky>,
        run: &Run<'_>,
    ) -> Result<Self> {
        let tables = Tables::new(surface, environment, scene.view(), run)?;
        let colours = colours.map(|index| &scene.colours()[index]);
        Ok(Self { environment, colours, view: scene.view(), surface, tables, sky })
    }

    /// Whether it reads where pixels lie.
    pub(crate) fn needs_place(&self) -> bool {
        !self.view.is_distant()
    }

    /// Adds the light of all three channels to a block, whose first pixel has a column and row.
    #[inline(always)]
    pub(crate) fn shade<I: Isa>(
        &self,
        block: &mut Block,
        pixels: &Pixels<'_>,
        [column, row]: [usize; 2],
    ) {
        let range = (pixels.start, pixels.count);
        let sky = self.sky.as_ref().and_then(|sky| Some((sky.seen.row(column, row)?, sky.albedo)));
        let mut left = [1.0; BLOCK];
        if let Some((codes, _)) = sky {
            for ((left, &code), z) in left.iter_mut().zip(codes).zip(pixels.normal[2]) {
                // What sees all of the sky loses nothing, however long its normal; what faces away from
                // it has nothing to lose.
                let whole = (1.0 + z).max(AWAY);
                let share = if code == u16::MAX { 1.0 } else { 2.0 * Shares::share(code) / whole };
                *left = share.min(1.0);
            }
        }
        let zero: [Plane; 3] = [[0.0; BLOCK]; 3];
        let mut places = [[0.0; BLOCK]; 2];
        for lane in (0..BLOCK).step_by(I::F32::WIDTH) {
            let [x, y] = projected(pixels.normal::<I>(lane));
            x.store(&mut places[0][lane..]);
            y.store(&mut places[1][lane..]);
        }
        let (mut diffuse, mut specular, mut value) = (zero, zero, zero);
        let view = |lane: usize| self.view_at::<I>(block, lane);
        self.tables.irradiance.shade::<I>(pixels.normal, &places, view, &mut diffuse);
        let weaken = |value: &mut [Plane; 3], albedo: f32| {
            for (light, &left) in value.iter_mut().flat_map(|plane| plane.iter_mut().zip(&left)) {
                *light *= one_bounce(left, albedo);
            }
        };
        if let Some((_, albedo)) = sky {
            weaken(&mut diffuse, albedo);
        }
        match &self.tables.lobes {
            Lobes::None => {}
            Lobes::Glossy(lobes) => {
                for glossy in lobes {
                    glossy.shade::<I>(&places, range, &mut value);
                    if sky.is_some() {
                        weaken(&mut value, 0.0);
                    }
                    self.add::<I>(block, glossy.lobe, &value, &mut specular, range);
                }
            }
            Lobes::Lafortune(maps) => {
                for lobe in &self.surface.lobes {
                    self.lafortune::<I>(block, pixels, lobe, maps, &mut value);
                    if sky.is_some() {
                        weaken(&mut value, 0.0);
                    }
                    self.add::<I>(block, lobe, &value, &mut specular, range);
                }
            }
        }
        for (channel, seen) in self.colours.iter().enumerate() {
            let count = pixels.count;
            block.diffuse[..count].copy_from_slice(&diffuse[channel][..count]);
            block.specular[..count].copy_from_slice(&specular[channel][..count]);
            block.shiny = true;
            colour::<I>(block, pixels, seen);
        }
    }

    #[inline(always)]
    fn view_at<I: Isa>(&self, block: &Block, lane: usize) -> Vec3<I::F32> {
        self.view.at(I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]))
    }

    /// What a Lafortune lobe reflects at unit strength.
    #[inline(always)]
    fn lafortune<I: Isa>(
        &self,
        block: &Block,
        pixels: &Pixels<'_>,
        lobe: &Lobe<'_>,
        maps: &Prefiltered,
        out: &mut [Plane; 3],
    ) {
        let (start, count) = (pixels.start, pixels.count);
        let zero = I::F32::zero();
        let mut towards: [Plane; 3] = [[0.0; BLOCK]; 3];
        let [mut x, mut y, mut level, mut factor]: [Plane; 4] = [[0.0; BLOCK]; 4];
        for lane in (0..count).step_by(I::F32::WIDTH) {
            let pixel = start + lane;
            let [cxy, cz, exponent]: [I::F32; 3] =
                [0, 1, 2].map(|parameter| lobe.shape[parameter].at(pixel));
            let (normal, view) = (pixels.normal::<I>(lane), self.view_at::<I>(block, lane));
            let cosine = normal.dot(view);
            let along = normal.scale((cz - cxy) * cosine);
            let p = view.mul_add(cxy, along);
            // |p|^2 without the rounding of its components: exactly 1 for a mirror.
            let flat = cxy * cxy;
            let square = cz.mul_add(cz, -flat).mul_add(cosine * cosine, flat);
            let short = I::F32::of(SHORT);
            let log = exponent * I::F32::of(0.5) * ln_in_range(square.max(short));
            let [least, most] = LOG_POWER.map(I::F32::of);
            let power = exp_in_range(log.max(least).min(most)) / (exponent + I::F32::of(2.0));
            // No highlight is seen from behind (false for NaN).
            let lit = cosine.gt(zero) & square.gt(short);
            let known = cxy.le(cxy) & cz.le(cz) & exponent.le(exponent);
            let power = I::F32::select(known, I::F32::keep(lit, power), I::F32::of(f64::NAN));
            power.store(&mut factor[lane..]);
            let length = p.length_squared().max(short).sqrt();
            let direction = p.scale(length.recip());
            let place = projected(direction);
            place[0].store(&mut x[lane..]);
            place[1].store(&mut y[lane..]);
            level_of(exponent).store(&mut level[lane..]);
            for (plane, value) in towards.iter_mut().zip(direction.array()) {
                value.store(&mut plane[lane..]);
            }
        }
        for pixel in 0..count {
            let factor = factor[pixel];
            if factor == 0.0 {
                for out in out.iter_mut() {
                    out[pixel] = 0.0;
                }
                continue;
            }
            let maps = maps.at::<I>([x[pixel], y[pixel]], level[pixel]);
            let vector = |[x, y, z]: [&Plane; 3]| Vec3::new(x[pixel], y[pixel], z[pixel]);
            let scheme = self.environment.scheme;
            let light = scheme.light(&maps, vector(pixels.normal), vector(towards.each_ref()));
            for (out, light) in out.iter_mut().zip(light) {
                out[pixel] = light * factor;
            }
        }
    }

    /// Adds what a lobe reflects: to the light that has the environment's colours, or, coloured as the
    /// lobe's strengths are, to the light of all colours.
    #[inline(always)]
    fn add<I: Isa>(
        &self,
        block: &mut Block,
        lobe: &Lobe<'_>,
        value: &[Plane; 3],
        specular: &mut [Plane; 3],
        (start, count): (usize, usize),
    ) {
        for (channel, seen) in self.colours.iter().enumerate() {
            match lobe.strength {
                Strength::Tinted(strengths) => {
                    shine::<I>(block, &value[channel], strengths, seen, (start, count));
                }
                Strength::Neutral(strength) => {
                    let sums = &mut specular[channel];
                    for lane in (0..count).step_by(I::F32::WIDTH) {
                        let value = I::F32::load(&value[channel][lane..]);
                        let sum = I::F32::load(&sums[lane..]);
                        (sum + scaled(strength.at(start + lane), value)).store(&mut sums[lane..]);
                    }
                }
            }
        }
    }
}
