//! The Schur complement of the unknowns of pixels, one per lane, and how these follow the numbers of
//! the rig.
//!
//! With derivatives `U` by the unknowns of a pixel and `D` by the rig, the unknowns follow the rig by
//! `F = (U'U)^-1 U'D` of the photographs that are fitted. What is left of `D` in the photographs held
//! is `D - U F`, whose normal equations are `D'D - H - H'` with `H = F' (U'D - U'U F / 2)`. The
//! unknowns of different bands have no product, so `U'U` is an arrow: it is solved band by band.

#![allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]

use super::samples::{Layout, OWN, PixelSamples, Row, SHARED};
use crate::math::Real;

/// Relative addition to the diagonal of the equations of a pixel, which what is not determined makes
/// singular.
const RIDGE: f64 = 1e-4;

/// Least size of an unknown's derivatives that counts. The inverse of smaller squares is no number in
/// double precision: a lobe that stands far from the half vectors of all lamps shows so little.
const LEAST: f64 = 1e-140;

type Square<R> = [[R; 3]; 3];

/// Sums of products over some photographs of pixels.
struct Products<R> {
    shared: Square<R>,
    /// `(band, own, shared)`.
    cross: Vec<Square<R>>,
    own: Vec<Square<R>>,
    /// `(number, unknown)`: with the numbers of the rig, the errors as one more of them.
    by_rig: Vec<R>,
}

impl<R: Real> Products<R> {
    fn new(layout: Layout) -> Self {
        let none = [[R::zero(); 3]; 3];
        Self {
            shared: none,
            cross: vec![none; layout.bands],
            own: vec![none; layout.bands],
            by_rig: vec![R::zero(); layout.unknowns() * layout.columns()],
        }
    }

    /// The products of the photographs whose `held` is `which`.
    #[inline(always)]
    fn read(&mut self, pixels: &PixelSamples<R>, held: &[bool], which: bool) {
        let layout @ Layout { bands, places, strengths, .. } = pixels.layout;
        let none = [[R::zero(); 3]; 3];
        self.shared = none;
        self.cross.fill(none);
        self.own.fill(none);
        self.by_rig.fill(R::zero());
        for observation in 0..held.len() {
            if held[observation] != which {
                continue;
            }
            for band in 0..bands {
                let number = observation * bands + band;
                let row = &pixels.rows[number];
                let [cross, own] = [&mut self.cross[band], &mut self.own[band]];
                for i in 0..3 {
                    for j in 0..3 {
                        self.shared[i][j] = row.shared[i].mul_add(row.shared[j], self.shared[i][j]);
                        cross[i][j] = row.own[i].mul_add(row.shared[j], cross[i][j]);
                        own[i][j] = row.own[i].mul_add(row.own[j], own[i][j]);
                    }
                }
                let by_place = pixels.places_of(number);
                for place in 0..places {
                    self.add(layout, place, band, row, by_place[place]);
                }
                if strengths {
                    // A strength changes its own photograph alone.
                    self.add(layout, places + observation, band, row, row.lamp);
                }
                self.add(layout, layout.numbers(), band, row, row.error);
            }
        }
    }

    /// Adds the products of a row with its derivative by one number of the rig.
    #[inline(always)]
    fn add(&mut self, layout: Layout, number: usize, band: usize, row: &Row<R>, slope: R) {
        let first = number * layout.unknowns();
        let shared = &mut self.by_rig[first..first + SHARED];
        for k in 0..SHARED {
            shared[k] = row.shared[k].mul_add(slope, shared[k]);
        }
        let first = first + SHARED + OWN * band;
        let own = &mut self.by_rig[first..first + OWN];
        for k in 0..OWN {
            own[k] = row.own[k].mul_add(slope, own[k]);
        }
    }

    /// Subtracts half of `U'U` times some unknowns from `out`.
    #[inline(always)]
    fn take_half(&self, unknowns: &[R], out: &mut [R]) {
        let half = R::of(-0.5);
        for i in 0..SHARED {
            for j in 0..SHARED {
                out[i] = (half * self.shared[i][j]).mul_add(unknowns[j], out[i]);
            }
        }
        for band in 0..self.own.len() {
            let first = SHARED + OWN * band;
            for i in 0..OWN {
                for j in 0..OWN {
                    let (own, cross) = (half * self.own[band][i][j], half * self.cross[band][i][j]);
                    out[first + i] = own.mul_add(unknowns[first + j], out[first + i]);
                    out[first + i] = cross.mul_add(unknowns[j], out[first + i]);
                    out[j] = cross.mul_add(unknowns[first + i], out[j]);
                }
            }
        }
    }
}

