//! How well a least-squares fit is known: the covariance of its values, from exact sensitivities and from how the
//! residuals scatter, as a whole and recording by recording.
//!
//! Two estimates share the work, and each parameter is given the larger of the two standard errors:
//!
//! * From the measured spectrum of the residuals, band by band: the sandwich A⁻¹ B A⁻¹ with A = JᵀJ and B the covariance
//!   of Jᵀr. Residuals are not white: innovations have less than their share of noise below the bandwidth of the state
//!   correction, where the sensitivities are, and a real robot's torque noise has more; σ²A⁻¹ would be wrong either way.
//!   In each band the fit has taken out of the residuals what it could explain; the power left is divided by the degrees
//!   of freedom left (leverages). The level may change along the recording, the shape of the spectrum may not.
//! * From how the values change when one stretch of the recordings after another is left out, all joints at once (block
//!   jackknife, Künsch 1989). It needs no steady noise, sees that one motor's torque moves both joints, and that a moment
//!   which decides much, as the reversal of a joint does for its friction, may be noisier than the rest.
//!
//! Both are widened for how few degrees of freedom they rest on, as Student's t is against the normal distribution.
//! Directions that the data do not determine come out with a huge variance, not with an error.

use nalgebra::{DMatrix, DVector};
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

use super::least_squares::{Series, scaled_normal_matrix};

/// Bands are joined until this many degrees of freedom are left in them.
const LEAST_FREEDOM: f64 = 16.0;

/// Least width of a band in Hz, and its least width as a share of its frequency: the noise changes slowly within it.
const LEAST_WIDTH_HZ: f64 = 0.5;
const LEAST_WIDTH_SHARE: f64 = 0.12;

/// Into how many blocks the recordings are divided at least.
const LEAST_BLOCKS: usize = 16;

/// The least level of a moment, as a share of the whole recording's: a quiet moment is also chance.
const LEAST_LEVEL: f64 = 0.3;

/// Eigenvalues of the scaled information below this share of the largest are nothing but rounding.
const ROUNDING: f64 = 1e-12;

/// What was fitted, at its minimum.
pub struct Fitted<'a> {
    /// Derivatives of the residuals by each parameter.
    pub sensitivities: &'a [Series],
    /// The residuals. Series beyond `origins` are prior knowledge: independent values of variance `prior_variance`.
    pub residuals: &'a Series,
    /// Joint and recording of each series.
    pub origins: Vec<Origin>,
    /// How many recordings there are.
    pub recordings: usize,
    /// Time between two samples in s.
    pub period_s: f64,
    /// Over how many samples residuals are taken to be correlated.
    pub correlated_samples: usize,
    /// Variance of the prior residuals.
    pub prior_variance: f64,
}

/// Where a residual series comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Index of the joint.
    pub joint: usize,
    /// Index of the recording.
    pub recording: usize,
}

/// What the data say about the values fitted.
pub struct Certainty {
    /// Covariance of the values' errors.
    pub covariance: DMatrix<f64>,
    /// JᵀJ over all series, its diagonal scaled to one.
    pub scaled_information: DMatrix<f64>,
    /// JᵀJ and its variance, recording by recording.
    pub recordings: Vec<Evidence>,
    /// JᵀJ of everything, and of prior knowledge.
    information: DMatrix<f64>,
    prior: Evidence,
}

/// What one recording alone says.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// JᵀJ.
    pub information: DMatrix<f64>,
    /// Covariance of the score Jᵀr.
    pub score_covariance: DMatrix<f64>,
    /// The score Jᵀr at the common fit.
    pub score: DVector<f64>,
}

impl Evidence {
    fn none(count: usize) -> Self {
        Self {
            information: DMatrix::zeros(count, count),
            score_covariance: DMatrix::zeros(count, count),
            score: DVector::zeros(count),
        }
    }
}

impl Certainty {
    /// The change of the values if they were fitted without one recording: exact for a linear model, and near the
    /// minimum every model is.
    pub fn change_without(&self, recording: usize) -> DVector<f64> {
        let evidence = &self.recordings[recording];
        solve(&(&self.information - &evidence.information), &evidence.score)
    }

