//! The sum of squares of the innovations as a quadratic form of all unknowns, and the elimination of those nobody asks for.

#![expect(clippy::needless_range_loop, reason = "matrices are read by their indices")]

use super::bundle::{LOAD_UNKNOWNS, MODEL_UNKNOWNS, NOISE_COUNTS, NUISANCES, STATE_UNKNOWNS, Shown, UNKNOWNS};
use super::learned::Learned;
use super::prior::{Prior, gradient};
use crate::arm::Load;

/// Rows whose products are summed in single precision before they go into the sums in double precision, which a Cortex-M4
/// has to emulate.
const BLOCK_ROWS: u32 = 8;

/// Place of an element of the upper triangle.
const fn place(row: usize, column: usize) -> usize {
    row * UNKNOWNS - row * (row + 1) / 2 + column
}

const ELEMENTS: usize = UNKNOWNS * (UNKNOWNS + 1) / 2;

/// The sum of squares of the innovations as a function of all unknowns.
#[derive(Clone, Debug)]
pub struct Quadratic {
    matrix: [f64; ELEMENTS],
    vector: [f64; UNKNOWNS],
    block_matrix: [f32; ELEMENTS],
    block_vector: [f32; UNKNOWNS],
    block_rows: u32,
    squares: f64,
    rows: u32,
}

impl Quadratic {
    /// Of no rows.
    pub const fn new() -> Self {
        Self {
            matrix: [0.0; ELEMENTS],
            vector: [0.0; UNKNOWNS],
            block_matrix: [0.0; ELEMENTS],
            block_vector: [0.0; UNKNOWNS],
            block_rows: 0,
            squares: 0.0,
            rows: 0,
        }
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        *self = Self::new();
    }

    /// Adds what a row shows.
    #[inline(never)]
    pub fn add(&mut self, shown: &Shown) {
        let weight = 1.0 / (NOISE_COUNTS * NOISE_COUNTS);
        for (innovation, sensitivity) in shown.innovation_counts.iter().zip(&shown.sensitivity) {
            let mut elements = self.block_matrix.iter_mut();
            for (row, (&left, sum)) in sensitivity.iter().zip(&mut self.block_vector).enumerate() {
                let left = left * weight;
                *sum += left * innovation;
                let rights = sensitivity.get(row..).unwrap_or(&[]);
                for (right, sum) in rights.iter().zip(&mut elements) {
                    *sum += left * right;
                }
            }
            self.squares += f64::from(innovation * innovation * weight);
        }
        self.rows += 1;
        self.block_rows += 1;
        if self.block_rows == BLOCK_ROWS {
            self.flush();
        }
    }

    fn flush(&mut self) {
        for (sum, block) in self.matrix.iter_mut().zip(&mut self.block_matrix) {
            *sum += f64::from(core::mem::take(block));
        }
        for (sum, block) in self.vector.iter_mut().zip(&mut self.block_vector) {
            *sum += f64::from(core::mem::take(block));
        }
        self.block_rows = 0;
    }

    /// Root mean square of the innovations over that of the noise.
    pub fn noise_ratio(&self) -> f32 {
        let degrees = (2 * self.rows).saturating_sub((STATE_UNKNOWNS + LOAD_UNKNOWNS) as u32).max(1);
        libm::sqrtf((self.squares / f64::from(degrees)) as f32)
    }

    /// What all that is known beside the rows weighs: where these show more than noise, because the replicas are still far
    /// from the arm or their model is wrong, they say so much less.
    pub fn prior_weight(&self) -> f64 {
        let noise_ratio = f64::from(self.noise_ratio());
        (noise_ratio * noise_ratio).max(1.0)
    }

