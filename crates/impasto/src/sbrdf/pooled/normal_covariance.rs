//! The predicted error of a normal under the painting's lobe, with what the lobe does not describe.
//!
//! The sandwich covariance [@huber1967sandwich; @white1980] of an M-estimate takes the scatter of the
//! samples' pulls for what it is, photograph by photograph: pulls of the bands of one photograph
//! count together, as an error of the model would have it. The scale's weights fall faster than residuals
//! grow, so that its curvature is less than that of weighted least squares: along a residual it is
//! `w (1 - 4 v / (1 + v))`, which is kept above a quarter of `w`. Where residuals are noise the
//! covariance of normal noise is known better: the sandwich counts as far as they are coherent. Errors that are smooth over the
//! lights leave no scatter: as for [lobes of single pixels](crate::sbrdf), the deviation is
//! multiplied by `1 + kappa sin(t) coherence`. One lobe for the painting describes less than a pixel's
//! own, and `kappa` is larger.

use crate::math::{Real, Vec3};
use crate::sbrdf::coherence::Coherence;

use super::pixel::{Pixels, tangents};
use super::scale::weight;

/// `kappa`, calibrated on path-traced objects of known normals (docs/numerics.md).
const SMOOTH: f64 = 8.0;

/// Least curvature of a photograph, as a share of its weight: beyond it a first-order step says
/// nothing.
const LEAST_CURVATURE: f64 = 0.25;

/// What a photograph adds to the equations of two tilts.
#[derive(Clone, Copy)]
struct Pull<R> {
    cosine: R,
    /// Slopes of the diffuse term of reflectance 1, and of the specular part.
    t: [R; 2],
    g: [R; 2],
    /// The weight of the residuals, summed over the bands and so multiplied by the colours.
    plain: R,
    coloured: R,
}

/// Memory for one register of pixels.
pub(super) struct NormalErrors<R> {
    pulls: Vec<Pull<R>>,
    coherence: Coherence<R>,
}

impl<R: Real<Scalar = f32>> NormalErrors<R> {
    pub(super) fn new(photographs: usize, bands: usize) -> Self {
        let zero = R::zero();
        let none = Pull { cosine: zero, t: [zero; 2], g: [zero; 2], plain: zero, coloured: zero };
        Self { pulls: vec![none; photographs], coherence: Coherence::new(photographs, bands) }
    }

