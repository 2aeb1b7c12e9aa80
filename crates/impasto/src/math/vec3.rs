//! Three components side by side.

use core::ops::{Add, Neg, Sub};

use super::real::{Real, Scalar};

/// A vector in the world frame: x right, y up, z towards the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vec3<R> {
    /// To the right.
    pub x: R,
    /// Up.
    pub y: R,
    /// Towards the viewer.
    pub z: R,
}

impl<R> Vec3<R> {
    /// A vector from its components.
    #[inline(always)]
    pub const fn new(x: R, y: R, z: R) -> Self {
        Self { x, y, z }
    }
}

impl<R: Copy> Vec3<R> {
    /// The components in order.
    #[must_use]
    #[inline(always)]
    pub fn array(self) -> [R; 3] {
        [self.x, self.y, self.z]
    }
}

impl Vec3<f64> {
    /// The same vector in every lane.
    #[must_use]
    #[inline(always)]
    pub fn splat<R: Real>(self) -> Vec3<R> {
        Vec3::new(R::of(self.x), R::of(self.y), R::of(self.z))
    }
}

impl Vec3<f32> {
    /// The same vector in every lane.
    #[must_use]
    #[inline(always)]
    pub fn fill<R: Real<Scalar = f32>>(self) -> Vec3<R> {
        Vec3::new(R::splat(self.x), R::splat(self.y), R::splat(self.z))
    }
}

impl<S: Scalar> Vec3<S> {
    /// The same vector in every lane, whatever the precision of either.
    #[must_use]
    #[inline(always)]
    pub fn broadcast<R: Real>(self) -> Vec3<R> {
        // No closure: it may stay a call, and every instruction in it one outside the kernel.
        Vec3::new(R::of(self.x.to_f64()), R::of(self.y.to_f64()), R::of(self.z.to_f64()))
    }
}

impl<R: Real> Vec3<R> {
    /// The vector where the mask is set, else zero.
    #[must_use]
    #[inline(always)]
    pub fn keep(self, mask: R::Mask) -> Self {
        Self::new(R::keep(mask, self.x), R::keep(mask, self.y), R::keep(mask, self.z))
    }
    /// Inner product.
    #[must_use]
    #[inline(always)]
    pub fn dot(self, other: Self) -> R {
        self.x.mul_add(other.x, self.y.mul_add(other.y, self.z * other.z))
    }
    /// `yes` where the mask is set, else `no`.
    #[must_use]
    #[inline(always)]
    pub fn select(mask: R::Mask, yes: Self, no: Self) -> Self {
        Self::new(
            R::select(mask, yes.x, no.x),
            R::select(mask, yes.y, no.y),
            R::select(mask, yes.z, no.z),
        )
    }
    /// Cross product.
    #[must_use]
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        Self::new(
            self.y.mul_add(other.z, -(self.z * other.y)),
            self.z.mul_add(other.x, -(self.x * other.z)),
            self.x.mul_add(other.y, -(self.y * other.x)),
        )
    }
    /// The vector times a number.
    #[must_use]
    #[inline(always)]
    pub fn scale(self, factor: R) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
    /// `self * factor + summand`, fused per component.
    #[must_use]
    #[inline(always)]
    pub fn mul_add(self, factor: R, summand: Self) -> Self {
        Self::new(
            self.x.mul_add(factor, summand.x),
            self.y.mul_add(factor, summand.y),
            self.z.mul_add(factor, summand.z),
        )
    }
    /// Squared length.
    #[must_use]
    #[inline(always)]
    pub fn length_squared(self) -> R {
        self.dot(self)
    }
    /// Length.
    #[must_use]
    #[inline(always)]
    pub fn length(self) -> R {
        self.length_squared().sqrt()
    }
    /// The direction of the vector; NaN where its length is zero.
    #[must_use]
    #[inline(always)]
    pub fn normalised(self) -> Self {
        self.scale(self.length().recip())
    }
}

impl<R: Real> Add for Vec3<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}
impl<R: Real> Sub for Vec3<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}
impl<R: Real> Neg for Vec3<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}
