//! The simulated arm at the board's terminals: currents in, encoder edges and measured currents out.

use armid::hidden_robot::HiddenRobot;
use armid::robot::Robot;
use shared::arm::PARAMETERS;
use shared::board::MID_SCALE;
use shared::drive::Drive;
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant, Motion};
use shared::machine::Machine as _;
use shared::plant::{PreparedPlant, State};
use shared::protocol::CurrentScale;

use super::nucleo::Outputs;

/// Longest step of the plant, in ns.
pub const LONGEST_STEP_NS: u64 = 50_000;

/// Largest code of a 12-bit converter.
const LARGEST_CODE: f64 = 4095.0;

/// An encoder edge that is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// When.
    pub at_ns: u64,
    /// Index of the joint.
    pub joint: usize,
    up: bool,
}

/// The time of an arm that does not know when it is recorded, in s: before any instant and interval.
const BEFORE_RECORDING_S: f64 = -1.0;

/// What moves: the plain plant, or one with effects.
#[derive(Debug)]
enum Plant {
    Plain(Box<PreparedPlant<f64>>),
    Extended(Box<ExtendedMachine<f64>>),
}

/// How it moves.
#[derive(Clone, Copy, Debug)]
enum Moving {
    Plain(State<f64>),
    Extended(Motion<f64>),
}

impl Moving {
    fn motors(&self) -> &State<f64> {
        match self {
            Self::Plain(state) => state,
            Self::Extended(motion) => &motion.motor,
        }
    }

    fn hold(&mut self) {
        match self {
            Self::Plain(state) => state.velocity_rad_s = [0.0; 2],
            Self::Extended(motion) => {
                motion.motor.velocity_rad_s = [0.0; 2];
                motion.twist_rate_rad_s = [0.0; 2];
            }
        }
    }
}

/// The arm with its drives. Of effects it has those of motors, friction, shafts and links; not those of encoders and
/// current sensors, nor those that begin with a recording.
///
/// It is always simulated one step ahead, under the currents of now, because only so it is known when within that step
/// an encoder line will change. When the currents change before the step is over, it is taken back and done again.
#[derive(Debug)]
pub struct SimulatedArm {
    plant: Plant,
    /// Without load.
    empty: ExtendedPlant<f64>,
    drives: [Drive<f64>; 2],
    current_scale: [CurrentScale; 2],
    state: Moving,
    state_ns: u64,
    ahead: Moving,
    current_a: [f64; 2],
    powered: bool,
    /// What the encoders have put out because the arm moved.
    counts: [i64; 2],
    /// What they have put out because somebody turned the motor with the arm uncoupled.
    by_hand_counts: [i64; 2],
}

impl SimulatedArm {
    /// At rest at zero angles: upper arm horizontal, forearm up. The brakes hold it.
    pub fn new(robot: &Robot, hidden: &HiddenRobot) -> Self {
        let plain = hidden.plant(robot);
        let empty = ExtendedPlant { plant: plain, effects: hidden.effects().copied().unwrap_or(Effects::OFF) };
        let rest = State::at_rest([0.0; 2]);
        let (plant, state) = match hidden.effects() {
            None => (Plant::Plain(Box::new(plain.prepare())), Moving::Plain(rest)),
            Some(&effects) => {
                let machine = ExtendedMachine::new(&ExtendedPlant { plant: plain, effects });
                let motion = machine.start(rest, BEFORE_RECORDING_S);
                (Plant::Extended(Box::new(machine)), Moving::Extended(motion))
            }
        };
        Self {
            plant,
            empty,
            drives: plain.drives,
            current_scale: [0, 1].map(|joint: usize| CurrentScale::symmetric(robot.joints[joint].current_full_scale_a)),
            state,
            state_ns: 0,
            ahead: state,
            current_a: [0.0; 2],
            powered: false,
            counts: [0; 2],
            by_hand_counts: [0; 2],
        }
    }

    /// The arm carries something from now on that adds `added_f` to its f1..f9; its speed stays.
    pub fn set_load(&mut self, added_f: [f64; PARAMETERS]) {
        let mut extended = self.empty;
        extended.plant.arm.f.iter_mut().zip(added_f).for_each(|(f, added)| *f += added);
        self.plant = match &self.plant {
            Plant::Plain(_) => Plant::Plain(Box::new(extended.plant.prepare())),
            Plant::Extended(_) => Plant::Extended(Box::new(ExtendedMachine::new(&extended))),
        };
    }

