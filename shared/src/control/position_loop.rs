//! The decentralised position loop, `u = G (e + β (e − e_previous))`, and how large its gain may be.

use crate::scalar::Scalar;

/// Position gain and lead of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionLoop<S> {
    /// Current per count of tracking error, A/count.
    pub gain_a_per_count: S,
    /// Lead β: how many ticks ahead the error is extrapolated. 0 is the pure P loop.
    pub lead: S,
}

impl<S: Scalar> PositionLoop<S> {
    /// The commanded current in A, before the amplifier's limit.
    #[inline(always)]
    pub fn command_a(&self, error_counts: S, previous_error_counts: S) -> S {
        self.gain_a_per_count * self.lead.mul_add(error_counts - previous_error_counts, error_counts)
    }
}

/// What decides how stiff a sampled position loop may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledLoop {
    /// Loop period in s.
    pub period_s: f64,
    /// From sampling the encoder to the new current, in s; at most the period.
    pub command_delay_s: f64,
    /// Viscous friction at the motor in N m s/rad: all the damping the loop has.
    pub viscous_friction_nm_s_per_rad: f64,
    /// Encoder counts per motor turn.
    pub counts_per_rev: f64,
    /// The least inertia the motor may feel, gear included, in kg m² at the motor (joint inertia / ratio²). Half of
    /// what it feels with the other joint free covers the coupling of two loops that are both at their limits.
    pub least_motor_inertia_kg_m2: f64,
    /// Lead β of the loop.
    pub lead: f64,
}

/// The largest stable gain, in N m of motor torque per count, and what sets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StabilityLimit {
    /// The delay of sampling outweighs viscous friction and lead.
    Damping(f64),
    /// The lead makes the loop unstable near the sampling frequency.
    LeadBandwidth(f64),
}

impl StabilityLimit {
    /// The limit in N m of motor torque per count.
    pub fn nm_per_count(&self) -> f64 {
        match *self {
            Self::Damping(limit) | Self::LeadBandwidth(limit) => limit,
        }
    }

    /// What sets the limit, in words.
    pub fn cause(&self) -> &'static str {
        match self {
            Self::Damping(_) => "viscous friction against the delay of sampling",
            Self::LeadBandwidth(_) => "the lead's gain near the sampling frequency",
        }
    }
}

/// A gain that the sampled loop would not survive.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "position gain {gain_nm_per_count:.5} N m/count is not below the stability limit {limit_nm_per_count:.5} N m/count \
     set by {cause}; lower the gain, shorten the loop period or change the lead"
)]
pub struct GainError {
    /// The gain asked for.
    pub gain_nm_per_count: f64,
    /// The limit it must stay below.
    pub limit_nm_per_count: f64,
    /// What sets the limit.
    pub cause: &'static str,
}

impl SampledLoop {
    /// The largest stable gain of one joint's loop.
    ///
    /// The held command acts Td = period/2 + delay late on average, which takes G N/2π · Td from the viscous damping
    /// Bv, and lead β gives G N/2π · β·period back. So without enough lead G must stay below
    /// `Bv 2π / (N (Td − β period))` (design §4; for β = 0 the well-known `Bv 2π / (N Td)`).
    /// A lead also amplifies what is near the sampling frequency, which bounds G by the motor's inertia J: without
    /// friction and delay `G N/2π · period²/J < 2 (2β − 1)/(β (2β + 1))`. Where both matter neither formula holds
    /// (near Td = β period the first is infinite and the second zero), and a delay lowers the second, at 0.7 ms and
    /// 30 µs by 6 %. So the limit is found on the exact sampled loop, and never above the damping
    /// limit.
    ///
    /// Valid for delays up to one period; a longer one gets a limit of 0. Left out: flexibility of the joint, and the
    /// coupling of the joints beyond the least inertia.
    #[inline]
    pub fn stability_limit(&self) -> StabilityLimit {
        if !(0.0..=self.period_s).contains(&self.command_delay_s) {
            return StabilityLimit::Damping(0.0);
        }
        let unit = UnitLoop::new(self);
        let counts_per_rad = self.counts_per_rev / core::f64::consts::TAU;
        let unit_gain = self.least_motor_inertia_kg_m2 / (self.period_s * self.period_s * counts_per_rad);
        let exact = unit.largest_stable_gain() * unit_gain;
        let damping = self.damping_limit();
        if exact >= damping {
            StabilityLimit::Damping(damping)
        } else if exact >= 0.5 * damping {
            StabilityLimit::Damping(exact)
        } else {
            StabilityLimit::LeadBandwidth(exact)
        }
    }

