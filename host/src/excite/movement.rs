//! The movements to choose from: Fourier series that keep every limit on the reference by construction.

use shared::control::JointReference;
use shared::trajectory::{Fourier, Harmonic, Margin, MotionLimits, Quantity, Trajectory};

/// Share of a limit that a movement uses: what the f32 coefficients and the points between the grid's may add.
const USED: f64 = 0.99;

/// Points of the grid per period of the highest harmonic: a peak between two of them is missed by under 0.2 %.
const POINTS_PER_WAVE: usize = 64;

/// A family of movements of one duration, as numbers without limits of their own.
pub struct MovementSpace {
    limits: MotionLimits,
    /// Greatest speed of each joint in rad/s by whichever limit is tighter, speed or counts per tick.
    speed_rad_s: [f64; 2],
    period_ns: u64,
    repeats: u32,
    harmonics: usize,
    /// Sine and cosine of each harmonic at each point of the grid.
    waves: Vec<Vec<(f64, f64)>>,
}

impl MovementSpace {
    /// Movements of `repeats` periods within `limits`; `counts_per_rad` and the record period say what counts per
    /// tick mean.
    pub fn new(
        limits: MotionLimits,
        counts_per_rad: [f64; 2],
        record_period_s: f64,
        (period_ns, repeats): (u64, u32),
        harmonics: usize,
    ) -> Self {
        let points = POINTS_PER_WAVE * harmonics;
        let wave = |order: usize, point: usize| {
            (std::f64::consts::TAU * (order * point % points) as f64 / points as f64).sin_cos()
        };
        let waves =
            (0..points).map(|point| (1..=harmonics).map(|order| wave(order, point)).collect::<Vec<_>>()).collect();
        let speed_rad_s = std::array::from_fn(|joint| {
            let counting = f64::from(limits.counts_per_tick) / (counts_per_rad[joint].abs() * record_period_s);
            counting.min(f64::from(limits.speed_rad_s[joint]))
        });
        Self { limits, speed_rad_s, period_ns, repeats, harmonics, waves }
    }

    /// Numbers that describe a movement; each is of the order of 1.
    pub fn numbers(&self) -> usize {
        2 * (2 * self.harmonics + 1)
    }

    /// The movement that `numbers` describe: cosine and sine amplitudes of each joint, then its centre. Sines are
    /// freed from what would start the arm with a jerk, and the whole is made as small as the limits ask.
    pub fn movement(&self, numbers: &[f64]) -> Trajectory {
        self.repeated(numbers, self.repeats)
    }

    /// One period of that movement.
    pub fn period(&self, numbers: &[f64]) -> Trajectory {
        self.repeated(numbers, 1)
    }

    fn repeated(&self, numbers: &[f64], repeats: u32) -> Trajectory {
        let mut fourier = Fourier {
            period_ns: self.period_ns,
            repeats,
            fade_ns: 0,
            centre_rad: [0.0; 2],
            harmonics: heapless::Vec::new(),
        };
        let mut amplitudes = [(); 2].map(|()| Vec::new());
        for (joint, numbers) in numbers.chunks(2 * self.harmonics + 1).enumerate().take(2) {
            let (series, centre) = self.joint(joint, numbers);
            fourier.centre_rad[joint] = centre as f32;
            amplitudes[joint] = series;
        }
        for (second, third) in amplitudes[0].iter().zip(&amplitudes[1]) {
            // Space for MAX_HARMONICS, which the caller keeps to.
            let _ = fourier.harmonics.push(Harmonic {
                cosine_rad: [second[0] as f32, third[0] as f32],
                sine_rad: [second[1] as f32, third[1] as f32],
            });
        }
        Trajectory::Fourier(fourier)
    }

    /// Cosine and sine amplitudes of one joint in rad, and its centre in rad.
    fn joint(&self, joint: usize, numbers: &[f64]) -> (Vec<[f64; 2]>, f64) {
        let [low, high] = [self.limits.position_low_rad[joint], self.limits.position_high_rad[joint]].map(f64::from);
        let half_range = 0.5 * (high - low);
        // Higher harmonics are fast already at small amplitudes.
        let mut series: Vec<[f64; 2]> = (0..self.harmonics)
            .map(|index| {
                let size = half_range / (index + 1) as f64;
                [size * numbers[index], size * numbers[self.harmonics + index]]
            })
            .collect();
        // At rest at the start: Σ k·sine_k = 0. The nearest such amplitudes, measured in the numbers.
        let moving: f64 = series.iter().zip(1..).map(|(pair, order)| f64::from(order) * pair[1]).sum();
        let share = moving / self.harmonics as f64;
        for (pair, order) in series.iter_mut().zip(1..) {
            pair[1] -= share / f64::from(order);
        }

        let omega = std::f64::consts::TAU / (self.period_ns as f64 * 1e-9);
        let (mut lowest, mut highest, mut speed, mut acceleration) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        for waves in &self.waves {
            let (mut position, mut rate, mut bend) = (0.0, 0.0, 0.0);
            for ((pair, &(sine, cosine)), order) in series.iter().zip(waves).zip(1..) {
                let frequency = f64::from(order) * omega;
                let wave = pair[0] * cosine + pair[1] * sine;
                position += wave;
                rate += frequency * (pair[1] * cosine - pair[0] * sine);
                bend -= frequency * frequency * wave;
            }
            lowest = lowest.min(position);
            highest = highest.max(position);
            speed = speed.max(rate.abs());
            acceleration = acceleration.max(bend.abs());
        }
        let fits = [
            2.0 * half_range / (highest - lowest),
            self.speed_rad_s[joint] / speed,
            f64::from(self.limits.acceleration_rad_s2[joint]) / acceleration,
        ];
        let scale = fits.into_iter().map(|fit| USED * fit).fold(1.0, f64::min);
        for pair in &mut series {
            *pair = pair.map(|amplitude| scale * amplitude);
        }
        // The centre moves within what the extent leaves of the range.
        let room = half_range - 0.5 * scale * (highest - lowest);
        let middle = 0.5 * (low + high) - 0.5 * scale * (highest + lowest);
        (series, middle + USED * room * numbers[2 * self.harmonics].tanh())
    }
}

/// The references of a movement at every record period, in rad.
pub fn references_rad(movement: &Trajectory, record_period_s: f64) -> Vec<[f64; 2]> {
    let record_period_ns = (record_period_s * 1e9).round() as u64;
    let reference = |tick: u64| {
        let JointReference { position_rad, .. } = movement.reference::<f64>(tick * record_period_ns);
        position_rad
    };
    (0..movement.record_periods(record_period_ns)).map(reference).collect()
}

/// The margin that holds a joint's movement back most, and what it leaves as a share of its limit: of the position the
/// whole range counts.
pub fn tightest(margins: &[Margin], limits: &MotionLimits, joint: usize) -> Option<(Margin, f64)> {
    let left = |margin: &Margin| match margin.quantity {
        Quantity::PositionLow | Quantity::PositionHigh => {
            margin.left() / (limits.position_high_rad[joint] - limits.position_low_rad[joint])
        }
        _ => margin.left() / margin.limit,
    };
    let of_joint = margins.iter().filter(|margin| {
        usize::from(margin.joint) == joint && !matches!(margin.quantity, Quantity::StartSpeed | Quantity::EndSpeed)
    });
    of_joint.map(|margin| (*margin, f64::from(left(margin)))).min_by(|a, b| a.1.total_cmp(&b.1))
}
