//! When something pushes, and for how long: windows of torque, beside whatever the model's own parameters can do.
//!
//! Base parameters bend to imitate a push. What they take of a window, and of its product with the residual, comes from
//! running sums like that product itself, so that every start and many durations are looked at beside all of them.

use nalgebra::DVector;
use rayon::prelude::*;

use super::instance::Instance;
use super::instants::SHOWN_S;
use super::library::Kind;
use super::linear::{Base, Whitened};
use super::screen::{self, Stage};

/// Every how many samples a contact is tried to begin and to end.
const THINNING: usize = 4;

/// Durations of contacts that are tried, in s: the first, and by which factor each is longer than the one before.
const FIRST_DURATION_S: f64 = 0.05;
const LONGER: f64 = 1.22;
const DURATIONS: usize = 18;

/// How many starts of a recording the strength of a contact is computed at; between them it is interpolated.
const STRENGTHS: usize = 10;

/// How often the starts of all recordings are looked at again beside each other.
const SWEEPS: usize = 3;

/// How many durations are handed on for each direction of a contact, and by which factor they differ at least.
const HANDED_ON: usize = 2;
const APART: f64 = 1.4;

/// What a torque of 1 N m over a window of one recording has in common with the residual, and how strong it is, less what the
/// stage's own parameters would take of both.
struct Windows {
    /// First sample that is used.
    begin: usize,
    /// Up to each [`THINNING`]-th sample from there on: the product with the residual.
    common: Vec<f64>,
    /// The products with the stage's columns, whitened by them.
    taken: Vec<DVector<f64>>,
    /// Squared weighed rows by duration and start; what lies between the starts is interpolated.
    strength: Vec<[f64; STRENGTHS]>,
}

/// What windows in one or several recordings add up to.
#[derive(Clone)]
struct Sum {
    common: f64,
    taken: DVector<f64>,
    strength: f64,
}

impl Sum {
    fn none(parameters: usize) -> Self {
        Self { common: 0.0, taken: DVector::zeros(parameters), strength: 0.0 }
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            common: self.common + other.common,
            taken: &self.taken + &other.taken,
            strength: self.strength + other.strength,
        }
    }

    /// The torque over all of them that leaves least, in N m, and by how much χ² falls with it; `right` is what the stage's
    /// own parameters would gain.
    fn fit(&self, right: &DVector<f64>) -> (f64, f64) {
        let common = self.common - self.taken.dot(right);
        // What the own parameters imitate but for a thousandth is no window's.
        let left = (self.strength - self.taken.norm_squared()).max(1e-3 * self.strength);
        if left > 0.0 { (common / left, common * common / left) } else { (0.0, 0.0) }
    }
}

impl Windows {
    /// How many starts there are for windows of so many steps.
    fn starts(&self, steps: usize) -> usize {
        self.common.len().saturating_sub(steps + 1)
    }

    /// The window of the `duration`-th duration, `steps` long, from `start` on.
    fn sum(&self, duration: usize, steps: usize, start: usize) -> Sum {
        let place = start as f64 / self.starts(steps).max(2) as f64 * (STRENGTHS - 1) as f64;
        let (left, share) = (place as usize, place.fract());
        let strength = &self.strength[duration];
        Sum {
            common: self.common[start + steps] - self.common[start],
            taken: &self.taken[start + steps] - &self.taken[start],
            strength: strength[left] * (1.0 - share) + strength[(left + 1).min(STRENGTHS - 1)] * share,
        }
    }
}

/// Contacts in either of these directions that the residual suggests, the durations that explain most; or those of a `known`
/// one, whose torque and duration stay.
pub fn contacts(
    stage: &Stage,
    kind: &'static Kind,
    joint: usize,
    weights: &[f64],
    signs: &[f64],
    known: Option<&Instance>,
) -> Vec<Instance> {
    let period_s = stage.setting.experiment.robot.record_period_s;
    let step_s = THINNING as f64 * period_s;
    let size_nm = known.and_then(|known| known.common[0]);
    let durations_s: Vec<f64> = match known.and_then(|known| known.common[1]) {
        Some(duration_s) => vec![duration_s],
        None => (0..DURATIONS).map(|step| FIRST_DURATION_S * LONGER.powi(step as i32)).collect(),
    };
    let steps: Vec<usize> =
        durations_s.iter().map(|duration_s| ((duration_s / step_s).round() as usize).max(1)).collect();
    // An effect that is known is looked for beside parameters that are.
    let (precisions, offsets) = screen::priors(stage);
    let base = Base::new(stage.columns, stage.residual, weights, &precisions, &offsets);
    let whitened = if known.is_some() { None } else { base.whitened() };
    let records = stage.setting.experiment.segments.len();
    let windows: Vec<Windows> =
        (0..records).map(|record| windows(stage, record, joint, weights, &steps, whitened.as_ref())).collect();
    let right = whitened.map_or_else(|| DVector::zeros(0), |whitened| whitened.right);
    let mut found = Vec::new();
    for &sign in signs {
        let mut each: Vec<Found> = steps
            .par_iter()
            .enumerate()
            .filter_map(|(duration, &steps)| {
                if windows.iter().any(|windows| windows.starts(steps) == 0) {
                    return None;
                }
                let fit = |sum: &Sum| match size_nm {
                    Some(size_nm) => (size_nm, 2.0 * size_nm * sum.common - size_nm * size_nm * sum.strength),
                    None => sum.fit(&right),
                };
                let gain = |sum: &Sum| match fit(sum) {
                    (size_nm, gain) if size_nm * sign > 0.0 => gain,
                    _ => 0.0,
                };
                let (sum, starts) = together(&windows, duration, steps, right.len(), gain);
                Some(Found { gain: gain(&sum), size_nm: fit(&sum).0, duration_s: durations_s[duration], starts })
            })
            .collect();
        each.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut taken: Vec<f64> = Vec::new();
        for Found { size_nm, duration_s, starts, .. } in each {
            let apart = |other: &f64| (duration_s / other).max(other / duration_s) >= APART;
            if taken.len() == HANDED_ON || !taken.iter().all(apart) {
                continue;
            }
            taken.push(duration_s);
            let start_s =
                |(start, windows): (usize, &Windows)| vec![(windows.begin + start * THINNING) as f64 * period_s];
            let records = starts.into_iter().zip(&windows).map(start_s).collect();
            found.push(Instance { kind, joint, common: vec![Some(size_nm), Some(duration_s), None], records });
        }
    }
    found
}

