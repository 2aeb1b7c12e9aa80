//! Singular value decomposition by one-sided Jacobi rotations [@demmel1992jacobi].

use nalgebra::{DMatrix, DVector};

/// `(U, s, V)` with the singular values in descending order, by one-sided Jacobi rotations:
/// small singular values and their vectors come out as accurate as
/// large ones, which bidiagonalisation does not promise and collinear bands need.
pub(super) fn decomposed(matrix: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>, DMatrix<f64>) {
    if matrix.nrows() < matrix.ncols() {
        let (left, values, right) = decomposed(&matrix.transpose());
        return (right, values, left);
    }
    let count = matrix.ncols();
    let mut rotated = matrix.clone();
    let mut right = DMatrix::identity(count, count);
    for _ in 0..SWEEPS {
        let mut converged = true;
        for p in 0..count {
            for q in p + 1..count {
                let (a, b) = (rotated.column(p).norm_squared(), rotated.column(q).norm_squared());
                let product = rotated.column(p).dot(&rotated.column(q));
                if product.abs() <= f64::EPSILON * (a * b).sqrt() {
                    continue;
                }
                converged = false;
                let zeta = (b - a) / (2.0 * product);
                let tangent = zeta.signum() / (zeta.abs() + zeta.mul_add(zeta, 1.0).sqrt());
                let cosine = tangent.mul_add(tangent, 1.0).sqrt().recip();
                rotate(&mut rotated, p, q, cosine, cosine * tangent);
                rotate(&mut right, p, q, cosine, cosine * tangent);
            }
        }
        if converged {
            break;
        }
    }
    let lengths: Vec<f64> = rotated.column_iter().map(|column| column.norm()).collect();
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&p, &q| lengths[q].total_cmp(&lengths[p]));
    let values = DVector::from_iterator(count, order.iter().map(|&index| lengths[index]));
    let mut left = rotated.select_columns(&order);
    for (mut column, &value) in left.column_iter_mut().zip(&values) {
        if value > 0.0 {
            column.unscale_mut(value);
        }
    }
    (left, values, right.select_columns(&order))
}

/// Sweeps over all pairs of columns; ten settle matrices of this size, and the limit only ends
/// what rounding keeps turning.
const SWEEPS: usize = 40;

fn rotate(matrix: &mut DMatrix<f64>, p: usize, q: usize, cosine: f64, sine: f64) {
    let rows = matrix.nrows();
    let (head, tail) = matrix.as_mut_slice().split_at_mut(q * rows);
    for (a, b) in head[p * rows..][..rows].iter_mut().zip(&mut tail[..rows]) {
        // No fused multiply-add: where it is no instruction of its own it is a call.
        (*a, *b) = (cosine * *a - sine * *b, sine * *a + cosine * *b);
    }
}
