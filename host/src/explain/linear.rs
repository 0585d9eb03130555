//! Weighted linear least squares with priors, a few columns at a time beside a common base.

use nalgebra::{DMatrix, DVector};

/// A residual, or how it falls per unit of a parameter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Column {
    /// Rows of the innovations in counts.
    pub motion: Vec<f64>,
    /// Current, recorded less modelled, over its standard deviation, sample by sample; empty where it is zero
    /// throughout.
    pub current: Vec<f64>,
}

impl Column {
    /// Weighted inner product.
    pub fn inner(&self, other: &Self, weights: &[f64]) -> f64 {
        inner(&self.motion, &other.motion, weights) + dot(&self.current, &other.current)
    }

    /// Whether there is something, and all of it is zero.
    pub fn is_nothing(&self) -> bool {
        !self.motion.is_empty() && self.motion.iter().chain(&self.current).all(|x| *x == 0.0)
    }

    /// `(self − other)/by`.
    pub fn difference(&self, other: &Self, by: f64) -> Self {
        let of = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) / by).collect::<Vec<f64>>();
        let mut current = of(&self.current, &other.current);
        if current.iter().all(|x| *x == 0.0) {
            current = Vec::new();
        }
        Self { motion: of(&self.motion, &other.motion), current }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The base columns under one set of weights: what every candidate is fitted beside.
pub struct Base<'a> {
    columns: &'a [Column],
    weights: &'a [f64],
    residual: &'a Column,
    normal: DMatrix<f64>,
    right: DVector<f64>,
    /// Weighted sum of squares of the residual, prior included, before any fit.
    total: f64,
}

/// The base's directions with a unit of χ² along each: what they take of anything is a plain product.
pub struct Whitened {
    factor: DMatrix<f64>,
    scale: DVector<f64>,
    /// What χ² would fall by along each for the residual, as a root.
    pub right: DVector<f64>,
}

impl Whitened {
    /// Of products with the base's columns, those with its directions.
    pub fn of(&self, products: &DVector<f64>) -> DVector<f64> {
        let scaled = products.component_div(&self.scale);
        self.factor.solve_lower_triangular(&scaled).unwrap_or_else(|| DVector::zeros(products.len()))
    }
}

/// A fit of some columns beside the base.
#[derive(Clone, Debug)]
pub struct Fit {
    /// χ² of data and prior that is left.
    pub cost: f64,
    /// Coefficients: the base's, then the columns'.
    pub coefficients: Vec<f64>,
}

/// Weighted inner product.
pub fn inner(a: &[f64], b: &[f64], weights: &[f64]) -> f64 {
    a.iter().zip(b).zip(weights).map(|((a, b), w)| a * b * (w * w)).sum()
}

impl<'a> Base<'a> {
    /// `residual ≈ Σ coefficient·column`, each coefficient plus its offset normally distributed about 0; `priors` are
    /// one over its standard deviation.
    pub fn new(
        columns: &'a [Column],
        residual: &'a Column,
        weights: &'a [f64],
        priors: &[f64],
        offsets: &[f64],
    ) -> Self {
        let count = columns.len();
        let mut normal = DMatrix::zeros(count, count);
        let mut right = DVector::zeros(count);
        let mut total = residual.inner(residual, weights);
        for i in 0..count {
            for j in i..count {
                let value = columns[i].inner(&columns[j], weights);
                normal[(i, j)] = value;
                normal[(j, i)] = value;
            }
            let precision = priors[i] * priors[i];
            normal[(i, i)] += precision;
            right[i] = columns[i].inner(residual, weights) - precision * offsets[i];
            total += precision * offsets[i] * offsets[i];
        }
        Self { columns, weights, residual, normal, right, total }
    }

    /// The base's own directions; none where its columns cannot be told from each other.
    pub fn whitened(&self) -> Option<Whitened> {
        let (scaled, scale) = scaled(&self.normal);
        let factor = scaled.cholesky()?.l();
        let mut whitened = Whitened { factor, scale, right: DVector::zeros(0) };
        whitened.right = whitened.of(&self.right);
        Some(whitened)
    }

