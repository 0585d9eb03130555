//! Arm and controller from sample to sample.

use nalgebra::{Complex, DMatrix, Matrix2};
use shared::control::ComputedTorqueSettings;

use super::plant::LinearArm;

/// When the controller samples and acts.
pub(super) struct Timing {
    pub(super) period_s: f64,
    pub(super) command_delay_s: f64,
}

/// The loop as a map from one sample to the next: the arm's state, the torques commanded before, and the observer's
/// positions and velocities.
pub(super) struct ClosedLoop {
    /// Without any command.
    free: DMatrix<f64>,
    /// What each joint's command adds.
    driven: [DMatrix<f64>; 2],
}

/// Largest gain that is looked for.
const LARGEST_GAIN: f64 = 1e3;

/// Gains are found to a ten-thousandth of their logarithm.
const BISECTIONS: usize = 40;

impl ClosedLoop {
    /// `inertia` is the controller's.
    pub(super) fn new(
        arm: &LinearArm,
        inertia: Matrix2<f64>,
        settings: &ComputedTorqueSettings<f64>,
        timing: &Timing,
    ) -> Self {
        let LinearArm { a, b, c } = arm;
        let n = a.nrows();
        // The matrix exponential of state and held input together gives both at once.
        let held = |duration_s: f64| {
            let mut both = DMatrix::zeros(n + 2, n + 2);
            both.view_mut((0, 0), (n, n)).copy_from(&(a * duration_s));
            both.view_mut((0, n), (n, 2)).copy_from(&(b * duration_s));
            let both = both.exp();
            (both.view((0, 0), (n, n)).into_owned(), both.view((0, n), (n, 2)).into_owned())
        };
        let (early, before) = held(timing.command_delay_s);
        let (late, anew) = held(timing.period_s - timing.command_delay_s);

        // The law of `ComputedTorque::tick` for one joint, by y the angle seen, p the angle and v the velocity predicted:
        // acceleration wanted, and what p and v are next.
        let period_s = timing.period_s;
        let pole = 1.0 / (1.0 + settings.observer_bandwidth_rad_s * period_s);
        let position_correction = 1.0 - pole * pole;
        let velocity_correction = (1.0 - pole) * (1.0 - pole) / period_s;
        let omega = settings.bandwidth_rad_s;
        let per_velocity = -2.0 * settings.damping_ratio * omega;
        let per_position = -omega * omega;
        // [y, p, v] → corrected position, corrected velocity, acceleration, then predictions.
        let position = [position_correction, 1.0 - position_correction, 0.0];
        let velocity = [velocity_correction, -velocity_correction, 1.0];
        let both = |first: [f64; 3], weight: f64, second: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|index| first[index] + weight * second[index])
        };
        let wanted = both(velocity.map(|value| per_velocity * value), per_position, position);
        let next_position = both(both(position, period_s, velocity), 0.5 * period_s * period_s, wanted);
        let next_velocity = both(velocity, period_s, wanted);

        let states = n + 6;
        let (held_at, position_at, velocity_at) = (n, n + 2, n + 4);
        let row = |[y, p, v]: [f64; 3], joint: usize| {
            let mut row = DMatrix::zeros(1, states);
            row.view_mut((0, 0), (1, n)).copy_from(&(c.row(joint) * y));
            row[(0, position_at + joint)] = p;
            row[(0, velocity_at + joint)] = v;
            row
        };
        let mut free = DMatrix::zeros(states, states);
        free.view_mut((0, 0), (n, n)).copy_from(&(&late * early));
        free.view_mut((0, held_at), (n, 2)).copy_from(&(late * before));
        for joint in 0..2 {
            free.row_mut(position_at + joint).copy_from(&row(next_position, joint));
            free.row_mut(velocity_at + joint).copy_from(&row(next_velocity, joint));
        }
        let driven = [0, 1].map(|joint: usize| {
            // The torque of one joint takes both accelerations.
            let torque = row(wanted, 0) * inertia[(joint, 0)] + row(wanted, 1) * inertia[(joint, 1)];
            let mut driven = DMatrix::zeros(states, states);
            driven.view_mut((0, 0), (n, states)).copy_from(&(anew.column(joint) * &torque));
            driven.row_mut(held_at + joint).copy_from(&torque);
            driven
        });
        Self { free, driven }
    }

    /// Poles where each joint's command is multiplied by a gain.
    fn poles(&self, gains: [f64; 2]) -> Vec<Complex<f64>> {
        let matrix = &self.free + &self.driven[0] * gains[0] + &self.driven[1] * gains[1];
        matrix.complex_eigenvalues().iter().copied().collect()
    }

    /// Largest magnitude of a pole.
    pub(super) fn spectral_radius(&self, gains: [f64; 2]) -> f64 {
        self.poles(gains).iter().map(|pole| pole.norm()).fold(0.0, f64::max)
    }

    /// The gain of both commands at which the stable loop becomes unstable first.
    pub(super) fn largest_gain(&self) -> f64 {
        let stable = |gain: f64| self.spectral_radius([gain; 2]) < 1.0;
        let (mut low, mut high) = (1.0, 1.05);
        while stable(high) && high < LARGEST_GAIN {
            (low, high) = (high, 1.05 * high);
        }
        for _ in 0..BISECTIONS {
            let middle = (low * high).sqrt();
            if stable(middle) { low = middle } else { high = middle }
        }
        low
    }

    /// The loop opened at one joint's command.
    pub(super) fn opened(&self, joint: usize) -> OpenLoop {
        let mut gains = [1.0; 2];
        let closed = self.poles(gains);
        gains[joint] = 0.0;
        OpenLoop { closed, open: self.poles(gains) }
    }
}

/// An open loop's response, from the poles with it closed and open: `1 + L(z) = det(z − A_closed)/det(z − A_open)`.
pub(super) struct OpenLoop {
    closed: Vec<Complex<f64>>,
    open: Vec<Complex<f64>>,
}

impl OpenLoop {
    /// L(z).
    pub(super) fn at(&self, z: Complex<f64>) -> Complex<f64> {
        // In pairs, so that nothing overflows.
        let ratio: Complex<f64> =
            self.closed.iter().zip(&self.open).map(|(closed, open)| (z - closed) / (z - open)).product();
        ratio - 1.0
    }
}
