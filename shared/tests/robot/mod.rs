//! The robot of design.md that the tests of arm, drive, plant, control and replay have in common.
#![allow(dead_code, reason = "every test program uses a part of it")]

use core::f64::consts::{FRAC_PI_4, TAU};

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use shared::arm::{Arm, PARAMETERS, REFERENCE_F};
use shared::control::{JointReference, Law, LawState, PositionLaw, PositionLoop};
use shared::drive::Drive;
use shared::plant::{Plant, PreparedPlant, State};

pub const GRAVITY: f64 = 9.81;
/// The sampling period of the paper and of the default loop, in s.
pub const PERIOD_S: f64 = 0.0007;
/// From sampling the encoders to the new current, in s (design.md §8).
pub const DELAY_S: f64 = 0.00003;
/// Period of the paper's trajectory in s, and its number of samples.
pub const TRAJECTORY_S: f64 = 3.65;
pub const SAMPLES: usize = 5214;
/// The paper's set (design.md §2).
pub const PAPER_F: [f64; PARAMETERS] = [1.68, 1.39, -0.29, -1.40, -0.08, -1.94, 6.67, 0.06, 10.2];

/// Random numbers that are the same in every run.
pub struct Random(Pcg32);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(Pcg32::seed_from_u64(seed))
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.0.next_u32()) / 4_294_967_296.0
    }

    pub fn pair(&mut self, bound: f64) -> [f64; 2] {
        [self.between(-bound, bound), self.between(-bound, bound)]
    }
}

pub fn drives() -> [Drive<f64>; 2] {
    let drive = |gear_ratio, counts_per_rev, viscous, coulomb| Drive {
        gear_ratio,
        counts_per_rev,
        torque_constant_nm_per_a: 0.25,
        current_limit_a: 12.0,
        viscous_friction_nm_s_per_rad: viscous,
        coulomb_friction_nm: coulomb,
        torque_offset_nm: 0.0,
    };
    [drive(107.8, 800.0, 0.817e-3, 0.124), drive(-53.7, 1000.0, 1.38e-3, 0.146)]
}

/// The reference robot.
pub fn plant() -> Plant<f64> {
    Plant { arm: Arm { f: REFERENCE_F, gravity_m_s2: GRAVITY }, drives: drives() }
}

/// The reference robot without any friction.
pub fn frictionless() -> Plant<f64> {
    let mut plant = plant();
    for drive in &mut plant.drives {
        drive.viscous_friction_nm_s_per_rad = 0.0;
        drive.coulomb_friction_nm = 0.0;
    }
    plant
}

pub fn counts_per_rad() -> [f64; 2] {
    drives().map(|drive| drive.counts_per_rad())
}

pub fn single_precision(plant: &Plant<f64>) -> Plant<f32> {
    let of = |d: Drive<f64>| Drive {
        gear_ratio: d.gear_ratio as f32,
        counts_per_rev: d.counts_per_rev as f32,
        torque_constant_nm_per_a: d.torque_constant_nm_per_a as f32,
        current_limit_a: d.current_limit_a as f32,
        viscous_friction_nm_s_per_rad: d.viscous_friction_nm_s_per_rad as f32,
        coulomb_friction_nm: d.coulomb_friction_nm as f32,
        torque_offset_nm: d.torque_offset_nm as f32,
    };
    Plant {
        arm: Arm { f: plant.arm.f.map(|f| f as f32), gravity_m_s2: plant.arm.gravity_m_s2 as f32 },
        drives: plant.drives.map(of),
    }
}

/// The paper's trajectory (6): `q2 = -π/4 + π/4 cos wt`, `q3 = π/4 - π/4 cos 2wt`, w = 2π/T.
pub fn reference(time_s: f64) -> JointReference<f64> {
    let (w, r) = (TAU / TRAJECTORY_S, FRAC_PI_4);
    let ((s1, c1), (s2, c2)) = ((w * time_s).sin_cos(), (2.0 * w * time_s).sin_cos());
    JointReference {
        position_rad: [r * (c1 - 1.0), r * (1.0 - c2)],
        velocity_rad_s: [-r * w * s1, 2.0 * r * w * s2],
        acceleration_rad_s2: [-r * w * w * c1, 4.0 * r * w * w * c2],
    }
}

