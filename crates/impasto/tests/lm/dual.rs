//! Derivatives by dual numbers, in lanes: test problems are written as formulas only.

use core::ops::{Add, Div, Mul, Neg, Sub};

use impasto::math::lanes::MAX_LANES;
use impasto::math::{Real, Scalar};

/// The library's functions, lane by lane.
pub(crate) fn map<R: Real>(x: R, f: impl Fn(f64) -> f64) -> R {
    let mut lanes = [R::Scalar::default(); MAX_LANES];
    x.store(&mut lanes);
    for lane in &mut lanes[..R::WIDTH] {
        *lane = R::Scalar::from_f64(f(lane.to_f64()));
    }
    R::load(&lanes)
}

/// A value and its derivatives with respect to N parameters.
#[derive(Clone, Copy)]
pub(crate) struct Dual<R, const N: usize> {
    pub(crate) value: R,
    pub(crate) slope: [R; N],
}

impl<R: Real, const N: usize> Dual<R, N> {
    pub(crate) fn parameters(at: [R; N]) -> [Self; N] {
        let mut index = 0;
        at.map(|value| {
            let mut slope = [R::zero(); N];
            slope[index] = R::one();
            index += 1;
            Self { value, slope }
        })
    }

    pub(crate) fn of(value: f64) -> Self {
        Self { value: R::of(value), slope: [R::zero(); N] }
    }

    fn chain(self, value: R, factor: R) -> Self {
        Self { value, slope: self.slope.map(|s| s * factor) }
    }

    pub(crate) fn exp(self) -> Self {
        let value = map(self.value, f64::exp);
        self.chain(value, value)
    }

    pub(crate) fn atan(self) -> Self {
        let factor = R::one() / self.value.mul_add(self.value, R::one());
        self.chain(map(self.value, f64::atan), factor)
    }

    pub(crate) fn cos(self) -> Self {
        self.chain(map(self.value, f64::cos), -map(self.value, f64::sin))
    }

    pub(crate) fn sin(self) -> Self {
        self.chain(map(self.value, f64::sin), map(self.value, f64::cos))
    }

    pub(crate) fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, R::of(0.5) / root)
    }

    pub(crate) fn ln(self) -> Self {
        self.chain(map(self.value, f64::ln), self.value.recip())
    }

    /// `self^power`, for a positive base.
    pub(crate) fn pow(self, power: Self) -> Self {
        (power * self.ln()).exp()
    }

    pub(crate) fn square(self) -> Self {
        self * self
    }
}

impl<R: Real, const N: usize> Add for Dual<R, N> {
    type Output = Self;
    fn add(mut self, other: Self) -> Self {
        self.value = self.value + other.value;
        for (s, o) in self.slope.iter_mut().zip(other.slope) {
            *s = *s + o;
        }
        self
    }
}

impl<R: Real, const N: usize> Neg for Dual<R, N> {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, slope: self.slope.map(|s| -s) }
    }
}

impl<R: Real, const N: usize> Sub for Dual<R, N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl<R: Real, const N: usize> Mul for Dual<R, N> {
    type Output = Self;
    fn mul(mut self, other: Self) -> Self {
        for (s, o) in self.slope.iter_mut().zip(other.slope) {
            *s = s.mul_add(other.value, o * self.value);
        }
        self.value = self.value * other.value;
        self
    }
}

impl<R: Real, const N: usize> Div for Dual<R, N> {
    type Output = Self;
    fn div(mut self, other: Self) -> Self {
        self.value = self.value / other.value;
        for (s, o) in self.slope.iter_mut().zip(other.slope) {
            *s = (-self.value).mul_add(o, *s) / other.value;
        }
        self
    }
}
