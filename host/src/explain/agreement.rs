//! Whether recordings that no one model explains are each explained by a model of their own: then they are not of the
//! same robot in the same state.

use super::engine::{Engine, Free};
use super::fit::Setting;
use super::hypothesis::{Baseline, Hypothesis};
use super::noise::Noise;
use super::rows::Rows;
use super::verdict::CLOSED;
use crate::identify::Experiment;
use crate::recording::Recording;
use crate::robot::Robot;

/// Iterations of each refit: another robot may be a long way off.
const ITERATIONS: usize = 8;

/// Whether base parameters of its own, found without regard to the baseline's standard errors, bring each of the
/// recordings to the `floor` in counts rms. `false` for a single recording, which has nothing to disagree with.
pub fn only_each_by_itself(
    robot: &Robot,
    recordings: &[&Recording],
    baseline: &Baseline,
    noise: &Noise,
    floor: f64,
) -> bool {
    let anything = vec![f64::INFINITY; baseline.free.len()];
    let baseline = Baseline { standard_error: anything, ..baseline.clone() };
    let start = Hypothesis::baseline(&baseline, &[]);
    let explained = |recording: &&Recording| {
        let Ok(experiment) = Experiment::new(robot, std::slice::from_ref(*recording)) else { return false };
        let rows = Rows::new(&experiment);
        let setting = Setting { experiment: &experiment, rows: &rows, current_sigma_a: None };
        let engine = Engine::new(setting, &baseline);
        let fitted = engine.refit(&start, &engine.weights(noise), &[], Free::All, ITERATIONS);
        fitted.is_some_and(|fitted| engine.gap(&engine.innovations(&fitted.hypothesis)) <= CLOSED * floor)
    };
    recordings.len() > 1 && recordings.iter().all(explained)
}
