//! Residual maps: the torque a model lacks, over where the joint was, how fast it moved, and when.

use super::page::Section;
use super::picture::{Band, Content, Ink, Line, Map, Picture, thinned};
use super::table::{Cell, Table};
use crate::explain::trace::{Trace, residual_torque, traces};
use crate::identify::{Columns, Experiment, Values};
use crate::robot::{Robot, Unit};

/// Cells of a map along and upward, and of a curve.
const CELLS: usize = 24;
/// A cell with fewer samples says nothing.
const LEAST_SAMPLES: f64 = 6.0;
/// Neighbouring samples share the low-pass of 25 Hz: one in so many counts as independent, at 0.7 ms.
const SHARED_SAMPLES: f64 = 28.0;

/// Count, sum and sum of squares of what falls into a cell.
#[derive(Clone, Copy, Default)]
struct Sum([f64; 3]);

impl Sum {
    fn add(&mut self, value: f64) {
        self.0[0] += 1.0;
        self.0[1] += value;
        self.0[2] += value * value;
    }

    /// The mean, and half its 95 % interval.
    fn mean(&self) -> Option<[f64; 2]> {
        let [count, sum, squares] = self.0;
        (count >= LEAST_SAMPLES).then(|| {
            let mean = sum / count;
            let variance = (squares / count - mean * mean).max(0.0);
            [mean, 1.96 * (variance / (count / SHARED_SAMPLES).max(1.0)).sqrt()]
        })
    }
}

/// Where a value is in a range, as a cell.
fn cell([low, high]: [f64; 2], value: f64) -> usize {
    (((value - low) / (high - low) * CELLS as f64) as usize).min(CELLS - 1)
}

/// One joint's samples: angle, speed, time, torque the model lacks.
struct Samples<'a> {
    robot: &'a Robot,
    joint: usize,
    of: Vec<[f64; 4]>,
    /// Where each recording's stretch begins among them.
    starts: Vec<usize>,
}

impl<'a> Samples<'a> {
    fn new(experiment: &'a Experiment, traces: &[Trace], torque: &Columns, joint: usize) -> Self {
        let (mut of, mut starts) = (Vec::new(), Vec::new());
        for (index, segment) in experiment.segments.iter().enumerate() {
            starts.push(of.len());
            let (trace, torque) = (&traces[index], &torque[index][joint]);
            for k in experiment.settled(segment) {
                let time_s = segment.start_s + trace.time_s[k];
                of.push([trace.position_rad[joint][k], trace.velocity_rad_s[joint][k], time_s, torque[k]]);
            }
        }
        of.retain(|sample| sample.iter().all(|value| value.is_finite()));
        Self { robot: experiment.robot, joint, of, starts }
    }

    fn name(&self) -> &str {
        &self.robot.joints[self.joint].name
    }

