//! What is typical of a pixel's lobes, for those whose photographs hardly tell.
//!
//! Few lights fall near a pixel's highlight, and a narrow lobe between two of them fits anything.
//! Pixels all over the painting that know their lobes' shapes tell what is typical; every pixel's
//! shapes are then drawn towards it. Where the photographs know better that changes little; where
//! they know nothing the pixel has the painting's lobe, and its status says so.
//!
//! A painting is made of several materials, and what is typical of all is typical of none: a pixel
//! hears those that are like it.

use crate::math::elementary::exp;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Real};

use super::maps::MOST_LOBES;
use super::model::{LobeModel, MAX_SHAPES};
use super::tile::Place;

/// Pixels that must know a shape before it is typical of anything.
pub(super) const FEWEST: usize = 20;
/// Their share of all: some percent seem to have one lobe more than they have, by their noise.
const SHARE: f64 = 0.05;

/// Those that are asked, at most: 64 or 256 foretell photographs held out no better.
const ASKED: usize = 32;

/// How far shapes of one material lie from each other, as a share of how far those of a painting
/// do: 4 % of a lobe's width. Of 0.2, 0.3 and 0.5 this foretells photographs of the icon best, by
/// little; simulated varnishes, which are alike everywhere, want less.
const MATERIAL: f64 = 0.3;

/// Pixels that together have a smaller share are not like the one that asks: the nearest of them
/// lies 3.7 deviations away.
const ALIKE: f32 = 1e-3;

/// Pixels of a painting that know their shapes, by the number of their lobes; none where too few do.
#[derive(Clone, Debug)]
pub(super) struct Prior([Option<Box<Asked>>; MOST_LOBES]);

/// The first numbers of every row are those of so many pixels.
#[derive(Clone, Debug)]
struct Asked {
    count: usize,
    shapes: [[[f32; ASKED]; MAX_SHAPES]; MOST_LOBES],
    /// Variances of the shapes.
    doubts: [[f32; ASKED]; MOST_LOBES],
}

impl Asked {
    /// Some pixels of many. Quantiles: whatever the order of the pixels, and no material is left
    /// out by chance.
    fn of(known: &mut [&Place]) -> Self {
        let key = |place: &Place| place.shapes[0][0];
        known.sort_by(|a, b| key(a).total_cmp(&key(b)));
        let count = known.len().min(ASKED);
        let zero = [0.0; ASKED];
        let mut asked =
            Self { count, shapes: [[zero; MAX_SHAPES]; MOST_LOBES], doubts: [zero; MOST_LOBES] };
        for part in 0..count {
            let place = known[(2 * part + 1) * known.len() / (2 * count)];
            for (lobe, shape) in place.shapes.iter().enumerate() {
                for (number, &value) in shape.iter().enumerate() {
                    asked.shapes[lobe][number][part] = value;
                }
                asked.doubts[lobe][part] = square(place.shape_spread[lobe]);
            }
        }
        asked
    }
}

impl Prior {
    /// Some of the pixels that know their shapes better than shapes usually differ.
    pub(super) fn of_places<M: LobeModel>(model: &M, places: &[Place]) -> Self {
        let spread = model.spreads()[0] as f32;
        let fewest = FEWEST.max((SHARE * places.len() as f64) as usize);
        Self(core::array::from_fn(|index| {
            let knows = |place: &&Place| {
                place.lobes == index + 1
                    && place.shape_spread[..=index].iter().all(|&own| own < spread)
            };
            let mut known: Vec<&Place> = places.iter().filter(knows).collect();
            (known.len() >= fewest).then(|| Box::new(Asked::of(&mut known)))
        }))
    }

    /// Whether anything is typical of pixels with so many lobes.
    pub(super) fn knows(&self, lobes: usize) -> bool {
        self.0[lobes - 1].is_some()
    }
}

/// Asks what is typical of pixels whose samples have these variances.
pub(super) struct Ask<'a, M: LobeModel> {
    pub(super) prior: &'a Prior,
    pub(super) model: &'a M,
    pub(super) places: &'a [Place],
    pub(super) variances: &'a [f32],
}

impl<M: LobeModel> Kernel for Ask<'_, M> {
    type Output = Vec<Typical>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Vec<Typical> {
        let material = self.model.spreads().map(|spread| square((MATERIAL * spread) as f32));
        let mut typical = vec![Typical::NOTHING; self.places.len()];
        for ((typical, place), &variance) in typical.iter_mut().zip(self.places).zip(self.variances)
        {
            let asked = place.lobes.checked_sub(1).and_then(|index| self.prior.0[index].as_ref());
            if let Some(asked) = asked {
                typical.hear::<I::F32>(asked, place, variance, &material[..M::SHAPES]);
            }
        }
        typical
    }
}

/// What is typical of one pixel, lobe by lobe: the numbers of a shape, each with how hard it pulls,
/// which is a sample's deviation over that of such numbers (0: nothing is typical).
#[derive(Clone, Copy, Debug)]
pub(super) struct Typical(pub(super) [[[f32; 2]; MAX_SHAPES]; MOST_LOBES]);

impl Typical {
    pub(super) const NOTHING: Self = Self([[[0.0; 2]; MAX_SHAPES]; MOST_LOBES]);

