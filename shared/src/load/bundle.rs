//! Replicas of the arm side by side: one with the parameters assumed, and one for each unknown moved a little.
//!
//! What a replica shows of an unknown changes slowly, so all those that are moved, and one beside them that is not, take two
//! rows in a step; only the innovations themselves come from a replica that takes each row by itself. That halves the work,
//! and what is found is where the innovations say it is, however roughly their slopes are known.

#![expect(clippy::needless_range_loop, reason = "a joint is an index into many arrays")]

use super::{LoadRow, LoadSetup};
use crate::arm::{Arm, Load, PARAMETERS, Pose};
use crate::board::MID_SCALE;
use crate::drive::{Drive, centre_of_count};
use crate::plant::{Plant, State};
use crate::replay::{CORRECTION_DAMPING, CORRECTION_HZ};

/// What a load adds to f, in the four numbers that it is linear in: mass, mass times centre, inertia about joint 3.
pub const LOAD_UNKNOWNS: usize = 4;
/// f1..f9, viscous and Coulomb friction of both joints, the delay of the commands.
pub const MODEL_UNKNOWNS: usize = PARAMETERS + 5;
/// Which of them the delay is.
const DELAY: usize = PARAMETERS + 4;
/// Standard error of the delay in s: what the robot file says of it is as much a guess about the amplifier as the time that
/// the board takes. Held fast where it is off by that much, it would pass for centre and inertia of the load, at many of
/// their standard errors.
const DELAY_ERROR_S: f32 = 20e-6;
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

/// Counts that it does not matter when a joint comes to rest by: corrections move one that sticks by less at every row.
const NOTHING_COUNTS: f32 = 0.01;

/// What a load is linear in.
pub fn linear_load(load: &Load<f32>) -> [f32; LOAD_UNKNOWNS] {
    let [x, y] = load.centre_m;
    let mass = load.mass_kg;
    [mass, mass * x, mass * y, load.inertia_kg_m2 + mass * (x * x + y * y)]
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

/// The replicas. Their positions are counted from that of a row: whole angles in single precision are rounded by hundredths
/// of a count where a turn has many, and what two replicas differ by is less.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// The one that takes each row by itself, and the row that it is counted from.
    state: State<f32>,
    origin_counts: [i32; 2],
    /// Those that take two rows in a step, with everything as assumed and with each unknown moved, and the row that they are
    /// counted from.
    states: [State<f32>; UNKNOWNS + 1],
    first_origin_counts: [i32; 2],
    /// With everything as it is assumed.
    plant: Plant<f32>,
    /// The delay of the commands that is assumed, s.
    delay_s: f32,
    /// By how much each of the load's four is moved.
    steps: [f32; LOAD_UNKNOWNS],
    previous_torque_nm: Option<[f32; 2]>,
    /// The torques before and at the first of two rows, while the second is awaited.
    first_torque_nm: Option<[[f32; 2]; 2]>,
    /// What the first of two rows showed of each unknown.
    sensitivity: [[f32; UNKNOWNS]; 2],
}

impl Bundle {
    /// Replicas that know nothing yet.
    pub const fn new() -> Self {
        let drive = Drive {
            gear_ratio: 1.0,
            counts_per_rev: 1.0,
            torque_constant_nm_per_a: 0.0,
            current_limit_a: 0.0,
            viscous_friction_nm_s_per_rad: 0.0,
            coulomb_friction_nm: 0.0,
            torque_offset_nm: 0.0,
        };
        let state = State { position_rad: [0.0; 2], velocity_rad_s: [0.0; 2] };
        Self {
            state,
            origin_counts: [0; 2],
            states: [state; UNKNOWNS + 1],
            first_origin_counts: [0; 2],
            plant: Plant { arm: Arm { f: [0.0; PARAMETERS], gravity_m_s2: 0.0 }, drives: [drive; 2] },
            delay_s: 0.0,
            steps: [1.0; LOAD_UNKNOWNS],
            previous_torque_nm: None,
            first_torque_nm: None,
            sensitivity: [[0.0; UNKNOWNS]; 2],
        }
    }

