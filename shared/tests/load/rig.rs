//! A simulated robot under computed torque with the identification beside it, as on the board: a result enters at once.

use core::ops::Range;

use crate::robot::{
    DEFAULT_GAINS, DELAY_S, GRAVITY, PERIOD_S, Random, Robot, laws, plant, reference, single_precision,
};
use shared::arm::{Arm, Load};
use shared::control::{ComputedTorque, ComputedTorqueInput, ComputedTorqueSettings, JointReference};
use shared::drive::Drive;
use shared::load::{Identifier, LoadNews, LoadRow, LoadSettings, LoadSetup};
use shared::plant::Plant;

/// Where the reference robot's gripper holds a load, in frame 3.
pub const GRASP_M: [f64; 2] = [-0.02, -0.53];
pub const MAXIMUM_KG: f32 = 2.5;

/// An arm with a gripper.
#[derive(Clone, Copy)]
pub struct Carrier {
    empty: Plant<f64>,
    upper_arm_m: f32,
    /// Of the converters, which have 12 bits.
    a_per_code: [f32; 2],
    grasp_m: [f64; 2],
    pub maximum_kg: f32,
}

impl Carrier {
    pub fn reference() -> Self {
        Self {
            empty: plant(),
            upper_arm_m: 0.4318,
            a_per_code: [12.0 / 2048.0; 2],
            grasp_m: GRASP_M,
            maximum_kg: MAXIMUM_KG,
        }
    }

    /// An arm for a desk: its largest load outweighs the forearm, and its motors turn by more counts and speed up faster.
    pub fn light() -> Self {
        let drive = |gear_ratio, counts_per_rev, torque_constant_nm_per_a, current_limit_a, viscous, coulomb| Drive {
            gear_ratio,
            counts_per_rev,
            torque_constant_nm_per_a,
            current_limit_a,
            viscous_friction_nm_s_per_rad: viscous,
            coulomb_friction_nm: coulomb,
            torque_offset_nm: 0.0,
        };
        let f = [0.01434, 0.00684, 0.0096, 0.0, 0.048, 0.0, 0.10312, 0.0, 0.264];
        Self {
            empty: Plant {
                arm: Arm { f, gravity_m_s2: GRAVITY },
                drives: [
                    drive(-100.0, 4096.0, 0.035, 3.0, 2e-5, 0.004),
                    drive(-50.0, 2000.0, 0.025, 2.0, 1.5e-5, 0.003),
                ],
            },
            upper_arm_m: 0.2,
            a_per_code: [5.0 / 2048.0, 4.0 / 2048.0],
            grasp_m: [0.2, 0.0],
            maximum_kg: 0.5,
        }
    }

    /// Settings for a model whose parameters are uniformly off by up to `share`.
    pub fn settings(&self, share: f32) -> LoadSettings {
        let grasp_m = self.grasp_m.map(|value| value as f32);
        let mut settings = LoadSettings::known_grasp(self.maximum_kg, self.upper_arm_m, grasp_m);
        let error = share / 3.0_f32.sqrt();
        let model = single_precision(&self.empty);
        settings.f_standard_error = model.arm.f.map(|f| error * f.abs());
        settings.viscous_standard_error = model.drives.map(|drive| error * drive.viscous_friction_nm_s_per_rad);
        settings.coulomb_standard_error = model.drives.map(|drive| error * drive.coulomb_friction_nm);
        settings
    }

    /// A load of `mass_kg` in the gripper.
    pub fn holding(&self, mass_kg: f64) -> Load<f64> {
        Load { mass_kg, centre_m: self.grasp_m, inertia_kg_m2: 0.0 }
    }

    /// The arm with a load.
    fn with(&self, load: &Load<f64>) -> Plant<f64> {
        let mut plant = self.empty;
        let added = load.delta_f(f64::from(self.upper_arm_m));
        plant.arm.f.iter_mut().zip(added).for_each(|(f, added)| *f += added);
        plant
    }
}

/// Settings of the reference robot for a model whose parameters are uniformly off by up to `share`.
pub fn settings(share: f32) -> LoadSettings {
    Carrier::reference().settings(share)
}

pub struct Rig {
    robot: Robot,
    carrier: Carrier,
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

impl Rig {
    /// The reference robot with a load.
    pub fn new(settings: LoadSettings, load: Load<f64>) -> Self {
        Self::of(Carrier::reference(), settings, load)
    }

    pub fn of(carrier: Carrier, settings: LoadSettings, load: Load<f64>) -> Self {
        let robot = Robot::new(carrier.with(&load), laws(DEFAULT_GAINS, 0.0), true, PERIOD_S);
        let believed = single_precision(&carrier.empty);
        let mut rig = Self {
            controller: controller(&believed, &settings, robot.state.position_rad),
            robot,
            carrier,
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
            a_per_code: self.carrier.a_per_code,
            offset_a: [0.0; 2],
            period_s: PERIOD_S as f32,
            command_delay_s: DELAY_S as f32,
            assumed: self.assumed,
        });
    }

    /// The arm takes up or sets down something: it carries `load` from now on.
    pub fn take(&mut self, load: &Load<f64>) {
        let mut robot = Robot::new(self.carrier.with(load), laws(DEFAULT_GAINS, 0.0), true, PERIOD_S);
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
        let a_per_code = self.carrier.a_per_code;
        let code = [0, 1].map(|j| (output.command_a[j] / a_per_code[j]).round() + 2048.0);
        self.robot.advance([0, 1].map(|j| f64::from((code[j] - 2048.0) * a_per_code[j])));
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
        let [before, after] = [self.assumed, load].map(|load| load.delta_f(self.carrier.upper_arm_m));
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
    controller.add_to_f(&settings.assumed().delta_f(settings.upper_arm_m));
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
