//! What an estimator computes from the responses before its matrix: lanes of any precision.

use nalgebra::DMatrix;

use crate::math::Real;
use crate::math::elementary::exp;

/// Numbers computed from the responses of one pixel; each doubles when they double.
#[derive(Clone, Debug)]
pub enum Features {
    /// The responses themselves.
    Linear {
        /// Camera bands.
        bands: usize,
    },
    /// `rho_i` and `sqrt(rho_i rho_j)` for `i < j` (root-polynomials of Finlayson, Mackiewicz and
    /// Hurlbert 2015, for any number of bands); what is below zero counts as zero.
    RootPolynomial {
        /// Camera bands.
        bands: usize,
    },
    /// `|rho|`, `rho_i` and `|rho| exp(-gamma |z - c_j|^2)`, `z` the standardised direction.
    RadialBasis(Centres),
    /// The features of [`Self::RootPolynomial`], then those of [`Self::RadialBasis`].
    Ensemble(Centres),
}

/// Gaussians over the directions of responses.
#[derive(Clone, Debug)]
pub struct Centres {
    /// Mean direction, per band, times `scale`.
    pub(super) offset: Vec<f64>,
    /// `sqrt(gamma)` over the spread of the directions: `exp(-|scale u - offset - centre|^2)`.
    pub(super) scale: f64,
    /// `(centre, band)`, shifted and scaled as the directions are.
    pub(super) places: Vec<f64>,
    /// Width parameter in units of the spread.
    pub(super) gamma: f64,
}

impl Centres {
    /// Width parameter, relative to the spread of the training directions.
    #[must_use]
    pub fn gamma(&self) -> f64 {
        self.gamma
    }

    /// Length, responses, Gaussians.
    fn features(&self) -> usize {
        let bands = self.offset.len();
        1 + bands + self.places.len() / bands
    }
}

/// Responses, and pairs of them.
fn products(bands: usize) -> usize {
    bands * (bands + 1) / 2
}

impl Features {
    /// Camera bands.
    #[must_use]
    pub fn bands(&self) -> usize {
        match self {
            Self::Linear { bands } | Self::RootPolynomial { bands } => *bands,
            Self::RadialBasis(centres) | Self::Ensemble(centres) => centres.offset.len(),
        }
    }

    /// Number of features.
    #[must_use]
    pub fn count(&self) -> usize {
        match self {
            Self::Linear { bands } => *bands,
            Self::RootPolynomial { bands } => products(*bands),
            Self::RadialBasis(centres) => centres.features(),
            Self::Ensemble(centres) => products(centres.offset.len()) + centres.features(),
        }
    }

    /// The features of responses `rho` (one number per band), written to `out`.
    ///
    /// # Panics
    /// If a length is not [`Self::bands`] or [`Self::count`].
    #[inline(always)]
    pub fn evaluate<R: Real>(&self, rho: &[R], out: &mut [R]) {
        assert!(rho.len() == self.bands() && out.len() == self.count(), "feature lengths");
        match self {
            Self::Linear { .. } => out.copy_from_slice(rho),
            Self::RootPolynomial { .. } => root_polynomial(rho, out),
            Self::RadialBasis(centres) => radial_basis(centres, rho, out),
            Self::Ensemble(centres) => {
                let (polynomial, radial) = out.split_at_mut(products(rho.len()));
                root_polynomial(rho, polynomial);
                radial_basis(centres, rho, radial);
            }
        }
    }

    /// The features of each row of `(N, band)` responses, in double precision.
    #[must_use]
    pub fn of_rows(&self, responses: &DMatrix<f64>) -> DMatrix<f64> {
        let mut features = DMatrix::zeros(responses.nrows(), self.count());
        let (mut rho, mut out) = (vec![0.0; self.bands()], vec![0.0; self.count()]);
        for (responses, mut row) in responses.row_iter().zip(features.row_iter_mut()) {
            rho.iter_mut().zip(responses.iter()).for_each(|(rho, &value)| *rho = value);
            self.evaluate(&rho, &mut out);
            row.iter_mut().zip(&out).for_each(|(feature, &value)| *feature = value);
        }
        features
    }
}

#[inline(always)]
fn root_polynomial<R: Real>(rho: &[R], out: &mut [R]) {
    let (values, products) = out.split_at_mut(rho.len());
    // The product of the roots neither overflows nor underflows where that of the responses does.
    for (root, &rho) in values.iter_mut().zip(rho) {
        *root = rho.max(R::zero()).sqrt();
    }
    let mut next = 0;
    for i in 0..values.len() {
        for j in i + 1..values.len() {
            products[next] = values[i] * values[j];
            next += 1;
        }
    }
    for (value, &rho) in values.iter_mut().zip(rho) {
        *value = rho.max(R::zero());
    }
}

#[inline(always)]
fn radial_basis<R: Real>(shape: &Centres, rho: &[R], out: &mut [R]) {
    let bands = rho.len();
    let mut largest = R::zero();
    for &rho in rho {
        largest = rho.abs().max(largest);
    }
    // A black pixel has no direction; any will do, since its length is zero.
    let unit = R::select(largest.gt(R::zero()), largest, R::one());
    let mut square = R::zero();
    for &rho in rho {
        // Scaled first: squares of small responses underflow.
        let scaled = rho / unit;
        square = scaled.mul_add(scaled, square);
    }
    let root = R::select(square.gt(R::zero()), square, R::one()).sqrt();
    let length = unit * root;
    let (head, gaussians) = out.split_at_mut(1 + bands);
    head[0] = R::select(largest.gt(R::zero()), length, R::zero());
    // The directions stand where the responses will: no centre divides again.
    for (direction, &rho) in head[1..].iter_mut().zip(rho) {
        *direction = rho / length;
    }
    for (feature, centre) in gaussians.iter_mut().zip(shape.places.chunks_exact(bands)) {
        let mut distance = R::zero();
        for ((&direction, &offset), &centre) in head[1..].iter().zip(&shape.offset).zip(centre) {
            let away = direction.mul_add(R::of(shape.scale), R::of(-(offset + centre)));
            distance = away.mul_add(away, distance);
        }
        *feature = head[0] * exp(-distance);
    }
    for (feature, &rho) in head[1..].iter_mut().zip(rho) {
        *feature = rho;
    }
}
