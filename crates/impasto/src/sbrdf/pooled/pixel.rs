//! A register full of pixels under one lobe: residuals, their scale, and the equations of a step.
//!
//! The model is `y = E (rho_b (N.L) T + beta D F G / (N.V))` in photograph i and band b, `T` being what
//! an interface above the diffuse part transmits, 1 without one. Every band
//! of a photograph has the same weight and the same specular part, so that sums over bands fold
//! into sums over photographs: with `t` the slopes of the diffuse term and `g` those of the specular part, the
//! slope of a sample is `rho_b t + g`, and `sum_b (rho_b t + g)(rho_b t + g)'` needs only
//! `sum rho_b^2`, `sum rho_b` and the number of bands.

use crate::brdf::torrance_sparrow::{Facet, GAMMA_MAX, GAMMA_MIN, Glint, sharpness};
use crate::lm::Bounds;
use crate::math::{Real, Vec3};

use super::samples::{Photographs, Rows};
use super::scale::{above, count, squared_scale, weight};
use crate::math::tail::load;

/// A painting's lobe as the solver sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CommonLobe {
    pub(super) beta: f64,
    pub(super) log_sharpness: f64,
}

impl CommonLobe {
    /// Half-width of the facets, rad.
    pub(super) fn gamma(&self) -> f64 {
        (core::f64::consts::LN_2 / self.log_sharpness.exp()).sqrt()
    }

    /// Where a search looks for (beta, log k).
    pub(super) fn bounds() -> Bounds<f64, 2> {
        let [widest, narrowest] = [GAMMA_MAX, GAMMA_MIN].map(|gamma| sharpness(gamma).ln());
        Bounds { lower: [0.0, widest], upper: [f64::MAX, narrowest] }
    }
}

/// Squared scale below which residuals are rounding, relative to the brightest sample squared:
/// f32 keeps 24 bits, and a predicted sample is a sum of some ten rounded terms.
const ROUNDING: f64 = 1.0 / (1_u64 << 40) as f64;

/// The least of it: of a pixel so much darker than the painting that its squares vanish, residuals
/// still have a scale whose reciprocal is a number.
const FAINTEST: f32 = 4.0 * f32::MIN_POSITIVE;

/// A photograph with this many times the squared scale, which counts for a twenty-fifth, may be a
/// highlight that is not explained.
pub(super) const FARTHEST: f64 = 4.0;

/// Variance of a photograph's samples in units of the pixel's mean: proportional to their light
/// (shot noise; errors of a tone curve and of the model grow with it, too), plus this share of the
/// mean for what noise there is in the dark.
const DARK_NOISE: f64 = 0.1;

/// Added to the diagonals of the tilts, relative: enough to keep an undetermined direction (coplanar
/// lights, hard case 19) from moving, too little to slow the others down.
const RIDGE: f64 = 1e-3;

/// Samples of the pixels in one register, and what the last place predicted of them.
pub(super) struct Pixels<'a, R: Real> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) beta: R,
    pub(super) sharpness: R,
    /// Light, irradiance and facet per photograph.
    pub(super) geometry: Vec<(Vec3<R>, R, Facet<R>)>,
    /// `(obs, band)`; 0 where not usable.
    samples: Vec<R>,
    pub(super) usable: Vec<R::Mask>,
    /// One over the expected variance of a photograph's samples.
    pub(super) precision: Vec<R>,
    /// `(obs, band)` at the last place.
    pub(super) residuals: Vec<R>,
    /// Mean over the bands of the squared residuals, times the precision, per photograph.
    pub(super) squares: Vec<R>,
    pub(super) seen: Vec<(R, Glint<R>, R)>,
    /// Usable photographs.
    pub(super) used: R,
    /// Squared scale at which residuals are rounding.
    pub(super) floor: R,
}

impl<'a, R: Real<Scalar = f32>> Pixels<'a, R> {
    pub(super) fn new(photographs: &'a Photographs<'a>, lobe: CommonLobe) -> Self {
        let (zero, pairs) = (R::zero(), photographs.pairs);
        let geometry: Vec<_> = (0..pairs.len()).map(|pair| pairs.at(pair, zero, zero)).collect();
        let observations = geometry.len();
        let glint = Glint { weight: zero, phi_squared: zero, open: zero };
        Self {
            photographs,
            beta: R::of(lobe.beta),
            sharpness: R::of(lobe.log_sharpness.exp()),
            geometry,
            samples: vec![zero; observations * photographs.bands],
            usable: vec![zero.lt(zero); observations],
            precision: vec![zero; observations],
            residuals: vec![zero; observations * photographs.bands],
            squares: vec![zero; observations],
            seen: vec![(zero, glint, zero); observations],
            used: zero,
            floor: zero,
        }
    }

