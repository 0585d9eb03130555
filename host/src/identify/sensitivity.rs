//! Exact sensitivities: the plant on dual numbers whose lanes differentiate by one parameter each.

use fearless_simd::Simd;
use rayon::prelude::*;
use shared::dual::Dual;
use shared::plant::Plant;

use super::experiment::{Experiment, Fineness, Segment};
use super::parameters::{Parameter, Values};
use super::simulation::Simulation;
use crate::lanes::{Lanes, on_vectors};

/// Which residual of the model is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Residual {
    /// Recorded minus modelled tracking error under the robot's own loop.
    ClosedLoop(Fineness),
    /// What the model did not foresee under the recorded command.
    Innovations,
}

/// One value per sample, for each segment and joint.
pub type Columns = Vec<[Vec<f64>; 2]>;

/// Vectors per operation. With the widest instructions, two hold the usual thirteen parameters at once.
const GROUPS: usize = 2;

/// A parameter in each lane, as many as this machine's registers hold: more would make the code for narrow ones many
/// times larger and no faster.
type Wide<S> = Lanes<S, <S as Simd>::f64s, GROUPS>;

fn lanes<S: Simd>(_: S) -> usize {
    Wide::<S>::COUNT
}

impl Experiment<'_> {
    /// The residual in counts at `values`.
    pub fn residual(&self, values: &Values, which: Residual) -> Columns {
        match which {
            Residual::ClosedLoop(fineness) => self.closed_loop_differences(values, fineness),
            Residual::Innovations => self.innovations(values),
        }
    }

    /// The derivative of [`Experiment::residual`] by each parameter of `free`, in counts per unit of the parameter.
    pub fn sensitivities(&self, values: &Values, free: &[Parameter], which: Residual) -> Vec<Columns> {
        free.chunks(on_vectors!(machine => lanes(machine)))
            .flat_map(|free| {
                let of_segment =
                    |segment: &Segment| on_vectors!(machine => on_lanes(machine, self, segment, values, free, which));
                let by_segment: Vec<Vec<[Vec<f64>; 2]>> = self.segments.par_iter().map(of_segment).collect();
                by_parameter(by_segment, free.len())
            })
            .collect()
    }
}

fn by_parameter(by_segment: Vec<Vec<[Vec<f64>; 2]>>, parameters: usize) -> Vec<Columns> {
    let mut columns: Vec<Columns> = (0..parameters).map(|_| Vec::with_capacity(by_segment.len())).collect();
    for segment in by_segment {
        for (of_parameter, column) in columns.iter_mut().zip(segment) {
            of_parameter.push(column);
        }
    }
    columns
}

#[inline(always)]
fn on_lanes<S: Simd>(
    machine: S,
    experiment: &Experiment,
    segment: &Segment,
    values: &Values,
    free: &[Parameter],
    which: Residual,
) -> Vec<[Vec<f64>; 2]> {
    // Every constant of a plant is a parameter or does not depend on any: its derivative is 1 or 0.
    let plant = values.plant(experiment.robot);
    let at = |parameter: &Parameter, value: f64| values.with(&[*parameter], &[value]).plant(experiment.robot);
    let ends: Vec<[Plant<f64>; 2]> = free.iter().map(|parameter| [at(parameter, 0.0), at(parameter, 1.0)]).collect();
    let number = |constant: &dyn Fn(&Plant<f64>) -> f64| Dual {
        value: Wide::<S>::splat(machine, constant(&plant)),
        slope: Wide::from_fn(machine, |lane| ends.get(lane).map_or(0.0, |[zero, one]| constant(one) - constant(zero))),
    };
    // A lead is no constant of the plant, but of the law that drives it.
    let leads = [0, 1].map(|joint: usize| {
        values.lead[joint].map(|lead| Dual {
            value: Wide::<S>::splat(machine, lead),
            slope: Wide::from_fn(machine, |lane| f64::from(u8::from(free.get(lane) == Some(&Parameter::Lead(joint))))),
        })
    });
    let simulation = Simulation { experiment, plant: Plant::from_constants(number) };
    let samples = segment.error_counts.len();
    let mut columns: Vec<[Vec<f64>; 2]> =
        free.iter().map(|_| [Vec::with_capacity(samples), Vec::with_capacity(samples)]).collect();
    let mut push = |residual: [Dual<Wide<S>>; 2]| {
        for (lane, column) in columns.iter_mut().enumerate() {
            column[0].push(residual[0].slope.get(lane));
            column[1].push(residual[1].slope.get(lane));
        }
    };
    match which {
        Residual::ClosedLoop(fineness) => {
            let settings = experiment.settings(experiment.closed_loop_substeps(fineness));
            simulation.closed_loop_led(segment, &settings, &leads, |_, _, difference| push(difference));
        }
        Residual::Innovations => {
            let settings = experiment.settings(experiment.innovation_substeps);
            simulation.innovations_led(segment, &settings, &leads, |_, innovation| push(innovation));
        }
    }
    columns
}