/// The inverse of `U'U` with a ridge: `(U'U)^-1 = [C, -C K'; -K C, M + K C K']` with `C` the inverse
/// of the complement of what bands share, `M` the inverses of what they do not, and `K = M X` with
/// the products `X` of both.
struct Arrow<R> {
    complement: Square<R>,
    own: Vec<Square<R>>,
    solved: Vec<Square<R>>,
}

impl<R: Real> Arrow<R> {
    fn new(layout: Layout) -> Self {
        let none = [[R::zero(); 3]; 3];
        Self { complement: none, own: vec![none; layout.bands], solved: vec![none; layout.bands] }
    }

    /// Of the photographs `fitted`, each unknown scaled by its size there and in those `held`, if
    /// there are others.
    #[inline(always)]
    fn set(&mut self, fitted: &Products<R>, held: Option<&Products<R>>) {
        let by_shared = scales(&fitted.shared, held.map(|held| &held.shared));
        let mut complement = scaled(&fitted.shared, &by_shared, &by_shared);
        add_ridge(&mut complement);
        for band in 0..self.own.len() {
            let by_own = scales(&fitted.own[band], held.map(|held| &held.own[band]));
            let mut own = scaled(&fitted.own[band], &by_own, &by_own);
            add_ridge(&mut own);
            let own = scaled(&inverted(&own), &by_own, &by_own);
            let cross = &fitted.cross[band];
            let solved = product(&own, cross);
            for i in 0..3 {
                for j in 0..3 {
                    for k in 0..3 {
                        let less = -(by_shared[i] * cross[k][i]);
                        let own = solved[k][j] * by_shared[j];
                        complement[i][j] = less.mul_add(own, complement[i][j]);
                    }
                }
            }
            (self.own[band], self.solved[band]) = (own, solved);
        }
        self.complement = scaled(&inverted(&complement), &by_shared, &by_shared);
    }

    /// The unknowns that solve the equations with one right-hand side.
    #[inline(always)]
    fn solve(&self, right: &[R], out: &mut [R]) {
        let mut shared = [right[0], right[1], right[2]];
        for band in 0..self.own.len() {
            let first = SHARED + OWN * band;
            for i in 0..OWN {
                for j in 0..SHARED {
                    shared[j] = (-self.solved[band][i][j]).mul_add(right[first + i], shared[j]);
                }
            }
        }
        for i in 0..SHARED {
            out[i] = R::zero();
            for j in 0..SHARED {
                out[i] = self.complement[i][j].mul_add(shared[j], out[i]);
            }
        }
        for band in 0..self.own.len() {
            let first = SHARED + OWN * band;
            for i in 0..OWN {
                let mut value = R::zero();
                for j in 0..OWN {
                    value = self.own[band][i][j].mul_add(right[first + j], value);
                    value = (-self.solved[band][i][j]).mul_add(out[j], value);
                }
                out[first + i] = value;
            }
        }
    }
}

/// One over the sizes of three unknowns.
#[inline(always)]
fn scales<R: Real>(own: &Square<R>, held: Option<&Square<R>>) -> [R; 3] {
    let mut scales = [R::one(); 3];
    for i in 0..3 {
        // What shows in the photographs held alone, as a highlight may, does not follow.
        let squared = match held {
            Some(held) => own[i][i] + held[i][i],
            None => own[i][i],
        };
        let size = squared.sqrt();
        scales[i] = R::select(size.gt(R::of(LEAST)), size.recip(), R::one());
    }
    scales
}

#[inline(always)]
fn add_ridge<R: Real>(matrix: &mut Square<R>) {
    for i in 0..3 {
        matrix[i][i] = matrix[i][i] + R::of(RIDGE);
    }
}

#[inline(always)]
fn scaled<R: Real>(matrix: &Square<R>, rows: &[R; 3], columns: &[R; 3]) -> Square<R> {
    let mut out = *matrix;
    for i in 0..3 {
        for j in 0..3 {
            out[i][j] = rows[i] * matrix[i][j] * columns[j];
        }
    }
    out
}

#[inline(always)]
fn product<R: Real>(left: &Square<R>, right: &Square<R>) -> Square<R> {
    let mut out = [[R::zero(); 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            for k in 0..3 {
                out[i][j] = left[i][k].mul_add(right[k][j], out[i][j]);
            }
        }
    }
    out
}

/// The inverse, by cofactors, of equations with a ridge; what has none, by an overflow, follows
/// nothing.
#[inline(always)]
fn inverted<R: Real>(matrix: &Square<R>) -> Square<R> {
    let mut cofactors = [[R::zero(); 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            let ([a, b], [c, d]) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
            let less = matrix[a][d] * matrix[b][c];
            cofactors[i][j] = matrix[a][c].mul_add(matrix[b][d], -less);
        }
    }
    let mut determinant = R::zero();
    for j in 0..3 {
        determinant = matrix[0][j].mul_add(cofactors[0][j], determinant);
    }
    let inverse = determinant.recip();
    let exists = inverse.is_finite();
    let mut out = cofactors;
    for i in 0..3 {
        for j in 0..3 {
            out[i][j] = R::keep(exists, cofactors[j][i] * inverse);
        }
    }
    out
}

