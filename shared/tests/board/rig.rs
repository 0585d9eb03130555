//! A simulated arm around the board: what the firmware's pins are connected to.

use shared::arm::{Arm, REFERENCE_F};
use shared::board::{Board, DEFAULT_SAMPLES, Inputs, MID_SCALE, Outputs, Telemetry};
use shared::drive::Drive;
use shared::plant::{Plant, PreparedPlant, State};
use shared::protocol::*;
use shared::trajectory::{MotionLimits, Paper, Trajectory};

/// The paper's T.
pub const PAPER_PERIOD_NS: u64 = 3_650_000_000;

/// Longest step of the plant in ns.
const PLANT_STEP_NS: u64 = 50_000;

/// The reference robot with gains of half the stability limit, as in design §4.
pub fn configuration() -> Configuration {
    let second = JointConstants {
        gear_ratio: 107.8,
        counts_per_rev: 800.0,
        torque_constant_nm_per_a: 0.25,
        current_limit_a: 12.0,
        position_gain_a_per_count: 0.036,
        lead: 0.0,
        viscous_friction_nm_s_per_rad: 0.817e-3,
        coulomb_friction_nm: 0.124,
        least_motor_inertia_kg_m2: 2.0e-4,
        following_error_limit_counts: 2000.0,
        speed_limit_rad_s: 6.0,
        over_current_limit_a: 14.0,
        current_scale: CurrentScale::symmetric(16.0),
    };
    let third = JointConstants {
        gear_ratio: -53.7,
        counts_per_rev: 1000.0,
        position_gain_a_per_count: 0.048,
        viscous_friction_nm_s_per_rad: 1.38e-3,
        coulomb_friction_nm: 0.146,
        least_motor_inertia_kg_m2: 3.0e-4,
        ..second
    };
    Configuration {
        joints: [second, third],
        common: LoopConstants {
            gravity_m_s2: 9.81,
            loop_period_ns: 700_000,
            record_period_ns: 700_000,
            command_delay_ns: 30_000,
            link_timeout_ns: 500_000_000,
            current_limit_time_ns: 100_000_000,
            stop_time_ns: 200_000_000,
            computed_torque: ComputedTorqueConstants::default(),
        },
        motion_limits: MotionLimits::reference_robot(),
        model_range: ModelRange::default(),
    }
}

/// The model of the simulated arm itself.
pub fn exact_model() -> Model {
    let configuration = configuration();
    Model {
        robot_identity: configuration.robot_identity(),
        f: REFERENCE_F,
        viscous_friction_nm_s_per_rad: configuration.joints.map(|joint| joint.viscous_friction_nm_s_per_rad),
        coulomb_friction_nm: configuration.joints.map(|joint| joint.coulomb_friction_nm),
        compensation: [JointCompensation::NONE; 2],
    }
}

pub fn identity() -> BoardIdentity {
    BoardIdentity {
        firmware_version: "0.1.0".parse().unwrap(),
        git_revision: "0123456".parse().unwrap(),
        board: "test".parse().unwrap(),
        chip_id: [7; 12],
        chip_revision: 3,
        reset_cause: ResetCause::PowerOn,
    }
}

pub struct Rig {
    pub board: Board<Vec<PackedSample>>,
    pub configuration: Configuration,
    plant: PreparedPlant<f64>,
    drives: [Drive<f64>; 2],
    pub state: State<f64>,
    /// Where the counters stand at position 0.
    pub counter_offset: [i32; 2],
    /// What the next tick's inputs are replaced with, if anything.
    pub tamper: Option<fn(&mut Inputs)>,
    /// Current that flows now.
    current_a: [f64; 2],
    sequence: u32,
    /// Loop ticks between keep-alives; 0 for none.
    pub keep_alive_every: u32,
    ticks: u32,
    /// Everything that left the board.
    pub streamed: Vec<Telemetry>,
    pub events: Vec<Mode>,
    /// Exact motor positions at every streamed row.
    pub true_positions: Vec<[f64; 2]>,
}

impl Rig {
    /// A board and a resting arm; nothing sent yet but a hello.
    pub fn bare(configuration: Configuration) -> Self {
        let drives = configuration.joints.map(|joint| Drive {
            gear_ratio: joint.gear_ratio,
            counts_per_rev: joint.counts_per_rev,
            torque_constant_nm_per_a: joint.torque_constant_nm_per_a,
            current_limit_a: 40.0,
            viscous_friction_nm_s_per_rad: joint.viscous_friction_nm_s_per_rad,
            coulomb_friction_nm: joint.coulomb_friction_nm,
            torque_offset_nm: 0.0,
        });
        let arm = Arm { f: REFERENCE_F, gravity_m_s2: configuration.common.gravity_m_s2 };
        let mut rig = Self {
            board: Board::new(identity(), vec![PackedSample::EMPTY; DEFAULT_SAMPLES]),
            configuration,
            plant: Plant { arm, drives }.prepare(),
            drives,
            state: State::at_rest([-0.3, 0.4]),
            counter_offset: [12_345, -678],
            tamper: None,
            current_a: [0.0; 2],
            sequence: 0,
            keep_alive_every: 100,
            ticks: 0,
            streamed: Vec::new(),
            events: Vec::new(),
            true_positions: Vec::new(),
        };
        rig.ok(Request::Hello { protocol_version: PROTOCOL_VERSION });
        rig
    }

