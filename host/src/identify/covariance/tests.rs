//! Standard errors of a line's coefficients, against how they scatter.

use rand::{RngExt, SeedableRng};

use super::*;

const SAMPLES: usize = 4000;

/// A line's two coefficients, with noise that keeps `memory` of itself from sample to sample.
fn fit_a_line(random: &mut rand::rngs::StdRng, memory: f64) -> (f64, f64) {
    let mut noise = 0.0;
    let noise: Vec<f64> = (0..SAMPLES)
        .map(|_| {
            noise = memory * noise + random.random_range(-1.0..1.0);
            noise
        })
        .collect();
    let slow: Vec<f64> = (0..SAMPLES).map(|k| (k as f64 / 200.0).sin()).collect();
    // One residual of prior knowledge that knows nothing.
    let columns = [vec![slow.clone(), vec![0.0]], vec![vec![1.0; SAMPLES], vec![0.0]]];
    let a = DMatrix::from_fn(2, 2, |i, j| inner(&columns[i][0], &columns[j][0]));
    let b = DVector::from_fn(2, |i, _| inner(&columns[i][0], &noise));
    let values = a.try_inverse().unwrap() * b;
    let residuals: Vec<f64> = (0..SAMPLES).map(|k| values[0] * slow[k] + values[1] - noise[k]).collect();
    let found = certainty(&Fitted {
        sensitivities: &columns,
        residuals: &vec![residuals, vec![0.0]],
        origins: vec![Origin { joint: 0, recording: 0 }],
        recordings: 1,
        period_s: 1e-3,
        correlated_samples: 200,
        prior_variance: 1.0,
    });
    (values[0], found.covariance[(0, 0)].sqrt())
}

/// Whatever the memory of the noise, errors over standard errors are about one. A band that is as wide as the noise's
/// own bandwidth sees a little less than what there is at its lowest frequency.
#[test]
fn standard_errors_hold_for_white_and_for_slow_noise() {
    let mut random = rand::rngs::StdRng::seed_from_u64(5);
    for memory in [0.0, 0.9, 0.98] {
        let trials = 200;
        let ratios = (0..trials).map(|_| {
            let (error, stated) = fit_a_line(&mut random, memory);
            (error / stated).powi(2)
        });
        let ratio = (ratios.sum::<f64>() / f64::from(trials)).sqrt();
        println!("memory {memory}: error / standard error {ratio:.3}");
        assert!((0.75..1.15).contains(&ratio), "memory {memory}: {ratio}");
    }
}

/// Two parameters that do the same: their sum is known, neither of them is.
#[test]
fn what_nothing_determines_has_a_huge_error() {
    let column = || vec![(0..500).map(|k| (k as f64 / 30.0).sin()).collect::<Vec<f64>>()];
    let found = certainty(&Fitted {
        sensitivities: &[column(), column()],
        residuals: &vec![(0..500).map(|k| if k % 2 == 0 { 0.3 } else { -0.3 }).collect()],
        origins: vec![Origin { joint: 0, recording: 0 }],
        recordings: 1,
        period_s: 1e-3,
        correlated_samples: 10,
        prior_variance: 1.0,
    });
    let c = &found.covariance;
    assert!(c[(0, 0)] > 1e6 && c[(1, 1)] > 1e6, "{c}");
    assert!((c[(0, 0)] + c[(1, 1)] + 2.0 * c[(0, 1)]).abs() < 1e-3 * c[(0, 0)], "{c}");
}

/// Of a mean over two recordings each tells half; without one, what is left is the mean of the other.
#[test]
fn recordings_are_told_apart() {
    let sensitivities = [vec![vec![1.0; 100], vec![1.0; 300]]];
    let (first, second) = (2.0, 6.0);
    let mean = 0.25 * first + 0.75 * second;
    let wave = |k: usize| if k.is_multiple_of(2) { 0.1 } else { -0.1 };
    let residuals = vec![
        (0..100).map(|k| mean - first + wave(k)).collect::<Vec<f64>>(),
        (0..300).map(|k| mean - second + wave(k)).collect(),
    ];
    let found = certainty(&Fitted {
        sensitivities: &sensitivities,
        residuals: &residuals,
        origins: [0, 1].map(|recording| Origin { joint: 0, recording }).to_vec(),
        recordings: 2,
        period_s: 1e-3,
        correlated_samples: 10,
        prior_variance: 1.0,
    });
    assert!((mean + found.change_without(0)[0] - second).abs() < 1e-9);
    assert!((mean + found.change_without(1)[0] - first).abs() < 1e-9);
    assert!((mean + found.alone(1).0[0] - second).abs() < 1e-9);
}