    /// χ² without any further column.
    pub fn alone(&self) -> Fit {
        self.with(&[])
    }

    /// χ² and coefficients with `columns` beside the base. Columns that the base holds already change nothing.
    pub fn with(&self, columns: &[&Column]) -> Fit {
        let base = self.columns.len();
        let count = base + columns.len();
        let mut normal = DMatrix::zeros(count, count);
        normal.view_mut((0, 0), (base, base)).copy_from(&self.normal);
        let mut right = DVector::zeros(count);
        right.rows_mut(0, base).copy_from(&self.right);
        for (c, column) in columns.iter().enumerate() {
            let c = base + c;
            for i in 0..base {
                let value = self.columns[i].inner(column, self.weights);
                normal[(i, c)] = value;
                normal[(c, i)] = value;
            }
            for (d, other) in columns.iter().enumerate().take(c - base + 1) {
                let value = other.inner(column, self.weights);
                normal[(base + d, c)] = value;
                normal[(c, base + d)] = value;
            }
            right[c] = column.inner(self.residual, self.weights);
        }
        let coefficients = solve(&normal, &right);
        let cost = self.total - right.dot(&coefficients);
        Fit { cost, coefficients: coefficients.iter().copied().collect() }
    }

    /// What is left of the residual's motion after a fit of `columns`.
    pub fn left(&self, fit: &Fit, columns: &[&Column]) -> Vec<f64> {
        let mut left = self.residual.motion.clone();
        for (column, coefficient) in self.columns.iter().chain(columns.iter().copied()).zip(&fit.coefficients) {
            for (value, x) in left.iter_mut().zip(&column.motion) {
                *value -= coefficient * x;
            }
        }
        left
    }
}

/// Solves a symmetric system of wildly different scales; directions that nothing determines stay at 0.
pub fn solve(normal: &DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    let (scaled, scale) = scaled(normal);
    let right = right.component_div(&scale);
    let solution = match scaled.clone().cholesky() {
        Some(factor) => factor.solve(&right),
        None => {
            let eigen = scaled.symmetric_eigen();
            let projected = eigen.eigenvectors.transpose() * right;
            let divided = DVector::from_fn(scale.len(), |i, _| {
                if eigen.eigenvalues[i] > 1e-10 { projected[i] / eigen.eigenvalues[i] } else { 0.0 }
            });
            eigen.eigenvectors * divided
        }
    };
    solution.component_div(&scale)
}

/// A symmetric system with a diagonal of about 1, and the roots of the diagonal it had.
fn scaled(normal: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
    let scale = normal.diagonal().map(|x| x.max(f64::MIN_POSITIVE).sqrt());
    let scaled = DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| {
        normal[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-11 } else { 0.0 }
    });
    (scaled, scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a further column gains is the same from products alone as from the whole fit.
    #[test]
    fn whitened_products_tell_what_a_column_gains() {
        let wave =
            |step: f64| Column { motion: (0..60).map(|k| (step * f64::from(k)).sin()).collect(), ..Column::default() };
        let columns = [wave(0.1), wave(0.13), wave(0.9)];
        let (residual, further) = (wave(0.21), wave(0.17));
        let weights: Vec<f64> = (0..60).map(|k| 1.0 + 0.02 * f64::from(k)).collect();
        let base = Base::new(&columns, &residual, &weights, &[0.0, 2.0, 0.5], &[0.0, 0.1, -0.3]);
        let whitened = base.whitened().expect("columns that differ");
        let products = DVector::from_iterator(3, columns.iter().map(|column| column.inner(&further, &weights)));
        let taken = whitened.of(&products);
        let common = further.inner(&residual, &weights) - taken.dot(&whitened.right);
        let gain = common * common / (further.inner(&further, &weights) - taken.norm_squared());
        let by_fit = base.alone().cost - base.with(&[&further]).cost;
        assert!((gain - by_fit).abs() < 1e-6 * by_fit, "{gain} {by_fit}");
    }
}