/// Contacts of one duration in all recordings.
struct Found {
    gain: f64,
    size_nm: f64,
    duration_s: f64,
    starts: Vec<usize>,
}

/// The starts in all recordings that gain most together: each recording's own first, then each again beside the others.
fn together(
    windows: &[Windows],
    duration: usize,
    steps: usize,
    parameters: usize,
    gain: impl Fn(&Sum) -> f64,
) -> (Sum, Vec<usize>) {
    let best_beside = |windows: &Windows, others: &Sum| {
        let gains = (0..windows.starts(steps)).map(|start| gain(&others.plus(&windows.sum(duration, steps, start))));
        let best = gains.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        best.map_or(0, |(start, _)| start)
    };
    let none = Sum::none(parameters);
    let mut starts: Vec<usize> = windows.iter().map(|windows| best_beside(windows, &none)).collect();
    let total = |starts: &[usize], but: Option<usize>| {
        let each = windows.iter().zip(starts).enumerate().filter(|(record, _)| Some(*record) != but);
        each.fold(none.clone(), |sum, (_, (windows, &start))| sum.plus(&windows.sum(duration, steps, start)))
    };
    if windows.len() > 1 {
        for _ in 0..SWEEPS {
            let before = starts.clone();
            for record in 0..windows.len() {
                starts[record] = best_beside(&windows[record], &total(&starts, Some(record)));
            }
            if starts == before {
                break;
            }
        }
    }
    (total(&starts, None), starts)
}

/// What a torque of `joint` over windows of so many `steps` does in a recording, beside what `whitened` parameters do.
fn windows(
    stage: &Stage,
    record: usize,
    joint: usize,
    weights: &[f64],
    steps: &[usize],
    whitened: Option<&Whitened>,
) -> Windows {
    let rows = stage.setting.rows;
    let experiment = stage.setting.experiment;
    let ratio = experiment.robot.joints[joint].gear_ratio;
    let of_record: Vec<_> = rows.series.iter().filter(|series| series.segment == record).collect();
    let samples = experiment.settled(&experiment.segments[record]);
    let end = samples.end.saturating_sub((SHOWN_S / experiment.robot.record_period_s) as usize);
    // What a torque of 1 N m up to each sample has in common with these rows.
    let up_to = |motion: &[f64]| -> Vec<f64> {
        let mut seen = vec![0.0; samples.end];
        for series in &of_record {
            let place = series.rows.clone();
            let weighed = rows.weighed_back(series, &motion[place.clone()], &weights[place]);
            let back = stage.response.back_to_torque(record, series.joint, joint, &weighed);
            seen.iter_mut().zip(back).for_each(|(sum, x)| *sum += x / ratio);
        }
        let mut sum = 0.0;
        let sums = seen.iter().take(end).enumerate().map(|(k, x)| {
            sum += if k < samples.start { 0.0 } else { *x };
            sum
        });
        sums.skip(samples.start).step_by(THINNING).collect()
    };
    let common = up_to(&stage.residual.motion);
    let taken = match whitened {
        None => vec![DVector::zeros(0); common.len()],
        Some(whitened) => {
            let each: Vec<Vec<f64>> = stage.columns.par_iter().map(|column| up_to(&column.motion)).collect();
            let at = |k: usize| DVector::from_iterator(each.len(), each.iter().map(|column| column[k]));
            (0..common.len()).into_par_iter().map(|k| whitened.of(&at(k))).collect()
        }
    };
    let mut windows = Windows { begin: samples.start, common, taken, strength: Vec::new() };
    windows.strength = steps
        .par_iter()
        .map(|&steps| {
            let starts = windows.starts(steps);
            std::array::from_fn(|place| {
                let first = samples.start + THINNING * (starts * place / (STRENGTHS - 1));
                let pushed = first..first + THINNING * steps;
                let strength = of_record.iter().map(|series| {
                    let torque = |k: usize| if pushed.contains(&k) { 1.0 / ratio } else { 0.0 };
                    let row = rows.one(series, &stage.response.to_torque(record, series.joint, joint, torque));
                    row.iter().zip(&weights[series.rows.clone()]).map(|(x, w)| (x * w).powi(2)).sum::<f64>()
                });
                strength.sum()
            })
        })
        .collect();
    windows
}
