//! A recording as CSV in SI units.

use super::Series;
use crate::recording::Recording;
use crate::robot::Robot;

/// `recording` as CSV: a header of names that end in their unit, `time_s` first and then `joint_NAME_QUANTITY`, and one
/// row a sample.
pub fn recording_csv(recording: &Recording, robot: &Robot) -> String {
    let series = Series::of(recording, robot);
    let name = |column: &super::Column| format!("joint_{}_{}", series.joints[column.joint], column.quantity);
    let header: Vec<String> = std::iter::once("time_s".into()).chain(series.columns.iter().map(name)).collect();
    let mut text = header.join(",");
    text.push('\n');
    for sample in 0..series.time_ns.len() {
        text.push_str(&series.time_s(sample).to_string());
        for column in &series.columns {
            text.push(',');
            text.push_str(&column.values[sample].to_string());
        }
        text.push('\n');
    }
    text
}
