//! A rival: discrepancy modelling by sparse regression (SINDy), as its documentation shows it.
//!
//! The discrepancy is what the given model leaves of the torque; nothing of the model is fitted anew. Candidate
//! functions of all effects together, each of unit root mean square; sequentially thresholded least squares with the
//! usual settings of the published tool: threshold 0.1 (here of Coulomb friction), ridge 0.05, 20 rounds. The largest
//! coefficient gives the name.

use std::time::Instant;

use nalgebra::{DMatrix, DVector};

use super::answer::{Answer, Verdict};
use super::case::Case;
use super::screen::{Hypothesis, Rows, named};

const THRESHOLD: f64 = 0.1;
const RIDGE: f64 = 0.05;
const ROUNDS: usize = 20;

/// Sparse regression's answer to a case.
pub fn answer(case: &Case) -> Answer {
    let started = Instant::now();
    let verdict = match Rows::read(case) {
        Ok(Some(rows)) => Ok(verdict(&rows)),
        Ok(None) => Err("no two-link arm under a P loop".to_owned()),
        Err(error) => Err(error.to_string()),
    };
    let seconds = started.elapsed().as_secs_f64();
    match verdict {
        Ok(verdict) => Answer { seconds, verdict: Some(verdict), failure: String::new() },
        Err(failure) => Answer { seconds, verdict: None, failure },
    }
}

fn verdict(rows: &Rows) -> Verdict {
    // Whole orders: a library is written down before the data are seen.
    let hypotheses = rows.hypotheses(&[1.0, 2.0, 3.0, 4.0, 5.0]);
    let candidates: Vec<(&Hypothesis, &[f64])> = hypotheses
        .iter()
        .flat_map(|hypothesis| hypothesis.columns.iter().map(move |column| (hypothesis, column.as_slice())))
        .collect();
    let count = rows.left.len();
    let mut design = DMatrix::zeros(count, candidates.len());
    for (index, (_, column)) in candidates.iter().enumerate() {
        let rms = (column.iter().map(|value| value * value).sum::<f64>() / count.max(1) as f64).sqrt();
        if rms > 0.0 {
            design.column_mut(index).copy_from_slice(column);
            design.column_mut(index).scale_mut(1.0 / rms);
        }
    }
    let coefficients = thresholded(&design, &DVector::from_column_slice(&rows.left));
    let largest =
        (0..candidates.len()).max_by(|&one, &other| coefficients[one].abs().total_cmp(&coefficients[other].abs()));
    match largest {
        Some(index) if coefficients[index] != 0.0 => named(rows, candidates[index].0.name, candidates[index].0.joint),
        _ => Verdict { verdict: "none".to_owned(), ..Verdict::default() },
    }
}

/// Sequentially thresholded ridge regression; `design` has columns of unit root mean square.
pub fn thresholded(design: &DMatrix<f64>, target: &DVector<f64>) -> Vec<f64> {
    let mut active: Vec<usize> = (0..design.ncols()).collect();
    let mut coefficients = vec![0.0; design.ncols()];
    for _ in 0..ROUNDS {
        if active.is_empty() {
            break;
        }
        let part = design.select_columns(&active);
        let mut squares = part.tr_mul(&part);
        for index in 0..active.len() {
            squares[(index, index)] += RIDGE;
        }
        let Some(solution) = squares.cholesky().map(|factor| factor.solve(&part.tr_mul(target))) else { break };
        coefficients.fill(0.0);
        let mut kept = Vec::new();
        for (&index, &value) in active.iter().zip(solution.iter()) {
            if value.abs() >= THRESHOLD {
                coefficients[index] = value;
                kept.push(index);
            }
        }
        if kept.len() == active.len() {
            break;
        }
        active = kept;
    }
    if active.is_empty() {
        coefficients.fill(0.0);
    }
    coefficients
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two of four functions made the data; the others must come out as exactly zero.
    #[test]
    fn the_functions_behind_the_data_are_left() {
        let functions: [fn(f64) -> f64; 4] = [|t| t.sin(), |t| t.cos(), |t| (2.0 * t).sin(), |t| (3.0 * t).cos()];
        let at = |row: usize| row as f64 * 0.01;
        let design = DMatrix::from_fn(3000, 4, |row, column| std::f64::consts::SQRT_2 * functions[column](at(row)));
        let target = DVector::from_fn(3000, |row, _| 0.7 * design[(row, 0)] - 0.3 * design[(row, 2)]);
        let found = thresholded(&design, &target);
        assert!((found[0] - 0.7).abs() < 1e-3 && (found[2] + 0.3).abs() < 1e-3, "{found:?}");
        assert_eq!((found[1], found[3]), (0.0, 0.0));
    }
}
