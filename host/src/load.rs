//! Identification of a load with a board: what it is told, what it says about the load, and the same identification on this
//! computer.

use std::time::{Duration, Instant};

use shared::arm::PARAMETERS;
use shared::load::{Identifier, LoadEstimate, LoadNews, LoadRow, LoadSettings, LoadSetup};
use shared::protocol::{CurrentScale, LoadReport, Reply, Request, Sample};

use crate::client::{Client, ClientError, MovementWatcher};
use crate::model::Model;
use crate::robot::{Gripper, Robot};

/// Standard error of a model's parameter that the model does not state, as a share of it.
const UNSTATED_ERROR: f64 = 0.01;

/// Largest standard error believed, as a share of the parameter: an infinite one, of a parameter that the recordings do not
/// tell, would leave every load open that this parameter resembles.
const LARGEST_ERROR: f64 = 0.3;

/// How far from the axis of joint 3 a load's centre may be at most, in distances of the grasp, and at least, m.
const REACH: f64 = 2.0;
const LEAST_REACH_M: f64 = 0.1;

/// Settings for loads in `gripper`, with the standard errors of `model`: a share of 1 % where it states none.
pub fn settings(robot: &Robot, model: &Model, gripper: &Gripper) -> LoadSettings {
    let error = |value: f64, stated: Option<f64>| {
        stated.unwrap_or(UNSTATED_ERROR * value.abs()).clamp(0.0, LARGEST_ERROR * value.abs().max(1e-3)) as f32
    };
    let pair = |values: &[f64], errors: &Option<Vec<f64>>| {
        std::array::from_fn(|joint| {
            let value = values.get(joint).copied().unwrap_or(0.0);
            error(value, errors.as_ref().and_then(|errors| errors.get(joint)).copied())
        })
    };
    let f: [f32; PARAMETERS] =
        std::array::from_fn(|index| error(model.f[index], model.f_standard_error.map(|errors| errors[index])));
    let [x, y] = gripper.grasp_m;
    LoadSettings {
        f_standard_error: f,
        viscous_standard_error: pair(&model.viscous_nm_s_per_rad, &model.viscous_standard_error),
        coulomb_standard_error: pair(&model.coulomb_nm, &model.coulomb_standard_error),
        reach_m: (REACH * x.hypot(y)).max(LEAST_REACH_M) as f32,
        ..LoadSettings::known_grasp(
            gripper.maximum_load_kg as f32,
            robot.upper_arm_m as f32,
            gripper.grasp_m.map(|value| value as f32),
        )
    }
}

/// What the board makes of `settings` and its model, for the same identification elsewhere.
pub fn setup(robot: &Robot, model: &Model, settings: &LoadSettings) -> LoadSetup {
    let scale = [0, 1].map(|joint: usize| CurrentScale::symmetric(robot.joints[joint].current_full_scale_a));
    LoadSetup {
        settings: *settings,
        f: model.f.map(|f| f as f32),
        gravity_m_s2: robot.gravity_m_s2 as f32,
        drives: [0, 1].map(|joint: usize| {
            let drive = robot.joints[joint].drive();
            let friction = |values: &[f64]| values.get(joint).copied().unwrap_or(0.0) as f32;
            shared::drive::Drive {
                gear_ratio: drive.gear_ratio as f32,
                counts_per_rev: drive.counts_per_rev as f32,
                torque_constant_nm_per_a: drive.torque_constant_nm_per_a as f32,
                current_limit_a: drive.current_limit_a as f32,
                viscous_friction_nm_s_per_rad: friction(&model.viscous_nm_s_per_rad),
                coulomb_friction_nm: friction(&model.coulomb_nm),
                torque_offset_nm: 0.0,
            }
        }),
        a_per_code: scale.map(|scale| scale.dac_a_per_code as f32),
        offset_a: scale.map(|scale| scale.dac_offset_a as f32),
        period_s: robot.record_period_s as f32,
        command_delay_s: robot.command_delay_s as f32,
        assumed: settings.assumed(),
    }
}