    /// Takes up the pixels from `at` on.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn look(&mut self, rows: &Rows<'_>, at: usize) {
        let bands = self.photographs.bands;
        let zero = R::zero();
        let (mut peak, mut mean) = (zero, zero);
        for i in 0..self.geometry.len() {
            if !self.photographs.pairs.is_distant(i) {
                let (px, py) = (load(rows.x, at), load(rows.y, at));
                self.geometry[i] = self.photographs.pairs.at(i, px, py);
            }
            // Clipped in any band, never taken, or with a square beyond all numbers: weight 0, by
            // selection (hard case 26).
            let mut usable = zero.le(zero);
            for plane in i * bands..(i + 1) * bands {
                let sample: R = load(&rows.planes[plane * rows.stride..], at);
                self.samples[plane] = sample;
                usable = usable & (sample * sample).is_finite();
            }
            self.usable[i] = usable;
            let mut light = zero;
            for plane in i * bands..(i + 1) * bands {
                let sample = R::keep(usable, self.samples[plane]);
                self.samples[plane] = sample;
                peak = peak.max(sample.abs());
                light = light + sample;
            }
            self.precision[i] = light.max(zero);
            mean = mean + self.precision[i];
        }
        self.used = count(&self.usable);
        self.floor = (peak * peak * R::of(ROUNDING)).max(R::splat(FAINTEST));
        let mean = mean / self.used;
        let dark = mean * R::of(DARK_NOISE);
        for i in 0..self.precision.len() {
            let precision = mean / (self.precision[i] + dark);
            self.precision[i] = R::keep(mean.gt(zero), precision);
        }
    }

    /// The facet that mirrors the brightest photograph into the eye.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn brightest_facet(&self) -> Vec3<R> {
        let zero = R::zero();
        let mut peak = zero;
        let mut facing = Vec3::new(zero, zero, R::one());
        let bands = self.photographs.bands;
        for i in 0..self.geometry.len() {
            let (_, irradiance, facet) = &self.geometry[i];
            let mut light = zero;
            for plane in i * bands..(i + 1) * bands {
                light = light + self.samples[plane];
            }
            let light = light / *irradiance;
            let brighter = light.gt(peak);
            peak = R::select(brighter, light, peak);
            facing = Vec3::select(brighter, facet.half(), facing);
        }
        facing
    }

    /// Residuals at a place. Without `GLOSS` under no lobe, whatever the painting's.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn leave<const GLOSS: bool>(&mut self, normal: Vec3<R>, colours: &[R]) {
        let bands = self.photographs.bands;
        let share = R::of(1.0 / bands as f64);
        for i in 0..self.geometry.len() {
            let (towards, irradiance, facet) = &self.geometry[i];
            let cosine = self.photographs.diffuse(normal, *towards, facet) * *irradiance;
            self.seen[i].0 = cosine;
            let mut specular = R::zero();
            if GLOSS {
                let glint = facet.on(normal);
                let lobe = glint.lobe(self.sharpness);
                specular = self.beta * glint.weight * lobe * *irradiance;
                self.seen[i] = (cosine, glint, lobe);
            }
            let usable = self.usable[i];
            let mut square = R::zero();
            for band in 0..bands {
                let sample = self.samples[i * bands + band];
                let predicted = colours[band].mul_add(cosine, specular);
                let residual = R::keep(usable, sample - predicted);
                self.residuals[i * bands + band] = residual;
                square = residual.mul_add(residual, square);
            }
            self.squares[i] = square * share * self.precision[i];
        }
    }

    /// A squared scale above that of the last place.
    #[inline(always)]
    pub(super) fn above(&self) -> R {
        above(&self.squares, self.used)
    }

    /// The squared scale of the last place, from one that is near.
    #[inline(always)]
    pub(super) fn scale(&self, near: R) -> R {
        squared_scale(&self.squares, self.used, self.floor, near)
    }

    /// The largest square of a photograph at the last place.
    #[inline(always)]
    pub(super) fn farthest(&self) -> R {
        let mut farthest = R::zero();
        for &square in &self.squares {
            farthest = farthest.max(square);
        }
        farthest
    }

    /// The equations of a step from the place of the last [`Self::leave`].
    ///
    /// `SLOPES` is how many slopes of the specular part they have: all 4, only 2 of the tilts, or 0
    /// under no lobe.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn equations<const SLOPES: usize>(
        &self,
        normal: Vec3<R>,
        colours: &[R],
        scale: R,
        pulls: &mut [R],
    ) -> Equations<R> {
        let zero = R::zero();
        let bands = self.photographs.bands;
        let tilt = tangents(normal);
        let mut sums = Equations::zero();
        pulls.fill(zero);
        for i in 0..self.geometry.len() {
            let (towards, irradiance, facet) = &self.geometry[i];
            let (cosine, glint, lobe) = self.seen[i];
            let lasting = weight(self.squares[i], scale, self.usable[i]);
            let weight = lasting * self.precision[i];
            let lit = R::keep(cosine.gt(zero), *irradiance);
            let by_normal = self.photographs.diffuse_slope(normal, *towards, facet);
            let t = [tilt[0].dot(by_normal) * lit, tilt[1].dot(by_normal) * lit];
            let mut g = [zero; 4];
            if SLOPES > 0 {
                let slope = facet.slope(normal, glint, lobe, self.beta, self.sharpness);
                g = [
                    tilt[0].dot(slope.normal) * *irradiance,
                    tilt[1].dot(slope.normal) * *irradiance,
                    slope.beta * *irradiance,
                    slope.log_sharpness * *irradiance,
                ];
            }
            let heavy = weight * cosine;
            let (mut plain, mut coloured) = (zero, zero);
            for band in 0..bands {
                let residual = self.residuals[i * bands + band];
                plain = plain + residual;
                coloured = colours[band].mul_add(residual, coloured);
                pulls[band] = heavy.mul_add(residual, pulls[band]);
            }
            sums.own = heavy.mul_add(cosine, sums.own);
            sums.square = lasting.mul_add(self.squares[i], sums.square);
            sums.weight = sums.weight + weight;
            let plain = weight * plain;
            let coloured = weight * coloured;
            let mut place = 0;
            for row in 0..SLOPES {
                sums.g[row] = heavy.mul_add(g[row], sums.g[row]);
                sums.descent[row] = g[row].mul_add(plain, sums.descent[row]);
                let left = weight * g[row];
                for column in 0..=row {
                    sums.gg[place] = left.mul_add(g[column], sums.gg[place]);
                    place += 1;
                }
            }
            let mut place = 0;
            for row in 0..2 {
                sums.t[row] = heavy.mul_add(t[row], sums.t[row]);
                sums.descent[row] = t[row].mul_add(coloured, sums.descent[row]);
                let left = weight * t[row];
                for column in 0..SLOPES {
                    sums.tg[row][column] = left.mul_add(g[column], sums.tg[row][column]);
                }
                for column in 0..=row {
                    sums.tt[place] = left.mul_add(t[column], sums.tt[place]);
                    place += 1;
                }
            }
        }
        sums
    }
}

