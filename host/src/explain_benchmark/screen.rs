//! A rival: the best single regression.
//!
//! Every effect of the library as columns on the residual torque, the base parameters projected out with the
//! baseline's standard errors; the one that lowers the Bayesian information criterion most is named if it does by more
//! than 10. No refit, no null simulations, no second effect.

use std::f64::consts::TAU;
use std::path::Path;
use std::time::Instant;

use nalgebra::{DMatrix, DVector};
use shared::arm::{Arm, Load, PARAMETERS, PUMA_UPPER_ARM_M};

use super::answer::{Answer, Named, Verdict};
use super::case::Case;
use super::residual::{BASE_COLUMNS, Signals, sign, signals};
use crate::file_error::FileError;
use crate::model::Model;
use crate::recording::{ReadOptions, Recording};
use crate::robot::Robot;

/// A name needs to lower the criterion by this.
const LEAST_GAIN: f64 = 10.0;

/// One way an effect may look: columns over all rows.
pub struct Hypothesis {
    /// Effect.
    pub name: &'static str,
    /// Joint index, or nothing for the whole arm.
    pub joint: Option<usize>,
    /// Motor torques, one entry per unit of strength: rows in the order of [`Rows`].
    pub columns: Vec<Vec<f64>>,
    /// Shape constants that were searched over.
    pub shapes: usize,
}

/// The rows of all recordings and joints.
pub struct Rows {
    /// Signals behind the rows, in their order.
    pub signals: Vec<Signals>,
    /// Torque left over in units of Coulomb friction.
    pub left: Vec<f64>,
    /// Columns of the base parameters.
    pub base: Vec<Vec<f64>>,
    /// Standard errors of the base parameters; infinite where none is known.
    pub standard_errors: [f64; BASE_COLUMNS],
    /// Names of the joints.
    pub names: [String; 2],
    gravity_m_s2: f64,
}

impl Rows {
    /// Reads a case's files, its truth excepted.
    ///
    /// # Errors
    /// If one cannot be read.
    pub fn read(case: &Case) -> Result<Option<Self>, FileError> {
        let robot = Robot::read(&case.robot())?;
        let model = case.model.as_deref().map(|path| Model::read(path, &robot)).transpose()?;
        let read = |path: &Path| Recording::read(path, &robot, ReadOptions::default());
        let mut of_all = Vec::new();
        for path in &case.fit {
            let Some(both) = signals(&robot, model.as_ref(), &read(path)?) else { return Ok(None) };
            of_all.extend(both);
        }
        let mut rows = Self {
            left: of_all.iter().flat_map(|signals| signals.rows(&signals.left_nm)).collect(),
            base: Vec::new(),
            standard_errors: model.as_ref().map_or([f64::INFINITY; BASE_COLUMNS], standard_errors),
            names: [0, 1].map(|joint| robot.joints[joint].name.clone()),
            gravity_m_s2: robot.gravity_m_s2,
            signals: of_all,
        };
        rows.base = (0..BASE_COLUMNS).map(|index| rows.column(&|signals| signals.base[index].clone())).collect();
        Ok(Some(rows))
    }

    /// A column from each recording's and joint's signals.
    pub fn column(&self, of: &dyn Fn(&Signals) -> Vec<f64>) -> Vec<f64> {
        self.signals.iter().flat_map(|signals| signals.rows(&of(signals))).collect()
    }

    /// A column of one joint, zero in the rows of the other.
    fn of_joint(&self, joint: usize, of: &dyn Fn(&Signals) -> Vec<f64>) -> Vec<f64> {
        let rows = |signals: &Signals| {
            if signals.joint == joint { signals.rows(&of(signals)) } else { vec![0.0; signals.count()] }
        };
        self.signals.iter().flat_map(rows).collect()
    }