/// What the identification sees of a row.
pub fn row(sample: &Sample) -> LoadRow {
    LoadRow {
        index: sample.index,
        counts: [0, 1].map(|joint: usize| sample.reference_counts[joint] - i32::from(sample.error_counts[joint])),
        command_code: sample.command_code,
    }
}

impl Client {
    /// Has the board identify loads from the next movement under computed torque on.
    pub fn identify_load(&mut self, settings: &LoadSettings) -> Result<LoadReport, ClientError> {
        self.load_reply(Request::IdentifyLoad(*settings))
    }

    /// What the board says about its load.
    pub fn load_report(&mut self) -> Result<LoadReport, ClientError> {
        self.load_reply(Request::ReadLoad)
    }

    fn load_reply(&mut self, request: Request) -> Result<LoadReport, ClientError> {
        match self.request(request)? {
            Reply::Load(report) => Ok(report),
            _ => Err(ClientError::Unexpected { request: "identifying loads" }),
        }
    }
}

/// Something that was told about the load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// When: seconds on the board's clock, from the start of the movement's first row for the identification of this
    /// computer, from the board's start for its own.
    pub at_s: f64,
    /// What.
    pub news: LoadNews,
}

/// Listens to the board's identification.
pub struct Listener<'a> {
    period_s: f64,
    /// All that was told, in order.
    pub told: Vec<Told>,
    show: &'a mut dyn FnMut(&Told),
}

impl<'a> Listener<'a> {
    /// Shows everything as it is told.
    pub fn new(robot: &Robot, show: &'a mut dyn FnMut(&Told)) -> Self {
        Self { period_s: robot.loop_period_s, told: Vec::new(), show }
    }
}

impl MovementWatcher for Listener<'_> {
    fn load(&mut self, tick: u64, news: &LoadNews) {
        let told = Told { at_s: tick as f64 * self.period_s, news: *news };
        (self.show)(&told);
        self.told.push(told);
    }
}

/// Identifies from the stream on this computer, and has the board use the result.
pub struct HostIdentifier<'a> {
    identifier: Box<Identifier>,
    settings: LoadSettings,
    period_s: f64,
    /// All that came of it, in order.
    pub told: Vec<Told>,
    /// How long each search took on this computer.
    pub searched: Vec<Duration>,
    show: &'a mut dyn FnMut(&Told),
}

impl<'a> HostIdentifier<'a> {
    /// One for a movement that is about to begin.
    pub fn new(setup: &LoadSetup, show: &'a mut dyn FnMut(&Told)) -> Self {
        let mut identifier = Box::new(Identifier::new());
        identifier.begin(setup);
        let (settings, period_s) = (setup.settings, f64::from(setup.period_s));
        Self { identifier, settings, period_s, told: Vec::new(), searched: Vec::new(), show }
    }

    fn hear(&mut self, row: &LoadRow, news: Option<LoadNews>) -> Option<Request> {
        let news = news?;
        let told = Told { at_s: f64::from(row.index) * self.period_s, news };
        (self.show)(&told);
        self.told.push(told);
        match news {
            LoadNews::Found(estimate) => Some(Request::UseLoad(estimate)),
            LoadNews::Changed { assumed_kg, .. } => {
                let load = self.settings.held(assumed_kg);
                let (centre_m, inertia_kg_m2) = (load.centre_m, load.inertia_kg_m2);
                let assumed = LoadEstimate { mass_kg: load.mass_kg, centre_m, inertia_kg_m2, ..LoadEstimate::NONE };
                Some(Request::UseLoad(assumed))
            }
            _ => None,
        }
    }
}

impl MovementWatcher for HostIdentifier<'_> {
    fn row(&mut self, sample: &Sample) -> Option<Request> {
        let row = row(sample);
        let pushed = self.identifier.push(&row);
        let mut request = self.hear(&row, pushed.news);
        if self.identifier.has_work() {
            let began = Instant::now();
            let mut news = None;
            while self.identifier.has_work() {
                news = self.identifier.advance().news.or(news);
            }
            self.searched.push(began.elapsed());
            request = self.hear(&row, news).or(request);
        }
        request
    }
}