    /// Starts all replicas at `counts`, moving by `counts_per_row`, with `load` and the nuisances assumed, these in standard
    /// errors.
    #[inline(never)]
    pub fn start(
        &mut self,
        setup: &LoadSetup,
        load: [f32; LOAD_UNKNOWNS],
        nuisances: &[f32; NUISANCES],
        counts: [i32; 2],
        counts_per_row: [f32; 2],
    ) {
        let mass_step = 0.02 * setup.settings.maximum_kg;
        self.steps = [mass_step, 0.1 * mass_step, 0.1 * mass_step, 0.05 * mass_step];
        self.previous_torque_nm = None;
        self.first_torque_nm = None;
        self.sensitivity = [[0.0; UNKNOWNS]; 2];
        self.delay_s = setup.command_delay_s + DELAY_ERROR_S * nuisances[DELAY];
        self.plant = Plant { arm: Arm { f: setup.f, gravity_m_s2: setup.gravity_m_s2 }, drives: setup.drives };
        for (unknown, &errors) in nuisances.iter().enumerate().take(MODEL_UNKNOWNS) {
            move_model(&mut self.plant, unknown, errors * model_error(setup, unknown));
        }
        for (unknown, by) in load.into_iter().enumerate() {
            move_load(&mut self.plant, setup, unknown, by);
        }
        let per_rad = setup.drives.map(|drive| drive.counts_per_rad());
        let mut start = State { position_rad: [0.0; 2], velocity_rad_s: [0.0; 2] };
        for joint in 0..2 {
            let [position, speed] = [MODEL_UNKNOWNS + joint, MODEL_UNKNOWNS + 2 + joint].map(|index| nuisances[index]);
            start.position_rad[joint] =
                (middle_of_cell(counts[joint]) + START_POSITION_ERROR_COUNTS * position) / per_rad[joint];
            start.velocity_rad_s[joint] =
                (counts_per_row[joint] + START_SPEED_ERROR_COUNTS * speed) / (per_rad[joint] * setup.period_s);
        }
        self.state = start;
        self.origin_counts = counts;
        self.states = [start; UNKNOWNS + 1];
        self.first_origin_counts = counts;
        for joint in 0..2 {
            let [position, speed] = [MODEL_UNKNOWNS + joint, MODEL_UNKNOWNS + 2 + joint];
            self.states[1 + position].position_rad[joint] += START_POSITION_ERROR_COUNTS / per_rad[joint];
            self.states[1 + speed].velocity_rad_s[joint] +=
                START_SPEED_ERROR_COUNTS / (per_rad[joint] * setup.period_s);
        }
    }

    /// What the row shows, the replicas moved on to the next, and how many steps of one that took: at most
    /// [`UNKNOWNS`] + 2, and up to six times as many more in a row in which joints reverse, which are not counted.
    #[inline(never)]
    pub fn advance(&mut self, setup: &LoadSetup, row: &LoadRow) -> (Shown, u32) {
        let torque = [0, 1].map(|joint: usize| {
            let code = f32::from(row.command_code[joint]) - f32::from(MID_SCALE);
            setup.drives[joint].motor_torque_nm(code * setup.a_per_code[joint] + setup.offset_a[joint])
        });
        let before = self.previous_torque_nm.unwrap_or(torque);
        self.previous_torque_nm = Some(torque);

        let per_rad = self.plant.drives.map(|drive| drive.counts_per_rad());
        let measured = row.counts.map(middle_of_cell);
        recount(&mut self.state, self.origin_counts, row.counts, per_rad);
        self.origin_counts = row.counts;
        let innovation_counts = correct(&mut self.state, measured, per_rad, setup.period_s);
        let torque_nm = held(before, torque, self.delay_s / setup.period_s);
        let origin = pose(row.counts, per_rad);
        let nothing_rad = per_rad.map(|per_rad| NOTHING_COUNTS / per_rad);
        self.state =
            self.plant.prepare().step_through_reversals(&origin, &self.state, torque_nm, setup.period_s, nothing_rad);
        let mut steps = 1;
        if let Some([earliest, first]) = self.first_torque_nm.take() {
            // Over both rows, with the impulse of both.
            let mean = [0, 1].map(|joint: usize| 0.5 * (first[joint] + torque[joint]));
            let mean_before = [0, 1].map(|joint: usize| 0.5 * (earliest[joint] + first[joint]));
            self.step_two_rows(setup, mean_before, mean);
            steps += UNKNOWNS as u32 + 1;
        } else {
            self.first_torque_nm = Some([before, torque]);
            self.compare(setup, row.counts, per_rad);
        }
        (Shown { innovation_counts, sensitivity: self.sensitivity }, steps)
    }