    /// The gain at which the delay eats the viscous friction up; infinite where the lead pays for the delay.
    fn damping_limit(&self) -> f64 {
        let counts_per_rad = self.counts_per_rev / core::f64::consts::TAU;
        let unpaid_delay_s = 0.5 * self.period_s + self.command_delay_s - self.lead * self.period_s;
        if unpaid_delay_s > 0.0 {
            self.viscous_friction_nm_s_per_rad / (counts_per_rad * unpaid_delay_s)
        } else {
            f64::INFINITY
        }
    }

    /// Accepts a gain in N m of motor torque per count only from zero up to, not including, the limit. NaN is
    /// refused.
    #[inline]
    pub fn check_gain(&self, gain_nm_per_count: f64) -> Result<(), GainError> {
        let limit = self.stability_limit();
        if gain_nm_per_count >= 0.0 && gain_nm_per_count < limit.nm_per_count() {
            return Ok(());
        }
        Err(GainError { gain_nm_per_count, limit_nm_per_count: limit.nm_per_count(), cause: limit.cause() })
    }
}

/// The loop with time counted in periods and the inertia taken as 1, seen at its sampling instants.
///
/// Between two samples the command before acts for the delay, the new one for the rest, so the position follows the
/// command as `N(z) / (z (z − 1)(z − e))` and the loop's poles solve
/// `z² (z − 1)(z − e) + κ N(z) ((1 + β) z − β) = 0`, e the decay of velocity over a period. With
/// `z = (1 + w)/(1 − w)` they lie inside the unit circle where the roots w lie left of the imaginary axis.
struct UnitLoop {
    /// 1 − e, to full precision.
    loss: f64,
    /// N as a polynomial in w.
    numerator: [f64; 3],
    lead: f64,
}

/// What a unit force does in `time` to a unit mass at rest with viscous friction `friction`: how far it goes and how
/// fast it gets.
#[inline]
fn pushed(friction: f64, time: f64) -> (f64, f64) {
    let x = friction * time;
    // (1 − exp(−x))/x and (x − 1 + exp(−x))/x², by their series where the formulas cancel (error below 1e-12).
    let (speed, distance) = if x < 0.02 {
        (
            1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0)))),
            0.5 - x / 6.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0 * (1.0 - x / 7.0)))),
        )
    } else {
        let speed = -libm::expm1(-x) / x;
        (speed, (1.0 - speed) / x)
    };
    (time * time * distance, time * speed)
}

impl UnitLoop {
    fn new(sampled: &SampledLoop) -> Self {
        let friction = sampled.viscous_friction_nm_s_per_rad * sampled.period_s / sampled.least_motor_inertia_kg_m2;
        let late = sampled.command_delay_s / sampled.period_s;
        let prompt = 1.0 - late;
        let (drift, period_speed) = (pushed(friction, prompt).1, pushed(friction, 1.0).1);
        let loss = friction * period_speed;
        let decay = 1.0 - loss;
        // Where the command before has brought the mass at the end of the period, then the new one.
        let (late_distance, late_speed) = pushed(friction, late);
        let before = (late_distance + drift * late_speed, late_speed * (1.0 - friction * drift));
        let new = pushed(friction, prompt);
        let [n2, n1, n0] =
            [new.0, before.0 - decay * new.0 + period_speed * new.1, period_speed * before.1 - decay * before.0];
        // n2 + n1 + n0 = period_speed.
        Self { loss, numerator: [period_speed, 2.0 * (n2 - n0), n2 - n1 + n0], lead: sampled.lead }
    }

    /// Whether every pole lies inside the unit circle (Hurwitz criterion of the quartic in w).
    #[inline]
    fn is_stable(&self, gain: f64) -> bool {
        let Self { loss, numerator: [m0, m1, m2], lead } = *self;
        let kept = 2.0 - loss;
        let twice = 2.0 * lead;
        let a0 = gain * m0;
        let a1 = 2.0 * loss + gain * (m1 + twice * m0);
        let a2 = 2.0 * (kept + 2.0 * loss) + gain * (m2 + twice * m1 - (1.0 + twice) * m0);
        let a3 = 2.0 * (2.0 * kept + loss) + gain * (twice * m2 - (1.0 + twice) * m1);
        let a4 = 2.0 * kept - gain * (1.0 + twice) * m2;
        [a0, a1, a2, a3, a4].iter().all(|&coefficient| coefficient > 0.0) && a3 * (a2 * a1 - a3 * a0) > a4 * a1 * a1
    }

    /// The gain below which the loop is stable: zero where it never is. The stable gains form one interval from 0.
    fn largest_stable_gain(&self) -> f64 {
        let (mut stable, mut unstable) = (0.0, 1.0);
        while self.is_stable(unstable) && unstable < 1.0e12 {
            stable = unstable;
            unstable += unstable;
        }
        for _ in 0..100 {
            let middle = 0.5 * (stable + unstable);
            if self.is_stable(middle) {
                stable = middle;
            } else {
                unstable = middle;
            }
        }
        stable
    }
}
