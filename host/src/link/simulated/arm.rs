//! The arm of a simulated board with its amplifiers: plain, or with effects.

use shared::arm::PARAMETERS;
use shared::drive::Drive;
use shared::effects::{ExtendedMachine, ExtendedPlant, Motion};
use shared::machine::Machine as _;
use shared::plant::{Plant, PreparedPlant, State};

use crate::hidden_robot::HiddenRobot;
use crate::robot::Robot;

/// Longest step of the plant: finer than the models judged by it need to be, for friction lets go of a motor, and a gap's
/// teeth meet, within one.
const LONGEST_STEP_NS: u64 = 25_000;

/// The time of an arm that is not being recorded, s: before any instant and interval.
const BEFORE_RECORDING_S: f64 = -1.0;

/// An arm and its amplifiers.
pub(super) enum SimulatedArm {
    /// Rigid, with ideal amplifiers and encoders.
    Plain(Box<PlainArm>),
    /// With effects.
    Extended(Box<ExtendedArm>),
}

pub(super) struct PlainArm {
    /// Without load.
    empty: Plant<f64>,
    plant: PreparedPlant<f64>,
    drives: [Drive<f64>; 2],
    state: State<f64>,
    current_a: [f64; 2],
}

pub(super) struct ExtendedArm {
    /// Without load.
    empty: ExtendedPlant<f64>,
    machine: ExtendedMachine<f64>,
    motion: Motion<f64>,
    input_a: [f64; 2],
    recording: bool,
}

impl SimulatedArm {
    /// The arm of `hidden`, at rest at zero angles.
    pub fn new(robot: &Robot, hidden: &HiddenRobot) -> Self {
        let plant: Plant<f64> = hidden.plant(robot);
        let state = State::at_rest([0.0; 2]);
        match hidden.effects() {
            None => Self::Plain(Box::new(PlainArm {
                empty: plant,
                plant: plant.prepare(),
                drives: plant.drives,
                state,
                current_a: [0.0; 2],
            })),
            Some(&effects) => {
                let empty = ExtendedPlant { plant, effects };
                let machine = ExtendedMachine::new(&empty);
                let motion = machine.start(state, BEFORE_RECORDING_S);
                Self::Extended(Box::new(ExtendedArm { empty, machine, motion, input_a: [0.0; 2], recording: false }))
            }
        }
    }

    /// The arm carries something else from now on: what it adds to f1..f9. Its speed stays, as if the gripper had closed on
    /// something that moved along with it.
    pub fn set_load(&mut self, added_f: [f64; PARAMETERS]) {
        let with_load = |empty: &Plant<f64>| {
            let mut plant = *empty;
            plant.arm.f.iter_mut().zip(added_f).for_each(|(f, added)| *f += added);
            plant
        };
        match self {
            Self::Plain(arm) => arm.plant = with_load(&arm.empty).prepare(),
            Self::Extended(arm) => {
                let plant = with_load(&arm.empty.plant);
                arm.machine = ExtendedMachine::new(&ExtendedPlant { plant, effects: arm.empty.effects });
            }
        }
    }

    /// Where the encoders see the motors, in counts, before truncation.
    pub fn position_counts(&self) -> [f64; 2] {
        match self {
            Self::Plain(arm) => {
                std::array::from_fn(|joint| arm.state.position_rad[joint] * arm.drives[joint].counts_per_rad())
            }
            Self::Extended(arm) => arm.machine.position_counts(&arm.motion),
        }
    }

    /// Current that flows, A.
    pub fn current_a(&self) -> [f64; 2] {
        match self {
            Self::Plain(arm) => arm.current_a,
            Self::Extended(arm) => arm.motion.current_a,
        }
    }

    /// The amplifiers are off and the brakes hold.
    pub fn brake(&mut self) {
        match self {
            Self::Plain(arm) => {
                arm.current_a = [0.0; 2];
                arm.state.velocity_rad_s = [0.0; 2];
            }
            Self::Extended(arm) => {
                arm.input_a = [0.0; 2];
                arm.motion.current_a = [0.0; 2];
                arm.motion.motor.velocity_rad_s = [0.0; 2];
                arm.motion.twist_rate_rad_s = [0.0; 2];
            }
        }
    }

    /// A new command for both amplifiers, A.
    pub fn command(&mut self, command_a: [f64; 2]) {
        match self {
            Self::Plain(arm) => {
                arm.current_a = std::array::from_fn(|joint| {
                    let limit = arm.drives[joint].current_limit_a;
                    command_a[joint].clamp(-limit, limit)
                });
            }
            Self::Extended(arm) => arm.input_a = arm.machine.input(command_a),
        }
    }

    /// Whether what happens now is recorded: the time of effects that have one begins with the recording.
    pub fn set_recording(&mut self, recording: bool) {
        if let Self::Extended(arm) = self {
            if recording != arm.recording {
                arm.motion.time_s = if recording { 0.0 } else { BEFORE_RECORDING_S };
            }
            arm.recording = recording;
        }
    }

    /// Lets the arm move for `duration_ns`, with a torque at each motor beside the amplifiers', N m.
    pub fn advance(&mut self, duration_ns: u64, added_torque_nm: [f64; 2]) {
        match self {
            Self::Plain(arm) => {
                let steps = duration_ns.div_ceil(LONGEST_STEP_NS);
                let torque_nm = std::array::from_fn(|joint| {
                    arm.drives[joint].motor_torque_nm(arm.current_a[joint]) + added_torque_nm[joint]
                });
                for _ in 0..steps {
                    arm.state = arm.plant.step(&arm.state, torque_nm, duration_ns as f64 * 1e-9 / steps as f64);
                }
            }
            Self::Extended(arm) => {
                let steps = duration_ns.div_ceil(LONGEST_STEP_NS);
                let held = arm.machine.fresh(arm.input_a, added_torque_nm);
                for _ in 0..steps {
                    arm.motion = arm.machine.step(&arm.motion, &held, duration_ns as f64 * 1e-9 / steps as f64);
                    if !arm.recording {
                        arm.motion.time_s = BEFORE_RECORDING_S;
                    }
                }
            }
        }
    }
}