    /// Configured, at a known pose, still idle.
    pub fn configured(configuration: Configuration) -> Self {
        let mut rig = Self::bare(configuration);
        rig.configure();
        rig.tick();
        let position_rad = rig.state.position_rad;
        rig.ok(Request::SetPosition { position_rad });
        rig
    }

    /// With the paper's trajectory accepted.
    pub fn loaded(configuration: Configuration) -> Self {
        let mut rig = Self::configured(configuration);
        rig.load_paper(PAPER_PERIOD_NS);
        rig
    }

    /// Armed, with the paper's trajectory accepted.
    pub fn armed(configuration: Configuration) -> Self {
        let mut rig = Self::loaded(configuration);
        rig.ok(Request::Arm);
        rig
    }

    /// Running under the position loop, a second into the paper's trajectory.
    pub fn running(configuration: Configuration) -> Self {
        let mut rig = Self::armed(configuration);
        rig.run(ControlLaw::Position);
        rig.until(|mode| matches!(mode, Mode::Running(_)));
        rig.seconds(1.0);
        rig
    }

    pub fn configure(&mut self) {
        for part in self.configuration.parts() {
            self.ok(Request::Configure(part));
        }
        let crc = self.configuration.crc();
        self.ok(Request::ApplyConfiguration { crc });
    }

    pub fn load_paper(&mut self, period_ns: u64) {
        self.ok(Request::LoadTrajectory(TrajectoryPart::Paper(Paper { period_ns })));
        let state = self.checked();
        assert!(matches!(state, TrajectoryState::Accepted { .. }), "{state:?}");
    }

    /// Waits for the end of the check of a trajectory.
    pub fn checked(&mut self) -> TrajectoryState {
        for _ in 0..200_000 {
            match self.send(Request::ReadTrajectory) {
                Reply::Trajectory(TrajectoryState::Checking { .. }) => self.tick(),
                Reply::Trajectory(state) => return state,
                other => panic!("{other:?}"),
            };
        }
        panic!("the check does not end")
    }

    pub fn upload(&mut self, model: Model) {
        let crc = model.crc();
        self.ok(Request::StageModel { model, crc });
        self.ok(Request::CommitModel { crc });
    }

    pub fn run(&mut self, law: ControlLaw) -> Reply {
        self.ok(Request::Run { law, stream: true, settle_ns: 1_000_000_000 })
    }

    /// The next request over USB, whatever the reply.
    pub fn send(&mut self, request: Request) -> Reply {
        self.sequence += 1;
        self.board.handle(Link::Usb, self.sequence, &request)
    }

    /// The next request over USB, which must not be refused.
    pub fn ok(&mut self, request: Request) -> Reply {
        match self.send(request.clone()) {
            Reply::Refused(refusal) => panic!("{request:?} refused: {refusal}"),
            reply => reply,
        }
    }

    /// The next request over USB, which must be refused.
    pub fn refused(&mut self, request: Request) -> Refusal {
        match self.send(request.clone()) {
            Reply::Refused(refusal) => refusal,
            reply => panic!("{request:?} answered {reply:?}"),
        }
    }

    pub fn inputs(&self) -> Inputs {
        let mut counts = [0; 2];
        let mut current_code = [0; 2];
        for joint in 0..2 {
            let exact = self.state.position_rad[joint] * self.drives[joint].counts_per_rad();
            counts[joint] = self.counter_offset[joint].wrapping_add(exact.floor() as i32);
            let scale = self.configuration.joints[joint].current_scale;
            let code = (self.current_a[joint] - scale.adc_offset_a) / scale.adc_a_per_code + f64::from(MID_SCALE);
            current_code[joint] = code.round().clamp(0.0, 4095.0) as u16;
        }
        Inputs { counts, current_code, emergency_stop: false, deadline_missed: false }
    }

