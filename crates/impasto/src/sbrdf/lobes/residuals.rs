//! What a pixel's fit leaves of its photographs, and whether its neighbour's leaves the same.

use crate::lm::nnls::Sums;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Vec3};

use super::model::{LobeEstimation, Visit};
use super::photographs::Photographs;
use super::tile::{Estimate, LobeFitTile};

/// Residuals of one pixel under its present estimate.
pub(super) struct Residuals<'a, M: LobeEstimation> {
    pub(super) photographs: &'a Photographs<M>,
    pub(super) tile: &'a LobeFitTile,
    pub(super) ambient: bool,
    pub(super) pixel: usize,
    pub(super) level: Level,
}

impl<M: LobeEstimation> Residuals<'_, M> {
    /// Of the mean of the bands in every photograph, in units of their standard deviations, up to a
    /// factor; 0 where a photograph does not count.
    pub(super) fn weighted(self) -> Vec<f64> {
        M::dispatch(self.tile.estimates[self.pixel].lobes, self)
    }
}

impl<M: LobeEstimation> Visit for Residuals<'_, M> {
    type Output = Vec<f64>;

    fn visit<const J: usize, const K: usize, const N: usize>(self) -> Vec<f64> {
        let level = self.level;
        level.run(Look::<M, J, K>(self))
    }
}

/// A kernel although it uses no lanes: outside of one a fused multiply-add is a function call.
struct Look<'a, M: LobeEstimation, const J: usize, const K: usize>(Residuals<'a, M>);

impl<M: LobeEstimation, const J: usize, const K: usize> Kernel for Look<'_, M, J, K> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Vec<f64> {
        let Residuals { photographs, tile, ambient, pixel, .. } = self.0;
        let Estimate { normal, shapes, .. } = &tile.estimates[pixel];
        let [nx, ny, nz] = normal.map(f64::from);
        let normal = Vec3::new(nx, ny, nz);
        let [x, y] = [&tile.x, &tile.y].map(|axis| f64::from(axis[pixel]));
        let model = &photographs.model;
        let lobes: [M::Lobe<f64>; J] =
            core::array::from_fn(|lobe| model.lobe_from_unknowns(shapes[lobe].map(f64::from)));
        let mut seen = Vec::with_capacity(photographs.len());
        let mut sums = Sums::<f64, K>::zero();
        for photograph in 0..photographs.len() {
            let [sample, weight] = tile.colour.mean(photograph, pixel);
            let (towards, irradiance, pair) = photographs.at::<f64>(photograph, x, y);
            let mut columns = [1.0; K];
            let lit = normal.dot(towards) > 0.0;
            let diffuse = photographs.diffuse(normal, towards, &pair).value;
            columns[0] = if lit { diffuse * irradiance } else { 0.0 };
            for (lobe, column) in lobes.iter().zip(&mut columns[1..]) {
                *column = model.value(lobe, &pair, normal) * irradiance;
            }
            sums.add(&columns, weight, sample);
            seen.push((columns, weight, sample));
        }
        let barred = core::array::from_fn(|column| column == K - 1 && !ambient);
        let colours = sums.solve(&barred).values;
        let residual = |(columns, weight, sample): ([f64; K], f64, f64)| {
            let shown: f64 = columns.iter().zip(&colours).map(|(a, b)| a * b).sum();
            weight.sqrt() * (sample - shown)
        };
        seen.into_iter().map(residual).collect()
    }
}

/// Pixels with which a pixel is compared: the more, the less chance decides.
const COMPARED: usize = 8;

/// Mean correlation of the last pixel's residuals over the photographs with those of the pixels
/// before it: its terms of Moran's I [@moran1950]. Noise is another in every pixel; what a model
/// lacks, it lacks in all. NaN for the first pixel.
pub(super) fn likeness(residuals: &[Vec<f64>]) -> f32 {
    let Some((own, before)) = residuals.split_last() else { return f32::NAN };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let found: Vec<f64> = before
        .iter()
        .rev()
        .take(COMPARED)
        .map(|other| dot(own, other) / (dot(own, own) * dot(other, other)).sqrt())
        .filter(|one| !one.is_nan())
        .collect();
    (found.iter().sum::<f64>() / found.len() as f64) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_the_same_in_all_pixels_is_alike() {
        let [a, b] = [vec![1.0, -2.0, 0.5, 0.0], vec![2.0, 1.0, 0.0, 0.0]];
        assert!(likeness(&[]).is_nan());
        assert!(likeness(core::slice::from_ref(&a)).is_nan());
        assert_eq!(likeness(&[a.clone(), b.clone()]), 0.0);
        assert_eq!(likeness(&[b.clone(), b.clone(), a.clone(), b]), (2.0 / 3.0) as f32);
        let far = a.iter().map(|one| -3.0 * one).collect();
        assert_eq!(likeness(&[vec![0.0; 4], far, a]), -1.0);
    }
}