/// Two directions of the tangent plane, orthonormal, without a branch for any normal with z > -1.
#[inline(always)]
pub(in crate::sbrdf) fn tangents<R: Real>(n: Vec3<R>) -> [Vec3<R>; 2] {
    let one = R::one();
    let across = one / (one + n.z);
    let bend = -(n.x * n.y * across);
    [
        Vec3::new((-(n.x * n.x)).mul_add(across, one), bend, -n.x),
        Vec3::new(bend, (-(n.y * n.y)).mul_add(across, one), -n.y),
    ]
}

/// Sums over the photographs of a pixel; index 0 and 1 are tilts, 2 is beta, 3 is log k. Triangles
/// are stored row by row.
#[derive(Clone, Copy)]
pub(super) struct Equations<R> {
    /// `w c c`: the diagonal of every colour.
    own: R,
    /// `w c t`, `w c g`.
    t: [R; 2],
    g: [R; 4],
    tt: [R; 3],
    tg: [[R; 4]; 2],
    gg: [R; 10],
    /// `w (rho_b t + g) r_b`.
    descent: [R; 4],
    /// `w` times the mean squared residual of the bands, and `w`.
    pub(super) square: R,
    pub(super) weight: R,
}

/// The equations of two tilts, beta and log k, the colours following.
#[derive(Clone, Copy)]
pub(super) struct Reduced<R> {
    pub(super) matrix: [R; 10],
    pub(super) descent: [R; 4],
}

impl<R: Real> Equations<R> {
    fn zero() -> Self {
        let o = R::zero();
        Self {
            own: o,
            t: [o; 2],
            g: [o; 4],
            tt: [o; 3],
            tg: [[o; 4]; 2],
            gg: [o; 10],
            descent: [o; 4],
            square: o,
            weight: o,
        }
    }

