//! Computed torque around a simulated arm, seen exactly: what a board's recordings, whole counts, do not show, and what
//! no real board can do, such as encoders that do not round.

use shared::control::{ComputedTorque, ComputedTorqueInput, ComputedTorqueSettings, JointReference};
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant};
use shared::machine::Machine as _;
use shared::plant::{Plant, State};
use shared::protocol::CurrentScale;
use shared::trajectory::Trajectory;

use crate::random::Random;
use crate::robot::Robot;

/// How long the arm stands at the start before it counts, in s.
const SETTLE_S: f64 = 0.5;

/// Longest step of the plant in s.
const LONGEST_STEP_S: f64 = 1e-4;

/// An arm, what its controller takes it for, and what lies between them.
#[derive(Clone, Debug)]
pub struct TrackingLoop {
    /// The arm.
    pub truth: Plant<f64>,
    /// What it has beyond that.
    pub effects: Effects<f64>,
    /// What the controller takes it for.
    pub believed: Plant<f64>,
    /// The controller's bandwidths.
    pub settings: ComputedTorqueSettings<f64>,
    /// Loop period in s.
    pub period_s: f64,
    /// Time from sampling to the new current in s, as it is.
    pub delay_s: f64,
    /// The same as the controller takes it to be.
    pub believed_delay_s: f64,
    /// Whether encoders count whole counts.
    pub encoders_round: bool,
    /// Whether commands are codes of a converter of 12 bits.
    pub converters_round: bool,
    /// Current at full scale of the converters in A.
    pub full_scale_a: [f64; 2],
}

/// How one joint followed a movement.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Followed {
    /// Largest true error in counts, not rounded.
    pub max_counts: f64,
    /// Root mean square of the true error in counts.
    pub rms_counts: f64,
    /// Share of samples whose error, both counts truncated, is −1, 0 or 1.
    pub within_one_count: f64,
    /// What the rounding of the encoders puts into the command, A rms: from its second differences, whose mean square is
    /// six times that of white noise.
    pub command_noise_a: f64,
}

impl TrackingLoop {
    /// `truth` on the drives of `robot`, all as on a board whose model is exact.
    pub fn exact(robot: &Robot, truth: Plant<f64>) -> Self {
        Self {
            truth,
            effects: Effects::OFF,
            believed: truth,
            settings: robot.computed_torque,
            period_s: robot.loop_period_s,
            delay_s: robot.command_delay_s,
            believed_delay_s: robot.command_delay_s,
            encoders_round: true,
            converters_round: true,
            full_scale_a: [0, 1].map(|joint: usize| robot.joints[joint].current_full_scale_a),
        }
    }

    /// With every f of the model off by up to `share` of it, drawn from `random`.
    pub fn with_wrong_f(mut self, share: f64, random: &mut Random) -> Self {
        for f in &mut self.believed.arm.f {
            *f *= 1.0 + random.between(-share, share);
        }
        self
    }

    /// With the model's Coulomb and viscous friction off by up to these shares, drawn from `random`.
    pub fn with_wrong_friction(mut self, coulomb_share: f64, viscous_share: f64, random: &mut Random) -> Self {
        for drive in &mut self.believed.drives {
            drive.coulomb_friction_nm *= 1.0 + random.between(-coulomb_share, coulomb_share);
            drive.viscous_friction_nm_s_per_rad *= 1.0 + random.between(-viscous_share, viscous_share);
        }
        self
    }

    /// Follows a movement once.
    pub fn follow(&self, movement: &Trajectory) -> [Followed; 2] {
        let machine = ExtendedMachine::new(&ExtendedPlant { plant: self.truth, effects: self.effects });
        let scales = self.full_scale_a.map(CurrentScale::symmetric);
        let counts_per_rad = self.truth.drives.each_ref().map(|drive| drive.counts_per_rad());
        let period_ns = (self.period_s * 1e9).round() as u64;
        let ahead_ns = ((0.5 * self.period_s + self.believed_delay_s) * 1e9).round() as u64;
        let standing =
            JointReference { velocity_rad_s: [0.0; 2], acceleration_rad_s2: [0.0; 2], ..movement.reference::<f64>(0) };
        let settling = (SETTLE_S / self.period_s) as u64;
        let samples = movement.record_periods(period_ns);
        let mut controller = ComputedTorque::new(
            self.believed.arm,
            self.believed.drives,
            self.settings,
            self.period_s,
            standing.position_rad,
        );
        let mut motion = machine.start(State::at_rest(standing.position_rad), 0.0);
        let mut commands_a = [[0.0; 2]; 2];
        let mut followed = [Followed::default(); 2];
        for tick in 0..settling + samples {
            let moving_ns = tick.checked_sub(settling).map(|tick| tick * period_ns);
            let reference = |later_ns: u64| match moving_ns {
                None => standing,
                Some(time_ns) => movement.reference::<f64>(time_ns + later_ns),
            };
            let now = reference(0);
            let exact = machine.position_counts(&motion);
            let output = controller.tick(&ComputedTorqueInput {
                reference: now,
                reference_ahead: reference(ahead_ns),
                // Without rounding: what the controller takes for the exact position, but for a count about zero.
                encoder_counts: exact
                    .map(|counts| if self.encoders_round { counts.trunc() } else { counts - 0.5 * counts.signum() }),
            });
            let command_a = [0, 1].map(|joint: usize| {
                let scale = &scales[joint];
                let code = (output.command_a[joint] / scale.dac_a_per_code).round();
                if self.converters_round { code * scale.dac_a_per_code } else { output.command_a[joint] }
            });
            if moving_ns.is_some() {
                for (joint, followed) in followed.iter_mut().enumerate() {
                    let reference_counts = now.position_rad[joint] * counts_per_rad[joint];
                    let error = reference_counts - exact[joint];
                    let recorded = reference_counts.trunc() - exact[joint].trunc();
                    let [first, second] = commands_a;
                    let bend = command_a[joint] - 2.0 * second[joint] + first[joint];
                    followed.max_counts = followed.max_counts.max(error.abs());
                    followed.rms_counts += error * error;
                    followed.within_one_count += f64::from(u8::from(recorded.abs() <= 1.0));
                    followed.command_noise_a += bend * bend / 6.0;
                }
            }
            let before_a = commands_a[1];
            for (current_a, duration_s) in [(before_a, self.delay_s), (command_a, self.period_s - self.delay_s)] {
                let held = machine.fresh(machine.input(current_a), [0.0; 2]);
                let steps = (duration_s / LONGEST_STEP_S).ceil();
                for _ in 0..steps as usize {
                    motion = machine.step(&motion, &held, duration_s / steps);
                }
            }
            commands_a = [commands_a[1], command_a];
        }
        followed.map(|sums| {
            let n = samples as f64;
            Followed {
                max_counts: sums.max_counts,
                rms_counts: (sums.rms_counts / n).sqrt(),
                within_one_count: sums.within_one_count / n,
                command_noise_a: (sums.command_noise_a / n).sqrt(),
            }
        })
    }
}
