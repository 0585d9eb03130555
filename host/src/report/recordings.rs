//! Recordings: what was measured, and how a model repeats it.

use super::page::Section;
use super::picture::{Ink, Line, Picture, staircase, thinned};
use super::table::{Cell, Table};
use crate::capture::{efforts, tracking_quality};
use crate::identify::{Experiment, Fineness, Values};
use crate::recording::Recording;
use crate::robot::Robot;

/// How far a picture of tracking errors shows at least, counts: twice the goal.
const LEAST_EXTENT_COUNTS: f64 = 2.0;

/// Seconds from the start of the recording to each of its stretches without a gap, with the samples of each.
fn stretches(recording: &Recording, robot: &Robot) -> Vec<(f64, std::ops::Range<usize>)> {
    let mut stretches = Vec::new();
    let mut from = 0;
    for k in 1..=recording.tick.len() {
        if k == recording.tick.len() || recording.tick[k] != recording.tick[k - 1].wrapping_add(1) {
            stretches.push((f64::from(recording.tick[from]) * robot.record_period_s, from..k));
            from = k;
        }
    }
    stretches
}

/// Lines of one column over time, one a stretch without a gap.
fn over_time(recording: &Recording, robot: &Robot, column: &[f64], name: &str, ink: Ink) -> Vec<Line> {
    let line = |(start_s, range): (f64, std::ops::Range<usize>)| {
        let points = staircase(&column[range], robot.record_period_s);
        Line::new(name, ink, thinned(points.into_iter().map(|(time_s, value)| (start_s + time_s, value)).collect()))
    };
    stretches(recording, robot).into_iter().map(line).collect()
}

/// The bounds of the paper's goal, ±1 count, over `duration_s`.
fn one_count(duration_s: f64) -> [Line; 2] {
    let bound = |counts: f64| Line::new("±1 count", Ink::Left, vec![(0.0, counts), (duration_s, counts)]);
    [bound(-1.0), bound(1.0)]
}

fn duration_s(recording: &Recording, robot: &Robot) -> f64 {
    f64::from(recording.tick.last().copied().unwrap_or(0)) * robot.record_period_s
}

/// Tracking errors of movements under the controllers named, one picture a joint and movement, with the paper's goal.
pub fn tracking_pictures(robot: &Robot, runs: &[(&Recording, &str)]) -> Vec<Picture> {
    let mut pictures = Vec::new();
    for (index, joint) in robot.joints.iter().enumerate() {
        for (recording, controller) in runs {
            let mut lines = one_count(duration_s(recording, robot)).to_vec();
            lines.extend(over_time(recording, robot, &recording.error_counts[index], "tracking error", Ink::Measured));
            let title = format!("joint {}, {controller}", joint.name);
            pictures.push(Picture::lines(title, ["time, s", "error, counts"], lines).symmetric(LEAST_EXTENT_COUNTS));
        }
    }
    pictures
}

/// Tracking errors of recordings, one picture a joint.
pub fn measured(robot: &Robot, recordings: &[Recording]) -> Section {
    let runs: Vec<(&Recording, String)> =
        recordings.iter().map(|recording| (recording, recording.path.display().to_string())).collect();
    let runs: Vec<(&Recording, &str)> = runs.iter().map(|(recording, name)| (*recording, name.as_str())).collect();
    Section::new("Tracking errors").table(quality(robot, &runs)).pictures(tracking_pictures(robot, &runs))
}

/// How well each movement was tracked, and what it took.
pub fn quality(robot: &Robot, runs: &[(&Recording, &str)]) -> Table {
    let mut table = Table::new([
        "movement",
        "joint",
        "largest error, counts",
        "rms error, counts",
        "samples within ±1 count, %",
        "torque rms, N m",
        "in limits, s",
    ]);
    for (recording, name) in runs {
        let efforts = efforts(recording, robot);
        for (index, (joint, quality)) in robot.joints.iter().zip(tracking_quality(recording)).enumerate() {
            let effort = efforts.get(index);
            table = table.row([
                Cell::from(*name),
                Cell::from(joint.name.as_str()),
                Cell::fixed(quality.max_abs_error_counts, 0),
                Cell::fixed(quality.rms_error_counts, 2),
                Cell::fixed(quality.within_one_count_percent, 2),
                Cell::optional(effort.map(|effort| effort.torque_rms_nm), |torque| Cell::fixed(torque, 4)),
                Cell::optional(effort.map(|effort| effort.time_in_limits_s), |time_s| Cell::fixed(time_s, 3)),
            ]);
        }
    }
    table
}

/// Currents measured, and commanded where that was recorded.
pub fn currents(robot: &Robot, recordings: &[Recording]) -> Section {
    let mut pictures = Vec::new();
    for recording in recordings {
        for (index, joint) in robot.joints.iter().enumerate() {
            let mut lines = over_time(recording, robot, &recording.current_a[index], "measured", Ink::Measured);
            if let Some(commands) = &recording.command_a {
                lines.extend(over_time(recording, robot, &commands[index], "commanded", Ink::Simulated));
            }
            let title = format!("joint {}, {}", joint.name, recording.path.display());
            pictures.push(Picture::lines(title, ["time, s", current_unit(robot)], lines));
        }
    }
    Section::new("Currents").pictures(pictures)
}

fn current_unit(robot: &Robot) -> &'static str {
    if robot.current_is_command { "command" } else { "current, A" }
}

