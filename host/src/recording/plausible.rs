//! Whether a recording's current can come from its error under the robot's position loop.
//!
//! Only what cannot be an ordinary wrong gain is refused here: a current that runs against its error, and joints that
//! each fit the other's gain. A gain that is merely off, and a current that shows nothing, are told: `calibrate` sorts
//! them out, but an identification would take the wrong gain for right.

use super::Recording;
use crate::file_error::{FileError, Problem};
use crate::robot::Robot;

/// Below this many counts (rms) the error hardly moves and the current is mostly noise: nothing can be told.
const LEAST_ERROR_VARIATION_COUNTS: f64 = 5.0;
/// Anti-correlation beyond this cannot be noise or a little delay.
const AGAINST: f64 = -0.5;
/// A current that follows its law correlates at least this well with it.
const FOLLOWS: f64 = 0.95;
/// A gain this share away from the law's is another gain, or a current in another unit.
const GAIN_OFF_SHARE: f64 = 0.05;

/// What is doubtful about the recording's current, in words; an error where it cannot be this robot's.
pub(super) fn check(recording: &Recording, robot: &Robot) -> Result<Vec<String>, FileError> {
    let mut doubts = Vec::new();
    let Some(loops) = recording.position_loops(robot) else { return Ok(doubts) };
    // The measured current shows the command of the loop's tick before; in a faster loop that is no recorded sample, and
    // the one at the same instant is nearest.
    let lag = usize::from(!robot.current_is_command && robot.loop_ticks_per_record() == 1);
    // The gain each joint's current shows, in units of the gain it should have; nothing where it cannot be told.
    let mut apparent_gain = Vec::new();
    for (joint, position_loop) in loops.iter().enumerate() {
        let error = &recording.error_counts[joint];
        let commanded: Vec<f64> =
            (1..error.len()).map(|tick| position_loop.command_a(error[tick], error[tick - 1])).collect();
        let measured = &recording.current_a[joint][1..];
        // cur[k] shows the command computed from err[k − lag].
        let pairs = commanded.iter().zip(&measured[lag.min(measured.len())..]);
        let statistics = correlate(pairs, robot.joints[joint].current_limit_a);
        let gain = position_loop.gain_a_per_count;
        let moves = statistics.deviation_x > LEAST_ERROR_VARIATION_COUNTS * gain;
        if moves && statistics.correlation < AGAINST {
            let name = &robot.joints[joint].name;
            return Err(FileError {
                path: recording.path.clone(),
                line: None,
                problem: Problem::CurrentAgainstError {
                    current: format!("cur{name}"),
                    error: format!("err{name}"),
                    correlation: statistics.correlation,
                },
                remedy: "check the columns' order, the wiring of the current sensor and err = reference − actual"
                    .into(),
            });
        }
        let told = moves && statistics.correlation > FOLLOWS;
        apparent_gain.push(told.then_some(statistics.slope * gain));
        let name = &robot.joints[joint].name;
        if told && (statistics.slope - 1.0).abs() > GAIN_OFF_SHARE {
            doubts.push(format!(
                "cur{name} over err{name} is {:.4} A/count, but the gain in force is given as {gain:.4}: with a wrong \
                 gain every f and the friction are wrong by as much; check the unit (ampere) and run armid calibrate",
                statistics.slope * gain
            ));
        } else if moves && !told {
            doubts.push(format!(
                "cur{name} does not follow err{name} (correlation {:.2}, expected above {FOLLOWS}): the gain cannot be \
                 checked by it; check the columns' order and the current sensor",
                statistics.correlation
            ));
        }
    }
    let [first, second] = loops.as_slice() else { return Ok(doubts) };
    let (Some(Some(found_first)), Some(Some(found_second))) = (apparent_gain.first(), apparent_gain.get(1)) else {
        return Ok(doubts);
    };
    let near = |found: f64, gain: f64| (found / gain - 1.0).abs() < 0.05;
    let apart = (first.gain_a_per_count / second.gain_a_per_count - 1.0).abs() > 0.15;
    if apart && near(*found_first, second.gain_a_per_count) && near(*found_second, first.gain_a_per_count) {
        let [a, b] = [&robot.joints[0].name, &robot.joints[1].name];
        let evidence = format!(
            "current over error is {found_first:.4} A/count in the columns of joint {a} and {found_second:.4} in those \
             of joint {b}, but the gains are {:.4} and {:.4}",
            first.gain_a_per_count, second.gain_a_per_count
        );
        return Err(FileError {
            path: recording.path.clone(),
            line: None,
            problem: Problem::SwappedJoints { evidence },
            remedy: "exchange the joints' columns, or the gains if the robot file has them the wrong way round".into(),
        });
    }
    Ok(doubts)
}

struct Correlation {
    deviation_x: f64,
    slope: f64,
    correlation: f64,
}

/// Straight-line statistics of measured over commanded current, saturated samples left out.
fn correlate<'a>(pairs: impl Iterator<Item = (&'a f64, &'a f64)> + Clone, limit_a: f64) -> Correlation {
    let kept = pairs.filter(|(commanded, _)| commanded.abs() < 0.98 * limit_a);
    let (mut n, mut sum_x, mut sum_y) = (0.0, 0.0, 0.0);
    for (x, y) in kept.clone() {
        n += 1.0;
        sum_x += x;
        sum_y += y;
    }
    let n = f64::max(n, 1.0);
    let (mean_x, mean_y) = (sum_x / n, sum_y / n);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in kept {
        xx += (x - mean_x) * (x - mean_x);
        xy += (x - mean_x) * (y - mean_y);
        yy += (y - mean_y) * (y - mean_y);
    }
    // The smallest positive number keeps a constant column from dividing by zero: its correlation becomes 0.
    let tiny = f64::MIN_POSITIVE;
    Correlation { deviation_x: (xx / n).sqrt(), slope: xy / xx.max(tiny), correlation: xy / (xx * yy).sqrt().max(tiny) }
}
