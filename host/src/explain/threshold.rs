//! How large a score chance reaches in this experiment, from simulations of robots that lack nothing.

use std::path::Path;

use rayon::prelude::*;

use super::engine::{Engine, Fitted};
use super::kept_thresholds::Kept;
use super::linear::{Column, inner, solve};
use super::noise::Noise;
use super::nulls::{NullNoise, simulate_nulls};
use super::screen::Feature;
use crate::random::Random;

use nalgebra::{DMatrix, DVector};

/// Null simulations that a threshold is taken from.
pub const NULLS: usize = 48;

/// [`null_scores`], computed once if there is a folder to keep them in.
pub fn kept_null_scores(
    engine: &Engine,
    fitted: &Fitted,
    features: &[Feature],
    noise: &Noise,
    seed: u64,
    folder: Option<&Path>,
) -> Vec<f64> {
    let kept = folder.map(|folder| Kept::new(folder, engine, fitted, features, noise, NULLS, seed));
    if let Some(scores) = kept.as_ref().and_then(|kept| kept.read(NULLS)) {
        return scores;
    }
    let scores = null_scores(engine, fitted, features, noise, seed);
    if let Some(kept) = kept {
        kept.write(&scores);
    }
    scores
}

/// The largest score of each null simulation: ΔBIC of the best feature beside the base.
fn null_scores(engine: &Engine, fitted: &Fitted, features: &[Feature], noise: &Noise, seed: u64) -> Vec<f64> {
    let weights = engine.weights(noise);
    let Some(model) = fitted.hypothesis.candidate(engine.baseline, engine.setting.experiment) else {
        return Vec::new();
    };
    let simulated = NullNoise {
        torque_nm: engine.torque_noise_nm(noise),
        correlation_time_s: noise.map(|noise| noise.correlation_time_s),
        position_counts: noise.map(|noise| noise.white_counts2.sqrt()),
    };
    let nulls = simulate_nulls(engine.setting.experiment, &model, &simulated, seed, NULLS);
    let precisions: Vec<f64> = fitted
        .hypothesis
        .unknowns(engine.baseline)
        .iter()
        .map(|unknown| unknown.prior.map_or(0.0, |[_, sigma]| 1.0 / sigma))
        .collect();
    let count = fitted.columns.len();
    let mut normal = DMatrix::zeros(count, count);
    for i in 0..count {
        for j in i..count {
            let value = inner(&fitted.columns[i].motion, &fitted.columns[j].motion, &weights);
            normal[(i, j)] = value;
            normal[(j, i)] = value;
        }
        normal[(i, i)] += precisions[i] * precisions[i];
    }
    // Every feature's columns with the base taken out, orthonormal: a score is then a sum of squared products.
    let square: Vec<f64> = weights.iter().map(|w| w * w).collect();
    let projected: Vec<Vec<(Vec<f64>, DVector<f64>)>> =
        features.par_iter().map(|feature| orthonormal(&fitted.columns, &normal, &feature.columns, &weights)).collect();
    let rows: Vec<Vec<f64>> = nulls.par_iter().map(|columns| engine.setting.rows.of(columns)).collect();
    let penalty = (engine.setting.rows.count() as f64).ln();
    let mut random = Random::new(seed, 0x7072_696f);
    // A baseline errs by its standard errors: in the augmented rows of the priors that is the residual.
    let errors: Vec<DVector<f64>> = rows
        .iter()
        .map(|_| DVector::from_iterator(count, precisions.iter().map(|p| if *p > 0.0 { random.normal() } else { 0.0 })))
        .collect();
    rows.par_iter()
        .zip(&errors)
        .map(|(row, error)| {
            let weighted: Vec<f64> = row.iter().zip(&square).map(|(x, w)| x * w).collect();
            let of = |directions: &Vec<(Vec<f64>, DVector<f64>)>| -> f64 {
                directions
                    .iter()
                    .map(|(direction, prior)| {
                        let data: f64 = direction.iter().zip(&weighted).map(|(a, b)| a * b).sum();
                        (data + prior.dot(error)).powi(2)
                    })
                    .sum()
            };
            let scores =
                projected.iter().zip(features).map(|(directions, feature)| of(directions) - feature.price * penalty);
            scores.fold(f64::NEG_INFINITY, f64::max)
        })
        .collect()
}

/// The columns of a feature made orthonormal, under weights and priors, to the base and each other: rows of the data
/// and rows of the priors.
fn orthonormal(
    base: &[Column],
    normal: &DMatrix<f64>,
    columns: &[Column],
    weights: &[f64],
) -> Vec<(Vec<f64>, DVector<f64>)> {
    let count = base.len();
    let mut directions: Vec<(Vec<f64>, DVector<f64>)> = Vec::new();
    for column in columns {
        let right = DVector::from_iterator(count, base.iter().map(|b| inner(&b.motion, &column.motion, weights)));
        let coefficients = solve(normal, &right);
        let mut data = column.motion.clone();
        for (base, coefficient) in base.iter().zip(coefficients.iter()) {
            data.iter_mut().zip(&base.motion).for_each(|(x, b)| *x -= coefficient * b);
        }
        // In the rows of the priors the column is zero, and the base's are 1/σ.
        let mut prior = DVector::from_fn(count, |i, _| {
            let precision = (normal[(i, i)] - inner(&base[i].motion, &base[i].motion, weights)).max(0.0).sqrt();
            -coefficients[i] * precision
        });
        for (other, other_prior) in &directions {
            let overlap = inner(&data, other, weights) + prior.dot(other_prior);
            data.iter_mut().zip(other).for_each(|(x, o)| *x -= overlap * o);
            prior -= other_prior * overlap;
        }
        let size = inner(&data, &data, weights) + prior.dot(&prior);
        let whole = inner(&column.motion, &column.motion, weights);
        if size > 1e-8 * whole && size > 0.0 {
            let scale = 1.0 / size.sqrt();
            data.iter_mut().for_each(|x| *x *= scale);
            directions.push((data, prior * scale));
        }
    }
    directions
}