    /// One loop period: the board's tick, then the plant. With the amplifiers off the brakes hold the arm.
    pub fn tick(&mut self) -> Outputs {
        self.ticks += 1;
        if self.keep_alive_every != 0 && self.ticks.is_multiple_of(self.keep_alive_every) {
            self.ok(Request::KeepAlive);
        }
        let mut inputs = self.inputs();
        if let Some(tamper) = self.tamper.take() {
            tamper(&mut inputs);
        }
        let outputs = self.board.tick(&inputs);
        self.board.advance_check();
        assert_eq!(outputs.amplifier_enable, self.board.mode().is_powered());
        if !outputs.amplifier_enable {
            assert_eq!(outputs.command_code, [MID_SCALE; 2], "only mid-scale while the amplifiers are off");
        }
        if let Some(telemetry) = outputs.telemetry {
            self.streamed.push(telemetry);
            let counts = |joint: usize| self.state.position_rad[joint] * self.drives[joint].counts_per_rad();
            self.true_positions.push([counts(0), counts(1)]);
        }
        if let Some(Event::Mode { mode, .. }) = outputs.event {
            self.events.push(mode);
        }
        self.move_arm(&outputs);
        outputs
    }

    fn move_arm(&mut self, outputs: &Outputs) {
        let common = &self.configuration.common;
        let (delay_ns, period_ns) = (u64::from(common.command_delay_ns), u64::from(common.loop_period_ns));
        if !outputs.amplifier_enable {
            self.current_a = [0.0; 2];
            self.state = State::at_rest(self.state.position_rad);
            return;
        }
        self.integrate(delay_ns);
        for joint in 0..2 {
            let scale = self.configuration.joints[joint].current_scale;
            self.current_a[joint] = scale.command_a(outputs.command_code[joint]);
        }
        self.integrate(period_ns - delay_ns);
    }

    fn integrate(&mut self, duration_ns: u64) {
        let torque = [0, 1].map(|joint: usize| self.drives[joint].motor_torque_nm(self.current_a[joint]));
        let steps = duration_ns.div_ceil(PLANT_STEP_NS).max(1);
        let step_s = duration_ns as f64 * 1.0e-9 / steps as f64;
        for _ in 0..steps {
            self.state = self.plant.step(&self.state, torque, step_s);
        }
    }

    pub fn seconds(&mut self, seconds: f64) {
        let period_s = f64::from(self.configuration.common.loop_period_ns) * 1.0e-9;
        for _ in 0..(seconds / period_s) as u32 {
            self.tick();
        }
    }

    /// Ticks until one switches off, which it returns; at most 20 s. `each` sees every tick before.
    pub fn until_off(&mut self, mut each: impl FnMut(&mut Self, &Outputs)) -> Outputs {
        let ticks = 20_000_000_000 / u64::from(self.configuration.common.loop_period_ns);
        for _ in 0..ticks {
            let outputs = self.tick();
            if !outputs.amplifier_enable {
                return outputs;
            }
            each(self, &outputs);
        }
        panic!("still {:?} after 20 s", self.board.mode());
    }

    /// Ticks until a mode is reached; at most 20 s.
    pub fn until(&mut self, reached: impl Fn(Mode) -> bool) {
        let ticks = 20_000_000_000 / u64::from(self.configuration.common.loop_period_ns);
        for _ in 0..ticks {
            if reached(self.board.mode()) {
                return;
            }
            self.tick();
        }
        panic!("still {:?} after 20 s", self.board.mode());
    }

    /// A whole movement on the accepted trajectory.
    pub fn movement(&mut self, law: ControlLaw) {
        self.streamed.clear();
        self.true_positions.clear();
        self.run(law);
        self.until(|mode| mode == Mode::Holding(law));
    }

    /// The whole recording, read as a host reads it.
    pub fn recording(&mut self) -> Vec<Sample> {
        let Reply::Recording(info) = self.ok(Request::RecordingInfo) else { panic!() };
        let mut samples = Vec::new();
        while samples.len() < info.rows as usize {
            let request = Request::ReadRecording { from: samples.len() as u32, count: u16::MAX };
            let Reply::Rows(rows) = self.ok(request) else { panic!() };
            assert_eq!((rows.movement, rows.from), (info.movement, samples.len() as u32));
            assert!(!rows.rows.is_empty());
            samples.extend(rows.samples());
        }
        samples
    }

    pub fn recording_info(&mut self) -> RecordingInfo {
        let Reply::Recording(info) = self.ok(Request::RecordingInfo) else { panic!() };
        info
    }

    pub fn status(&mut self) -> Status {
        let Reply::Status(status) = self.ok(Request::Status) else { panic!() };
        status
    }
}

/// The reference of the paper's movement in exact counts, `time_ns` after its start.
pub fn paper_counts(configuration: &Configuration, time_ns: u64) -> [f64; 2] {
    let reference = Trajectory::Paper(Paper { period_ns: PAPER_PERIOD_NS }).reference::<f64>(time_ns);
    [0, 1].map(|joint: usize| reference.position_rad[joint] * configuration.joints[joint].counts_per_rad())
}