    /// Every hypothesis; `orders` are the cycles per motor turn to try.
    pub fn hypotheses(&self, orders: &[f64]) -> Vec<Hypothesis> {
        let mut all = Vec::new();
        for joint in 0..2 {
            let mut add = |name: &'static str, shapes: usize, columns: &[&dyn Fn(&Signals) -> Vec<f64>]| {
                let columns = columns.iter().map(|of| self.of_joint(joint, of)).collect();
                all.push(Hypothesis { name, joint: Some(joint), columns, shapes });
            };
            let of_speed = |law: &dyn Fn(f64) -> f64, signals: &Signals| -> Vec<f64> {
                signals.speed_rad_s.iter().map(|&speed| law(speed)).collect()
            };
            add("coulomb-friction", 0, &[&|s| of_speed(&sign, s)]);
            add("viscous-friction", 0, &[&|s| of_speed(&|speed| speed, s)]);
            add("asymmetric-friction", 0, &[&|s| of_speed(&|speed| sign(speed).abs(), s)]);
            add("asymmetric-viscous-friction", 0, &[&|s| of_speed(&f64::abs, s)]);
            add("quadratic-friction", 0, &[&|s| of_speed(&|speed| speed * speed.abs(), s)]);
            add("torque-offset", 0, &[&|s| vec![1.0; s.speed_rad_s.len()]]);
            add("back-emf", 0, &[&|s| of_speed(&|speed| speed, s)]);
            for width in [4.0_f64, 8.0, 16.0] {
                let law = move |speed: f64| sign(speed) * (-(speed / width).powi(2)).exp();
                add("stribeck-friction", 1, &[&move |s| of_speed(&law, s)]);
            }
            add("load-dependent-friction", 0, &[&|s| over(s, |s, k| sign(s.speed_rad_s[k]) * s.link_nm[k].abs())]);
            add("friction-drift", 0, &[&|s| over(s, |s, k| sign(s.speed_rad_s[k]) * s.time_s[k])]);
            for half_turns in 3..=12 {
                let order = 0.5 * f64::from(half_turns);
                add(
                    "position-dependent-friction",
                    1,
                    &[&move |s| over(s, |s, k| sign(s.speed_rad_s[k]) * (order * s.joint_rad[k]).cos()), &move |s| {
                        over(s, |s, k| sign(s.speed_rad_s[k]) * (order * s.joint_rad[k]).sin())
                    }],
                );
            }
            add("torque-constant", 0, &[&|s| s.command_a.clone()]);
            add("current-lag", 0, &[&|s| over(s, |s, k| s.command_a[k] - s.command_a[k.saturating_sub(1)])]);
            add("amplifier-dead-zone", 0, &[&|s| over(s, |s, k| sign(s.command_a[k]))]);
            for share in [0.85, 0.9, 0.95] {
                let beyond = move |value: f64, peak: f64| value - value.clamp(-share * peak, share * peak);
                add(
                    "current-saturation",
                    1,
                    &[&move |s| {
                        let peak = largest(&s.command_a);
                        over(s, |s, k| beyond(s.command_a[k], peak))
                    }],
                );
                add(
                    "voltage-saturation",
                    1,
                    &[&move |s| {
                        let volts =
                            over(s, |s, k| 1.6 * s.command_a[k] + s.torque_constant_nm_per_a * s.speed_rad_s[k]);
                        let peak = largest(&volts);
                        volts.iter().map(|&volts| beyond(volts, peak)).collect()
                    }],
                );
            }
            add(
                "gravity-spring",
                0,
                &[&|s| over(s, |s, k| s.joint_rad[k].cos()), &|s| over(s, |s, k| s.joint_rad[k].sin())],
            );
            add("joint-flexibility", 0, &[&|s| s.acceleration_of(&s.link_nm)]);
            add("backlash", 0, &[&|s| s.acceleration_of(&over(s, |s, k| sign(s.link_nm[k])))]);
            for &order in orders {
                let wave = move |s: &Signals, k: usize, quarter: f64| (order * s.motor_rad[k] - quarter).cos();
                let quarter = 0.25 * TAU;
                add(
                    "cogging",
                    1,
                    &[&move |s| over(s, |s, k| wave(s, k, 0.0)), &move |s| over(s, |s, k| wave(s, k, quarter))],
                );
                add(
                    "torque-ripple",
                    1,
                    &[&move |s| over(s, |s, k| s.command_a[k] * wave(s, k, 0.0)), &move |s| {
                        over(s, |s, k| s.command_a[k] * wave(s, k, quarter))
                    }],
                );
                add(
                    "transmission-error",
                    1,
                    &[&move |s| s.acceleration_of(&over(s, |s, k| wave(s, k, 0.0))), &move |s| {
                        s.acceleration_of(&over(s, |s, k| wave(s, k, quarter)))
                    }],
                );
            }
            for step in 2..18 {
                let share = 0.05 * f64::from(step);
                add(
                    "external-contact",
                    2,
                    &[&move |s| {
                        let start_s = share * s.time_s.last().copied().unwrap_or(0.0);
                        over(s, |s, k| if (start_s..start_s + 0.45).contains(&s.time_s[k]) { 1.0 } else { 0.0 })
                    }],
                );
                add(
                    "count-loss",
                    1,
                    &[&move |s| {
                        let start_s = share * s.time_s.last().copied().unwrap_or(0.0);
                        s.acceleration_of(&over(s, |s, k| if s.time_s[k] >= start_s { 1.0 } else { 0.0 }))
                    }],
                );
            }
        }
        let tool = Load { mass_kg: 1.0, centre_m: [0.0, -0.45], inertia_kg_m2: 0.0 };
        let of_load = tool.delta_f(PUMA_UPPER_ARM_M);
        let payload = self.column(&|s| {
            (0..s.speed_rad_s.len())
                .map(|k| (0..PARAMETERS).map(|index| of_load[index] * s.base[index][k]).sum())
                .collect()
        });
        all.push(Hypothesis { name: "payload", joint: None, columns: vec![payload], shapes: 0 });
        all.push(Hypothesis { name: "base-tilt", joint: None, columns: vec![self.tilt()], shapes: 0 });
        all
    }

    /// Motor torque per radian that the base leans.
    fn tilt(&self) -> Vec<f64> {
        const STEP_RAD: f64 = 1e-4;
        let weights = |f: [f64; PARAMETERS], q2: f64, q3: f64| {
            Arm { f, gravity_m_s2: self.gravity_m_s2 }.inverse_dynamics_nm([q2, q3], [0.0; 2], [0.0; 2])
        };
        let mut rows = Vec::new();
        for both in self.signals.chunks_exact(2) {
            for (joint, signals) in both.iter().enumerate() {
                let gear = signals.motor_rad.last().copied().unwrap_or(1.0)
                    / signals.joint_rad.last().copied().filter(|angle| *angle != 0.0).unwrap_or(1.0);
                let column: Vec<f64> = (0..signals.time_s.len())
                    .map(|k| {
                        let [q2, q3] = [both[0].joint_rad[k], both[1].joint_rad[k]];
                        let f = shared::arm::REFERENCE_F;
                        (weights(f, q2 + STEP_RAD, q3)[joint] - weights(f, q2, q3)[joint]) / STEP_RAD / gear
                    })
                    .collect();
                rows.extend(signals.rows(&column));
            }
        }
        rows
    }
}

