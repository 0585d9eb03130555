//! From series of samples to rows of a regression: the spectrum of every recording and joint, one row for each real and
//! imaginary part.
//!
//! In frequency noise that is correlated in time is independent from row to row, so that weighing is a division. Above
//! [`HIGHEST_HZ`] an arm moves too little for anything to be told; leaving those rows out makes everything three times
//! faster.

use std::sync::Arc;

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

use super::nulls;
use super::simulate::Candidate;
use crate::identify::{Columns, Experiment};

/// No mechanical effect shows above this.
const HIGHEST_HZ: f64 = 200.0;

/// Lines above the rows' frequencies from which on their power tells how loud white noise is.
const TELLING_LINES: f64 = 100.0;

/// Share of the samples that fade in and out: the ends of a series are no jump then.
const TAPERED_S: f64 = 0.05;

/// One recording's joint.
pub struct Series {
    /// Which segment of the experiment.
    pub segment: usize,
    /// Which joint.
    pub joint: usize,
    /// Its samples that are used.
    pub samples: std::ops::Range<usize>,
    /// Where its rows are.
    pub rows: std::ops::Range<usize>,
    taper: Vec<f64>,
    fft: Arc<dyn RealToComplex<f64>>,
    back: Arc<dyn ComplexToReal<f64>>,
}

/// How series become rows.
pub struct Rows {
    /// The recordings' joints, in the order of their rows.
    pub series: Vec<Series>,
    /// Frequency of every row in Hz.
    pub frequency_hz: Vec<f64>,
    /// Joint of every row.
    pub joint: Vec<usize>,
    /// Variance that rounding alone leaves in the innovations of each joint, counts².
    rounding_counts2: [f64; 2],
}

impl Rows {
    /// The rows of an experiment.
    pub fn new(experiment: &Experiment) -> Self {
        let period_s = experiment.robot.record_period_s;
        let mut planner = RealFftPlanner::<f64>::new();
        let rounding_counts2 = [if experiment.robot.quantised { 1.0 / 12.0 } else { 1e-6 }; 2];
        let mut rows = Self { series: Vec::new(), frequency_hz: Vec::new(), joint: Vec::new(), rounding_counts2 };
        for (index, segment) in experiment.segments.iter().enumerate() {
            for joint in 0..experiment.robot.joints.len() {
                let samples = experiment.settled(segment);
                let length = samples.len();
                let from = rows.frequency_hz.len();
                let spacing_hz = 1.0 / (length as f64 * period_s);
                let bins = ((HIGHEST_HZ / spacing_hz) as usize).min(length.saturating_sub(1) / 2);
                for bin in 0..=bins {
                    for _ in 0..if bin == 0 { 1 } else { 2 } {
                        rows.frequency_hz.push(bin as f64 * spacing_hz);
                        rows.joint.push(joint);
                    }
                }
                let edge = ((TAPERED_S / period_s) as usize).max(1) as f64;
                let mut taper: Vec<f64> = (0..length)
                    .map(|k| {
                        let inside = (k as f64 + 0.5).min(length as f64 - k as f64 - 0.5) / edge;
                        if inside >= 1.0 { 1.0 } else { 0.5 - 0.5 * (std::f64::consts::PI * inside).cos() }
                    })
                    .collect();
                let power: f64 = taper.iter().map(|x| x * x).sum();
                // White noise of variance σ² gives every row the variance σ².
                let scale = (2.0 / power).sqrt();
                taper.iter_mut().for_each(|x| *x *= scale);
                rows.series.push(Series {
                    segment: index,
                    joint,
                    samples,
                    rows: from..rows.frequency_hz.len(),
                    taper,
                    fft: planner.plan_fft_forward(length),
                    back: planner.plan_fft_inverse(length),
                });
            }
        }
        rows
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.frequency_hz.len()
    }

