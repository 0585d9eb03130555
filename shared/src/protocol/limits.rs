//! Limits that act without stopping the arm, by name.

use super::Joint;
use serde::{Deserialize, Serialize};

/// A limit that changed what was commanded or stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum ActiveLimit {
    /// The command of joint 2 was cut to `current_limit_a`.
    CurrentLimitSecond = 0,
    /// The command of joint 3 was cut to `current_limit_a`.
    CurrentLimitThird = 1,
    /// The command of joint 2 was beyond the converter's codes.
    ConverterRangeSecond = 2,
    /// The command of joint 3 was beyond the converter's codes.
    ConverterRangeThird = 3,
}

impl ActiveLimit {
    /// Every limit.
    pub const ALL: [Self; 4] =
        [Self::CurrentLimitSecond, Self::CurrentLimitThird, Self::ConverterRangeSecond, Self::ConverterRangeThird];

    /// The current limit of a joint.
    pub fn current(joint: Joint) -> Self {
        match joint {
            Joint::Second => Self::CurrentLimitSecond,
            Joint::Third => Self::CurrentLimitThird,
        }
    }

    /// The converter's range of a joint.
    pub fn converter(joint: Joint) -> Self {
        match joint {
            Joint::Second => Self::ConverterRangeSecond,
            Joint::Third => Self::ConverterRangeThird,
        }
    }

    /// The limit's name, with the setting that sets it.
    pub fn name(self) -> &'static str {
        match self {
            Self::CurrentLimitSecond => "current_limit_a of joint 2",
            Self::CurrentLimitThird => "current_limit_a of joint 3",
            Self::ConverterRangeSecond => "converter range (dac_a_per_code) of joint 2",
            Self::ConverterRangeThird => "converter range (dac_a_per_code) of joint 3",
        }
    }
}

/// A set of [`ActiveLimit`]s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LimitsActive(u8);

impl LimitsActive {
    /// No limit.
    pub const NONE: Self = Self(0);

    /// Adds a limit.
    pub fn insert(&mut self, limit: ActiveLimit) {
        self.0 |= 1 << limit as u8;
    }

    /// Adds every limit of another set.
    pub fn merge(&mut self, other: Self) {
        self.0 |= other.0;
    }

    /// Whether a limit is in the set.
    pub fn contains(self, limit: ActiveLimit) -> bool {
        self.0 & (1 << limit as u8) != 0
    }

    /// Whether no limit acted.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The limits in the set.
    pub fn iter(self) -> impl Iterator<Item = ActiveLimit> {
        ActiveLimit::ALL.into_iter().filter(move |&limit| self.contains(limit))
    }
}
