//! Convex quadratic problems with linear and cone constraints, solved by an interior-point method (Clarabel).

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, SecondOrderConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use nalgebra::{DMatrix, DVector};

/// `weights · x ≤ limit`.
pub type Row = (Vec<f64>, f64);

/// Rows `b − a · x` whose first is at least the length of the others taken together.
pub type Cone = Vec<Row>;

/// The x that minimises ½ xᵀ `quadratic` x + `linear`ᵀ x within all `rows` and `cones`; nothing if there is none.
pub fn minimise(quadratic: &DMatrix<f64>, linear: &DVector<f64>, rows: &[Row], cones: &[Cone]) -> Option<Vec<f64>> {
    let count = linear.len();
    let all: Vec<&Row> = rows.iter().chain(cones.iter().flatten()).collect();
    let mut kinds = vec![NonnegativeConeT(rows.len())];
    kinds.extend(cones.iter().map(|cone| SecondOrderConeT(cone.len())));
    let weights: Vec<Vec<f64>> = all.iter().map(|row| row.0.clone()).collect();
    let limits: Vec<f64> = all.iter().map(|row| row.1).collect();
    // The solver takes the upper triangle.
    let upper: Vec<Vec<f64>> =
        (0..count).map(|i| (0..count).map(|j| if j >= i { quadratic[(i, j)] } else { 0.0 }).collect()).collect();
    let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
    let mut solver = DefaultSolver::new(
        &CscMatrix::from(&upper),
        linear.as_slice(),
        &CscMatrix::from(&weights),
        &limits,
        &kinds,
        settings,
    )
    .ok()?;
    solver.solve();
    matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved)
        .then(|| solver.solution.x.clone())
}