    /// The rows of `columns`.
    pub fn of(&self, columns: &Columns) -> Vec<f64> {
        self.of_series(|series| &columns[series.segment][series.joint])
    }

    /// The rows of whatever `column` gives for each series, all samples of its segment.
    pub fn of_series<'a>(&self, column: impl Fn(&Series) -> &'a [f64]) -> Vec<f64> {
        self.series.iter().flat_map(|series| self.one(series, column(series))).collect()
    }

    /// The rows of one series, from all samples of its segment.
    pub fn one(&self, series: &Series, column: &[f64]) -> Vec<f64> {
        let column = &column[series.samples.clone()];
        let mut samples: Vec<f64> = column.iter().zip(&series.taper).map(|(x, w)| x * w).collect();
        let mut lines = series.fft.make_output_vec();
        // Fails only on wrong buffer lengths, which the planner made itself.
        let _ = series.fft.process(&mut samples, &mut lines);
        let bins = series.rows.len() / 2;
        let mut rows = Vec::with_capacity(series.rows.len());
        rows.push(lines[0].re * std::f64::consts::FRAC_1_SQRT_2);
        for line in &lines[1..=bins] {
            rows.push(line.re);
            rows.push(line.im);
        }
        rows
    }

    /// The series, as long as its segment, whose product with any other sample by sample is the product of `rows`, under
    /// squared weights, with the other's rows.
    pub fn weighed_back(&self, series: &Series, rows: &[f64], weights: &[f64]) -> Vec<f64> {
        let mut lines = series.back.make_input_vec();
        let weighed: Vec<f64> = rows.iter().zip(weights).map(|(x, w)| x * w * w).collect();
        lines[0].re = weighed[0] * std::f64::consts::FRAC_1_SQRT_2;
        for (line, pair) in lines[1..].iter_mut().zip(weighed[1..].chunks(2)) {
            line.re = 0.5 * pair[0];
            line.im = 0.5 * pair[1];
        }
        let mut samples = series.back.make_output_vec();
        // Fails only on wrong buffer lengths and on imaginary parts where a real series has none.
        let _ = series.back.process(&mut lines, &mut samples);
        let mut whole = vec![0.0; series.samples.end];
        for ((place, x), w) in whole[series.samples.clone()].iter_mut().zip(samples).zip(&series.taper) {
            *place = x * w;
        }
        whole
    }

    /// The rows of an experiment on a robot that is about `model`. In a loop that is faster than the recording, rounding moves
    /// the arm between the samples, unseen, by how much robots tell that have no other noise.
    pub fn with_rounding_of(mut self, experiment: &Experiment, model: Option<&Candidate>, seed: u64) -> Self {
        if let Some(model) = model.filter(|_| experiment.robot.quantised && experiment.commands_are_missing()) {
            self.rounding_counts2 = nulls::rounding_counts2(experiment, model, seed);
        }
        self
    }

    /// Variance of the white part of innovations per joint in counts²: their mean power above the rows' frequencies, at least
    /// what rounding leaves.
    pub fn white_counts2(&self, columns: &Columns) -> [f64; 2] {
        let mut sum = [0.0; 2];
        let mut count = [0.0; 2];
        for series in &self.series {
            let column = &columns[series.segment][series.joint][series.samples.clone()];
            let mut samples: Vec<f64> = column.iter().zip(&series.taper).map(|(x, w)| x * w).collect();
            let mut lines = series.fft.make_output_vec();
            let _ = series.fft.process(&mut samples, &mut lines);
            for line in &lines[series.rows.len() / 2 + 1..] {
                sum[series.joint] += 0.5 * line.norm_sqr();
                count[series.joint] += 1.0;
            }
        }
        [0, 1].map(|joint: usize| {
            let (power, rounding) = (sum[joint] / count[joint], self.rounding_counts2[joint]);
            // A few lines tell little of their power.
            if count[joint] >= TELLING_LINES && power.is_finite() { power.max(rounding) } else { rounding }
        })
    }
}
