//! Replicas of the arm side by side: one with the parameters assumed, and one for each unknown moved a little.

#![expect(clippy::needless_range_loop, reason = "a joint is an index into many arrays")]

use super::{LoadRow, LoadSetup};
use crate::arm::{Arm, Load, PARAMETERS};
use crate::board::MID_SCALE;
use crate::drive::{Drive, centre_of_count};
use crate::plant::{Plant, State};
use crate::replay::{CORRECTION_DAMPING, CORRECTION_HZ};

/// What a load adds to f, in the four numbers that it is linear in: mass, mass times centre, inertia about joint 3.
pub const LOAD_UNKNOWNS: usize = 4;
/// f1..f9, viscous and Coulomb friction of both joints.
pub const MODEL_UNKNOWNS: usize = PARAMETERS + 4;
/// Positions and velocities at the first row.
pub const STATE_UNKNOWNS: usize = 4;
/// All that is not known exactly beside the load.
pub const NUISANCES: usize = MODEL_UNKNOWNS + STATE_UNKNOWNS;
/// All unknowns: first the nuisances, then the load.
pub const UNKNOWNS: usize = NUISANCES + LOAD_UNKNOWNS;

/// Rows before the first replayed one that its velocity is found from, and as many after it.
pub const START_ROWS: usize = 8;

/// Standard deviation of what a row shows beside the model, counts: rounding, 1/√12, and a little for what no model has.
pub const NOISE_COUNTS: f32 = 0.35;
/// Standard error of the velocity at the first row in counts a row: rounding over twice [`START_ROWS`], and the change of
/// the acceleration meanwhile.
const START_SPEED_ERROR_COUNTS: f32 = 0.1;
/// Standard error of the position at the first row in counts.
const START_POSITION_ERROR_COUNTS: f32 = 0.3;

/// What a load is linear in.
pub fn linear_load(load: &Load<f32>) -> [f32; LOAD_UNKNOWNS] {
    let [x, y] = load.centre_m;
    let mass = load.mass_kg;
    [mass, mass * x, mass * y, load.inertia_kg_m2 + mass * (x * x + y * y)]
}

/// What [`linear_load`] adds to f1..f9.
fn added_f([mass, mass_x, mass_y, about_joint]: [f32; LOAD_UNKNOWNS], upper_arm_m: f32) -> [f32; PARAMETERS] {
    [
        about_joint,
        about_joint,
        mass_x * upper_arm_m,
        mass_y * upper_arm_m,
        mass_x,
        mass_y,
        mass * upper_arm_m * upper_arm_m + about_joint,
        0.0,
        mass * upper_arm_m,
    ]
}

/// What a row shows: the innovation of the replica that assumes what is assumed, and how the modelled position moves with
/// each unknown.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Measured less modelled position of both motors in counts.
    pub innovation_counts: [f32; 2],
    /// Counts by which the modelled positions move with each unknown: with a nuisance by one standard error of it, with the
    /// load's four by one unit.
    pub sensitivity: [[f32; UNKNOWNS]; 2],
}

/// The replicas.
#[derive(Clone, Debug)]
pub struct Bundle {
    states: [State<f32>; UNKNOWNS + 1],
    /// Nuisances assumed, in standard errors.
    nuisances: [f32; NUISANCES],
    load: [f32; LOAD_UNKNOWNS],
    /// By how much each of the load's four is moved.
    steps: [f32; LOAD_UNKNOWNS],
    previous_torque_nm: Option<[f32; 2]>,
}

impl Bundle {
    /// Replicas that know nothing yet.
    pub const fn new() -> Self {
        Self {
            states: [State { position_rad: [0.0; 2], velocity_rad_s: [0.0; 2] }; UNKNOWNS + 1],
            nuisances: [0.0; NUISANCES],
            load: [0.0; LOAD_UNKNOWNS],
            steps: [1.0; LOAD_UNKNOWNS],
            previous_torque_nm: None,
        }
    }

    /// Starts all replicas at `counts`, moving by `counts_per_row`, with `load` and the nuisances assumed (in standard
    /// errors, those of the state apart).
    pub fn start(
        &mut self,
        setup: &LoadSetup,
        load: [f32; LOAD_UNKNOWNS],
        nuisances: &[f32; NUISANCES],
        counts: [i32; 2],
        counts_per_row: [f32; 2],
    ) {
        self.load = load;
        let mass_step = 0.1 * setup.settings.maximum_kg;
        self.steps = [mass_step, 0.1 * mass_step, 0.1 * mass_step, 0.05 * mass_step];
        self.nuisances = *nuisances;
        self.previous_torque_nm = None;
        let per_rad = setup.drives.map(|drive| drive.counts_per_rad());
        let mut start = State { position_rad: [0.0; 2], velocity_rad_s: [0.0; 2] };
        for joint in 0..2 {
            let [position, speed] = [MODEL_UNKNOWNS + joint, MODEL_UNKNOWNS + 2 + joint].map(|index| nuisances[index]);
            start.position_rad[joint] =
                (centre_of_count(counts[joint] as f32) + START_POSITION_ERROR_COUNTS * position) / per_rad[joint];
            start.velocity_rad_s[joint] =
                (counts_per_row[joint] + START_SPEED_ERROR_COUNTS * speed) / (per_rad[joint] * setup.period_s);
        }
        self.states = [start; UNKNOWNS + 1];
        for joint in 0..2 {
            let [position, speed] = [MODEL_UNKNOWNS + joint, MODEL_UNKNOWNS + 2 + joint];
            self.states[1 + position].position_rad[joint] += START_POSITION_ERROR_COUNTS / per_rad[joint];
            self.states[1 + speed].velocity_rad_s[joint] +=
                START_SPEED_ERROR_COUNTS / (per_rad[joint] * setup.period_s);
        }
    }