    /// Hears pixels with as many lobes; nothing is typical where none of them is like this one.
    ///
    /// A mixture of normal distributions, one about each of the others. Each has the share that the
    /// pixel's own shapes, as uncertain as they are, make likely (the first step of expectation and
    /// maximisation), and counts by how well it is known. Mean and variance are the mixture's.
    #[inline(always)]
    fn hear<R: Real<Scalar = f32>>(
        &mut self,
        asked: &Asked,
        place: &Place,
        variance: f32,
        material: &[f32],
    ) {
        let mut shares = [0.0; ASKED];
        for at in (0..ASKED).step_by(R::WIDTH) {
            let mut far = R::zero();
            for lobe in 0..place.lobes {
                let own = R::splat(square(place.seen_spread[lobe]) * variance);
                let both = own + R::load(&asked.doubts[lobe][at..]);
                for (number, &alike) in material.iter().enumerate() {
                    let other = R::load(&asked.shapes[lobe][number][at..]);
                    let apart = R::splat(place.shapes[lobe][number]) - other;
                    far = far + apart * apart / (R::splat(alike) + both);
                }
            }
            exp(far * R::of(-0.5)).store(&mut shares[at..]);
        }
        let shares = &shares[..asked.count];
        // Written so that NaN is no answer.
        if shares.iter().sum::<f32>() > ALIKE {
            for (lobe, numbers) in self.0[..place.lobes].iter_mut().enumerate() {
                for (number, &alike) in material.iter().enumerate() {
                    let others = &asked.shapes[lobe][number];
                    let [mean, spread] = mixed(shares, others, &asked.doubts[lobe], alike);
                    numbers[number] = [mean, (variance / spread).sqrt()];
                }
            }
        }
    }
}

/// Mean and variance of a mixture of distributions of the same variance, whose own means are known
/// with these doubts.
#[inline(always)]
fn mixed(shares: &[f32], means: &[f32], doubts: &[f32], variance: f32) -> [f32; 2] {
    let (mut whole, mut first, mut second) = (0.0, 0.0, 0.0);
    let about = means[0];
    for ((&share, &mean), &doubt) in shares.iter().zip(means).zip(doubts) {
        let weight = share / (variance + doubt);
        let off = mean - about;
        whole += weight;
        first = weight.mul_add(off, first);
        second = (weight * off).mul_add(off, second);
    }
    let off = first / whole;
    [about + off, variance + (second / whole - off * off).max(0.0)]
}

/// Of a deviation; where nothing is known it is infinite.
#[inline(always)]
fn square(spread: f32) -> f32 {
    if spread.is_finite() { spread * spread } else { f32::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Level;
    use crate::sbrdf::TorranceSparrow;

    const MODEL: TorranceSparrow = TorranceSparrow { index: 1.45 };

    /// A pixel of one lobe, its logarithm of sharpness known so well.
    fn place(shape: f32, spread: f32) -> Place {
        let mut place = Place { lobes: 1, ..Place::new([0.0, 0.0, 1.0]) };
        place.shapes[0][0] = shape;
        place.shape_spread[0] = spread;
        place.seen_spread[0] = spread;
        place
    }

    /// Deviation of a typical number, and the number.
    fn heard(pixel: &Place, shapes: &[f32]) -> [f32; 2] {
        let places: Vec<Place> = shapes.iter().map(|&shape| place(shape, 0.02)).collect();
        let prior = Prior::of_places(&MODEL, &places);
        let ask = Ask { prior: &prior, model: &MODEL, places: &[*pixel], variances: &[1.0] };
        let [mean, pull] = Level::detect().run(ask)[0].0[0][0];
        [mean, pull.recip()]
    }

    #[test]
    fn one_material_says_nothing_of_another() {
        let shapes: Vec<f32> = (0..32).map(|i| if i % 2 == 0 { 4.5 } else { 2.0 }).collect();
        let material = (MATERIAL * 0.25) as f32;
        for side in [4.5, 2.0] {
            let [mean, spread] = heard(&place(side + 0.1, 0.1), &shapes);
            assert!((mean - side).abs() < 1e-6, "{mean}");
            assert!((spread / material - 1.0).abs() < 1e-5, "{spread}");
        }
        // A pixel that knows nothing of its own has them all, and that they differ.
        let [mean, spread] = heard(&place(4.5, f32::NAN), &shapes);
        assert!((mean - 3.25).abs() < 1e-5, "{mean}");
        assert!((spread - 1.25).abs() < 0.01, "{spread}");
    }

    #[test]
    fn too_few_or_none_alike_tell_nothing() {
        let shapes = [4.5; 32];
        assert_eq!(heard(&place(4.5, 0.1), &shapes[..19])[1], f32::INFINITY);
        assert_eq!(heard(&place(1.0, 0.02), &shapes)[1], f32::INFINITY);
        assert_eq!(heard(&Place { lobes: 0, ..place(4.5, 0.1) }, &shapes)[1], f32::INFINITY);
        assert_eq!(heard(&Place { lobes: 2, ..place(4.5, 0.1) }, &shapes)[1], f32::INFINITY);
    }

    #[test]
    fn some_are_asked_of_many() {
        let places: Vec<Place> = (0..1000).map(|i| place(0.01 * i as f32, 0.02)).collect();
        let Prior([Some(one), None, None]) = Prior::of_places(&MODEL, &places) else { panic!() };
        assert_eq!(one.count, ASKED);
        // The middles of 32 equal parts of all.
        for (part, &shape) in one.shapes[0][0].iter().enumerate() {
            assert!((shape - (part as f32 + 0.5) * 10.0 / ASKED as f32).abs() < 0.02, "{shape}");
        }
    }
}