#[inline(always)]
fn add_product<R: Real>(sums: &mut [R], at: usize, left: R, right: R) {
    sums[at] = left.mul_add(right, sums[at]);
}

/// How the unknowns of pixels, one per lane, follow the rig.
pub(super) struct Followed<R: Real> {
    layout: Layout,
    held: Products<R>,
    fitted: Products<R>,
    arrow: Arrow<R>,
    /// `(number, unknown)`: `F`, and `U'D - U'U F / 2`.
    pub(super) follow: Vec<R>,
    pub(super) half: Vec<R>,
    /// `D'D`, and the products of `D` with the errors, as [`Layout::direct`] numbers them.
    pub(super) direct: Vec<R>,
    /// Whether any sample counts.
    pub(super) any: R::Mask,
}

impl<R: Real> Followed<R> {
    pub(super) fn new(layout: Layout) -> Self {
        let zero = R::zero();
        let size = layout.unknowns() * layout.columns();
        Self {
            layout,
            held: Products::new(layout),
            fitted: Products::new(layout),
            arrow: Arrow::new(layout),
            follow: vec![zero; size],
            half: vec![zero; size],
            direct: vec![zero; layout.direct_products()],
            any: zero.lt(zero),
        }
    }

    /// Follows pixels whose photographs `held` are to be explained.
    #[inline(always)]
    pub(super) fn solve(&mut self, pixels: &PixelSamples<R>, held: &[bool]) {
        let zero = R::zero();
        let mut all = true;
        for observation in 0..held.len() {
            all &= held[observation];
        }
        self.held.read(pixels, held, true);
        if all {
            self.arrow.set(&self.held, None);
        } else {
            self.fitted.read(pixels, held, false);
            self.arrow.set(&self.fitted, Some(&self.held));
        }
        self.any = zero.lt(zero);
        for row in 0..pixels.rows.len() {
            let Row { own, lamp, .. } = &pixels.rows[row];
            for slope in [own[1], *lamp] {
                self.any = self.any | slope.gt(zero) | slope.lt(zero);
            }
        }
        self.set_direct(pixels, held);
        let unknowns = self.layout.unknowns();
        for number in 0..self.layout.columns() {
            let own = number * unknowns..(number + 1) * unknowns;
            let follow = &mut self.follow[own.clone()];
            if number == self.layout.numbers() && !all {
                // Photographs that are fitted are at their least squares.
                follow.fill(zero);
            } else {
                let fitted = if all { &self.held } else { &self.fitted };
                self.arrow.solve(&fitted.by_rig[own.clone()], follow);
            }
            let half = &mut self.half[own.clone()];
            half.copy_from_slice(&self.held.by_rig[own]);
            self.held.take_half(follow, half);
        }
    }

    #[inline(always)]
    fn set_direct(&mut self, pixels: &PixelSamples<R>, held: &[bool]) {
        let layout @ Layout { bands, places, strengths, .. } = self.layout;
        self.direct.fill(R::zero());
        let direct = &mut self.direct;
        for observation in 0..held.len() {
            if !held[observation] {
                continue;
            }
            let lamp_number = places + observation;
            for row in observation * bands..(observation + 1) * bands {
                let Row { error, lamp, .. } = pixels.rows[row];
                let by_place = pixels.places_of(row);
                for i in 0..places {
                    for j in i..places {
                        add_product(direct, layout.direct(i, j), by_place[i], by_place[j]);
                    }
                    add_product(direct, layout.direct(i, layout.numbers()), by_place[i], error);
                    if strengths {
                        add_product(direct, layout.direct(i, lamp_number), by_place[i], lamp);
                    }
                }
                if strengths {
                    add_product(direct, layout.direct(lamp_number, lamp_number), lamp, lamp);
                    add_product(direct, layout.direct(lamp_number, layout.numbers()), lamp, error);
                }
            }
        }
    }

    /// Sums of squares of what is left of the derivatives: by every inverse distance, and by all
    /// strengths together; into `(kind)`.
    #[inline(always)]
    pub(super) fn leverage(&self, out: &mut [R]) {
        let Self { layout, follow, half, direct, .. } = self;
        let unknowns = layout.unknowns();
        out.fill(R::zero());
        for number in 0..layout.numbers() {
            let mut left = direct[layout.direct(number, number)];
            for unknown in number * unknowns..(number + 1) * unknowns {
                left = (R::of(-2.0) * follow[unknown]).mul_add(half[unknown], left);
            }
            let kind = number.min(layout.places);
            out[kind] = out[kind] + left;
        }
    }
}
