//! References made of a few sines and cosines that begin and end at rest.

use std::f64::consts::{FRAC_PI_4, TAU};

use super::noise::{Purpose, RandomStream};

/// A finite Fourier series for both joints over one base period, beginning and ending at rest at the same pose.
#[derive(Clone, Debug, PartialEq)]
pub struct FourierSeries {
    period_s: f64,
    offset_rad: [f64; 2],
    cosine_rad: [Vec<f64>; 2],
    sine_rad: [Vec<f64>; 2],
}

impl FourierSeries {
    /// A series from its amplitudes in radians; entry 0 belongs to the base frequency `1 / period_s`.
    ///
    /// The base sine is not given but chosen so that the speed at the start is zero; the offset so that the start
    /// is `start_rad`. `higher_sine_rad` therefore begins with the second harmonic.
    #[must_use]
    pub fn at_rest(
        period_s: f64,
        start_rad: [f64; 2],
        cosine_rad: [Vec<f64>; 2],
        higher_sine_rad: [Vec<f64>; 2],
    ) -> Self {
        let offset_rad = std::array::from_fn(|joint| start_rad[joint] - cosine_rad[joint].iter().sum::<f64>());
        let sine_rad = higher_sine_rad.map(|higher| {
            let base =
                -higher.iter().zip(2..).map(|(amplitude, harmonic)| amplitude * f64::from(harmonic)).sum::<f64>();
            std::iter::once(base).chain(higher).collect()
        });
        Self { period_s, offset_rad, cosine_rad, sine_rad }
    }

    /// A random series decided by `seed` alone, with five harmonics, around the middle of the paper's workspace:
    /// `q2` within ±π/4 of -π/4, `q3` within ±π/4 of π/4. Each joint uses its range fully unless that would take it
    /// beyond 2 rad/s.
    #[must_use]
    pub fn draw(seed: u64, period_s: f64) -> Self {
        const HARMONICS: usize = 5;
        const LARGEST_EXCURSION_RAD: f64 = FRAC_PI_4;
        const LARGEST_SPEED_RAD_S: f64 = 2.0;
        const GRID: u32 = 2000;
        let mut random = RandomStream::new(seed, Purpose::Reference);
        // Amplitudes fall with the harmonic so that no single one rules the accelerations.
        let mut amplitudes = |first: usize| -> Vec<f64> {
            (first..=HARMONICS).map(|harmonic| random.symmetric() / harmonic as f64).collect()
        };
        let cosine_rad = [amplitudes(1), amplitudes(1)];
        let sine_rad = [amplitudes(2), amplitudes(2)];
        let mut series = Self::at_rest(period_s, [0.0; 2], cosine_rad, sine_rad);
        for (joint, centre_rad) in [-FRAC_PI_4, FRAC_PI_4].into_iter().enumerate() {
            let times = || (0..GRID).map(|point| period_s * f64::from(point) / f64::from(GRID));
            let angles = || times().map(|time_s| series.angle_rad(time_s)[joint]);
            let (lowest, highest) = angles()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), angle| (low.min(angle), high.max(angle)));
            let fastest = times().map(|time_s| series.velocity_rad_s(time_s)[joint].abs()).fold(0.0, f64::max);
            let scale = (2.0 * LARGEST_EXCURSION_RAD / (highest - lowest)).min(LARGEST_SPEED_RAD_S / fastest);
            let middle = 0.5 * (lowest + highest);
            series.offset_rad[joint] = centre_rad + scale * (series.offset_rad[joint] - middle);
            for amplitude in series.cosine_rad[joint].iter_mut().chain(&mut series.sine_rad[joint]) {
                *amplitude *= scale;
            }
        }
        series
    }

    /// Duration of the movement in seconds.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Joint angles in radians at `time_s`.
    #[must_use]
    pub fn angle_rad(&self, time_s: f64) -> [f64; 2] {
        std::array::from_fn(|joint| {
            self.offset_rad[joint]
                + self.terms(joint).map(|(speed, cosine, sine)| wave(speed * time_s, cosine, sine)).sum::<f64>()
        })
    }

    /// Joint speeds in rad/s at `time_s`.
    #[must_use]
    pub fn velocity_rad_s(&self, time_s: f64) -> [f64; 2] {
        std::array::from_fn(|joint| {
            self.terms(joint).map(|(speed, cosine, sine)| speed * wave(speed * time_s, sine, -cosine)).sum()
        })
    }

    /// Angular frequency in rad/s, cosine and sine amplitude of every harmonic of a joint.
    fn terms(&self, joint: usize) -> impl Iterator<Item = (f64, f64, f64)> {
        let harmonics = self.cosine_rad[joint].len().max(self.sine_rad[joint].len());
        (0..harmonics).map(move |index| {
            let amplitude = |amplitudes: &[f64]| amplitudes.get(index).copied().unwrap_or(0.0);
            let speed_rad_s = TAU * (index + 1) as f64 / self.period_s;
            (speed_rad_s, amplitude(&self.cosine_rad[joint]), amplitude(&self.sine_rad[joint]))
        })
    }
}

fn wave(phase_rad: f64, cosine: f64, sine: f64) -> f64 {
    cosine * phase_rad.cos() + sine * phase_rad.sin()
}
