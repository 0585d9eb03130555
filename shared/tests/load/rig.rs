//! A simulated robot under computed torque with the identification beside it, as on the board: a result enters at once.

use core::ops::Range;

use crate::robot::{DEFAULT_GAINS, DELAY_S, PERIOD_S, Random, Robot, laws, plant, reference, single_precision};
use shared::arm::Load;
use shared::control::{ComputedTorque, ComputedTorqueInput, ComputedTorqueSettings, JointReference};
use shared::load::{Identifier, LoadNews, LoadRow, LoadSettings, LoadSetup};
use shared::plant::Plant;

/// Where the gripper holds a load, in frame 3.
pub const GRASP_M: [f64; 2] = [-0.02, -0.53];
pub const MAXIMUM_KG: f32 = 2.5;
const UPPER_ARM_M: f32 = 0.4318;
/// Of a 12 A converter of 12 bits.
const A_PER_CODE: f32 = 12.0 / 2048.0;

/// Settings for a model whose parameters are uniformly off by up to `share`.
pub fn settings(share: f32) -> LoadSettings {
    let mut settings = LoadSettings::known_grasp(MAXIMUM_KG, UPPER_ARM_M, GRASP_M.map(|value| value as f32));
    let error = share / 3.0_f32.sqrt();
    let model = single_precision(&plant());
    settings.f_standard_error = model.arm.f.map(|f| error * f.abs());
    settings.viscous_standard_error = model.drives.map(|drive| error * drive.viscous_friction_nm_s_per_rad);
    settings.coulomb_standard_error = model.drives.map(|drive| error * drive.coulomb_friction_nm);
    settings
}

pub struct Rig {
    robot: Robot,
    empty: Plant<f64>,
    believed: Plant<f32>,
    settings: LoadSettings,
    controller: ComputedTorque<f32>,
    assumed: Load<f32>,
    identifier: Identifier,
    lose: bool,
    tick: usize,
    pub news: Vec<(usize, LoadNews)>,
    pub errors: Vec<[f64; 2]>,
}

fn loaded(mut plant: Plant<f64>, load: &Load<f64>) -> Plant<f64> {
    let added = load.delta_f(f64::from(UPPER_ARM_M));
    plant.arm.f.iter_mut().zip(added).for_each(|(f, added)| *f += added);
    plant
}

impl Rig {
    pub fn new(settings: LoadSettings, load: Load<f64>) -> Self {
        let empty = plant();
        let robot = Robot::new(loaded(empty, &load), laws(DEFAULT_GAINS, 0.0), true, PERIOD_S);
        let believed = single_precision(&empty);
        let mut rig = Self {
            controller: controller(&believed, &settings, robot.state.position_rad),
            robot,
            empty,
            believed,
            settings,
            assumed: settings.assumed(),
            identifier: Identifier::new(),
            lose: false,
            tick: 0,
            news: Vec::new(),
            errors: Vec::new(),
        };
        rig.begin();
        rig
    }

    /// Makes the board's model wrong: every f by up to `share`, friction by up to `friction_share`.
    pub fn spoil_model(&mut self, seed: u64, share: f64, friction_share: f64) {
        let mut random = Random::new(seed);
        let mut off = |bound: f64| (1.0 + random.between(-bound, bound)) as f32;
        self.believed.arm.f.iter_mut().for_each(|f| *f *= off(share));
        for drive in &mut self.believed.drives {
            drive.viscous_friction_nm_s_per_rad *= off(friction_share);
            drive.coulomb_friction_nm *= off(friction_share);
        }
        self.settings.viscous_standard_error =
            self.believed.drives.map(|drive| (friction_share / 1.732) as f32 * drive.viscous_friction_nm_s_per_rad);
        self.settings.coulomb_standard_error =
            self.believed.drives.map(|drive| (friction_share / 1.732) as f32 * drive.coulomb_friction_nm);
        self.controller = controller(&self.believed, &self.settings, self.robot.state.position_rad);
        self.begin();
    }