    /// Gives every nuisance its standard normal prior, or what an empty arm has shown of it, `assumed` being where they are
    /// now, in standard errors. After the last row, before [`Self::eliminate`].
    #[inline(never)]
    pub fn expect(&mut self, assumed: &[f32; NUISANCES], learned: Option<&Learned>) {
        self.flush();
        let weight = self.prior_weight();
        let shown = if let Some(learned) = learned {
            learned.add_to(self, assumed, weight);
            MODEL_UNKNOWNS
        } else {
            0
        };
        for (unknown, &assumed) in assumed.iter().enumerate().skip(shown) {
            self.add_prior(unknown, unknown, weight, [-f64::from(assumed); 2]);
        }
    }

    /// Adds an element of the inverse of a covariance to both of its places; `expected` are the means of its row's and of
    /// its column's unknown from where they are now.
    pub fn add_prior(&mut self, row: usize, column: usize, information: f64, expected: [f64; 2]) {
        self.matrix[place(row, column)] += information;
        self.vector[row] += information * expected[1];
        if row != column {
            self.vector[column] += information * expected[0];
        }
    }

    /// Sum of squares of the innovations over the variance of the noise.
    pub fn squares(&self) -> f64 {
        self.squares
    }

    /// How many rows.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// An element of the upper triangle.
    pub fn element(&self, row: usize, column: usize) -> f64 {
        self.matrix[place(row, column)]
    }

    /// Eliminates a nuisance from those before it; the load stays where it is.
    #[inline(never)]
    pub fn eliminate_backward(&mut self, pivot: usize) {
        let inverse = 1.0 / self.matrix[place(pivot, pivot)];
        for row in 0..pivot {
            let factor = self.matrix[place(row, pivot)] * inverse;
            for column in row..pivot {
                self.matrix[place(row, column)] -= factor * self.matrix[place(column, pivot)];
            }
            self.vector[row] -= factor * self.vector[pivot];
        }
    }

    /// Where the nuisances are best when the load stays; after all of them were eliminated backward.
    #[inline(never)]
    pub fn settled_nuisances(&self, assumed: &[f32; NUISANCES]) -> [f32; NUISANCES] {
        let mut solution = [0.0; NUISANCES];
        let mut best = *assumed;
        for unknown in 0..NUISANCES {
            let mut sum = self.vector[unknown];
            for earlier in 0..unknown {
                sum -= self.matrix[place(earlier, unknown)] * solution[earlier];
            }
            solution[unknown] = sum / self.matrix[place(unknown, unknown)];
            best[unknown] += solution[unknown] as f32;
        }
        best
    }

    /// Holds the load, which is `about`, and answers for variances then; after [`Self::expect`] and the elimination.
    pub fn hold(&mut self, about: &Load<f32>) {
        self.finish(&gradient(about), &Prior::known(about));
    }

    /// Eliminates one unknown from all after it. Apart from each other, because all at once take the board milliseconds.
    #[inline(never)]
    pub fn eliminate(&mut self, pivot: usize) {
        let inverse = 1.0 / self.matrix[place(pivot, pivot)];
        for row in pivot + 1..UNKNOWNS {
            let factor = self.matrix[place(pivot, row)] * inverse;
            if factor == 0.0 {
                continue;
            }
            for column in row..UNKNOWNS {
                self.matrix[place(row, column)] -= factor * self.matrix[place(pivot, column)];
            }
            self.vector[row] -= factor * self.vector[pivot];
        }
    }

    /// The form of the load alone, once all nuisances are eliminated.
    #[inline(never)]
    pub fn reduced(&self) -> Reduced {
        let mut reduced = Reduced { matrix: [[0.0; LOAD_UNKNOWNS]; LOAD_UNKNOWNS], vector: [0.0; LOAD_UNKNOWNS] };
        for row in 0..LOAD_UNKNOWNS {
            reduced.vector[row] = self.vector[NUISANCES + row];
            for column in 0..LOAD_UNKNOWNS {
                let (low, high) = (row.min(column), row.max(column));
                reduced.matrix[row][column] = self.matrix[place(NUISANCES + low, NUISANCES + high)];
            }
        }
        reduced
    }