    /// The change of the values if they were fitted to one recording and prior knowledge alone, and their covariance.
    pub fn alone(&self, recording: usize) -> (DVector<f64>, DMatrix<f64>) {
        let evidence = &self.recordings[recording];
        let information = &evidence.information + &self.prior.information;
        let change = -solve(&information, &(&evidence.score + &self.prior.score));
        let (inverse, scale) = scaled_inverse(&information, ROUNDING);
        let meat = scaled(&(&evidence.score_covariance + &self.prior.score_covariance), &scale);
        (change, unscaled(&(&inverse * meat * &inverse), &scale))
    }
}

/// `right` divided by `matrix`; nothing along directions that the matrix does not determine.
fn solve(matrix: &DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    let scale = root_diagonal(matrix);
    let eigen = scaled(matrix, &scale).symmetric_eigen();
    let least = eigen.eigenvalues.max() * 1e-9;
    let inverse = eigen.eigenvalues.map(|value| if value > least { 1.0 / value } else { 0.0 });
    let divided = right.component_div(&scale);
    let along = eigen.eigenvectors.transpose() * divided;
    (&eigen.eigenvectors * along.component_mul(&inverse)).component_div(&scale)
}

/// The inverse of a covariance whose entries may differ by many orders of magnitude.
pub fn inverse(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let (inverse, scale) = scaled_inverse(covariance, ROUNDING);
    unscaled(&inverse, &scale)
}

fn root_diagonal(matrix: &DMatrix<f64>) -> DVector<f64> {
    matrix.diagonal().map(|value| value.sqrt().max(f64::MIN_POSITIVE.sqrt()))
}

fn scaled(matrix: &DMatrix<f64>, scale: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / (scale[i] * scale[j]))
}

/// The covariance in the parameters' own units of one in units of 1/`scale`.
fn unscaled(matrix: &DMatrix<f64>, scale: &DVector<f64>) -> DMatrix<f64> {
    scaled(matrix, scale)
}

/// The inverse of `matrix` scaled to a unit diagonal, its eigenvalues kept above a share of the largest, and the scale.
fn scaled_inverse(matrix: &DMatrix<f64>, floor: f64) -> (DMatrix<f64>, DVector<f64>) {
    let scale = root_diagonal(matrix);
    let eigen = scaled(matrix, &scale).symmetric_eigen();
    let least = eigen.eigenvalues.max() * floor;
    let inverse = DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| 1.0 / value.max(least)));
    (&eigen.eigenvectors * inverse * eigen.eigenvectors.transpose(), scale)
}

/// One series in the frequency domain.
struct Spectrum {
    origin: Origin,
    /// Sensitivities by parameter, divided by their scale.
    sensitivities: Vec<Vec<Complex<f64>>>,
    /// The same times the residual's level of the moment.
    levelled: Vec<Vec<Complex<f64>>>,
    /// The residual divided by its level of the moment.
    residual: Vec<Complex<f64>>,
    samples: f64,
    spacing_hz: f64,
}

impl Spectrum {
    /// How often a line stands in the sum over all frequencies.
    fn weight(&self, line: usize) -> f64 {
        let nyquist = self.samples % 2.0 == 0.0 && line + 1 == self.residual.len();
        if line == 0 || nyquist { 1.0 } else { 2.0 }
    }
}

/// A range of frequencies of one joint.
struct Band {
    joint: usize,
    until_hz: f64,
    freedom: f64,
    /// Variance of the residuals' lines.
    level: f64,
}