fn over(signals: &Signals, of: impl Fn(&Signals, usize) -> f64) -> Vec<f64> {
    (0..signals.time_s.len()).map(|k| of(signals, k)).collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().map(f64::abs).fold(0.0, f64::max)
}

fn standard_errors(model: &Model) -> [f64; BASE_COLUMNS] {
    let mut errors = [f64::INFINITY; BASE_COLUMNS];
    if let Some(of_f) = &model.f_standard_error {
        errors[..PARAMETERS].copy_from_slice(of_f);
    }
    for joint in 0..2 {
        if let Some(viscous) = &model.viscous_standard_error {
            errors[PARAMETERS + 2 * joint] = viscous[joint];
        }
        if let Some(coulomb) = &model.coulomb_standard_error {
            errors[PARAMETERS + 2 * joint + 1] = coulomb[joint];
        }
    }
    errors
}

/// The screen's answer to a case.
pub fn answer(case: &Case) -> Answer {
    let started = Instant::now();
    let verdict = match Rows::read(case) {
        Ok(Some(rows)) => Ok(verdict(&rows)),
        Ok(None) => Err("no two-link arm under a P loop".to_owned()),
        Err(error) => Err(error.to_string()),
    };
    let seconds = started.elapsed().as_secs_f64();
    match verdict {
        Ok(verdict) => Answer { seconds, verdict: Some(verdict), failure: String::new() },
        Err(failure) => Answer { seconds, verdict: None, failure },
    }
}

