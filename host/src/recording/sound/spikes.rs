//! Single samples far off their neighbours: bits lost on a wire, not motion. No motor moves five counts and back within
//! a few periods.

use std::ops::Range;

use super::{Finding, contiguous, gain_a_per_count, median};
use crate::recording::Recording;
use crate::robot::Robot;

/// Samples on either side that a sample is compared with. Up to half as many corrupted in a row are found.
const NEIGHBOURS: usize = 7;

/// A count this far off its neighbours is none: rounding and ringing bend a count's course by less than two.
const LEAST_COUNTS: f64 = 5.0;

/// How many times the scatter of its neighbours a sample may be off.
const SCATTERS: f64 = 8.0;

/// The standard deviation of normal noise over its median absolute deviation.
const DEVIATIONS_PER_MEDIAN: f64 = 1.4826;

/// With more than this share of a column off, it is noise and not a few accidents.
const MOST_MENDED: f64 = 0.02;

/// Replaces corrupted samples of reference, error and command by the line between their sound neighbours.
pub fn mend(recording: &mut Recording, robot: &Robot) -> Vec<Finding> {
    let ranges = contiguous(&recording.tick);
    let tick = recording.tick.clone();
    let mut findings = Vec::new();
    let counts = robot.quantised.then_some(LEAST_COUNTS);
    for (index, joint) in robot.joints.iter().enumerate() {
        let current = counts.zip(gain_a_per_count(robot, index)).map(|(counts, gain)| counts * gain);
        let columns = [
            ("ref", counts, Some(&mut recording.reference_counts[index])),
            ("err", counts, Some(&mut recording.error_counts[index])),
            ("cmd", current, recording.command_a.as_mut().map(|columns| &mut columns[index])),
        ];
        for (prefix, least, column) in columns {
            let Some(column) = column else { continue };
            let off: Vec<usize> = ranges.iter().flat_map(|range| spikes(column, range, least)).collect();
            let (name, samples) = (format!("{prefix}{}", joint.name), column.len());
            if off.len() as f64 > MOST_MENDED * samples as f64 {
                findings.push(Finding::Noisy { column: name, count: off.len(), samples });
            } else if !off.is_empty() {
                bridge(column, &ranges, &off);
                findings.push(Finding::Mended { column: name, ticks: off.iter().map(|&k| tick[k]).collect() });
            }
        }
    }
    findings
}

/// The samples of `values` in `range` that are off by more than `least` and by more than the scatter around them.
/// Without `least`, by the column's own smoothness.
fn spikes(values: &[f64], range: &Range<usize>, least: Option<f64>) -> Vec<usize> {
    let bend = |k: usize| (values[k - 1] - 2.0 * values[k] + values[k + 1]).abs();
    let inner = range.start + 1..range.end.saturating_sub(1).max(range.start + 1);
    let least = least.unwrap_or_else(|| {
        let mut bends: Vec<f64> = inner.clone().map(bend).collect();
        SCATTERS * DEVIATIONS_PER_MEDIAN * median(&mut bends)
    });
    if least <= 0.0 {
        return Vec::new();
    }
    // Where nothing bends nothing is off: most samples are done with at once.
    let mut suspect = vec![false; range.len()];
    for k in inner {
        if bend(k) > 0.5 * least {
            let from = k.saturating_sub(NEIGHBOURS).max(range.start) - range.start;
            let to = (k + NEIGHBOURS + 1).min(range.end) - range.start;
            suspect[from..to].fill(true);
        }
    }
    let mut window = Vec::with_capacity((2 * NEIGHBOURS + 1) * NEIGHBOURS);
    let mut off = Vec::new();
    for k in range.clone().filter(|k| suspect[k - range.start]) {
        let from = k.saturating_sub(NEIGHBOURS).max(range.start);
        let to = (k + NEIGHBOURS + 1).min(range.end);
        // The median over all pairs: that over neighbours alone would be a whole number, in a column of whole counts.
        window.clear();
        window.extend((from + 1..to).flat_map(|j| (from..j).map(move |i| (values[j] - values[i]) / (j - i) as f64)));
        let slope = median(&mut window);
        window.clear();
        window.extend((from..to).map(|i| values[i] - slope * (i as f64 - k as f64)));
        let level = median(&mut window);
        window.iter_mut().for_each(|value| *value = (*value - level).abs());
        let scatter = DEVIATIONS_PER_MEDIAN * median(&mut window);
        if (values[k] - level).abs() > least.max(SCATTERS * scatter) {
            off.push(k);
        }
    }
    off
}

/// Lays a straight line over the samples `off`, within their contiguous range.
fn bridge(values: &mut [f64], ranges: &[Range<usize>], off: &[usize]) {
    for range in ranges {
        let off: Vec<usize> = off.iter().copied().filter(|k| range.contains(k)).collect();
        let sound = |k: &usize| off.binary_search(k).is_err();
        for &k in &off {
            let before = (range.start..k).rev().find(&sound);
            let after = (k + 1..range.end).find(&sound);
            values[k] = match (before, after) {
                (Some(before), Some(after)) => {
                    let share = (k - before) as f64 / (after - before) as f64;
                    // Whole counts stay whole.
                    let between = values[before] + share * (values[after] - values[before]);
                    if values[before].fract() == 0.0 && values[after].fract() == 0.0 {
                        between.round()
                    } else {
                        between
                    }
                }
                (Some(near), None) | (None, Some(near)) => values[near],
                (None, None) => values[k],
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rounded fast movement with ringing: nothing in it is off, and everything put into it is found.
    #[test]
    fn finds_what_was_put_in_and_nothing_else() {
        let course = |k: usize| {
            let t = k as f64 * 0.7e-3;
            (8000.0 * (1.7 * t).cos() + 8.0 * (75.0 * t).sin()).trunc()
        };
        let clean: Vec<f64> = (0..5000).map(course).collect();
        assert!(spikes(&clean, &(0..5000), Some(LEAST_COUNTS)).is_empty());
        let mut spoilt = clean.clone();
        let put_in = [0, 700, 1500, 1501, 1502, 2600, 4999];
        for (index, &k) in put_in.iter().enumerate() {
            spoilt[k] += if index % 2 == 0 { 9.0 } else { -1024.0 };
        }
        assert_eq!(spikes(&spoilt, &(0..5000), Some(LEAST_COUNTS)), put_in);
        bridge(&mut spoilt, std::slice::from_ref(&(0..5000)), &put_in);
        for k in put_in {
            assert!((spoilt[k] - clean[k]).abs() <= 12.0, "sample {k}: {} for {}", spoilt[k], clean[k]);
        }
    }

    /// A motor that runs into a stop bends sharply, but is not off.
    #[test]
    fn a_kink_is_no_spike() {
        let values: Vec<f64> = (0..400).map(|k| f64::from(k.min(200)) * 14.0).collect();
        assert!(spikes(&values, &(0..400), Some(LEAST_COUNTS)).is_empty());
    }
}