    /// By which share the best nuisances lower the sum of squares while the load stays; after the elimination, forward or
    /// backward.
    #[inline(never)]
    pub fn gained_share(&self) -> f64 {
        let gained =
            |unknown: usize| self.vector[unknown] * self.vector[unknown] / self.matrix[place(unknown, unknown)];
        (0..NUISANCES).map(gained).sum::<f64>() / self.squares.max(1.0)
    }

    /// Where the nuisances are best when the load is moved by `moved`; after the elimination.
    #[inline(never)]
    pub fn nuisances(&self, assumed: &[f32; NUISANCES], moved: &[f64; LOAD_UNKNOWNS]) -> [f32; NUISANCES] {
        let mut solution = [0.0; UNKNOWNS];
        solution[NUISANCES..].copy_from_slice(moved);
        let mut best = *assumed;
        for unknown in (0..NUISANCES).rev() {
            let mut sum = self.vector[unknown];
            for later in unknown + 1..UNKNOWNS {
                sum -= self.matrix[place(unknown, later)] * solution[later];
            }
            solution[unknown] = sum / self.matrix[place(unknown, unknown)];
            best[unknown] += solution[unknown] as f32;
        }
        best
    }

    /// Turns the form into one of mass, centre and inertia with their priors, eliminated to the end, so that
    /// [`Self::variance`] can be asked; after the elimination.
    #[inline(never)]
    pub fn finish(&mut self, gradient: &[[f64; LOAD_UNKNOWNS]; LOAD_UNKNOWNS], prior: &Prior) {
        let turned = |of: [f64; LOAD_UNKNOWNS]| -> [f64; LOAD_UNKNOWNS] {
            core::array::from_fn(|column| (0..LOAD_UNKNOWNS).map(|row| of[row] * gradient[row][column]).sum())
        };
        for row in 0..NUISANCES {
            let columns = core::array::from_fn(|column| self.matrix[place(row, NUISANCES + column)]);
            for (column, value) in turned(columns).into_iter().enumerate() {
                self.matrix[place(row, NUISANCES + column)] = value;
            }
        }
        let half: [[f64; LOAD_UNKNOWNS]; LOAD_UNKNOWNS] = core::array::from_fn(|row| {
            turned(core::array::from_fn(|column| {
                self.matrix[place(NUISANCES + row.min(column), NUISANCES + row.max(column))]
            }))
        });
        for row in 0..LOAD_UNKNOWNS {
            for column in row..LOAD_UNKNOWNS {
                let sum = (0..LOAD_UNKNOWNS).map(|inner| gradient[inner][row] * half[inner][column]).sum::<f64>();
                let known = if row == column { prior.information[row] } else { 0.0 };
                self.matrix[place(NUISANCES + row, NUISANCES + column)] = sum + known;
            }
        }
        for pivot in NUISANCES..UNKNOWNS {
            self.eliminate(pivot);
        }
    }

    /// Variance of a sum of the unknowns with these weights; the load's are those of mass, centre and inertia. After
    /// [`Self::finish`].
    pub fn variance(&self, weights: &[f32; UNKNOWNS]) -> f64 {
        let mut left = weights.map(f64::from);
        let mut variance = 0.0;
        for unknown in 0..UNKNOWNS {
            let scaled = left[unknown] / self.matrix[place(unknown, unknown)];
            variance += left[unknown] * scaled;
            for later in unknown + 1..UNKNOWNS {
                left[later] -= scaled * self.matrix[place(unknown, later)];
            }
        }
        variance
    }
}

/// The form of the load alone, about the load assumed.
#[derive(Clone, Copy, Debug)]
pub struct Reduced {
    /// Its matrix.
    pub matrix: [[f64; LOAD_UNKNOWNS]; LOAD_UNKNOWNS],
    /// Half its slope, turned round.
    pub vector: [f64; LOAD_UNKNOWNS],
}