fn verdict(rows: &Rows) -> Verdict {
    let orders: Vec<f64> = (0..160).map(|step| 0.85 + 0.0275 * f64::from(step)).collect();
    let projection = Projection::new(rows);
    let count = rows.left.len() as f64;
    let before = projection.left.norm_squared();
    let gain = |hypothesis: &Hypothesis| {
        let after = before - projection.explained(&hypothesis.columns);
        let constants = (hypothesis.columns.len() + hypothesis.shapes) as f64;
        count * (before / after.max(f64::MIN_POSITIVE)).ln() - constants * count.ln()
    };
    let hypotheses = rows.hypotheses(&orders);
    let best = hypotheses
        .iter()
        .map(|hypothesis| (gain(hypothesis), hypothesis))
        .max_by(|one, other| one.0.total_cmp(&other.0));
    match best {
        Some((gain, hypothesis)) if gain > LEAST_GAIN => named(rows, hypothesis.name, hypothesis.joint),
        _ => Verdict { verdict: "none".to_owned(), ..Verdict::default() },
    }
}

/// A verdict of one name.
pub fn named(rows: &Rows, name: &str, joint: Option<usize>) -> Verdict {
    let joint = joint.map_or("both", |joint| rows.names[joint].as_str());
    let effect =
        Named { name: name.to_owned(), joint: joint.to_owned(), class: vec![name.to_owned()], ..Named::default() };
    Verdict { verdict: "named".to_owned(), effects: vec![effect], gap: None }
}

/// Rows with the base parameters taken out, as far as the baseline lets them move.
struct Projection {
    /// Orthonormal columns that span what the base parameters can do, prior rows appended.
    basis: DMatrix<f64>,
    left: DVector<f64>,
    priors: usize,
}

impl Projection {
    fn new(rows: &Rows) -> Self {
        let count = rows.left.len();
        // Noise of a row, from what the base parameters leave when they are free.
        let free = DMatrix::from_fn(count, BASE_COLUMNS, |row, column| rows.base[column][row]);
        let target = DVector::from_column_slice(&rows.left);
        let noise = free
            .clone()
            .svd(true, true)
            .solve(&target, 1e-9)
            .map_or(1.0, |solution| ((&target - &free * solution).norm_squared() / count.max(1) as f64).sqrt());
        let design = DMatrix::from_fn(count + BASE_COLUMNS, BASE_COLUMNS, |row, column| {
            if row < count {
                rows.base[column][row]
            } else if row - count == column {
                noise / rows.standard_errors[column]
            } else {
                0.0
            }
        });
        let basis = design.qr().q();
        let mut left = DVector::zeros(count + BASE_COLUMNS);
        left.rows_mut(0, count).copy_from(&target);
        let left = &left - &basis * basis.tr_mul(&left);
        Self { basis, left, priors: BASE_COLUMNS }
    }

    /// Sum of squares that these columns take away.
    fn explained(&self, columns: &[Vec<f64>]) -> f64 {
        let mut design = DMatrix::zeros(self.left.len(), columns.len());
        for (index, column) in columns.iter().enumerate() {
            design.view_mut((0, index), (self.left.len() - self.priors, 1)).copy_from_slice(column);
        }
        let before: Vec<f64> = design.column_iter().map(|column| column.norm()).collect();
        let mut projected = &design - &self.basis * self.basis.tr_mul(&design);
        // What the base parameters can do as well is no evidence.
        for (mut column, before) in projected.column_iter_mut().zip(before) {
            let after = column.norm();
            if after < 1e-6 * before || after == 0.0 {
                column.fill(0.0);
            } else {
                column /= after;
            }
        }
        let moments = projected.tr_mul(&self.left);
        let squares = projected.tr_mul(&projected);
        squares.svd(true, true).solve(&moments, 1e-9).map_or(0.0, |solution| moments.dot(&solution))
    }
}