    /// What the row shows, and every replica moved on to the next. Bounded time: [`UNKNOWNS`] + 1 steps of the plant.
    #[inline(never)]
    pub fn advance(&mut self, setup: &LoadSetup, row: &LoadRow) -> Shown {
        let omega = core::f64::consts::TAU as f32 * CORRECTION_HZ as f32;
        let position_gain = 2.0 * CORRECTION_DAMPING as f32 * omega * setup.period_s;
        let velocity_gain = omega * omega * setup.period_s;
        let torque = [0, 1].map(|joint: usize| {
            let code = f32::from(row.command_code[joint]) - f32::from(MID_SCALE);
            setup.drives[joint].motor_torque_nm(code * setup.a_per_code[joint] + setup.offset_a[joint])
        });
        // The command before acts until the delay is over; the mean has the same impulse.
        let before = self.previous_torque_nm.unwrap_or(torque);
        let late = setup.command_delay_s / setup.period_s;
        let held = [0, 1].map(|joint: usize| torque[joint] + late * (before[joint] - torque[joint]));
        self.previous_torque_nm = Some(torque);

        let mut shown = Shown { innovation_counts: [0.0; 2], sensitivity: [[0.0; UNKNOWNS]; 2] };
        let per_rad = setup.drives.map(|drive| drive.counts_per_rad());
        for replica in 0..=UNKNOWNS {
            let moved = replica.checked_sub(1);
            if moved.is_some_and(|unknown| !is_free(setup, unknown)) {
                continue;
            }
            let Some(state) = self.states.get_mut(replica) else { continue };
            let mut corrected = *state;
            for joint in 0..2 {
                let innovation = centre_of_count(row.counts[joint] as f32) - state.position_rad[joint] * per_rad[joint];
                corrected.position_rad[joint] += position_gain * innovation / per_rad[joint];
                corrected.velocity_rad_s[joint] += velocity_gain * innovation / per_rad[joint];
                match moved {
                    None => shown.innovation_counts[joint] = innovation,
                    Some(unknown) => {
                        let step = unknown.checked_sub(NUISANCES).map_or(1.0, |index| self.steps[index]);
                        shown.sensitivity[joint][unknown] = (shown.innovation_counts[joint] - innovation) / step;
                    }
                }
            }
            let plant = plant(setup, &self.load, &self.steps, &self.nuisances, moved).prepare();
            *state = plant.step(&corrected, held, setup.period_s);
        }
        shown
    }
}

/// How far one standard error of a nuisance of the model is, in its unit.
fn model_error(setup: &LoadSetup, unknown: usize) -> f32 {
    let settings = &setup.settings;
    let errors = settings.f_standard_error.iter().chain(&settings.viscous_standard_error);
    errors.chain(&settings.coulomb_standard_error).nth(unknown).copied().unwrap_or(0.0)
}

/// Whether an unknown is one: a parameter of the model known exactly is none.
pub fn is_free(setup: &LoadSetup, unknown: usize) -> bool {
    unknown >= MODEL_UNKNOWNS || model_error(setup, unknown) > 0.0
}

/// The plant of one replica, the one of `moved` with that unknown moved by its step.
fn plant(
    setup: &LoadSetup,
    load: &[f32; LOAD_UNKNOWNS],
    steps: &[f32; LOAD_UNKNOWNS],
    nuisances: &[f32; NUISANCES],
    moved: Option<usize>,
) -> Plant<f32> {
    let settings = &setup.settings;
    let off = |unknown: usize, error: f32| {
        let step = if moved == Some(unknown) { 1.0 } else { 0.0 };
        (nuisances.get(unknown).copied().unwrap_or(0.0) + step) * error
    };
    let mut load = *load;
    if let Some(index) = moved.and_then(|unknown| unknown.checked_sub(NUISANCES)) {
        load[index] += steps[index];
    }
    let mut f = setup.f;
    let added = added_f(load, settings.upper_arm_m);
    for (index, ((f, added), &error)) in f.iter_mut().zip(added).zip(&settings.f_standard_error).enumerate() {
        *f += added + off(index, error);
    }
    let drive = |joint: usize| {
        let drive = setup.drives[joint];
        let viscous = off(PARAMETERS + joint, settings.viscous_standard_error[joint]);
        let coulomb = off(PARAMETERS + 2 + joint, settings.coulomb_standard_error[joint]);
        Drive {
            viscous_friction_nm_s_per_rad: drive.viscous_friction_nm_s_per_rad + viscous,
            coulomb_friction_nm: (drive.coulomb_friction_nm + coulomb).max(0.0),
            ..drive
        }
    };
    Plant { arm: Arm { f, gravity_m_s2: setup.gravity_m_s2 }, drives: [drive(0), drive(1)] }
}
