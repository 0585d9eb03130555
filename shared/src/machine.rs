//! What a replay moves: the plain plant, or one with effects beyond it. The replays know only this interface, so both
//! are integrated, sampled and corrected in the same way, and the plain plant pays nothing for what it does not have.

use core::fmt::Debug;

use crate::drive::Drive;
use crate::plant::{Plant, PreparedPlant, State};
use crate::scalar::Scalar;

/// A plant with everything between the commanded current and the encoder's count.
pub trait Machine<S: Scalar>: Copy + Debug {
    /// Everything that changes while it moves.
    type Motion: Copy + Debug;
    /// What acts on it during one step.
    type Held: Copy;

    /// `value` in the number type.
    fn number(&self, value: f64) -> S;

    /// Encoder counts per radian of each joint.
    fn counts_per_rad(&self) -> [S; 2];

    /// The motion that starts at `state`, `time_s` after the start of the recording.
    fn start(&self, state: State<S>, time_s: f64) -> Self::Motion;

    /// Position and velocity of the motors, as joint angles.
    fn state(&self, motion: &Self::Motion) -> State<S>;

    /// Where the encoders see the motors, in counts, before truncation.
    fn position_counts(&self, motion: &Self::Motion) -> [S; 2];

    /// What the amplifiers make of a commanded current at once: the part of it that is held until the next command.
    fn input(&self, command_a: [S; 2]) -> [S; 2];

    /// `motion` before its first step, if `input` had acted for long.
    fn begun(&self, motion: &Self::Motion, input: [S; 2]) -> Self::Motion;

    /// A step that begins under the input before and ends under a new one, `share` of it under the one before; with a
    /// known motor torque in N m beside both.
    fn held(&self, share: S, previous: [S; 2], input: [S; 2], added_torque_nm: [S; 2]) -> Self::Held;

    /// A step under one input, with a known motor torque in N m beside it.
    fn fresh(&self, input: [S; 2], added_torque_nm: [S; 2]) -> Self::Held;

    /// One step of the implicit midpoint rule ([`PreparedPlant::step`]).
    fn step(&self, motion: &Self::Motion, held: &Self::Held, period_s: S) -> Self::Motion;

    /// One step of symplectic Euler ([`PreparedPlant::step_symplectic`]).
    fn step_symplectic(&self, motion: &Self::Motion, held: &Self::Held, period_s: S) -> Self::Motion;

    /// The first step of symplectic Euler ([`PreparedPlant::start_symplectic`]).
    fn start_symplectic(&self, motion: &Self::Motion, held: &Self::Held, period_s: S) -> Self::Motion;

    /// `motion` with the motors' positions and velocities moved on.
    fn corrected(&self, motion: &Self::Motion, position_rad: [S; 2], velocity_rad_s: [S; 2]) -> Self::Motion;
}

/// A plant as it is described, before it is made ready to move.
pub trait Movable {
    /// The type of its numbers.
    type Number: Scalar;
    /// What it becomes.
    type Machine: Machine<Self::Number>;

    /// The plant made ready to move.
    fn machine(&self) -> Self::Machine;
}

impl<S: Scalar> Movable for Plant<S> {
    type Number = S;
    type Machine = PlainMachine<S>;

    #[inline(always)]
    fn machine(&self) -> PlainMachine<S> {
        PlainMachine::new(self)
    }
}

/// The plain plant as a machine: rigid arm, ideal amplifiers and encoders. Its input is the motor torque in N m.
#[derive(Clone, Copy, Debug)]
pub struct PlainMachine<S> {
    plant: PreparedPlant<S>,
    drives: [Drive<S>; 2],
    counts_per_rad: [S; 2],
}

impl<S: Scalar> PlainMachine<S> {
    /// The machine of `plant`.
    pub fn new(plant: &Plant<S>) -> Self {
        Self {
            plant: plant.prepare(),
            drives: plant.drives,
            counts_per_rad: [plant.drives[0].counts_per_rad(), plant.drives[1].counts_per_rad()],
        }
    }
}

impl<S: Scalar> Machine<S> for PlainMachine<S> {
    type Motion = State<S>;
    type Held = [S; 2];

    #[inline(always)]
    fn number(&self, value: f64) -> S {
        self.counts_per_rad[0].constant(value)
    }

    #[inline(always)]
    fn counts_per_rad(&self) -> [S; 2] {
        self.counts_per_rad
    }

    #[inline(always)]
    fn start(&self, state: State<S>, _time_s: f64) -> State<S> {
        state
    }

    #[inline(always)]
    fn state(&self, motion: &State<S>) -> State<S> {
        *motion
    }

    #[inline(always)]
    fn position_counts(&self, motion: &State<S>) -> [S; 2] {
        [motion.position_rad[0] * self.counts_per_rad[0], motion.position_rad[1] * self.counts_per_rad[1]]
    }

    #[inline(always)]
    fn input(&self, command_a: [S; 2]) -> [S; 2] {
        [self.drives[0].motor_torque_nm(command_a[0]), self.drives[1].motor_torque_nm(command_a[1])]
    }

    #[inline(always)]
    fn begun(&self, motion: &State<S>, _input: [S; 2]) -> State<S> {
        *motion
    }

    #[inline(always)]
    fn held(&self, share: S, previous: [S; 2], input: [S; 2], added_torque_nm: [S; 2]) -> [S; 2] {
        [
            share.mul_add(previous[0] - input[0], input[0] + added_torque_nm[0]),
            share.mul_add(previous[1] - input[1], input[1] + added_torque_nm[1]),
        ]
    }

    #[inline(always)]
    fn fresh(&self, input: [S; 2], added_torque_nm: [S; 2]) -> [S; 2] {
        [input[0] + added_torque_nm[0], input[1] + added_torque_nm[1]]
    }

    #[inline(always)]
    fn step(&self, motion: &State<S>, held: &[S; 2], period_s: S) -> State<S> {
        self.plant.step(motion, *held, period_s)
    }

    #[inline(always)]
    fn step_symplectic(&self, motion: &State<S>, held: &[S; 2], period_s: S) -> State<S> {
        self.plant.step_symplectic(motion, *held, period_s)
    }

    #[inline(always)]
    fn start_symplectic(&self, motion: &State<S>, held: &[S; 2], period_s: S) -> State<S> {
        self.plant.start_symplectic(motion, *held, period_s)
    }

    #[inline(always)]
    fn corrected(&self, motion: &State<S>, position_rad: [S; 2], velocity_rad_s: [S; 2]) -> State<S> {
        let (q, v) = (motion.position_rad, motion.velocity_rad_s);
        State {
            position_rad: [q[0] + position_rad[0], q[1] + position_rad[1]],
            velocity_rad_s: [v[0] + velocity_rad_s[0], v[1] + velocity_rad_s[1]],
        }
    }
}