    /// `1 / own`, 0 for a pixel that no light reaches.
    #[inline(always)]
    fn inverse(&self) -> R {
        R::keep(self.own.gt(R::zero()), self.own.recip())
    }

    /// Eliminates the colours (a Schur complement).
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn reduced(&self, colours: &[R], pulls: &[R]) -> Reduced<R> {
        let zero = R::zero();
        let bands = R::of(colours.len() as f64);
        let inverse = self.inverse();
        let (mut sum, mut squares, mut pull, mut coloured) = (zero, zero, zero, zero);
        for band in 0..colours.len() {
            let (colour, b) = (colours[band], pulls[band]);
            sum = sum + colour;
            squares = colour.mul_add(colour, squares);
            pull = pull + b;
            coloured = colour.mul_add(b, coloured);
        }
        let t = [self.t[0], self.t[1], zero, zero];
        let mut matrix = [zero; 10];
        let mut place = 0;
        for row in 0..4 {
            for column in 0..=row {
                // What couples two unknowns directly, less what goes through the colours.
                let gg = self.gg[place] - self.g[row] * self.g[column] * inverse;
                let mut value = bands * gg;
                if column < 2 {
                    let mut mixed = self.tg[column][row] - t[column] * self.g[row] * inverse;
                    if row < 2 {
                        mixed = mixed + self.tg[row][column] - t[row] * self.g[column] * inverse;
                        let tt = self.tt[place] - t[row] * t[column] * inverse;
                        value = squares.mul_add(tt, value);
                    }
                    value = sum.mul_add(mixed, value);
                }
                matrix[place] = value;
                place += 1;
            }
        }
        let mut descent = [R::zero(); 4];
        for row in 0..4 {
            let through = self.g[row].mul_add(pull, t[row] * coloured);
            descent[row] = (-through).mul_add(inverse, self.descent[row]);
        }
        Reduced { matrix, descent }
    }

    /// How far each colour follows a tilt.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn follow(&self, tilt: [R; 2], colours: &[R], pulls: &[R], changes: &mut [R]) {
        let inverse = self.inverse();
        let along_t = self.t[0].mul_add(tilt[0], self.t[1] * tilt[1]);
        let along_g = self.g[0].mul_add(tilt[0], self.g[1] * tilt[1]);
        for band in 0..colours.len() {
            let along = colours[band].mul_add(along_t, along_g);
            changes[band] = (pulls[band] - along) * inverse;
        }
    }
}

/// A pixel's equations of (beta, log k), colours and normal following.
pub(super) struct PixelEquations<R> {
    pub(super) descent: [R; 2],
    /// beta beta, log k beta, log k log k.
    pub(super) matrix: [R; 3],
}

impl<R: Real> Reduced<R> {
    /// The tilt that solves the equations under a lobe; none for too few samples (hard case 30).
    #[inline(always)]
    pub(super) fn tilt(&self) -> [R; 2] {
        let [xx, xy, yy, ..] = self.matrix;
        let ridge = R::of(1.0 + RIDGE);
        solve(xx * ridge, xy, yy * ridge, self.descent[0], self.descent[1])
    }

    /// Eliminates the tilts.
    #[inline(always)]
    pub(super) fn without_tilts(&self) -> PixelEquations<R> {
        let [xx, xy, yy, bx, by, bb, kx, ky, kb, kk] = self.matrix;
        let [gx, gy, gb, gk] = self.descent;
        let ridge = R::of(1.0 + RIDGE);
        let (rx, ry) = (xx * ridge, yy * ridge);
        let [b0, b1] = solve(rx, xy, ry, bx, by);
        let [k0, k1] = solve(rx, xy, ry, kx, ky);
        PixelEquations {
            descent: [
                (-b0).mul_add(gx, (-b1).mul_add(gy, gb)),
                (-k0).mul_add(gx, (-k1).mul_add(gy, gk)),
            ],
            matrix: [
                (-b0).mul_add(bx, (-b1).mul_add(by, bb)),
                (-b0).mul_add(kx, (-b1).mul_add(ky, kb)),
                (-k0).mul_add(kx, (-k1).mul_add(ky, kk)),
            ],
        }
    }
}

/// Solves a symmetric 2 x 2 system; 0 where it has no inverse.
#[inline(always)]
fn solve<R: Real>(xx: R, xy: R, yy: R, a: R, b: R) -> [R; 2] {
    let determinant = xx.mul_add(yy, -(xy * xy));
    let inverse = R::keep(determinant.gt(R::zero()), determinant.recip());
    [yy.mul_add(a, -(xy * b)) * inverse, xx.mul_add(b, -(xy * a)) * inverse]
}
