//! Ridge regression [@hoerl1970ridge], its weight chosen by cross-validation.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Parts into which the training spectra are split.
pub(super) const FOLDS: usize = 5;

/// Weighted sums of products, divided by the number of rows: all that a regression needs.
#[derive(Clone, Debug)]
pub(super) struct RidgeEquations {
    /// `(m, m)`: features with features.
    pub(super) gram: DMatrix<f64>,
    /// `(m, n)`: features with targets.
    pub(super) cross: DMatrix<f64>,
}

impl RidgeEquations {
    pub(super) fn of(
        features: &DMatrix<f64>,
        targets: &DMatrix<f64>,
        weights: &DVector<f64>,
    ) -> Self {
        let mut weighted = features.clone();
        for (mut row, &weight) in weighted.row_iter_mut().zip(weights) {
            row *= weight;
        }
        let transposed = weighted.transpose();
        Self { gram: &transposed * features, cross: transposed * targets }
    }

    pub(super) fn divided(&self, count: f64) -> Self {
        Self { gram: &self.gram / count, cross: &self.cross / count }
    }

    /// `(n, m)`: the map from features to targets.
    pub(super) fn solve(&self, ridge: f64) -> DMatrix<f64> {
        RidgeSolver::of(self).map(ridge)
    }
}

/// Normal equations on the axes of their matrix: any ridge weight costs one product.
struct RidgeSolver {
    axes: DMatrix<f64>,
    values: DVector<f64>,
    rotated: DMatrix<f64>,
}

impl RidgeSolver {
    fn of(normal: &RidgeEquations) -> Self {
        let eigen = SymmetricEigen::new(normal.gram.clone());
        let rotated = eigen.eigenvectors.transpose() * &normal.cross;
        Self { axes: eigen.eigenvectors, values: eigen.eigenvalues, rotated }
    }

    /// `(n, m)`.
    fn map(&self, ridge: f64) -> DMatrix<f64> {
        (&self.axes * self.shrunk(ridge)).transpose()
    }

    fn shrunk(&self, ridge: f64) -> DMatrix<f64> {
        // Rounding leaves eigenvalues slightly below zero where features are collinear; the ridge
        // must still be larger than that rounding.
        let floor = self.values.max() * f64::EPSILON * self.values.len() as f64;
        let mut shrunk = self.rotated.clone();
        for (mut row, &value) in shrunk.row_iter_mut().zip(&self.values) {
            row /= value.max(0.0) + ridge.max(floor);
        }
        shrunk
    }
}

/// Normal equations over all rows, and the squared error of held-out rows for each ridge weight.
///
/// `fold` names the part of each row; replicas of one spectrum belong to the same part.
pub(super) fn cross_validated(
    features: &DMatrix<f64>,
    targets: &DMatrix<f64>,
    weights: &DVector<f64>,
    fold: &[usize],
    ridges: &[f64],
) -> (RidgeEquations, Vec<f64>) {
    let rows =
        |part: usize| -> Vec<usize> { (0..fold.len()).filter(|&row| fold[row] == part).collect() };
    let parts: Vec<_> = (0..FOLDS)
        .map(|part| {
            let rows = rows(part);
            let (features, targets) = (features.select_rows(&rows), targets.select_rows(&rows));
            let weights = weights.select_rows(&rows);
            let normal = RidgeEquations::of(&features, &targets, &weights);
            (features, targets, weights, normal)
        })
        .collect();
    let mut whole = parts[0].3.clone();
    for (.., part) in &parts[1..] {
        whole.gram += &part.gram;
        whole.cross += &part.cross;
    }
    let mut errors = vec![0.0; ridges.len()];
    for (features, targets, weights, part) in &parts {
        let rest =
            RidgeEquations { gram: &whole.gram - &part.gram, cross: &whole.cross - &part.cross };
        let solver = RidgeSolver::of(&rest.divided((fold.len() - features.nrows()) as f64));
        let rotated = features * &solver.axes;
        for (error, &ridge) in errors.iter_mut().zip(ridges) {
            let residual = &rotated * solver.shrunk(ridge) - targets;
            let of_rows = residual.row_iter().zip(weights);
            *error += of_rows.map(|(row, &weight)| weight * row.norm_squared()).sum::<f64>();
        }
    }
    (whole.divided(fold.len() as f64), errors)
}

/// The index of the smallest error.
pub(super) fn best(errors: &[f64]) -> usize {
    (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0)
}

/// A part for each of `count` spectra, all parts of nearly the same size.
pub(super) fn folds(order: &[usize]) -> Vec<usize> {
    order.iter().map(|place| place % FOLDS).collect()
}