/// The certainty of a fit.
pub fn certainty(fitted: &Fitted) -> Certainty {
    let count = fitted.sensitivities.len();
    let (scaled_information, scale) = scaled_normal_matrix(fitted.sensitivities);
    let scale = DVector::from_vec(scale);
    let eigen = scaled_information.clone().symmetric_eigen();
    let floor = eigen.eigenvalues.max() * ROUNDING;
    let in_eigenvectors = |of: &dyn Fn(f64) -> f64| {
        &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(of)) * eigen.eigenvectors.transpose()
    };
    let inverse = in_eigenvectors(&|value| if value > floor { 1.0 / value } else { 0.0 });
    // Directions that nothing determines: A⁻¹ B A⁻¹ would be a quotient of roundings, of any sign.
    let squares: f64 = fitted.residuals.iter().flatten().map(|value| value * value).sum();
    let count_of_residuals = fitted.residuals.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let open = in_eigenvectors(&|value| if value > floor { 0.0 } else { squares / count_of_residuals / floor });

    let spectra = spectra(fitted, &scale);
    let bands = bands(&spectra, &inverse);
    // All in scaled parameters from here on.
    let mut recordings = vec![Evidence::none(count); fitted.recordings];
    let mut by_band = vec![DMatrix::<f64>::zeros(count, count); bands.len()];
    for (index, spectrum) in spectra.iter().enumerate() {
        let evidence = &mut recordings[spectrum.origin.recording];
        for line in 0..spectrum.residual.len() {
            let hz = line as f64 * spectrum.spacing_hz;
            let Some(band) = bands.iter().position(|b| b.joint == spectrum.origin.joint && hz < b.until_hz) else {
                continue;
            };
            let weight = spectrum.weight(line) / spectrum.samples * bands[band].level;
            for i in 0..count {
                let a = spectrum.levelled[i][line];
                for j in 0..=i {
                    let b = spectrum.levelled[j][line];
                    let value = weight * (a.re * b.re + a.im * b.im);
                    by_band[band][(i, j)] += value;
                    evidence.score_covariance[(i, j)] += value;
                }
            }
        }
        let columns: Vec<&[f64]> = fitted.sensitivities.iter().map(|series| series[index].as_slice()).collect();
        for i in 0..count {
            evidence.score[i] += inner(columns[i], &fitted.residuals[index]) / scale[i];
            for j in 0..=i {
                evidence.information[(i, j)] += inner(columns[i], columns[j]) / (scale[i] * scale[j]);
            }
        }
    }
    for evidence in &mut recordings {
        mirror(&mut evidence.information);
        mirror(&mut evidence.score_covariance);
    }
    by_band.iter_mut().for_each(mirror);
    let prior = prior_evidence(fitted, &scale);

    let from_spectrum: DMatrix<f64> = by_band.iter().fold(prior.score_covariance.clone(), |sum, band| sum + band);
    let covariance = &inverse * from_spectrum * &inverse + &open;
    let left_out = blocks_left_out(fitted, &scale, &scaled_information, &inverse);
    let of_prior = &inverse * &prior.score_covariance * &inverse;
    let widened = DVector::from_fn(count, |i, _| {
        let variance = covariance[(i, i)].max(f64::MIN_POSITIVE);
        let spread: f64 = by_band
            .iter()
            .zip(&bands)
            .map(|(band, about)| (inverse.row(i) * band * inverse.column(i))[0].powi(2) / about.freedom)
            .sum();
        let freedom = variance * variance / spread.max(f64::MIN_POSITIVE);
        let of_blocks =
            (left_out.variance[i] + of_prior[(i, i)]).max(0.0).sqrt() * student_over_normal(left_out.freedom[i]);
        (variance.sqrt() * student_over_normal(freedom)).max(of_blocks) / variance.sqrt()
    });
    let widened = DMatrix::from_fn(count, count, |i, j| covariance[(i, j)] * widened[i] * widened[j]);

    let own_units = |evidence: Evidence| Evidence {
        information: DMatrix::from_fn(count, count, |i, j| evidence.information[(i, j)] * scale[i] * scale[j]),
        score_covariance: DMatrix::from_fn(count, count, |i, j| {
            evidence.score_covariance[(i, j)] * scale[i] * scale[j]
        }),
        score: evidence.score.component_mul(&scale),
    };
    let information = DMatrix::from_fn(count, count, |i, j| scaled_information[(i, j)] * scale[i] * scale[j]);
    Certainty {
        covariance: unscaled(&widened, &scale),
        scaled_information,
        recordings: recordings.into_iter().map(own_units).collect(),
        information,
        prior: own_units(prior),
    }
}