    /// What the moved replicas show beside the one that is not, all corrected for the two rows to come.
    fn compare(&mut self, setup: &LoadSetup, counts: [i32; 2], per_rad: [f32; 2]) {
        let measured = counts.map(middle_of_cell);
        let before = core::mem::replace(&mut self.first_origin_counts, counts);
        let mut unmoved = [0.0; 2];
        for (replica, state) in self.states.iter_mut().enumerate() {
            let moved = replica.checked_sub(1).map(|unknown| (unknown, moved(setup, &self.steps, unknown)));
            // Known exactly: nothing moves with it.
            if matches!(moved, Some((_, None))) {
                continue;
            }
            recount(state, before, counts, per_rad);
            let innovation = correct(state, measured, per_rad, 2.0 * setup.period_s);
            let Some((unknown, Some((_, units)))) = moved else {
                unmoved = innovation;
                continue;
            };
            for joint in 0..2 {
                self.sensitivity[joint][unknown] = (unmoved[joint] - innovation[joint]) / units;
            }
        }
    }

    fn step_two_rows(&mut self, setup: &LoadSetup, before: [f32; 2], torque: [f32; 2]) {
        let assumed = held(before, torque, self.delay_s / setup.period_s);
        let per_rad = self.plant.drives.map(|drive| drive.counts_per_rad());
        let origin = pose(self.first_origin_counts, per_rad);
        let nothing_rad = per_rad.map(|per_rad| NOTHING_COUNTS / per_rad);
        let period_s = 2.0 * setup.period_s;
        for (replica, state) in self.states.iter_mut().enumerate() {
            let mut plant = self.plant;
            let mut torque_nm = assumed;
            if let Some(unknown) = replica.checked_sub(1) {
                let Some((by, _)) = moved(setup, &self.steps, unknown) else { continue };
                match unknown.checked_sub(NUISANCES) {
                    Some(index) => move_load(&mut plant, setup, index, by),
                    None if unknown == DELAY => {
                        torque_nm = held(before, torque, (self.delay_s + by) / setup.period_s);
                    }
                    None if unknown < MODEL_UNKNOWNS => move_model(&mut plant, unknown, by),
                    None => {}
                }
            }
            *state = plant.prepare().step_through_reversals(&origin, state, torque_nm, period_s, nothing_rad);
        }
    }
}

/// The command before acts until the delay is over; the mean has the same impulse.
#[inline(always)]
fn held(before: [f32; 2], torque: [f32; 2], late: f32) -> [f32; 2] {
    [0, 1].map(|joint: usize| torque[joint] + late * (before[joint] - torque[joint]))
}

/// The position that a count stands for, from where the count itself is.
#[inline(always)]
fn middle_of_cell(count: i32) -> f32 {
    centre_of_count(count as f32) - count as f32
}

/// Counts a state from another row.
#[inline(always)]
fn recount(state: &mut State<f32>, from_counts: [i32; 2], to_counts: [i32; 2], per_rad: [f32; 2]) {
    for joint in 0..2 {
        state.position_rad[joint] += from_counts[joint].wrapping_sub(to_counts[joint]) as f32 / per_rad[joint];
    }
}

/// The pose at those counts.
#[inline(always)]
fn pose(counts: [i32; 2], per_rad: [f32; 2]) -> Pose<f32> {
    Pose::at([0, 1].map(|joint: usize| counts[joint] as f32 / per_rad[joint]))
}

