//! What a model knows of one joint beyond f and friction, for computed torque to compensate.

use super::{Joint, ModelError};
use crate::effects::JointEffects;
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

macro_rules! numbers {
    ($(#[$of_type:meta])* $name:ident { $($(#[$of_field:meta])* $field:ident $low:literal ..= $high:literal,)* }) => {
        $(#[$of_type])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name {
            $($(#[$of_field])* pub $field: f32,)*
        }

        impl $name {
            /// Names of the numbers, in their order.
            pub const NAMES: &[&str] = &[$(stringify!($field),)*];
            const COUNT: usize = Self::NAMES.len();
            /// Least and greatest value of each.
            const RANGES: [[f32; 2]; Self::COUNT] = [$([$low, $high],)*];

            /// No effect.
            pub const NONE: Self = Self { $($field: JointEffects::OFF_SINGLE.$field,)* };

            fn numbers(&self) -> [f32; Self::COUNT] {
                [$(self.$field,)*]
            }

            fn from_numbers(numbers: [f32; Self::COUNT]) -> Self {
                let [$($field,)*] = numbers;
                Self { $($field,)* }
            }

            /// The effects that these numbers are of; all others off.
            #[inline(always)]
            pub(crate) fn effects(&self) -> JointEffects<f32> {
                JointEffects { $($field: self.$field,)* ..JointEffects::OFF_SINGLE }
            }
        }
    };
}

numbers! {
    /// Effects of one joint that computed torque compensates, with the meaning they have in [`JointEffects`]: what is not
    /// among them is either part of f and friction already, or cannot be compensated.
    ///
    /// On the wire: its numbers one after the other, little endian, as bytes. A reader of each number by itself would take
    /// ten times the flash.
    JointCompensation {
        /// Torque the motor has to overcome, N m; half the difference of Coulomb friction by direction included, which
        /// is the same to a moving motor.
        torque_offset_nm -100.0 ..= 100.0,
        /// Relative change of the torque constant.
        torque_constant_change -0.9 ..= 10.0,
        /// Viscous friction forward less that backward, N m s/rad at the motor.
        viscous_asymmetry_nm_s_per_rad -1000.0 ..= 1000.0,
        /// Friction per square of the motor's speed, N m s²/rad².
        quadratic_nm_s2_per_rad2 -1000.0 ..= 1000.0,
        /// Friction at rest beyond Coulomb friction, N m at the motor.
        stribeck_nm -100.0 ..= 100.0,
        /// Motor speed at which 1/e of it is left, rad/s.
        stribeck_velocity_rad_s 1e-4 ..= 1000.0,
        /// How it falls: 1 as exp(−x²), 0 as exp(−x).
        stribeck_sharpness 0.0 ..= 1.0,
        /// Coulomb friction per torque that the gear transmits.
        load_friction_coefficient -1.0 ..= 1.0,
        /// Inertia on the motor's side of the gear, kg m² at the motor: its torque is not the gear's.
        motor_inertia_kg_m2 0.0 ..= 10.0,
        /// Amplitude of Coulomb friction over the joint's angle, N m at the motor.
        position_friction_nm -100.0 ..= 100.0,
        /// Its periods per joint revolution.
        position_friction_order 0.0 ..= 1000.0,
        /// Its phase in rad.
        position_friction_phase_rad -6.3 ..= 6.3,
        /// Relative amplitude of the torque constant over the motor's angle; at 1 there would be angles without torque.
        ripple_share -0.5 ..= 0.5,
        /// Its periods per motor revolution.
        ripple_order 0.0 ..= 24.0,
        /// Its phase in rad, at the pose that was declared before the model was uploaded.
        ripple_phase_rad -6.3 ..= 6.3,
        /// Amplitude of a motor torque over the motor's angle, N m.
        cogging_nm -100.0 ..= 100.0,
        /// Its periods per motor revolution.
        cogging_order 0.0 ..= 24.0,
        /// Its phase in rad, at the pose that was declared before the model was uploaded.
        cogging_phase_rad -6.3 ..= 6.3,
        /// Torque amplitude of a balance spring, N m at the joint.
        spring_nm -10000.0 ..= 10000.0,
        /// Joint angle at which it pulls most in positive direction, rad.
        spring_angle_rad -6.3 ..= 6.3,
    }
}

/// Bytes of one number.
const NUMBER_BYTES: usize = size_of::<f32>();

impl JointCompensation {
    /// Bytes of all numbers.
    const BYTES: usize = Self::COUNT * NUMBER_BYTES;

    /// Ripple and cogging off: their phases count from where the encoder was switched on, and hold only as long as the
    /// pose does that was declared then.
    pub(crate) fn forget_phases(&mut self) {
        self.ripple_share = 0.0;
        self.cogging_nm = 0.0;
    }

    /// Whether something of it counts from where the encoder was switched on.
    pub fn has_phases(&self) -> bool {
        self.ripple_share != 0.0 || self.cogging_nm != 0.0
    }

    /// Accepts numbers in their ranges only; a NaN is in none.
    #[inline(never)]
    pub(super) fn check(&self, joint: Joint) -> Result<(), ModelError> {
        for (number, (value, [low, high])) in (0..).zip(self.numbers().into_iter().zip(Self::RANGES)) {
            if !(low..=high).contains(&value) {
                return Err(ModelError::Compensation { joint, number, value, low, high });
            }
        }
        Ok(())
    }

    /// The numbers, little endian.
    #[inline(never)]
    pub(super) fn to_bytes(self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        for (place, number) in bytes.chunks_exact_mut(NUMBER_BYTES).zip(self.numbers()) {
            place.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    #[inline(never)]
    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        if bytes.len() != Self::BYTES {
            return None;
        }
        let mut numbers = [0.0; Self::COUNT];
        for (number, bytes) in numbers.iter_mut().zip(bytes.as_chunks::<NUMBER_BYTES>().0) {
            *number = f32::from_le_bytes(*bytes);
        }
        Some(Self::from_numbers(numbers))
    }
}

impl Serialize for JointCompensation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.to_bytes())
    }
}

impl<'de> Deserialize<'de> for JointCompensation {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Bytes;
        impl Visitor<'_> for Bytes {
            type Value = JointCompensation;

            fn expecting(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                formatter.write_str("the numbers of a joint")
            }

            fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<JointCompensation, E> {
                JointCompensation::from_bytes(bytes).ok_or_else(|| E::invalid_length(bytes.len(), &self))
            }
        }
        deserializer.deserialize_bytes(Bytes)
    }
}