    /// Variance along the worst axis by the sandwich, the coherence of the residuals, and the factor of
    /// the deviation for what is smooth; from the place of the last [`Pixels::leave`].
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "several arrays share an index")]
    pub(super) fn of(
        &mut self,
        pixels: &Pixels<'_, R>,
        normal: Vec3<R>,
        colours: &[R],
        scale: R,
        nearest: &[Vec<usize>],
    ) -> [R; 3] {
        let (zero, one) = (R::zero(), R::one());
        let bands = colours.len();
        let count = R::of(bands as f64);
        let tilt = tangents(normal);
        let (mut sum, mut squares) = (zero, zero);
        for &colour in colours {
            sum = sum + colour;
            squares = colour.mul_add(colour, squares);
        }
        self.coherence.clear();
        let mut own = zero;
        let [mut ct, mut cg] = [[zero; 2]; 2];
        // Triangles: both tilts alone, and with each other.
        let [mut tt, mut tg, mut gg] = [[zero; 3]; 3];
        for (i, (towards, irradiance, facet)) in pixels.geometry.iter().enumerate() {
            let (cosine, glint, lobe) = pixels.seen[i];
            let full = weight(pixels.squares[i], scale, pixels.usable[i]) * pixels.precision[i];
            let slope = facet.slope(normal, glint, lobe, pixels.beta, pixels.sharpness);
            let lit = R::keep(cosine.gt(zero), *irradiance);
            let by_normal = pixels.photographs.diffuse_slope(normal, *towards, facet);
            let t = tilt.map(|tilt| tilt.dot(by_normal) * lit);
            let g = tilt.map(|tilt| tilt.dot(slope.normal) * *irradiance);
            let (mut plain, mut coloured, mut energy) = (zero, zero, zero);
            let root = full.sqrt();
            for (&residual, &colour) in pixels.residuals[i * bands..].iter().zip(colours) {
                plain = plain + residual;
                coloured = colour.mul_add(residual, coloured);
                energy = residual.mul_add(residual, energy);
                self.coherence.add(i, root * residual, pixels.usable[i]);
            }
            self.coherence.end_photograph();
            let alike = R::keep(energy.gt(zero), plain * plain / (energy * count));
            let far = pixels.squares[i] / (pixels.squares[i] + scale);
            let bent = (-(R::of(4.0) * far)).mul_add(alike, one).max(R::of(LEAST_CURVATURE));
            let heavy = full * bent;
            own = (heavy * cosine).mul_add(cosine, own);
            for k in 0..2 {
                ct[k] = (heavy * cosine).mul_add(t[k], ct[k]);
                cg[k] = (heavy * cosine).mul_add(g[k], cg[k]);
            }
            for (place, [k, l]) in [[0, 0], [0, 1], [1, 1]].into_iter().enumerate() {
                tt[place] = (heavy * t[k]).mul_add(t[l], tt[place]);
                tg[place] = (heavy * t[k]).mul_add(g[l], (heavy * t[l]).mul_add(g[k], tg[place]));
                gg[place] = (heavy * g[k]).mul_add(g[l], gg[place]);
            }
            self.pulls[i] = Pull { cosine, t, g, plain: full * plain, coloured: full * coloured };
        }
        let inverse = R::keep(own.gt(zero), own.recip());
        let mut matrix = [zero; 3];
        for (place, [k, l]) in [[0, 0], [0, 1], [1, 1]].into_iter().enumerate() {
            // What couples two tilts directly, less what goes through the colours.
            let tt = (-(ct[k] * ct[l])).mul_add(inverse, tt[place]);
            let tg = (-ct[k].mul_add(cg[l], ct[l] * cg[k])).mul_add(inverse, tg[place]);
            let gg = (-(cg[k] * cg[l])).mul_add(inverse, gg[place]);
            matrix[place] = squares.mul_add(tt, sum.mul_add(tg, count * gg));
        }
        let mut scatter = [zero; 3];
        for pull in &self.pulls {
            let mut both = [zero; 2];
            for k in 0..2 {
                let along = pull.cosine * inverse;
                let t = (-along).mul_add(ct[k], pull.t[k]);
                let g = (-along).mul_add(cg[k], pull.g[k]);
                both[k] = pull.coloured.mul_add(t, pull.plain * g);
            }
            for (place, [k, l]) in [[0, 0], [0, 1], [1, 1]].into_iter().enumerate() {
                scatter[place] = both[k].mul_add(both[l], scatter[place]);
            }
        }
        let [xx, xy, yy] = matrix;
        let determinant = xx.mul_add(yy, -(xy * xy));
        let inverse = R::keep(determinant.gt(zero), determinant.recip());
        let [a, b, d] = [yy * inverse, -(xy * inverse), xx * inverse];
        let [sa, sb, sd] = scatter;
        let [top, side] = [a.mul_add(sa, b * sb), a.mul_add(sb, b * sd)];
        let [under, low] = [b.mul_add(sa, d * sb), b.mul_add(sb, d * sd)];
        let [xx, xy, yy] =
            [top.mul_add(a, side * b), top.mul_add(b, side * d), under.mul_add(b, low * d)];
        let half = R::of(0.5);
        let (middle, apart) = ((xx + yy) * half, (xx - yy) * half);
        let worst = middle + apart.mul_add(apart, xy * xy).sqrt();
        let lean = normal.x.mul_add(normal.x, normal.y * normal.y).sqrt();
        let share = self.coherence.share(nearest);
        let smooth = lean * R::of(SMOOTH) * share;
        // Fourth powers of a few pixels leave the range of single precision.
        [R::keep(worst.is_finite(), worst), share, one + smooth]
    }
}