/// Corrects a state by what it did not foresee, which is the answer in counts, for the time until the next correction.
#[inline(always)]
fn correct(state: &mut State<f32>, measured_counts: [f32; 2], per_rad: [f32; 2], until_next_s: f32) -> [f32; 2] {
    let omega = core::f64::consts::TAU as f32 * CORRECTION_HZ as f32;
    let position_gain = 2.0 * CORRECTION_DAMPING as f32 * omega * until_next_s;
    let velocity_gain = omega * omega * until_next_s;
    [0, 1].map(|joint: usize| {
        let innovation = measured_counts[joint] - state.position_rad[joint] * per_rad[joint];
        state.position_rad[joint] += position_gain * innovation / per_rad[joint];
        state.velocity_rad_s[joint] += velocity_gain * innovation / per_rad[joint];
        innovation
    })
}

/// By how much of its unit the replica of an unknown has it moved, and how much that is in what its sensitivity is told for;
/// `None` where it is known exactly. A state is moved once, at the start.
#[inline(always)]
fn moved(setup: &LoadSetup, steps: &[f32; LOAD_UNKNOWNS], unknown: usize) -> Option<(f32, f32)> {
    if let Some(&step) = unknown.checked_sub(NUISANCES).and_then(|index| steps.get(index)) {
        return Some((step, step));
    }
    if unknown >= MODEL_UNKNOWNS {
        return Some((0.0, 1.0));
    }
    let error = model_error(setup, unknown);
    let by = error.max(least_step(setup, unknown));
    (error > 0.0).then_some((by, by / error))
}

/// How far one standard error of a nuisance of the model is, in its unit.
fn model_error(setup: &LoadSetup, unknown: usize) -> f32 {
    let settings = &setup.settings;
    match unknown.checked_sub(PARAMETERS) {
        None => settings.f_standard_error[unknown],
        Some(joint @ 0..2) => settings.viscous_standard_error[joint],
        Some(joint) => settings.coulomb_standard_error.get(joint - 2).copied().unwrap_or(DELAY_ERROR_S),
    }
}

/// How far a nuisance of the model is moved at least: what a smaller step shows drowns in the rounding of single precision,
/// which then passes for knowledge about it and holds it where it is.
fn least_step(setup: &LoadSetup, unknown: usize) -> f32 {
    /// Share of the parameter.
    const SHARE: f32 = 0.01;
    /// f that smaller ones are taken for, in kg m² or kg m.
    const LEAST_F: f32 = 0.05;
    let drive = |joint: usize| setup.drives.get(joint);
    SHARE
        * match unknown.checked_sub(PARAMETERS) {
            None => {
                let least = LEAST_F * setup.f.iter().fold(0.0, |most: f32, f| most.max(f.abs()));
                setup.f.get(unknown).map_or(least, |f| f.abs().max(least))
            }
            Some(joint @ 0..2) => drive(joint).map_or(0.0, |drive| drive.viscous_friction_nm_s_per_rad),
            // In periods for the delay.
            Some(joint) => drive(joint - 2).map_or(setup.period_s, |drive| drive.coulomb_friction_nm),
        }
}

/// Moves an unknown of the model by so much of its unit.
#[inline(always)]
fn move_model(plant: &mut Plant<f32>, unknown: usize, by: f32) {
    match unknown.checked_sub(PARAMETERS) {
        None => plant.arm.f[unknown] += by,
        Some(joint @ 0..2) => plant.drives[joint].viscous_friction_nm_s_per_rad += by,
        Some(joint) => {
            if let Some(drive) = plant.drives.get_mut(joint - 2) {
                drive.coulomb_friction_nm = (drive.coulomb_friction_nm + by).max(0.0);
            }
        }
    }
}

/// Moves one of the load's four by so much of its unit: what [`linear_load`] adds to f1..f9.
#[inline(always)]
fn move_load(plant: &mut Plant<f32>, setup: &LoadSetup, unknown: usize, by: f32) {
    let upper_arm_m = setup.settings.upper_arm_m;
    let f = &mut plant.arm.f;
    match unknown {
        0 => {
            f[6] += by * upper_arm_m * upper_arm_m;
            f[8] += by * upper_arm_m;
        }
        1 | 2 => {
            f[1 + unknown] += by * upper_arm_m;
            f[3 + unknown] += by;
        }
        _ => {
            f[0] += by;
            f[1] += by;
            f[6] += by;
        }
    }
}
