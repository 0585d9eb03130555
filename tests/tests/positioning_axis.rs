//! `identify` on the real positioning axis (EMPS) that lies beside a checkout of the project, against another program's
//! fit of the same structure to the same recording; skipped, and saying so, without the recording.

use std::path::Path;

use armid::identify::{Options, Parameter, identify};
use armid::recording::{ReadOptions, Recording};
use armid::robot::{Law, Robot};
use nalgebra::{DMatrix, DVector};

/// The published structure: a mass with viscous and Coulomb friction and a constant force.
#[derive(Clone, Copy, Debug)]
struct Axis {
    mass_kg: f64,
    viscous_n_s_per_m: f64,
    coulomb_n: f64,
    /// Force that the drive has to overcome at rest.
    offset_n: f64,
}

impl Axis {
    fn parameters(&self) -> [f64; 4] {
        [self.mass_kg, self.viscous_n_s_per_m, self.coulomb_n, self.offset_n]
    }

    fn of([mass_kg, viscous_n_s_per_m, coulomb_n, offset_n]: [f64; 4]) -> Self {
        Self { mass_kg, viscous_n_s_per_m, coulomb_n, offset_n }
    }
}

/// Steps per sample: Euler's method below errs by half a step.
const STEPS: usize = 200;

/// Samples at the beginning that carry the unknown start.
const UNSETTLED: usize = 200;

/// What the axis was recorded under, and what was recorded, in SI units.
struct Recorded {
    position_gain_per_s: f64,
    velocity_gain_v_s_per_m: f64,
    force_per_volt_n: f64,
    period_s: f64,
    reference_m: Vec<f64>,
    position_m: Vec<f64>,
    command_v: Vec<f64>,
}

impl Recorded {
    /// Recorded less simulated force at every settled sample, in N. The simulation has nothing in common with the
    /// library's: Euler steps of 5 µs whose velocity is held where it would change its sign against friction.
    fn force_gap_n(&self, axis: &Axis) -> Vec<f64> {
        let step_s = self.period_s / STEPS as f64;
        let start = &self.position_m[..15];
        // The slope at the first of the samples from a straight line through their differences.
        let slope = |k: usize| (start[k + 1] - start[k]) / self.period_s;
        let mut velocity = slope(0) - (slope(13) - slope(0)) / 13.0 * 0.5;
        let mut position = start[0];
        let mut before = [position - velocity * self.period_s, position - 2.0 * velocity * self.period_s];
        let mut gaps = Vec::with_capacity(self.reference_m.len());
        for (k, reference) in self.reference_m.iter().enumerate() {
            let measured_velocity = (position - before[1]) / (2.0 * self.period_s);
            let command_v =
                self.velocity_gain_v_s_per_m * (self.position_gain_per_s * (reference - position) - measured_velocity);
            before = [position, before[0]];
            if k >= UNSETTLED {
                gaps.push(self.force_per_volt_n * (self.command_v[k] - command_v));
            }
            let drive_n = self.force_per_volt_n * command_v - axis.offset_n;
            for _ in 0..STEPS {
                let free = velocity + step_s * (drive_n - axis.viscous_n_s_per_m * velocity) / axis.mass_kg;
                let lost = step_s * axis.coulomb_n / axis.mass_kg;
                let next = if free.abs() <= lost { 0.0 } else { free - lost * free.signum() };
                position += step_s * 0.5 * (velocity + next);
                velocity = next;
            }
        }
        gaps
    }

    /// The axis with the least force gap, by Gauss and Newton with differences, and its gap in N rms.
    fn reference_fit(&self) -> (Axis, f64) {
        let mut axis = Axis { mass_kg: 90.0, viscous_n_s_per_m: 180.0, coulomb_n: 22.0, offset_n: -3.0 };
        for _ in 0..6 {
            let parameters = axis.parameters();
            let gaps = self.force_gap_n(&axis);
            let slopes: Vec<Vec<f64>> = (0..4)
                .map(|index| {
                    let step = 1e-4 * parameters[index];
                    let mut moved = parameters;
                    moved[index] += step;
                    let moved = self.force_gap_n(&Axis::of(moved));
                    moved.iter().zip(&gaps).map(|(moved, gap)| (moved - gap) / step).collect()
                })
                .collect();
            let jacobian = DMatrix::from_fn(gaps.len(), 4, |row, column| slopes[column][row]);
            let right = jacobian.transpose() * DVector::from_column_slice(&gaps);
            let step = (jacobian.transpose() * &jacobian).lu().solve(&right).expect("a determined axis");
            axis = Axis::of(std::array::from_fn(|index| parameters[index] - step[index]));
        }
        let gaps = self.force_gap_n(&axis);
        (axis, (gaps.iter().map(|gap| gap * gap).sum::<f64>() / gaps.len() as f64).sqrt())
    }
}

/// Every parameter within 1 % of the reference fit; a force gap as small as that structure can have. That the gap cannot
/// be below 2.44 N with it is the reference fit's finding as well.
#[test]
fn a_real_axis_is_identified_as_an_independent_fit_has_it() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/emps");
    if !folder.is_dir() {
        println!("skipped: {} is not there", folder.display());
        return;
    }
    let robot = Robot::read(&folder.join("robot.toml")).expect("a robot file");
    let recording = Recording::read(&folder.join("identification.csv"), &robot, ReadOptions::default())
        .expect("a recording of the axis");
    let joint = &robot.joints[0];
    let Law::Cascade { position_gain_per_s, velocity_gain } = joint.law else { panic!("a cascade") };
    let counts_per_m = joint.gear_ratio * joint.counts_per_rev / std::f64::consts::TAU;
    let (reference, error) = (&recording.reference_counts[0], &recording.error_counts[0]);
    let recorded = Recorded {
        position_gain_per_s,
        velocity_gain_v_s_per_m: velocity_gain,
        force_per_volt_n: joint.torque_constant_nm_per_a,
        period_s: robot.record_period_s,
        reference_m: reference.iter().map(|counts| counts / counts_per_m).collect(),
        position_m: reference.iter().zip(error).map(|(reference, error)| (reference - error) / counts_per_m).collect(),
        command_v: recording.current_a[0].clone(),
    };
    let (axis, least_gap_n) = recorded.reference_fit();

    let found = identify(&robot, &[recording], &[], &Options::default(), &|_| ()).expect("an identification");
    let gap_n = found.force_gap_rms.as_ref().expect("the command is recorded")[0];
    println!("{axis:?}, {least_gap_n:.4} N rms; armid {gap_n:.4} N rms");
    let parameters = [Parameter::F(6), Parameter::Viscous(0), Parameter::Coulomb(0), Parameter::TorqueOffset(0)];
    for (parameter, reference) in parameters.into_iter().zip(axis.parameters()) {
        let value = found.values.get(parameter);
        println!("{parameter:?}: {value:.4} for {reference:.4}, {:.2} % apart", 100.0 * (value / reference - 1.0));
        assert!((value / reference - 1.0).abs() < 0.01, "{parameter:?}: {value} for {reference}");
    }
    assert!(gap_n < 1.002 * least_gap_n && gap_n <= 2.45, "{gap_n} for {least_gap_n}");
}