/// The 97.5 % point of Student's distribution over that of the normal distribution (first terms of Fisher's expansion).
fn student_over_normal(freedom: f64) -> f64 {
    1.0 + 1.21 / freedom + 1.44 / (freedom * freedom)
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Copies the lower triangle to the upper.
fn mirror(matrix: &mut DMatrix<f64>) {
    matrix.fill_upper_triangle_with_lower_triangle();
}

fn spectra(fitted: &Fitted, scale: &DVector<f64>) -> Vec<Spectrum> {
    let mut planner = RealFftPlanner::<f64>::new();
    let mut spectra = Vec::new();
    for (index, &origin) in fitted.origins.iter().enumerate() {
        let samples = fitted.residuals[index].len();
        if samples < 2 {
            continue;
        }
        let transform = planner.plan_fft_forward(samples);
        let transformed = |series: &mut dyn Iterator<Item = f64>| {
            let mut input: Vec<f64> = series.collect();
            let mut lines = transform.make_output_vec();
            // Fails only on wrong buffer lengths, which the planner made itself.
            let _ = transform.process(&mut input, &mut lines);
            lines
        };
        let residual = &fitted.residuals[index];
        let level = level(residual, fitted.correlated_samples);
        let columns = || fitted.sensitivities.iter().map(|column| &column[index]).zip(scale);
        spectra.push(Spectrum {
            origin,
            residual: transformed(&mut residual.iter().zip(&level).map(|(value, level)| value / level)),
            sensitivities: columns()
                .map(|(column, scale)| transformed(&mut column.iter().map(|v| v / scale)))
                .collect(),
            levelled: columns()
                .map(|(column, scale)| transformed(&mut column.iter().zip(&level).map(|(v, level)| v * level / scale)))
                .collect(),
            samples: samples as f64,
            spacing_hz: 1.0 / (samples as f64 * fitted.period_s),
        });
    }
    spectra
}

/// The residual's level of the moment: its root mean square over a window either way. The same torque moves an arm more in
/// one pose than in another, and a parameter shows most where the arm moves most; a level that is averaged over the whole
/// recording would miss that the two go together.
fn level(residual: &[f64], window: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in residual {
        sums.push(sums[sums.len() - 1] + value * value);
    }
    let mean = |from: usize, to: usize| (sums[to] - sums[from]) / (to - from).max(1) as f64;
    let least = LEAST_LEVEL * mean(0, residual.len()).sqrt();
    let of = |k: usize| mean(k.saturating_sub(window), (k + window).min(residual.len())).sqrt();
    (0..residual.len()).map(|k| of(k).max(least).max(f64::MIN_POSITIVE)).collect()
}

/// Joins lines to bands and measures the residuals' level in each.
fn bands(spectra: &[Spectrum], inverse: &DMatrix<f64>) -> Vec<Band> {
    let mut bands = Vec::new();
    let joints = spectra.iter().map(|s| s.origin.joint + 1).max().unwrap_or(0);
    let highest_hz = spectra.iter().map(|s| s.spacing_hz * s.residual.len() as f64).fold(0.0, f64::max);
    for joint in 0..joints {
        // Frequency, degrees of freedom before and after the fit, power.
        let mut lines: Vec<(f64, f64, f64)> = Vec::new();
        for spectrum in spectra.iter().filter(|s| s.origin.joint == joint) {
            for line in 0..spectrum.residual.len() {
                let weight = spectrum.weight(line);
                let at = |part: fn(&Complex<f64>) -> f64| {
                    DVector::from_iterator(inverse.nrows(), spectrum.sensitivities.iter().map(|s| part(&s[line])))
                };
                let (real, imaginary) = (at(|c| c.re), at(|c| c.im));
                let taken = (real.dot(&(inverse * &real)) + imaginary.dot(&(inverse * &imaginary))) / spectrum.samples;
                let power = spectrum.residual[line].norm_sqr() / spectrum.samples;
                lines.push((line as f64 * spectrum.spacing_hz, weight * (1.0 - taken), weight * power));
            }
        }
        lines.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut from_hz, mut freedom, mut power) = (0.0, 0.0, 0.0);
        for (index, line) in lines.iter().enumerate() {
            freedom += line.1;
            power += line.2;
            let next_hz = lines.get(index + 1).map_or(f64::INFINITY, |next| next.0);
            let wide = next_hz - from_hz >= LEAST_WIDTH_HZ.max(LEAST_WIDTH_SHARE * from_hz);
            let last = next_hz > highest_hz;
            if (wide && next_hz > line.0 && freedom >= LEAST_FREEDOM) || last {
                bands.push(Band {
                    joint,
                    until_hz: next_hz,
                    freedom: freedom.max(1.0),
                    level: power / freedom.max(1.0),
                });
                (from_hz, freedom, power) = (next_hz, 0.0, 0.0);
            }
        }
    }
    bands
}