/// Tracking errors and currents measured under computed torque, beside those of the same movements made once more.
pub fn made_again(robot: &Robot, pairs: &[(&Recording, Recording)]) -> [Section; 2] {
    let mut table = Table::new([
        "recording",
        "joint",
        "measured, counts rms",
        "simulated, counts rms",
        "largest measured, counts",
        "largest simulated, counts",
        "measured within ±1 count, %",
        "simulated within ±1 count, %",
    ]);
    let (mut errors, mut currents) = (Vec::new(), Vec::new());
    for (measured, simulated) in pairs {
        let qualities = tracking_quality(measured).into_iter().zip(tracking_quality(simulated));
        for (index, (joint, (of_measured, of_simulated))) in robot.joints.iter().zip(qualities).enumerate() {
            let name = measured.path.display().to_string();
            let both = [of_measured, of_simulated];
            let cells = [
                both.map(|quality| Cell::fixed(quality.rms_error_counts, 3)),
                both.map(|quality| Cell::fixed(quality.max_abs_error_counts, 0)),
                both.map(|quality| Cell::fixed(quality.within_one_count_percent, 2)),
            ];
            let names = [Cell::from(name.as_str()), Cell::from(joint.name.as_str())];
            table = table.row(names.into_iter().chain(cells.into_iter().flatten()));
            let picture = |axis: &str, column: fn(&Recording) -> &Vec<Vec<f64>>| {
                let of = |recording: &Recording, name: &str, ink: Ink| {
                    over_time(recording, robot, &column(recording)[index], name, ink)
                };
                let mut lines = of(measured, "measured", Ink::Measured);
                lines.extend(of(simulated, "simulated", Ink::Simulated));
                Picture::lines(format!("joint {}, {name}", joint.name), ["time, s", axis], lines)
            };
            let of_error = picture("error, counts", |recording| &recording.error_counts);
            errors.push(of_error.symmetric(LEAST_EXTENT_COUNTS));
            currents.push(picture(current_unit(robot), |recording| &recording.current_a));
        }
    }
    let errors = Section::new("Computed torque, measured and simulated")
        .text(
            "The model's arm, with the effects that the model has, makes the same movement under computed torque on a \
             simulated board. Errors are those recorded, whole counts, and of the same size rather than the same sample by \
             sample: how the counts round is chance. A load in the gripper is not simulated.",
        )
        .table(table)
        .pictures(errors);
    [errors, Section::new("Currents under computed torque").pictures(currents)]
}

/// Tracking errors and currents measured, those of a simulated arm under the same position loop, and their difference.
pub fn repeated(experiment: &Experiment, values: &Values, recordings: &[Recording]) -> [Section; 2] {
    let robot = experiment.robot;
    let mut table = Table::new([
        "recording",
        "joint",
        "measured, counts rms",
        "simulated, counts rms",
        "difference, counts rms",
        "largest difference, counts",
    ]);
    let (mut errors, mut currents) = (Vec::new(), Vec::new());
    for segment in &experiment.segments {
        let ticks = experiment.closed_loop(values, segment, Fineness::Fine);
        let name = recordings[segment.recording].path.display().to_string();
        for (index, joint) in robot.joints.iter().enumerate() {
            let over_time = |name: &str, ink: Ink, values: &[f64]| {
                let points = values.iter().enumerate();
                let at = |k: usize| segment.start_s + k as f64 * robot.record_period_s;
                Line::new(name, ink, thinned(points.map(|(k, &value)| (at(k), value)).collect()))
            };
            let measured: Vec<f64> = segment.error_counts.iter().map(|pair| pair[index]).collect();
            let simulated: Vec<f64> = ticks.iter().map(|tick| tick.error_counts[index]).collect();
            let difference: Vec<f64> = measured.iter().zip(&simulated).map(|(m, s)| m - s).collect();
            let largest = difference.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            let rms = |values: &[f64]| {
                (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
            };
            let cells = [&measured, &simulated, &difference].map(|values| Cell::fixed(rms(values), 3));
            let names = [Cell::from(name.as_str()), Cell::from(joint.name.as_str())];
            table = table.row(names.into_iter().chain(cells).chain([Cell::fixed(largest, 2)]));
            let both = vec![
                over_time("measured", Ink::Measured, &measured),
                over_time("simulated", Ink::Simulated, &simulated),
            ];
            let axes = ["time, s", "error, counts"];
            errors.push(
                Picture::lines(format!("joint {}, {name}", joint.name), axes, both).symmetric(LEAST_EXTENT_COUNTS),
            );
            let left = vec![over_time("measured less simulated", Ink::Left, &difference)];
            let axes = ["time, s", "difference, counts"];
            errors.push(Picture::lines(format!("joint {}, {name}: difference", joint.name), axes, left).symmetric(1.0));
            let measured_a: Vec<f64> = segment.current_a.iter().map(|pair| pair[index]).collect();
            let simulated_a: Vec<f64> = ticks.iter().map(|tick| tick.command_a[index]).collect();
            let both = vec![
                over_time("measured", Ink::Measured, &measured_a),
                over_time("simulated", Ink::Simulated, &simulated_a),
            ];
            let axes = ["time, s", current_unit(robot)];
            currents.push(Picture::lines(format!("joint {}, {name}", joint.name), axes, both));
        }
    }
    let errors = Section::new("Tracking errors, measured and simulated")
        .text(
            "The model's arm follows the recorded reference under the same position loop; nothing of the measured motion \
             but its start enters the simulation.",
        )
        .table(table)
        .pictures(errors);
    let currents = Section::new("Currents, measured and simulated")
        .text("The measured current shows the command of the tick before; the simulated one is the model's command.")
        .pictures(currents);
    [errors, currents]
}