    fn range(&self, of: usize) -> Option<[f64; 2]> {
        let values = || self.of.iter().map(|sample| sample[of]);
        let range = [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)];
        (range[0] < range[1]).then_some(range)
    }

    /// What angles and speeds are measured in.
    fn units(&self) -> [&'static str; 2] {
        match self.robot.unit {
            Unit::Radian => ["angle, rad", "speed, rad/s"],
            Unit::Metre => ["position, m", "speed, m/s"],
        }
    }

    fn torque_unit(&self) -> &'static str {
        match self.robot.unit {
            Unit::Radian => "N m at the motor",
            Unit::Metre => "N",
        }
    }

    fn map(&self) -> Option<Picture> {
        let (x, y) = (self.range(0)?, self.range(1)?);
        let mut sums = vec![vec![Sum::default(); CELLS]; CELLS];
        for &[position, speed, _, torque] in &self.of {
            sums[cell(y, speed)][cell(x, position)].add(torque);
        }
        let cells = sums.iter().map(|row| row.iter().map(|sum| sum.mean().map(|[mean, _]| mean)).collect()).collect();
        let map = Map { x, y, cells };
        let note = format!(
            "Blue: the robot's motor gives more than the model says; orange: less. Full colour is {:.2e} {}.",
            map.largest(),
            self.torque_unit()
        );
        let title = format!("joint {}: mean residual over position and speed", self.name());
        Some(Picture::of(title, self.units(), Content::Map(map)).note(note))
    }

    /// Mean and 95 % band over quantity `of`.
    fn curve(&self, of: usize, over: &str) -> Option<Picture> {
        let range = self.range(of)?;
        let mut sums = [Sum::default(); CELLS];
        for sample in &self.of {
            sums[cell(range, sample[of])].add(sample[3]);
        }
        let middle = |index: usize| range[0] + (index as f64 + 0.5) / CELLS as f64 * (range[1] - range[0]);
        let points: Vec<[f64; 3]> =
            (0..CELLS).filter_map(|index| sums[index].mean().map(|[mean, half]| [middle(index), mean, half])).collect();
        let band = points.iter().map(|[x, mean, half]| [*x, mean - half, mean + half]).collect();
        let content = Content::Lines(
            vec![Band { name: "95 % interval".into(), ink: Ink::Measured, points: band }],
            vec![Line::new("mean", Ink::Measured, points.iter().map(|point| (point[0], point[1])).collect())],
        );
        let title = format!("joint {}: residual over {over}", self.name());
        Some(Picture::of(title, [self.units()[of], self.torque_unit()], content))
    }

    fn over_time(&self, names: &[String]) -> Picture {
        let ends = self.starts.iter().skip(1).copied().chain([self.of.len()]);
        let line = |((index, start), end): ((usize, &usize), usize)| {
            let points = self.of[(*start).min(end)..end].iter().map(|sample| (sample[2], sample[3])).collect();
            Line::new(names[index].as_str(), Ink::Nth(index), thinned(points))
        };
        let lines = self.starts.iter().enumerate().zip(ends).map(line).collect();
        let title = format!("joint {}: residual over time", self.name());
        Picture::lines(title, ["time, s", self.torque_unit()], lines)
    }

    fn rms(&self) -> f64 {
        (self.of.iter().map(|sample| sample[3] * sample[3]).sum::<f64>() / self.of.len().max(1) as f64).sqrt()
    }
}

/// The torque that the recordings show and the model lacks. `names` are those of the experiment's recordings.
pub fn residual_maps(experiment: &Experiment, values: &Values, names: &[String]) -> Section {
    let traces = traces(experiment);
    let innovations = experiment.innovations(values);
    let torque = residual_torque(experiment, &traces, &values.arm(experiment.robot), &innovations);
    let innovation_rms = experiment.innovation_rms_counts(values);
    let mut table = Table::new(["joint", "innovations, counts rms", "residual torque rms"]);
    let mut pictures = Vec::new();
    let of_segments: Vec<String> = experiment.segments.iter().map(|segment| names[segment.recording].clone()).collect();
    for (joint, named) in experiment.robot.joints.iter().enumerate() {
        let samples = Samples::new(experiment, &traces, &torque, joint);
        table = table.row([
            Cell::from(named.name.as_str()),
            Cell::fixed(innovation_rms[joint], 4),
            Cell::Number { value: samples.rms(), text: format!("{:.2e} {}", samples.rms(), samples.torque_unit()) },
        ]);
        pictures.extend(samples.map());
        pictures.extend(samples.curve(0, "position"));
        pictures.extend(samples.curve(1, "speed"));
        pictures.push(samples.over_time(&of_segments));
    }
    Section::new("Residual maps")
        .text(
            "The torque that the motion shows and the model does not have, from what it did not foresee under the recorded \
             command; low-passed at 25 Hz. What follows position is cogging, springs or gravity, what follows speed is \
             friction, what changes over time is heat or something that happened; an even field is noise.",
        )
        .table(table)
        .pictures(pictures)
}