fn prior_evidence(fitted: &Fitted, scale: &DVector<f64>) -> Evidence {
    let count = scale.len();
    let mut evidence = Evidence::none(count);
    for index in fitted.origins.len()..fitted.residuals.len() {
        let columns: Vec<&[f64]> = fitted.sensitivities.iter().map(|series| series[index].as_slice()).collect();
        for i in 0..count {
            evidence.score[i] += inner(columns[i], &fitted.residuals[index]) / scale[i];
            for j in 0..count {
                let value = inner(columns[i], columns[j]) / (scale[i] * scale[j]);
                evidence.information[(i, j)] += value;
                evidence.score_covariance[(i, j)] += value * fitted.prior_variance;
            }
        }
    }
    evidence
}

/// What leaving out blocks says about each scaled value.
struct LeftOutBlocks {
    variance: DVector<f64>,
    /// Degrees of freedom: as many as there are blocks if all decide alike, fewer if a few decide most.
    freedom: DVector<f64>,
}

/// The fit without each block of `correlated_samples` in turn, all joints of the block at once. Blocks are laid twice,
/// half a block apart, so that it matters little where they begin.
fn blocks_left_out(
    fitted: &Fitted,
    scale: &DVector<f64>,
    information: &DMatrix<f64>,
    inverse: &DMatrix<f64>,
) -> LeftOutBlocks {
    let count = scale.len();
    let mut variance = DVector::<f64>::zeros(count);
    let (mut shares, mut squared_shares) = (DVector::<f64>::zeros(count), DVector::<f64>::zeros(count));
    let groups = same_moments(fitted);
    let samples: usize = groups.iter().map(|group| fitted.residuals[group.start].len()).sum();
    let length = fitted.correlated_samples.min(samples / LEAST_BLOCKS).max(1);
    for group in groups {
        let until = fitted.residuals[group.start].len();
        for first in [length, length.div_ceil(2)] {
            let mut from = 0;
            while from < until {
                let next = if from == 0 { first } else { from + length };
                // A rest shorter than half a block belongs to the block before it.
                let to = if next + length / 2 >= until { until } else { next };
                let (block, score) = score_of(fitted, scale, group.clone(), from..to);
                let (without, rescale) = scaled_inverse(&(information - &block), ROUNDING);
                let change = (without * score.component_div(&rescale)).component_div(&rescale);
                let share = (inverse * &block * inverse).diagonal();
                variance += 0.5 * change.component_mul(&change);
                squared_shares += 0.5 * share.component_mul(&share);
                shares += 0.5 * share;
                from = to;
            }
        }
    }
    let freedom = shares.zip_map(&squared_shares, |sum, squares| sum * sum / squares.max(f64::MIN_POSITIVE));
    LeftOutBlocks { variance, freedom: freedom.map(|freedom| freedom.max(1.0)) }
}

/// Ranges of series that were recorded at the same moments: the joints of one stretch, unless each leaves out samples of
/// its own.
fn same_moments(fitted: &Fitted) -> Vec<std::ops::Range<usize>> {
    let length = |index: usize| fitted.residuals[index].len();
    let mut groups: Vec<std::ops::Range<usize>> = Vec::new();
    for (index, origin) in fitted.origins.iter().enumerate() {
        match groups.last_mut() {
            Some(group) if origin.joint > 0 && length(index) == length(group.start) => group.end = index + 1,
            _ => groups.push(index..index + 1),
        }
    }
    groups
}

/// JᵀJ and Jᵀr, scaled, of some samples of some series.
fn score_of(
    fitted: &Fitted,
    scale: &DVector<f64>,
    series: std::ops::Range<usize>,
    samples: std::ops::Range<usize>,
) -> (DMatrix<f64>, DVector<f64>) {
    let count = scale.len();
    let (mut information, mut score) = (DMatrix::<f64>::zeros(count, count), DVector::<f64>::zeros(count));
    for index in series {
        let columns: Vec<&[f64]> = fitted.sensitivities.iter().map(|s| &s[index][samples.clone()]).collect();
        for i in 0..count {
            score[i] += inner(columns[i], &fitted.residuals[index][samples.clone()]) / scale[i];
            for j in 0..=i {
                information[(i, j)] += inner(columns[i], columns[j]) / (scale[i] * scale[j]);
            }
        }
    }
    mirror(&mut information);
    (information, score)
}

#[cfg(test)]
mod tests;
