//! Seeded random numbers and disturbances. The same seed gives the same run on every machine.

use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng, SeedableRng};

/// What a stream of random numbers is for. Each purpose has its own stream, so that switching one disturbance on
/// does not change the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Parameters of a drawn robot.
    Robot = 1,
    /// Coefficients of a drawn reference.
    Reference = 2,
    /// Noise of the current measurement.
    Current = 3,
    /// Disturbing torque.
    Torque = 4,
}

/// A seeded stream of random numbers.
#[derive(Clone, Debug)]
pub struct RandomStream(Pcg64);

impl RandomStream {
    /// The stream for one purpose of one seed.
    #[must_use]
    pub fn new(seed: u64, purpose: Purpose) -> Self {
        // The golden-ratio constant spreads the few purposes over all 64 bits; the generator mixes the rest.
        Self(Pcg64::seed_from_u64(seed ^ (purpose as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)))
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        // 53 bits are what a double's mantissa holds.
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in [-1, 1).
    pub fn symmetric(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }

    /// Gaussian with mean zero and standard deviation one, by the Box–Muller transform.
    pub fn gaussian(&mut self) -> f64 {
        // 1 - uniform lies in (0, 1], where the logarithm is finite.
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// A random disturbing torque with memory (a first-order Gauss–Markov process), independent in the two joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueNoise {
    /// Standard deviation at each motor in N m.
    pub standard_deviation_nm: [f64; 2],
    /// Time after which the correlation has fallen to 1/e, in seconds.
    pub correlation_time_s: f64,
}

/// The running disturbance of one simulation.
#[derive(Clone, Debug)]
pub struct TorqueDisturbance {
    noise: Option<TorqueNoise>,
    random: RandomStream,
    motor_torque_nm: [f64; 2],
}

impl TorqueDisturbance {
    /// Begins in the steady state of `noise`; without noise the torque is always zero.
    #[must_use]
    pub fn new(noise: Option<TorqueNoise>, seed: u64) -> Self {
        let mut random = RandomStream::new(seed, Purpose::Torque);
        let standard_deviation_nm = noise.map_or([0.0; 2], |noise| noise.standard_deviation_nm);
        let motor_torque_nm = standard_deviation_nm.map(|deviation| deviation * random.gaussian());
        Self { noise, random, motor_torque_nm }
    }

    /// The disturbing motor torque in N m now; the next call gives the one `period_s` later.
    pub fn next_nm(&mut self, period_s: f64) -> [f64; 2] {
        let now = self.motor_torque_nm;
        if let Some(noise) = self.noise {
            // Exact for this process at any period, so the loop period does not change the noise.
            let kept = (-period_s / noise.correlation_time_s).exp();
            let fresh = (1.0 - kept * kept).sqrt();
            for (torque, deviation) in self.motor_torque_nm.iter_mut().zip(noise.standard_deviation_nm) {
                *torque = kept * *torque + fresh * deviation * self.random.gaussian();
            }
        }
        now
    }
}