    /// Until when the arm has been simulated.
    pub fn ahead_ns(&self) -> u64 {
        self.state_ns + LONGEST_STEP_NS
    }

    /// Joint angles in rad at the last step.
    pub fn position_rad(&self) -> [f64; 2] {
        self.state.motors().position_rad
    }

    /// The step is over.
    pub fn advance(&mut self, at_ns: u64) {
        self.state = self.after(at_ns.saturating_sub(self.state_ns));
        self.state_ns = at_ns;
        self.ahead = self.after(LONGEST_STEP_NS);
    }

    /// The board puts something else out.
    pub fn apply(&mut self, at_ns: u64, outputs: &Outputs) {
        self.advance(at_ns);
        self.powered = outputs.amplifiers_enabled;
        self.current_a = [0, 1].map(|joint| {
            // An output that is switched off floats to ground, which the conditioning turns into full negative current.
            let code = outputs.command_code[joint].unwrap_or(0);
            let limit_a = self.drives[joint].current_limit_a;
            if self.powered { self.current_scale[joint].command_a(code).clamp(-limit_a, limit_a) } else { 0.0 }
        });
        if !self.powered {
            // The brakes engage when power goes, and hold at once.
            self.state.hold();
        }
        self.ahead = self.after(LONGEST_STEP_NS);
    }

    /// What the current sensors show, as codes of the board's converter.
    pub fn current_codes(&self) -> [u16; 2] {
        [0, 1].map(|joint| {
            let CurrentScale { adc_a_per_code, adc_offset_a, .. } = self.current_scale[joint];
            let code = (self.current_a[joint] - adc_offset_a) / adc_a_per_code + f64::from(MID_SCALE);
            code.round().clamp(0.0, LARGEST_CODE) as u16
        })
    }

    /// The next edge within the step ahead.
    pub fn next_edge(&self) -> Option<Edge> {
        [0, 1].into_iter().filter_map(|joint| self.edge(joint)).min_by_key(|edge| edge.at_ns)
    }

    fn edge(&self, joint: usize) -> Option<Edge> {
        let per_rad = self.drives[joint].counts_per_rad();
        let [from, to] = [&self.state, &self.ahead].map(|state| state.motors().position_rad[joint] * per_rad);
        // All cells of an encoder are one count wide.
        let shown = self.counts[joint] as f64;
        let (up, boundary) = match to.floor() {
            cell if cell > shown => (true, shown + 1.0),
            cell if cell < shown => (false, shown),
            _ => return None,
        };
        let share = if to == from { 0.0 } else { ((boundary - from) / (to - from)).clamp(0.0, 1.0) };
        Some(Edge { at_ns: self.state_ns + (share * LONGEST_STEP_NS as f64) as u64, joint, up })
    }

    /// Lets an edge happen; returns the levels of the joint's two channels after it.
    pub fn pass(&mut self, edge: Edge) -> [bool; 2] {
        self.counts[edge.joint] += if edge.up { 1 } else { -1 };
        self.levels(edge.joint)
    }

    /// Somebody turns a motor by one edge, with the arm uncoupled; returns the levels of its two channels after it.
    pub fn turn_by_hand(&mut self, joint: usize, up: bool) -> [bool; 2] {
        self.by_hand_counts[joint] += if up { 1 } else { -1 };
        self.levels(joint)
    }

    /// The levels of a joint's two channels: the first leads when the count goes up.
    pub fn levels(&self, joint: usize) -> [bool; 2] {
        match (self.counts[joint] + self.by_hand_counts[joint]).rem_euclid(4) {
            0 => [false, false],
            1 => [true, false],
            2 => [true, true],
            _ => [false, true],
        }
    }

    fn after(&self, duration_ns: u64) -> Moving {
        if !self.powered || duration_ns == 0 {
            return self.state;
        }
        let duration_s = duration_ns as f64 * 1e-9;
        match (&self.plant, &self.state) {
            (Plant::Plain(plant), Moving::Plain(state)) => {
                let torque_nm = [0, 1].map(|joint: usize| self.drives[joint].motor_torque_nm(self.current_a[joint]));
                Moving::Plain(plant.step(state, torque_nm, duration_s))
            }
            (Plant::Extended(machine), Moving::Extended(motion)) => {
                let held = machine.fresh(machine.input(self.current_a), [0.0; 2]);
                let next = machine.step(motion, &held, duration_s);
                Moving::Extended(Motion { time_s: BEFORE_RECORDING_S, ..next })
            }
            // Both were made together.
            (_, &state) => state,
        }
    }
}