/// The trajectory in motor counts, not truncated.
pub fn reference_counts(time_s: f64) -> [f64; 2] {
    let [q2, q3] = reference(time_s).position_rad;
    [q2 * counts_per_rad()[0], q3 * counts_per_rad()[1]]
}

/// A position loop of gain `gain_nm_per_count` at a torque constant of 0.25 N m/A.
pub fn position_loop(gain_nm_per_count: f64, lead: f64) -> PositionLoop<f64> {
    PositionLoop { gain_a_per_count: gain_nm_per_count / 0.25, lead }
}

/// Laws of both joints from gains in N m of motor torque per count.
pub fn laws(gains_nm_per_count: [f64; 2], lead: f64) -> [LawState<f64>; 2] {
    gains_nm_per_count.map(|gain| LawState::new(Law::Proportional(position_loop(gain, lead))))
}

/// Half the stability limit at 0.7 ms (design.md §4).
pub const DEFAULT_GAINS: [f64; 2] = [0.009, 0.012];

/// A robot integrated in fine steps under its own sampled position loop: what a recording is made with.
pub struct Robot {
    pub plant: Plant<f64>,
    pub prepared: PreparedPlant<f64>,
    pub state: State<f64>,
    laws: [LawState<f64>; 2],
    /// Whether the encoders and references are truncated.
    pub quantised: bool,
    pub loop_period_s: f64,
    pub delay_s: f64,
    pub step_s: f64,
    previous_command: Option<[f64; 2]>,
}

/// What the robot saw and did at one tick of its loop.
#[derive(Clone, Copy)]
pub struct Tick {
    pub reference: [f64; 2],
    pub actual: [f64; 2],
    pub error: [f64; 2],
    pub command: [f64; 2],
}

impl Robot {
    /// Stands at the start of the trajectory.
    pub fn new(plant: Plant<f64>, laws: [LawState<f64>; 2], quantised: bool, loop_period_s: f64) -> Self {
        Self {
            prepared: plant.prepare(),
            plant,
            state: State::at_rest(reference(0.0).position_rad),
            laws,
            quantised,
            loop_period_s,
            delay_s: DELAY_S,
            step_s: 1e-5,
            previous_command: None,
        }
    }

    /// One tick of the loop: samples, computes the command, and moves on by one period.
    pub fn tick(&mut self, reference_counts: [f64; 2]) -> Tick {
        let round = |counts: f64| if self.quantised { counts.trunc() } else { counts };
        let reference = reference_counts.map(round);
        let actual = [0, 1].map(|j| round(self.state.position_rad[j] * self.plant.drives[j].counts_per_rad()));
        let command = [0, 1].map(|j| self.laws[j].command_a(reference[j], actual[j]));
        self.advance(command);
        Tick { reference, actual, error: [0, 1].map(|j| reference[j] - actual[j]), command }
    }

    /// Holds the command before for the delay, then `command` to the end of the period.
    pub fn advance(&mut self, command: [f64; 2]) {
        let before = self.previous_command.replace(command).unwrap_or(command);
        let torque = |command: [f64; 2]| [0, 1].map(|j| self.plant.drives[j].motor_torque_nm(command[j]));
        let (before, now) = (torque(before), torque(command));
        for (torque, duration_s) in [(before, self.delay_s), (now, self.loop_period_s - self.delay_s)] {
            let steps = (duration_s / self.step_s).round().max(if duration_s > 0.0 { 1.0 } else { 0.0 });
            for _ in 0..steps as usize {
                self.state = self.prepared.step(&self.state, torque, duration_s / steps);
            }
        }
    }
}

pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |most: f64, v| most.max(v.abs()))
}