    fn begin(&mut self) {
        self.identifier.begin(&LoadSetup {
            settings: self.settings,
            f: self.believed.arm.f,
            gravity_m_s2: self.believed.arm.gravity_m_s2,
            drives: self.believed.drives,
            a_per_code: [A_PER_CODE; 2],
            offset_a: [0.0; 2],
            period_s: PERIOD_S as f32,
            command_delay_s: DELAY_S as f32,
            assumed: self.assumed,
        });
    }

    /// The arm takes up or sets down something: it carries `load` from now on.
    pub fn take(&mut self, load: &Load<f64>) {
        let plant = loaded(self.empty, load);
        let mut robot = Robot::new(plant, laws(DEFAULT_GAINS, 0.0), true, PERIOD_S);
        robot.state = self.robot.state;
        self.robot = robot;
    }

    /// The next row does not reach the identification.
    pub fn lose_a_row(&mut self) {
        self.lose = true;
    }

    pub fn run(&mut self, rows: usize) {
        (0..rows).for_each(|_| self.step());
    }

    fn step(&mut self) {
        let position = self.robot.state.position_rad;
        let counts = [0, 1].map(|j| self.robot.plant.drives[j].encoder_counts(position[j]));
        let time_s = self.tick as f64 * PERIOD_S;
        let at = reference(time_s);
        self.errors
            .push([0, 1].map(|j| (at.position_rad[j] - position[j]) * self.robot.plant.drives[j].counts_per_rad()));
        let output = self.controller.tick(&ComputedTorqueInput {
            reference: single(&at),
            reference_ahead: single(&reference(time_s + 0.5 * PERIOD_S + DELAY_S)),
            encoder_counts: counts.map(|count| count as f32),
        });
        let code = output.command_a.map(|current_a| (current_a / A_PER_CODE).round() + 2048.0);
        self.robot.advance(code.map(|code| f64::from((code - 2048.0) * A_PER_CODE)));
        let row = LoadRow {
            index: self.tick as u32,
            counts: counts.map(|count| count as i32),
            command_code: code.map(|code| code as u16),
        };
        if !core::mem::take(&mut self.lose) {
            let piece = self.identifier.push(&row);
            self.hear(piece.news);
        }
        while self.identifier.has_work() {
            let piece = self.identifier.advance();
            self.hear(piece.news);
        }
        self.tick += 1;
    }

    fn hear(&mut self, news: Option<LoadNews>) {
        let Some(news) = news else { return };
        self.news.push((self.tick, news));
        match news {
            LoadNews::Found(estimate) => self.assume(estimate.load()),
            LoadNews::Changed { assumed_kg, .. } => self.assume(self.settings.held(assumed_kg)),
            _ => {}
        }
    }

    fn assume(&mut self, load: Load<f32>) {
        let before = self.assumed.delta_f(UPPER_ARM_M);
        let after = load.delta_f(UPPER_ARM_M);
        self.controller.add_to_f(&core::array::from_fn(|index| after[index] - before[index]));
        self.assumed = load;
    }

    /// Largest true error of both joints in counts.
    pub fn largest_error(&self, rows: Range<usize>) -> [f64; 2] {
        [0, 1].map(|j| self.errors[rows.clone()].iter().map(|error| error[j].abs()).fold(0.0, f64::max))
    }
}

fn controller(believed: &Plant<f32>, settings: &LoadSettings, position_rad: [f64; 2]) -> ComputedTorque<f32> {
    let mut controller = ComputedTorque::new(
        believed.arm,
        believed.drives,
        ComputedTorqueSettings::at_record_period(),
        PERIOD_S as f32,
        position_rad.map(|value| value as f32),
    );
    controller.add_to_f(&settings.assumed().delta_f(UPPER_ARM_M));
    controller
}

fn single(reference: &JointReference<f64>) -> JointReference<f32> {
    let single = |values: [f64; 2]| values.map(|value| value as f32);
    JointReference {
        position_rad: single(reference.position_rad),
        velocity_rad_s: single(reference.velocity_rad_s),
        acceleration_rad_s2: single(reference.acceleration_rad_s2),
    }
}
